"""Health of the estimator: innovations over what it allows (test ratios), and its own flags of a fault.

Above 1 a measurement is rejected; in normal operation ratios stay below 0.5 and reach 1 at times (MAVLink's
ESTIMATOR_STATUS, which PX4 and ArduPilot both send).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.autopilot import Autopilot
from wrenchgap.flight.check import Level
from wrenchgap.learn.health.phases import AIRBORNE, FlightPhases
from wrenchgap.learn.health.recorded import Recorded


@dataclass(frozen=True)
class EstimatorThresholds:
    """Limits of test ratios."""

    usual: float = 0.5
    """Largest median of a ratio in normal operation (MAVLink)."""
    rejected: float = 1.0
    """From here on a measurement is rejected (MAVLink)."""
    rarely: float = 0.01
    """Share of the flight with rejected measurements that is worth a word: single outliers are what the test is for."""
    often: float = 0.1
    """The same, that is bad: most receivers and compasses are lost to the estimator for seconds then."""


ESTIMATOR = EstimatorThresholds()
PX4 = {"velocity": "vel", "position": "pos", "height": "hgt", "magnetometer": "mag", "heading": "hdg"}
"""Fields NAME_test_ratio of estimator_status; heading is that of the newer firmware, which has no magnetometer."""
ARDUPILOT = {"velocity": "SV", "position": "SP", "height": "SH", "magnetometer": "SM"}
"""Fields of XKF4 and NKF4."""


@dataclass(frozen=True)
class InnovationRatio:
    """The test ratio of a kind of measurement in the air: median, 95th percentile, share of the time above 1."""

    of: str
    median: float
    high: float
    rejected: float


@dataclass(frozen=True)
class Estimator:
    """The estimator in use, by the topic that says so. `faulty` is the share of the flight with a flag of a fault."""

    topic: str
    ratios: tuple[InnovationRatio, ...]
    faulty: float

    @property
    def worst(self) -> InnovationRatio:
        """Of the measurement that is rejected most, else of the largest ratio."""
        return max(self.ratios, key=lambda ratio: (ratio.rejected, ratio.high))

    @property
    def level(self) -> Level:
        """How bad it is."""
        if self.faulty > 0.0 or self.worst.rejected > ESTIMATOR.often:
            return "bad"
        uneasy = self.worst.rejected > ESTIMATOR.rarely or any(r.median > ESTIMATOR.usual for r in self.ratios)
        return "warn" if uneasy else "ok"


def estimator_of(autopilot: Autopilot | None, recorded: Recorded, phases: FlightPhases) -> Estimator | None:
    """The estimator in use; None where its test ratios are not logged."""
    if autopilot is None:
        return None
    if autopilot.name == "ArduPilot":
        kinds = {2: ("NKF4",), 3: ("XKF4",)}.get(int(autopilot.parameters.get("AHRS_EKF_TYPE", 0)), ("XKF4", "NKF4"))
        found = [_found(recorded, _in_use(recorded, kind, kind, "PI"), ARDUPILOT, "{}", "FS", phases) for kind in kinds]
        return next((one for one in found if one is not None), None)
    topic = _in_use(recorded, "estimator_status", "estimator_selector_status", "primary_instance")
    return _found(recorded, topic, PX4, "{}_test_ratio", "filter_fault_flags", phases)


def _in_use(recorded: Recorded, topic: str, says: str, name: str) -> str:
    """The instance of a topic that was in use for most of the log."""
    for place in recorded.instances(says):
        if (chosen := recorded.columns(place, name)) is not None:
            number = int(np.median(chosen[1]))
            return next((t for t in (f"{topic}/{number}", topic) if t in recorded.tables), topic)
    return next(iter(recorded.instances(topic)), topic)


def _found(
    recorded: Recorded, topic: str, fields: dict[str, str], form: str, faults: str, phases: FlightPhases
) -> Estimator | None:
    ratios = []
    for of, name in fields.items():
        known = recorded.columns(topic, form.format(name))
        if known is None:
            continue
        values = known[1][phases.within(known[0], *AIRBORNE) & np.isfinite(known[1][:, 0]), 0]
        if len(values) and np.any(values > 0.0):  # zero throughout: such a measurement is not used
            median, high = (float(np.percentile(values, q)) for q in (50.0, 95.0))
            ratios.append(InnovationRatio(of, median, high, float(np.mean(values > ESTIMATOR.rejected))))
    if not ratios:
        return None
    flags = recorded.columns(topic, faults)
    air = np.zeros(0, dtype=bool) if flags is None else phases.within(flags[0], *AIRBORNE)
    faulty = float(np.mean(flags[1][air, 0] != 0)) if flags is not None and air.any() else 0.0
    return Estimator(topic, tuple(ratios), faulty)
