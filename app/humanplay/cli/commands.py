"""The commands, and which extra of the package brings which optional library, so that a missing one is named in a sentence.

This module imports nothing that an extra brings: it is what speaks when click itself is missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

EXTRAS: dict[str, tuple[str, ...]] = {
    "mars": ("numba", "llvmlite"),
    "maps": ("PIL", "yaml"),
    "play": ("viser", "msgspec", "zstandard"),
    "server": (
        "PIL", "fastapi", "starlette", "uvicorn", "h11", "websockets", "sqlite_utils",
        "pydantic_settings", "pydantic", "itsdangerous", "limits", "secure", "jinja2", "click", "rich", "scipy",
        "prometheus_client", "pythonjsonlogger", "isal",
    ),
    "networks": ("torch",),
    "train": ("tensorboardX", "matplotlib", "click", "rich", "scipy"),
    "study": ("httpx", "matplotlib", "jinja2"),
    "export": ("pyarrow", "minari", "h5py", "mlcroissant", "cryptography"),
    "onnx": ("onnx", "onnxruntime"),
    "ray": ("ray",),
    "any": ("pygame",),
    "hub": ("huggingface_hub", "httpx2", "click", "rich"),
    "video": ("av",),
    "agents": ("cryptography", "openenv", "openai"),
}  # fmt: skip
"""Extra -> the modules that it brings itself, by the names they are imported by."""

INCLUDED: dict[str, tuple[str, ...]] = {
    "maps": ("mars",),
    "any": ("server",),
    "play": ("server", "mars", "onnx", "maps"),
    "networks": ("mars", "onnx"),
    "train": ("networks",),
    "study": ("play",),
    "export": ("study",),
    "ray": ("train",),
    "hub": ("mars", "onnx"),
    "video": ("play",),
    "agents": ("study",),
}
"""Extra -> the extras that it includes."""

COMMANDS = {
    "serve": ("serve", "play", "Play and watch in a browser; every move is recorded."),
    "play": ("serve", "play", "Play one environment on this machine, in its browser."),
    "export": ("database", "play", "Write the recorded episodes as CSV."),
    "replay": ("replay", "play", "Write an episode as a page in one file, a GIF or an MP4."),
    "doctor": ("doctor", "any", "Say whether an environment follows from seed and actions."),
    "evaluate": ("training.evaluate", "play", "Score policies on the same terrains."),
    "leaderboard": ("training.leaderboard", "play", "Make the leaderboard's figures of the shipped policies."),
    "train": ("training.train", "train", "Train a policy on this machine."),
    "refine": ("training.refine", "train", "Improve a trained policy by trying other moves."),
    "sweep": ("training.sweep", "train", "Train on many levels and seeds."),
    "study": ("study.study", "study", "Plan, freeze, open and close a study with participants."),
    "agents": (".agents.commands", "agents", "Evaluate other people's agents on instances that stay secret."),
    "simulate": ("study.simulate", "study", "Let synthetic players take part in a study."),
    "report": ("study.report", "study", "Write a study's figures with their intervals, as a page and as JSON."),
    "costs": ("study.report", "study", "Show where the players of a study lose moves."),
    "policies": ("training.policies", "hub", "List policies, show their cards, share them on the Hugging Face hub."),
    "verify": ("database", "study", "Simulate every recorded episode again and compare."),
    "release": ("bundles", "export", "Write a study as a citable, signed bundle."),
    "reproduce": ("bundles", "export", "Derive a bundle's figures again and compare."),
    "import": ("bundles", "export", "Write the episodes of a released bundle into a database."),
    "merge": ("database", "play", "Join the databases of several servers."),
    "forget": ("database", "study", "Erase a participant from a database."),
    "backup": ("database", "play", "Copy the database into one verified file while people play."),
    "restore": ("database", "play", "Put a backup in the place of the database."),
}  # fmt: skip
"""Name -> its module, relative to humanplay.cli, the extra that brings all it needs, and its line in `marsexplorer --help`. The
command NAME is the object NAME of its module; `import`, which Python keeps for itself, is `import_release`."""


def missing_extra(error: ModuleNotFoundError, words: Sequence[str]) -> str | None:
    """Return the sentence that names the extra to install, or None when no extra brings the missing module.

    words   the arguments of `marsexplorer`; the first of them that is a command decides between several extras
    """
    module = (error.name or "").split(".")[0]
    extras = [extra for extra in EXTRAS if module in EXTRAS[extra]]
    if not extras:
        return None
    command = next((word for word in words if word in COMMANDS), None)
    extra = COMMANDS[command][1] if command else "play"
    if module not in _modules(extra):
        extra = extras[0]
    what = f"marsexplorer {command}" if command else "marsexplorer"
    return f"`{what}` needs the extra [{extra}]: pip install 'humanplay[{extra}]'"


def _modules(extra: str) -> Iterator[str]:
    """Yield every module that an extra brings, those of the extras that it includes too."""
    yield from EXTRAS[extra]
    for included in INCLUDED.get(extra, ()):
        yield from _modules(included)
