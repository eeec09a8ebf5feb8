"""Networks over our features: of one board, as a policy, and of many boards.

`features` and `batch` need numpy alone, `policy` the extra `play`. The network that is trained is
in `training.network`.
"""
