"""Replays of finished episodes: what is drawn at each move, a policy on the same terrain, and both as a file.

Only episodes that anybody may see are replayed (`episodes.public_episode`); everything else here takes what it returned.
"""
