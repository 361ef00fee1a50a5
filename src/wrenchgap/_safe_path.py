"""Where processes that are started here look for modules: never in the working folder, whose files are data."""

from __future__ import annotations

import os
import sys


def absolute(paths: list[str]) -> list[str]:
    """Those that do not depend on the working folder: the empty and relative ones, which do, are left out."""
    return [path for path in paths if os.path.isabs(path)]  # noqa: PTH117


def environment() -> dict[str, str]:
    """The environment for a child: no Python of it, nor of its children, has the working folder on its path."""
    found = dict(os.environ, PYTHONSAFEPATH="1")
    chosen = absolute(found.pop("PYTHONPATH", "").split(os.pathsep))
    return found | ({"PYTHONPATH": os.pathsep.join(chosen)} if chosen else {})


def leave_working_folder() -> None:
    """Take what stands for the working folder out of this process's path and its environment.

    Python has made the relative entries of PYTHONPATH absolute by now, so that they are known by its text alone.
    """
    asked = os.environ.get("PYTHONPATH", "").split(os.pathsep) if not sys.flags.ignore_environment else []
    relative = {os.path.abspath(path) for path in asked} - set(absolute(asked))  # noqa: PTH100
    sys.path[:] = [path for path in absolute(sys.path) if path not in relative]
    safe = environment()
    if "PYTHONPATH" not in safe:
        os.environ.pop("PYTHONPATH", None)
    os.environ.update(safe)
