"""Series: who plays which terrains, when, and what is hidden till when.

A study is a series that its operator closes, and the daily terrain one of a single terrain that closes at midnight: both
commit to a secret before anybody plays, draw their seeds from it (`seeds`), and hide every episode until they close
(`humanplay.db.reader`). Ranked play is no series of the table: it never closes, so a commitment could never be opened; each
of its terrains is drawn by chance at the beginning (`humanplay.board.ranked`).

`folder` and `protocol` hold what a study is, `progress` leads participants through it, `daily` the players of a day, `data`
reads what they did, and `verification` checks it.
"""
