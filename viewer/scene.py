"""Data of the page: flights to draw, second vehicles, series to plot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from wrenchgap.flight.flight import Array


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
class Scene:
    """One flight, K instants at `time` (K,) [s], strictly increasing; gaps are jumps of it.

    position_E (K, 3), quat_EB (K, 4)   the body; at rest at the origin where the log has no pose
    reference_position_E, quat_ED       the same of the reference, None where it is not logged
    tilt (K, A) [rad]                   angles of all arms, None where unknown
    thrust (K, R) [N]                   of all rotors as commanded, None where unknown
    wrenches                            by name, e.g. "commanded", "measured", "predicted": (K, 6) in B about the
                                        centre of mass, nan where unknown
    sigma                               of some of them, standard deviation (K, 6), nan where unknown
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
    def motion(self) -> Motion:
        """The same flight as a ghost for another."""
        return Motion(self.time, self.position_E, self.quat_EB, self.tilt, self.name)
