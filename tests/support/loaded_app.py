"""The app and every policy loaded once, for the process that forks servers.

What a server does at its start it still does; what it would read from the disk, compile or import
is in its memory already.
"""

import gc
from importlib.util import find_spec

from humanplay import jobs
from humanplay.task.registration import DEFAULT_TASK, environment_of
from humanplay.web.server import run
from tests.support.forked_server import Worker

__all__ = ["run"]

jobs._Process = Worker
if find_spec("humanplay.tasks.mars") is not None:
    from humanplay.tasks.mars.policies import PolicyCatalogue
    from humanplay.tasks.mars.viewer3d import viewer

    environment_of(DEFAULT_TASK).prepare()
    PolicyCatalogue().offers()
    viewer.ClientPage.load()
gc.collect()
gc.freeze()  # or the collection at each server's start would walk, and so copy, all of it
