"""Networks over our features: the features of a board, the policy that plays, and boards decided together.

`features` and `batch` need numpy alone, `policy` the extra `play`. The network that is trained is in `training.network`.
"""
