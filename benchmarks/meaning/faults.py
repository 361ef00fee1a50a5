"""The faults, one at a time: what a driver, a bridge, a recorder or a tired engineer does to a healthy log.

A fault changes a flight, the file that was written of it, or the model. It says which checks name it (`named`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.meaning.files import hour, microseconds, milliseconds, two_vehicles
from wrenchgap.flight.flight import Array, Flight

# Long because the faults are one list, each beside the few lines that make it.

GRAVITY = 9.80665
SAME = "the same flight"
"""In place of the name of a check: logs of one flight are refused together."""
Change = Callable[[Flight], Flight]


@dataclass(frozen=True)
class Fault:
    """`named` are the checks that say it; `flight`, `file` and `model` (of the text of its file) are changed by it.

    `again` makes a second log of the flight, which is opened beside the first.
    """

    name: str
    named: tuple[str, ...]
    flight: Change | None = None
    file: Callable[[Path], None] | None = None
    model: Callable[[str], str] | None = None
    tilting: bool | None = None  # only for vehicles whose arms do, or do not, tilt
    again: Change | None = None


def _imu(flight: Flight, gyro: Any = None, accel: Any = None) -> Flight:
    """The IMU through matrices (3, 3) or factors; `accel` may be a function of the readings."""
    imu = flight.imu
    assert imu is not None
    omega = imu.omega_B if gyro is None else imu.omega_B @ (np.eye(3) * gyro if np.ndim(gyro) == 0 else gyro).T
    force = imu.specific_force_B
    if accel is not None:
        force = force @ (np.eye(3) * accel if np.ndim(accel) == 0 else accel).T
    return replace(flight, imu=replace(imu, omega_B=omega, specific_force_B=force))


def _without_gravity(flight: Flight) -> Flight:
    imu, odometry = flight.imu, flight.odometry
    assert imu is not None
    assert odometry is not None
    quat = np.stack([np.interp(imu.time, odometry.time, c) for c in odometry.quat_EB.T], axis=1)
    up = Rotation.from_quat(quat, scalar_first=True).inv().apply([0.0, 0.0, GRAVITY])
    return replace(flight, imu=replace(imu, specific_force_B=imu.specific_force_B - up))


def _turned(degrees: float) -> Change:
    turn = Rotation.from_euler("z", -degrees, degrees=True).as_matrix()
    return partial(_imu, gyro=turn, accel=turn)


def _odometry(change: Callable[[Any], Mapping[str, Array]]) -> Change:
    def apply(flight: Flight) -> Flight:
        assert flight.odometry is not None
        return replace(flight, odometry=replace(flight.odometry, **change(flight.odometry)))

    return apply


def _no_imu(change: Change) -> Change:
    return lambda flight: replace(change(flight), imu=None)


def _wrench(force: Any = 1.0, torque: Any = 1.0) -> Change:
    def apply(flight: Flight) -> Flight:
        sent = flight.commanded
        assert sent is not None
        parts = sent.wrench_B[:, :3] * np.asarray(force), sent.wrench_B[:, 3:] * np.asarray(torque)
        return replace(flight, commanded=replace(sent, wrench_B=np.hstack(parts)))

    return apply


def _normalised(flight: Flight) -> Flight:
    """Thrust as a share of twice the hover's, torques as shares of what was largest."""
    sent = flight.commanded
    assert sent is not None
    force = 2.0 * float(np.median(np.linalg.norm(sent.wrench_B[:, :3], axis=1)))
    return _wrench(1.0 / force, 1.0 / (float(np.abs(sent.wrench_B[:, 3:]).max())))(flight)


def _in_g(flight: Flight) -> Flight:
    """Force as a share of the weight."""
    sent = flight.commanded
    assert sent is not None
    return _wrench(1.0 / float(np.median(np.linalg.norm(sent.wrench_B[:, :3], axis=1))))(flight)


def _rotors(change: Callable[[Array], Array]) -> Change:
    def apply(flight: Flight) -> Flight:
        sent = flight.actuators
        assert sent is not None
        return replace(flight, actuators=replace(sent, rotor_speed=change(sent.rotor_speed)))

    return apply


