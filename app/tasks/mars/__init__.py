"""MarsExplorer on a board: its episode as it is played and as it may be seen."""
