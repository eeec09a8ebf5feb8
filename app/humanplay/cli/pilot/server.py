"""The server of a pilot, in a process that ends with the program that started it.

`python -m humanplay.cli.pilot.server DESCRIPTOR` is that process. It is sent one message, and answers with one when its page is
open, or when it cannot be.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from contextlib import closing, suppress
from multiprocessing.connection import Connection
from threading import Thread

from humanplay.board.sources import PlayerTokens, Sources
from humanplay.cli.pilot.running import Answer, Request
from humanplay.db import names
from humanplay.db.database import StoreError
from humanplay.db.file import InUseError
from humanplay.db.store import Store
from humanplay.jobs import held
from humanplay.tasks.gymnasium.in_place import connect
from humanplay.web.people import likeness
from humanplay.web.server import ServerError, run
from humanplay.web.settings import Settings

ENDING_S = 3.0
"""How long the server of a program that was killed may take to end."""


def free_store(settings: Settings) -> Store:
    """The database, once the server of a killed program has left it.

    Raises:
        StoreError: If another server holds it for longer, or it cannot be opened.
    """
    until_s = time.monotonic() + ENDING_S
    while time.monotonic() < until_s:
        with suppress(InUseError):
            return Store(settings.database, settings.durable)
        time.sleep(0.05)
    return Store(settings.database, settings.durable)


def invitations(settings: Settings, people: int) -> list[str]:
    """The tokens of people 1, 2, ...; a database always gives the same ones."""
    sources, tokens = Sources(), []
    with closing(free_store(settings)) as store:
        signed = PlayerTokens(store.secret())
        for number in range(1, people + 1):
            player = names.invited(store.connection, number)
            if player is None:
                player, name, now_ms = sources.player_id(), f"Person {number}", sources.clock_ms()
                with store.transaction():
                    store.add_player(player, now_ms)
                    names.invite(store.connection, number, player)
                    with suppress(names.NameTakenError):  # else the page asks them for a name
                        names.set_name(store.connection, player, name, likeness(name), now_ms)
            tokens.append(signed.sign(player))
    return tokens


def serve(connection: Connection) -> None:
    """Serve what is asked for until the program closes its end."""
    request: Request = json.loads(connection.recv_bytes())
    answer = Answer()

    def end_with_the_program() -> None:
        try:
            connection.recv_bytes()
        except (EOFError, OSError):
            os.kill(os.getpid(), signal.SIGTERM)

    def tell(address: str) -> None:
        connection.send_bytes(json.dumps(answer | {"address": address}).encode())
        Thread(target=end_with_the_program, daemon=True).start()

    try:
        held.take(request["held"])
        if request["board"] is not None:
            connect(request["board"])
        settings = Settings.model_validate(request["settings"])
        answer["invitations"] = invitations(settings, request["people"])
        run(settings, tell)
    except (ServerError, StoreError, ValueError) as error:
        connection.send_bytes(json.dumps({"error": str(error)}).encode())


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
