"""The app imported and every policy loaded once, for the process from which servers and workers of the tests are forked.

What a server does at its start it still does; what it would read from the disk or compile is in its memory already.
"""

import gc

from app import jobs
from app.tasks.mars.policies import PolicyCatalogue
from app.web.server import run
from tests.support.forked_server import Worker

__all__ = ["run"]

jobs._Process = Worker
PolicyCatalogue()
gc.collect()
gc.freeze()  # or the collection at each server's start would walk, and so copy, all of it
