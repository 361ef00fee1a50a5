"""A contiguous stretch of a log on its control clock, ready to be re-simulated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.flight import Array, Flight, OdometrySeries, ReferenceSeries, Samples
from wrenchgap.learn.data.measurement import Record, commands_of
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.data.recorded_motion import CUTOFF_HZ, RecordedMotion, recorded_motion
from wrenchgap.learn.data.zero_order_hold import samples_over_periods
from wrenchgap.plant.closed_loop import Clock
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.tracking import Tracking, TrackingErrors, during, tracking_errors
from wrenchgap.plant.trajectory import Recorded, Reference
from wrenchgap.plant.vehicle import Vehicle


@dataclass(frozen=True)
class Recording:
    """One contiguous stretch of a flight on its control clock: N periods of `dt` [s] that begin at `time` (N,).

    Commands are what was held over each period: `desired`, `commanded` (N, 6), and `commands` with the actuators;
    `record` is the same stretch as models are compared on it.
    `first` and `count` say which periods are to be re-simulated; those before warm up what has memory.
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
    notes: tuple[object, ...]

    @property
    def window(self) -> slice:
        """The periods that are re-simulated."""
        return slice(self.first, self.first + self.count)

    @property
    def clock(self) -> Clock:
        """That of the window: one step a period."""
        voltage = self.motion.state.voltage
        return Clock(self.time[self.window], self.dt, voltage=None if voltage is None else voltage[self.window])

    @property
    def start(self) -> State:
        """The recorded state (N = 1) at the beginning of the window."""
        return self.motion.state.take(slice(self.first, self.first + 1))

    @property
    def reference_covers(self) -> bool:
        """Whether the log has a reference throughout the window; where not, its ends are held."""
        assert self.flight.reference is not None
        known, asked = self.flight.reference.time, self.time[self.window]
        return bool(asked[0] >= known[0] and asked[-1] <= known[-1] + 1.0)

    @property
    def tracking_errors(self) -> TrackingErrors:
        """Errors of the recorded flight within the window, by its odometry."""
        assert self.flight.reference is not None
        flown = during(self.odometry, self.time[self.window])
        asked = Recorded(self.flight.reference, start=0.0).at(flown.time)
        return tracking_errors(flown.time, flown.position_E, flown.quat_EB, asked)

    @property
    def tracking(self) -> Tracking:
        """Their averages."""
        return Tracking.of(self.tracking_errors)


def read_recording(
    opened: OpenFlight, vehicle: Vehicle, *, start: float = 0.0, duration: float | None = None
) -> Recording:
    """The part of a flight in which `start` [s] lies, or the longest that flew, ready for inference.

    Raises LogError where odometry or reference are missing, UsageError for times outside the flight.
    """
    log = opened.flight
    odometry, reference = _roles(log)
    index, first, count = _window(log.name, opened.flown, start, duration)
    if opened.flown[index].quat_EB is None:
        raise LogError(
            f"{log.path}: {odometry.topic} covers less than half of the flight, and a counterfactual starts from the "
            "recorded state; cut the log to where both are, or map another topic with --topic odometry=/your/topic"
        )
    samples = samples_over_periods(opened.flown[index], log)
    commands, _ = commands_of(samples, vehicle)
    return Recording(
        flight=log,
        odometry=odometry,
        reference=Recorded(reference, start=0.0).at(samples.time),
        motion=recorded_motion(samples, odometry, vehicle.imu_position_B, cutoff_hz=min(CUTOFF_HZ, 0.3 / samples.dt)),
        record=opened.records[index],
        time=samples.time,
        dt=samples.dt,
        desired=commands.wrench_B if samples.wrench_des_B is None else samples.wrench_des_B,
        commanded=commands.wrench_B,
        commands=commands,
        first=first,
        count=count,
        notes=opened.notes,
    )


def _roles(log: Flight) -> tuple[OdometrySeries, ReferenceSeries]:
    """The series without which there is nothing to re-simulate."""
    if log.odometry is not None and log.reference is not None:
        return log.odometry, log.reference
    lacks = "odometry" if log.odometry is None else "reference"
    needs = {"odometry": "starts from the recorded state", "reference": "flies along the recorded reference"}[lacks]
    raise LogError(
        f"{log.path}: a counterfactual {needs}, and no topic plays the role '{lacks}' (played: "
        f"{', '.join(log.series()) or 'none'}); map one with --topic {lacks}=/your/topic"
    )


def _window(name: str, stretches: tuple[Samples, ...], start: float, duration: float | None) -> tuple[int, int, int]:
    """Which stretch, and the first and number of its samples to re-simulate."""
    if not (np.isfinite(start) and start >= 0.0):
        raise UsageError(f"--start {start:g}: expected seconds since the log's first sample")
    if duration is not None and not (np.isfinite(duration) and duration > 0.0):
        raise UsageError(f"--duration {duration:g}: expected a positive number of seconds")
    containing = [i for i, s in enumerate(stretches) if s.time[0] - 0.5 <= start <= s.time[-1] - 1.0]
    if not containing and start > 0.0:
        spans = ", ".join(f"{s.time[0]:.2f} to {s.time[-1] - 1.0:.2f} s" for s in stretches)
        raise UsageError(f"--start {start:g}: {name} can be re-simulated within {spans}; choose a time in there")
    index = containing[0] if start > 0.0 else max(range(len(stretches)), key=lambda i: len(stretches[i]))
    chosen = stretches[index]
    first = int(np.searchsorted(chosen.time, start - 1e-9))
    available = len(chosen) - first
    count = available if duration is None else min(available, max(round(duration / chosen.dt), 2))
    return index, first, count
