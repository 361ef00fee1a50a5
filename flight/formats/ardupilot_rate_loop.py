"""ArduPilot's attitude and rate controller (Copter): its gains by the parameters, and what they make of a log.

`flight.formats.rate_loop` has the law and its letters; the derivative is that of the filtered error:

    A  ATC_ANG_RLL_P, ...        P, I, D, FF  ATC_RAT_RLL_P, _I, _D, _FF
    T, E, F  ATC_RAT_RLL_FLTT, _FLTE, _FLTD, 0 for none; before firmware 4.0 _FILT, which is E
    G  INS_GYRO_FILTER, and notches INS_HNTCH_*, INS_HNTC2_* and INS_NOTCH_*

A notch of bandwidth B at f has with r = f / (f - B / 2) the quality Q = r / (r^2 - 1), also at its harmonics. Those
that follow the rotors are taken at their _FREQ: where they are in hover, or the lowest place that they have, at which
they take most of the phase. RATE has w_sp, w behind G, and torques [-1, 1]. The law is stepped through its samples as
the firmware steps it, so that they show it where they come as fast as the loop (ATTITUDE_FAST of LOG_BITMASK).
The mixer turns a unit of torque into half of a rotor's thrust. Source: Copter parameter reference (ardupilot.org),
AC_PID, AC_AttitudeControl, NotchFilter, AP_MotorsMatrix. Its slew limit (SMAX), notches of AC_PID and _D_FF are not in.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.filters import angular_velocity, filtered
from wrenchgap.flight.flight import Array
from wrenchgap.flight.formats.ardupilot import MOTOR_FUNCTIONS
from wrenchgap.flight.formats.dataflash import DataflashReader
from wrenchgap.flight.formats.ned_frd import quat_of_euler
from wrenchgap.flight.formats.rate_loop import FLYING, LoggedLoop, Pair, RateLoop, messages_of
from wrenchgap.flight.formats.standard_topics import Messages
from wrenchgap.flight.stamps import interpolated

AXES = ("RLL", "PIT", "YAW")
NOTCHES = {
    "INS_HNTCH": (80.0, 40.0, 40.0, 3.0),
    "INS_HNTC2": (80.0, 40.0, 40.0, 3.0),
    "INS_NOTCH": (80.0, 20.0, 15.0, 1.0),
}
"""ArduPilot's defaults of _FREQ and _BW [Hz], _ATT [dB] and _HMNCS."""


def gains_of(parameters: Mapping[str, float | int]) -> RateLoop | None:
    """What parameters set; None where they lack a gain."""
    needed = [f"ATC_{kind}_{axis}_P" for kind in ("RAT", "ANG") for axis in AXES]
    if any(name not in parameters for name in needed):
        return None

    def each(name: str) -> Array:
        return np.array([float(parameters.get(f"ATC_RAT_{axis}_{name}", 0.0)) for axis in AXES])

    def cutoff(name: str) -> Array:
        found = each(name)
        return np.where(found > 0.0, found, np.inf)

    return RateLoop(
        np.array([float(parameters[f"ATC_ANG_{axis}_P"]) for axis in AXES]),
        each("P"),
        each("I"),
        each("D"),
        1.0 / max(float(parameters.get("SCHED_LOOP_RATE", 400)), 1.0),
        forward=each("FF"),
        gyro=float(parameters.get("INS_GYRO_FILTER", 20)) or np.inf,
        acceleration=cutoff("FLTD"),
        error=np.minimum(cutoff("FLTE"), cutoff("FILT")),
        target=cutoff("FLTT"),
        notches=_notches(parameters),
        of_error=True,
    )


