"""The links to a pilot's page, in a notebook, below a proxy, over ssh, or local."""

from __future__ import annotations

import getpass
import json
import os
import socket
import sys
import webbrowser
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from threading import Thread
from urllib.parse import urlsplit

from humanplay.cli.pilot.errors import PilotError

ANY_HOST, LOCAL_HOST = ("0.0.0.0", "::"), "127.0.0.1"
"""What a server listens on for all addresses of this machine, and for itself alone."""
COLAB = (
    "the proxy of Colab passes no WebSockets on, over which the page plays: download the notebook and what it trained, "
    "`pip install humanplay jupyterlab` on your machine, and run it there"
)


def check_place() -> None:
    """Raise PilotError where no browser could reach the page."""
    if "google.colab" in sys.modules:
        raise PilotError(COLAB)


def in_notebook() -> bool:
    """Whether this program is a notebook's kernel, whose cells show what they display."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


def is_in_hub() -> bool:
    """Whether browsers come through a JupyterHub, by a name that is not known here."""
    return "JUPYTERHUB_SERVICE_PREFIX" in os.environ and _has_proxy()


def _has_proxy() -> bool:
    """Whether a notebook's own server passes on what other ports answer."""
    return in_notebook() and find_spec("jupyter_server_proxy") is not None


def with_host(address: str, host: str) -> str:
    """The address of a page by another name of the machine."""
    return f"http://{host}:{urlsplit(address).port}"


def shared_address(address: str) -> str:
    """The address by which other machines open a page that listens on all addresses."""
    if urlsplit(address).hostname not in ANY_HOST:
        return address
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(
                ("192.0.2.1", 9)
            )  # nothing is sent: the system only chooses its own address
            host = probe.getsockname()[0]
        except OSError:
            host = LOCAL_HOST
    return with_host(address, host)


def local_address(address: str) -> str:
    """The address by which this machine opens a page."""
    return with_host(address, LOCAL_HOST) if urlsplit(address).hostname in ANY_HOST else address


def forwarding(address: str) -> str:
    """The command that brings a page to where ssh came from; empty if none is needed."""
    connection = os.environ.get("SSH_CONNECTION", "").split()
    if len(connection) != 4:
        return ""
    from humanplay.web.protection.hosts import is_loopback

    parts = urlsplit(address)
    if not is_loopback(parts.hostname or ""):
        return ""
    return f"ssh -N -L {parts.port}:127.0.0.1:{parts.port} {getpass.getuser()}@{connection[2]}"


def proxied(address: str) -> str:
    """The page's path below the notebook's server; empty if that forwards nothing."""
    if not _has_proxy():
        return ""
    base = os.environ.get("JUPYTERHUB_SERVICE_PREFIX") or _base_of_parent()
    return f"{base.rstrip('/')}/proxy/{urlsplit(address).port}/"


def _base_of_parent() -> str:
    """The path below which the notebook server that started this kernel has its pages."""
    if find_spec("jupyter_server") is None:
        return "/"
    servers = import_module("jupyter_server.serverapp").list_running_servers()
    parents = {str(os.getppid()), os.environ.get("JPY_PARENT_PID", "")}
    return next(
        (str(server["base_url"]) for server in servers if str(server["pid"]) in parents), "/"
    )


def open_browser(address: str) -> None:
    """Open a page in this machine's browser, without waiting for that."""
    Thread(target=webbrowser.open, args=(address,), daemon=True).start()


def show(
    address: str, links: Sequence[str] = (), opens: bool = True, public_url: str | None = None
) -> None:
    """Print the links, and open the page in a new tab if that can be done.

    Args:
        address: Of the page, as its server tells it.
        links: Of invited people; empty if anybody may come.
        opens: Whether a tab is opened.
        public_url: Where browsers find the page, if that is elsewhere.
    """
    opens = opens and not links
    shared = public_url or shared_address(address)
    below = "" if public_url else proxied(address)
    command = "" if public_url or below else forwarding(address)
    if in_notebook():
        _display(below or shared, opens and not command)
    else:
        print(f"Play at {shared}", flush=True)
        # over ssh the browser is elsewhere
        if opens and "SSH_CONNECTION" not in os.environ:
            open_browser(public_url or local_address(address))
    if command:
        print(f"From the machine that you sit at, first: {command}", flush=True)
    for number, link in enumerate(links, 1):
        print(f"Person {number}: {link}", flush=True)


def _display(address: str, opens: bool) -> None:
    """Show a link in a notebook, and open it in a new tab."""
    display = import_module("IPython.display")
    link = f'<a href="{address}" target="_blank" rel="noopener">Play in a new tab</a>'
    script = f"<script>window.open({json.dumps(address)}, '_blank')</script>" if opens else ""
    display.display(display.HTML(f"{link} ({address}){script}"))
