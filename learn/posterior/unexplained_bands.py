"""At which frequencies what was named leaves something.

The rms of an axis hides what sits at one frequency: a load on a rope that hardly swings, a tank, a magnet on a slow
mission leave less than the sensors' noise has over all frequencies, but several times the noise in a band. By band of
frequency and axis (`learn.posterior.spectrum`), b is the mean square that the model leaves on held-out time, a that of
the named set, s that of the sensors' noise, d what the laws of the set may be off by at most
(`learn.posterior.score.Scored.inexact`), D the mean of d over all frequencies, and e what any cause shows elsewhere: a
share `leak` of all of the force, or torque, that the model leaves in the band, and on torques that of the force at one
radius of gyration, since a force attacks somewhere. A band is open where

    a > structure^2 s    and    a > UNEXPLAINED^2 b    and    a > FAR^2 (d + e)    and    a > FAR^2 D

the last since a law that bends what it is given is off at other frequencies too. One gust or touch is no verdict: the
loudest tenth of the blocks of time, and one more, is left aside. A block `BENDS` times louder than the others has bent
the fit: then a band is open only where a is more than four times the mean square of what the set adds there, since a
bent fit errs by what it adds. The slowest band is left out: biases, batteries and trims are there, and the noise of
angular accelerations is least. Where commands answer the motion nothing is said: turbulence is open at all frequencies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.data.input_errors import EDGES
from wrenchgap.learn.posterior.posterior import Posterior
from wrenchgap.learn.posterior.single_effects import ModelResidual
from wrenchgap.learn.posterior.spectrum import leaking, sensor_spectrum, transformed

UNEXPLAINED = 0.4
"""Share of the rms in a band that a set which explains the band does not leave; in one band of many a law that is
nearly right leaves more of it than over all (`learn.posterior.verdict.UNEXPLAINED`)."""
FAR = 4.0
"""How many times what the laws of a set may be off by is no longer their inexactness."""
UNUSUAL = 0.1
"""Share of the blocks of time, the loudest, that is left aside."""
BENDS = 6.0
"""How many times the rms of the others a block has that bends the fit."""


@dataclass(frozen=True)
class OpenBand:
    """From `low_hz` to `high_hz` an `axis` (of six) keeps `over_noise` times the rms of the sensors' noise there."""

    axis: int
    low_hz: float
    high_hz: float
    over_noise: float


def unexplained_bands(on: ModelResidual, found: Posterior, left: Array) -> tuple[OpenBand, ...]:
    """Bands that the likeliest set, which leaves `left` (K, 6) on held-out time, does not explain; loudest first."""
    if on.data.answering:
        return ()
    axes = np.flatnonzero(on.data.measured_axes)
    coefficients, block, hertz = transformed(
        on.data.records, np.stack((on.given, left), axis=2)[:, axes], on.settings.block
    )
    present, band = np.unique(np.digitize(hertz, EDGES), return_inverse=True)
    noise = sensor_spectrum(on.data, hertz, band)[:, axes]
    each = _by_block(coefficients[:, :, 1], block, band)
    loudness = np.sum((each / noise)[:, present > 0] * np.bincount(band)[present > 0, None], axis=(1, 2))
    aside = np.argsort(loudness)[-1 - math.floor(UNUSUAL * len(loudness)) :]
    usual = ~np.isin(block, aside)
    kept = np.bincount(band[usual], minlength=len(present))
    if not kept.any():  # a flight of one block or two
        return ()
    coefficients, band = coefficients[usual], band[usual]
    before, after = (_means(coefficients[:, :, k], band, kept) for k in range(2))
    adds = _means(coefficients[:, :, 0] - coefficients[:, :, 1], band, kept)
    inexact = found.best.scored_set.scored.inexact
    anywhere = np.average(inexact, axis=0, weights=kept)
    there = np.maximum(before - noise, 0.0)
    off = inexact + leaking(there, axes, on.settings.leak)
    off += _levers(there, axes, on.data.weights[axes], on.settings.leak)
    loud = after > np.maximum.reduce(
        [on.settings.structure**2 * noise, UNEXPLAINED**2 * before, FAR**2 * np.maximum(off, anywhere)]
    )
    loud &= (after > np.minimum(each.max(axis=0) / BENDS**2, 4.0 * adds)) & (present > 0)[:, None]
    edges = (0.0, *EDGES, float(hertz.max()))
    rows = [
        OpenBand(int(axes[j]), edges[present[k]], edges[present[k] + 1], float(np.sqrt(after[k, j] / noise[k, j])))
        for k, j in zip(*np.nonzero(loud), strict=True)
    ]
    return tuple(sorted(rows, key=lambda b: -b.over_noise))


def _means(coefficients: Array, band: NDArray[np.intp], count: NDArray[np.intp]) -> Array:
    """Mean squares (bands, axes) of coefficients (K, axes); zero in a band of which the time left has none."""
    sums = [np.bincount(band, weights=x**2, minlength=len(count)) for x in coefficients.T]
    return np.asarray(np.stack(sums, axis=1) / np.maximum(count, 1)[:, None])


def _by_block(coefficients: Array, block: NDArray[np.intp], band: NDArray[np.intp]) -> Array:
    """Mean squares (blocks, bands, axes) of coefficients (K, axes); zero where a block has none in a band."""
    size = block.max() + 1, band.max() + 1
    cell = block * size[1] + band
    sums = [np.bincount(cell, weights=x**2, minlength=size[0] * size[1]) for x in coefficients.T]
    count = np.maximum(np.bincount(cell, minlength=size[0] * size[1]), 1)
    return np.asarray((np.stack(sums, axis=1) / count[:, None]).reshape(*size, -1))


def _levers(power: Array, axes: NDArray[np.intp], weights: Array, share: float) -> Array:
    """Mean squares (bands, axes) on torques of this share of all of the force at the length of the weights (axes,)."""
    forces = axes < len(AXES) // 2
    whole = share**2 * power[:, forces].sum(axis=1, keepdims=True)
    return np.asarray(np.where(forces, 0.0, whole / weights**2))
