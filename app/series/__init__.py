"""Studies of how well people explore: a protocol that is frozen, terrains from a committed secret, and participants.

`folder` and `protocol` hold what a study is, `progress` leads participants through it, `data` reads what they did, and
`verification` and `erasure` check and forget it.
"""
