"""The environments that are played: one package each, behind `humanplay.task`."""
