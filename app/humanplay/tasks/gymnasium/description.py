"""What a researcher says of an environment: an id, or a TOML file; and what is known or derived where it says nothing."""

from __future__ import annotations

import inspect
import json
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
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
from humanplay.tasks.gymnasium.modules import imported, module_of_file, owners_of, source_hash
from humanplay.tasks.gymnasium.values import two_of

DEFAULT_LIMIT = 1000
"""Moves after which an episode times out where neither the environment nor its description sets a limit."""
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
    """An environment as people are to play it; nothing but `id` is needed.

    Rules: a success is `return > NUMBER`, `return >= NUMBER` or `info.NAME` (true in the last step's info). Without one nothing
    is guessed: an episode that ends by itself has ended, no more.
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
    def _are_names(cls, given: tuple[str, ...]) -> tuple[str, ...]:
        if bad := [name for name in given if not re.fullmatch(r"\w{1,40}", name)]:
            raise ValueError(f"expected names of letters, digits and _, got {bad[0]!r}")
        if len(set(given)) < len(given):
            raise ValueError("expected names that differ")
        return given

    @field_validator("keys")
    @classmethod
    def _are_codes(cls, given: dict[str, str | int]) -> dict[str, str | int]:
        if bad := [code for code in given if not KEY_CODES.issuperset(code.split("+"))]:
            expected = "codes like ArrowUp, KeyA, Digit1 or Space (KeyboardEvent.code)"
            raise ValueError(f"expected {expected}, got {bad[0]!r}")
        return given

    @property
    def told(self) -> str:
        """What describes it in the name of a task: the id alone, or canonical JSON of what was said."""
        said = self.model_dump(mode="json", exclude_unset=True)
        return self.id if said == {"id": self.id} else canonical(said)

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
        """Return a new environment; ValueError where something it needs is not installed or it refuses its arguments."""
        for driver in ("SDL_VIDEODRIVER", "SDL_AUDIODRIVER"):
            os.environ.setdefault(driver, "dummy")  # pygame would look for a screen and for sound
        given = {**kwargs, **({"seed": seed} if self.seeding == "kwarg" else {})}
        try:
            spec = spec_of(self.id)
            if _takes(_creator_of(spec), "render_mode"):
                given["render_mode"] = self.render_mode
            env = gymnasium.make(spec, limit, True, **given)
            for wrapper in self.wrappers:
                module, _, name = wrapper.partition(":")
                env = getattr(imported(module), name)(env)
        except (gymnasium.error.Error, TypeError, ImportError, AttributeError) as error:
            raise ValueError(f"{self.id} cannot be made: {error}") from error
        if env.render_mode not in RENDER_MODES:
            env.close()
            raise ValueError(
                f"{self.id} takes no render_mode and makes its environment with render_mode={env.render_mode!r}: "
                "let it make the environment with render_mode='rgb_array'"
            )
        return env

    @property
    def render_mode(self) -> str:
        """How it is shown: `rgb_array`, else `ansi`; ValueError where it draws neither."""
        creator = _creator_of(spec_of(self.id))
        modes = getattr(creator, "metadata", {}).get("render_modes", ["rgb_array"])
        for mode in RENDER_MODES:
            if mode in modes:
                return mode
        said = f"no picture (rgb_array) and no text (ansi), only {', '.join(modes) or 'nothing'}"
        raise ValueError(f"{self.id} draws {said}: name a wrapper that does")

    @property
    def versions(self) -> str:
        """What an episode replays with: the versions of its packages, the hashes of modules of one's own."""
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
        """Top-level module that no package brings -> SHA-256 (hex) of its source."""
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
    """Return Gymnasium's description of an environment that is registered, or named as MODULE:NAME.

    Raises:
        ValueError: There is none; the text says what was looked for and the way out.
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
    try:
        return gymnasium.spec(name)  # it may be there under another version, which its error names
    except (gymnasium.error.Error, ImportError) as error:
        raise ValueError(
            f"{module_name} registers no environment {name!r} and has no class of gymnasium.Env or function "
            f"of that name: {error}"
        ) from error


def _named(spec: EnvSpec) -> EnvSpec:
    """Name a class or function that was registered itself, so that the description can be written down."""
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
    """Return the class or function that makes an environment."""
    entry = spec.entry_point
    creator = load_env_creator(entry) if isinstance(entry, str) else entry
    if not callable(creator):
        raise ValueError(f"{spec.id} must be made by a class or a function, got {creator!r}")
    return creator


def _takes(creator: Callable[..., object], name: str) -> bool:
    """Whether something that is called takes an argument of a name."""
    try:
        parameters = inspect.signature(creator).parameters.values()
    except (TypeError, ValueError):  # of what is compiled nothing is known
        return True
    return any(it.name == name or it.kind is it.VAR_KEYWORD for it in parameters)


@lru_cache(maxsize=64)
def described(told: str) -> Description:
    """Return a description as it was told, without what the catalogue knows; ValueError where it is none."""
    said = json.loads(told) if told.startswith("{") else {"id": told}
    try:
        return Description.model_validate(said)
    except ValidationError as error:
        raise ValueError(_first(error)) from error


def completed(given: Description) -> Description:
    """Return a description with what the catalogue knows of its environment where it says nothing."""
    known: dict[str, Any] = {}
    for beginning, fields in sorted(CATALOGUE["known"].items()):  # the shortest first
        known |= fields if given.id.startswith(beginning) else {}
    if given.kwargs or given.wrappers:  # they may change what is seen
        known = {name: value for name, value in known.items() if not name.endswith("_see")}
    if given.wrappers:  # or the reward
        known.pop("bounds", None)
    if "actions" in given.model_fields_set or "keys" in given.model_fields_set:
        known = {name: value for name, value in known.items() if name != "keys"}
    return Description.model_validate({**known, **given.model_dump(exclude_unset=True)})


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
    """Return the name of the environment that a file defines; ValueError unless there is exactly one."""
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
    """Return the description in a TOML file; ValueError with the line of what is wrong, OSError where it cannot be read."""
    text = path.read_text("utf-8")
    try:
        return Description.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: {error}") from error
    except ValidationError as error:
        field = str(error.errors()[0]["loc"][0]) if error.errors()[0]["loc"] else ""
        found = re.search(rf"^\[?{field}\b", text, re.M) if field else None
        where = f"{path}, line {text.count(chr(10), 0, found.start()) + 1}" if found else path
        raise ValueError(f"{where}: {_first(error)}") from error


def _first(error: ValidationError) -> str:
    first = error.errors()[0]
    field = ".".join(map(str, first["loc"]))
    if first["type"] == "extra_forbidden":
        return f"there is no field {field!r}; the fields are {', '.join(Description.model_fields)}"
    said = first["msg"].removeprefix("Value error, ")
    return f"{field}: {said}" + ("" if first["type"] == "missing" else f", got {first['input']!r}")


def actions_of(described: Description, env: Any) -> tuple[str, ...]:
    """Return the names of the actions of an environment, by their codes; ValueError where they are not discrete.

    They come from the description, else from `get_action_meanings` or an enumeration `actions`, else from the numbers of
    the environment's own actions.
    """
    inner, codes = env.unwrapped, ActionCodes(described.id, env.action_space)
    count = codes.count
    named: Iterable[Any] = described.actions
    if not described.actions:
        meanings = getattr(inner, "get_action_meanings", None)
        named = meanings() if meanings is not None else getattr(inner, "actions", ())
    try:
        names = [re.sub(r"\W+", "_", str(getattr(each, "name", each))).lower() for each in named]
    except TypeError:
        names = []
    if described.actions and len(names) != count:
        raise ValueError(f"actions: {described.id} has {count}, got {len(names)} names")
    return tuple(names) if len(set(names)) == len(names) == count else codes.names()


def keys_of(described: Description, env: Any, names: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Return the keys (`event.code`) of each action, none for one that cannot be chosen; ValueError where no action has one.

    They come from the description, else from `get_keys_to_action`, else from the words of the names, else they are digits.
    """
    found: dict[str, list[str]] = {name: [] for name in names}
    for code, wanted in described.keys.items():
        is_code = isinstance(wanted, int) and 0 <= wanted < len(names)
        name = names[cast("int", wanted)] if is_code else str(wanted)
        if name not in found:
            said = f"keys: {code} = {wanted!r} is no action of {described.id}"
            raise ValueError(f"{said}: {', '.join(names)}")
        found[name].append(code)
    if not described.keys:
        words = {each: codes for said, codes in CATALOGUE["words"].items() for each in said.split()}
        taken = set[str]()
        for name in names:
            whole = [codes for word, codes in words.items() if word in name.split("_")]
            parts = [codes for word, codes in words.items() if word in name and len(word) > 2]
            fits = next(iter(whole + parts), ())
            found[name] = [code for code in fits if code not in taken]
            taken.update(found[name])
        for code, action in _own_keys(env.unwrapped):
            if action < len(names) and not found[names[action]] and code not in taken:
                found[names[action]].append(code)
                taken.add(code)
        free = [f"Digit{each}" for each in "1234567890"]
        free += [f"Key{letter}" for letter in "QERTYUFGHJKLZXCVBM"]
        for name in names if len(names) <= len(free) else ():
            if not found[name]:
                own = [f"Digit{name}"] if name in {*"0123456789"} else []
                codes = [each for each in (*own, *free) if each not in taken and each in KEY_CODES]
                found[name] = codes[:1]
                taken.update(found[name])
    if not any(found.values()):
        raise ValueError(
            f"no key is known for the {len(names)} actions of {described.id}; name them in its file, such as "
            "keys = { ArrowLeft = 0, ArrowRight = 1 }"
        )
    return {name: tuple(codes) for name, codes in found.items()}


def _own_keys(inner: Any) -> list[tuple[str, int]]:
    """Return the single keys of `get_keys_to_action`, as codes of browsers."""
    found = []
    for keys, action in getattr(inner, "get_keys_to_action", dict)().items():
        held = [keys] if isinstance(keys, str | int) else list(keys)
        if len(held) == 1 and isinstance(action, int):
            key = ord(held[0]) if isinstance(held[0], str) and len(held[0]) == 1 else held[0]
            letter = chr(key).upper() if isinstance(key, int) and key < 128 else ""
            plain = f"Key{letter}" if letter.isalpha() else f"Digit{letter}"
            code = SPECIAL.get(cast("int", key), plain)
            if code in KEY_CODES:
                found.append((code, action))
    return found
