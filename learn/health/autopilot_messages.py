"""An autopilot's own messages on the clock of a flight, and what they say of its battery and its estimator.

The battery: its voltage at rest, in flight and at the lowest, and whether it is one at all. The estimator: innovations
over what it allows (test ratios), and its own flags of a fault. Above 1 a measurement is rejected; in normal operation
ratios stay below 0.5 and reach 1 at times (MAVLink's ESTIMATOR_STATUS, which PX4 and ArduPilot both send).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.autopilot import Autopilot
from wrenchgap.flight.check import Level
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.formats import Table
from wrenchgap.flight.formats.standard_topics import numbers
from wrenchgap.learn.health.phases import AIRBORNE, FlightPhases


@dataclass(frozen=True, eq=False)
class Recorded:
    """The tables of a log by topic, with times from the flight's start [ns]; empty where no autopilot wrote it."""

    tables: Mapping[str, Table]
    start_ns: int

    def columns(self, topic: str, *names: str) -> tuple[Array, Array] | None:
        """Times (N,) [s] and fields (N, K) of a topic; None where it lacks one or has no message."""
        table = self.tables.get(topic)
        values = None if table is None or not len(table) else numbers(table, *names)
        if table is None or values is None:
            return None
        return np.asarray((table.log_time_ns - self.start_ns) * 1e-9, dtype=float), values

    def instances(self, topic: str) -> list[str]:
        """All instances of a topic that are logged: `imu`, `imu/0`, `imu/1`, ..."""
        return [name for name in (topic, *(f"{topic}/{k}" for k in range(10))) if name in self.tables]


@dataclass(frozen=True)
class BatteryThresholds:
    """What is no battery, and what is a low one."""

    current: float = 0.5
    """Current [A] below which no motors hover: the smallest quadrotors, of 30 g, take more than 1 A."""
    cell: tuple[float, float] = (2.5, 4.5)
    """Voltage of a cell [V] in flight, between empty under load and full (4.35 V of the high-voltage kind)."""
    low: float = 3.0
    """Time [s] below the voltage that its parameters name that is worth a word: a burst of thrust is shorter."""


BATTERY = BatteryThresholds()
RAW = (("battery_status", "voltage_v"), ("BAT", "Volt"), ("CURR", "Volt"))
"""Where autopilots log a voltage that plays no role because it is zero throughout."""
CURRENTS = (("battery_status", "current_a"), ("BAT", "Curr"), ("CURR", "Curr"))


