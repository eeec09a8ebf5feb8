"""The speed of environment, policies, server and page: `python -m research.speed`.

`make bench` runs it too.
"""