def _shuffled(speed: Array) -> Array:
    """Another order: front and back swapped as another autopilot counts."""
    return speed[:, np.roll(np.arange(speed.shape[1])[::-1], 1)]


def _uncommanded(change: Change) -> Change:
    """The same where no commanded wrench was logged: the motion is the only witness."""
    return lambda flight: replace(change(flight), commanded=None)


def _tilt(flight: Flight) -> Flight:
    assert flight.actuators is not None
    return replace(flight, actuators=replace(flight.actuators, tilt=-flight.actuators.tilt))


def _stuck(flight: Flight, axis: int, seconds: float = 3.0, accel: bool = False) -> Flight:
    imu = flight.imu
    assert imu is not None
    first, last = np.searchsorted(imu.time, (6.0, 6.0 + seconds))
    name = "specific_force_B" if accel else "omega_B"
    values = getattr(imu, name).copy()
    columns = [axis] if axis >= 0 else [0, 1, 2]
    values[first:last, columns] = values[first, columns]
    out = replace(flight, imu=replace(imu, **{name: values}))
    return _stuck(out, -1, seconds, accel=True) if axis < 0 and not accel else out


def _held(role: str, name: str, columns: Any, seconds: float, value: float | None = None) -> Change:
    """Some columns of a series at what they were, or at `value`, from 6 s on."""

    def apply(flight: Flight) -> Flight:
        series = getattr(flight, role)
        first, last = np.searchsorted(series.time, (6.0, 6.0 + seconds))
        values = getattr(series, name).copy()
        values[first:last, columns] = values[first, columns] if value is None else value
        return replace(flight, **{role: replace(series, **{name: values})})

    return apply


def _dead(flight: Flight, name: str, share: float = 0.7) -> Flight:
    """A sensor of the IMU reads one value from that share of the flight to its end."""
    imu = flight.imu
    assert imu is not None
    values = getattr(imu, name).copy()
    first = int(share * len(values))
    values[first:] = values[first]
    return replace(flight, imu=replace(imu, **{name: values}))


def _clipped(flight: Flight, name: str, share: float = 0.97) -> Flight:
    """A sensor of the IMU whose range ends where that share of its readings lies, on the axis that moves most."""
    imu = flight.imu
    assert imu is not None
    values = getattr(imu, name).copy()
    axis = int(np.argmax(values.std(axis=0)))
    middle = float(np.median(values[:, axis]))
    size = float(np.quantile(np.abs(values[:, axis] - middle), share))
    values[:, axis] = np.clip(values[:, axis], middle - size, middle + size)
    return replace(flight, imu=replace(imu, **{name: values}))


def _cut(flight: Flight) -> Flight:
    """From 4 s on, stamped an hour later, in single precision."""
    out: dict[str, Any] = {"start_ns": flight.start_ns + 3_600_000_000_000, "content_hash": "0" * 64}
    for role, series in flight.series().items():
        first = int(np.searchsorted(series.time, 4.0))
        arrays = {k: v[first:].astype(np.float32) for k, v in vars(series).items() if isinstance(v, np.ndarray)}
        arrays = {k: v.astype(float) for k, v in arrays.items()} | {"time": series.time[first:] - 4.0}
        out[role] = replace(series, **arrays)
    return replace(flight, **out)


def _odometry_stuck(flight: Flight) -> Flight:
    for name in ("position_E", "quat_EB", "velocity_E", "omega_B"):
        flight = _held("odometry", name, slice(None), 3.0)(flight)
    return flight


def _twist_stuck(flight: Flight) -> Flight:
    for name in ("velocity_E", "omega_B"):
        flight = _held("odometry", name, slice(None), 3.0)(flight)
    return flight


def _alone(change: Change) -> Change:
    """The same on a log of actuators and IMU alone."""
    return lambda flight: replace(change(flight), commanded=None, odometry=None)


def _wrench_alone(change: Change) -> Change:
    """The same on a log of commanded wrench and IMU alone."""
    return lambda flight: replace(change(flight), actuators=None, odometry=None)


