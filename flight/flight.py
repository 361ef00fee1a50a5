"""What a flight is: series of stamped values, one per role, on one time base.

A *role* is what a topic means to the analysis, whatever its name and type. A `Flight` holds at most one series per
role. Times are seconds since `Flight.start_ns`, strictly increasing within a series. All values are SI; frames are E
(inertial, z up) and B (body, x forward, y left, z up); quaternions are scalar first and take B to E.
"""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.autopilot import Autopilot
from wrenchgap.flight.check import Check, TimeLeftOut

GRAVITY = 9.80665
"""Standard gravity [m/s^2], the one value that every layer uses; CGPM 1901, by definition."""
DEGREE, RPM = np.pi / 180.0, 2.0 * np.pi / 60.0
"""A degree [rad]; a turn a minute [rad/s]."""

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]
Stamps = NDArray[np.int64]
"""Times in ns since 1970, or since an autopilot's start."""

SpeedUnit = Literal["rad/s", "normalised", "pwm"]
"""In what rotor commands are: speeds, a share of full throttle, or pulse widths [us]."""
WrenchUnit = Literal["N", "normalised"]
"""In what a wrench is: N and Nm, or shares of what the vehicle can do."""

AXES = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")
"""Order of a wrench's six components, everywhere."""


@dataclass(frozen=True)
class Gap:
    """An interval between two samples that is too long to be bridged."""

    start: float  # s
    stop: float  # s


@dataclass(frozen=True)
class Series:
    """Samples of one role. `time` (N,) [s] is strictly increasing.

    `gaps` are the intervals that no computation may interpolate over. `dropped` counts samples that the reader left
    out, by reason, e.g. `{"not finite": 3, "stamp not increasing": 1}`.
    """

    topic: str
    time: Array
    gaps: tuple[Gap, ...] = field(default=(), kw_only=True)
    dropped: dict[str, int] = field(default_factory=dict, kw_only=True)

    @cached_property
    def period(self) -> float:
        """Median interval between samples [s]."""
        return float(np.median(np.diff(self.time)))


@dataclass(frozen=True)
class WrenchSeries(Series):
    """`wrench_B` (N, 6): force [N] then torque [Nm], in B, about the vehicle's (believed) centre of mass.

    Where `unit` is "normalised" the numbers are shares of the vehicle's authority, and not comparable to a measured
    wrench until a model converts them (`flight.command_units`).
    """

    wrench_B: Array
    unit: WrenchUnit = field(default="N", kw_only=True)


@dataclass(frozen=True)
class ActuatorSeries(Series):
    """`tilt` (N, A) [rad] and `rotor_speed` (N, R) [rad/s], as commanded; either may have no columns.

    Where `unit` is not "rad/s", `rotor_speed` holds a share of full throttle (0 to 1, negative: reversed) or pulse
    widths [us], as autopilots send them, until a model converts them (`flight.command_units`).
    """

    tilt: Array
    rotor_speed: Array
    unit: SpeedUnit = field(default="rad/s", kw_only=True)


@dataclass(frozen=True)
class ImuSeries(Series):
    """`omega_B` (N, 3) [rad/s] and `specific_force_B` (N, 3) [m/s^2] (an accelerometer's reading: +g up at rest).

    A column that is NaN throughout was not measured (`flight.unmeasured`).
    """

    omega_B: Array
    specific_force_B: Array


@dataclass(frozen=True)
class OdometrySeries(Series):
    """Pose and, where known, velocity of the body.

    `position_E` (N, 3) [m], `quat_EB` (N, 4), `velocity_E` (N, 3) [m/s] or None, `omega_B` (N, 3) [rad/s] or None.
    """

    position_E: Array
    quat_EB: Array
    velocity_E: Array | None = None
    omega_B: Array | None = None


@dataclass(frozen=True)
class ReferenceSeries(Series):
    """The trajectory that was asked for; D is the reference's body frame.

    `position_E` (N, 3), `quat_ED` (N, 4), `velocity_E` (N, 3) or None, `omega_D` (N, 3) or None; `acceleration_E`
    (N, 3) [m/s^2] and `omega_dot_D` (N, 3) [rad/s^2] where the log has them.
    """

    position_E: Array
    quat_ED: Array
    velocity_E: Array | None = None
    omega_D: Array | None = None
    acceleration_E: Array | None = None
    omega_dot_D: Array | None = None


