"""What is said of a set of effects that was fitted: the structure that it leaves, and the verdict.

    unknown   force or torque stay above `structure` times the noise and above the share `UNEXPLAINED` of what they
              were, the worst `UNUSUAL` of the time left aside, and where commands answer the motion `PREDICTABLE` of
              that depends on what was logged; or something is named, and a band of frequency of what is left is open
              (`unexplained_bands`); or an oscillation is found in what is left, or all of it pushes
              where one rotor does; or what explains most is at the limit of what is plausible, or takes nothing off
    nothing   no effect was named
    group     another effect would do as well in the place of the largest member
    effect    else

The rms of an axis hides what sits at one frequency, as a load on a rope that hardly swings. By band of frequency and
axis, b is the mean square that the model leaves on held-out time, a that of the named set, s that of the sensors'
noise, d what the laws of the set may be off by at most, D the mean of d over all frequencies, and e what any cause
shows elsewhere, on torques also the force at one radius of gyration (docs/theory/posterior.md, The verdict). A band is
open where

    a > structure^2 s    and    a > BAND_UNEXPLAINED^2 b    and    a > FAR^2 (d + e)    and    a > FAR^2 D

the last since a law that bends what it is given is off at other frequencies too. One gust or touch is no verdict: the
loudest tenth of the blocks of time, and one more, is left aside. A block `BENDS` times louder than the others has bent
the fit: then a band is open only where a is more than four times the mean square of what the set adds there, since a
bent fit errs by what it adds. The slowest band is left out: biases, batteries and trims are there, and the noise of
angular accelerations is least. Where commands answer the motion nothing is said: turbulence is open at all frequencies.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from wrenchgap.flight.flight import AXES, Array, Mask
from wrenchgap.learn.data.blocks import by_block
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import energy, force_and_torque, means_by, rms, weighted
from wrenchgap.learn.data.input_errors import EDGES
from wrenchgap.learn.diagnose.relevance import Relevance, relevance
from wrenchgap.learn.diagnose.residual_patterns import OneRotor, Oscillation, one_rotor, oscillation
from wrenchgap.learn.posterior.members import Member
from wrenchgap.learn.posterior.posterior import WeighedSets
from wrenchgap.learn.posterior.single_effects import ModelResidual
from wrenchgap.learn.posterior.spectrum import leaking, sensor_spectrum, transformed


class Verdict(StrEnum):
    """What the flights show to be missing; see the module."""

    EFFECT = "effect"
    GROUP = "group"
    UNKNOWN = "unknown"
    NOTHING = "nothing"


UNEXPLAINED = 0.25
"""Structure is left where the rms of force or torque stays above `structure` times the noise and above this share
of what it was."""
PREDICTABLE = 0.3
"""Share of what is left that must depend on what was logged to be missing physics, where commands answer the motion:
those answer turbulence too (`learn.diagnose.relevance.Relevance.driven`)."""
UNUSUAL = 0.1
"""Share of the time, the loudest, that is left aside."""
FEWEST = 5
"""Blocks of time below which nothing is said about what the rest depends on."""
BAND_UNEXPLAINED = 0.4
"""Share of the rms in a band that a set which explains the band does not leave; in one band of many a law that is
nearly right leaves more of it than over all (`UNEXPLAINED`)."""
FAR = 4.0
"""How many times what the laws of a set may be off by is no longer their inexactness."""
BENDS = 6.0
"""How many times the rms of the others a block has that bends the fit."""


@dataclass(frozen=True)
class OpenBand:
    """From `low_hz` to `high_hz` an `axis` (of six) keeps `over_noise` times the rms of the sensors' noise there."""

    axis: int
    low_hz: float
    high_hz: float
    over_noise: float


@dataclass(frozen=True, repr=False)
class ResidualStructure:
    """What the named set leaves.

    `open` are axes (6,) on which structure is left, `bands` the frequencies at which the set leaves some. `oscillation`
    is one found in the residual, `one_rotor` the rotor in whose direction it pushes; `named_there` says that what is
    named pushes there too: the mean of what comes and goes, whose name is open. `depends` says on what it depends,
    where axes are open; `concentrated` is the share of the residual that sits in the worst tenth of the time; `left` is
    its rms over that of the noise, the worse of force and torque.
    """

    open: Mask
    oscillation: Oscillation | None
    one_rotor: OneRotor | None
    depends: Relevance | None
    concentrated: float
    left: float
    bands: tuple[OpenBand, ...]
    named_there: bool


def residual_structure(
    on: ModelResidual, found: WeighedSets, members: Sequence[Member], left: Array
) -> ResidualStructure:
    """Of what the likeliest set, of these members, leaves (K, 6) on held-out time."""
    data, vehicle = on.data, on.model.vehicle
    bands = unexplained_bands(on, found, left) if members else ()
    loud = open_axes(on, left) | np.isin(np.arange(6), [b.axis for b in bands])
    pushing = one_rotor(data, vehicle, left) if loud.any() else None
    mean = one_rotor(data, vehicle, on.given - left) if pushing and members else None
    usual_energy = energy(left[usual(data, left)], data.weights)
    return ResidualStructure(
        open=loud,
        oscillation=oscillation(data, left),
        one_rotor=pushing,
        depends=relevance(data, left) if loud.any() and len(np.unique(data.block)) >= FEWEST else None,
        concentrated=1.0 - usual_energy / max(energy(left, data.weights), 1e-30),
        left=float(np.nanmax(force_and_torque(rms(left)) / force_and_torque(data.noise))),
        bands=bands,
        named_there=bool(pushing and mean and set(pushing.rotors) & set(mean.rotors)),
    )


