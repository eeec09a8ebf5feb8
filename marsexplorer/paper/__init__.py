"""The paper's experiments, measured again: its four algorithms, its figures, its claims (Koutras et al. 2021, sections 3 to 5).

`job` says what the command `marsexplorer paper` runs, `trial` is one training as such a job, and `trainer` is what each
algorithm has to fulfil. Import from the modules: they load torch, and the command's help must not.
"""
