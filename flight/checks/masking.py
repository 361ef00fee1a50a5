"""Samples that cannot be true: spikes, and channels that stand still while the flight goes on. Left out, and said.

A spike is beyond what is physically possible *and* far beyond everything else on its channel: a channel in another unit
is large throughout, and has no spikes. A channel has frozen where one that otherwise changes with every sample repeats
itself for a while, away from the ends of the log and from the channel's own limits (a command may rest at those, and
where the ground carries the vehicle), while most of the other channels go on: at rest everything stands still. A sensor
of the IMU, or the odometry, may also have died, until the end of the log: there the other sensors alone are asked,
because commands go on where a vehicle has landed. A rotor's command has died where it stands still to the end, at no
limit and with the thrust of flight, while the other rotors', or the IMU, go on. Of an odometry that stands still the
IMU is asked in means, which its noise at rest does not move.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from wrenchgap.flight import row_kernels
from wrenchgap.flight.check import Check, TimeLeftOut
from wrenchgap.flight.flight import Array, Flight, Mask, Series
from wrenchgap.flight.stamps import gaps_of

LIMITS = {"specific_force_B": 500.0, "omega_B": 100.0, "velocity_E": 300.0, "position_E": 1e5}
"""Beyond these nothing flies: 50 g, 5700 deg/s, 300 m/s, 100 km."""


@dataclass(frozen=True)
class MaskThresholds:
    """From when on samples cannot be true."""

    spike: float = 10.0
    """Times the 95th percentile of its channel that a spike is at least."""
    rare: float = 0.04
    """Share of the samples that spikes are at most."""
    frozen_seconds: float = 0.5
    """Time [s] for which a frozen channel repeats itself."""
    frozen_samples: int = 25
    """Samples for which a frozen channel repeats itself."""
    lively: float = 0.05
    """Share of repeated values of a channel that otherwise changes with every sample."""
    leap: float = 5.0
    """Times the 99th percentile of its steps by which a channel leaps to a value and from it."""
    stirring: float = 0.2
    """Share of its usual steps that another channel makes where the flight goes on."""
    alive: float = 0.5
    """Share of the other sensors' channels that go on where one of the IMU has died and the vehicle has not landed."""
    going_on: float = 0.25
    """The same of other channels where one stands still for a while."""
    largest_share: float = 0.5
    """Share of the flight that may be frozen."""
    carried: float = 0.7
    """Share of what the accelerometer reads below which a commanded thrust does not carry the vehicle: the ground does.
    Thrusts and readings are relative to those of the flight."""
    flies: float = 0.5
    """Share of the thrust of the flight from which on the vehicle flies."""


MASKING = MaskThresholds()


WATCHED = {
    "imu": ("omega_B", "specific_force_B"),
    "odometry": ("position_E", "quat_EB", "velocity_E", "omega_B"),
    "commanded": ("wrench_B",),
    "actuators": ("rotor_speed", "tilt"),
}
"""Channels that are watched, by role."""
LIMITED = frozenset({"commanded", "actuators"})
"""Roles whose channels may rest at a limit."""


def masked(flight: Flight) -> tuple[Flight, tuple[Check, ...], tuple[TimeLeftOut, ...]]:
    """The flight without samples that cannot be true, what was found, and the times that are left out."""
    found: list[Check] = []
    for role, series in flight.series().items():
        bad = spikes(series)
        if bad.any():
            flight = without(flight, role, bad, "beyond what is possible")
            words = f"{role}: {int(bad.sum())} sample(s) are beyond what is physically possible: left out"
            found.append(Check("spikes", "warn", f"{words}."))
    frozen: dict[str, list[tuple[float, float, str]]] = {}
    for role, start, stop, channel in (*_frozen(flight), *_dead_rotors(flight)):
        frozen.setdefault(role, []).append((start, stop, channel))
    left: list[TimeLeftOut] = []
    support = _Support(flight)
    for role, runs in frozen.items():
        series = flight.series()[role]
        bad = np.any([(series.time > a) & (series.time <= b) for a, b, _ in runs], axis=0)
        share = float(bad.mean())
        names = ", ".join(dict.fromkeys(name for *_, name in runs))
        a, b = runs[0][:2]
        words = f"{role} ({names}) stands still for {b - a:.2f} s at {a:.2f} s"
        words += ", to the end of the log" if runs[0][1] == series.time[-1] else ""
        more = len({run[:2] for run in runs if run[0] >= b or run[1] <= a})
        words += f" and {more} time(s) more" if more else ""
        if share > MASKING.largest_share:
            mend = f"--topic {role}=none" if role in ("imu", "odometry") else None
            found.append(Check("frozen", "bad", f"{words}, {100 * share:.0f} % of the log", mend))
            continue
        flies = ", in mid-flight" if any(support.flies(start, stop) for start, stop, _ in runs) else ""
        found.append(Check("frozen", "warn", f"{words}{flies}: left out."))
        left += [TimeLeftOut(flight.name, a, b, f"{role} ({name}) stands still") for a, b, name in runs]
        flight = without(flight, role, bad, "frozen")
    return flight, tuple(found), tuple(left)


