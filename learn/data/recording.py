"""A contiguous stretch of a log on its control clock, ready to be flown again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrenchgap import flight
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.flight import Flight, OdometrySeries, ReferenceSeries, Samples, Series
from wrenchgap.flight.resample import held_mean
from wrenchgap.learn.data.measurement import Record, prepare
from wrenchgap.learn.data.recorded_motion import CUTOFF_HZ, RecordedMotion, recorded_motion
from wrenchgap.plant.state import Commands
from wrenchgap.plant.trajectory import Recorded, Reference
from wrenchgap.plant.vehicle import Vehicle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Recording:
    """One contiguous stretch of a flight on its control clock: N periods of `dt` [s] that begin at `time` (N,).

    Commands are what was held over each period: `desired`, `commanded` (N, 6), and `commands` with the actuators;
    `record` is the same stretch as models are compared on it.
    `first` and `count` say which periods are to be flown again; those before warm up what has memory.
    """

    flight: Flight
    odometry: OdometrySeries
    reference: Reference
    motion: RecordedMotion
    record: Record
    time: Array
    dt: float
    desired: Array
    commanded: Array
    commands: Commands
    first: int
    count: int
    notes: tuple[str, ...]

    @property
    def window(self) -> slice:
        """The periods that are flown again."""
        return slice(self.first, self.first + self.count)


def read_recording(
    log: Flight,
    vehicle: Vehicle,
    *,
    start: float = 0.0,
    duration: float | None = None,
    cutoff_hz: float = CUTOFF_HZ,
) -> Recording:
    """The stretch of a log in which `start` [s] lies, or the longest, ready for inference.

    Raises LogError where commands, odometry or reference are missing, UsageError for times outside the flight.
    """
    odometry, reference = _roles(log)
    leader = log.commanded if log.commanded is not None else log.actuators
    assert leader is not None
    held = ("commanded",) if log.commanded is not None else ("actuators",)
    imu = ("imu",) if log.imu is not None else ()
    resampled = flight.resample(log, require=(*held, "odometry", *imu))
    samples, first, count = _window(log, resampled.samples, start, duration)
    samples = _held(samples, log)
    record = prepare(samples, vehicle)
    knots = Recorded(reference, start=0.0)
    notes = [*log.notes, *resampled.notes]
    uncovered = samples.time[first] < reference.time[0] or samples.time[first + count - 1] > reference.time[-1] + 1.0
    if uncovered:
        notes.append(f"{log.name}: the reference covers only a part of the re-flight; its ends are held.")
    commanded = record.commands.wrench_B
    return Recording(
        flight=log,
        odometry=odometry,
        reference=knots.at(samples.time),
        motion=recorded_motion(samples, odometry, vehicle.imu_position_B, cutoff_hz=min(cutoff_hz, 0.3 / samples.dt)),
        record=record,
        time=samples.time,
        dt=samples.dt,
        desired=commanded if samples.wrench_des_B is None else samples.wrench_des_B,
        commanded=commanded,
        commands=record.commands,
        first=first,
        count=count,
        notes=tuple(notes),
    )


def _roles(log: Flight) -> tuple[OdometrySeries, ReferenceSeries]:
    """The series without which there is nothing to fly again."""
    played = ", ".join(log.series()) or "none"
    if log.odometry is None:
        raise LogError(
            f"{log.path}: a counterfactual starts from the recorded state, and no topic plays the role 'odometry' "
            f"(played: {played}); map one with --topic odometry=/your/topic"
        )
    if log.reference is None:
        raise LogError(
            f"{log.path}: a counterfactual flies along the recorded reference, and no topic plays the role 'reference' "
            f"(played: {played}); map one with --topic reference=/your/topic"
        )
    if log.commanded is None and log.actuators is None:
        raise LogError(
            f"{log.path}: no topic plays the role 'commanded' or 'actuators' (played: {played}); "
            "map one with --topic commanded=/your/topic"
        )
    return log.odometry, log.reference


def _window(
    log: Flight, stretches: tuple[Samples, ...], start: float, duration: float | None
) -> tuple[Samples, int, int]:
    """The stretch, and the first and number of its samples to fly again."""
    if not (np.isfinite(start) and start >= 0.0):
        raise UsageError(f"--start {start:g}: expected seconds since the log's first sample")
    if duration is not None and not (np.isfinite(duration) and duration > 0.0):
        raise UsageError(f"--duration {duration:g}: expected a positive number of seconds")
    containing = [s for s in stretches if start <= s.time[-1] - 1.0]
    if start == 0.0:
        chosen = max(stretches, key=len)
    elif containing and start >= containing[0].time[0] - 0.5:
        chosen = containing[0]
    else:
        spans = ", ".join(f"{s.time[0]:.2f} to {s.time[-1] - 1.0:.2f} s" for s in stretches)
        raise UsageError(f"--start {start:g}: {log.name} can be flown again within {spans}; choose a time in there")
    first = int(np.searchsorted(chosen.time, start - 1e-9))
    available = len(chosen) - first
    count = available if duration is None else min(available, max(round(duration / chosen.dt), 2))
    return chosen, first, count


def _held(samples: Samples, log: Flight) -> Samples:
    """The samples with commands averaged over the period that begins at each instant, as the plant holds them.

    (`flight.resample` averages *around* each instant, half a period earlier, which is what a measurement sees.)
    """

    def mean(series: Series, values: Array) -> Array:
        run = (series.time >= samples.time[0] - 1.0) & (series.time <= samples.time[-1] + 1.0)
        middle = samples.time + 0.5 * samples.dt
        return held_mean(middle, series.time[run], values[run], series.period, samples.dt)

    used: dict[str, Array] = {}
    if samples.wrench_cmd_B is not None and log.commanded is not None:
        used["wrench_cmd_B"] = mean(log.commanded, log.commanded.wrench_B)
    if samples.wrench_des_B is not None and log.desired is not None:
        used["wrench_des_B"] = mean(log.desired, log.desired.wrench_B)
    if samples.rotor_speed_cmd is not None and log.actuators is not None:
        used["tilt_cmd"] = mean(log.actuators, log.actuators.tilt)
        used["rotor_speed_cmd"] = mean(log.actuators, log.actuators.rotor_speed)
    return replace(samples, **used)  # type: ignore[arg-type]
