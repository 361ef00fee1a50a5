"""A folder of files that appears whole or not at all."""

import ctypes
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path

from wrenchgap.flight.atomic import check_writable, flush, resolved
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.model import Model

HERE, EXCHANGE = -100, 2
"""AT_FDCWD and RENAME_EXCHANGE of Linux (renameat2(2))."""
COMMON = frozenset({"Makefile", "README.md", "CMakeLists.txt", "selftest.c", "selftest", "__pycache__"})
"""Names that others give files too: a folder that holds nothing else is not ours."""


def checked(folder: Path, names: Collection[str], *, force: bool = False, model: Model | None = None) -> None:
    """Check, before any work, that a folder may be written.

    Raises UsageError where it exists and `force` is not given, is a file, the working folder or one that cannot be
    written to, holds files that are not ours or the `model` that is exported, or where its parent does not exist.
    """
    target = resolved(folder)
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise UsageError(f"--output {folder}: is no folder; choose another name")
    if not target.parent.is_dir():
        raise UsageError(f"--output {folder}: the folder {folder.parent} does not exist; create it first")
    check_writable(target.parent, f"--output {folder}")
    if not folder.exists():
        return
    if not force:
        raise UsageError(f"--output {folder}: exists already; choose another name or overwrite it with --force")
    if folder.samefile("."):
        raise UsageError(
            f"--output {folder}: is the working folder, and --force replaces the whole folder; run the command from "
            f"{target.parent} with --output {target.name}"
        )
    check_writable(folder, f"--output {folder}")
    ours = {*names, "selftest"}
    cached = {"__pycache__"} if any(name.endswith(".py") for name in names) else set()
    found = sorted(folder.iterdir())
    others = [
        p.name
        for p in found
        if (p.name not in ours or not p.is_file() or p.is_symlink()) and (p.name not in cached or not p.is_dir())
    ]
    if all(p.name in COMMON for p in found):
        others = [p.name for p in found]
    if others:
        raise UsageError(
            f"--output {folder}: holds {', '.join(others[:3])}, which this command did not write; --force replaces the "
            "whole folder, so choose an empty one"
        )
    if model is not None and model.path is not None and model.path.resolve().is_relative_to(target):
        raise UsageError(f"--output {folder}: the model {model.path} is in it; choose another name")


def write_folder(folder: Path, files: Mapping[str, str], *, force: bool = False) -> Path:
    """Write files into a hidden folder beside the folder, and give them its name at once.

    Whoever ends the process leaves the old folder or the new one, and at most the hidden one (`.wrenchgap.XXXXXXXX`).
    A folder that is replaced keeps its permissions.
    """
    checked(folder, files, force=force)
    target = folder.resolve()
    try:
        hidden = Path(tempfile.mkdtemp(dir=target.parent, prefix=".wrenchgap."))
        try:
            new = hidden / "new"
            new.mkdir()
            for name, text in files.items():
                (new / name).write_text(text, encoding="utf-8")
                flush(new / name)
            if target.exists():
                new.chmod(stat.S_IMODE(target.stat().st_mode))
                _replace(target, new)
            else:
                new.rename(target)
        finally:
            if target.exists() or not (hidden / "old").exists():
                shutil.rmtree(hidden, ignore_errors=True)
    except OSError as error:
        raise UsageError(f"--output {folder}: cannot be written: {error.strerror}") from None
    return folder


def _replace(target: Path, new: Path) -> None:
    """Put a folder in the place of another one: in one step where the system can, else the old one comes back."""
    if _exchanged(new, target):
        return
    old = new.with_name("old")
    try:
        target.rename(old)
        new.rename(target)
    except BaseException:  # an interrupt, too
        with suppress(FileNotFoundError):
            if not target.exists():
                old.rename(target)
        raise


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange the names of two folders in one step; False where the system or the file system cannot."""
    if sys.platform != "linux":
        return False
    with suppress(AttributeError):  # a C library without it
        rename = ctypes.CDLL(None).renameat2
        return bool(rename(HERE, os.fsencode(one), HERE, os.fsencode(other), EXCHANGE) == 0)
    return False