def spikes(series: Series) -> Mask:
    """Samples (N,) of which a value is beyond what is possible and beyond its channel."""
    bad = np.zeros(len(series.time), dtype=bool)
    for name, limit in LIMITS.items():
        values = getattr(series, name, None)
        if values is None:
            continue
        beyond = np.zeros(len(values), dtype=bool)
        for column in values.T:
            size = np.nan_to_num(np.abs(column))
            if size.max() > limit:
                beyond |= (size > limit) & (size > MASKING.spike * np.percentile(size, 95))
        if beyond.any() and beyond.mean() <= MASKING.rare:
            bad |= beyond
    return bad


def without(flight: Flight, role: str, bad: Mask, why: str) -> Flight:
    """The flight without some samples of a role, counted as dropped; what is too long to be bridged is a gap."""
    series = flight.series()[role]
    keep = ~bad
    if keep.sum() < 2:
        return flight
    arrays: dict[str, Any] = {
        name: value[keep] for name, value in vars(series).items() if isinstance(value, np.ndarray)
    }
    dropped = {**series.dropped, why: series.dropped.get(why, 0) + int(bad.sum())}
    replaced: dict[str, Any] = {role: replace(series, **arrays, gaps=gaps_of(arrays["time"]), dropped=dropped)}
    return replace(flight, **replaced)


def _frozen(flight: Flight) -> Iterator[tuple[str, float, float, str]]:
    """Role, start and stop [s] and channel of every run of repeated values that nothing explains.

    A command may rest at its limit: rotors at full speed hold every torque, in the wrench as well. A channel of the IMU
    has died where most channels of the odometry and of the IMU's other sensor go on to the end, one of the odometry
    where most of the IMU do.
    """
    series = {role: s for role, s in flight.series().items() if role in WATCHED}
    lively = {role: _lively(s, WATCHED[role]) for role, s in series.items()}
    sensors, support = series.keys() & {"imu", "odometry"}, _Support(flight)

    def at_limit(start: float, stop: float) -> bool:
        for role in series.keys() & LIMITED:
            a, b = np.searchsorted(series[role].time, (start, stop))
            if b > a and any(np.ptp(c[a:b]) == 0.0 and c[a] in (c.min(), c.max()) for _, c, _ in lively[role]):
                return True
        return False

    def others_go_on(role: str, name: str, start: float, stop: float) -> bool:
        ends = stop == series[role].time[-1]
        lost = ends and role == "odometry"
        alone = not ends and sensors == {role} == {"imu"}
        moving = []
        for other in lively.keys() & ({*series} if alone else {*sensors, role}):  # motors idle on the ground
            for label, column, _ in lively[other]:
                alike = label.partition(" ")[0] == name.partition(" ")[0] if ends else label == name
                if other != role or not (alike or lost):
                    moving.append(_moves(*_means(series[other], column, lost), start, stop))
        return _most(moving, MASKING.alive if ends else MASKING.going_on, fewest=2)

    for role, channels in lively.items():
        for name, values, longest in channels:
            if longest < MASKING.frozen_samples:
                continue
            for start, stop, jumps in _runs(series[role].time, values, limited=role in LIMITED, dies=role in sensors):
                held = role in LIMITED and not jumps
                explained = held and (support.by_ground(start, stop) or at_limit(start, stop))
                if not explained and others_go_on(role, name, start, stop):
                    yield role, start, stop, name


def _dead_rotors(flight: Flight) -> Iterator[tuple[str, float, float, str]]:
    """The same of rotors whose command stands still to the end; an output that seldom changes is no rotor's."""
    actuators, imu, support = flight.actuators, flight.imu, _Support(flight)
    if actuators is None or len(actuators.time) < 4 * MASKING.frozen_samples:
        return
    time, speeds = actuators.time, actuators.rotor_speed
    changes = np.diff(speeds, axis=0) != 0.0
    for k, column in enumerate(speeds.T):
        first = int(np.max(np.flatnonzero(changes[:, k]), initial=-1)) + 1
        start, stop = float(time[first]), float(time[-1])
        short = len(time) - first <= MASKING.frozen_samples or stop - start < MASKING.frozen_seconds
        if short or column[-1] in (column.min(), column.max()) or not support.carries(start, stop):
            continue
        usual = np.mean(changes[:first], axis=0)
        others = [(time, speeds[:, j]) for j in range(speeds.shape[1]) if j != k]
        sensors = [] if imu is None else [(imu.time, v) for v in (*imu.omega_B.T, *imu.specific_force_B.T)]
        moving = [[_moves(at, values, start, stop) for at, values in group] for group in (others, sensors)]
        if usual[k] > MASKING.alive * np.median(usual) and any(_most(group) for group in moving):
            yield "actuators", start, stop, f"rotor_speed {k}"


