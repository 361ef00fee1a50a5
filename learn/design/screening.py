"""Separability of many flights at little cost: effects linearised once for each piece of flight.

For a piece of flight and every effect B of a group, at its own size theta_B, what it adds to the measured wrench and
how that changes with its parameters:

    p_B = W(model + B(theta_B)) - W(model),    J_B = dW(model + B(theta)) / dtheta at theta_B

The imitation of A by B on any sequence of pieces is then the bounded linear least-squares problem p_A ~ J_B x with the
same terms as in `learn.identify.fit`: the plausible range of B, an accelerometer's bias, nuisance (at zero), axes
weighted by what is left on them. Exact for effects that are linear in their parameters; for the others (a lag, a force
times its lever, a width) it says what B can do in the neighbourhood of its own size, which is good enough to choose
by. `learn.design.separability` then says what the choice is worth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.applicable import unexcited
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.measurement import Record, predict
from wrenchgap.learn.design.separability import Separability, absent, in_pairs, visibility
from wrenchgap.learn.identify.trim import ACCELEROMETER_BIAS
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel

DULL = 0.1
"""Factor on the merit of a flight that leaves an effect of the group unexcited."""
PASSES = 3
"""How often the axes' weights follow from what is left."""


@dataclass(frozen=True)
class Piece:
    """One piece of flight: `added` (K, 6) of each effect at its own size, `jacobian` (K, 6, P) at that size.

    `excited` are the effects that such a flight can show at all (`Effect.unexcited`).
    """

    record: Record
    added: dict[str, Array]
    jacobian: dict[str, Array]
    excited: frozenset[str]


class Screen:
    """Judges sequences of pieces for one group of effects with values, on top of `base`."""

    def __init__(self, base: Model, effects: Sequence[ModelEffect], along: Sequence[str], floor: Array | None) -> None:
        self.base = base
        self.effects = tuple(effects)
        self.floor = floor
        self.nuisance = (*base.effects, *(absent(n, base) for n in along))

    def piece(self, record: Record) -> Piece:
        """Predictions of all effects and their derivatives, by forward differences of 2 % of the typical size."""
        plain = predict(record, self.base.wrench_model)
        added, jacobian = {}, {}
        for effect in (*self.effects, *self.nuisance):
            own = effect in self.base.effects
            at = plain if own else self._with(record, effect)
            added[effect.name] = at - plain
            columns = []
            for k, p in enumerate(effect.effect.parameters(self.base.vehicle)):
                step = 0.02 * p.scale * (1.0 if effect.theta[k] + 0.02 * p.scale <= p.high else -1.0)
                theta = effect.theta.copy()
                theta[k] += step
                columns.append((self._with(record, replace(effect, theta=theta)) - at) / step)
            jacobian[effect.name] = np.stack(columns, axis=-1)
        excited = (e.name for e in self.effects if unexcited(e.name, self.base, [record]) is None)
        return Piece(record, added, jacobian, frozenset(excited))

    def _with(self, record: Record, effect: ModelEffect) -> Array:
        others = tuple(e for e in self.base.effects if e.name != effect.name)
        return predict(record, WrenchModel(self.base.vehicle, (*others, effect)))

    def merit(self, pieces: Sequence[Piece]) -> float:
        """`Separability.merit`, much less where an effect is not excited: `explain` would not even try it."""
        every = all(any(e.name in p.excited for p in pieces) for e in self.effects)
        return self.judge(pieces).merit * (1.0 if every else DULL)

    def judge(self, pieces: Sequence[Piece]) -> Separability:
        """All ordered pairs on these pieces, one after the other."""
        data = dataset([p.record for p in pieces], self.base)
        sensor = data.noise
        if self.floor is not None:
            data = dataset([replace(p.record, noise=self.floor) for p in pieces], self.base)
        added = {e.name: np.concatenate([p.added[e.name] for p in pieces]) for e in self.effects}

        def left(truth: str, other: ModelEffect) -> Array:
            return self._left(data, pieces, added[truth], other)

        return in_pairs(data, self.base, self.effects, sensor, added, left)

    def _left(self, data: Dataset, pieces: Sequence[Piece], added: Array, imitator: ModelEffect) -> Array:
        """What the imitator leaves of `added` (K, 6), alone or with the nuisance: whichever leaves less to see."""
        sets = [(imitator, *self.base.effects), (imitator, *self.nuisance)]
        found = [self._solved(data, pieces, added, effects) for effects in (sets if sets[0] != sets[1] else sets[:1])]
        return min(found, key=lambda left: visibility(left, data.noise))

    def _solved(self, data: Dataset, pieces: Sequence[Piece], added: Array, effects: Sequence[ModelEffect]) -> Array:
        """What these effects and a bias leave of `added` (K, 6)."""
        bias = np.zeros((len(added), 6, 3))
        bias[:, range(3), range(3)] = self.base.vehicle.body.mass
        J = np.concatenate([*(np.concatenate([p.jacobian[e.name] for p in pieces]) for e in effects), bias], axis=-1)
        known = [p for e in effects for p in e.effect.parameters(self.base.vehicle)]
        middle = np.array([v if e in self.base.effects else 0.0 for e in effects for v in e.theta] + [0.0] * 3)
        low = np.array([p.low for p in known] + [-ACCELEROMETER_BIAS] * 3) - middle
        high = np.array([p.high for p in known] + [ACCELEROMETER_BIAS] * 3) - middle
        sizes = np.array([p.scale for p in known] + [0.5 * ACCELEROMETER_BIAS] * 3)
        seen = data.measured_axes
        if not seen.all():
            added, J = np.where(seen, added, 0.0), np.where(seen[:, None], J, 0.0)
        weights = data.weights / np.sqrt(np.mean((added * data.weights) ** 2))
        left = added
        for _ in range(PASSES):
            left = added - J @ _bounded(J * weights[:, None], added * weights, sizes, (low, high))
            size = np.sqrt(np.mean(left**2, axis=0))
            weights = np.where(seen, 1.0 / np.where(seen, np.maximum(size, data.noise), 1.0), 0.0)
        return left


def _bounded(J: Array, target: Array, sizes: Array, bounds: tuple[Array, Array]) -> Array:
    """Argmin |target - J x|^2 + |x / sizes|^2 within bounds."""
    from scipy.optimize import lsq_linear  # here: others need not wait for it

    A = J.reshape(-1, J.shape[-1]) * sizes
    L = np.linalg.cholesky(A.T @ A + np.eye(len(sizes)))
    aim = np.linalg.solve(L, A.T @ target.reshape(-1))
    low, high = (b / sizes for b in bounds)
    found = lsq_linear(L.T, aim, bounds=(low - 1e-9, high + 1e-9), method="bvls")
    return np.asarray(found.x * sizes)
