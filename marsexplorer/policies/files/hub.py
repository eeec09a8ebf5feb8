"""Policies on the Hugging Face hub: one policy a model repository, with its card.

A repository has three files: `NAME.onnx`, the policy as it plays anywhere; `config.json`, the card
in its metadata; and `README.md`, the model card that the hub shows. A file from a repository is
read as any policy file is: nothing is unpickled.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx2
from huggingface_hub import CommitOperationAdd, EvalResult, HfApi, ModelCardData
from huggingface_hub.errors import (
    EntryNotFoundError,
    HfHubHTTPError,
    HFValidationError,
    LocalEntryNotFoundError,
    LocalTokenNotFoundError,
    RepositoryNotFoundError,
    RevisionNotFoundError,
)

from marsexplorer.files import write_whole
from marsexplorer.policies.files.card import SUFFIX, read_card
from marsexplorer.policies.files.model import refuse

METRICS = {
    "steps": "Steps to 99 % coverage",
    "completion": "Share of episodes that reach 99 % coverage",
    "score": "Normalized score",
    "human_likeness": "Share of people's moves that it makes too",
}
"""Key of a card's results -> its name on the hub."""

REPO = re.compile(r"[\w.-]+/[\w.-]+")


class HubError(RuntimeError):
    """The hub refused, lacks what was asked for, or could not be reached."""


def model_card(path: Path, repo: str) -> str:
    """The README.md of a policy's repository "OWNER/NAME": YAML metadata and its card.

    PolicyFileError if the file is not a policy with a card.
    """
    card = _card_of(path)
    metadata = ModelCardData(
        license="mit",
        library_name="humanplay",
        pipeline_tag="reinforcement-learning",
        tags=["reinforcement-learning", "marsexplorer", "exploration", "gymnasium"],
        model_name=path.stem,
        eval_results=list(_eval_results(card)) or None,
    )
    return f"---\n{metadata.to_yaml()}\n---\n\n{_words(path, card, repo)}"


def push(path: Path, repo: str, *, is_private: bool = False, token: str | None = None) -> str:
    """Write a policy file and its cards into a repository, in one commit.

    The repository is created if it does not exist. If the hub refuses, nothing is half-written.

    Args:
        path: A policy file with a card.
        repo: "OWNER/NAME".
        is_private: Whether a new repository is private.
        token: The access token; None: the one that the hub's client has stored.

    Returns:
        The repository's address.

    Raises:
        HubError: If the hub refuses or cannot be reached.
        PolicyFileError: If the file is not a policy with a card.
    """
    files = {path.name: path.read_bytes(), "config.json": card_json(path)}
    files["README.md"] = model_card(path, repo).encode()
    api = _api(token)
    with _hub_errors(_checked(repo)):
        api.create_repo(repo, private=is_private, exist_ok=True)
        additions = [CommitOperationAdd(*file) for file in files.items()]
        api.create_commit(repo, additions, commit_message=f"Upload the policy {path.stem}")
    return f"{api.endpoint}/{repo}"


def pull(repo: str, folder: Path, *, revision: str | None = None, token: str | None = None) -> Path:
    """Download the policy of a repository into a folder and return its file.

    Args:
        repo: "OWNER/NAME".
        folder: Where the file goes; it is made if need be.
        revision: A branch, tag or commit; None: the newest.
        token: The access token; None: the one that the hub's client has stored.

    Raises:
        HubError: As for `push`, and if the repository has no policy file or several.
        PolicyFileError: If the file is not a policy with a card.
    """
    api = _api(token)
    with _hub_errors(_checked(repo)):
        siblings = api.model_info(repo, revision=revision).siblings or []
        names = [file.rfilename for file in siblings if file.rfilename.endswith(SUFFIX)]
        if len(names) != 1:
            raise HubError(
                f"expected one {SUFFIX} file in {repo}, found {len(names)}: {', '.join(names) or 'none'}"
            )
        source = Path(api.hf_hub_download(repo, names[0], revision=revision))
    _card_of(source)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / Path(names[0]).name
    with write_whole(path) as file:
        file.write(source.read_bytes())
    return path


def card_json(path: Path) -> bytes:
    """The card in a policy's file as indented JSON."""
    return json.dumps(_card_of(path), indent=2, ensure_ascii=False).encode() + b"\n"


