"""A flight on one uniform clock, in stretches without gaps.

Commands are held by the plant from one to the next, so what acts around an instant t is the mean of the held signal,

    u(t) = 1/T  integral of u_held over [t - T/2, t + T/2],    T = max(grid step, command period).

For T = one command period this is the straight line between commands, read half a period *earlier*: a command that was
just sent has not acted yet. It is the only delay that a perfect plant has, and it must be taken out here, or a fit
will find it as half a period of lag.

Measurements are low-passed without phase before their rate is reduced, then interpolated; attitudes along the
shortest rotation.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import row_kernels, so3
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.filters import angular_velocity, smooth
from wrenchgap.flight.flight import AXES, GRAVITY, ROLES, Array, Flight, Gap, OdometrySeries, Samples, Series
from wrenchgap.flight.memory import give_back, on_disk
from wrenchgap.flight.stamps import interpolated, nominal_period
from wrenchgap.flight.unmeasured import unmeasured_axes


@dataclass(frozen=True)
class ResamplingSettings:
    """How a flight is put on one clock."""

    maximum_rate: float = 250.0
    """Highest rate of the clock [Hz] that is chosen by itself."""
    anti_alias_ratio: float = 1.3
    """A series that is faster than this many rates of the clock is low-passed first."""
    anti_alias_cutoff: float = 0.4
    """Cut-off of that low-pass, over the clock's rate."""
    force_window: float = 0.15
    """Length [s] of local fits that turn a velocity into an acceleration."""
    minimum_cover: float = 0.5
    """Share of the flight below which a role that is not required is left out."""


GRID = ResamplingSettings()


_HELD = ("commanded", "desired", "actuators")
_USED = ("commanded", "desired", "actuators", "imu", "odometry")

Interval = tuple[float, float]


@dataclass(frozen=True)
class Resampling:
    """`samples` in order of time; `rate` [Hz]; `notes` say what was left out or stands in for something else.

    `covered` [s] is the sum of the stretches, `span` [s] the time from the first to the last sample of the flight,
    `short` the stretches that were too short to keep.
    """

    samples: tuple[Samples, ...]
    rate: float
    covered: float
    span: float
    short: tuple[Gap, ...]
    notes: tuple[str, ...]


def uniform(
    flight: Flight,
    rate: float | None = None,
    require: tuple[str, ...] = ("commanded", "imu"),
    minimum_duration: float = 2.0,
) -> list[Samples]:
    """The stretches of `resample`."""
    return list(resample(flight, rate, require, minimum_duration).samples)


def resample(
    flight: Flight,
    rate: float | None = None,
    require: tuple[str, ...] = ("commanded", "imu"),
    minimum_duration: float = 2.0,
) -> Resampling:
    """Put a flight on a uniform clock of `rate` [Hz], by default that of its commands, at most `GRID.maximum_rate`.

    A stretch is where all used roles have samples; it ends at every gap of any of them. Roles beyond `require` are
    used where the log plays them. Without an IMU, rates and specific force come from the odometry. Stretches shorter
    than `minimum_duration` [s] are left out and counted.

    Raises LogError where the log lacks a required role, or no stretch is long enough.
    """
    _check_requirements(flight, require)
    notes: list[str] = []
    grid_rate = _grid_rate(flight, rate)
    series = _used_series(flight, require, grid_rate, notes)
    if "imu" not in series:
        known = flight.odometry is not None and flight.odometry.omega_B is not None
        source = "odometry's twist" if known else "differentiated attitude"
        notes.append(
            f"{flight.name}: no IMU; rates come from the {source}, specific force from differentiated velocity."
        )
    stretches = _intersection([_cover(role, item, 1.0 / grid_rate) for role, item in series.items()])
    shortest = max(minimum_duration, 4.0 / grid_rate)
    kept = [(start, stop) for start, stop in stretches if stop - start >= shortest]
    short = [(start, stop) for start, stop in stretches if stop - start < shortest]
    if not kept:
        longest = max((stop - start for start, stop in stretches), default=0.0)
        raise LogError(
            f"{flight.path}: no stretch of {shortest:g} s in which {', '.join(series)} all have samples "
            f"(longest {longest:.2f} s); see `wrenchgap inspect` for rates and gaps"
        )
    if short:
        words = f"shorter than {shortest:g} s left out ({_length(short):.2f} s)"
        notes.append(f"{flight.name}: {len(short)} stretch(es) {words}.")
    samples = tuple(_samples(flight, series, interval, grid_rate) for interval in kept)
    every = [item.time for item in series.values()]
    span = max(time[-1] for time in every) - min(time[0] for time in every)
    gaps = tuple(Gap(*interval) for interval in short)
    return Resampling(samples, grid_rate, float(_length(kept)), float(span), gaps, tuple(notes))


