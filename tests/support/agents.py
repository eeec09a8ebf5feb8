"""An evaluation of agents, played with cards through the server's own `Cards`."""

import re

import numpy as np

from humanplay.agents.evaluation import (
    begin_evaluation,
    changing,
    find_evaluation,
    issue_card,
    looking,
)
from humanplay.study.files import now_ms
from humanplay.study.folder import Folder
from marsexplorer.episode import Episode
from marsexplorer.policies import load
from tests.support.command import run
from tests.support.golden_study import is_valid

CODES = {"?": 0, ".": 1, "@": 2, "#": 3}


def codes_of(grid):
    """The codes of a frame's grid, as policies take them."""
    return np.array([[CODES[cell] for cell in row] for row in grid], np.uint8)


def begun(database, name="agents", of="small", **rest):
    """Return a new evaluation on the ranked terrains of a frozen study."""
    folder = Folder.beside(database)
    return begin_evaluation(database, folder, {"name": name, "study": of, **rest}, now_ms())


def own(database, name="agents", task="gymnasium:FrozenLake-v1", instances=3, config=None, **rest):
    """Return a new evaluation of a task on instances of its own."""
    from humanplay.task.registration import environment_of

    config = environment_of(task).configuration({}) if config is None else config
    wanted = {"name": name, "task": task, "instances": instances, "config": config.to_dict()}
    return begin_evaluation(database, Folder.beside(database), {**wanted, **rest}, now_ms())


def evaluation_of(database, name="agents"):
    """Return an evaluation as it stands."""
    with looking(database) as conn:
        return find_evaluation(conn, Folder.beside(database), name)


def token_of(database, author="Ann", name="agents"):
    """Issue a card and return its token."""
    with changing(database) as conn:
        evaluation = find_evaluation(conn, Folder.beside(database), name)
        issued = issue_card(conn, evaluation, author, now_ms())
    return re.search(r"/agents/(\w+)$", evaluation.link(issued.id, "http://h"))[1]


def rows_of(database, sql):
    """Return what a query of the room's tables finds."""
    with looking(database) as conn:
        return conn.execute(sql).fetchall()


class Agent:
    """Who plays with a card of a server in this process."""

    def __init__(self, server, token):
        self.server, self.cards = server, server.app.state.agents
        self.token, self.card = token, server.on_loop(self.cards.find(token))

    def call(self, name, *given, **named):
        """Call a method of `Cards`; the card is looked up as for each request."""
        card = self.server.on_loop(self.cards.find(self.token))
        return self.server.on_loop(getattr(self.cards, name)(card, *given, **named))

    def play(self, index, policy="frontier-cost", moves=10_000):
        """Play an attempt by a rule from what is seen, and return all that was seen."""
        rule = load(policy)
        rule.reset(1)
        seen = [self.call("begin", index)]
        while not seen[-1].done and len(seen) <= moves:
            grid = seen[-1].observation["grid"]
            codes = codes_of(grid)
            seen.append(self.call("act", index, int(rule.act(codes))))
        return seen

    def follow(self, index, actions):
        """Play an attempt by actions that were worked out before."""
        self.call("begin", index)
        for action in actions:
            seen = self.call("act", index, action)
        assert seen.done

    def play_all(self, policy="frontier-cost"):
        """Play every attempt."""
        for index in range(self.call("state")["instances"]):
            self.play(index, policy)


def best_way(database, index, study="dunes", tries=60):
    """The shortest of many ways through an instance's terrain.

    Only somebody who has seen it can know the way.
    """
    frozen = Folder.beside(database).study(study)
    ways = []
    for attempt in range(tries):
        episode = Episode.begin(frozen.protocol.env_config, seed=frozen.seed("ranked", index))
        rule, draws = load("frontier-cost"), np.random.default_rng(attempt)
        rule.reset(0)
        while not episode.ended:
            action = int(rule.act(episode.codes))
            if (
                attempt
                and draws.random() < 0.15
                and (free := np.flatnonzero(is_valid(episode))).size
            ):
                action = int(draws.choice(free))
            episode.step(action)
        ways.append(episode)
    best = max(ways, key=lambda way: way.score)
    return list(best.actions)


def paths(root):
    """Return the option that names the database in a folder."""
    return ["--database", str(root / "playground.db")]


def closed_evaluation(root, policies):
    """A folder with a closed evaluation of three cards.

    Ann's card played all, a second of hers knew the maps, Bo's left most.
    """
    from tests.support.servers import hasty_limits, running_server
    from tests.support.stored_studies import freeze, play_study

    database = root / "playground.db"
    study = freeze(
        root / "playground.db-studies", close=False, draw=lambda count: bytes(count)
    )  # the rule has not the best ways there
    play_study(database, study)
    assert run("study", "close", "dunes", "--keep-secret", "--yes", *paths(root)) == 0
    begun(database, of="dunes")
    tokens = [token_of(database, author) for author in ("Ann", "ann ", "Bo")]
    settings = {"database": database, "limits": hasty_limits()}
    with running_server(policies, **settings) as server:
        first, second, third = (Agent(server, token) for token in tokens)
        first.call("describe", {"agent": "Mapper", "model": "rule", "prompts_sha256": "0" * 64})
        first.play_all()
        for index in range(3):
            second.follow(index, best_way(database, index))
        third.play(1)
        third.play(2, moves=2)
    assert run("agents", "close", "agents", "--yes", "--now", *paths(root)) == 0
    return root
