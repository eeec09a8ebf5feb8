"""Answers of a server held against its own description, /openapi.json."""

import jsonschema_rs
from starlette.routing import Match

_KNOWN = {}
"""Descriptions with their validators, by the messages of the environment and the number of
routes.
"""


class Description:
    """What an app says of its answers."""

    def __init__(self, schema):
        self.schema, self._validators = schema, {}

    def declared(self, path, method, status):
        """What is declared of an answer; None for a call that is not described."""
        operation = self.schema["paths"].get(path, {}).get(method.lower())
        return operation and operation["responses"].get(
            str(status), operation["responses"]["default"] if status >= 400 else {}
        )

    def validator(self, path, method, status, schema):
        key = path, method, status
        if key not in self._validators:
            whole = {**schema, "components": self.schema["components"]}
            self._validators[key] = jsonschema_rs.Draft202012Validator(whole)
        return self._validators[key]


def description_of(app):
    """An app's description, one for all apps of an environment with equal routes."""
    key = id(app._messages), len(app.routes)
    if key not in _KNOWN:
        _KNOWN[key] = Description(app.openapi())
    return _KNOWN[key]


def path_of(app, scope):
    """The path, as the description has it, of the route that answers a request."""
    for route in app.router.routes:
        match, _ = route.matches(scope)
        if match is Match.FULL:
            return getattr(route, "path_format", None)
    return None


def check_answer(app, response):
    """Fail where an answer is not what the description says."""
    url, method = response.request.url, response.request.method
    scope = {"type": "http", "path": url.path, "method": method, "root_path": "", "headers": []}
    path, description = path_of(app, scope), description_of(app)
    declared = description.declared(path, method, response.status_code)
    if declared is None:
        return
    called = f"{method} {url.path} {response.status_code}"
    assert declared, f"{called}: the description has no such status"
    kind = response.headers.get("content-type", "").partition(";")[0]
    content = {name.partition(";")[0]: media for name, media in declared.get("content", {}).items()}
    if not content:
        assert not response.read(), f"{called}: the description has no content"
        return
    assert kind in content, f"{called}: {kind} is not in the description"
    if kind == "application/json" and (schema := content[kind]["schema"]).get("format") != "binary":
        response.read()
        validator = description.validator(path, method, response.status_code, schema)
        errors = [str(error)[:400] for error in validator.iter_errors(response.json())]
        assert not errors, f"{called}: {errors[:3]}"
