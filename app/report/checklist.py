"""The human-baseline reporting checklist of Wei et al. 2025, filled from the study's database as far as possible.

Items and numbers are those of the checklist in appendix B of "Recommendations and Reporting Checklist for Rigorous &
Transparent Human Baselines in Model Evaluations" (arXiv 2506.13776). What only the authors know is said to be missing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from app.series.protocol import Protocol

Source = Literal["database", "protocol", "software", "missing"]
RECRUITMENT = {
    "invitation": "By single-use invitations that the operator gave out; to whom, the authors must state.",
    "panel": "Through a panel whose link names each participant; its rules of admission, the authors must state.",
    "open": "By a link that anybody could open; where it was published, the authors must state.",
}
"""What the software knows of how participants came, by the protocol's `recruitment`."""
CITATION = "Wei et al. 2025, arXiv 2506.13776, appendix B"


@dataclass(frozen=True)
class Item:
    """An item: its number and name in the checklist, the answer, details, and where the answer comes from.

    source  "missing" where neither database nor protocol nor software can know
    """

    number: str
    name: str
    answer: str
    detail: str
    source: Source


@dataclass(frozen=True)
class Facts:
    """What the answers are made from.

    sets      the figure under each exclusion set, as sentences
    leak      what the trend over earlier finishers says (`app.report.statistics.terrain_leaks`)
    started   people who began a ranked episode
    excluded  of them, those who are not in the primary figure
    erased    people who were erased after closing; of them `erased_finishers` had ended all ranked episodes
    """

    protocol: Protocol
    frozen_at: str
    hash: str
    is_closed: bool
    software: str
    players: int
    joined: int
    finished: int
    episodes: int
    labelled: int
    median_minutes: float | None
    policies: tuple[str, ...]
    sets: str
    leak: str
    started: int
    excluded: int
    erased: int = 0
    erased_finishers: int = 0

    @property
    def erased_in_words(self) -> str:
        """What is said of them behind every count that they are missing from; nothing without any."""
        if not self.erased:
            return ""
        return f" {self.erased} more were erased after closing, {self.erased_finishers} of them finishers."


def checklist(facts: Facts) -> tuple[Item, ...]:
    """Return every item in order."""
    parts = (_paper, _design, _recruitment, _execution, _analysis, _documentation)
    return tuple(item for part in parts for item in part(facts))


def _many(count: int, one: str) -> str:
    """Return a count with its noun: `1 question`, `3 questions`."""
    return f"{count} {one}" if count == 1 else f"{count} {one}s"


def _missing(number: str, name: str, what: str) -> Item:
    return Item(number, name, "Missing", f"The authors must state {what}.", "missing")


def _power(protocol: Protocol) -> Item:
    if protocol.assumed_player_sd is None or protocol.assumed_episode_sd is None:
        what = "whether the number of players was planned (`marsexplorer study power` helps)"
        return _missing("1.8", "Power analysis", what)
    planned = (
        f"{protocol.players} players, for standard deviations of {protocol.assumed_player_sd:g} steps between players and "
        f"{protocol.assumed_episode_sd:g} between a player's episodes, which were assumed before the study."
    )
    return Item("1.8", "Power analysis", "Yes", planned, "protocol")


def _paper(facts: Facts) -> Iterator[Item]:
    items = facts.protocol.ranked
    yield _missing("0.1", "Paper title", "it")
    yield _missing("0.2", "Paper link", "it")
    yield _missing("0.3", "Publication year", "it")
    yield _missing("0.4", "Publication venue", "it")
    yield Item(
        "0.5",
        "Type of eval",
        "Agent",
        "Sequential control: exploring an unknown terrain.",
        "software",
    )
    yield Item(
        "0.6",
        "Mode of eval",
        "Visual",
        "People see the discovered map as a matrix of cells; policies get its codes.",
        "software",
    )
    yield Item(
        "0.7",
        "Language of eval",
        "N/A",
        "The task needs no language; consent and instructions are in English.",
        "software",
    )
    yield Item(
        "0.8",
        "Evaluation dataset size",
        "Unbounded",
        "Terrains are drawn by seed from the level's distribution.",
        "software",
    )
    yield Item(
        "0.9",
        "AI test set size",
        str(items),
        "Policies play exactly the ranked terrains.",
        "protocol",
    )
    yield Item(
        "0.10",
        "AI samples per item",
        "1",
        "A policy's episode is a function of policy, configuration and seed.",
        "software",
    )


