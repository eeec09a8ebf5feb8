"""The environments that are played: one package each, behind `app.task`."""
