"""Logs that somebody drops on a page that was started without a model: what `check` says of them, and a model for them.

Before there is a model a session of the page shows what the logs themselves hold; afterwards it is a `LogSession`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import wrenchgap as wg
from wrenchgap.flight import UsageError, so3, work_files
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.inspection import Channel, channels_of
from wrenchgap.flight.stamps import interpolated
from wrenchgap.learn.data.checks import usable_cutoff
from wrenchgap.learn.data.opening import open_flights
from wrenchgap.learn.data.read_options import ReadOptions
from wrenchgap.learn.health.health import Health, LogHealth
from wrenchgap.learn.health.phases import AIRBORNE
from wrenchgap.plant import Body, Model, Vehicle, model_file
from wrenchgap.plant.drafts.draft import Sheet
from wrenchgap.plant.drafts.sources import Given
from wrenchgap.plant.reader import text_of
from wrenchgap.replay.session.log_session import FLOORS, XYZ, LogSession
from wrenchgap.replay.session.saving import SaveFolder
from wrenchgap.viewer.session import Capabilities, MakePanel, Report, Scene, Series, Session, Stretch

NOTHING_YET = "no log yet"
FILTERED = ("imu", "actuators", "commanded")
"""Roles of which the low-pass has to leave something."""
LEAST_CUTOFF = 0.1
"""Of the form [Hz]."""
MOST_LOGS = 8
"""On the page: `check` shows them side by side."""
UNKNOWN = Vehicle("a vehicle without a model", Body(1.0, 0.01 * np.eye(3), np.zeros(3)), None, None, np.zeros(3))
"""What is drawn before there is a model: a ball of 0.3 m with a nose."""


def _folder() -> Path:
    """A new folder of this process, which ends with it."""
    return Path(tempfile.mkdtemp(dir=work_files.folder()))


def filtered(log: LogHealth) -> tuple[str, ...]:
    """Roles whose rates a filter has to go with: no normalised wrench where the motors' commands are logged."""
    flight = log.inspection.flight
    if flight is None or flight.actuators is None or flight.commanded is None or flight.commanded.unit == "N":
        return FILTERED
    return tuple(role for role in FILTERED if role != "commanded")


@dataclass(frozen=True)
class Intake:
    """Logs of one vehicle, what `check` says of them, and the model once there is one; changes make another intake.

    `options` say how logs are read, `save_to` where the page may save, `sheet` what was assumed of a model that was
    made here of what was `given`; `saved` says whether a file has the model. What is dropped lies in `dropped`.
    """

    logs: tuple[Path, ...] = ()
    model: Model | None = None
    options: ReadOptions = field(default_factory=ReadOptions)
    save_to: SaveFolder | None = None
    health: Health | None = None
    sheet: Sheet | None = None
    given: Given = field(default_factory=Given)
    saved: bool = True
    dropped: Path = field(default_factory=_folder)

    def with_file(self, path: Path, report: Report) -> Intake:
        """With another log, all being looked at again, or a model file. Raises LogError, UsageError, ModelError."""
        if path.suffix.lower() == ".toml":
            model = model_file.loads(text_of(path, "as a model file"))
            return self.with_model(replace(model, path=Path(path.name)), report)
        if len(self.logs) >= MOST_LOGS:
            raise UsageError(f"{path.name}: {MOST_LOGS} logs are open, as many as the page takes; start it again")
        return self.with_logs((*self.logs, path), report)

    def with_logs(self, logs: Sequence[Path], report: Report) -> Intake:
        """With these logs, looked at."""
        health = wg.check(list(logs), self.model, self.options, progress=report) if logs else None
        if health is not None and health.repeated:
            again, first = (Path(file).name for file in health.repeated[0])
            raise UsageError(f"{again}: the same log as {first}, which is open")
        return replace(self, health=health, logs=tuple(logs))

    def with_model(self, model: Model, report: Report, sheet: Sheet | None = None) -> Intake:
        """With another model, for whose rotors the logs are looked at again."""
        return replace(self, model=model, sheet=sheet, saved=sheet is None).with_logs(self.logs, report)

    def drafted(self, given: Given, report: Report) -> Intake:
        """With a model of what the first log says and what is `given`. Raises UsageError, ModelError, LogError."""
        known = self.logs and self.logs[0].suffix.lower() in (".ulg", ".bin", ".csv", ".parquet")
        sheet = wg.draft_model(self.logs[0] if known else None, given=given, command="wrenchgap view")
        return replace(self, given=given).with_model(sheet.model, report, sheet)

    @property
    def cutoff_hz(self) -> float:
        """The cut-off of the options, or a lower one for which motion and commands of all logs are fast enough [Hz]."""
        logs = () if self.health is None else self.health.logs
        slowest = min((r.hz for log in logs for r in log.rates if r.role in filtered(log)), default=np.inf)
        return min(self.options.low_pass_hz(self.model), max(usable_cutoff(slowest), LEAST_CUTOFF))

    def session(self, report: Report, first: MakePanel | None = None) -> Session:
        """What the page shows now, what was dropped last first: flights for the model, or what the logs hold.

        `first` is a tab before all others.
        """
        if self.model is None or not self.logs:
            return BareSession(self, first)
        report(0.0, "opening the flights")
        flights = open_flights(self.logs[::-1], self.model, self.options.changed(cutoff_hz=self.cutoff_hz))
        how: Any = {"folder": self.save_to, "budget": self.options.budget, "first": first, "saved": self.saved}
        return LogSession(flights, self.model, **how)


