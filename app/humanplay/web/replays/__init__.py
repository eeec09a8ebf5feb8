"""Replays of finished episodes.

They hold what is drawn at each move, a policy on the same terrain, and both as a file.
`episodes.shown_episode` says who may see which; everything else here takes what it returned.
"""
