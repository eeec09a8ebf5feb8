"""The paper's experiments, measured again: its four algorithms, its figures, its claims (Koutras et al. 2021, sections 3 to
5).
"""
