"""What floating-point results depend on besides seed and actions.

That is packages, Python, system, processor and settings.
"""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from importlib.metadata import distribution
from typing import Any

import numpy as np

from humanplay.tasks.processes import FIXED

PATHS = ("GLIBC_TUNABLES", "NPY_DISABLE_CPU_FEATURES", "OPENBLAS_CORETYPE")
"""Variables by which the C library, NumPy and OpenBLAS choose their code; boards have those of the server."""


@cache
def lock_of(packages: tuple[str, ...]) -> dict[str, Any]:
    """What this machine computes with, as JSON.

    Returns:
        "packages": name -> version, and SHA-256 (hex) of its list of files (RECORD), "" without one.
        "python", "platform".
        "processor": its features, as NumPy names them.
        "setting": the variables of the boards' processes.
    """
    is_new = np.lib.NumpyVersion(np.__version__) >= "2.0.0"
    core = import_module("numpy._core" if is_new else "numpy.core")
    features = import_module(f"{core.__name__}._multiarray_umath").__cpu_features__
    locked = {}
    for name in packages:
        installed = distribution(name)
        files = sorted((installed.read_text("RECORD") or "").splitlines())
        files = [line for line in files if "__pycache__" not in line and ".dist-info/" not in line]
        record = hashlib.sha256("\n".join(files).encode()).hexdigest() if files else ""
        locked[name] = {"version": installed.version, "record": record}
    return {
        "packages": locked,
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()} {' '.join(platform.libc_ver())}".strip(),
        "processor": " ".join(sorted(name for name, has in features.items() if has)),
        "setting": {**{name: os.environ.get(name, "") for name in PATHS}, **FIXED},
    }


def differences(stored: Mapping[str, Any], here: Mapping[str, Any]) -> Iterator[str]:
    """What differs here from what was stored, in a few words each."""
    for name in sorted({*stored, *here}):
        was, now = stored.get(name), here.get(name)
        if was == now:
            continue
        if isinstance(was, Mapping) and isinstance(now, Mapping) and "version" not in was:
            yield from differences(was, now)
        elif isinstance(was, Mapping) and isinstance(now, Mapping):
            other = "with other files" if was["version"] == now["version"] else ""
            yield f"{name} {now['version']} {other or 'instead of ' + was['version']}"
        elif name == "processor":
            lost = sorted({*str(was).split()} ^ {*str(now).split()})
            yield f"a processor that differs in {', '.join(lost)}"
        elif isinstance(was, Mapping):
            yield f"no {name} instead of {was.get('version', was)}"
        elif isinstance(now, Mapping):
            yield f"{name} {now.get('version', now)} in addition"
        else:
            yield f"{name} {now or 'unset'} instead of {was or 'unset'}"
