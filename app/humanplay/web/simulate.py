"""Synthetic participants, who play a study through its page's calls and socket.

They join as scripts, so they are labelled `script` for ever and enter no human score.
`Participant` is one of them; `simulate` lets many take part side by side.
"""

from __future__ import annotations

import json
import math
import random
import secrets
import ssl
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal
from urllib.parse import quote

import httpx
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from humanplay.db.store import SLOW, WAITS
from humanplay.task import Configuration, Environment
from humanplay.task.registration import environment_of
from humanplay.web.answers.studies import ShownQuestion

Frame = dict[str, Any]

ANSWER_TIMEOUT_S = 60.0
"""How long one answer may take."""
CONNECTION_ERRORS = (httpx.HTTPError, WebSocketException, OSError, EOFError)
"""What is raised while a server is away, stops, or cannot answer (5xx)."""
RETRY_EVERY_S = 0.25
JOIN_EVERY_MS = 500.0
"""Between two participants' joining, in a person's time."""
MOVES_BEFORE_LEAVING = 3
"""Moves in the ranked episode in which a participant leaves."""

KEY_CODES: Mapping[str, str] = {
    **dict.fromkeys(("north", "up", "forward"), "ArrowUp"),
    **dict.fromkeys(("east", "right"), "ArrowRight"),
    **dict.fromkeys(("south", "down"), "ArrowDown"),
    **dict.fromkeys(("west", "left"), "ArrowLeft"),
}
"""The arrow key of each direction, where a task says nothing else."""


class RefusedError(Exception):
    """The server declined: `status` (None over the socket) and its sentence."""

    def __init__(self, status: int | None, detail: str) -> None:
        super().__init__(detail)
        self.status, self.detail = status, detail


class ServerAwayError(Exception):
    """The server does not come back."""


class StoppedError(Exception):
    """The simulation was stopped while a participant played."""


class Clock:
    """A page's clock, and how its participant lets time pass.

    Args:
        speed: So many times as fast as people.
        stop: Ends every wait at once.
    """

    def __init__(self, speed: float = 1.0, stop: threading.Event | None = None) -> None:
        self.speed, self._stop = speed, stop or threading.Event()
        self.waited_ms = 0.0

    def page_ms(self) -> float:
        """What performance.now() would return: the true time, in ms."""
        return round(time.monotonic() * 1000, 1)

    def wait(self, ms: float) -> None:
        """Let so many milliseconds of a person's time pass.

        Raises:
            StoppedError: Once the simulation was stopped.
        """
        self.waited_ms += ms
        if self._stop.wait(ms / 1000 / self.speed):
            raise StoppedError