def _notches(parameters: Mapping[str, float | int]) -> Array:
    found = []
    for head, usual in NOTCHES.items():
        keys = ("FREQ", "BW", "ATT", "HMNCS")
        centre, width, depth, harmonics = (
            float(parameters.get(f"{head}_{k}", u)) for k, u in zip(keys, usual, strict=True)
        )
        if parameters.get(f"{head}_ENABLE", 0) and centre > 0.5 * width:
            r = centre / (centre - 0.5 * width)
            motors = sum(parameters.get(f"SERVO{n}_FUNCTION") in MOTOR_FUNCTIONS for n in range(1, 33))
            every = int(parameters.get(f"{head}_OPTS", 0)) & 2  # a notch for every motor
            turns = [k for k in range(1, 17) if int(harmonics) >> (k - 1) & 1]
            found += [(k * centre, k * centre * (r - 1.0 / r), 10.0 ** (-depth / 20.0)) for k in turns] * (
                max(motors, 1) if every else 1
            )
    return np.array(found).reshape(-1, 3)


def logged_loop(path: Path) -> LoggedLoop | None:
    """The controller of an ArduPilot log; None of another file, and where it lacks a message that the law needs."""
    said = messages_of(path, DataflashReader)
    gains = None if said is None else gains_of(said.parameters)
    if said is None or gains is None:
        return None
    try:
        torques, rates = _torques(said, gains), _rates(said, gains)
    except (ValueError, IndexError, TypeError):  # messages of a damaged log have other shapes
        return None
    return None if torques is None or rates is None else LoggedLoop("ArduPilot", gains, torques, *rates)


def _flown(said: Messages) -> tuple[Array, Array, Array, Array] | None:
    """Times [s] of RATE from the first to the last thrust, the rates asked for and measured [rad/s], and torques."""
    found = said.read("RATE", ("RDes", "PDes", "YDes"), ("R", "P", "Y"), ("ROut", "POut", "YOut"), "AOut")
    if found is None:
        return None
    table, asked, rates, torque, thrust = found
    flying = np.flatnonzero(thrust[:, 0] > FLYING)
    if len(flying) < 3:
        return None
    part = slice(flying[0], flying[-1] + 1)
    return 1e-9 * table.log_time_ns[part], np.radians(asked[part]), np.radians(rates[part]), torque[part]


def _torques(said: Messages, gains: RateLoop) -> Pair | None:
    """Torques in flight, and what the gains make of the rates."""
    found = _flown(said)
    if found is None:
        return None
    time, asked, rates, torque = found
    dt = float(np.median(np.diff(time)))

    def low_pass(values: Array, cutoff: Array) -> Array:
        share = dt / (dt + 1.0 / (2.0 * np.pi * cutoff))
        columns = zip(share, values.T[:, :, None], strict=True)
        return np.hstack([filtered(np.array([a]), np.array([1.0, a - 1.0]), x, (1.0 - a) * x[:1]) for a, x in columns])

    target = low_pass(asked, gains.target)
    error = low_pass(target - rates, gains.error)
    turning = low_pass(np.diff(error, axis=0, prepend=error[:1]) / dt, gains.acceleration)
    law = gains.rate * error + gains.integral * dt * np.cumsum(error, axis=0) + gains.derivative * turning
    return torque, law + gains.forward * target


def _rates(said: Messages, gains: RateLoop) -> tuple[Pair, float] | None:
    """Rates asked for in flight, and what the gains make of the attitude error and the rates of its setpoint."""
    found = said.read("ATT", ("DesRoll", "DesPitch", "DesYaw"), ("Roll", "Pitch", "Yaw"))
    flown = _flown(said)
    if found is None or flown is None:
        return None
    time = 1e-9 * found[0].log_time_ns
    within = (time >= flown[0][0]) & (time <= flown[0][-1])
    wanted, quat = (quat_of_euler(*np.radians(angles[within]).T) for angles in found[1:])
    if len(quat) < 3:
        return None
    error = so3.multiply(so3.conjugate(quat), wanted)
    law = gains.angle * 2.0 * np.sign(error[:, :1]) * error[:, 1:]
    law = law + so3.rotate(error, angular_velocity(time[within], wanted))
    asked = interpolated(time[within], flown[0], flown[1])
    return (asked, law), float(np.median(np.diff(time[within])))
