"""A worker process: `python -m humanplay.jobs DESCRIPTOR NICE`."""

import sys
from multiprocessing.connection import Connection

from humanplay.jobs import give_way, work

give_way(int(sys.argv[2]))
work(Connection(int(sys.argv[1])))
