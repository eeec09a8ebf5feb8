"""An environment as a researcher describes it, by an id or a TOML file.

What the description leaves open comes from the catalogue, or from the environment itself.
"""

from __future__ import annotations

import inspect
import json
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from importlib.metadata import entry_points
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import gymnasium
from gymnasium.envs.registration import EnvSpec, load_env_creator
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from humanplay.board.messages import KEY_CODES
from humanplay.jobs import held
from humanplay.tasks.gymnasium.codes import ActionCodes
from humanplay.tasks.gymnasium.kinds import refusal_of
from humanplay.tasks.gymnasium.modules import imported, module_of_file, owners_of, source_hash
from humanplay.tasks.gymnasium.values import two_of

DEFAULT_LIMIT = 1000
"""Moves after which an episode times out if nothing else sets a limit."""
MAX_LIMIT = 100_000
SPECIAL = {
    32: "Space", 273: "ArrowUp", 274: "ArrowDown", 275: "ArrowRight", 276: "ArrowLeft", 1073741906: "ArrowUp",
    1073741905: "ArrowDown", 1073741903: "ArrowRight", 1073741904: "ArrowLeft",
}  # fmt: skip
"""pygame's codes (before and since 2.0) of the keys that print no letter."""
PACKAGES = {
    "gymnasium.envs.box2d": "Box2D", "gymnasium.envs.mujoco": "mujoco", "humanplay.tasks.gymnasium.adapters:Crafter": "crafter",
}  # fmt: skip
"""Beginnings of entry points -> the package whose code an environment is, where another one brings it."""
IN_PLACE = "inplace"
"""What stands before the colon in the id of an environment that the program which holds it steps itself."""
RECORDED = "recorded 1"
"""What the episodes of such an environment replay with: their recordings."""
PRINTED = "printed in preregistration, report and datasheet"


