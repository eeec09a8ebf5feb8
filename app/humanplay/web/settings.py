"""The settings of a server.

They come from the command's flags, else from HUMANPLAY_* variables, else from the defaults here.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from ipaddress import ip_network
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    JsonValue,
    SecretStr,
    ValidationError,
    ValidationInfo,
    field_validator,
)
from pydantic_settings import BaseSettings, SettingsConfigDict, SettingsError

from humanplay import IS_CHECKOUT, ROOT
from humanplay.db.file import studies_beside
from humanplay.task.registration import DEFAULT_TASK, WORLDS

PREFIX = "HUMANPLAY_"
"""With which the names of variables begin that hold a setting."""

DEFAULT_DATABASE = ROOT / "data" / "playground.db" if IS_CHECKOUT else Path("playground.db")
"""In a checkout `data/playground.db`; where the package is installed, `playground.db` in the
directory it is started in."""


def _checked_url(url: str) -> str:
    """A public address without its default port and final slash.

    Raises:
        ValueError: If it is none.
    """
    try:
        parts = urlsplit(url.strip())
        port = parts.port
    except ValueError:
        parts, port = urlsplit(""), None
    has_more = "@" in parts.netloc or parts.query or parts.fragment
    if parts.scheme not in ("http", "https") or not parts.hostname or has_more:
        raise ValueError(
            "expected the address of the pages, like https://mars.example or https://lab.example/mars"
        )
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    rest = "" if port in (None, {"http": 80, "https": 443}[parts.scheme]) else f":{port}"
    return f"{parts.scheme}://{host}{rest}{parts.path.rstrip('/')}"


def _checked_site(url: str) -> str:
    """The origin of a site.

    Raises:
        ValueError: If there is more than that, or none.
    """
    site = _checked_url(url)
    if urlsplit(site).path or re.search(r"[^\w.:/\[\]-]", site):  # it stands in a header
        raise ValueError(f"expected a site without a path, like https://survey.example, got {site}")
    return site


def _checked_proxy(proxy: str) -> str:
    """An address or a network of a proxy, as text.

    Raises:
        ValueError: If it is neither.
    """
    try:
        network = ip_network(proxy.strip(), strict=False)
    except ValueError as error:
        raise ValueError("expected an IP address or a network like 10.0.0.0/8") from error
    if network.prefixlen == 0:
        raise ValueError(
            "expected the proxy's own address or network: with everybody named, everybody could invent addresses"
        )
    return str(network)


LOOPBACK = ("127.0.0.1", "::1", "localhost")
"""Where a server listens that nobody but this machine reaches."""


def read_bucket(text: str) -> tuple[int, float]:
    """Read a text like `20+2/s`.

    Returns:
        How many may come at once, and how many a second after that.

    Raises:
        ValueError: If the text says neither.
    """
    match = re.fullmatch(r"\s*([0-9]+)\s*\+\s*([0-9]+(?:\.[0-9]+)?)\s*/\s*s\s*", text)
    burst, rate = (int(match[1]), float(match[2])) if match else (0, 0.0)
    if burst < 1 or rate <= 0:
        raise ValueError(
            f"expected BURST+RATE/s, how many at once and how many a second after that, like 20+2/s; got {text!r}"
        )
    return burst, rate


def _checked_bucket(text: str) -> str:
    read_bucket(text)
    return text


Bucket = Annotated[str, AfterValidator(_checked_bucket)]


class Limits(BaseModel):
    """What one client may ask of a server.

    `HUMANPLAY_LIMITS__MESSAGES=50+10/s` changes one of the limits.

    A bucket like 50+10/s lets 50 come at once and 10 a second after that. A classroom of 100 people
    behind one address stays below all of them.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    sockets: int = Field(default=2000, ge=1)
    """Websockets that may be open in all."""
    sockets_per_address: int = Field(default=500, ge=1)
    """Websockets that one address may have open."""
    handshakes_per_address: Bucket = "1000+10/s"
    """Websockets that one address may open; one that was closed for too much costs 100."""
    messages: Bucket = "200+100/s"
    """Messages over one websocket; beyond, they wait, and after 100 unanswered ones it is closed
    with 1008."""
    body_s: float = Field(default=60.0, gt=0)
    """Seconds within which the whole body of a request must come; beyond, 408."""
    answer_s: float = Field(default=20.0, gt=0)
    """Seconds in which a client takes what is sent to it; beyond, it is disconnected."""
    requests_per_address: Bucket = "8000+500/s"
    """HTTP requests of one address; beyond, 429. `/healthz` and `/readyz` have the same rate for
    themselves."""
    paced_per_address: Bucket = "400+100/s"
    """HTTP requests of one address, but for the files of pages; beyond, they wait."""
    joins_per_address: Bucket = "1000+1/s"
    """Joins of studies, answers and settings of one address."""
    joins_per_player: Bucket = "60+0.5/s"
    """Joins of studies, answers and settings of one cookie."""
    sessions_per_address: Bucket = "300+2/s"
    """New boards and attempts at the daily terrain of one address."""
    sessions_per_player: Bucket = "60+1/s"
    """New boards and attempts at the daily terrain of one cookie."""
    episodes_per_address: Bucket = "1200+20/s"
    """Next episodes of one address."""
    episodes_per_player: Bucket = "120+2/s"
    """Next episodes of one cookie."""
    decision_s: float = Field(default=10.0, gt=0)
    """Seconds that one decision of a policy may take; beyond, its board is paused."""
    unplayed_h: float = Field(default=24.0, gt=0)
    """Hours after which an abandoned board outside studies is deleted, or closed if something was
    done on it."""
    stored_address_percent: float = Field(default=0.5, gt=0)
    """Percent of the disk that is charged to one address on a day (UTC), but for studies. An
    episode counts the most that it can store while it is open, and then what it has stored."""
    stored_player_percent: float = Field(default=0.1, gt=0)
    """The same, of one cookie."""
    stored_study_percent: float = Field(default=5.0, gt=0)
    """The same, of one study, whose boards do not count against addresses."""
    free_mb: float = Field(default=500.0, ge=0)
    """Megabytes of free disk below which nothing is begun for anybody."""
    token: SecretStr | None = Field(default=None, min_length=16)
    """Whoever sends it in `X-Humanplay-Token`, as `humanplay simulate` does, has no limit on
    requests, joins, boards, episodes and sockets."""


