"""PX4's attitude and rate controller: its gains by the parameters, and what they make of the messages of a log.

`flight.formats.rate_loop` has the law and its letters; the derivative is that of the rates, E and T are none.

    A  MC_ROLL_P, ...        P, I, D  MC_ROLLRATE_P, _I, _D times _K        FF  MC_ROLLRATE_FF
    G  IMU_GYRO_CUTOFF, notches IMU_GYRO_NF0_FRQ, _BW and NF1, and of every motor IMU_GYRO_DNF_* where speeds are logged
    F  IMU_DGYRO_CUTOFF      O  MC_YAW_TQ_CUTOFF, about yaw alone

w and dw/dt are logged behind G and F (`vehicle_angular_velocity`), the integral times K as it is (`rate_ctrl_status`),
so that a log shows whether the gains made its torques. For small errors MC_YAW_WEIGHT has no effect on A. Source: PX4
parameter reference and "Controller Diagrams" (docs.px4.io); checked on logs of 1.15 and 1.16 (docs/ready.md).
"""

from collections.abc import Mapping
from enum import IntFlag
from pathlib import Path

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.filters import filtered
from wrenchgap.flight.flight import Array
from wrenchgap.flight.formats.ned_frd import flu
from wrenchgap.flight.formats.px4 import motor_speeds
from wrenchgap.flight.formats.px4_allocation import allocation_of, sent
from wrenchgap.flight.formats.rate_loop import FLYING, LoggedLoop, Pair, RateLoop, messages_of
from wrenchgap.flight.formats.standard_topics import Messages, numbers
from wrenchgap.flight.formats.ulog import UlogReader
from wrenchgap.flight.stamps import interpolated

AXES = ("ROLL", "PITCH", "YAW")
USUAL = {"IMU_GYRO_CUTOFF": 40.0, "IMU_DGYRO_CUTOFF": 30.0, "IMU_GYRO_RATEMAX": 400.0, "MC_YAW_TQ_CUTOFF": 0.0}
"""PX4's defaults; firmware without MC_YAW_TQ_CUTOFF has no filter there."""
NOTCHES = (("NF0_FRQ", "NF0_BW"), ("NF1_FRQ", "NF1_BW"), ("NF_FREQ", "NF_BW"))
"""Fixed notches, after IMU_GYRO_; the last of 1.12 and before."""


class MovingNotch(IntFlag):
    """Bits of IMU_GYRO_DNF_EN: notches at the motors' speeds, and at peaks of the gyroscope's spectrum."""

    SPEEDS = 1
    SPECTRUM = 2


def gains_of(parameters: Mapping[str, float | int], speeds: Array) -> RateLoop | None:
    """What parameters set, at these motor `speeds` (R,) [rad/s], empty where unknown.

    None where they lack a gain, and with notches whose place is not logged.
    """
    names = [f"MC_{axis}RATE_{k}" for k in "KPID" for axis in AXES] + [f"MC_{axis}_P" for axis in AXES]
    if any(name not in parameters for name in names):
        return None
    moving = MovingNotch(int(parameters.get("IMU_GYRO_DNF_EN", 0)))
    if MovingNotch.SPECTRUM in moving or (MovingNotch.SPEEDS in moving and not len(speeds)):
        return None
    notches = [[float(parameters.get(f"IMU_GYRO_{name}", 0.0)) for name in pair] for pair in NOTCHES]
    if MovingNotch.SPEEDS in moving:
        width, least, count = (float(parameters[f"IMU_GYRO_DNF_{name}"]) for name in ("BW", "MIN", "HMC"))
        turns = np.outer(np.arange(1, int(count) + 1), speeds / (2.0 * np.pi)).ravel()
        notches += [[max(float(turn), least), width] for turn in turns]
    whole, P, integral, D, angle = np.array([float(parameters[name]) for name in names]).reshape(5, 3)
    gyro, acceleration, rate, yaw = (float(parameters.get(name, usual)) or np.inf for name, usual in USUAL.items())
    return RateLoop(
        angle,
        whole * P,
        whole * integral,
        whole * D,
        1.0 / rate,
        forward=np.array([float(parameters.get(f"MC_{axis}RATE_FF", 0.0)) for axis in AXES]),
        gyro=gyro,
        acceleration=np.full(3, acceleration),
        output=np.array([np.inf, np.inf, yaw]),
        notches=np.array([(centre, width, 0.0) for centre, width in notches if centre > 0.0]).reshape(-1, 3),
    )


