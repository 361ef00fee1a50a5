"""Let go of a correction that rests on a guess (paper, 'Utilize posterior uncertainty prediction').

    beta = 1 / (1 + exp(-kappa (sigma - sigma_th)))
    dW  <- a beta dW_prev + (1 - beta) dW*                  a = exp(-dt / tau_d)

sigma is the largest standard deviation over the outputs at W_des + dW*, dW_prev the last *filtered* correction, dW*
the new *unfiltered* optimum. Near the data beta ~ 0 and dW = dW*; far away beta ~ 1 and dW dies out with the time
constant tau_d. At constant sigma and dW* the steady-state gain is (1 - beta) / (1 - a beta).

The paper publishes neither kappa, sigma_th nor a. Its sigma contains the noise and so has a floor, above which the
threshold must lie: sigma_th is half way between the floor (99th percentile over the training inputs) and the prior's
sigma (infinitely far away), and kappa = 9.2 / gap makes beta go from 1 % to 99 % between the two.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from wrenchgap.flight.flight import Array, Mask
from wrenchgap.plant.mismatch import Follows, KnowsItsData, MismatchModel

LOGIT_99 = 2.0 * float(np.log(99.0))
"""Width of the logistic from 1 % to 99 %, in units of 1 / kappa: 9.19."""


@dataclass(frozen=True)
class UncertaintyFilter:
    """sigma and beta of a prediction, and the filtered correction.

    `offset` (L,) and `scale` (L,) make sigma = max_l (std_l - offset_l) / scale_l over the outputs where `watched`
    (L,) is true: offset 0 and scale 1 give the paper's maximum in N or Nm. `threshold` may be infinite (never
    filters), `decay` is a.
    """

    watched: Mask
    offset: Array
    scale: Array
    threshold: float
    kappa: float
    decay: float

    def sigma(self, std: Array) -> float:
        """The one number that decides, from the standard deviations (L,) of the outputs."""
        return float(np.max(((std - self.offset) / self.scale)[self.watched]))

    def beta(self, sigma: float) -> float:
        """Distrust, 0 to 1; safe for every finite sigma."""
        if np.isinf(self.threshold):
            return 0.0
        return float(expit(self.kappa * (sigma - self.threshold)))

    def filtered(self, optimum: Array, previous: Array, beta: float) -> Array:
        """The next correction (6,) from the new optimum and the previous filtered correction."""
        return np.asarray(self.decay * beta * previous + (1.0 - beta) * optimum)


def default_filter(
    model: MismatchModel | Follows,
    decay: float,
    threshold: float | None,
    kappa: float | None,
    normalise: bool | None,
    min_growth: float = 0.05,
) -> UncertaintyFilter:
    """Filter with the defaults of this module where `threshold` and `kappa` are None.

    `normalise` None means: only where outputs mix forces and torques. Normalised, an output's sigma is 0 at its
    training percentile and 1 at its prior. A model that cannot tell how sigma grows away from its data is not
    filtered, unless a threshold is given. An output is watched if its sigma grows by `min_growth` of the prior.
    """
    offset, scale = np.zeros(len(model.outputs)), np.ones(len(model.outputs))
    watched, middle, steep = scale > 0, np.inf, 1.0
    if isinstance(model, KnowsItsData):
        floor, prior = model.sigma_training, model.sigma_prior
        tells = prior - floor > min_growth * prior
        if tells.any():
            watched = tells
            mixed = len({name.split("_")[0] for name in model.outputs}) > 1
            if mixed if normalise is None else normalise:
                offset, scale = np.where(watched, floor, 0.0), np.where(watched, prior - floor, 1.0)
            low, high = (float(np.max(((level - offset) / scale)[watched])) for level in (floor, prior))
            gap = max(high - low, min_growth * high)
            middle, steep = low + gap / 2, LOGIT_99 / gap
    threshold, kappa = (given if given is not None else usual for given, usual in ((threshold, middle), (kappa, steep)))
    return UncertaintyFilter(watched, offset, scale, threshold, kappa, decay)
