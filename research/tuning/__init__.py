"""The parameters of `frontier-priced` by CMA-ES: `python -m research.tuning`."""