class BareSession:
    """Implements `viewer.session.Session` for logs without a model: attitude, path, commands, what the IMU measured."""

    def __init__(self, intake: Intake, first: MakePanel | None = None) -> None:
        seen = () if intake.health is None else intake.health.logs[::-1]
        names = [log.name for log in seen]
        told_apart = [n if names.count(n) == 1 else f"{n} ({k})" for k, n in enumerate(names, 1)]
        self._logs = dict(zip(told_apart, seen, strict=True))
        self.vehicle, self.flights = UNKNOWN, tuple(self._logs) or (NOTHING_YET,)
        self.capabilities = Capabilities(first=first, channels=self.channels)
        self._budget = intake.options.budget

    def channels(self, flight: str) -> Mapping[str, Channel]:
        """Everything in the log of this name; nothing where no topic of it plays a role."""
        log = self._logs.get(flight)
        found = None if log is None else log.inspection.flight
        return {} if found is None else channels_of(found.path, found, self._budget)

    def scene(self, flight: str) -> Scene:
        """What the log of this name holds."""
        log = self._logs.get(flight)
        if log is None or log.inspection.flight is None:
            return Scene(flight, np.array([0.0, 1.0]), np.zeros((2, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)))
        return recorded_alone(flight, log, log.inspection.flight)


def recorded_alone(name: str, log: LogHealth, flight: Flight, rate_hz: float = 50.0, most: int = 100_000) -> Scene:
    """A flight without any model, at `rate_hz` instants a second, or fewer where they were more than `most`.

    Position and attitude of the odometry, at rest at the origin without one; rates and specific force of the IMU and
    commands of the actuators in the units of the log.
    """
    ends = [(s.time[0], s.time[-1]) for s in flight.series().values() if len(s.time)]
    start, stop = min(a for a, _ in ends), max(b for _, b in ends)
    count = int(np.clip((stop - start) * rate_hz, 2, most))
    time = np.linspace(start, stop, count)
    position, quat = np.zeros((count, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    series: list[Series] = []
    odometry, imu, actuators = flight.odometry, flight.imu, flight.actuators
    if odometry is not None:
        place = np.nan_to_num(odometry.position_E)
        position = interpolated(time, odometry.time, place)
        if np.isfinite(odometry.quat_EB).all():
            quat = so3.interpolate(time, odometry.time, odometry.quat_EB)
    if imu is not None:
        series.append(_series("specific force", "m/s^2", "Sensors", imu.time, imu.specific_force_B, XYZ, count))
        series.append(_series("body rate", "rad/s", "Sensors", imu.time, imu.omega_B, XYZ, count))
    if actuators is not None and actuators.rotor_speed.size:
        names = [f"motor {k + 1}" for k in range(actuators.rotor_speed.shape[1])]
        series.append(
            _series("motor command", actuators.unit, "Actuators", actuators.time, actuators.rotor_speed, names, count)
        )
    gaps = tuple(
        Stretch(phase.start, phase.stop, str(phase.name)) for phase in log.phases.phases if phase.name not in AIRBORNE
    )
    return Scene(name, time, position, quat, series=tuple(series), gaps=gaps, notes=log.inspection.notes)


def _series(title: str, unit: str, group: str, time: Array, values: Array, names: Sequence[str], count: int) -> Series:
    """Columns of values (N, C), every so many samples that there are about `count` of them."""
    some = slice(None, None, max(1, len(time) // count))
    columns = dict(zip(names, values[some].T, strict=True))
    return Series(title, unit, time[some], columns, group, FLOORS.get(unit, 0.0))
