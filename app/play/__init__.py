"""Live boards: sessions in memory, the messages that reach and leave them, and the policies that drive some of them.

`lobby` finds and opens sessions, `session` makes moves and records them, `channel` hands the newest frame to subscribers,
and `agent` lets a policy of `policy_catalogue` move a rover. Nothing here knows HTTP.
"""