def _check_requirements(flight: Flight, require: tuple[str, ...]) -> None:
    played = flight.series()
    for role in require:
        if role not in ROLES:
            raise UsageError(f"require={role!r}: no such role; roles: {', '.join(ROLES)}")
        if role not in played and not (role == "imu" and "odometry" in played):
            raise LogError(
                f"{flight.path}: no topic plays the role {role!r}; played: {', '.join(played) or 'none'}. "
                f"Map one with --topic {role}=/your/topic"
            )
    if "imu" not in played and "odometry" not in played:
        lacking = f"neither an IMU nor an odometry; played: {', '.join(played)}"
        raise LogError(f"{flight.path}: {lacking}. Map one with --topic imu=/your/topic")


def _grid_rate(flight: Flight, rate: float | None) -> float:
    if rate is not None:
        if not (np.isfinite(rate) and rate > 0):
            raise UsageError(f"rate {rate}: expected a positive number of Hz")
        return float(rate)
    played = flight.series()
    leader = next(played[role] for role in ("commanded", "actuators", "imu", "odometry") if role in played)
    native = min(1.0 / nominal_period(leader.time), GRID.maximum_rate)
    return float(round(native)) if abs(native - round(native)) < 0.002 * native else native


def _used_series(flight: Flight, require: tuple[str, ...], rate: float, notes: list[str]) -> dict[str, Series]:
    """Required roles, and others that are there for most of the time in which the required ones are."""
    played = {role: item for role, item in flight.series().items() if role in _USED}
    needed = {*require, "imu" if "imu" in played else "odometry"} & played.keys()
    core = _intersection([_cover(role, played[role], 1.0 / rate) for role in needed])
    used: dict[str, Series] = {}
    for role, item in played.items():
        both = core if role in needed else _intersection([core, _cover(role, item, 1.0 / rate)])
        if _length(both) < GRID.minimum_cover * _length(core):
            notes.append(f"{flight.name}: {role} covers less than half of the flight: left out.")
        else:
            used[role] = item
    return used


def _length(intervals: list[Interval]) -> float:
    return sum(stop - start for start, stop in intervals)


def _cover(role: str, series: Series, step: float) -> list[Interval]:
    """Where a series can be evaluated; that of a held one reaches until its last command has acted."""
    runs = [(float(series.time[a]), float(series.time[b - 1])) for a, b in _runs(series) if b - a >= 2]
    if role not in _HELD:
        return runs
    window = max(step, series.period)
    return [(start + window / 2, stop + series.period - window / 2) for start, stop in runs]


def _runs(series: Series) -> list[tuple[int, int]]:
    """Index ranges [a, b) between gaps."""
    cuts = [int(np.searchsorted(series.time, gap.stop)) for gap in series.gaps]
    return list(zip([0, *cuts], [*cuts, len(series.time)], strict=True))


def _intersection(covers: list[list[Interval]]) -> list[Interval]:
    common = covers[0] if covers else []
    for cover in covers[1:]:
        common = [(max(a, c), min(b, d)) for a, b in common for c, d in cover if min(b, d) > max(a, c)]
    return common


def _samples(flight: Flight, series: dict[str, Series], interval: Interval, rate: float) -> Samples:
    first, last = np.ceil(interval[0] * rate - 1e-6), np.floor(interval[1] * rate + 1e-6)
    time = np.arange(first, last + 1) / rate
    on = _Grid(time, rate, interval)
    used = {role: getattr(flight, role) if role in series else None for role in _USED}
    commanded, desired, actuators, imu, odometry = (used[role] for role in _USED)
    found: dict[str, Any] = {}

    def keep(name: str, values: Array) -> None:
        found[name] = on_disk(values)
        give_back(len(values))

    absent = tuple(unmeasured_axes(flight))
    if imu is None:
        motion = on.inertial(odometry)
    else:
        motion = on.measured(imu, imu.omega_B), on.measured(imu, imu.specific_force_B)
        if absent:
            motion = _instead(flight, absent, motion, odometry and on.inertial(odometry))
    keep("omega_B", motion[0])
    keep("specific_force_B", motion[1])
    if commanded is not None:
        keep("wrench_cmd_B", on.held(commanded, commanded.wrench_B))
    if desired is not None:
        keep("wrench_des_B", on.held(desired, desired.wrench_B))
    if actuators is not None:
        keep("tilt_cmd", on.held(actuators, actuators.tilt))
        keep("rotor_speed_cmd", on.held(actuators, actuators.rotor_speed))
    if odometry is not None:
        keep("position_E", on.measured(odometry, odometry.position_E))
        keep("velocity_E", on.measured(odometry, _velocity_E(odometry, on.run(odometry))))
        keep("quat_EB", on.attitude(odometry))
    if flight.battery is not None and not flight.battery.none:
        found["voltage"] = np.interp(time, flight.battery.time, flight.battery.voltage)
    return Samples(flight=flight.name, time=on_disk(time), dt=1.0 / rate, unmeasured=absent, **found)


