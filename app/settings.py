"""The settings of a server: from the command's flags, else from MARS_* variables, else the defaults here."""

from __future__ import annotations

from ipaddress import ip_network
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict

from marsexplorer.maps import CELL_M

PACKAGE = Path(__file__).resolve().parent
ROOT = PACKAGE.parent
IS_CHECKOUT = (ROOT / "pyproject.toml").is_file()
"""Whether this package runs from a checkout of the repository; otherwise it is installed from a wheel."""

STATIC = ROOT / "static" if IS_CHECKOUT else PACKAGE / "static"
"""The files of the pages: at the root of a checkout, inside this package in a wheel."""

SHIPPED_DATA = (ROOT if IS_CHECKOUT else PACKAGE) / "data"
"""What comes with the package beside its code: `leaderboard/`, the figures of the shipped policies."""

DEFAULT_DATABASE = ROOT / "data" / "playground.db" if IS_CHECKOUT else Path("playground.db")
"""In a checkout `data/playground.db`; where the package is installed, `playground.db` in the directory it is started in."""

DEFAULT_STUDIES = DEFAULT_DATABASE.parent / "studies"


def _checked_url(url: str) -> str:
    """Return a public address without its default port and final slash; ValueError when it is none."""
    try:
        parts = urlsplit(url.strip())
        port = parts.port
    except ValueError:
        parts, port = urlsplit(""), None
    if parts.scheme not in ("http", "https") or not parts.hostname or "@" in parts.netloc or parts.query or parts.fragment:
        raise ValueError("expected the address of the pages, like https://mars.example or https://lab.example/mars")
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    rest = "" if port in (None, {"http": 80, "https": 443}[parts.scheme]) else f":{port}"
    return f"{parts.scheme}://{host}{rest}{parts.path.rstrip('/')}"


def _checked_proxy(proxy: str) -> str:
    """Return an address or a network of a proxy as text; ValueError when it is neither."""
    try:
        network = ip_network(proxy.strip(), strict=False)
    except ValueError as error:
        raise ValueError("expected an IP address or a network like 10.0.0.0/8") from error
    if network.prefixlen == 0:
        raise ValueError("expected the proxy's own address or network: with everybody named, everybody could invent addresses")
    return str(network)


class Settings(BaseSettings):
    """One server's settings, frozen; `Settings(port=0)` overrides, `MARS_PORT=9000` in the environment as well.

    host, port   where to listen; port 0 takes a free one
    database     the SQLite file; made on first start
    studies      the folder of studies; need not exist
    signers      the file of pinned signing keys of releases; None: known_signers.json in the user's configuration folder
    policies     paths of further policies to offer in addition to the shipped ones (`serve --policy PATH`)
    maps         map_server files (YAML) to offer for play (`serve --map FILE`)
    cell_m       side of their cells in metres
    public_url   where browsers find the pages, like https://mars.example; its host is served beside IP literals, localhost and
                 the machine's own names
    trusted_proxies  addresses and networks of proxies whose X-Forwarded headers count (`serve --trusted-proxy`)
    durable      True survives a power cut at a few milliseconds a step (`synchronous=FULL`)
    admin        True opens the operator's page /admin; with admin_password in the environment it is open anyway
    admin_password  of the operator, from MARS_ADMIN_PASSWORD; None: one is drawn and printed
    metrics_port  of a listener of its own that serves metrics to Prometheus; 0 takes a free one, None: there is none
    metrics_host  where that listener is; nobody but this machine reaches the default
    log_format   "text", or "json" for one object a line on stderr
    backup_every  minutes between backups that the server makes by itself; None: it makes none
    backup_to    the folder that they are kept in; None: `backups`, beside the database
    backup_keep  how many of them stay
    idle_s       seconds after which a session that nobody subscribes to or asks for leaves memory (access resumes it)
    abandon_after_s  seconds without a move after which a ranked episode on the playground counts as abandoned
    """

    model_config = SettingsConfigDict(env_prefix="MARS_", frozen=True, extra="forbid")

    host: str = "127.0.0.1"
    port: int = Field(default=8000, ge=0, le=65535)
    database: Path = DEFAULT_DATABASE
    studies: Path = DEFAULT_STUDIES
    signers: Path | None = None
    policies: tuple[Path, ...] = ()
    maps: tuple[Path, ...] = ()
    cell_m: float = Field(default=CELL_M, gt=0)
    public_url: Annotated[str, AfterValidator(_checked_url)] | None = None
    trusted_proxies: tuple[Annotated[str, AfterValidator(_checked_proxy)], ...] = ()
    durable: bool = False
    admin: bool = False
    admin_password: SecretStr | None = None
    metrics_port: int | None = Field(default=None, ge=0, le=65535)
    metrics_host: str = "127.0.0.1"
    log_format: Literal["text", "json"] = "text"
    backup_every: float | None = Field(default=None, gt=0)
    backup_to: Path | None = None
    backup_keep: int = Field(default=48, ge=1)
    idle_s: float = Field(default=600.0, gt=0)
    abandon_after_s: float = Field(default=1800.0, gt=0)
