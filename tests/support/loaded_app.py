"""The app and every policy loaded once, for the process that forks servers.

What a server does at its start it still does; what it would read from the disk, compile or import
is in its memory already.
"""

from importlib.util import find_spec

import humanplay.cli.pilot.play
import humanplay.cli.pilot.server  # noqa: F401
from humanplay import jobs
from humanplay.cli.pilot import running
from humanplay.task.registration import DEFAULT_TASK, environment_of
from humanplay.tasks import processes
from humanplay.tasks.gymnasium import doctor
from humanplay.web.server import run
from tests.support.forked_server import PageProcess, Worker, run_fresh, start_preparer

__all__ = ["run"]

jobs._Process = Worker
running.start_process = PageProcess
processes.start_process = start_preparer
doctor.run_fresh = run_fresh
if find_spec("humanplay.tasks.mars") is not None:
    from humanplay.tasks.mars.policies import PolicyCatalogue
    from humanplay.tasks.mars.viewer3d import viewer

    environment_of(DEFAULT_TASK).prepare()
    PolicyCatalogue().offers()
    viewer.ClientPage.load()