class Description(BaseModel):
    """An environment as people play it; only `id` is required.

    A success is `return > NUMBER`, `return >= NUMBER` or `info.NAME` (true in the last step's info).
    Without such a rule nothing is guessed: an episode that ends by itself has ended, no more.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    id: str = Field(
        pattern=r"^(\w[\w.]*:)?[\w./-]{1,100}$",
        description="Gymnasium's id, before a colon the module that registers it; or MODULE:NAME of a class or function",
    )
    kwargs: dict[str, Any] = Field({}, description="what gymnasium.make is given besides")
    options: dict[str, Any] = Field({}, description="what reset is given as options")
    wrappers: tuple[str, ...] = Field(
        (), description='put around it, the innermost first: "module:Class", called with the environment alone'
    )  # fmt: skip
    title: str = Field("", max_length=100, description="what pages call it; else a part of the id")
    instructions: str = Field("", max_length=2000, description="what players are told to do")
    actions: tuple[str, ...] = Field((), description="names of the actions, by their codes")
    keys: dict[str, str | int] = Field(
        {}, description="event.code -> an action's name or code, with a clock also KeyA+KeyD; "
        "an action without a key cannot be chosen"
    )  # fmt: skip
    clock: Literal["turns"] | Annotated[int, Field(ge=1, le=60)] = Field(
        "turns", description="frames a second; turns: each move is waited for"
    )
    noop: str = Field("", description="the action of no key; else noop, else the last one again")
    max_steps: int | None = Field(None, gt=0, le=MAX_LIMIT, description="moves until it times out")
    success: str = Field(
        "", pattern=r"^(return >=? -?\d+(\.\d+)?|info\.\w+)?$", description="which ending is a success"
    )  # fmt: skip
    score: str = Field(
        "return", pattern=r"^(return|info\.\w+)$", description="the headline metric: the return, or the last info.NAME"
    )  # fmt: skip
    bounds: tuple[float | None, float | None] = Field(
        (None, None), description="the lowest and the highest score that there can be, where they are known"
    )  # fmt: skip
    seeding: Literal["reset", "kwarg"] = Field(
        "reset", description="kwarg: it is made with seed= and ignores the seed of reset"
    )
    memory_mb: int = Field(512, ge=16, le=2**20, description="MB that a board may take by itself")
    codec: Literal["png", "jpeg"] = Field("png", description="jpeg: smaller, with loss")
    people_see: str = Field("", max_length=200, description=f"what the picture shows; {PRINTED}")
    agents_see: str = Field("", max_length=200, description=f"what agents observe; {PRINTED}")

    @field_validator("actions")
    @classmethod
    def _are_names(cls, actions: tuple[str, ...]) -> tuple[str, ...]:
        if bad := [name for name in actions if not re.fullmatch(r"\w{1,40}", name)]:
            raise ValueError(f"expected names of letters, digits and _, got {bad[0]!r}")
        if len(set(actions)) < len(actions):
            raise ValueError("expected names that differ")
        return actions

    @field_validator("keys")
    @classmethod
    def _are_codes(cls, keys: dict[str, str | int]) -> dict[str, str | int]:
        if bad := [code for code in keys if not KEY_CODES.issuperset(code.split("+"))]:
            raise ValueError(
                "expected codes like ArrowUp, KeyA, Digit1 or Space (KeyboardEvent.code), "
                f"got {bad[0]!r}"
            )
        return keys

    @property
    def told(self) -> str:
        """The description in the name of a task: the id, or the fields as canonical JSON."""
        fields = self.model_dump(mode="json", exclude_unset=True)
        return self.id if fields == {"id": self.id} else canonical(fields)

    @property
    def is_in_place(self) -> bool:
        """Whether the program that holds it steps it, so that nothing makes it again."""
        return self.id.startswith(f"{IN_PLACE}:")

    @property
    def has_no_module(self) -> bool:
        """Whether no module makes it, so that another program cannot make it again."""
        return self.is_in_place or self.id.startswith(f"{held.SCHEME}:")

    def begin(self, env: Any, seed: int) -> tuple[Any, dict[str, Any]]:
        """Reset an environment; return its observation and its info."""
        options = {"options": self.options} if self.options else {}
        return two_of(env.reset(seed=seed, **options))

    def make(self, kwargs: Mapping[str, Any], limit: int, seed: int | None = None) -> Any:
        """A new environment.

        Raises:
            ValueError: If something it needs is not installed, or it refuses its arguments.
        """
        # without them pygame looks for a screen and for sound
        for driver in ("SDL_VIDEODRIVER", "SDL_AUDIODRIVER"):
            os.environ.setdefault(driver, "dummy")
        arguments = {**kwargs, **({"seed": seed} if self.seeding == "kwarg" else {})}
        spec = spec_of(self.id)
        try:
            if _takes(_creator_of(spec), "render_mode"):
                arguments["render_mode"] = self.render_mode
            env = gymnasium.make(spec, limit, True, **arguments)
            for wrapper in self.wrappers:
                module, _, name = wrapper.partition(":")
                env = getattr(imported(module), name)(env)
        except (gymnasium.error.Error, TypeError, ImportError, AttributeError) as error:
            # gymnasium's error of a wrong type does not say which type it is
            reason = _refusal_of_made(spec, arguments) if isinstance(error, TypeError) else ""
            raise ValueError(f"{self.id} cannot be made: {reason or error}") from error
        if env.render_mode not in RENDER_MODES:
            env.close()
            raise ValueError(
                f"{self.id} takes no render_mode and makes its environment with render_mode={env.render_mode!r}: "
                "let it make the environment with render_mode='rgb_array'"
            )
        return env

    @property
    def render_mode(self) -> str:
        """How it is shown: `rgb_array`, else `ansi`; ValueError if it draws neither."""
        creator = _creator_of(spec_of(self.id))
        modes = getattr(creator, "metadata", {}).get("render_modes", ["rgb_array"])
        for mode in RENDER_MODES:
            if mode in modes:
                return mode
        raise ValueError(
            f"{self.id} draws no picture (rgb_array) and no text (ansi), only {', '.join(modes) or 'nothing'}: "
            "name a wrapper that does"
        )

    @property
    def versions(self) -> str:
        """What an episode replays with: versions of packages, hashes of your own modules."""
        if self.is_in_place:
            return RECORDED
        sources = [f"{name} {hash[:12]}" for name, hash in self.sources.items()]
        return ", ".join([*(f"{name} {version_of(name)}" for name in self.packages), *sources])

    @property
    def packages(self) -> list[str]:
        """Gymnasium, NumPy and the packages of the environment and its wrappers."""
        entry, *modules = self._modules
        owned = [package for start, package in PACKAGES.items() if entry.startswith(start)]
        tops = [re.split("[.:]", module)[0] for module in (entry, *modules)]
        owners = (owner for top in tops for owner in owners_of(top))
        return sorted({"gymnasium", "numpy", *owned, *owners})

    @property
    def sources(self) -> dict[str, str]:
        """Top-level module without a package -> SHA-256 (hex) of its source."""
        tops = sorted({re.split("[.:]", module)[0] for module in self._modules})
        return {top: hash for top in tops if (hash := source_hash(top))}

    @property
    def _modules(self) -> list[str]:
        """Where the code of the environment is, then that of its wrappers."""
        entry = spec_of(self.id).entry_point
        module = entry if isinstance(entry, str) else getattr(entry, "__module__", "")
        return [module, *self.wrappers]


RENDER_MODES = ("rgb_array", "ansi")
CATALOGUE = tomllib.loads(Path(__file__).with_name("catalogue.toml").read_text("utf-8"))


def canonical(value: Any) -> str:
    """Return JSON that is the same for equal values."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def spec_of(env_id: str) -> EnvSpec:
    """Gymnasium's own description of an environment: a registered one, or MODULE:NAME.

    Raises:
        ValueError: If there is none; the text says how to name one.
    """
    module_name, _, name = env_id.rpartition(":")
    if module_name == held.SCHEME:
        return EnvSpec(name, held.function_of(name))
    if module_name == IN_PLACE:
        raise ValueError(
            f"{name} was stepped in place by the program that held it, and nothing makes it again: move what makes it "
            "into a module, which is found by its name"
        )
    if not module_name:
        try:
            return _named(gymnasium.spec(name))
        except (gymnasium.error.Error, ImportError) as error:
            raise ValueError(
                f"Gymnasium knows no environment {env_id!r}: {error}; where a package or a file of yours brings it, "
                "write the module's name before it, like minigrid:ID or mymodule:MyEnv"
            ) from error
    try:
        module = imported(module_name)
    except ModuleNotFoundError as error:
        raise ValueError(_absent(env_id, module_name, error)) from error
    except ImportError as error:
        raise ValueError(f"{module_name} cannot be imported: {error}") from error
    if name in gymnasium.registry:
        return _named(gymnasium.spec(name))
    member = getattr(module, name, None)
    if (isinstance(member, type) and issubclass(member, gymnasium.Env)) or inspect.isfunction(
        member
    ):
        return EnvSpec(name, f"{module_name}:{name}")
    if isinstance(member, type) and (reason := refusal_of(member)):
        raise ValueError(reason)
    try:
        return gymnasium.spec(name)  # it may be there under another version, which its error names
    except (gymnasium.error.Error, ImportError) as error:
        raise ValueError(
            f"{module_name} registers no environment {name!r} and has no class of gymnasium.Env or function "
            f"of that name: {error}"
        ) from error


