"""Synthetic players: they play a whole study as browsers do, labelled `script` for ever, and their true level is known."""
