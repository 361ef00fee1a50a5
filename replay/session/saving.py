"""Where the page may write: the one folder that the user named when he started it, and no file but its own."""

import re
from pathlib import Path

from wrenchgap.flight.atomic import Identity, check_replaceable, check_writable, write_below
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.reader import quoted

NAME = re.compile(r"(?!(?:con|prn|aux|nul|com\d|lpt\d)\.)[a-z0-9][a-z0-9._-]{0,99}\.toml", re.IGNORECASE | re.ASCII)
"""What a file may be called: a name on every system, no device on Windows, nothing hidden, no way out of the folder."""


def file_name(name: str) -> str:
    """`name`, as a client gave it. Raises UsageError for anything but the plain name of a TOML file."""
    if NAME.fullmatch(name) is None:
        said = " ".join(
            re.split(r"([/\\])", name)
        ).strip()  # spaced: the page shows no folders of a path (`viewer.host`)
        raise UsageError(
            f"{quoted(said) or 'no name'}: expected a file name that ends in .toml, of letters, digits and ._-, at "
            "most 100 before it; the page names no folders"
        )
    return name


class SaveFolder:
    """A folder into which a page writes. What lies there is replaced where the page wrote it, else only with `force`.

    Raises UsageError for what is no folder, or one that cannot be written to.
    """

    def __init__(self, folder: Path, *, force: bool = False) -> None:
        if not folder.is_dir():
            raise UsageError(f"--save-to {folder}: is no folder; make it first, or name another")
        check_writable(folder, "--save-to")
        self.folder, self.force = folder.resolve(), force
        self._written: dict[Path, Identity] = {}

    def write(self, name: str, text: str) -> Path:
        """Write a file of this name. Raises UsageError for a bad name, and for what the page must not replace."""
        path = self.folder / file_name(name)
        self._written[path] = write_below(self.folder, name, text.encode(), lambda found: self._check(path, found))
        return path

    def place(self, name: str) -> Path:
        """Where a file of this name would be written; raises as `write`."""
        path = self.folder / file_name(name)
        check_replaceable(path, lambda found: self._check(path, found))
        return path

    def _check(self, path: Path, found: Identity) -> None:
        if not self.force and self._written.get(path) != found:
            raise UsageError(
                f"{path.name}: exists already and was not written by this page; choose another name, or start the page "
                "with --force"
            )