def _design(facts: Facts) -> Iterator[Item]:
    protocol = facts.protocol
    each = f"{facts.episodes / protocol.ranked:.1f}"
    limit = protocol.env_config.limit
    yield Item(
        "1.1",
        "Number of baseliners",
        str(facts.players),
        f"{facts.joined} joined.{facts.erased_in_words}",
        "database",
    )
    yield Item(
        "1.2",
        "Baseline test set size",
        str(protocol.ranked),
        "Every participant meets the same terrains.",
        "protocol",
    )
    how = "Independent draws: seeds by HMAC-SHA256 from a secret that was committed to when the protocol was frozen."
    yield Item("1.2.1", "Baseline test set sampling strategy", "Simple random", how, "software")
    yield Item(
        "1.3",
        "Baseline samples per item",
        each,
        f"{facts.episodes} episodes on {protocol.ranked} terrains.",
        "database",
    )
    yield Item(
        "1.4",
        "Items per baseliner",
        str(protocol.ranked),
        f"After {protocol.warm_up} to warm up.",
        "protocol",
    )
    same = "The page shows people what the policy observes: the discovered cells and nothing else. Scoring is the same."
    yield Item("1.5", "Explicit human/AI adjustment", "Yes", same, "software")
    yield _missing("1.6", "Iterative design", "whether there was a pilot")
    effort = f"Both have at most {limit} moves an episode. People's time to think is recorded and not limited."
    yield Item("1.7", "Amount of effort", "Partial", effort, "software")
    yield _power(protocol)
    yield _missing(
        "1.8.1",
        "Minimum detectable effect size",
        "it, with the power, where there was a power analysis",
    )
    yield _missing("1.9", "Ethics review", "whether a board approved or exempted the study")
    frozen = f"Protocol frozen {facts.frozen_at}, SHA-256 {facts.hash[:16]}…; whether it was registered publicly is not known."
    yield Item("1.10", "Pre-registration", "Partial", frozen, "protocol")


def _recruitment(facts: Facts) -> Iterator[Item]:
    protocol = facts.protocol
    questions = _many(len(protocol.questions), "question")
    yield _missing("2.1", "Population of interest identification", "the population")
    yield _missing("2.1.1", "Population of interest identification criteria", "them")
    yield Item(
        "2.2",
        "Baseliner sampling strategy",
        "Partial",
        RECRUITMENT[protocol.recruitment],
        "protocol",
    )
    asked = f"{questions} must be answered rightly before the warm-up; criteria of recruitment are not known."
    yield Item("2.3", "Quality control in recruitment", "Partial", asked, "protocol")
    yield _missing(
        "2.3.1", "Quality control criteria for baseliners", "criteria of recruitment, if any"
    )
    yield _missing("2.3.2", "Recruitment exclusion rate", "whom recruitment turned away")
    yield _missing("2.4", "Author baseliners", "whether members of the team took part")
    unseen = (
        "Ranked terrains come from a secret, and the server shows nobody more than their own moves have earned until "
        "the study closes. Whether somebody learnt of a terrain in another way is not known. "
    )
    yield Item(
        "2.5", "Baseliner train/test contamination", "Unknown", unseen + facts.leak, "database"
    )
    yield Item(
        "2.6",
        "Baseliner training",
        "Yes",
        "Everybody, before the first ranked episode.",
        "protocol",
    )
    kind = f"A tutorial to play, {questions} and {_many(protocol.warm_up, 'warm-up episode')} with feedback."
    yield Item("2.6.1", "Baseliner training type", "Tutorial and practice", kind, "protocol")
    yield _missing("2.6.2", "Baseliner training compensation", "it")
    yield _missing("2.6.2.1", "Baseliner training compensation amount", "it")
    yield _missing("2.7", "Baseliner testing compensation", "it")
    yield _missing("2.7.1", "Baseliner testing compensation amount", "it")
    yield _missing("2.7.2", "Baseliner testing performance bonus", "it")
    yield _missing("2.7.2.1", "Baseliner testing performance bonus amount", "it")
    yield _missing("2.7.3", "Baseliner testing compensation structure", "it")
    yield _missing("2.7.3.1", "Baseliner testing compensation structure details", "them")


