"""Every answer of the API has a form of its own.

That answers have the form which the description gives them is checked wherever a test asks a server (`tests.support.answers`).
"""

import json

import pytest

from humanplay.tasks.mars.messages import Course, Frame, History, Mistake
from humanplay.web.server import create_app
from humanplay.web.settings import Settings
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies import load
from tests.support.answers import check_answer
from tests.support.golden_episodes import ROWS

OPEN = {
    "ListedEpisode.config", "Episode.config", "Study.config", "VolunteerFigure.config", "Card.config",
    "Protocol.config", "Protocol.lock",
    "Schemas.action", "Schemas.observation", "Schemas.state", "GET /agents/{token}/openapi.json",
    "RpcAnswer.result",
}  # fmt: skip
"""What an environment, JSON schema or a protocol of somebody else's gives its keys."""


def open_parts(schema, schemas, name, seen):
    """Yield the names of the open objects in a schema."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        if name not in seen:
            seen.add(name)
            yield from open_parts(schemas[name], schemas, name, seen)
        return
    parts = [*schema.get("anyOf", ()), *schema.get("prefixItems", ())]
    parts += [schema["items"]] if isinstance(schema.get("items"), dict) else []
    for part in parts:
        yield from open_parts(part, schemas, name, seen)
    others = schema.get("additionalProperties")
    if isinstance(others, dict):
        yield from open_parts(others, schemas, name, seen)
    for key, part in schema.get("properties", {}).items():
        yield from open_parts(part, schemas, f"{name}.{key}", seen)
    is_object = (
        schema.get("type") == "object" and not isinstance(others, dict) and others is not False
    )
    if is_object or not {"type", "anyOf", "enum", "const"} & schema.keys():
        yield name


def answers_of(description):
    """Yield call, media type and schema of every answer to a request that was granted."""
    for path, operations in description["paths"].items():
        for method, operation in operations.items():
            call = f"{method.upper()} {path}"
            for status, response in operation["responses"].items():
                if status[0] == "2" and (method, path, status) != (
                    "post",
                    "/agents/{token}/mcp",
                    "202",
                ):
                    assert response["content"], f"{call} {status} declares nothing"
                    for kind, media in response["content"].items():
                        yield call, kind, media.get("schema", {})


def description_of(tmp_path, task, **settings):
    return create_app(Settings(database=tmp_path / "a.db", task=task, **settings)).openapi()


def test_every_call_is_described_with_those_of_the_operators_page(tmp_path):
    """What is no page and no file of one has answers of declared forms."""
    app = create_app(Settings(database=tmp_path / "a.db", admin=True))
    described = {
        (path, method.upper())
        for path, operations in app.openapi()["paths"].items()
        for method in operations
    }
    calls = {
        (route.path_format, method)
        for route in app.routes
        if route.path.startswith("/api/") and hasattr(route, "methods")
        for method in route.methods
    }
    assert len([path for path, _ in calls if path.startswith("/api/admin/")]) > 10
    assert calls - described == set()


@pytest.mark.parametrize("task", ["mars", "gymnasium:FrozenLake-v1"])
def test_no_answer_of_any_call_is_open(tmp_path, task):
    description = description_of(tmp_path, task, admin=True)
    open_answers = {
        part
        for call, _, schema in answers_of(description)
        for part in open_parts(schema, description["components"]["schemas"], call, set())
    }
    assert open_answers <= OPEN
    assert "x-environment" not in json.dumps(description)


def test_an_open_answer_is_found(tmp_path):
    app = create_app(Settings(database=tmp_path / "a.db"))

    @app.get("/api/open")
    def opened() -> dict[str, list[dict]]:
        """Nothing in particular."""

    description = app.openapi()
    open_answers = [
        (call, list(open_parts(schema, description["components"]["schemas"], call, set())))
        for call, _, schema in answers_of(description)
    ]
    assert ("GET /api/open", ["GET /api/open"]) in open_answers


def test_files_have_their_media_types(tmp_path):
    kinds = {}
    for call, kind, schema in answers_of(description_of(tmp_path, "mars", admin=True)):
        if schema.get("format") == "binary":
            kinds.setdefault(call, []).append(kind)
    assert kinds == {
        "GET /api/export/{table}.csv": ["text/csv"],
        "GET /api/me/export/{table}.csv": ["text/csv"],
        "GET /api/admin/studies/{name}/files/{file}": [
            "text/html",
            "application/json",
            "application/zip",
        ],
        "GET /api/export/human-scores.zip": ["application/zip"],
        "GET /api/evaluations/{name}/files/{file}": ["application/json"],
        "GET /replay/{episode_id}.{form}": ["text/html", "image/gif", "video/mp4", "image/png"],
    }


def has_form(model, sent):
    """Whether what was sent is, field for field, what a model declares."""
    # a frame's one optional field, `packed`, is sent of large maps alone
    declared = model.model_validate(sent).model_dump_json(
        by_alias=True, exclude_unset=model is Frame
    )
    return json.loads(declared) == sent


def test_golden_episodes_have_the_forms_that_are_declared(server):
    client = server.client()
    rows = [row for row in ROWS if row["rows"] < 21 and row["seed"] == 0]
    assert len(rows) > 10
    for row in rows:
        wanted = {"level": row["level"], "size": [row["rows"], row["cols"]], "seed": row["seed"]}
        about = client.post("/api/sessions", json=wanted).json()
        frame, url = about["frame"], f"/api/sessions/{about['session']}"
        config = EnvConfig.of(row["level"], wanted["size"])
        for action in play_episode(load("random"), config, row["seed"]).actions:
            act = {"episode": frame["episode"], "step": frame["step"], "action": ACTIONS[action]}
            frame = client.post(f"{url}/act", json=act).json()
            assert has_form(Frame, frame)
        golden = row["episodes"]["random"]
        assert {name: frame[name] for name in ("outcome", "discovered", "score")} == {
            name: golden[name] for name in ("outcome", "discovered", "score")
        }
        assert has_form(History, client.get(f"{url}/history").json())
        episode = f"/api/episodes/{frame['episode']}"
        assert has_form(Course, client.get(f"{episode}/replay").json()["run"])
    costs = client.get(f"{episode}/costs").json()
    assert costs["mistakes"]
    assert all(has_form(Mistake, mistake) for mistake in costs["mistakes"])


def test_an_answer_with_an_undeclared_field_is_noticed(server):
    answer = server.client().get("/api/health")
    changed = {**answer.json(), "mood": "good"}
    answer._content = json.dumps(changed).encode()
    with pytest.raises(AssertionError, match="mood"):
        check_answer(server.app, answer)
