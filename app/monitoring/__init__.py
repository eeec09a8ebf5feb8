"""What a running server says of itself: its metrics, its logs, and an id for each request.

Nothing here holds or writes who anybody is: no id of a player, a session or a participant, no cookie and no token.
"""