class Socket:
    """The socket of one board: JSON messages, and moves with their input events.

    Args:
        keys: The keys of the actions (`event.code`).
    """

    def __init__(
        self,
        connection: Connection,
        clock: Clock,
        tempo: random.Random,
        keys: Mapping[str, str] = KEY_CODES,
    ) -> None:
        self.connection, self.clock, self._tempo, self._keys = connection, clock, tempo, keys
        self._released: list[dict[str, object]] = []
        self._load = {"page_load": secrets.token_hex(16), "tab": secrets.token_hex(16)}

    def send(self, message: dict[str, object] | str | bytes) -> None:
        """Send a message."""
        is_text = isinstance(message, str | bytes)
        self.connection.send(message if is_text else json.dumps(message))

    def receive(self, kind: str | None = None, seconds: float = ANSWER_TIMEOUT_S) -> dict[str, Any]:
        """The next message, or the next of a kind.

        Raises:
            TimeoutError: If none comes.
        """
        while True:
            message: dict[str, Any] = json.loads(self.connection.recv(timeout=seconds))
            if kind in (None, message["kind"]):
                return message

    def act(
        self,
        frame: Frame,
        action: str,
        input: Literal["key", "touch"] | None = None,
        **rest: object,
    ) -> None:
        """Send a move.

        Args:
            input: With it the move is one of a person, whose press is sent before it.
        """
        if input is not None:
            rest = {**self.press(frame, action, input), **rest}
        answered = {"kind": "act", "episode": frame["episode"], "step": frame["step"]}
        self.send({**answered, "action": action, **rest})

    def press(
        self, frame: Frame, action: str, input: Literal["key", "touch"] = "key", **changes: object
    ) -> dict[str, object]:
        """Take a person's time to press, and send the press.

        The release is sent with the next press.

        Args:
            changes: Fields of the press's event.

        Returns:
            What its move says of it.
        """
        self.clock.wait(self._tempo.randint(90, 250))
        now = self.clock.page_ms()
        code = self._keys[action] if input == "key" else action
        kind = "keydown" if input == "key" else "touchdown"
        event = {"kind": kind, "code": code, "repeat": False, "trusted": True, "client_ms": now}
        event |= {"step": frame["step"], **changes}
        batch = {"batch": secrets.token_hex(8), "episode": frame["episode"]}
        events = [*self._released, event]
        self.send({"kind": "events", **batch, **self._load, "events": events})
        self.clock.wait(self._tempo.randint(40, 80))
        up = {"kind": kind.replace("down", "up"), "client_ms": self.clock.page_ms()}
        self._released = [{**event, **up}]
        return {"input": input, "key_down_ms": now, "client_ms": now}

    def frame_after(self, step: int) -> Frame:
        """The first frame with more moves than `step`.

        Raises:
            RefusedError: If the move is refused.
        """
        while (message := self.receive())["kind"] != "frame" or message["step"] <= step:
            # a move that waits for the disk is made all the same
            is_waiting = message.get("detail") in (SLOW, WAITS)
            if message["kind"] in ("refused", "error") and not is_waiting:
                raise RefusedError(None, message.get("reason") or message["detail"])
        return message


class RandomMoves:
    """Any action that has a key and can be chosen, at random."""

    def __init__(self, keys: Mapping[str, Sequence[str]], seed: int = 0) -> None:
        self._actions = [action for action, codes in keys.items() if codes]
        self._dice = random.Random(seed)

    def reset(self) -> None:
        """Begin another episode: nothing is remembered."""

    def choose(self, frame: Frame) -> str:
        """The action that answers a frame."""
        allowed = frame.get("allowed") or self._actions
        return self._dice.choice([action for action in self._actions if action in allowed])


class NoisyPolicy:
    """A policy of which some moves are replaced by random valid ones.

    Args:
        name: Or path of the policy.
        noise: Probability (0..1) that a move is the random policy's.

    Raises:
        PolicyError: If there is no such policy.
    """

    def __init__(
        self,
        environment: Environment,
        name: str,
        noise: float,
        config: Configuration | None,
        seed: int = 0,
    ) -> None:
        self._environment, self._noise, self._dice = environment, noise, random.Random(seed)
        self._policy = environment.policies.load(name, config)
        self._random = environment.policies.load("random", config)

    def reset(self) -> None:
        """Begin another episode."""
        self._policy.reset(self._dice.getrandbits(31))
        self._random.reset(self._dice.getrandbits(31))

    def choose(self, frame: Frame) -> str:
        """The action that answers a frame."""
        policy = self._random if self._dice.random() < self._noise else self._policy
        policies = self._environment.policies
        return self._environment.actions[policies.act(policy, policies.observation_in(frame))]


