"""The public table of environments: each family examined in a virtual environment of its own."""
