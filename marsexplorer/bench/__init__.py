"""How fast the environment is: what `marsexplorer bench` prints and tests/benchmarks gate, measured in one way."""
