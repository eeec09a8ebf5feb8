"""MarsExplorer: explore unknown terrain with a lidar rover (Koutras et al. 2021).

Importing the package registers its environments with Gymnasium and loads nothing else;
`gymnasium.make("marsexplorer:MarsExplorer-v0")` imports it by itself.
"""

import os

import gymnasium

# ONNX Runtime from 1.31 on keeps an id of the machine in the user's home and reports to its makers, unless it finds this
# when it is loaded
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

gymnasium.register(
    id="MarsExplorer-v0",
    entry_point="marsexplorer.env:MarsExplorer",
    vector_entry_point="marsexplorer.vector:MarsExplorerVector",
)
gymnasium.register(
    id="KoutrasCode-v0",
    entry_point="marsexplorer.compat.env:KoutrasCode",
    vector_entry_point="marsexplorer.compat.env:KoutrasCodeVector",
)
gymnasium.register(id="exploConf-v1", entry_point="marsexplorer.compat.env:ExploConf")
