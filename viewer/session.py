"""The protocol of a working session, which the page uses.

The page knows no logs, fits or compensators. It asks a `Session` for flights that are ready to be drawn, on one clock,
with every quantity in the frames of `flight.flight`. `replay` implements it; a test may do so in ten lines.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from wrenchgap.flight.flight import Array
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.viewer.background import Report
from wrenchgap.viewer.scene import Scene

ReadChannels = Callable[[str], Mapping[str, tuple[Array, Array]]]
"""All channels of a flight by name: times (N,) [s] on its clock and values (N,). May take seconds."""
WriteReport = Callable[[str, Report], str]
"""A self-contained HTML page about a flight. May take minutes."""
MakePanel = Callable[[Any], Any]
"""Called once with the page (`viewer.host.Host`), it makes a tab of its own there (`viewer.panel.Panel`)."""


@dataclass(frozen=True)
class Capabilities:
    """Optional features of a session, such as its own tabs (`panels`); those that are None have no controls."""

    panels: Sequence[MakePanel] = ()
    channels: ReadChannels | None = None
    report: WriteReport | None = None


class Session(Protocol):
    """The interface of every session."""

    vehicle: Vehicle
    """The vehicle to draw."""
    flights: tuple[str, ...]
    """Names of the flights, all different, at least one."""
    capabilities: Capabilities
    """What else it can do."""

    def scene(self, flight: str) -> Scene:
        """The flight of this name."""
