"""Compiled helpers of several policies: distances, and what the lidar is to show.

Like all compiled code here they take whole arrays and plain numbers and allocate nothing (see
`marsexplorer.compiled`).
"""