def _named(spec: EnvSpec) -> EnvSpec:
    """Name the class or function that makes an environment, so that JSON can hold it."""
    entry = spec.entry_point
    name = getattr(entry, "__qualname__", "")
    if isinstance(entry, str) or not name.isidentifier():
        return spec
    return replace(spec, entry_point=f"{getattr(entry, '__module__', '')}:{name}")


def _absent(env_id: str, module_name: str, error: ModuleNotFoundError) -> str:
    """Say which module is missing, and where it was looked for."""
    top = module_name.partition(".")[0]
    if error.name is None or error.name.partition(".")[0] != top:
        return f"{module_name} needs a module that is not installed: {error.name}"
    return (
        f"{env_id}: there is no module {top!r} in this folder, nor is it installed. If it is a file of yours, run the "
        "command in its folder or name the file; if it comes with a package, install that package first"
    )


def _creator_of(spec: EnvSpec) -> Callable[..., object]:
    """The class or function that makes an environment."""
    entry = spec.entry_point
    creator = load_env_creator(entry) if isinstance(entry, str) else entry
    if not callable(creator):
        raise ValueError(f"{spec.id} must be made by a class or a function, got {creator!r}")
    return creator


def _refusal_of_made(spec: EnvSpec, arguments: Mapping[str, object]) -> str:
    """Why what a function makes is no environment of Gymnasium's; empty if unknown."""
    with suppress(Exception):  # whatever it raises
        env = _creator_of(spec)(**{**spec.kwargs, **arguments})
        if callable(close := getattr(env, "close", None)):
            with suppress(Exception):
                close()  # or its processes would outlive the refusal
        return refusal_of(type(env))
    return ""


