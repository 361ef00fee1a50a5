"""PX4 logs (`.ulg`): recognised so that they are refused for the right reason.

They carry normalised controls, not a wrench in SI, so there is nothing to compare a measured wrench with.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats.reader import Batch, Reader, Wanted


@dataclass
class UlogReader(Reader):
    """Refuses a PX4 log."""

    name: ClassVar[str] = "PX4 ULog"
    magic: ClassVar[bytes] = b"ULog\x01\x12\x35"

    def batches(self, wanted: Wanted) -> Iterator[Batch]:
        """Say what can be done instead."""
        raise LogError(
            f"{self.path}: PX4 .ulg logs are not read (their controls are normalised, not N and Nm); "
            "supported: MCAP, ROS 1 .bag, ROS 2 bag folder or .db3. Record ROS topics, or convert to MCAP"
        )
