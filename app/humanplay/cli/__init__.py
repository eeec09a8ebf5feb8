"""The command `humanplay`, a module for each of its commands or families of them."""
