"""The paper's experiments, measured again: its algorithms, figures and claims.

Koutras et al. 2021, sections 3 to 5.
"""
