"""Environments of Gymnasium on the playground: turn by turn, in process, shown as their own picture."""
