"""MarsExplorer: explore unknown terrain with a lidar rover (Koutras et al. 2021)."""
