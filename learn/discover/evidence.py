"""What flights say of laws: what each atom takes off what is left, and how much chance would have found.

Equations and sources: docs/theory/laws.md. Of every axis and band of frequency the residual's coefficients
(`learn.posterior.spectrum`) have a variance, as the named set leaves them. What the set, trims and biases of flights
can say is projected out of them and of every atom's columns, so that a law is never an alias of a name. Atoms are many,
and residuals are slow, so that some atom always explains a part: a law must gain more than 95 % of the largest gains on
residuals of chance, which go through the same search.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wrenchgap.flight.flight import Array, Indices, Mask
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.measurement import Record, thinned
from wrenchgap.learn.discover.atoms import Atom, Term
from wrenchgap.learn.discover.law_file import evaluator
from wrenchgap.learn.discover.settings import SETTINGS
from wrenchgap.learn.identify.bias_and_trim import trim_of
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.score import Scorer
from wrenchgap.learn.posterior.spectrum import Spectrum
from wrenchgap.plant.effects.effect import Context
from wrenchgap.plant.model import Model
from wrenchgap.plant.state import Actuation
from wrenchgap.plant.wrench_model import WrenchModel, about_com, actuator_rates


@dataclass(frozen=True)
class Evidence:
    """What atoms and the residual say, whitened, named effects projected out: rows are coefficients of axes and bands.

    `X` (rows, columns) of `atoms`, of which atom a has the columns `of[a]`; `y` (rows,) the residual; `nulls` (rows,
    N). `cell` (rows,) numbers axis and band, `moment` (rows,) the block of time and `flight` (rows,) its flight;
    `count` (cells,) are coefficients that count, `floor` (cells,) the sensors' share of the variance. `same` are atoms
    that were left out as they are one of these here, by its name.
    """

    atoms: tuple[Atom, ...]
    of: tuple[slice, ...]
    X: Array
    y: Array
    nulls: Array
    cell: Indices
    moment: Indices
    flight: Indices
    count: Array
    floor: Array
    same: Mapping[str, tuple[Atom, ...]] = field(default_factory=dict)

    def columns(self, some: Sequence[int]) -> Array:
        """Those of some atoms, side by side (rows, P)."""
        return np.concatenate([self.X[:, self.of[k]] for k in some], axis=1).astype(np.float64)

    def rows(self, keep: Mask) -> Evidence:
        """Some of the rows, without nulls."""
        cells = len(self.count)
        share = np.bincount(self.cell[keep], minlength=cells) / np.maximum(np.bincount(self.cell, minlength=cells), 1)
        parts = {n: getattr(self, n)[keep] for n in ("X", "y", "cell", "moment", "flight")}
        return replace(self, **parts, nulls=np.zeros((int(keep.sum()), 0)), count=self.count * share)

    def after(self, atom: int, left: Array, whitening: Whitening, seed: int) -> Evidence:
        """The same when one atom is a law, and `left` (K, 6) is what it leaves in time."""
        nulls = whitening(surrogate_residuals(whitening.data, left, SETTINGS.nulls, seed))
        X, y, nulls = projected_out(self.columns([atom]), self.X, self.y, nulls)
        return distinct(replace(self, X=X.astype(np.float32), y=y, nulls=nulls))


def projected_out(columns: Array, *others: Array) -> list[Array]:
    """Columns (rows, P) taken out of others, each (rows,) or (rows, Q)."""
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    basis = u[:, s > 1e-6 * s.max()]
    return [m - basis @ (basis.T @ m) for m in others]


def responses(data: Dataset, model: Model, atoms: Sequence[Atom], numbers: dict[str, str]) -> Iterator[Array]:
    """Measured wrenches (K, 6, terms), about the nominal centre of mass, that atoms make at their typical coefficients.

    Effects of the model on mass properties and sensors are left out: of the second order here, and in the fit.
    """
    values = evaluator(numbers)
    acting = WrenchModel(model.vehicle, model.effects)
    parts = [_rotor_side(r, acting) for r in data.records]
    for atom in atoms:
        stacks = []
        for record, (act, rotors, context) in zip(data.records, parts, strict=True):
            made = values([atom], act, rotors, context)[0]
            wrenches = [
                _measured(record, t.scale * about_com(model.vehicle.body, w))
                for t, w in zip(atom.terms, made, strict=True)
            ]
            stacks.append(np.stack(wrenches, axis=2))
        yield np.concatenate(stacks)


def _rotor_side(record: Record, model: WrenchModel) -> tuple[Actuation | None, Array, Context]:
    commands = model.command(record.commands, record.state, record.dt)[0]
    tilt, speed = commands.tilt, commands.rotor_speed
    rates = None if tilt is None or speed is None else actuator_rates(tilt, speed, record.dt)[0]
    act, rotors = model.rotors(commands, record.state, rates)
    return act, rotors, model.context(record.state)


def _measured(record: Record, wrench: Array) -> Array:
    return thinned(np.broadcast_to(wrench, (len(record.state.time), 6)), record.dt, record.cutoff_hz, record.keep)


def possible(atoms: Sequence[Atom], data: Dataset, model: Model) -> tuple[Atom, ...]:
    """Those that these flights have the quantities of."""
    has = {
        "pose": all(r.has_pose for r in data.records),
        "voltage": all(r.has_voltage for r in data.records),
        "rotors": model.vehicle.has_rotors and all(r.commands.rotor_speed is not None for r in data.records),
    }
    has |= {"air": has["pose"], "tilt": has["rotors"], "rates": has["rotors"]}
    return tuple(a for a in atoms if all(known or not a.needs(what) for what, known in has.items()))


def evidence(
    whitening: Whitening, model: Model, left: Array, atoms: Sequence[Atom], numbers: dict[str, str], seed: int = 0
) -> Evidence:
    """Put together what flights say of atoms; `left` (K, 6) is what the model leaves in time."""
    data = whitening.data
    nulls = whitening(surrogate_residuals(data, left, SETTINGS.nulls, seed))
    chunks, every = [], []
    for some, block in _chunked(responses(data, model, atoms, numbers), atoms):
        chunks.append(whitening(block).astype(np.float32))
        every += some
    w = whitening
    X: Array = np.concatenate(chunks, axis=1)  # of single precision, for memory
    return distinct(Evidence(tuple(every), _slices(every), X, w.y, nulls, w.cell, w.moment, w.flight, w.count, w.floor))


class Whitening:
    """Coefficients of any columns of some flights, over the deviation that each cell has with the named set, without
    what that set, trims, and a constant wrench of each flight can say; rows are coefficients, axis by axis.
    """  # noqa: D205

    def __init__(self, data: Dataset, model: Model, left: Array, named: Sequence[Column]) -> None:
        self.data, self.left, self.named, self.trim = data, left, named, trim_of(model)
        own = Spectrum(data, left, [], self.trim, named)
        scorer = Scorer(own, own.saturated()[0])
        axes = len(own.axes)
        self.deviation, self.silent = np.sqrt(scorer.variance)[own.band], own.silent
        self.count, self.floor = scorer.count.ravel(), (own.sensor / scorer.variance).ravel()
        self.cell = (own.band[:, None] * axes + np.arange(axes)).ravel()
        self.moment = np.repeat(own.block, axes)
        self.flight = data.flight[own.starts][self.moment]
        self.basis = np.zeros((len(self.cell), 0))
        constants = np.zeros((*left.shape, 6 * (1 + int(data.flight.max()))))
        for axis in range(6):
            constants[np.arange(len(left)), axis, 6 * data.flight + axis] = 1.0
        said = np.hstack((self(constants), self._flat(own.coefficients[:, :, own.always])))
        size = np.linalg.norm(said, axis=0)
        u, s, _ = np.linalg.svd(said[:, size > 0.0] / size[size > 0.0], full_matrices=False)
        self.basis = u[:, s > 1e-6]
        y = self._flat(own.coefficients[:, :, :1])
        self.y = (y - self.basis @ (self.basis.T @ y))[:, 0]

    def __call__(self, block: Array) -> Array:
        """Of columns (K, 6, P): (rows, P)."""
        columns = Column.straight(("law",), block, np.ones(block.shape[2]), 1e6)
        spectrum = Spectrum(self.data, self.left, [columns], self.trim, self.named)
        out = self._flat(spectrum.coefficients[:, :, 1 : 1 + block.shape[2]])
        return np.asarray(out - self.basis @ (self.basis.T @ out))

    def _flat(self, coefficients: Array) -> Array:
        scaled = coefficients / self.deviation[:, :, None] * ~self.silent[:, :, None]
        return np.ascontiguousarray(scaled.reshape(-1, coefficients.shape[2]))


def _chunked(parts: Iterator[Array], atoms: Sequence[Atom], most: int = 60) -> Iterator[tuple[list[Atom], Array]]:
    waiting: list[Array] = []
    names: list[Atom] = []
    for atom, part in zip(atoms, parts, strict=True):
        waiting.append(part)
        names.append(atom)
        if sum(p.shape[2] for p in waiting) >= most:
            yield names, np.concatenate(waiting, axis=2)
            waiting, names = [], []
    if waiting:
        yield names, np.concatenate(waiting, axis=2)


def _slices(atoms: Sequence[Atom]) -> tuple[slice, ...]:
    ends = np.cumsum([0, *(len(a.terms) for a in atoms)])
    return tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(ends))


def surrogate_residuals(data: Dataset, left: Array, count: int, seed: int) -> Array:
    """Residuals (K, 6, count) that have nothing to do with the flights: the even ones shifted, the odd of random phase.

    All axes of a flight are shifted alike and turned by the same phases, so that they go together as they did.
    """
    rng = np.random.default_rng(seed)
    out = np.empty((*left.shape, count))
    known = data.by_record(np.nan_to_num(left))
    for record, own, into in zip(data.records, known, data.by_record(out), strict=True):
        n = len(record)
        least = min(round(SETTINGS.least_shift / record.dt_kept), n // 3)
        spectrum = np.fft.rfft(own, axis=0)
        for k in range(count):
            if k % 2 == 0 and n > 6:
                made = np.roll(own, int(rng.integers(least, n - least)), axis=0)
            else:
                phase = np.exp(2j * np.pi * rng.random(len(spectrum)))
                phase[0] = 1.0
                phase[-1] = 1.0 if n % 2 == 0 else phase[-1]  # what is real stays real
                made = np.fft.irfft(spectrum * phase[:, None], n, axis=0)
            into[:, :, k] = made
    return out


def distinct(found: Evidence) -> Evidence:
    """Without atoms that these flights do not move, and those that are the same as one before them, as far as names and
    earlier laws leave it: a yaw torque by sideways velocity is a pitch torque by climbing, where drag has a free point.
    """  # noqa: D205
    kept: list[int] = []
    seen: list[Array] = []
    single: list[str] = []
    same = dict(found.same)
    for k, own in enumerate(found.of):
        columns = found.X[:, own]
        size = np.sqrt(np.einsum("ij,ij->j", columns, columns))
        if not np.isfinite(size).all() or size.min() < 1e-2:
            continue
        if columns.shape[1] == 1:
            unit = columns[:, 0] / size
            alike = np.abs(np.stack(seen) @ unit) if seen else np.zeros(1)
            if alike.max() > SETTINGS.same:
                first, atom = single[int(alike.argmax())], found.atoms[k]
                same[first] = (*same.get(first, ()), atom, *found.same.get(atom.name, ()))
                continue
            seen.append(unit)
            single.append(found.atoms[k].name)
        kept.append(k)
    columns = (
        np.concatenate([np.arange(found.of[k].start, found.of[k].stop) for k in kept]) if kept else np.zeros(0, int)
    )
    names = tuple(found.atoms[k] for k in kept)
    return replace(found, atoms=names, of=_slices(names), X=found.X[:, columns.astype(int)], same=same)


REPORTED = ("speed", "rate", "height", "thrust", "time", "voltage_excess")
"""Quantities of one number whose flown range is told."""
CLIPPED = ("v", "omega", "height", "time", "voltage_excess", "thrust")
"""Quantities that a law's file holds within the range that was flown."""


def ranges(
    data: Dataset,
    model: Model,
    some: Sequence[Atom],
    numbers: dict[str, str],
    of: Sequence[str] = REPORTED,
    tail: float = 0.01,
) -> tuple[tuple[str, float, float], ...]:
    """Ranges of quantities that laws use, but for a share `tail` at both ends, over components, on these flights."""
    used = {n for a in some for n in a.lines}
    used |= {scalar for scalar, vector in (("speed", "v"), ("rate", "omega")) if vector in used}
    acting = WrenchModel(model.vehicle, model.effects)
    sides = [_rotor_side(r, acting) for r in data.records]
    values = evaluator(numbers)
    out = []
    for name in (n for n in of if n in used):
        probe = Atom(name, "", (Term(name, "", "", 1.0),))
        seen = np.concatenate([np.ravel(values([probe], *side)[0][0]) for side in sides])
        low, high = np.quantile(seen, (tail, 1.0 - tail))
        out.append((name, float(low), float(high)))
    return tuple(out)
