"""A folder of files that appears whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from wrenchgap.flight.atomic import check_writable
from wrenchgap.flight.errors import UsageError


def checked(folder: Path, names: Mapping[str, str] | tuple[str, ...], *, force: bool = False) -> None:
    """Check, before any work, that a folder may be written.

    Raises UsageError where it exists and `force` is not given, is a file, holds files that are not ours, or where its
    parent does not exist.
    """
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise UsageError(f"--output {folder}: is no folder; choose another name")
    if not folder.resolve().parent.is_dir():
        raise UsageError(f"--output {folder}: the folder {folder.parent} does not exist; create it first")
    check_writable(folder.resolve().parent, f"--output {folder}")
    if not folder.exists():
        return
    if not force:
        raise UsageError(f"--output {folder}: exists already; choose another name or overwrite it with --force")
    ours = {*names, "selftest"}
    others = sorted(p.name for p in folder.iterdir() if p.name not in ours or p.is_symlink() or not p.is_file())
    if others:
        raise UsageError(
            f"--output {folder}: holds {', '.join(others[:3])}, which `export` did not write; --force replaces the "
            "whole folder, so choose an empty one"
        )


def write_folder(folder: Path, files: Mapping[str, str], *, force: bool = False) -> Path:
    """Write files under a temporary name beside the folder, and move them into place at once."""
    checked(folder, files, force=force)
    temporary = Path(tempfile.mkdtemp(dir=folder.resolve().parent, prefix=f".{folder.name}."))
    try:
        for name, text in files.items():
            (temporary / name).write_text(text, encoding="utf-8")
        temporary.chmod(0o755)
        old = temporary.with_name(f"{temporary.name}.old")
        if folder.exists():
            folder.replace(old)
        try:
            temporary.replace(folder)
        except OSError:
            if old.exists():
                old.replace(folder)
            raise
        shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        raise UsageError(f"--output {folder}: cannot be written: {error.strerror}") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return folder
