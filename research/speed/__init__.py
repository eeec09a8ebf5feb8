"""How fast the environment, its policies, the server and the page are: `python -m research.speed` and `make bench`."""
