"""What named effects leave on some flights: atoms that gain more than chance there, and the laws fitted of them."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wrenchgap.flight import so3, work_files
from wrenchgap.flight.atomic import write_below
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.blocks import cosine
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.errors import means_by, rms
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.relevance import RELEVANCE, shifted
from wrenchgap.learn.discover import law_file
from wrenchgap.learn.discover.atoms import Atom, atoms, constants
from wrenchgap.learn.discover.evidence import CLIPPED, Evidence, Whitening, evidence, possible, ranges, responses
from wrenchgap.learn.discover.search import Step, best_on, coefficients, gain_beside, step
from wrenchgap.learn.discover.settings import SETTINGS
from wrenchgap.learn.identify.fit import Fit, fit, held_out, with_fit
from wrenchgap.learn.identify.least_squares import left_by
from wrenchgap.learn.posterior.explain import Explanation
from wrenchgap.learn.posterior.single_effects import uncertain_effects
from wrenchgap.plant import effects, own_effects
from wrenchgap.plant.model import Model


@dataclass(frozen=True)
class FoundAtom:
    """An atom that gains more than chance. `parts` are its leading coefficient on parts of the flights, each with a
    standard error; `stability` is the share of halves of the time in which it or one of `equivalents` is found again;
    `driven` says that it follows what is left, and does not make it.
    """  # noqa: D205

    step: Step
    atom: Atom
    equivalents: tuple[Atom, ...]
    parts: tuple[tuple[str, float, float], ...]
    stability: float
    driven: bool

    @property
    def formula(self) -> str:
        """As it is written."""
        return self.atom.formula

    @property
    def name(self) -> str:
        """Of its effect."""
        return law_name(self.atom)

    @property
    def holds(self) -> bool:
        """Whether it is found again, makes and does not follow what is left, and parts agree on its coefficient."""
        values = np.array([[value, std] for _, value, std in self.parts])
        if len(values) < 2:
            return self.stability >= SETTINGS.stability and not self.driven
        weight = 1.0 / np.maximum(values[:, 1], 1e-300) ** 2
        mean = float(values[:, 0] @ weight / weight.sum())
        agree = np.abs(values[:, 0] - mean) < SETTINGS.apart * values[:, 1] + 0.5 * abs(mean)
        return bool(np.all(agree)) and self.stability >= SETTINGS.stability and not self.driven


def law_name(atom: Atom) -> str:
    """The name of the effect that an atom is."""
    return f"law_{atom.name}"


def renamed(some: Sequence[Atom]) -> list[Atom]:
    """Laws by names that no effect has: with `--effects`, a law that was found before is one."""
    taken = effects.catalogue()

    def free(one: Atom) -> Atom:
        return one if law_name(one) not in taken else free(replace(one, name=f"{one.name}_again"))

    return [free(a) for a in some]


class Residual:
    """What named effects leave on some flights, and what atoms would make there."""

    def __init__(self, data: Dataset, model: Model, explanation: Explanation) -> None:
        """Where commands answer on axes of `data`, what they could have made is no evidence."""
        self.data, self.explanation, self.given, self.model = data, explanation, model, explanation.model
        self.left = np.nan_to_num(left_by(data, self.model))
        named = uncertain_effects(data, self.model)
        self.numbers = constants(model.vehicle, _volts(data))
        answered = bool(explanation.answering) and not data.answering  # and nothing of that is taken off here
        some = [a for a in atoms(model.vehicle) if not (answered and a.commanded)]
        every = possible(renamed(some), data, model)
        self.whitening = Whitening(data, model, self.left, named)
        self.first = evidence(self.whitening, self.model, self.left, every, self.numbers)

    def steps(self) -> tuple[FoundAtom, ...]:
        """Atoms that gain more than chance, one after the other, each on what the last leaves."""
        on, left, found = self.first, self.left, []
        for k in range(SETTINGS.most if on.atoms else 0):
            one = step(on, SETTINGS.equivalent)
            if one.p_value > SETTINGS.p_value:
                break
            found.append(self.described(one, on))
            atom = on.atoms[one.atom]
            theta = coefficients(on.columns([one.atom]), on.y, on.moment)[0]
            left = left - self.made([atom]) @ theta
            on = on.after(one.atom, left, self.whitening, seed=k + 1)
            if not on.atoms:
                break
        return self.needed(found)

    def needed(self, found: Sequence[FoundAtom]) -> tuple[FoundAtom, ...]:
        """Those that still gain more than chance did when the others that hold are there: one may say it better."""

        def at(one: FoundAtom) -> int:
            return self.first.atoms.index(one.atom)

        kept = list(found)
        for one in found:
            others = [at(f) for f in kept if f is not one and f.holds]
            if others and gain_beside(self.first, self.first.columns([at(one)]), others) <= one.step.null_quantile:
                kept.remove(one)
        return tuple(kept)

    def made(self, some: Sequence[Atom]) -> Array:
        """Measured wrenches (K, 6, P) that atoms make at typical coefficients."""
        return np.concatenate(list(responses(self.data, self.model, some, self.numbers)), axis=2)

    def described(self, one: Step, on: Evidence) -> FoundAtom:
        """What halves and parts of the flights say of the best atom."""
        near = {one.atom, *one.equivalents}
        moments = np.unique(on.moment // 2)
        rng = np.random.default_rng(0)
        halves = [rng.permutation(moments)[: max(1, len(moments) // 2)] for _ in range(SETTINGS.halves)]
        again = sum(best_on(on, np.isin(on.moment // 2, half)) in near for half in halves)
        atom = on.atoms[one.atom]
        parts = self._parts(on, one.atom)
        made = self.made([atom]) @ coefficients(on.columns([one.atom]), on.y, on.moment)[0]
        alike = [a for k in (one.atom, *one.equivalents) for a in (on.atoms[k], *on.same.get(on.atoms[k].name, ()))]
        driven = self.feeding(atom, made) or self.driven(atom)
        return FoundAtom(one, atom, tuple(alike[1:]), parts, again / SETTINGS.halves, driven)

    def driven(self, atom: Atom) -> bool:
        """Whether a law goes with what is left better as it is a moment later: then it follows, as the motion follows
        a gust that the commands answer, and does not make it (`learn.diagnose.relevance`). Better by what tells two
        laws apart: one that changes over minutes is the same a moment later.
        """  # noqa: D205
        made, gains = self.made([atom]), []
        for seconds in (0.0, RELEVANCE.later):
            moved = shifted(self.data, made.reshape(len(made), -1), seconds).reshape(made.shape)
            gains.append(gain_beside(self.first, self.whitening(moved), ()))
        return gains[1] > gains[0] + SETTINGS.equivalent

    def feeding(self, atom: Atom, made: Array) -> bool:
        """Whether a law of the motion alone feeds it at every moment: nothing passive does (damping takes energy out),
        and what a gust turns or pushes moves along with it at once.
        """  # noqa: D205
        feeds = _power(self.data, made, self.given.vehicle.body.com_B) > 0.0
        return atom.of_motion and bool(np.mean(feeds) > SETTINGS.feeding)

    def _parts(self, on: Evidence, k: int) -> tuple[tuple[str, float, float], ...]:
        """The leading coefficient on each flight, or on thirds of a single one."""
        X, terms = on.columns([k]), on.atoms[k].terms
        lead = int(np.argmax(np.abs(coefficients(X, on.y, on.moment)[0])))
        names = list(dict.fromkeys(r.flight for r in self.data.records))
        third = 3 * on.moment // (on.moment.max() + 1)
        parts = [(n, on.flight == f) for f, n in enumerate(names)]
        if len(names) == 1:
            parts = [(f"third {f + 1}", third == f) for f in range(3)]
        out = []
        for label, keep in parts:
            if len(np.unique(on.moment[keep])) >= SETTINGS.fewest:
                theta, covariance = coefficients(X[keep], on.y[keep], on.moment[keep])
                scale = terms[lead].scale
                out.append((label, float(theta[lead] * scale), float(np.sqrt(covariance[lead, lead]) * scale)))
        return tuple(out)


@dataclass(frozen=True)
class HeldOut:
    """Rms (6,) of what is left without and with the laws where they were not fitted, the share of the energy above the
    sensors' noise that they take off, and where that was.
    """  # noqa: D205

    before: Array
    after: Array
    energy_reduction: float
    where: str


class Fitted:
    """Laws as effects of their own, fitted with the effects that were named."""

    def __init__(self, on: Residual, steps: Sequence[FoundAtom]) -> None:
        self.on, self.steps = on, tuple(steps)
        self.members = [m.name for m in on.explanation.members]
        self.names = [s.name for s in steps]
        self.source = self._file()
        self.effects = loaded(self.source) if steps else []
        with effects.registered(self.effects):
            self.before: Fit = fit(on.data, on.given, self.members, start=on.explanation.fit)
            self.fit = fit(on.data, on.given, [*self.members, *self.names], base=self.before)

    def _file(self) -> str:
        on, laws = self.on, listed(self.steps)
        return law_file.source(laws, on.numbers, ranges(on.data, on.model, laws, on.numbers, CLIPPED, 0.0))

    def on_time(self) -> HeldOut:
        """On quarters of the time in turn."""
        data, given = self.on.data, self.on.given
        quarter = (SETTINGS.quarters * np.arange(len(data.block)) // len(data.block)).astype(np.intp)
        with effects.registered(self.effects):
            before = held_out(data, given, self.members, self.before, groups=quarter)
            after = held_out(data, given, [*self.members, *self.names], self.fit, groups=quarter)
        return _compared(data, before, after, "time that was not fitted, a quarter after the other")

    def on_flights(self, flights: Sequence[OpenFlight]) -> HeldOut:
        """On flights that were not fitted."""
        records = [r for f in flights for r in f.records]
        with effects.registered(self.effects):
            data = dataset(records, self.on.given, self.on.data.answering)
            before, after = (left_by(data, with_fit(self.on.given, f)) for f in (self.before, self.fit))
        return _compared(data, before, after, "flights that were not fitted")

    def law(self, one: FoundAtom) -> Law:
        """What is said of a law."""
        found = next(e for e in self.fit.effects if e.name == one.name)
        std = np.zeros_like(found.theta) if found.std is None else found.std
        made = self.on.made([one.atom]) @ (found.theta / np.array([t.scale for t in one.atom.terms]))
        power = _power(self.on.data, made, self.on.given.vehicle.body.com_B)
        return Law(
            name=one.name,
            formula=one.formula,
            coefficients=tuple(
                Coefficient(t.symbol, t.unit, float(v), float(s))
                for t, v, s in zip(one.atom.terms, found.theta, std, strict=True)
            ),
            causes=one.atom.causes,
            gain=one.step.gain,
            null_quantile=one.step.null_quantile,
            p_value=one.step.p_value,
            equivalents=tuple((law_name(a), a.formula) for a in one.equivalents),
            stability=one.stability,
            parts=one.parts,
            nearest=self._nearest(made),
            mean_power=float(np.mean(power)),
            feeding_share=float(np.mean(power > 0.0)),
            flown_ranges=ranges(self.on.data, self.on.model, [one.atom], self.on.numbers),
        )

    def _nearest(self, made: Array) -> tuple[str, float] | None:
        """The candidate of the catalogue whose prediction is nearest to that of a law (K, 6), and the cosine."""
        on = self.on
        start = np.nan_to_num(left_by(on.data, on.given))
        tried = [c for c in on.explanation.ranking if c.residual.shape == start.shape]
        rows = [(c.name, abs(cosine(on.data, start, np.nan_to_num(c.residual), start - made))) for c in tried]
        return max(rows, key=lambda row: row[1]) if rows else None


@dataclass(frozen=True)
class Coefficient:
    """One number of a law, with its standard deviation."""

    symbol: str
    unit: str
    value: float
    std: float


@dataclass(frozen=True)
class Law:
    """One law: `name` of its effect and `formula`, with its `coefficients`; what it depends on (`causes`).

    `p_value` is the share of residuals of chance in which as much was found; `gain` [nats] and what chance gains
    (`null_quantile`, its 95 % quantile). `equivalents` are names and formulas that predict the same on these flights.
    `stability` is the share of halves of the time in which it, or one of those, is found again; `parts` are its leading
    coefficient on parts of the flights, each with a standard error. `nearest` is the effect of the catalogue nearest to
    it, with the cosine between what both predict. `mean_power` [W] is F . v + M . omega on average, positive where it
    feeds the motion, and `feeding_share` the share of the time in which it does. `flown_ranges` are the ranges (1 to
    99 %) of its quantities on these flights.
    """

    name: str
    formula: str
    coefficients: tuple[Coefficient, ...]
    causes: tuple[str, ...]
    gain: float
    null_quantile: float
    p_value: float
    equivalents: tuple[tuple[str, str], ...]
    stability: float
    parts: tuple[tuple[str, float, float], ...]
    nearest: tuple[str, float] | None
    mean_power: float
    feeding_share: float
    flown_ranges: tuple[tuple[str, float, float], ...]


def listed(steps: Sequence[FoundAtom], others: int = 3) -> list[Atom]:
    """Atoms that a file has: the laws, and a few that predict the same as each."""
    found = [s.atom for s in steps]
    found += [a for s in steps for a in s.equivalents[:others]]
    return list({a.name: a for a in found}.values())


def loaded(source: str) -> list[tuple[effects.AnyEffect, effects.Source]]:
    """The effects of a file, which passes the checks that every user's own file has to."""
    with tempfile.TemporaryDirectory(dir=work_files.folder()) as folder:
        write_below(Path(folder), "law.py", source.encode())
        return own_effects.load(Path(folder) / "law.py")


