"""Commands about studies: plan, freeze, invite, rehearse, report, and where players lose moves.

`study.py` is the group `marsexplorer study`; the commands of that group which are not about its files alone stand in
`planning.py` and `recruiting.py`.
"""
