"""A study: who plays which instances, when, and what is hidden until when.

A study and a daily terrain are both kept as a series: a secret that is bound by its hash before anybody plays, seeds that
are drawn from it (`seeds`), and episodes that are hidden until the series closes (`humanplay.db.reader`). Ranked play is
not a series: it never closes, so its secret could never be published. Each of its terrains is drawn by chance when it
begins (`humanplay.board.ranked`).

`folder` and `protocol` hold what a study is, `days` what a daily terrain is, `progress` leads participants through a study,
`data` reads what they did, and `verification` checks it.
"""
