"""What the page asks of a working session, and what it gets: flights to draw, second vehicles, series to plot.

The page knows no logs, fits or compensators. It asks a `Session` for flights that are ready to be drawn, on one clock,
with every quantity in the frames of `flight.flight`. `replay` implements it; a test may do so in ten lines.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant.vehicle import Vehicle

Report = Callable[[float, str], None]
"""Says how far a job is: its share done, 0 to 1, and what it does at present."""


@dataclass(frozen=True)
class Stretch:
    """A part of a flight, [start, stop] [s], and the reason to look at it."""

    start: float
    stop: float
    words: str


@dataclass(frozen=True)
class Motion:
    """Motion of a second vehicle (a ghost), on the clock of the flight that it is compared with.

    time (K,) [s]                       strictly increasing
    position_E (K, 3), quat_EB (K, 4)   its body
    tilt (K, A) [rad]                   angles of its arms, None where unknown
    words                               what it is, in a few words, e.g. "without compensation"
    """

    time: Array
    position_E: Array
    quat_EB: Array
    tilt: Array | None = None
    words: str = ""


@dataclass(frozen=True)
class Series:
    """Quantities over time that belong into one plot: `values` (K,) by name, on `time` (K,) [s]; nan where unknown.

    `title` is what they are, `unit` what they are in, e.g. "attitude error" in "deg"; `group` the tab for the plot.
    `floor` is the least range of the plot [unit]: what varies by less is drawn flat.
    """

    title: str
    unit: str
    time: Array
    values: Mapping[str, Array]
    group: str = "Tracking"
    floor: float = 0.0


@dataclass(frozen=True)
class PathsAhead:
    """Predictions of the next second that start at times (S,) [s]: positions (S, 1 + D, P, 3) [m] in E, the model's own
    path first, then D by which it may be off.
    """  # noqa: D205

    start: Array
    position_E: Array

    def at(self, time: float) -> Array | None:
        """Paths (1 + D, P, 3) of the last start that is not after `time`; None where that is a second ago."""
        k = int(np.searchsorted(self.start, time + 1e-9, side="right")) - 1
        return self.position_E[k] if k >= 0 and time - self.start[k] < 1.0 else None


@dataclass(frozen=True)
class Scene:
    """One flight, K instants at `time` (K,) [s], strictly increasing; gaps are jumps of it.

    position_E (K, 3), quat_EB (K, 4)   the body; at rest at the origin where the log has no pose
    reference_position_E, quat_ED       the same of the reference, None where it is not logged
    tilt (K, A) [rad]                   angles of all arms, None where unknown
    thrust (K, R) [N]                   of all rotors as commanded, None where unknown
    wrenches                            by name, e.g. "commanded", "measured", "predicted": (K, 6) in B about the
                                        centre of mass, nan where unknown
    sigma                               of some of them, standard deviation (K, 6), nan where unknown
    ahead                               where the current model leads, worked out when it is asked for; may take seconds
    residual_of                         the wrench that predicts "measured"; what is left is the residual
    floors                              by unit, "N" and "Nm": the least range of plots of wrenches and residuals
    series                              what else is worth a plot
    gaps                                stretches that the log does not cover, or that are left out
    worst                               stretches in which the model is farthest from the measurement
    notes, warnings                     sentences that a user should read; what checks of the log said
    """

    name: str
    time: Array
    position_E: Array
    quat_EB: Array
    reference_position_E: Array | None = None
    quat_ED: Array | None = None
    tilt: Array | None = None
    thrust: Array | None = None
    wrenches: Mapping[str, Array] = field(default_factory=dict)
    sigma: Mapping[str, Array] = field(default_factory=dict)
    ahead: Callable[[], PathsAhead | None] = lambda: None
    residual_of: str | None = None
    floors: Mapping[str, float] = field(default_factory=dict)
    series: tuple[Series, ...] = ()
    gaps: tuple[Stretch, ...] = ()
    worst: tuple[Stretch, ...] = ()
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def index(self, time: float) -> int:
        """The last instant that is not after `time`, the first where there is none."""
        return max(int(np.searchsorted(self.time, time, side="right")) - 1, 0)

    @property
    def is_empty(self) -> bool:
        """Whether nothing was logged: no flight is open yet."""
        return not (self.wrenches or self.series or np.any(self.position_E))

    @property
    def motion(self) -> Motion:
        """The same flight as a ghost for another."""
        return Motion(self.time, self.position_E, self.quat_EB, self.tilt, self.name)


ReadChannels = Callable[[str], Mapping[str, tuple[Array, Array]]]
"""All channels of a flight by name: times (N,) [s] on its clock and values (N,). May take seconds."""
WriteReport = Callable[[str, Report], str]
"""A self-contained HTML page about a flight. May take minutes."""
MakePanel = Callable[[Any], Any]
"""Called once with the page (`viewer.host.Host`), it makes a tab of its own there (`viewer.panel.Panel`)."""


@dataclass(frozen=True)
class Capabilities:
    """Optional features of a session, such as its own tabs (`panels`); those that are None have no controls.

    `first` is a tab that stands before all others.
    """

    panels: Sequence[MakePanel] = ()
    first: MakePanel | None = None
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
