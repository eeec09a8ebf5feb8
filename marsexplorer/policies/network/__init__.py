"""Our own networks: the features of a board, the two models, and boards decided together.

`features` and `batch` need numpy alone; the models need the extra `networks` (torch and safetensors).
"""
