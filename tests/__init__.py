"""A package, so that no other package of this name, as opensimplex installs one, stands in its place."""