def _swapped(speed: Array) -> Array:
    """The first two rotors in each other's place."""
    return speed[:, [1, 0, *range(2, speed.shape[1])]]


def _often_beyond(speed: Array) -> Array:
    out = speed.copy()
    out[::10] = 9000.0
    return out


def _spiked(flight: Flight) -> Flight:
    imu = flight.imu
    assert imu is not None
    force = imu.specific_force_B.copy()
    force[[500, 1200, 1201, 2000], [0, 1, 2, 2]] = [1e5, -1e5, 3e4, -8e4]
    return replace(flight, imu=replace(imu, specific_force_B=force))


def _rotor_spikes(speed: Array) -> Array:
    out = speed.copy()
    out[[400, 900, 1500], [0, 1, 2]] = 10.0 * speed.max()
    return out


def _lost_speeds(speed: Array) -> Array:
    out = speed.copy()
    rows = np.random.default_rng(0).choice(np.arange(20, len(out) - 20), 20, replace=False)
    out[rows, rows % out.shape[1]] = 0.0
    return out


def _slow(role: str, every: int) -> Change:
    def apply(flight: Flight) -> Flight:
        series = getattr(flight, role)
        arrays = {k: v[::every] for k, v in vars(series).items() if isinstance(v, np.ndarray)}
        return replace(flight, **{role: replace(series, **arrays)})

    return apply


def _constant(flight: Flight) -> Flight:
    imu = flight.imu
    assert imu is not None
    still = {k: np.tile(getattr(imu, k)[0], (len(imu.time), 1)) for k in ("omega_B", "specific_force_B")}
    return replace(flight, imu=replace(imu, **still))


NED_E = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD_B = np.diag([1.0, -1.0, -1.0])


def _ned(odometry: Any) -> Mapping[str, Array]:
    turn = Rotation.from_quat(odometry.quat_EB, scalar_first=True).as_matrix()
    quat = Rotation.from_matrix(NED_E @ turn @ FRD_B).as_quat(scalar_first=True)
    return {
        "position_E": odometry.position_E @ NED_E.T,
        "velocity_E": odometry.velocity_E @ NED_E.T,
        "quat_EB": quat,
        "omega_B": odometry.omega_B @ FRD_B,
    }


def _number(key: str, change: Callable[[float], float]) -> Callable[[str], str]:
    def apply(text: str) -> str:
        def scaled(match: re.Match[str]) -> str:
            return match[1] + re.sub(r"[\d.e+-]+", lambda n: repr(change(float(n[0]))), match[2])

        return re.sub(rf"(^{key} *= *)([^#\n]*)", scaled, text, flags=re.MULTILINE)

    return apply


def _spins(text: str) -> str:
    return re.sub(r"spin = (-?1)", lambda m: f"spin = {-int(m[1])}", text)


def _attitude(change: Callable[[Array], Array]) -> Change:
    """Another attitude; the twist, which is in the body's axes, stays as it was."""

    def changed(odometry: Any) -> Mapping[str, Array]:
        wrong = change(odometry.quat_EB)
        right, other = (Rotation.from_quat(q, scalar_first=True) for q in (odometry.quat_EB, wrong))
        return {"quat_EB": wrong, "velocity_E": other.apply(right.inv().apply(odometry.velocity_E))}

    return _odometry(changed)


def _wxyz(quat: Array) -> Array:
    """The scalar first in the fields x y z w, which a reader takes in the order w x y z."""
    return np.asarray(quat[:, [3, 0, 1, 2]])


