"""`python -m research.refinement`: a policy learns from the cost of other moves."""