def _takes(creator: Callable[..., object], name: str) -> bool:
    """Whether a class or function takes an argument of a name."""
    try:
        parameters = inspect.signature(creator).parameters.values()
    except (TypeError, ValueError):  # of what is compiled nothing is known
        return True
    return any(it.name == name or it.kind is it.VAR_KEYWORD for it in parameters)


@lru_cache(maxsize=64)
def described(text: str) -> Description:
    """The description of an id or a JSON text, without the catalogue's fields.

    Raises:
        ValueError: If it is none.
    """
    fields = json.loads(text) if text.startswith("{") else {"id": text}
    try:
        return Description.model_validate(fields)
    except ValidationError as error:
        raise ValueError(_first(error)) from error


def completed(description: Description) -> Description:
    """A description with the catalogue's fields where it says nothing."""
    fields: dict[str, Any] = {}
    # the shortest beginning first: a longer one says more of the environment
    for beginning, catalogued in sorted(CATALOGUE["known"].items()):
        if description.id.startswith(beginning):
            fields |= catalogued
    # arguments and wrappers may change what is seen, and wrappers the reward
    if description.kwargs or description.wrappers:
        fields = {name: text for name, text in fields.items() if not name.endswith("_see")}
    if description.wrappers:
        fields.pop("bounds", None)
    if {"actions", "keys"} & description.model_fields_set:
        fields.pop("keys", None)
    return Description.model_validate({**fields, **description.model_dump(exclude_unset=True)})


def description_of(env: str) -> str:
    """The id or the description, as JSON, of an environment that somebody names.

    Args:
        env: An id, a TOML or Python file, or a name under which a package offers a dictionary of
            the fields, by the entry-point group `humanplay.tasks`.

    Raises:
        ValueError: If the description is wrong.
        OSError: If a file cannot be read.
    """
    if env.endswith(".toml"):
        return read_description(Path(env)).told
    path, _, name = env.partition(":")
    if path.endswith(".py"):
        module_name = module_of_file(Path(path))
        return f"{module_name}:{name or _only_environment(module_name, path)}"
    for offer in entry_points(group="humanplay.tasks", name=env):
        try:
            return Description.model_validate(offer.load()).told
        except ValidationError as error:
            raise ValueError(f"{env}, which {offer.value} describes: {_first(error)}") from error
    return env


def _only_environment(module_name: str, path: str) -> str:
    """The name of a file's one environment; ValueError if it defines none or several."""
    try:
        members = vars(imported(module_name))
    except ImportError as error:
        raise ValueError(f"{path} cannot be imported: {error}") from error
    names = [
        name
        for name, member in members.items()
        if isinstance(member, type)
        and issubclass(member, gymnasium.Env)
        and member.__module__ == module_name
    ]
    if len(names) != 1:
        there = ", ".join(names) or "none"
        raise ValueError(
            f"expected one class of gymnasium.Env in {path}, found {there}: write {path}:NAME"
        )
    return names[0]


def read_description(path: Path) -> Description:
    """The description in a TOML file.

    Raises:
        ValueError: If something in it is wrong; the text names the line.
        OSError: If it cannot be read.
    """
    text = path.read_text("utf-8")
    try:
        return Description.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: {error}") from error
    except ValidationError as error:
        field = str(error.errors()[0]["loc"][0]) if error.errors()[0]["loc"] else ""
        match = re.search(rf"^\[?{field}\b", text, re.M) if field else None
        line = f", line {text.count(chr(10), 0, match.start()) + 1}" if match else ""
        raise ValueError(f"{path}{line}: {_first(error)}") from error


def _first(error: ValidationError) -> str:
    first = error.errors()[0]
    field = ".".join(map(str, first["loc"]))
    if first["type"] == "extra_forbidden":
        return f"there is no field {field!r}; the fields are {', '.join(Description.model_fields)}"
    message = f"{field}: {first['msg'].removeprefix('Value error, ')}"
    return message if first["type"] == "missing" else f"{message}, got {first['input']!r}"


