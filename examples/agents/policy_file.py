"""A policy of MarsExplorer, by name or file, plays every instance of a card.

It needs only a plain websocket.

.venv/bin/python examples/agents/policy_file.py http://127.0.0.1:8000/agents/TOKEN --policy ppo
"""

import argparse
import json
from urllib.request import Request, urlopen

import numpy as np
from websockets.sync.client import connect

from marsexplorer.policies import load

CODES = {"?": 0, ".": 1, "@": 2, "#": 3}
"""The cells of a frame, as policies are given them."""


def called(url, body=None):
    """The answer of a call; POST if there is a body."""
    content = None if body is None else json.dumps(body).encode()
    with urlopen(Request(url, content, {"Content-Type": "application/json"})) as answer:
        return json.load(answer)


def main():
    """Play each instance that is not finished, then close the card."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("card", help="the card's address")
    parser.add_argument("--policy", default="frontier-cost", help="a name, or a file")
    options = parser.parse_args()
    card = called(options.card)
    if "sensor_radius" not in card["config"]:
        raise SystemExit(
            f"expected a card of MarsExplorer, got one of {card['title']}: random_moves.py plays any"
        )
    policy = load(options.policy, card["config"]["sensor_radius"])
    if not card["state"]["begun"]:
        agent = {
            "agent": policy.name,
            "version": "1",
            "model": options.policy.split("/")[-1],
            "cost": "0",
        }
        called(options.card, agent)
    with connect(f"ws{options.card.removeprefix('http')}/ws", proxy=None) as socket:

        def ask(kind, **data):
            socket.send(json.dumps({"type": kind, "data": data}))
            answer = json.loads(socket.recv())
            if answer["type"] == "error":
                raise SystemExit(answer["data"]["message"])
            return answer["data"]

        for index in sorted(set(range(card["instances"])) - set(card["state"]["finished"])):
            policy.reset(index)
            seen = ask("reset", index=index)
            while not seen["done"]:
                grid = seen["observation"]["observation"]["grid"]
                codes = np.array([[CODES[cell] for cell in row] for row in grid], np.uint8)
                seen = ask("step", action=int(policy.act(codes)))
            print(f"instance {index}: {seen['observation']['step']} moves", flush=True)
    called(f"{options.card}/close", {})
    print("the card is closed")


if __name__ == "__main__":
    main()
