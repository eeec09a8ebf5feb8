"""Random moves on every instance of a card, with OpenEnv's own client.

Any agent has to beat them.

.venv-agents/bin/python examples/agents/random_moves.py http://127.0.0.1:8000/agents/TOKEN
"""

import argparse
import random

import httpx
from openenv import GenericEnvClient


def main():
    """Play each instance that is not finished, then close the card."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("card", help="the card's address")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    draw, card = (
        random.Random(options.seed),
        httpx.get(options.card, timeout=60).raise_for_status().json(),
    )
    if not card["state"]["begun"]:
        agent = {"agent": "random moves", "version": "1", "model": "none", "cost": "0"}
        httpx.post(options.card, json=agent, timeout=60).raise_for_status()
    with GenericEnvClient(base_url=options.card).sync() as env:
        for index in sorted(set(range(card["instances"])) - set(card["state"]["finished"])):
            step = env.reset(split="evaluation", index=index)
            while not step.done:
                step = env.step({"action": draw.choice(card["actions"])})
            print(f"instance {index}: {step.observation['step']} moves", flush=True)
    httpx.post(f"{options.card}/close", timeout=60).raise_for_status()
    print("the card is closed")


if __name__ == "__main__":
    main()