@dataclass(frozen=True)
class Battery:
    """A battery, all voltages in V: before take-off (`rest`), and in the air: at the `start`, median, smallest, `end`.

    `cells` is their number by the autopilot's parameters, `limit` the voltage that these call low (ArduPilot) or empty
    (PX4, which itself acts on the charge that remains), None where there is none, and `limit_of` which they are; it was
    below for `below` [s] in the air. `none` says that this reads no battery. `current` [A] is its median in the air,
    None where none is measured.
    """

    rest: float | None
    start: float
    flight: float
    lowest: float
    end: float
    cells: int | None
    limit: float | None
    limit_of: str
    below: float
    none: bool
    current: float | None = None

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
    def no_current(self) -> bool:
        """Whether what is read as the current does not carry the vehicle."""
        return self.current is not None and self.current < BATTERY.current

    @property
    def level(self) -> Level:
        """How bad it is."""
        odd = self.none or self.cells_wrong or self.no_current
        return "warn" if odd or self.below > BATTERY.low else "ok"


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
    cells, limit, limit_of = _settings({} if flight.autopilot is None else flight.autopilot.parameters)
    nothing = flight.battery is None or flight.battery.none
    amperes = next((one for raw in CURRENTS if (one := recorded.columns(*raw)) is not None), None)
    whole = recorded.tables.get("CURR")  # firmware 3.3 and before: hundredths of an ampere
    unit = 0.01 if whole is not None and "Curr" in whole.columns and whole.columns["Curr"].dtype.kind in "iu" else 1.0
    drawn = _aloft(amperes, phases)
    period = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    return Battery(
        rest=float(np.median(before)) if len(before) else None,
        start=float(np.median(flown[: max(1, len(flown) // 20)])),
        flight=float(np.median(flown)),
        lowest=float(flown.min()),
        end=float(np.median(flown[-max(1, len(flown) // 20) :])),
        cells=cells,
        limit=limit,
        limit_of=limit_of,
        below=0.0 if limit is None or nothing or not air.any() else float(np.sum(flown < limit)) * period,
        none=nothing,
        current=unit * float(np.median(drawn)) if np.any(drawn > 0.0) else None,  # -1 or 0 throughout: no sensor
    )


def _settings(parameters: Mapping[str, float | int]) -> tuple[int | None, float | None, str]:
    """Number of cells, voltage [V] that the parameters call low (ArduPilot) or empty (PX4), and by which of them."""
    prefix = "BAT1" if "BAT1_N_CELLS" in parameters else "BAT"
    cells = int(parameters.get(f"{prefix}_N_CELLS", 0)) or None
    if cells is not None and (empty := f"{prefix}_V_EMPTY") in parameters:
        return cells, cells * float(parameters[empty]), f"{cells} cells at {empty}"
    name = "BATT_LOW_VOLT" if "BATT_LOW_VOLT" in parameters else "FS_BATT_VOLTAGE"
    limit = float(parameters.get(name, 0.0))
    return cells, limit if limit > 0.0 else None, name


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
FIXES = (("vehicle_gps_position", "fix_type"), ("sensor_gps", "fix_type"), ("GPS", "Status"))
"""What receivers say of their fix, 2 and more of one (PX4's message SensorGps, ArduPilot's GPS)."""
SOURCES = {"cs_ev_pos": "vision", "cs_opt_flow": "optical flow"}
"""What a position comes from without a fix, by flags of PX4's message EstimatorStatusFlags."""
ARDUPILOT = {"velocity": "SV", "position": "SP", "height": "SH", "magnetometer": "SM"}
"""Fields of XKF4, NKF4 and, of the first estimator, EKF4."""


@dataclass(frozen=True)
class InnovationRatio:
    """The test ratio of a kind of measurement in the air: median, 95th percentile, share of the time above 1."""

    of: str
    topic: str
    median: float
    high: float
    rejected: float


@dataclass(frozen=True)
class Estimator:
    """The estimator in use, by the topic that says so. `faulty` is the share of the flight with a flag of a fault.

    `disturbed` is that in which the magnetic field does not match the expected one. `no_fix` says that the GPS had no
    fix in the air; `sources` are what the position came from then, where that is logged.
    """

    topic: str
    ratios: tuple[InnovationRatio, ...]
    faulty: float
    disturbed: float = 0.0
    no_fix: bool = False
    sources: tuple[str, ...] = ()

    @property
    def worst(self) -> InnovationRatio:
        """Of the measurement that is rejected most, else of the largest ratio."""
        return max(self.ratios, key=lambda ratio: (ratio.rejected, ratio.high))

    @property
    def level(self) -> Level:
        """How bad it is."""
        if self.faulty > 0.0 or self.worst.rejected > ESTIMATOR.often:
            return "bad"
        odd = self.worst.rejected > ESTIMATOR.rarely or self.disturbed > ESTIMATOR.often
        uneasy = odd or any(r.median > ESTIMATOR.usual for r in self.ratios)
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
    status = _found(recorded, topic, PX4, "{}_test_ratio", "filter_fault_flags", phases)
    return None if status is None else _with_compass(status, recorded, phases)


def _with_compass(found: Estimator, recorded: Recorded, phases: FlightPhases) -> Estimator:
    """The same with the ratios of the magnetic field, the largest of its axes, and what PX4's flags say.

    mag_test_ratio is low-passed, and of the heading, which need not come from the compass.
    """
    place = found.topic.replace("estimator_status", "estimator_innovation_test_ratios")
    field = _ratio("magnetometer", recorded, place, "mag_field", phases)
    others = tuple(ratio for ratio in found.ratios if field is None or ratio.of != field.of)
    flags = found.topic.replace("estimator_status", "estimator_status_flags")

    def share(name: str) -> float:
        return float(np.mean(values)) if len(values := _aloft(recorded.columns(flags, name), phases)) else 0.0

    sources = tuple(words for name, words in SOURCES.items() if share(name) > 0.5)
    ratios = others if field is None else (*others, field)
    return replace(found, ratios=ratios, disturbed=share("cs_mag_field_disturbed"), sources=sources)


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
    every = (_ratio(of, recorded, topic, form.format(name), phases) for of, name in fields.items())
    ratios = tuple(ratio for ratio in every if ratio is not None)
    if not ratios:
        return None
    flags = _aloft(recorded.columns(topic, faults), phases)
    fixes = [fix for names in FIXES if len(fix := _aloft(recorded.columns(*names), phases))]
    no_fix = bool(fixes) and max(float(fix.max()) for fix in fixes) < 2.0
    return Estimator(topic, ratios, float(np.mean(flags != 0.0)) if len(flags) else 0.0, no_fix=no_fix)


def _aloft(known: tuple[Array, Array] | None, phases: FlightPhases) -> Array:
    """The largest field (M,) of each message from the air, without those that are no number; empty of None."""
    if known is None:
        return np.zeros(0)
    values = known[1].max(axis=1)[phases.within(known[0], *AIRBORNE)]
    return np.asarray(values[np.isfinite(values)])


def _ratio(of: str, recorded: Recorded, topic: str, name: str, phases: FlightPhases) -> InnovationRatio | None:
    """Of a kind of measurement; zero, or no number, throughout: it is not used."""
    values = _aloft(recorded.columns(topic, name), phases)
    if not np.any(values > 0.0):
        return None
    median, high = (float(np.percentile(values, q)) for q in (50.0, 95.0))
    return InnovationRatio(of, topic, median, high, float(np.mean(values > ESTIMATOR.rejected)))
