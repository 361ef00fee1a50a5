"""An autopilot's own messages on the clock of a flight, and what they say of its battery and its estimator.

The battery: its voltage at rest, in flight and at the lowest, and whether it is one at all. The estimator: innovations
over what it allows (test ratios), and its own flags of a fault. Above 1 a measurement is rejected; in normal operation
ratios stay below 0.5 and reach 1 at times (MAVLink's ESTIMATOR_STATUS, which PX4 and ArduPilot both send).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.autopilot import Autopilot
from wrenchgap.flight.check import Level
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.formats import Table
from wrenchgap.learn.health.phases import AIRBORNE, FlightPhases


@dataclass(frozen=True, eq=False)
class Recorded:
    """The tables of a log by topic, with times from the flight's start [ns]; empty where no autopilot wrote it."""

    tables: Mapping[str, Table]
    start_ns: int

    def columns(self, topic: str, *names: str) -> tuple[Array, Array] | None:
        """Times (N,) [s] and fields (N, K) of a topic; None where it lacks one or has no message."""
        table = self.tables.get(topic)
        if table is None or not len(table) or any(_number(table, name) is None for name in names):
            return None
        time = np.asarray((table.log_time_ns - self.start_ns) * 1e-9, dtype=float)
        parts = [np.asarray(_number(table, name), dtype=float).reshape(len(table), -1) for name in names]
        return time, np.hstack(parts)

    def instances(self, topic: str) -> list[str]:
        """All instances of a topic that are logged: `imu`, `imu/0`, `imu/1`, ..."""
        return [name for name in (topic, *(f"{topic}/{k}" for k in range(10))) if name in self.tables]


def _number(table: Table, name: str) -> Array | None:
    values = table.columns.get(name)
    return values if values is not None and values.dtype.kind in "fiub" else None


@dataclass(frozen=True)
class BatteryThresholds:
    """What is no battery, and what is a low one."""

    least: float = 2.0
    """Voltage [V] below which nothing flies: a lithium cell is empty above 2.5 V."""
    cell: tuple[float, float] = (2.5, 4.5)
    """Voltage of a cell [V] in flight, between empty under load and full (4.35 V of the high-voltage kind)."""
    low: float = 3.0
    """Time [s] below the autopilot's own limit that is worth a word: a burst of thrust is shorter."""


BATTERY = BatteryThresholds()
RAW = (("battery_status", "voltage_v"), ("BAT", "Volt"), ("CURR", "Volt"))
"""Where autopilots log a voltage that plays no role because it is zero throughout."""


@dataclass(frozen=True)
class Battery:
    """A battery, all voltages in V: before take-off (`rest`), and in the air: at the `start`, median, smallest, `end`.

    `cells` is their number by the autopilot's parameters, `limit` the voltage at which it calls the battery low or
    empty, None where it has none; it was below for `below` [s] in the air. `none` says that this reads no battery.
    """

    rest: float | None
    start: float
    flight: float
    lowest: float
    end: float
    cells: int | None
    limit: float | None
    below: float
    none: bool

    @property
    def sag(self) -> float | None:
        """By how much it falls from rest to the median in the air [V]."""
        return None if self.rest is None else self.rest - self.flight

    @property
    def drop(self) -> float:
        """By how much it falls from the beginning to the end of the flight, relative."""
        return (self.start - self.end) / max(self.start, 1e-9)

    @property
    def cells_wrong(self) -> bool:
        """Whether no cell has such a voltage, so that the number of cells is set wrongly."""
        return bool(self.cells) and not BATTERY.cell[0] < self.flight / (self.cells or 1) < BATTERY.cell[1]

    @property
    def level(self) -> Level:
        """How bad it is."""
        return "warn" if self.none or self.cells_wrong or self.below > BATTERY.low else "ok"


def battery_of(flight: Flight, recorded: Recorded, phases: FlightPhases) -> Battery | None:
    """The battery; None where no voltage is logged."""
    found = next((one for raw in RAW if (one := recorded.columns(*raw)) is not None), None)
    if flight.battery is not None:
        time, voltage = flight.battery.time, flight.battery.voltage
    elif found is not None:
        time, voltage = found[0], found[1][:, 0]
    else:
        return None
    air = phases.within(time, *AIRBORNE)
    flown = voltage[air] if air.any() else voltage
    first = float(time[air][0]) if air.any() else np.inf
    before = voltage[phases.within(time, "ground") & (time < first)]
    cells, limit = _settings({} if flight.autopilot is None else flight.autopilot.parameters)
    nothing = float(np.median(flown)) < BATTERY.least
    period = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    return Battery(
        rest=float(np.median(before)) if len(before) else None,
        start=float(np.median(flown[: max(1, len(flown) // 20)])),
        flight=float(np.median(flown)),
        lowest=float(flown.min()),
        end=float(np.median(flown[-max(1, len(flown) // 20) :])),
        cells=cells,
        limit=limit,
        below=0.0 if limit is None or nothing or not air.any() else float(np.sum(flown < limit)) * period,
        none=nothing,
    )


def _settings(parameters: Mapping[str, float | int]) -> tuple[int | None, float | None]:
    """Number of cells, and voltage [V] at which the battery counts as low (ArduPilot) or empty (PX4)."""
    prefix = "BAT1" if "BAT1_N_CELLS" in parameters else "BAT"
    cells = int(parameters.get(f"{prefix}_N_CELLS", 0)) or None
    if cells is not None and f"{prefix}_V_EMPTY" in parameters:
        return cells, cells * float(parameters[f"{prefix}_V_EMPTY"])
    limit = float(parameters.get("BATT_LOW_VOLT", parameters.get("FS_BATT_VOLTAGE", 0.0)))
    return cells, limit if limit > 0.0 else None


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
"""Fields of XKF4, NKF4 and, of the first estimator, EKF4."""


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
        used = int(autopilot.parameters.get("AHRS_EKF_TYPE", 0))
        kinds = {2: ("NKF4",), 3: ("XKF4",)}.get(used, ("XKF4", "NKF4", "EKF4"))
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