def actions_of(description: Description, env: Any) -> tuple[str, ...]:
    """The names of an environment's actions, by their codes.

    They come from the description, else from `get_action_meanings` or an enumeration `actions`, else
    from the numbers of the environment's own actions.

    Raises:
        ValueError: If the actions are not discrete.
    """
    inner, codes = env.unwrapped, ActionCodes(description.id, env.action_space)
    count = codes.count
    named: Iterable[Any] = description.actions
    if not description.actions:
        meanings = getattr(inner, "get_action_meanings", None)
        named = meanings() if meanings is not None else getattr(inner, "actions", ())
    try:
        names = [re.sub(r"\W+", "_", str(getattr(name, "name", name))).lower() for name in named]
    except TypeError:
        names = []
    if description.actions and len(names) != count:
        raise ValueError(f"actions: {description.id} has {count}, got {len(names)} names")
    return tuple(names) if len(set(names)) == len(names) == count else codes.names()


def keys_of(
    description: Description, env: Any, names: tuple[str, ...]
) -> dict[str, tuple[str, ...]]:
    """Action -> its keys (`event.code`); none for an action that cannot be chosen.

    They come from the description. Else they follow from the words of the names, then from
    `get_keys_to_action`; the rest are digits and letters.

    Raises:
        ValueError: If no action has a key, or the description names an unknown action.
    """
    keys: dict[str, list[str]] = {name: [] for name in names}
    for code, action in description.keys.items():
        is_code = isinstance(action, int) and 0 <= action < len(names)
        name = names[cast("int", action)] if is_code else str(action)
        if name not in keys:
            raise ValueError(
                f"keys: {code} = {action!r} is no action of {description.id}: {', '.join(names)}"
            )
        keys[name].append(code)
    if not description.keys:
        _add_keys(keys, env)
    if not any(keys.values()):
        raise ValueError(
            f"no key is known for the {len(names)} actions of {description.id}; name them in its file, such as "
            "keys = { ArrowLeft = 0, ArrowRight = 1 }"
        )
    return {name: tuple(codes) for name, codes in keys.items()}


def _add_keys(keys: dict[str, list[str]], env: Any) -> None:
    """Add keys to actions without a key, each key to one action."""
    taken = set[str]()

    def take(name: str, codes: Iterable[str]) -> None:
        keys[name] = [code for code in codes if code not in taken]
        taken.update(keys[name])

    # 1. by a whole word of the name, or by a part of one
    key_words = {
        word: codes for words, codes in CATALOGUE["words"].items() for word in words.split()
    }
    for name in keys:
        whole = [codes for word, codes in key_words.items() if word in name.split("_")]
        parts = [codes for word, codes in key_words.items() if word in name and len(word) > 2]
        take(name, next(iter(whole + parts), ()))
    # 2. as the environment has them
    names = list(keys)
    for code, action in _own_keys(env.unwrapped):
        if action < len(names) and not keys[names[action]] and code not in taken:
            take(names[action], [code])
    # 3. a digit or a letter: its own digit for an action that is called by one
    free = [f"Digit{digit}" for digit in "1234567890"]
    free += [f"Key{letter}" for letter in "QERTYUFGHJKLZXCVBM"]
    for name in names if len(names) <= len(free) else ():
        if not keys[name]:
            digit = [f"Digit{name}"] if name in {*"0123456789"} else []
            codes = [code for code in (*digit, *free) if code not in taken and code in KEY_CODES]
            take(name, codes[:1])


def _own_keys(inner: Any) -> list[tuple[str, int]]:
    """The single keys of `get_keys_to_action`, as (`event.code`, action)."""
    own_keys = []
    for keys, action in getattr(inner, "get_keys_to_action", dict)().items():
        held = [keys] if isinstance(keys, str | int) else list(keys)
        if len(held) == 1 and isinstance(action, int):
            key = ord(held[0]) if isinstance(held[0], str) and len(held[0]) == 1 else held[0]
            letter = chr(key).upper() if isinstance(key, int) and key < 128 else ""
            plain = f"Key{letter}" if letter.isalpha() else f"Digit{letter}"
            code = SPECIAL.get(cast("int", key), plain)
            if code in KEY_CODES:
                own_keys.append((code, action))
    return own_keys
