"""The commands of `marsexplorer`, one module each: NAME.py holds the click command NAME. Loaded when asked for."""
