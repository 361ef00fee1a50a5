"""What a residual looks like that no effect of the catalogue can follow: a lightly damped mode, or one rotor's.

**A lightly damped mode**: a mass on a rope, liquid in a tank, a loose mast, an arm that rings. Such a thing has a state
of its own: it answers the vehicle's motion as a weakly damped oscillator,

    H(s) = w^2 / (s^2 + 2 zeta w s + w^2),

and no effect that depends on the commands and the state of the hull alone can imitate that. What a model leaves is
regressed, by blocks of time held out in turn, on the wrench u that it predicts, on H u and on dH u / dt; once
with a weakly damped H, once with a critically damped one of the same frequency. Something swings where the weakly
damped one predicts held-out blocks better beyond chance and takes off a good part.

Two frames are tried. In E (a rope keeps its direction in the world): force from the predicted force less its mean,
which is mass times acceleration. In B (a tank, a mast): force and torque from the predicted wrench, and the torque
r x F of a mass that has moved by r in proportion to H F.

Source: second-order systems, e.g. Franklin, Powell and Emami-Naeini, "Feedback Control of Dynamic Systems"; slung load
as a pendulum, Sreenath, Lee and Kumar, CDC 2013.

**One rotor's**: a propeller that slips, a motor that stutters, a loose arm. The force and the torque that they take go
together as those of that rotor's thrust do, at any moment, while nothing in the commands or the state says when;
turbulence pushes in all directions. So the residual r is projected, sample by sample, onto the wrench d_k(t) that one
newton of rotor k makes,

    share_k = sum_t (d_k . r)^2 / |d_k|^2  /  sum_t |r|^2,

all in the units in which newtons and newton metres count alike, over the axes that rotors reach and that were measured.
"""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.flight.so3 import rotate
from wrenchgap.learn.data.blocks import SIGNIFICANCE, by_block, paired_t
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import weighted
from wrenchgap.plant.actuation import actuation, rotor_wrench
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import cross

Frame = Literal["E", "B"]


@dataclass(frozen=True)
class ResonanceSettings:
    """Which oscillators are tried, and from when on one is said."""

    band: tuple[float, float] = (0.3, 6.0)
    """Frequencies tried [Hz]."""
    dampings: tuple[float, ...] = (0.02, 0.06, 0.15)
    """Damping ratios of what is said to swing. Frequencies are tried at steps of one and a half of them, relative."""
    loose: float = 0.35
    """Damping ratio up to which something is said to swing."""
    plain: float = 1.0
    """Damping ratio of what does not swing."""
    same: float = 1.15
    """Ratio of the frequencies found in E and B up to which they are one and the same oscillation."""
    faint: float = 0.5
    """Power above the sensors' noise, over that of the noise, from which on an axis is looked at."""
    beyond_noise: float = 6.0
    """Standard errors in the sensors' noise by which a weakly damped answer must be better: some hundred are tried."""
    least_share: float = 0.25
    """Smallest share of what is left above the noise that an oscillator must take off to be worth mentioning."""


RESONANCE = ResonanceSettings()


@dataclass(frozen=True)
class Oscillation:
    """Something that swings at `frequency_hz` with damping ratio `damping`, in frame E or B; None if either would do.

    `share` of the energy that is left above the noise is predicted by it on held-out blocks, beyond what the best
    answer without resonance predicts; `significance` is the paired t between the two.
    """

    frequency_hz: float
    damping: float
    frame: Frame | None
    share: float
    significance: float


def oscillation(data: Dataset, residual: Array) -> Oscillation | None:
    """Look for an oscillator in what a model leaves, `residual` (K, 6); None where there is none."""
    found = [s for frame in get_args(Frame) if (s := _in_frame(data, residual, frame)) is not None]
    if not found:
        return None
    best = max(found, key=lambda s: s.share)
    alike = max(s.frequency_hz for s in found) < RESONANCE.same * min(s.frequency_hz for s in found)
    return replace(best, frame=None) if len(found) == 2 and alike else best