@dataclass(frozen=True)
class BatterySeries(Series):
    """`voltage` (N,) [V]. `none` where it is throughout below what flies: a lithium cell is empty above 2.5 V."""

    voltage: Array

    @property
    def none(self) -> bool:  # noqa: D102
        return bool(np.max(self.voltage, initial=0.0) < 2.0)


SERIES: dict[str, type[Series]] = {
    "commanded": WrenchSeries,
    "desired": WrenchSeries,
    "actuators": ActuatorSeries,
    "imu": ImuSeries,
    "odometry": OdometrySeries,
    "reference": ReferenceSeries,
    "battery": BatterySeries,
}
"""What plays each role."""
ROLES = tuple(SERIES)
"""What a topic can mean: see `Flight` for each."""


@dataclass(frozen=True)
class Flight:
    """One recorded flight. Roles that the log does not play are None.

    commanded  what the controller sent to the allocation, after any compensation
    desired    what the controller wanted before compensation
    actuators  commanded tilt angles and rotor speeds
    imu        gyroscope and accelerometer
    odometry   pose and velocity (motion capture, estimator or simulator)
    reference  the trajectory that was asked for
    battery    its voltage

    `content_hash` is the SHA-256 of the file(s). `notes` are plain sentences that a user should read: what was assumed,
    repaired or left out. `shifts` [s] are by how much the user moved the stamps of a role
    (`flight.compared_signals.shifted`). `unmeasured` are axes that were not measured, with the reason
    (`flight.unmeasured`). `mapping` is where each part comes from, as in an override (`flight.roles`), empty where no
    file was read; `checks` is what `flight.checks` found when it was read, None where nobody has asked; `left_out` are
    times without samples that can be true; `autopilot` is None where none wrote the log. `command_option` is the value
    of `--topic` that maps commands which were not recognised. `firmware` is the one whose names the columns of a table
    have ("Crazyflie"), empty for other logs. `damage` are sentences on where the file holds less than was recorded.
    """

    name: str
    path: Path
    content_hash: str
    start_ns: int
    commanded: WrenchSeries | None = None
    desired: WrenchSeries | None = None
    actuators: ActuatorSeries | None = None
    imu: ImuSeries | None = None
    odometry: OdometrySeries | None = None
    reference: ReferenceSeries | None = None
    battery: BatterySeries | None = None
    notes: tuple[str, ...] = ()
    shifts: dict[str, float] = field(default_factory=dict)
    mapping: dict[str, str] = field(default_factory=dict)
    checks: tuple[Check, ...] | None = None
    left_out: tuple[TimeLeftOut, ...] = ()
    unmeasured: dict[str, str] = field(default_factory=dict)
    autopilot: Autopilot | None = None
    command_option: str = "commanded=/your/topic"
    firmware: str = ""
    damage: tuple[str, ...] = ()

    def __repr__(self) -> str:
        roles = ", ".join(f"{role} {len(series.time):,}" for role, series in self.series().items())
        return f"<Flight {self.name}: samples of {roles or 'no role'}>"

    def series(self) -> dict[str, Series]:
        """The roles that this flight plays, in the order of `ROLES`."""
        found = ((role, getattr(self, role)) for role in ROLES)
        return {role: series for role, series in found if series is not None}


@dataclass(frozen=True)
class Samples:
    """A contiguous stretch of a flight on one uniform clock: N samples, `time` (N,) [s since Flight.start_ns].

    There is no gap inside. Commands are what the plant held on average around each instant (see
    `flight.resample`). What the log lacks is None.

    wrench_cmd_B      (N, 6)  commanded wrench
    wrench_des_B      (N, 6)  desired wrench, before compensation
    tilt_cmd          (N, A)  [rad]
    rotor_speed_cmd   (N, R)  [rad/s]
    omega_B           (N, 3)  gyroscope, or odometry's rate where there is no IMU
    specific_force_B  (N, 3)  accelerometer, or from differentiated odometry velocity
    position_E, velocity_E (N, 3), quat_EB (N, 4)
    voltage           (N,)
    unmeasured        axes that the sensors did not measure (`flight.unmeasured`): what the columns of omega_B and
                      specific_force_B hold there is the odometry's, and NaN where there is none
    """

    flight: str
    time: Array
    dt: float
    omega_B: Array
    specific_force_B: Array
    wrench_cmd_B: Array | None = None
    wrench_des_B: Array | None = None
    tilt_cmd: Array | None = None
    rotor_speed_cmd: Array | None = None
    position_E: Array | None = None
    velocity_E: Array | None = None
    quat_EB: Array | None = None
    voltage: Array | None = None
    unmeasured: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.time)