def _instead(
    flight: Flight, absent: tuple[str, ...], motion: tuple[Array, Array], seen: tuple[Array, Array] | None
) -> tuple[Array, Array]:
    """Rates and specific force (N, 3) with the odometry's where the IMU did not measure, NaN where there is none.

    Raises LogError for rates that nothing tells: every effect that depends on the motion needs them.
    """
    omega_B, force_B = motion[0].copy(), motion[1].copy()
    for axis in absent:
        column = AXES.index(axis) % 3
        if axis in AXES[:3]:
            force_B[:, column] = np.nan if seen is None else seen[1][:, column]
        elif seen is not None:
            omega_B[:, column] = seen[0][:, column]
        else:
            raise LogError(
                f"{flight.path}: the gyroscope did not measure about {'xyz'[column]}, and no odometry tells the rate "
                "there; map one with --topic odometry=/your/topic"
            )
    return omega_B, force_B


@dataclass(frozen=True)
class _Grid:
    """Evaluates series at `time`, all inside one `interval` without gaps."""

    time: Array
    rate: float
    interval: Interval

    def run(self, series: Series) -> slice:
        """The samples of a series between the gaps around the interval."""
        middle = 0.5 * (self.interval[0] + self.interval[1])
        a, b = next((a, b) for a, b in reversed(_runs(series)) if series.time[a] <= middle)
        return slice(a, b)

    def held(self, series: Series, values: Array) -> Array:
        run = self.run(series)
        window = max(1.0 / self.rate, series.period)
        return held_mean(self.time, series.time[run], values[run], series.period, window)

    def measured(self, series: Series, values: Array) -> Array:
        run = self.run(series)
        return interpolated(self.time, series.time[run], self._anti_aliased(series.time[run], values[run]))

    def attitude(self, odometry: OdometrySeries) -> Array:
        run = self.run(odometry)
        quat = so3.continuous(odometry.quat_EB[run])
        filtered = so3.normalise(self._anti_aliased(odometry.time[run], quat))
        return so3.interpolate(self.time, odometry.time[run], filtered)

    def inertial(self, odometry: OdometrySeries | None) -> tuple[Array, Array]:
        """omega_B and the specific force R_EB^T (dv_E/dt + g e_z) that an IMU at the odometry's origin would read."""
        assert odometry is not None  # resample has asked for one or the other
        run = self.run(odometry)
        time, quat_EB = odometry.time[run], odometry.quat_EB[run]
        omega_B = angular_velocity(time, quat_EB) if odometry.omega_B is None else odometry.omega_B[run]
        acceleration_E = smooth(time, _velocity_E(odometry, run)[run], GRID.force_window, derivative=1)
        force_B = so3.rotate_inverse(quat_EB, acceleration_E + np.array([0.0, 0.0, GRAVITY]))
        at = self.time
        return tuple(interpolated(at, time, self._anti_aliased(time, v)) for v in (omega_B, force_B))  # type: ignore[return-value]

    def _anti_aliased(self, time: Array, values: Array) -> Array:
        sections = anti_alias(time, self.rate)
        if sections is None:
            return values
        from scipy.signal import sosfiltfilt  # here: others need not wait for it

        return np.asarray(sosfiltfilt(sections, values, axis=0, padlen=min(len(time) - 1, 60)))


def anti_alias(stamps: Array, rate: float) -> Array | None:
    """Sections (S, 6) of the filter that readings at `stamps` (K,) pass forward and backward before a clock of `rate`.

    None where the readings are not much faster than the clock.
    """
    native = 1.0 / float(np.median(np.diff(stamps)))
    if native <= GRID.anti_alias_ratio * rate or len(stamps) < 16:
        return None
    from scipy.signal import butter  # here: others need not wait for it

    return np.asarray(butter(4, GRID.anti_alias_cutoff * rate, fs=native, output="sos"))


def held_mean(time: Array, stamps: Array, values: Array, period: float, window: float) -> Array:
    """Mean over `window` [s] around each `time` (N,), increasing, of `values` (K, C) held from each stamp to the next.

    The last is held for one `period`.
    """
    knots = np.append(stamps, stamps[-1] + period)
    times, rows = (np.ascontiguousarray(item, dtype=float) for item in (time, values))
    return np.asarray(row_kernels.held_mean(times, knots, rows, float(window)))


def _velocity_E(odometry: OdometrySeries, run: slice) -> Array:
    """Logged velocity (N, 3), or the differentiated position within `run` (zero elsewhere)."""
    if odometry.velocity_E is not None:
        return odometry.velocity_E
    velocity: NDArray[np.float64] = np.zeros_like(odometry.position_E)
    velocity[run] = smooth(odometry.time[run], odometry.position_E[run], GRID.force_window, derivative=1)
    return velocity
