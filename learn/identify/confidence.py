"""How often a name like this one is right: evidence turned into a probability that was calibrated on hidden effects.

    logit p = b . (1, separation from the nearest rival, log10 share, log evidence, log what is left over the noise,
                   verdict unknown)

The coefficients were fitted to every member that `explain` named in the benchmark of hidden effects
(`python -m benchmarks.hidden_effects.calibrate`), whose flights come from another engine with other formulas, and
checked on hidden effects that were left out of the fit; docs/hidden-effects.md shows how well stated and observed
frequencies agree. "Right" means that the effect, or one of its group, was really there.

A probability stated for other vehicles, other trajectories or real flights carries over as far as those resemble
these. It is a statement about the method, not a posterior under a model: that would assume that one of the candidates
is exactly true, and none ever is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrenchgap.learn.identify.search import Member
from wrenchgap.plant.effects import family

Array = NDArray[np.float64]

COEFFICIENTS: tuple[float, ...] = (3.247, 0.013, 0.0, 0.726, -0.729, -0.547)
"""b, in the order of `features`."""
FAR = 8.0
"""Separation beyond which more is no surer."""
SUREST = 0.98
"""Largest probability that is stated: what the number of flights behind the calibration can carry."""


def features(nearest: float, share: float, evidence: float, left: float, unknown: bool) -> Array:
    """What the probability depends on, (6,): see the module."""
    return np.array(
        [
            1.0,
            min(nearest, FAR),
            np.log10(np.clip(share, 1e-4, 1.0)),
            np.log(np.clip(evidence, 0.1, 10.0)),
            np.log(np.clip(left, 1.0, 30.0)),
            float(unknown),
        ]
    )


def confidence(member: Member, left: float, unknown: bool) -> float:
    """Probability that the member, or one of its group, is really there.

    `left` is the rms that the whole set leaves, over the noise, the worse of force and torque.
    """
    x = features(nearest(member), member.share, member.evidence, left, unknown)
    return float(min(SUREST, 1.0 / (1.0 + np.exp(-x @ np.array(COEFFICIENTS)))))


def nearest(member: Member) -> float:
    """Separation from the nearest rival outside group and family, `FAR` where there is none."""
    foreign = [r for r in member.rivals if family(r.name) != family(member.name)]
    outside = [r.separation for r in foreign if not r.alike and r.candidate.worthy]
    return float(min(outside, default=FAR))
