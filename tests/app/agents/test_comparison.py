"""How agents are put on one scale with people and policies."""

from humanplay.agents.comparison import compare
from humanplay.agents.evaluation import Protocol
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.description import Description


def test_what_an_agent_left_is_worth_what_people_get_for_leaving():
    """Leaving is worth the lowest score, however much was scored until then."""
    task = f"gymnasium:{Description(id='FrozenLake-v1', bounds=(1, 500)).told}"
    environment = environment_of(task)
    protocol = Protocol(
        name="lake",
        task=task,
        config=environment.default.to_dict(),
        core_version=environment.version,
        lock={},
        instances=3,
    )
    ends = [("abandoned", 499.0), ("environment_failed", 400.0), ("ended", 450.0)]
    episodes = [
        {
            "index": index,
            "begun": True,
            "outcome": outcome,
            "steps": 9,
            "score": score,
            "total": score,
        }
        for index, (outcome, score) in enumerate(ends)
    ]
    receipt = {
        "card": {"id": "c", "ranks": True},
        "agent": {},
        "sees": "both",
        "seen_by": {},
        "episodes": episodes,
    }
    (row,) = compare(protocol, [receipt], [], None)["rows"]
    assert row["score"]["values"] == [1, 1, 450]