class Place(BaseSettings):
    """Where a server and its files are, for commands beside it; see Settings."""

    model_config = SettingsConfigDict(
        env_prefix=PREFIX,
        env_nested_delimiter="__",
        frozen=True,
        extra="forbid",
        use_attribute_docstrings=True,
    )

    host: str = "127.0.0.1"
    """Where to listen."""
    port: int = Field(default=8000, ge=0, le=65535)
    """The port to listen on; 0 takes a free one. A socket that systemd passes on stands in for
    both."""
    public_url: Annotated[str, AfterValidator(_checked_url)] | None = None
    """Where browsers find the pages, like https://mars.example. Its host is served beside IP
    addresses, localhost and the machine's own names."""
    database: Path = DEFAULT_DATABASE
    """The SQLite file, made on the first start. Its studies lie in the folder beside it."""
    signers: Path | None = None
    """The file of pinned signing keys of releases; by default `known_signers.json` in your
    configuration folder."""


class Settings(Place):
    """One server's settings, frozen.

    `Settings(port=0)` overrides, `HUMANPLAY_PORT=9000` in the environment as well.
    """

    task: str = DEFAULT_TASK
    """What is played: `mars`, or `gymnasium:` with an id or a description as JSON (`serve --env
    ENV`)."""
    more: tuple[str, ...] = ()
    """Further tasks, each below `/play/NAME` with a database of its own beside the first one's."""
    policies: tuple[Path, ...] = ()
    """Files of further policies to offer (`serve --policy FILE`)."""
    maps: tuple[Path, ...] = ()
    """Maps of map_server (YAML) to offer (`serve --map FILE`)."""
    framed_by: Annotated[str, AfterValidator(_checked_site)] | None = None
    """One other site whose pages may show ours in a frame, like https://survey.example; by default
    none may. A link is better: see the guide on studies."""
    cell_m: float | None = Field(default=None, gt=0)
    """The side of a map's cells in metres; by default the largest that fit."""
    confined: bool = True
    """False lets environments and policies do what you may, in your folders and your network, as
    `humanplay play` does."""
    any_host: bool = False
    """True answers for every host name, as the call `play` does in a notebook of a JupyterHub, which
    does not tell its own. A server refuses it that is confined, listens for others than this machine
    or has a public URL."""
    asks_name: bool = False
    """True asks whoever comes for a name before the first episode, as the call `play` does."""
    trusted_proxies: tuple[Annotated[str, AfterValidator(_checked_proxy)], ...] = ()
    """Addresses and networks of proxies whose X-Forwarded headers count (`serve --trusted-proxy`)."""
    durable: bool = False
    """True survives a power cut, at a few milliseconds a move (`synchronous=FULL`)."""
    admin: bool = False
    """True opens the operator's page `/admin`; with a password in the environment it is open
    anyway."""
    admin_password: SecretStr | None = None
    """The operator's password, which opens `/admin`, at least 8 characters. With `HUMANPLAY_ADMIN`
    and no password one is drawn and printed."""
    metrics_port: int | None = Field(default=None, ge=0, le=65535)
    """A port of its own that serves metrics to Prometheus; 0 takes a free one. By default there is
    none."""
    metrics_host: str = "127.0.0.1"
    """Where that port listens; by default nobody but this machine reaches it."""
    log_format: Literal["text", "json"] = "text"
    """`text`, or `json` for one object a line on stderr."""
    accept_loss: bool = False
    """True starts although commits that were acknowledged are missing, or may be."""
    backup_every: float | None = Field(default=None, gt=0)
    """Minutes between backups that the server makes by itself; by default it makes none."""
    backup_to: Path | None = None
    """The folder of those backups; by default `backups` beside the database."""
    idle_s: float = Field(default=600.0, gt=0)
    """Seconds after which a session that nobody looks at leaves memory; the next access resumes
    it."""
    abandon_after_s: float = Field(default=1800.0, gt=0)
    """Seconds without a move after which a ranked episode on the playground counts as abandoned."""
    limits: Limits = Limits()
    """What one client may ask of the server."""

    @field_validator("any_host")
    @classmethod
    def _check_any_host(cls, any_host: bool, info: ValidationInfo) -> bool:
        settings = info.data
        is_open = not settings.get("confined", True) and settings.get("public_url") is None
        if any_host and not (is_open and settings.get("host") in LOOPBACK):
            raise ValueError(
                "expected false, unless confined is false, host is this machine and there is no public_url"
            )
        return any_host

    @property
    def backups(self) -> Path:
        """The folder of the backups."""
        return self.backup_to or self.database.with_name("backups")

    @property
    def studies(self) -> Path:
        """The folder of the studies; it need not exist."""
        return studies_beside(self.database)


