"""The paper's claims and their verdicts: the table rows of `docs/paper.md`.

Each row is one claim, judged from shipped results. A claim without a result is "not yet measured"
by itself. The document has what the paper says and what the authors' repository does; here is what
was measured, with which command, and what follows from it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from research.paper.claims import policy_claims as played
from research.paper.claims import training_claims as training
from research.paper.claims.checks import CHECKS
from research.paper.claims.results import (
    DIFFERENT,
    NOTHING,
    PEOPLE,
    REPRODUCED,
    SLIP,
    Decide,
    Judgement,
    Results,
    verdict,
)


@dataclass(frozen=True)
class Claim:
    """One statement of the paper.

    command  measures it; None for checks, which have one command, and if nothing measures it
    decide   results -> what was measured, and the verdict
    """

    command: str | None
    decide: Decide


def checked(name: str) -> Claim:
    """The claim that a check of the environment decides."""

    def decide(results: Results) -> Judgement:
        line = results.checks.get(name)
        if line is None:
            return NOTHING
        return Judgement(line["measured"], verdict(line["holds"]))

    return Claim(None, decide)


def slip(name: str) -> Claim:
    """The claim of a check of the paper's own numbers: if it fails, the paper slipped."""
    claim = checked(name)

    def decide(results: Results) -> Judgement:
        judgement = claim.decide(results)
        is_slip = judgement.verdict == verdict(False)
        return Judgement(judgement.measured, SLIP, judgement.measured) if is_slip else judgement

    return Claim(None, decide)


def settled(measured: str, verdict_text: str, command: str | None = None) -> Claim:
    """A claim that no measurement decides.

    It is there to be seen, ours differs by choice, or it needs people.
    """
    return Claim(command, lambda results: Judgement(measured, verdict_text))


RESULTS_PAGE = Path(__file__).resolve().parents[3] / "docs" / "results.md"
SPEED = re.compile(
    r"^\|through `gymnasium\.make`, uint8 codes\|(?P<measured>[\d,]+)\|(?P<wanted>[\d,]+)\|$", re.M
)
"""The row of the page of results."""


def fast(page: str) -> Judgement:
    """Time steps are executed rapidly (2.5): as fast as the page of results wants it."""
    row = SPEED.search(page)
    if row is None:
        return NOTHING
    is_fast = int(row["measured"].replace(",", "")) >= int(row["wanted"].replace(",", ""))
    return Judgement(
        f"{row['measured']} steps per CPU second through `gymnasium.make`, {row['wanted']} wanted "
        "([results](results.md#speed-of-the-environment))",
        verdict(is_fast),
    )


FIGURE = "--figure"
"""What its command adds to `python -m research.paper`."""
GENERALISATION = "python -m research.paper.generalisation"

CLAIMS: dict[str, Claim] = {name: checked(name) for name in CHECKS} | {
    "shares": slip("shares"),
    "discovered-obstacles": Claim(f"{FIGURE} 6", played.discovered),
    "manual": settled(
        "people drive the rover in a browser, by arrow keys too", REPRODUCED, "humanplay serve"
    ),
    "fast": Claim("python -m research.speed", lambda _: fast(RESULTS_PAGE.read_text())),
    "rllib": settled("PPO by our own trainer; A2C, Rainbow and SAC by tianshou 2", DIFFERENT),
    "network": settled(
        "the paper gives no sizes; what ran stands in the rows *network* of the [settings](paper-trainings.md#settings)",
        DIFFERENT,
    ),
    "a3c": settled(
        "A2C: the same loss as A3C's, computed synchronously, so no gradient is stale", DIFFERENT
    ),
    "bands": settled("intervals: 95 % t intervals of the mean over seeds", DIFFERENT),
    "players": settled("no closed study with people exists yet", PEOPLE, "humanplay report"),
    "best": Claim(f"{FIGURE} 4", training.best),
    "second": Claim(f"{FIGURE} 4", training.second),
    "half": Claim(f"{FIGURE} 4", training.half),
    "morphology-first": Claim(f"{FIGURE} 5", training.morphology_first),
    "morphology-degrades": Claim(f"{FIGURE} 5", training.morphology_degrades),
    "hardest": Claim(f"{FIGURE} 5", training.hardest),
    "generalises": Claim(GENERALISATION, training.generalises),
    "harder-generalises": Claim(GENERALISATION, training.harder_generalises),
    "bonus-little": Claim(f"{FIGURE} 5", training.bonus_little),
    "same-family": Claim(f"{FIGURE} 6", played.same_family),
    "hilbert": Claim(f"{FIGURE} 6", played.hilbert),
    "dexterous": Claim(f"{FIGURE} 6", played.dexterous),
    "utility": settled(
        "`frontier-utility`: expected new cells over the squared length of the path, decided anew at every move; there is no "
        "potential field",
        DIFFERENT,
        "pytest tests/marsexplorer/policies/test_frontier.py",
    ),
    "less-distance": Claim(f"{FIGURE} 7", played.less_distance),
    "knee": Claim(f"{FIGURE} 7", played.knee),
    "no-knee": Claim(f"{FIGURE} 7", played.no_knee),
    "scales": Claim(f"{FIGURE} 7", played.scales),
}
"""Name of the claim, as in the first column of its row -> the claim."""

FINDINGS = frozenset(
    {
        "players",
        "best",
        "second",
        "half",
        "shares",
        "morphology-first",
        "morphology-degrades",
        "hardest",
        "generalises",
        "harder-generalises",
        "bonus-little",
        "discovered-obstacles",
        "same-family",
        "hilbert",
        "dexterous",
        "less-distance",
        "knee",
        "no-knee",
        "scales",
    }
)
"""The claims about findings; the others are about definitions and methods."""


def cells(name: str, results: Results) -> tuple[str, str]:
    """The last two cells of a claim's row, as Markdown.

    What was measured with its command, and the verdict.
    """
    claim = CLAIMS[name]
    judgement = claim.decide(results)
    parts = [judgement.measured] if judgement.measured else []
    if claim.command is not None:
        parts.append(f"`{claim.command}`")
    return "<br>".join(parts), judgement.verdict
