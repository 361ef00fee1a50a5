"""The actuation model h(u): from tilt angles and rotor speeds to the wrench about the body origin.

    T = c_f Omega |Omega|
    F = sum_r T_r n_r
    M = sum_r (p_r x n_r - spin_r kappa_r n_r) T_r

The rotors of arm i sit at p_i + offset n_i, and n x n = 0, so the offsets make no torque and the wrench is linear in
the arm's sums S_i = sum T_r and Q_i = sum spin_r kappa_r T_r, times cos(alpha_i) and sin(alpha_i).

Source: Bodie et al., "An omnidirectional aerial manipulation platform", RSS 2019.
"""

from functools import lru_cache

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.flight.memory import HOURS, empty_on_disk, give_back
from wrenchgap.flight.stamps import pieces
from wrenchgap.plant.state import Actuation, Commands, Posture
from wrenchgap.plant.vehicle import Vehicle


def actuation(vehicle: Vehicle, commands: Commands, posture: Posture | None = None) -> Actuation:
    """Nominal thrusts of the rotors at these commands; `posture` where that of an equal tilt is known."""
    _, rotors = vehicle.geometry()
    assert commands.tilt is not None
    assert commands.rotor_speed is not None
    speed = commands.rotor_speed
    if len(speed) <= HOURS:
        thrust = rotors.c_f * speed * np.abs(speed)
    else:
        thrust = empty_on_disk(speed.shape)
        for k in pieces(len(speed)):  # so that products of all samples are not in memory at once
            thrust[k] = rotors.c_f * speed[k] * np.abs(speed[k])
    if posture is None:
        return Actuation(vehicle, commands.tilt, speed, thrust)
    return Actuation(vehicle, posture.tilt, speed, thrust, posture=posture)


@lru_cache(maxsize=64)
def _matrices(vehicle: Vehicle) -> tuple[Array, Array]:
    """Sums over arms (R, 2A): thrust, then spin kappa thrust; and the wrench (4A, 6) of their cosines and sines."""
    arms, rotors = vehicle.geometry()
    member = (rotors.arm[:, None] == np.arange(len(arms))).astype(float)
    sums = np.hstack((member, (rotors.spin * rotors.kappa)[:, None] * member))
    rows = []
    for direction in (arms.normal_B, arms.lateral_B):
        rows.append(np.hstack((direction, np.cross(arms.position_B, direction))))
        rows.append(np.hstack((np.zeros((len(arms), 3)), -direction)))
    return sums, np.vstack(rows)


def rotor_wrench(actuation: Actuation) -> Array:
    """Wrench (N, 6) about O, in B, of these thrusts."""
    posture, thrust = actuation.posture, actuation.thrust
    if len(thrust) <= HOURS:
        return _wrench_of_thrusts(actuation.vehicle, thrust, posture.turn)
    out = empty_on_disk((len(thrust), 6))
    for k in pieces(len(out)):
        out[k] = _wrench_of_thrusts(actuation.vehicle, thrust[k], Posture(actuation.vehicle, posture.tilt[k]).turn)
        give_back(len(out))
    return out


def _wrench_of_thrusts(vehicle: Vehicle, thrust: Array, turn: Array, most: int = 2048) -> Array:
    """Wrench (N, 6) of thrusts (N, R), `turn` (N, 2A) the cosines and sines of the tilts.

    At most so many rows at a time: what lies in between stays in the processor's cache.
    """
    if len(turn) > most:
        parts = [slice(k, k + most) for k in range(0, len(turn), most)]
        return np.concatenate([_wrench_of_thrusts(vehicle, thrust[k], turn[k]) for k in parts])
    sums, wrench = _matrices(vehicle)
    per_arm = (thrust @ sums).reshape(len(turn), 2, -1)  # thrusts, drag torques
    cos, sin = np.split(turn[:, None], 2, axis=2)
    half = len(wrench) // 2
    along = (per_arm * cos).reshape(-1, half) @ wrench[:half]
    return np.asarray(along + (per_arm * sin).reshape(-1, half) @ wrench[half:])


def nominal_wrench(vehicle: Vehicle, commands: Commands) -> Array:
    """h(u), (N, 6) about O: the wrench of the commands by the nominal model."""
    assert commands.rotor_speed is not None
    out = empty_on_disk((len(commands.rotor_speed), 6))
    for piece in pieces(len(out)):
        out[piece] = rotor_wrench(actuation(vehicle, commands.take(piece)))
        give_back(len(out))
    return out
