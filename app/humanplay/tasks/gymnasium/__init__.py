"""Environments of Gymnasium, shown by their own pictures."""
