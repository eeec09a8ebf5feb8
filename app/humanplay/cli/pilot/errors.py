"""What cannot be played or scored."""


class PilotError(ValueError):
    """An environment cannot be played, or plays not scored; the text says what to do."""
