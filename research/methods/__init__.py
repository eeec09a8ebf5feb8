"""What the report's methods are worth, on players whose truth is known.

A command each, by `python -m`.
"""