def _most(moving: Sequence[bool | None], least: float = MASKING.alive, fewest: int = 1) -> bool:
    """Whether more than the share `least` of the channels that have samples, `fewest` at least, go on."""
    known = [one for one in moving if one is not None]
    return len(known) >= fewest and float(np.mean(known)) > least


class _Support:
    """What carries the vehicle: its thrust, as commanded, or the ground, as the accelerometer shows."""

    def __init__(self, flight: Flight) -> None:
        self.thrust = self.reading = None
        if flight.commanded is not None:
            self.thrust = flight.commanded.time, np.linalg.norm(flight.commanded.wrench_B[:, :3], axis=1)
        elif flight.actuators is not None and flight.actuators.rotor_speed.shape[1]:
            self.thrust = flight.actuators.time, np.mean(flight.actuators.rotor_speed**2, axis=1)
        if flight.imu is not None:
            self.reading = flight.imu.time, np.linalg.norm(flight.imu.specific_force_B, axis=1)

    def flies(self, start: float, stop: float) -> bool:
        """Whether the thrust within, or where it is lost before, is large enough to fly."""
        return self.carries(start, stop) or self.carries(start - 0.5, start)

    def carries(self, start: float, stop: float) -> bool:
        """Whether the thrust within is large enough to fly."""
        return _of_usual(self.thrust, start, stop) > MASKING.flies

    def by_ground(self, start: float, stop: float) -> bool:
        """Whether the accelerometer reads what this little thrust cannot make."""
        thrust, reading = _of_usual(self.thrust, start, stop), _of_usual(self.reading, start, stop)
        return 0.0 <= thrust < MASKING.carried * reading


def _of_usual(signal: tuple[Array, Array] | None, start: float, stop: float) -> float:
    """Median of a size within an interval, in units of its upper quartile; -1 where it is not known."""
    if signal is None:
        return -1.0
    time, size = signal
    a, b = np.searchsorted(time, (start, stop))
    usual = float(np.percentile(size, 75))
    return float(np.median(size[a:b])) / usual if b > a and usual > 0.0 else -1.0


class _Channel(NamedTuple):
    """A channel, its samples (N,), and how often it repeats itself in a row at most."""

    name: str
    values: Array
    longest: int


def _lively(series: Series, names: tuple[str, ...]) -> list[_Channel]:
    """Channels that change with nearly every sample, but for one stretch."""
    found = []
    for name in names:
        values = getattr(series, name)
        if values is None or len(values) < 4 * MASKING.frozen_samples:
            continue
        for k, (count, longest) in enumerate(row_kernels.repeats(values).T.tolist()):
            if longest < len(values) - 1 and (count - longest) <= MASKING.lively * max(len(values) - 1 - longest, 1):
                found.append(_Channel(f"{name} {k}", values[:, k], longest))
    return found


def _runs(time: Array, column: Array, *, limited: bool, dies: bool) -> Iterator[tuple[float, float, bool]]:
    """Start and stop [s] of runs of one value, and whether the column leaps to zero and back.

    A command that rests at its limit came there; one that is zero from one sample to the next was lost. With `dies` a
    run may last to the end.
    """
    steps = np.diff(column)
    usual = None
    for first, last in row_kernels.runs(steps == 0.0):
        short = last - first < MASKING.frozen_samples or time[last] - time[first] < MASKING.frozen_seconds
        ends = last == len(steps)
        if short or first == 0 or (ends and not dies):
            continue
        if ends:
            jumps = at_limit = False
        else:
            usual = MASKING.leap * float(np.percentile(np.abs(steps), 99)) if usual is None else usual
            jumps = column[first] == 0.0 and min(abs(steps[first - 1]), abs(steps[last])) > usual
            at_limit = limited and column[first] in (column.min(), column.max())
        if jumps or not at_limit:
            yield float(time[first]), float(time[last]), bool(jumps)


def _means(series: Series, column: Array, averaged: bool) -> tuple[Array, Array]:
    """Times and means of a channel over `MASKING.frozen_seconds`; its own samples without `averaged`."""
    each = max(1, round(MASKING.frozen_seconds / series.period)) if averaged else 1
    whole = len(column) // each * each
    return series.time[:whole:each], column[:whole].reshape(-1, each).mean(axis=1)


def _moves(time: Array, column: Array, start: float, stop: float) -> bool | None:
    """Whether another channel goes on in the meantime as it does otherwise; None where it has none there, or all."""
    a, b = np.searchsorted(time, (start, stop))
    steps = np.abs(np.diff(column))
    otherwise = np.delete(steps, np.s_[a : b - 1])
    if b - a < 3 or not otherwise.size:
        return None
    return bool(np.mean(steps[a : b - 1]) > MASKING.stirring * np.mean(otherwise))
