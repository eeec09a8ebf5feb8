"""A player's id, signed: what a browser keeps so that nobody can pass for another player."""

from __future__ import annotations

from itsdangerous import BadSignature, Signer


class PlayerTokens:
    """Signs players' ids and reads them back; `secret` is the database's, so that tokens outlive a restart."""

    def __init__(self, secret: str) -> None:
        self._signer = Signer(secret, salt="mars-player")

    def sign(self, player_id: str) -> str:
        """Return the token of a player."""
        return self._signer.sign(player_id).decode()

    def read(self, token: str) -> str | None:
        """Return the player's id in a token; None when this server did not sign it."""
        try:
            return self._signer.unsign(token).decode()
        except (BadSignature, UnicodeError):
            return None
