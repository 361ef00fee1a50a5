"""Motor commands at the rate of PX4's thrust and torque setpoints, by the allocation that the log itself shows.

By default PX4 logs `actuator_motors` at 10 Hz and the setpoints that they are made of at 50 Hz or more. Where no motor
is at a limit the allocation is linear with constant coefficients, u = B (F, M). B is fitted to the messages of one
`timestamp_sample`, and used only where it gives every one of them back: nothing is assumed of the vehicle's geometry,
of normalisation or firmware. At a limit PX4 gives up torque and thrust in an order of its own, and a motor that it
takes for failed it stops; there, and while all motors stand, the last command that was logged is held.
"""

from collections.abc import Mapping

import numpy as np

from wrenchgap.flight.flight import Array, Mask
from wrenchgap.flight.formats.reader import Table
from wrenchgap.flight.formats.standard_topics import Messages, taken

EXACT = 1e-4
"""Largest misfit of a motor command, as a share of full throttle: a tenth of a step of an output of 1000 to 2000 us.
Single precision leaves 1e-7; what is not in the setpoints leaves more than 1e-3."""
NEAR_LIMIT = 0.02
"""Share of full throttle, within which of a limit a logged command may be one that was taken back from beyond it: PX4
does it in two steps, the second one half of what is left, which ends at up to 0.002 from the limit in logs."""
FEWEST = 50
"""Messages off the limits to fit six coefficients a motor to, and to see that they stay the same: 5 s at 10 Hz."""


def driven(control: Array, parameters: Mapping[str, float | int], rare: float = 0.01) -> Mask:
    """Which columns (N, K) of `actuator_motors` are of motors.

    Not what is beyond CA_ROTOR_COUNT, nor what has a number in a share below `rare` of the messages of the motor that
    has most: a damaged byte makes one of a NaN.
    """
    finite = np.isfinite(control).sum(axis=0)
    count = parameters.get("CA_ROTOR_COUNT", 0)
    known = np.arange(control.shape[1]) < (count if 0 < count <= control.shape[1] else control.shape[1])
    return np.asarray((finite > rare * finite.max(initial=0)) & known)


def motor_commands_of_setpoints(said: Messages, motors: Table, control: Array) -> tuple[Table, Array] | None:
    """The torque setpoints' messages (N rows) and the motor commands (N, R) that were made of them.

    `control` (M, R) is what the messages `motors` say, NaN where disarmed. None where the setpoints do not come faster,
    or do not give the logged commands.
    """
    allocation, found = allocation_of(said, motors, control), _setpoints(said)
    if allocation is None or found is None or len(found[1]) < 1.5 * len(motors):
        return None
    _, messages, setpoint = found
    finite = np.isfinite(setpoint).all(axis=1)
    command = np.nan_to_num(setpoint) @ allocation
    lowest = _lowest(control)
    after = np.searchsorted(sent(motors), sent(messages), side="right")
    last, following = np.clip(after - 1, 0, None), np.clip(after, None, len(motors) - 1)
    held = np.nan_to_num(control)[last]
    within = finite & np.all((command >= lowest) & (command <= 1.0), axis=1)
    other = _contradicted(np.asarray(motors.columns["timestamp_sample"]), found, command, control)
    within &= ~(other[last] | other[following])
    said.notes.append(
        f"{said.prefix}/motor_command_normalised: {len(command)} commands of the setpoints of thrust and torque "
        f"instead of {len(motors)} of actuator_motors; the log shows their allocation to be exact."
    )
    return messages, np.where((within & held.any(axis=1))[:, None], command, held)


def allocation_of(said: Messages, motors: Table, control: Array) -> Array | None:
    """The matrix (6, R) that turns setpoints of thrust and torque into motor commands; None where the log shows none.

    `control` (M, R) is what the messages `motors` say, NaN where disarmed.
    """
    found = _setpoints(said)
    if found is None or "timestamp_sample" not in motors.columns:
        return None
    sample, _, setpoint = found
    off_limits = np.all((control > _lowest(control) + NEAR_LIMIT) & (control < 1.0 - NEAR_LIMIT), axis=1)
    of_motors = np.asarray(motors.columns["timestamp_sample"])
    _, logged, asked = np.intersect1d(of_motors, sample, return_indices=True)
    fitted = off_limits[logged] & np.isfinite(setpoint[asked]).all(axis=1)
    if np.count_nonzero(fitted) < FEWEST:
        return None
    asked_for, given = setpoint[asked[fitted]], control[logged[fitted]]
    allocation = np.asarray(np.linalg.lstsq(asked_for, given, rcond=None)[0], dtype=float)
    exact = np.abs(asked_for @ allocation - given).max(axis=0) < EXACT
    if exact.all():
        return allocation
    if exact.sum() >= exact.size / 2:
        said.notes.append(
            f"{said.prefix}/actuator_motors: control {', '.join(map(str, np.flatnonzero(~exact)))} is not what the "
            "setpoints of thrust and torque make, which give the others exactly: limited or changed after them, or "
            "that of a motor taken for failed."
        )
    return None


def _contradicted(of_motors: Array, found: tuple[Array, Table, Array], command: Array, control: Array) -> Mask:
    """Which of the logged commands (M, R) are others than those (N, R) that the allocation makes of their setpoints.

    A command that it makes beyond a limit, or close to one, is no contradiction.
    """
    sample, _, setpoint = found
    out = np.zeros(len(control), dtype=bool)
    _, logged, asked = np.intersect1d(of_motors, sample, return_indices=True)
    made = command[asked]
    within = np.isfinite(setpoint[asked]).all(axis=1)
    within &= np.all((made > _lowest(control) + NEAR_LIMIT) & (made < 1.0 - NEAR_LIMIT), axis=1)
    out[logged] = within & ~np.all(np.abs(control[logged] - made) < EXACT, axis=1)
    return out


def _setpoints(said: Messages) -> tuple[Array, Table, Array] | None:
    """Samples and messages that have both setpoints, and thrust and torque (N, 6)."""
    thrust, torque = said.read("vehicle_thrust_setpoint", "xyz"), said.read("vehicle_torque_setpoint", "xyz")
    if not thrust or not torque or any("timestamp_sample" not in x[0].columns for x in (thrust, torque)):
        return None
    of_thrust, of_torque = (np.asarray(x[0].columns["timestamp_sample"]) for x in (thrust, torque))
    sample, row_thrust, row_torque = np.intersect1d(of_thrust, of_torque, return_indices=True)
    return sample, taken(torque[0], row_torque), np.hstack((thrust[1][row_thrust], torque[1][row_torque]))


def _lowest(control: Array) -> float:
    """Of motors that turn both ways -1, of others 0."""
    return -1.0 if np.nanmin(control) < 0.0 else 0.0


def sent(table: Table) -> Array:
    """When each message was sent [us]."""
    return np.asarray(table.columns["timestamp"], dtype=float)
