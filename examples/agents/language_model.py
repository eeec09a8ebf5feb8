"""A model of language or vision plays every instance of a card, frame by frame.

Any OpenAI-compatible API does: OPENAI_BASE_URL and OPENAI_API_KEY say which.

    CARD=http://127.0.0.1:8000/agents/TOKEN
    .venv-agents/bin/python examples/agents/language_model.py $CARD --model MODEL
    .venv-agents/bin/python examples/agents/language_model.py $CARD --model MODEL --frames picture
"""

import argparse
import hashlib
import json
import re

import httpx
from openai import OpenAI
from openenv import GenericEnvClient

SYSTEM = """{instructions}

You are shown what is seen after each move. Think briefly, then name your next move on the last line, one of: {actions}."""
NO_ACTION = "That named no move. Name one of: {actions}."
REMEMBERED, TRIES = 20, 3
"""Moves that the model is reminded of, and answers that it may give until one names a move."""


class Player:
    """The model, its moves on an instance, and the tokens that it has taken."""

    def __init__(self, model, card, frames):
        self._api, self._model, self._frames = OpenAI(), model, frames
        self._actions = card["actions"]
        named = ", ".join(self._actions)
        self._system = SYSTEM.format(instructions=card["instructions"], actions=named)
        self._again = NO_ACTION.format(actions=named)
        self.moves, self.tokens = [], [0, 0]

    def act(self, seen):
        """Return the model's next move; None where it names none."""
        messages = [
            {"role": "system", "content": self._system},
            {"role": "user", "content": self._shown(seen)},
        ]
        for _ in range(TRIES):
            answer = self._api.chat.completions.create(model=self._model, messages=messages)
            if answer.usage is not None:
                self.tokens[0] += answer.usage.prompt_tokens
                self.tokens[1] += answer.usage.completion_tokens
            text = answer.choices[0].message.content or ""
            words = [word for word in re.findall(r"[\w-]+", text) if word in self._actions]
            if words:
                self.moves.append(words[-1])
                return words[-1]
            messages += [
                {"role": "assistant", "content": text},
                {"role": "user", "content": self._again},
            ]
        return None

    def _shown(self, seen):
        """The content of a message that shows the model what it sees."""
        last_moves = ", ".join(self.moves[-REMEMBERED:]) or "none"
        sentence = f"Moves so far: {seen['step']}; the last ones: {last_moves}."
        if self._frames == "picture":
            if "picture" not in seen:
                raise SystemExit("this evaluation shows no pictures: take --frames text")
            picture = {"type": "image_url", "image_url": {"url": seen["picture"]}}
            return [{"type": "text", "text": sentence}, picture]
        if "text" not in seen and "observation" not in seen:
            raise SystemExit("this evaluation shows pictures alone: take --frames picture")
        return f"{sentence}\n{seen.get('text') or json.dumps(seen['observation'])}"


def main():
    """Play each instance that is not finished, then close the card."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("card", help="the card's address")
    parser.add_argument("--model", required=True, help="as the API calls it")
    parser.add_argument("--frames", choices=("text", "picture"), default="text")
    parser.add_argument("--most-moves", type=int, help="of an instance, which is then left")
    options = parser.parse_args()
    card = httpx.get(options.card, timeout=60).raise_for_status().json()
    player = Player(options.model, card, options.frames)
    prompts = hashlib.sha256(f"{SYSTEM}{NO_ACTION}".encode()).hexdigest()
    if not card["state"]["begun"]:
        agent = {
            "agent": f"one {options.frames} frame a call",
            "version": "1",
            "model": options.model,
        }
        httpx.post(
            options.card, json={**agent, "prompts_sha256": prompts}, timeout=60
        ).raise_for_status()
    with GenericEnvClient(base_url=options.card).sync() as env:
        for index in sorted(set(range(card["instances"])) - set(card["state"]["finished"])):
            player.moves.clear()
            step = env.reset(split="evaluation", index=index)
            while not step.done and len(player.moves) != options.most_moves:
                action = player.act(step.observation)
                if action is None:
                    print(f"instance {index}: the model names no move; it is left as it stands")
                    break
                step = env.step({"action": action})
            print(f"instance {index}: {step.observation['step']} moves", flush=True)
            cost = f"{player.tokens[0]} tokens in, {player.tokens[1]} out"
            httpx.post(options.card, json={"cost": cost}, timeout=60).raise_for_status()
    httpx.post(f"{options.card}/close", timeout=60).raise_for_status()
    print("the card is closed")


if __name__ == "__main__":
    main()
