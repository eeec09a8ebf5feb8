"""Episodes of policies and untrained walks, and their measures for the figures."""
