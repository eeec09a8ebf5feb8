"""What the operator sees and does: participants, boards, health, exports.

The list of payments alone reads identities.
"""