def _in_frame(data: Dataset, residual: Array, frame: Frame) -> Oscillation | None:
    if frame == "E" and not (all(r.has_pose for r in data.records) and data.measured_axes[:3].all()):
        return None
    inputs, target, noise = _signals(data, data.measured - residual, residual, frame)
    excess = np.mean(target**2, axis=0) - noise**2
    loud = (excess > RESONANCE.faint * noise**2) & (noise > 0.0)  # a sensor that is stuck has no noise
    if not loud.any():
        return None
    target, noise, excess = target[:, loud], noise[loud], float(np.sum(excess[loud] / noise[loud] ** 2))
    levers = [cross(axis, inputs[:, :3]) for axis in np.eye(3)] if frame == "B" else []

    def left(f: float, zeta: float) -> Array:
        return _left(data, inputs, levers, target, f, zeta)

    def cost(f: float, zeta: float) -> float:
        return float(np.mean(np.sum((left(f, zeta) / noise) ** 2, axis=1)))

    _, f, zeta = min((cost(f, zeta), float(f), zeta) for zeta in RESONANCE.dampings for f in _steps(zeta))
    for _ in range(3):
        near = [(f * a, zeta * b) for a in (1 - 0.4 * zeta, 1.0, 1 + 0.4 * zeta) for b in (0.6, 1.0, 1.6)]
        f, zeta = min(near, key=lambda p: cost(*p))
    slow = min(_steps(0.2), key=lambda g: cost(g, RESONANCE.plain))
    given = float(np.mean(np.sum((target / noise) ** 2, axis=1)))
    plain = min(cost(slow, RESONANCE.plain), given)
    share = (plain - cost(f, zeta)) / excess
    before = left(slow, RESONANCE.plain) if cost(slow, RESONANCE.plain) < given else target
    after = left(f, zeta)
    gain = np.sum((before / noise) ** 2 - (after / noise) ** 2, axis=1)
    t = float(paired_t(by_block(data.block, gain)))
    chance = 2.0 * float(np.linalg.norm((before - after) / noise)) / np.sqrt(data.independence)
    sure = t > SIGNIFICANCE.unsteady and float(gain.sum()) > RESONANCE.beyond_noise * chance
    sure = sure and share > RESONANCE.least_share and zeta < RESONANCE.loose
    return Oscillation(f, zeta, frame, share, t) if sure else None


def _steps(zeta: float) -> Array:
    """Frequencies of the band, as close as the resonance is narrow."""
    return np.geomspace(*RESONANCE.band, round(np.log(RESONANCE.band[1] / RESONANCE.band[0]) / np.log1p(1.5 * zeta)))


def _signals(data: Dataset, predicted: Array, residual: Array, frame: Frame) -> tuple[Array, Array, Array]:
    """Inputs (K, 3 or 6), targets (K, 3 or 6) and the targets' noise."""
    if frame == "B":
        return np.where(data.measured_axes, predicted, 0.0), residual, data.noise
    quat = np.concatenate([r.state_kept.quat_EB for r in data.records])
    force = rotate(quat, predicted[:, :3])
    mean = float(np.sqrt(np.mean(data.noise[:3] ** 2)))
    return force - force.mean(axis=0), rotate(quat, residual[:, :3]), np.full(3, mean)


def _left(data: Dataset, inputs: Array, levers: list[Array], target: Array, f: float, zeta: float) -> Array:
    """What of the target (K, n) held-out blocks keep, regressed on the oscillator's answer.

    `levers` are those of the force, for a mass that moves in the frame; none in E.
    """
    parts = zip(data.by_record(inputs), data.records, strict=True)
    moved = np.concatenate([answer(part, r.dt_kept, f, zeta) for part, r in parts])
    places = [moved[:, i : i + 1] * lever for i, lever in enumerate(levers)]
    X = np.hstack([inputs, moved, np.ones((len(inputs), 1)), *places])
    X = X / (np.sqrt(np.mean(X**2, axis=0)) + 1e-30)
    out = np.empty_like(target)
    fold = data.block % 4
    for k in range(4):
        test = fold == k
        A = X[~test]
        H = A.T @ A + 1e-3 * len(A) * np.eye(A.shape[1])
        out[test] = target[test] - X[test] @ np.linalg.solve(H, A.T @ target[~test])
    return out


def answer(inputs: Array, dt: float, f: float, zeta: float) -> Array:
    """H u and dH u / dt (K, 2n) of inputs (K, n) every dt [s], from rest at the first sample.

    The bilinear transform s = c (z - 1) / (z + 1), c = 2 / dt, of w^2 and of w s over s^2 + 2 zeta w s + w^2.
    """
    from scipy.signal import lfilter  # here: others need not wait for it

    w, c = 2 * np.pi * f, 2.0 / dt
    scale = c**2 + 2 * zeta * w * c + w**2
    poles = np.array([1.0, 2 * (w**2 - c**2) / scale, (c**2 - 2 * zeta * w * c + w**2) / scale])
    position, velocity = w**2 / scale * np.array([1.0, 2.0, 1.0]), w * c / scale * np.array([1.0, 0.0, -1.0])
    out = []
    for b, gain in ((position, 1.0), (velocity, 0.0)):  # and what a constant input gives for ever
        start = np.outer((gain - b[0], b[2] - poles[2] * gain), inputs[0])
        out.append(lfilter(b, poles, inputs, axis=0, zi=start)[0])
    return np.hstack(out)


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