class Participant:
    """One participant of a study, with a cookie of their own, who has not joined yet.

    `where` is the server's last answer.

    Args:
        client: Its base_url is the server's address, and it keeps the participant's cookie.
        policy: That the participant follows, with a person's tempo on the clock.
        tempo: Seed of the times between a frame and the key.
    """

    def __init__(
        self,
        client: httpx.Client,
        study: str,
        policy: NoisyPolicy | RandomMoves,
        clock: Clock,
        tempo: int = 0,
    ) -> None:
        self.client, self.url = client, f"/api/studies/{quote(study, safe='')}"
        self._policy, self._clock, self._tempo = policy, clock, random.Random(tempo)
        self.where: dict[str, Any] = {}
        self.round_trips_ms: list[float] = []
        """From each move to its frame."""
        self.progressed = time.perf_counter()
        """When the last move was answered, or the last step was taken, in seconds."""

    def call(self, verb: str, body: object = None) -> dict[str, Any]:
        """The answer to a POST.

        Raises:
            RefusedError: If it is declined.
        """
        return self._keep(self.client.post(f"{self.url}/{verb}", json=body))

    def me(self) -> dict[str, Any]:
        """Ask where the participant stands, and return it."""
        return self._keep(self.client.get(f"{self.url}/me"))

    def _keep(self, answer: httpx.Response) -> dict[str, Any]:
        self.where = _content(answer)
        return self.where

    @property
    def frame(self) -> Frame:
        """The frame of the last answer."""
        frame: Frame = self.where["about"]["frame"]
        return frame

    @contextmanager
    def socket(self) -> Iterator[Socket]:
        """Yield the socket of the participant's board."""
        base = self.client.base_url
        url = base.copy_with(scheme=base.scheme.replace("http", "ws"))
        path = f"{str(url).rstrip('/')}/ws/sessions/{self.where['session']}"
        names = ("Cookie", "X-Humanplay-Token")
        sent = self.client.build_request("GET", "/").headers
        headers = {name: sent[name] for name in names if name in sent}
        opened = connect(
            path, origin=sent.get("Origin"), additional_headers=headers, proxy=None,
            open_timeout=ANSWER_TIMEOUT_S, close_timeout=1.0,
        )  # fmt: skip
        with opened as connection:
            keys = self.where["about"]["task"]["keys"]
            first = {action: codes[0] for action, codes in keys.items() if codes}
            yield Socket(connection, self._clock, self._tempo, first)

    def play(self, moves: int | None = None, **act: Any) -> list[Frame]:
        """Play the running episode to its end, or for some moves.

        Args:
            act: Fields of every move; `input=None` sends no presses.

        Returns:
            Its frames.
        """
        self._policy.reset()
        with self.socket() as socket:
            frames = [socket.receive("frame")]
            while frames[-1]["outcome"] is None and (moves is None or len(frames) <= moves):
                socket.act(frames[-1], self._policy.choose(frames[-1]), **{"input": "key", **act})
                began = time.perf_counter()
                frames.append(socket.frame_after(frames[-1]["step"]))
                self.progressed = time.perf_counter()
                self.round_trips_ms.append((self.progressed - began) * 1000)
        return frames

    def answer_questions(self) -> None:
        """Answer the questions until all are right.

        The first choice of each comes first, then the next ones.
        """
        choices = [0] * len(self.where["questions"])
        while not all(right := self.call("answers", {"answers": choices})["right"]):
            pairs = zip(choices, right, strict=True)
            choices = [choice + (not is_right) for choice, is_right in pairs]

    def answer_block(self) -> None:
        """Answer every question of the block that is due, at random."""
        block = self.where["block"]
        draws = random.Random(f"{self.where['participant']}|{block['name']}|{block['turn']}")
        questions = [ShownQuestion.model_validate(question) for question in block["questions"]]
        answers = {question.name: _answer_to(question, draws) for question in questions}
        self.call("block", {"block": block["name"], "turn": block["turn"], "answers": answers})

    def take_step(self) -> None:
        """Do what is next where the participant stands, a whole episode at most."""
        stage, has_practised = self.where["stage"], self.where["tutorial"]["done"]
        if self.where["block"] is not None:
            self.answer_block()
        elif stage == "consent":
            self.call("consent", {"version": self.where["consent"]["version"], "agree": True})
        elif stage == "questions":
            self.answer_questions()
        elif stage in ("instructions", "debrief") or (stage == "tutorial" and has_practised):
            self.call("advance", {"from": stage})
        elif stage in ("tutorial", "warm_up", "ranked"):
            self.call("next")
            self.play()


def _answer_to(question: ShownQuestion, draws: random.Random) -> object:
    """Return an answer to a question, as a page sends it."""
    values = [choice.value for choice in question.choices or ()]
    match question.kind:
        case "choice":
            return draws.choice(values)
        case "several":
            return [value for value in values if draws.random() < 0.5]
        case "likert":
            return [draws.randrange(len(question.points or ())) for _ in question.rows or ()]
        case "scale":
            return draws.randrange(question.steps or 1)
        case "number":
            minimum, maximum = question.minimum or 0, question.maximum or 0
            if question.whole:
                return draws.randint(math.ceil(minimum), math.floor(maximum))
            return draws.uniform(minimum, maximum)
        case "statement":
            return True
    return "A synthetic player has no words."[: question.max_length or 0]


