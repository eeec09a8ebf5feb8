"""Plays an episode by a generated client: FOLDER (of package `client`), ADDRESS.

It runs in the client's own environment, without anything of ours, and prints outcome, moves and
coverage.
"""

import random
import sys

sys.path.insert(0, sys.argv[1])

from client import Client
from client.api.play import act, create_session, get_history
from client.models import Act, NewSession

WAYS = {"north": (-1, 0), "east": (0, 1), "south": (1, 0), "west": (0, -1)}


def free_ways(frame):
    """The directions in which the rover can move."""
    row, col = frame.position
    for name, (down, right) in WAYS.items():
        r, c = row + down, col + right
        if 0 <= r < frame.rows and 0 <= c < frame.cols and frame.grid[r][c] == ".":
            yield name


draw = random.Random(7)
with Client(base_url=sys.argv[2]) as api:
    board = create_session.sync(client=api, body=NewSession(size=[7, 9], seed=3))
    frame = board.frame
    while frame.outcome is None:
        move = Act(frame.episode, frame.step, draw.choice(list(free_ways(frame))))
        frame = act.sync(board.session, client=api, body=move)
    history = get_history.sync(board.session, client=api)
assert len(history.positions) == frame.step + 1
print(frame.outcome, frame.step, frame.coverage)
