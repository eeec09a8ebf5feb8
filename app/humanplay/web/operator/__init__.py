"""What the operator sees and does: a study's participants, boards that are being played, the server's health, exports.

Nothing here reads identities.
"""