def logged_loop(path: Path) -> LoggedLoop | None:
    """The controller of a PX4 log; None of another file, and where the log lacks a message that the law needs."""
    said = messages_of(path, UlogReader)
    if said is None:
        return None
    try:
        gains = gains_of(said.parameters, _speeds(said))
        torques, rates, motors = _torques(said, gains), _rates(said, gains), _motors(said)
    except (ValueError, IndexError, TypeError, KeyError):  # messages of a damaged log have other shapes
        return None
    if gains is None or torques is None or rates is None or motors is None:
        return None
    return LoggedLoop("PX4", gains, torques, *rates, *motors)


def _speeds(said: Messages) -> Array:
    """Speeds (R,) [rad/s] of the motors in flight; empty where none were measured."""
    found = said.read("esc_status")
    speeds = None if found is None else motor_speeds(found[0])
    turning = np.zeros((0, 0)) if speeds is None else speeds[(speeds > 0.0).all(axis=1)]
    return np.median(turning, axis=0) if len(turning) else np.zeros(0)


def _torques(said: Messages, gains: RateLoop | None) -> Pair | None:
    """Torque setpoints in flight, and what the gains make of the rates of the same `timestamp_sample`."""
    torque, motion = said.read("vehicle_torque_setpoint", "xyz"), said.read("vehicle_angular_velocity", "xyz")
    asked = said.read("vehicle_rates_setpoint", ("roll", "pitch", "yaw"), "thrust_body")
    sums = said.read("rate_ctrl_status", ("rollspeed_integ", "pitchspeed_integ", "yawspeed_integ"))
    if not (gains and torque and motion and asked and sums):
        return None
    turning = numbers(motion[0], "xyz_derivative")
    if turning is None or any("timestamp_sample" not in x.columns for x in (torque[0], motion[0])):
        return None
    of_torque, of_motion = (np.asarray(x.columns["timestamp_sample"]) for x in (torque[0], motion[0]))
    _, k, row = np.intersect1d(of_torque, of_motion, return_indices=True)
    at = sent(torque[0])[k]
    last = np.searchsorted(sent(asked[0]), at, side="right") - 1
    integral = interpolated(at, sent(sums[0]), sums[1])
    law = gains.rate * (asked[1][last] - motion[1][row]) + integral - gains.derivative * turning[row]
    law += gains.forward * asked[1][last]
    dt = 1e-6 * float(np.median(np.diff(at)))
    yaw = np.exp(-2.0 * np.pi * gains.output[2] * dt)
    law[:, 2:] = filtered(np.array([1.0 - yaw]), np.array([1.0, -yaw]), law[:, 2:], yaw * law[:1, 2:])
    counts = (last >= 0) & (-asked[2][last, 2] > FLYING) & np.isfinite(law).all(axis=1)
    return (torque[1][k][counts], law[counts]) if counts.sum() > 1 else None


def _rates(said: Messages, gains: RateLoop | None) -> tuple[Pair, float] | None:
    """Rate setpoints in flight, at the stamps of the attitude, and what the gains make of the attitude error."""
    attitude, wanted = said.read("vehicle_attitude", "q"), said.read("vehicle_attitude_setpoint", "q_d")
    asked = said.read("vehicle_rates_setpoint", ("roll", "pitch", "yaw"), "thrust_body")
    if not (gains and attitude and wanted and asked) or len(wanted[0]) < 2:
        return None
    time, at = sent(attitude[0]), sent(wanted[0])
    time, quat = time[(time >= at[0]) & (time <= at[-1])], attitude[1][(time >= at[0]) & (time <= at[-1])]
    error = so3.multiply(so3.conjugate(quat), so3.interpolate(time, at, wanted[1]))
    law = gains.angle * 2.0 * np.sign(error[:, :1]) * error[:, 1:]
    turn = numbers(wanted[0], "yaw_sp_move_rate")
    if turn is not None:
        down_B = so3.rotate_inverse(quat, np.array([0.0, 0.0, 1.0]))
        law = law + down_B * np.nan_to_num(np.interp(time, at, turn[:, 0]))[:, None]
    both = np.hstack((asked[1], asked[2][:, 2:]))
    rates = interpolated(time, sent(asked[0]), both)
    counts = (-rates[:, 3] > FLYING) & np.isfinite(law).all(axis=1) & np.isfinite(rates).all(axis=1)
    return ((rates[counts, :3], law[counts]), 1e-6 * float(np.median(np.diff(time)))) if counts.sum() > 1 else None


def _motors(said: Messages) -> tuple[Array, Array] | None:
    """Motor commands (R, 3) for a unit of torque about B's axes, and the mean commands (R,) in flight."""
    found = said.read("actuator_motors", "control")
    if found is None:
        return None
    control = found[1][:, np.isfinite(found[1]).any(axis=0)]
    flying = control[np.all(control > FLYING, axis=1)]
    allocation = allocation_of(said, found[0], control) if len(flying) else None
    return None if allocation is None else (flu(allocation[3:].T), np.asarray(flying.mean(axis=0)))
