"""A closed study's figures from a release's files: `independent_figures.py DIR`."""

import csv
import json
import math
import sqlite3
import sys
from collections import Counter
from contextlib import closing
from functools import cache
from pathlib import Path
from statistics import NormalDist

import numpy as np
import scipy

METRICS = {"score": "score", "steps": "steps_to_99"}
NO_ESTIMATE = {"declined", "undecided", "never_began", "withdrew_early", "interrupted_early", "bot"}
UNSEEN, TAIL = 0.25, 0.025


def rows_of(release, name):
    """Return the rows of a table of the release."""
    with (release / "csv" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def figures(release):
    """Return the means with intervals, and the counts of statuses.

    They are {"per protocol", "everybody": {metric: (mean, interval)}, "statuses": counts}.
    """
    protocol = json.loads((release / "protocol.json").read_text(encoding="utf-8"))
    people = [row for row in rows_of(release, "participants") if row["kind"] == "human"]
    episodes = [row for row in rows_of(release, "episodes") if row["phase"] == "ranked"]
    are_drawn = protocol["ranked"] >= 5 and not protocol["fixed_terrains"]
    limit = int(episodes[0]["max_steps"])
    worst = {"score": lowest_score(episodes[0]), "steps": float(limit)}
    finished = [row["participant"] for row in people if row["status"] == "finished"]
    began = [row["participant"] for row in people if row["status"] not in NO_ESTIMATE]
    by_analysis = {"per protocol": {}, "everybody": {}}
    for metric, column in METRICS.items():
        for name, ids in (("per protocol", finished), ("everybody", began)):
            table = np.full((len(ids), protocol["ranked"]), worst[metric])
            for row in episodes:
                if row["participant"] in ids and not (name == "everybody" and row["lowest"]):
                    place = ids.index(row["participant"]), int(row["terrain_index"])
                    table[place] = float(row[column])
            ends = interval(table, worst[metric], are_drawn)
            by_analysis[name][metric] = float(table.mean(1).mean()), ends
    with closing(sqlite3.connect(release / "study.sqlite")) as conn:
        query = "SELECT count(*) FROM meta WHERE name LIKE 'erased|%'"
        (erased,) = conn.execute(query).fetchone()
    counts = Counter(row["status"] for row in people)
    by_analysis["statuses"] = dict(counts + Counter(erased=erased))
    return by_analysis


def lowest_score(episode):
    """The score of a limit of moves that discover nothing and end in a collision."""
    # the bonus and an invalid move come to as much as all cells do (levels other than t-m-2)
    return -0.5 * int(episode["max_steps"]) / (3 * int(episode["rows"]) * int(episode["cols"]))


def interval(table, worst, are_drawn):
    """Return the 95 % interval of a table without gaps; None below five participants.

    are_drawn  whether it is for other terrains too
    """
    if len(table) < 5:
        return None
    seen = table + UNSEEN / len(table) * (worst - table)
    low, high = (seen, table) if worst < table.mean() else (table, seen)
    return low_end(low, are_drawn), -low_end(-high, are_drawn)


def low_end(table, are_drawn):
    """The lowest mean under other weights on participants, terrains, and half each."""
    people, terrains = table.mean(1), table.mean(0)
    if not are_drawn:
        return lowest(people, radius(len(people), 1))
    most = largest_radius(*table.shape)
    one, both = (
        (
            lowest(people, radius(len(people), stretch)),
            lowest(terrains, min(radius(len(terrains), stretch), most)),
        )
        for stretch in (1, math.sqrt(2))
    )
    return min(*one, sum(both) / 2)


def largest_radius(people, terrains):
    """The radius at which a terrain weighs as much as a participant on average."""
    if people >= terrains:
        return math.inf
    others = (1 - people / terrains) / (1 - 1 / terrains)
    return -math.log(people) - (terrains - 1) * math.log(others)


@cache
def radius(count, stretch):
    """The radius within which the lowest mean of normal scores is Student's end."""
    shares = (np.arange(1, count + 1) - 3 / 8) / (count + 1 / 4)
    scores = np.array([NormalDist().inv_cdf(share) for share in shares])
    reach = stretch * scipy.stats.t.isf(TAIL, count - 1) / math.sqrt(count)
    if reach >= -scores[0]:
        return math.inf
    return scipy.optimize.brentq(lambda size: lowest(scores, size) + reach, 1e-9, 300)


def lowest(values, size):
    """Return the lowest mean whose weights w have sum(-log(n w)) of at most `size`."""
    if size == math.inf or np.ptp(values) == 0:
        return float(values.min())
    scale = float(values.std())
    near, far = -40.0, 40.0
    for _ in range(200):
        middle = (near + far) / 2
        weights = 1 / ((values - values.min()) / scale + math.exp(middle))
        weights /= weights.sum()
        is_beyond = -np.log(len(values) * weights).sum() > size
        near, far = (middle, far) if is_beyond else (near, middle)
    return float(weights @ values)


if __name__ == "__main__":
    print(json.dumps(figures(Path(sys.argv[1])), indent=2))