FAULTS: tuple[Fault, ...] = (
    Fault("accelerometer in g", ("accelerometer-unit",), partial(_imu, accel=1 / GRAVITY)),
    Fault("accelerometer without gravity", ("accelerometer-unit",), _without_gravity),
    Fault("accelerometer scaled by 1.06", ("accelerometer-scale",), partial(_imu, accel=1.06)),
    Fault("gyroscope in deg/s", ("gyroscope",), partial(_imu, gyro=180 / np.pi)),
    Fault("gyroscope in deg/s, IMU and wrench alone", ("gyroscope",), _wrench_alone(partial(_imu, gyro=180 / np.pi))),
    Fault("gyroscope in deg/s, IMU and actuators alone", ("gyroscope",), _alone(partial(_imu, gyro=180 / np.pi))),
    Fault("gyroscope twice too large", ("gyroscope",), partial(_imu, gyro=2.0)),
    Fault("gyroscope scaled by 0.9", ("gyroscope-scale",), partial(_imu, gyro=0.9)),
    Fault("gyroscope scaled by 1.03", ("gyroscope-scale",), partial(_imu, gyro=1.03)),
    Fault("gyroscope's y scaled by 0.95", ("gyroscope-scale",), partial(_imu, gyro=np.diag([1.0, 0.95, 1.0]))),
    Fault("IMU forward-right-down", ("body-frame",), partial(_imu, gyro=FRD_B, accel=FRD_B)),
    Fault("IMU turned by 90 deg", ("body-frame",), _turned(90.0)),
    Fault("IMU turned by 45 deg", ("body-frame",), _turned(45.0)),
    Fault("IMU turned by 45 deg, no attitude", ("body-frame",), _alone(_turned(45.0))),
    Fault(
        "IMU with x and y swapped", ("body-frame", "gyroscope"),
        partial(_imu, gyro=np.eye(3)[[1, 0, 2]], accel=np.eye(3)[[1, 0, 2]]),
    ),
    Fault("gyroscope's y opposite", ("body-frame", "gyroscope"), partial(_imu, gyro=np.diag([1.0, -1.0, 1.0]))),
    Fault("quaternion scalar first", ("inertial-frame",), _attitude(_wxyz)),
    Fault(
        "quaternion inverse", ("inertial-frame", "body-frame", "gyroscope"),
        _attitude(lambda q: q * [1, -1, -1, -1]),
    ),
    Fault("odometry NED and FRD", ("inertial-frame",), _odometry(_ned)),
    Fault(
        "odometry in mm", ("odometry-scale",),
        _odometry(lambda o: {"position_E": 1e3 * o.position_E, "velocity_E": 1e3 * o.velocity_E}),
    ),
    Fault(
        "odometry with a scale of 2", ("odometry-scale",),
        _odometry(lambda o: {"position_E": 2 * o.position_E, "velocity_E": 2 * o.velocity_E}),
    ),
    Fault("velocity in km/h", ("velocity",), _odometry(lambda o: {"velocity_E": 3.6 * o.velocity_E})),
    Fault("positions in mm, velocity in m/s", ("velocity",), _odometry(lambda o: {"position_E": 1e3 * o.position_E})),
    Fault(
        "odometry's rates in deg/s, no IMU", ("odometry-rate",),
        _no_imu(_odometry(lambda o: {"omega_B": 180 / np.pi * o.omega_B})),
    ),
    Fault("wrench forward-right-down", ("wrench-frame",), _wrench([1, -1, -1], [1, -1, -1])),
    Fault("torque in Nmm", ("torque-unit",), _wrench(1.0, 1e3)),
    Fault("wrench normalised", ("force-unit", "torque-unit"), _normalised),
    Fault("force in units of g", ("force-unit",), _in_g),
    Fault("rotors in another order", ("rotors",), _rotors(_shuffled), tilting=False),
    Fault("rotors in another order, no wrench", ("rotors",), _uncommanded(_rotors(_shuffled)), tilting=False),
    Fault("two rotors swapped, no wrench", ("rotors",), _uncommanded(_rotors(_swapped)), tilting=False),
    Fault("rotor speeds in rpm, no wrench", ("rotor-speed-unit",), _uncommanded(_rotors(lambda s: s * 30 / np.pi))),
    Fault("rotor speeds in rpm", ("rotor-speed-unit", "actuation"), _rotors(lambda s: s * 30 / np.pi)),
    Fault("every spin turned over", ("rotors",), model=_spins, tilting=False),
    Fault("every spin turned over, no wrench", ("rotors",), _uncommanded(lambda f: f), model=_spins, tilting=False),
    Fault("tilt of the opposite sign", ("rotors",), _tilt, tilting=True),
    Fault("tilt of the opposite sign, no wrench", ("rotors",), _uncommanded(_tilt), tilting=True),
    Fault("inertia ten times too large", ("inertia", "torque-unit"), model=_number("inertia", lambda v: 10.0 * v)),
    Fault("inertia in g m^2", ("inertia", "torque-unit"), model=_number("inertia", lambda v: 1000.0 * v)),
    Fault("inertia a third of what it is", ("inertia",), model=_number("inertia", lambda v: v / 3.0)),
    Fault(
        "arms twice as long, no wrench", ("inertia",), _uncommanded(lambda f: f),
        model=_number("length", lambda v: 2.0 * v),
    ),
    Fault("kappa of the opposite sign", ("kappa", "rotors"), model=_number("kappa", lambda v: -v)),
    Fault(
        "kappa over the arm, no wrench", ("kappa",), _uncommanded(lambda f: f),
        model=_number("kappa", lambda v: 4.0 * v), tilting=False,
    ),
    Fault("c_f per rpm^2", ("thrust-coefficient",), model=_number("c_f", lambda v: v * (np.pi / 30.0) ** 2)),
    Fault("kappa as torque coefficient", ("kappa",), model=_number("kappa", lambda v: 1e-5 * v)),
    Fault("gyroscope's x stuck for 3 s", ("frozen",), partial(_stuck, axis=0)),
    Fault("IMU stuck for 3 s", ("frozen",), partial(_stuck, axis=-1)),
    Fault("gyroscope dead to the end", ("frozen",), partial(_dead, name="omega_B")),
    Fault("accelerometer dead to the end", ("frozen",), partial(_dead, name="specific_force_B")),
    Fault("gyroscope clipped", ("clipped",), partial(_clipped, name="omega_B")),
    Fault("accelerometer clipped", ("clipped",), partial(_clipped, name="specific_force_B")),
    Fault("odometry stuck for 3 s", ("frozen",), _odometry_stuck),
    Fault("odometry's twist stuck for 3 s", ("frozen",), _twist_stuck),
    Fault(
        "odometry's velocity never filled in", ("velocity",),
        _odometry(lambda o: {"velocity_E": 0.0 * o.velocity_E}),
    ),
    Fault(
        "odometry's rates never filled in, no IMU", ("odometry-rate",),
        _no_imu(_odometry(lambda o: {"omega_B": 0.0 * o.omega_B})),
    ),
    Fault("commanded wrench stuck for 3 s", ("frozen",), _held("commanded", "wrench_B", slice(None), 3.0)),
    Fault("a rotor's command stuck for 1 s", ("frozen",), _held("actuators", "rotor_speed", [1], 1.0)),
    Fault("a rotor's command zero for 1 s", ("frozen",), _held("actuators", "rotor_speed", [1], 1.0, 0.0)),
    Fault("spikes of 1e5 m/s^2", ("spikes",), _spiked),
    Fault("spikes of rotor speed", ("spikes",), _rotors(_rotor_spikes)),
    Fault("rotor speed 0 in 20 single samples", ("spikes",), _rotors(_lost_speeds)),
    Fault("every tenth rotor speed 9000 rad/s", ("spikes",), _rotors(_often_beyond)),
    Fault("IMU at 10 Hz", ("rate",), _slow("imu", 25)),
    Fault("commands at 10 Hz", ("rate",), lambda f: _slow("actuators", 25)(_slow("commanded", 25)(f))),
    Fault("actuators at 10 Hz beside a fast wrench", ("rate",), _slow("actuators", 25)),
    Fault("an IMU that never changes", ("constant-channel",), _constant),
    Fault("stamps in milliseconds", ("clock-unit",), file=milliseconds),
    Fault("stamps in microseconds", ("clock-unit",), file=microseconds),
    Fault("two vehicles in one log", ("vehicles",), file=two_vehicles, tilting=False),
    Fault("a clock that is set in mid-flight", ("clock-jump",), file=hour),
    Fault("the same flight under two names", (SAME,), again=lambda f: replace(f, start_ns=f.start_ns + 10**9)),
    Fault("a cut of the flight beside it", (SAME,), again=_cut),
)  # fmt: skip
"""All of them."""
