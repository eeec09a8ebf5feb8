"""Compiled helpers that several policies share: distances over the known map, and what the lidar is expected to show.

Like all compiled code here they take whole arrays and plain numbers and allocate nothing (see `marsexplorer.compiled`).
"""
