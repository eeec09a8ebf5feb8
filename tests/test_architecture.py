"""Imports follow the layers: every import of the project is held to the tables below, and the tables have no cycle.

A unit is a folder with code in it; where a folder has folders inside, each of its own modules is a unit as well. Imports
inside functions and under TYPE_CHECKING count, and so do those by name through `importlib`.
"""

import ast
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("marsexplorer", "app")

ALLOWED = {
    # the environment and its agents, complete without the web
    "marsexplorer": "marsexplorer.config marsexplorer.env marsexplorer.vector",
    "marsexplorer.config": "",
    "marsexplorer.compiled": "",
    "marsexplorer.score": "marsexplorer.config",
    "marsexplorer.lidar": "marsexplorer.compiled",
    "marsexplorer.terrain": "marsexplorer.compiled marsexplorer.config",
    "marsexplorer.rules": "marsexplorer.compiled marsexplorer.config marsexplorer.lidar marsexplorer.terrain",
    "marsexplorer.world": "marsexplorer.config marsexplorer.lidar marsexplorer.rules marsexplorer.terrain",
    "marsexplorer.episode": "marsexplorer.config marsexplorer.rules marsexplorer.score marsexplorer.world",
}
