"""The app imported and every policy loaded once, for the process from which the servers of the tests are forked.

What a server does at its start it still does; what it would read from the disk or compile is in its memory already.
"""

import gc

from app.tasks.mars.policies import PolicyCatalogue
from app.web.server import run

__all__ = ["run"]

PolicyCatalogue()
gc.collect()
gc.freeze()  # or the collection at each server's start would walk, and so copy, all of it
