"""Is this log what it seems? Units, frames and stamps, asked of the data themselves, wherever a log is opened.

    channels    roles, sizes that betray a unit, channels without a reading, flat tops, gaps, jitter, clocks
    attitude    IMU against attitude: units, axes, gravity, frames
    gyroscope_scale  the gyroscope's scale against the attitude, to a per cent; its slow turns
    accelerometer_scale  the accelerometer against gravity and the odometry's acceleration
    sensor_windows  a sensor of the IMU and the odometry through the same windows of time
    sensor_scales  its scale by them, axis by axis; misread_axes: whether an axis reads another's
    late_sensors  whether one of the IMU's sensors is later than the other
    odometry    the odometry against itself and against the accelerometer
    wrench      the commanded force against the specific force
    masking     samples that cannot be true
    parameters  what an autopilot's parameters say of the log
    repeated    a part of the recording that stands in it twice
    motion      means over intervals, which all of these compare; the search for axes among 48, and for a rotation

Each check looks at one way in which real logs are wrong, and says what mends it (docs/checks.md). What needs the
vehicle is in `learn.data.checks.against_model`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks import (
    accelerometer_scale,
    attitude,
    channels,
    clipping,
    command_rate,
    gyroscope_scale,
    late_sensors,
    odometry,
    parameters,
    repeated,
    wrench,
)
from wrenchgap.flight.checks.masking import masked
from wrenchgap.flight.checks.motion import MotionMeans, motion_means
from wrenchgap.flight.clocks import Timing
from wrenchgap.flight.flight import Flight

ALONE: tuple[Callable[[Flight], Iterator[Check]], ...] = (
    channels.roles,
    channels.constant,
    channels.units,
    channels.unmeasured,
    channels.coarse,
    clipping.clipped,
    clipping.limited,
    channels.copied,
    channels.held,
    command_rate.sparse_commands,
    channels.stamps,
    channels.dropped,
    channels.damaged,
    repeated.repeated,
    parameters.changed_parameters,
    parameters.simulated,
)
AGAINST_ODOMETRY: tuple[Callable[[Flight, MotionMeans | None], Iterator[Check]], ...] = (
    attitude.accelerometer_unit,
    attitude.frames,
    attitude.gyroscope,
    odometry.odometry_rate,
    odometry.velocity,
    odometry.odometry_scale,
    wrench.wrench_frame,
)


def checks(flight: Flight) -> tuple[Check, ...]:
    """Everything that can be asked of a flight without knowing the vehicle, bad ones first."""
    found = [check for ask in ALONE for check in ask(flight)]
    if not any(check.name == "constant-channel" and check.level == "bad" for check in found):  # the IMU is stuck
        moved = motion_means(flight)
        found += [check for ask in AGAINST_ODOMETRY for check in ask(flight, moved)]
        found += gyroscope_scale.gyroscope_scale(flight, found)
        found += gyroscope_scale.slow_turns(flight, found)
        found += gyroscope_scale.gyroscope_bias(flight, found)
        found += accelerometer_scale.accelerometer_scale(flight, moved, found)
        found += late_sensors.late_sensors(flight, found)
    found = wrench.behind_body_frame(gyroscope_scale.without_factor(found), found)
    return tuple(sorted(found, key=lambda check: ("bad", "warn", "ok").index(check.level)))


def with_checks(flight: Flight, timing: Timing | None = None, vehicles: Sequence[tuple[str, str]] = ()) -> Flight:
    """The flight with its checks, and without samples that cannot be true; as it is where that was done before.

    `timing` and `vehicles` are those of the reader (`flight.clocks`, `flight.roles`).
    """
    if flight.checks is not None:
        return flight
    clean, unlikely, left = masked(flight)
    clocks = () if timing is None else channels.clocks(timing, flight.mapping)
    found = (*channels.vehicles(vehicles), *clocks, *unlikely, *checks(clean))
    return replace(clean, checks=found, left_out=(*flight.left_out, *left))
