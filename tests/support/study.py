"""A frozen study on small boards, and a participant who plays it as a page does."""

import json
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import httpx
import pytest

from humanplay.study.folder import Folder
from humanplay.study.outcomes import change_texts
from humanplay.study.protocol import default_protocol
from humanplay.study.translation import path_of
from humanplay.task.registration import environment_of
from humanplay.web.simulate import NoisyPolicy, Participant, RefusedError
from marsexplorer.config import EnvConfig
from tests.support.declared import DECLARATIONS

SIZE = (7, 9)
CHECK = {
    "kind": "attention",
    "name": "check",
    "question": "Choose red.",
    "choices": ["red", "blue"],
    "answer": 0,
}


def freeze(root, name="small", **rest):
    """A frozen study: 2 warm-up and 3 ranked episodes on 7x9, with breaks.

    A break after every 2 episodes, and the rules as debrief policies.
    """
    small = {
        "warm_up": 2,
        "ranked": 3,
        "players": 2,
        "break_every": 2,
        "policies": ("frontier-cost",),
        "outside_ids": ("PROLIFIC_PID", "STUDY_ID", "SESSION_ID"),
        "declarations": DECLARATIONS,
    }
    texts, folder = rest.pop("outcomes", {}), Folder(root)
    own_texts = rest.pop("own_texts", {})
    config = EnvConfig.of("random", rest.pop("size", SIZE))
    protocol = default_protocol(
        name, config, **{**small, "debrief_policy": "frontier-cost", **rest}
    )
    folder.create(protocol)
    change_texts(folder.path(name), protocol, texts, is_frozen=False)
    for language, words in own_texts.items():
        write_own(folder.path(name), language, words)
    return folder.freeze(name)


def write_own(folder, language, words):
    """Write a study's own texts in a language, by their IDs."""
    path = path_of(folder, language)
    path.parent.mkdir(exist_ok=True)
    lines = [f"{json.dumps(ident)} = {json.dumps(text)}\n" for ident, text in words.items()]
    path.write_text("".join(lines), encoding="utf-8")


class Person(Participant):
    """A participant with a cookie, who plays the rules' best moves by key."""

    def __init__(self, server, study="small", client=None, **join):
        policy = NoisyPolicy(environment_of("mars"), "frontier-cost", 0.0, None)
        super().__init__(client or server.client(), study, policy, server.clock)
        self.server = server
        if join.pop("joins", True):
            self.call("join", join or None)

    def refused(self, action, body=None, status=409):
        """POST, expect a refusal and return its sentence."""
        with pytest.raises(RefusedError) as refusal:
            self.call(action, body)
        assert refusal.value.status == status, (action, refusal.value)
        return refusal.value.detail

    def to_tutorial(self):
        self.call("consent", {"version": "1", "agree": True})
        self.call("advance", {"from": "instructions"})

    def to_questions(self):
        self.to_tutorial()
        self.give_up_tutorial()

    def give_up_tutorial(self):
        self.call("next")
        self.call("give-up", {"episode": self.frame["episode"], "step": self.frame["step"]})
        self.call("advance", {"from": "tutorial"})

    def to_warm_up(self):
        self.to_questions()
        self.answer_questions()

    def socket(self):
        return self.server.socket(self.where["session"], self.client)

    def play_on(self, until=("debrief",), **act):
        """Play every episode until one of the stages; return all frames by phase."""
        seen = {"tutorial": [], "warm_up": [], "ranked": []}
        while self.me()["stage"] not in until:
            self.call("next")
            seen[self.where["phase"]].append(self.play(**act))
        return seen


def agree_at_once(crowd):
    """All agree at the same time; what each was answered, None without an answer."""
    ready = threading.Barrier(len(crowd))

    def agree(person):
        ready.wait()
        with suppress(httpx.TransportError):
            consent = {"version": "1", "agree": True}
            return person.client.post(f"{person.url}/consent", json=consent).json()

    with ThreadPoolExecutor(len(crowd)) as pool:
        return list(pool.map(agree, crowd))
