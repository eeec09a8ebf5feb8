"""What the report's methods are worth, on players whose truth is known; a command each, by `python -m`."""