def _execution(facts: Facts) -> Iterator[Item]:
    protocol = facts.protocol
    sitting = f"A break is offered every {protocol.break_every} ranked episodes; a participant may leave and resume."
    yield Item(
        "3.1", "Instrument length", str(protocol.warm_up + protocol.ranked), sitting, "protocol"
    )
    order = "Orders are rows of a Latin square permuted by the study's secret."
    yield Item("3.1.1", "Item randomization", "Yes", order, "protocol")
    checks = (
        "The server makes every move itself and compares it with the input events that the page sends; an episode below the "
        f"level of attestation that the protocol requires ({protocol.required_attestation}) enters no figure. Implausible "
        "input is labelled."
    )
    yield Item("3.2", "Quality control in execution", "Yes", checks, "software")
    yield Item(
        "3.2.1",
        "Quality control in execution criteria",
        "See exclusion sets",
        "Fixed in the protocol.",
        "protocol",
    )
    rate = (
        f"{facts.excluded} of {facts.started} who began a ranked episode are not in the primary figure. "
        f"{facts.labelled} of {facts.episodes} finished ranked episodes carry a label.{facts.erased_in_words}"
    )
    yield Item(
        "3.2.2",
        "Execution exclusion rate",
        f"{facts.excluded} of {facts.started}",
        rate,
        "database",
    )
    yield Item(
        "3.3",
        "UI equivalence",
        "No",
        "People use a page, policies a matrix of the same cells.",
        "software",
    )
    yield Item(
        "3.3.1",
        "GUI vs. API",
        "Yes",
        "People have a graphical page, policies the program interface.",
        "software",
    )
    yield Item(
        "3.3.2",
        "UI equivalence adjustment",
        "Partial",
        "The page draws the policy's matrix itself, cell by cell.",
        "software",
    )
    yield Item(
        "3.4",
        "Instruction equivalence",
        "N/A",
        "Policies take no instructions; they were trained on the reward.",
        "software",
    )
    yield Item("3.4.1", "Instruction equivalence adjustment", "N/A", "See 3.4.", "software")
    tools = "Nobody is given tools; what people used beside the page is not known."
    yield Item("3.5", "Tool access equivalence", "Unknown/Unreported", tools, "software")
    guard = "Input that the browser does not vouch for, or that came while the page was hidden, is labelled."
    yield Item("3.5.1", "Tool access equivalence enforcement", "Partial", guard, "software")
    yield Item("3.6", "Explanations", "No", "None are collected.", "software")


def _analysis(facts: Facts) -> Iterator[Item]:
    words = facts.protocol.rules.words
    compared = bool(facts.policies and facts.players)
    answer = "Yes" if compared else "No"
    yield Item(
        "4.1",
        "Statistical significance",
        answer,
        f"Policies: {', '.join(facts.policies) or 'none played'}.",
        "database",
    )
    test = (
        "Test of the paired differences over players and terrains (crossed, Satterthwaite), adjusted by Holm's method."
        if compared
        else "None."
    )
    yield Item("4.1.1", "Statistical significance test", test, "", "software")
    yield Item(
        "4.2",
        "Uncertainty estimate",
        "Yes",
        "Intervals over players, and over players and terrains.",
        "software",
    )
    yield Item(
        "4.2.1",
        "Estimate type",
        "Point, interval, distribution",
        "Every player's mean is shown.",
        "software",
    )
    yield Item(
        "4.3",
        "Evaluation metric equivalence",
        "Yes",
        f"{words.score[0].upper()}{words.score[1:]} and {words.steps} for both.",
        "software",
    )
    yield Item(
        "4.4",
        "Evaluation scoring criteria equivalence",
        "Yes",
        "One compiled set of rules scores both.",
        "software",
    )
    yield Item(
        "4.5",
        "Evaluation scoring method equivalence",
        "Yes",
        "By the rules; nobody grades.",
        "software",
    )
    yield Item(
        "4.6",
        "Quality control robustness",
        "Reported",
        facts.sets or "Nobody has played.",
        "database",
    )


def _documentation(facts: Facts) -> Iterator[Item]:
    time = (
        f"Median {facts.median_minutes:.1f} minutes a ranked episode."
        if facts.median_minutes is not None
        else "Nobody has played."
    )
    yield Item(
        "5.1.1",
        "Reporting sample demographics",
        "No",
        "Not asked by this software; the authors may.",
        "missing",
    )
    yield Item(
        "5.1.2",
        "Reporting baseline instructions",
        "Yes",
        "Consent text and questions are in the protocol.",
        "protocol",
    )
    yield Item("5.1.3", "Reporting time to completion", "Yes", time, "database")
    yield Item("5.1.4", "AI tool versions", "N/A", "Participants are given no AI tool.", "software")
    rate = f"{facts.joined - facts.finished} of {facts.joined} who joined have not finished.{facts.erased_in_words}"
    yield Item("5.1.5", "Completion rate", "Yes", rate, "database")
    data = f"Planned licence {facts.protocol.data_licence}; the authors must say where the release (`marsexplorer release`) is."
    yield Item("5.2", "Baseline data availability", "Missing", data, "missing")
    yield Item(
        "5.2.1",
        "Individual baseline data availability",
        "Yes",
        "A release has every move under pseudonyms.",
        "software",
    )
    yield _missing(
        "5.2.2",
        "Baseline data non-availability justification",
        "it, should the data not be published",
    )
    secret = "revealed" if facts.is_closed else "revealed when the study closes"
    yield Item(
        "5.3",
        "Experimental materials availability",
        "Yes",
        f"Software and protocol; the seeds' secret is {secret}.",
        "software",
    )
    yield Item(
        "5.4",
        "Analysis code availability",
        "Yes",
        f"This report's code, MarsExplorer Playground {facts.software}.",
        "software",
    )