def _compared(data: Dataset, before: Array, after: Array, where: str) -> HeldOut:
    before, after = (_centred(data, x) for x in (before, after))
    scale, noise = data.weights**2, np.nan_to_num(data.noise) ** 2
    excess = [float(np.maximum(np.mean(x**2, axis=0) - noise, 0.0) @ scale) for x in (before, after)]
    reduction = 1.0 - excess[1] / excess[0] if excess[0] > 0.0 else 0.0
    return HeldOut(rms(before), rms(after), reduction, where)


def _centred(data: Dataset, left: Array) -> Array:
    """A residual (K, 6) without the mean of each flight, which a constant takes off, and without commands' answers."""
    known = np.nan_to_num(left)
    return np.asarray(data.remaining(known - means_by(data.flight, known)[data.flight]))


def _power(data: Dataset, made: Array, com_B: Array) -> Array:
    """F . v + M . omega (K,) [W] of wrenches (K, 6) about the centre of mass; NaN where a force needs an unknown v."""
    if made[:, :3].any() and not all(r.has_pose for r in data.records):
        return np.full(len(made), np.nan)
    states = [r.state_kept for r in data.records]
    omega = np.concatenate([s.omega_B for s in states])
    velocity = np.concatenate([so3.rotate_inverse(s.quat_EB, s.velocity_E) for s in states])
    return np.asarray(np.sum(made * np.hstack((velocity + np.cross(omega, com_B), omega)), axis=1))


def _volts(data: Dataset) -> float:
    """The mean voltage [V] of these flights; one volt where none is known, and no law uses it."""
    known = [float(np.mean(r.state.voltage)) for r in data.records if r.state.voltage is not None]
    return float(np.mean(known)) if known else 1.0
