"""Live boards of any task: sessions, their messages, and the policies that drive.

`lobby` finds and opens sessions, `session` makes moves, records them and hands the newest frame to
subscribers, and `agent` lets a policy move. What is played stands behind `humanplay.task`. Nothing
here knows HTTP.
"""
