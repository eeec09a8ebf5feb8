"""MarsExplorer: explore unknown terrain with a lidar rover (Koutras et al. 2021).

Importing the package registers MarsExplorer-v0 with Gymnasium and loads nothing else;
`gymnasium.make("marsexplorer:MarsExplorer-v0")` imports it by itself.
"""

import gymnasium

gymnasium.register(
    id="MarsExplorer-v0",
    entry_point="marsexplorer.env:MarsExplorer",
    vector_entry_point="marsexplorer.vector:MarsExplorerVector",
)