def _content(answer: httpx.Response) -> dict[str, Any]:
    """What an answer holds.

    Raises:
        RefusedError: For a refusal (4xx).
        HTTPError: For a failure.
    """
    if answer.is_client_error:
        is_ours = answer.headers.get("Content-Type", "").startswith("application/json")
        detail = (
            answer.json()["detail"] if is_ours else f"{answer.url} answers {answer.status_code}"
        )
        raise RefusedError(answer.status_code, detail)
    content: dict[str, Any] = answer.raise_for_status().json()
    return content


@dataclass(frozen=True)
class Plan:
    """What is simulated.

    Attributes:
        url: Address of the server.
        policy: Name or path of the policy that the participants follow; None for the task's, or
            random moves without one.
        noise: Share (0..1) of their moves that are random ones.
        leaving: Share (0..1) of them who leave in a ranked episode: half withdraw, half close
            the page.
        speed: Times as fast as people.
        wait_s: How long a server that has gone away is waited for.
        token: Of the server, which lets any number play from one address; None: without.
    """

    url: str
    study: str
    participants: int
    seed: int = 0
    policy: str | None = None
    noise: float = 0.1
    leaving: float = 0.0
    speed: float = 20.0
    wait_s: float = 60.0
    token: str | None = None


@dataclass
class ParticipantSummary:
    """How far a synthetic participant came.

    Attributes:
        stage: The last stage, or "left".
        warm_up: Practice episodes that are over.
        ranked: Ranked episodes that are over.
        minutes: Of a person's time.
        debrief: Its summary.
    """

    number: int
    stage: str = "joining"
    warm_up: int = 0
    ranked: int = 0
    minutes: float = 0.0
    round_trips_ms: list[float] = field(default_factory=list, repr=False)
    debrief: dict[str, Any] | None = None
    code: str | None = None


@cache
def _certificates() -> ssl.SSLContext:
    """The certificates that servers are checked against, read once for all."""
    return httpx.create_ssl_context(trust_env=False)


def open_client(plan: Plan) -> httpx.Client:
    """A client that sends what a page of the server would.

    Raises:
        ValueError: If the plan has no address.
    """
    base = httpx.URL(plan.url)
    if base.scheme not in ("http", "https") or not base.host:
        raise ValueError(f"an address must be like http://127.0.0.1:8000, got {plan.url!r}")
    headers = {"Origin": f"{base.scheme}://{base.netloc.decode()}"}
    if plan.token is not None:
        headers["X-Humanplay-Token"] = plan.token
    return httpx.Client(
        base_url=base,
        timeout=ANSWER_TIMEOUT_S,
        trust_env=False,
        verify=_certificates(),
        headers=headers,
    )


def fetch_study(plan: Plan) -> dict[str, Any]:
    """What the server says of the study.

    Raises:
        RefusedError: If nobody can take part in it, or be simulated.
    """
    with open_client(plan) as client:
        study = _content(client.get(f"/api/studies/{quote(plan.study, safe='')}"))
    if study["status"] == "closed":
        raise RefusedError(409, f"the study {plan.study!r} is closed: nobody can take part in it")
    title = study["task"]["title"]
    if study["task"]["clock"] is not None:
        raise RefusedError(
            409, f"the study {plan.study!r} is of {title}, where time runs: nobody can be simulated"
        )
    if plan.policy is not None and _followed(study) is None:
        raise RefusedError(
            409,
            f"the study {plan.study!r} is of {title}: no policy sees what its frames show; "
            "without --policy, participants move at random",
        )
    return study