_EXPECTED = {
    "bool_parsing": "true or false",
    "extra_forbidden": "no setting of this name",
    "float_parsing": "a number",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "int_parsing": "a whole number",
    "less_than_equal": "{le:g} or less",
    "literal_error": "{expected}",
    "model_type": "a JSON object of limits",
    "too_short": "at least {min_length} characters",
}
"""What was expected, by the type of pydantic's error."""


def fault_of(error: ValidationError | SettingsError, flags: Mapping[str, JsonValue]) -> str:
    """Describe the first wrong setting: its name, what was expected, and the way out."""
    if isinstance(error, SettingsError):
        field = re.search(r'"(.+?)"', str(error))
        name = f"{PREFIX}{field[1].upper()}" if field else "a setting"
        return f'{name}: expected JSON, such as ["127.0.0.1"]: correct it or unset it'
    first = error.errors()[0]
    path = [str(part) for part in first["loc"]]
    expected = _EXPECTED.get(first["type"], first["msg"].removeprefix("Value error, expected "))
    sentence = f"expected {expected.format_map(first.get('ctx', {}))}"
    # a password or a token is not printed
    if path[-1] not in ("token", "admin_password") and "; got " not in sentence:
        sentence += f", got {first['input']!r}"
    if path[0] in flags:
        return f"setting {path[0]}: {sentence}"
    variable = PREFIX + "__".join(path[:2] if path[0] == "limits" else path[:1]).upper()
    return f"{variable}: {sentence}: correct it or unset it"


def unknown_variables(names: Iterable[str]) -> Iterator[str]:
    """Yield a note on each variable that is named like a setting and is none."""
    variables = [WORLDS, *(PREFIX + name.upper() for name in Settings.model_fields)]
    for name in sorted(names):
        # a wrong name of a limit is an error of `Settings`
        if name.startswith(f"{PREFIX}LIMITS__") or not name.startswith(PREFIX):
            continue
        if name not in variables:
            near = difflib.get_close_matches(name, variables, n=1)
            question = f"; did you mean {near[0]}?" if near else ""
            yield f"the variable {name} is no setting and is ignored{question}"
