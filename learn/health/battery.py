"""The battery: its voltage at rest, in flight and at the lowest, and whether it is one at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.check import Level
from wrenchgap.flight.flight import Flight
from wrenchgap.learn.health.phases import AIRBORNE, FlightPhases
from wrenchgap.learn.health.recorded import Recorded


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
RAW = (("battery_status", "voltage_v", 1.0), ("BAT", "Volt", 1.0), ("CURR", "Volt", 1.0))
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
    found = next((one for topic, name, _ in RAW if (one := recorded.columns(topic, name)) is not None), None)
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