def _followed(study: dict[str, Any]) -> tuple[Environment, str] | None:
    """A study's environment and the policy to follow.

    None if its frames do not hold what policies are given.
    """
    try:
        environment = environment_of(study["task"]["name"])
    except ValueError:  # a task of many environments, which pages are not told apart
        return None
    simulated = environment.policies.simulated if environment.policies.sees_frames else None
    return None if simulated is None else (environment, simulated)


def _player(plan: Plan, study: dict[str, Any], seed: int) -> NoisyPolicy | RandomMoves:
    """What decides for a participant."""
    if (followed := _followed(study)) is None:
        return RandomMoves(study["task"]["keys"], seed)
    environment, simulated = followed
    config = environment.configuration(study["config"])
    return NoisyPolicy(environment, plan.policy or simulated, plan.noise, config, seed)


def simulate(
    plan: Plan,
    summaries: list[ParticipantSummary],
    advance: Callable[[int, int], None] = lambda *_: None,
) -> None:
    """Let the participants take part side by side.

    Args:
        summaries: Gets one for each participant.
        advance: Called with (episodes ended, episodes in all).

    Raises:
        RefusedError: If the server declines somebody.
        ServerAwayError: If it stays away.
    """
    study = fetch_study(plan)
    summaries.extend(ParticipantSummary(number) for number in range(plan.participants))
    in_all = plan.participants * (int(study["warm_up"]) + int(study["ranked"]))
    stop, run = threading.Event(), secrets.token_hex(4)
    with ThreadPoolExecutor(plan.participants) as pool:
        try:
            running = {
                pool.submit(
                    _take_part, plan, study, summary, f"simulated-{run}-{summary.number}", stop
                )
                for summary in summaries
            }
            while running:
                ended, running = wait(running, 0.3, FIRST_EXCEPTION)
                for future in ended:
                    future.result()
                advance(sum(summary.warm_up + summary.ranked for summary in summaries), in_all)
        finally:
            stop.set()


def _take_part(
    plan: Plan,
    study: dict[str, Any],
    summary: ParticipantSummary,
    outside_id: str,
    stop: threading.Event,
) -> None:
    """Let one participant take part, to the completion code or until they leave."""
    dice = random.Random(f"{plan.seed} {summary.number}")
    clock, policy = Clock(plan.speed, stop), _player(plan, study, dice.getrandbits(31))
    leaves_at = dice.randrange(study["ranked"]) if dice.random() < plan.leaving else None
    withdraws = dice.random() < 0.5
    followed = _followed(study)
    script = "random moves"
    if followed is not None:
        script = f"{plan.policy or followed[1]}, {plan.noise:.0%} random moves"
    join = {"outside_ids": {"PROLIFIC_PID": outside_id}, "script": script}
    with open_client(plan) as client:
        clock.wait(JOIN_EVERY_MS * summary.number)
        participant = Participant(client, plan.study, policy, clock, dice.getrandbits(31))
        participant.round_trips_ms = summary.round_trips_ms
        while summary.stage not in ("complete", "withdrawn", "left"):
            try:
                if not participant.where:
                    participant.call("join", join)
                _show(participant.me(), summary)
                if summary.stage == "ranked" and summary.ranked == leaves_at:
                    participant.call("next")
                    participant.play(MOVES_BEFORE_LEAVING)
                    if withdraws:
                        participant.call("withdraw")
                    summary.stage = "left"
                else:
                    participant.take_step()
                participant.progressed = time.perf_counter()
                summary.minutes = clock.waited_ms / 60_000
            except CONNECTION_ERRORS as error:
                away_s = time.perf_counter() - participant.progressed
                if away_s > plan.wait_s:
                    raise ServerAwayError(
                        f"the server at {plan.url} has been away for {away_s:.0f} s ({error}): "
                        "start it again, and begin another simulation"
                    ) from error
                if stop.wait(RETRY_EVERY_S):
                    raise StoppedError from error


def _show(answer: dict[str, Any], summary: ParticipantSummary) -> None:
    """Write into a summary where its participant stands."""
    summary.stage, summary.debrief = answer["stage"], answer["debrief"]
    summary.code = (answer["ending"] or {}).get("code")
    summary.warm_up, summary.ranked = answer["warm_up"]["done"], answer["ranked"]["done"]
