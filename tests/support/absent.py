"""Processes that have no more packages than an extra brings."""

import os


def environment_without(modules, folder):
    """The environment of a process that cannot import these modules.

    Neither can any process that it starts.
    """
    absent = folder / "absent"
    absent.mkdir()
    for module in modules:
        statement = f"raise ModuleNotFoundError(\"No module named '{module}'\", name={module!r})\n"
        (absent / f"{module}.py").write_text(statement)
    path = os.pathsep.join(filter(None, [str(absent), os.environ.get("PYTHONPATH")]))
    return {**os.environ, "PYTHONPATH": path}
