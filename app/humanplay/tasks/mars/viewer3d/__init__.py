"""The 3-D view of a board, drawn by viser from what the rover has discovered.

`viewer` keeps one scene for each browser that looks, `scene`, `textures` and `camera` fill it, and `viser_transport` lets
viser use the app's own websockets.
"""
