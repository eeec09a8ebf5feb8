"""What the API of evaluations answers.

Evaluations are for everybody; messages of OpenEnv and MCP are for holders of a card.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from humanplay.agents.evaluation import PlayedStudy, Protocol
from humanplay.web.answers.base import Answer, Configuration
from humanplay.web.answers.leaderboard import StudyFigure

JsonSchema = dict[str, object]
"""A JSON schema, or an OpenAPI description, which has a form of its own."""
Sees = Literal["picture", "observation", "both"]


class ListedEvaluation(Answer):
    """An evaluation of agents."""

    name: str
    status: Literal["open", "closed"]
    task: str = Field(description="what is played, by its title")
    where: str = Field(description="its configuration in words")
    instances: int
    protocol_hash: str
    commitment: str = Field(description="SHA-256 of the secret")
    sees: Sees
    hours: float = Field(description="from a card's first attempt until the card is closed")
    minutes: float | None = Field(
        description="that an attempt may take; null: no limit but its moves"
    )
    calls: int = Field(description="that a card may make, times the number of instances")
    study: PlayedStudy | None = Field(
        description="whose terrains are played; null: its own instances"
    )


class Words(Answer):
    """What the figures are called."""

    score: str
    steps: str
    definition: str


class PeopleRow(StudyFigure):
    """The people of the study whose terrains were played."""

    claim: str = Field(description="what their figure may be called")
    set: str = Field(description="whom it is of")
    everybody: StudyFigure = Field(description="everybody who began")
    sentence: str
    sees: str


class InstanceOfPeople(Answer):
    """What people came to on an instance."""

    index: int
    players: int
    completed: int
    upper_median: int | None = Field(description="moves; null where fewer than half completed it")
    best: int | None = Field(description="moves")
    score: float | None = Field(description="their mean")
    steps: float | None = Field(description="their mean; moves")


class MetricComparison(Answer):
    """A policy or an agent in one metric.

    It stands beside people if they played the same instances.
    """

    mean: float
    values: list[float] = Field(description="of each instance")
    difference: float | None = Field(description="to people's mean; null without people")
    terrains: int | None = Field(default=None, description="that people played too")
    interval: tuple[float, float] | None = Field(
        default=None, description="95 %, of the difference"
    )
    normalized: float | None = Field(default=None, description="(own - random) / (people - random)")


class Row(Answer):
    """What somebody came to on the instances."""

    name: str
    outcomes: list[str] = Field(description="of each instance")
    score: MetricComparison
    steps: MetricComparison = Field(
        description="moves of a success, the limit for any other ending"
    )


class PolicyRow(Row):
    """A policy on the same instances."""

    kind: Literal["policy"]
    rank: None


class ReceiptCard(Answer):
    """The card of an agent."""

    id: str
    author: str
    number: int = Field(description="among the author's cards")
    ranks: bool = Field(description="whether it is the author's first")
    note: str | None


class AgentDescription(Answer):
    """What an author says of their agent; nobody has checked it."""

    agent: str | None = Field(default=None, description="its name")
    version: str | None = None
    model: str | None = None
    prompts_sha256: str | None = None
    cost: str | None = None


class Exposure(Answer):
    """Who could have seen the instances before the agent."""

    participants: int
    participants_since: str | None = Field(description="a date and time, UTC")
    operators: str
    operators_since: str = Field(description="a date and time, UTC")
    other_cards_before: int


class AgentRow(Row):
    """An agent."""

    kind: Literal["agent"]
    rank: int | None = Field(description="among cards that rank")
    attempts: int
    card: ReceiptCard
    agent: AgentDescription
    sees: Sees
    seen_by: Exposure


class Comparison(Answer):
    """People, policies and agents on one scale."""

    words: Words
    terrains_drawn: bool = Field(description="whether intervals are for other terrains too")
    better: Literal["higher", "lower"]
    limit: int = Field(description="moves")
    people: PeopleRow | None
    instances: list[InstanceOfPeople]
    rows: list[PolicyRow | AgentRow]


class Evaluation(ListedEvaluation):
    """What an evaluation has published."""

    cards: int = Field(description="that were issued")
    protocol: Protocol
    secret: str | None = Field(description="null while it is open")
    comparison: Comparison | None = Field(description="null while it is open")


class CardHealth(Answer):
    """The card can be played."""

    status: Literal["healthy"]


class Metadata(Answer):
    """What is played."""

    name: str
    description: str


class Schemas(Answer):
    """JSON schemas of what is sent and seen."""

    action: JsonSchema
    observation: JsonSchema
    state: JsonSchema


class Split(Answer):
    """A set of instances."""

    name: str
    type: Literal["test"]


class Instance(Answer):
    """An instance, by its id and by its index in a split."""

    task: str
    split: str
    index: int


class Instances(Answer):
    """Instances of a split."""

    tasks: list[Instance]
    env_name: str


class InstanceCount(Answer):
    """How many instances a split has."""

    num_tasks: int


class OneInstance(Answer):
    """One instance."""

    task: Instance


class CardState(Answer):
    """Which attempts were begun and finished, by their instances' indices.

    No score is in it.
    """

    instances: int
    begun: list[int]
    finished: list[int]
    calls: int = Field(description="made so far")


class Card(Answer):
    """What is played with a card, and how far it is."""

    author: str
    number: int = Field(description="among the author's cards")
    agent: AgentDescription
    evaluation: str
    title: str
    instructions: str
    actions: list[str] = Field(description="names, by their codes")
    sees: Sees
    seen: str = Field(description="what is seen, in words")
    config: Configuration = Field(description="the environment's own configuration")
    limit: int = Field(description="moves of an attempt, at most")
    instances: int
    hours: float = Field(description="from the first attempt until the card is closed")
    minutes: float | None = Field(description="that an attempt may take")
    calls: int = Field(description="in all")
    state: CardState


class StoredDescription(Answer):
    """All that the author has said of their agent."""

    agent: AgentDescription


class CardClosure(Answer):
    """The card is closed."""

    closed: Literal[True]


class RpcError(Answer):
    """Why a request of JSON-RPC failed."""

    code: int
    message: str


class RpcAnswer(Answer):
    """An answer of JSON-RPC 2.0: a result, whose form is the method's, or an error."""

    jsonrpc: Literal["2.0"]
    id: str | int | None
    result: dict[str, object] | None = Field(
        default=None, description="as the Model Context Protocol has it"
    )
    error: RpcError | None = Field(default=None, description="instead of a result")
