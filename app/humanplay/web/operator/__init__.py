"""What the operator sees and does: a study's participants, boards that are being played, the server's health, exports.

The list of payments alone reads identities.
"""
