"""What cannot be played or scored."""


class PilotError(ValueError):
    """An environment cannot be played, or plays cannot be scored; the text says why, and the way out."""
