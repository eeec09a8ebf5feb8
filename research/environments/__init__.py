"""The public table of environments, each family in a virtual environment."""