def usual(data: Dataset, residual: Array) -> Mask:
    """Samples (K,) outside the tenth of the blocks with the largest residual: one gust or touch is no verdict."""
    loud = by_block(data.block, np.sum(weighted(residual, data.weights) ** 2, axis=1))
    return np.asarray(loud[data.block] <= np.quantile(loud, 1.0 - UNUSUAL, method="lower"))


def open_axes(on: ModelResidual, left: Array) -> Mask:
    """Axes (6,) with structure left: where force or torque is well above noise and a quarter of what it was."""
    some = usual(on.data, left)
    before, after = (rms(on.data.unanswered(r)[some]) for r in (on.given, left))
    noise = on.data.noise
    loud = (after > on.settings.structure * noise) & (after > UNEXPLAINED * before)
    worse = force_and_torque(after) > np.maximum(
        on.settings.structure * force_and_torque(noise), UNEXPLAINED * force_and_torque(before)
    )
    return np.asarray(loud & np.repeat(worse, 3))


def unexplained_bands(on: ModelResidual, found: WeighedSets, left: Array) -> tuple[OpenBand, ...]:
    """Bands that the likeliest set, which leaves `left` (K, 6) on held-out time, does not explain; loudest first."""
    if on.data.answering:
        return ()
    axes = np.flatnonzero(on.data.measured_axes)
    coefficients, block, hertz = transformed(
        on.data.records, np.stack((on.given, left), axis=2)[:, axes], on.settings.block
    )
    present, band = np.unique(np.digitize(hertz, EDGES), return_inverse=True)
    noise = sensor_spectrum(on.data, hertz, band)[:, axes]
    cells = (int(block.max()) + 1) * len(present)
    each = means_by(block * len(present) + band, coefficients[:, :, 1] ** 2, cells)
    each = each.reshape(-1, len(present), len(axes))
    loudness = np.sum((each / noise)[:, present > 0] * np.bincount(band)[present > 0, None], axis=(1, 2))
    aside = np.argsort(loudness)[-1 - math.floor(UNUSUAL * len(loudness)) :]
    usual = ~np.isin(block, aside)
    kept = np.bincount(band[usual], minlength=len(present))
    if not kept.any():  # a flight of one block or two
        return ()
    coefficients, band = coefficients[usual], band[usual]
    given, remains = coefficients[:, :, 0], coefficients[:, :, 1]
    before, after, adds = (means_by(band, x**2, len(present)) for x in (given, remains, given - remains))
    inexact = found.best.scored_set.scored.inexact
    anywhere = np.average(inexact, axis=0, weights=kept)
    there = np.maximum(before - noise, 0.0)
    forces = axes < len(AXES) // 2
    levers = on.settings.leak**2 * there[:, forces].sum(axis=1, keepdims=True) / on.data.weights[axes] ** 2
    off = inexact + leaking(there, axes, on.settings.leak) + np.where(forces, 0.0, levers)
    loud = after > np.maximum.reduce(
        [on.settings.structure**2 * noise, BAND_UNEXPLAINED**2 * before, FAR**2 * np.maximum(off, anywhere)]
    )
    loud &= (after > np.minimum(each.max(axis=0) / BENDS**2, 4.0 * adds)) & (present > 0)[:, None]
    edges = (0.0, *EDGES, float(hertz.max()))
    rows = [
        OpenBand(int(axes[j]), edges[present[k]], edges[present[k] + 1], float(np.sqrt(after[k, j] / noise[k, j])))
        for k, j in zip(*np.nonzero(loud), strict=True)
    ]
    return tuple(sorted(rows, key=lambda b: -b.over_noise))


def decide(
    on: ModelResidual, members: Sequence[Member], rest: ResidualStructure, *, at_limit: Collection[str] = ()
) -> Verdict:
    """Unknown where something was found in what is left, or structure is left; where commands answer the motion, and
    with it turbulence, only structure that can be predicted is one. Unknown, too, where what explains most is
    `at_limit` of what is plausible: that says that its law is another one; and where nothing that is named takes
    anything off the error as it is, whatever it takes off what commands did not answer.
    """  # noqa: D205
    turbulent = bool(on.data.answering) and (rest.depends is None or rest.depends.driven < PREDICTABLE)
    if rest.oscillation or rest.one_rotor or (rest.open.any() and not turbulent):
        return Verdict.UNKNOWN
    if not members:
        return Verdict.NOTHING
    if members[0].name in at_limit or not any(m.share > 0.0 for m in members):
        return Verdict.UNKNOWN
    return Verdict.GROUP if members[0].alike else Verdict.EFFECT
