"""Whether what is left pushes where one rotor pushes.

A propeller that slips, a motor that stutters, a loose arm: the force and the torque that they take go together as those
of that rotor's thrust do, at any moment, while nothing in the commands or the state says when. No effect of the
catalogue can follow it; turbulence pushes in all directions. So the residual r is projected, sample by sample, onto the
wrench d_k(t) that one newton of rotor k makes,

    share_k = sum_t (d_k . r)^2 / |d_k|^2  /  sum_t |r|^2,

all in the units in which newtons and newton metres count alike, over the axes that rotors reach and that were measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import weighted
from wrenchgap.plant.actuation import actuation, rotor_wrench
from wrenchgap.plant.vehicle import Vehicle


@dataclass(frozen=True)
class OneRotor:
    """`rotors` (indices; several where they push alike) in whose direction `share` of what is left pushes."""

    rotors: tuple[int, ...]
    share: float


def one_rotor(
    data: Dataset, vehicle: Vehicle, residual: Array, least: float = 0.75, ahead: float = 0.4
) -> OneRotor | None:
    """The rotor in whose direction a residual (K, 6) pushes; None where there is none, or the vehicle has no rotors.

    Needs a force and a torque that were measured, or another rotor might push the same. `least` is the share from which
    on it is said: turbulence gives some 0.5 on a quadrotor (its rotors share the vertical axis), a rotor that slips 0.8
    in turbulence or with its drag torque as it was, else 0.99 (benchmarks/field). `ahead` is by how much it must exceed
    that of rotors elsewhere: two on one shaft push alike.
    """
    if vehicle.rotors is None or vehicle.arms is None or any(r.commands.rotor_speed is None for r in data.records):
        return None
    known = data.measured_axes
    if not (known[:3].any() and known[3:].any()):
        return None
    directions = np.nan_to_num(_directions(data, vehicle) * data.weights) * known
    reached = np.abs(directions).max(axis=(0, 1)) > 0.0
    left = np.where(known & reached, weighted(residual, data.weights), 0.0)
    whole = float(np.sum(left**2))
    along = np.einsum("kra,ka->kr", directions, left) ** 2 / np.maximum(np.sum(directions**2, axis=2), 1e-30)
    shares = along.sum(axis=0) / max(whole, 1e-30)
    best = float(shares.max())
    alike = np.flatnonzero(shares > best - 0.02)
    others = np.delete(shares, alike)
    if best < least or (others.size and others.max() > best - ahead):
        return None
    return OneRotor(tuple(int(r) for r in alike), best)


def _directions(data: Dataset, vehicle: Vehicle) -> Array:
    """Wrench (K, R, 6) of one newton of every rotor."""
    out = []
    for record in data.records:
        act = actuation(vehicle, record.commands.take(record.keep))
        each = []
        for k in range(act.thrust.shape[1]):
            one = np.zeros_like(act.thrust)
            one[:, k] = 1.0
            each.append(rotor_wrench(replace(act, thrust=one)))
        out.append(np.stack(each, axis=1))
    return np.concatenate(out)