def _card_of(path: Path) -> dict[str, Any]:
    """The card in a policy's file; PolicyFileError if there is none."""
    card = read_card(path)
    if not card:
        raise refuse(path, 'a card under "card" in its metadata', "none")
    return card


def _eval_results(card: dict[str, Any]) -> Iterator[EvalResult]:
    """Yield a card's numbers by level and size, one result for each metric."""
    for setting, metrics in _results(card).items():
        for key, name in METRICS.items():
            if key in metrics:
                yield EvalResult(
                    task_type="reinforcement-learning",
                    task_name="Exploration of unknown terrain",
                    dataset_type="marsexplorer",
                    dataset_name=f"MarsExplorer {setting}",
                    metric_type=key,
                    metric_name=name,
                    metric_value=metrics[key],
                )


def _results(card: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The results of a card that are numbers by metric, for each setting."""
    results = card.get("results", {}).items()
    return {setting: metrics for setting, metrics in results if isinstance(metrics, dict)}


def _words(path: Path, card: dict[str, Any], repo: str) -> str:
    """A policy's card as Markdown: what it is, how to play it, results and limits."""
    lines = [f"# {path.stem}", "", str(card.get("summary", "A policy for MarsExplorer.")), ""]
    lines += ["## Play it", "```sh", f"marsexplorer policies pull {repo}"]
    lines += [f"humanplay serve --policy {path.name}", "```", ""]
    lines += [f"or `marsexplorer.policies.load({path.name!r})` in Python.", ""]
    if "command" in card:
        lines += ["## How it was made", f"`{card['command']}`", ""]
    if results := _results(card):
        pairs = [pair for metrics in results.values() for pair in metrics.items()]
        keys = list(dict.fromkeys(key for key, number in pairs if not isinstance(number, list)))
        rows = [["setting", *keys]]
        for setting, metrics in results.items():
            rows.append([setting, *(str(metrics.get(key, "")) for key in keys)])
        table = [f"| {' | '.join(row)} |" for row in rows]
        lines += ["## Results", table[0], "|---" * (len(keys) + 1) + "|", *table[1:], ""]
    if "limits" in card:
        lines += ["## Limits", str(card["limits"]), ""]
    lines += [
        "`config.json` has the whole card. The environment is that of Koutras et al. (2021), arXiv:2107.09996."
    ]
    return "\n".join(lines) + "\n"


def _checked(repo: str) -> str:
    """The repository's name if it is OWNER/NAME; HubError otherwise."""
    if not REPO.fullmatch(repo):
        raise HubError(f"expected a repository as OWNER/NAME, got {repo!r}")
    return repo


def _api(token: str | None) -> HfApi:
    """A client of the hub, or of the server that HF_ENDPOINT names."""
    endpoint = os.environ.get("HF_ENDPOINT")
    return HfApi(endpoint=endpoint, token=token, library_name="humanplay")


@contextmanager
def _hub_errors(repo: str) -> Iterator[None]:
    """Turn the errors of the hub's client into a HubError that says what to do."""
    try:
        yield
    except HubError:
        raise
    except (
        EntryNotFoundError,
        HFValidationError,
        RuntimeError,
        httpx2.TransportError,
        OSError,
    ) as error:
        raise HubError(_sentence(error, repo)) from error


def _sentence(error: Exception, repo: str) -> str:
    connection = "check the connection, or HF_ENDPOINT"
    match error:
        case LocalTokenNotFoundError():
            return "the hub asks who you are: run `hf auth login`, or set HF_TOKEN"
        case RevisionNotFoundError():
            return f"{repo} has no such revision; look at its list of commits"
        case RepositoryNotFoundError():
            return f"no repository {repo} that you may see; check the name, or run `hf auth login`"
        case LocalEntryNotFoundError():
            return f"the hub could not be reached while a file was read; {connection}"
        case EntryNotFoundError():
            return f"a file of {repo} went missing while it was read; try again"
        case HFValidationError():
            return f"{repo!r} is no name of a repository: {error}"
        case HfHubHTTPError():
            reason = error.server_message or (str(error).splitlines() or [type(error).__name__])[0]
            return f"the hub refused: {reason}"
        case RuntimeError():
            return f"the hub did not take the file: {error.__cause__ or error}; try again"
    return f"the hub could not be reached: {error}; {connection}"
