"""Blackbox logs of Betaflight and INAV (`.bbl`, `.bfl`): known by their first line, read by way of their own decoder.

Its table (`blackbox_decode`, github.com/betaflight/blackbox-tools) is read as any other (`flight.formats.tabular`).
"""

import shlex
from typing import ClassVar, NoReturn

from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats.reader import TableReader
from wrenchgap.flight.formats.table import Selection


class BlackboxReader(TableReader):
    """Says how to convert it."""

    name: ClassVar[str] = "blackbox log"
    magic: ClassVar[bytes] = b"H Product:Blackbox"

    def tables(self, selection: Selection) -> NoReturn:
        """None: raises LogError."""
        raise LogError(
            f"{self.path}: a blackbox log of Betaflight or INAV; convert it with `blackbox_decode "
            f"{shlex.quote(self.path.name)}` and give the .csv that it writes"
        )
