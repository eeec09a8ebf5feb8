"""A trained policy learns what other moves would have cost it: `python -m research.refinement`."""
