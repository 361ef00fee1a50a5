"""Whether anything disturbed the flights, on the axes where commands answer the motion.

Where they answer a disturbance, what linear responses to the commands explain is no evidence, and what no command
explains moved with the disturbance (`learn.posterior.spectrum`). But motors that speed up and slow down otherwise, or a
curved thrust, are no linear response either: what they make would be called a disturbance, and no effect could
explain it. So where all candidates at once come close, sets are searched on the whole wrench too. One that leaves no
more there than the sensors' noise, or a few per cent of what was there or of what was commanded, in every band, leaves
no room for a disturbance: the commands answered none, and the wrench is evidence as it is (the direct regression in a
closed loop errs by the ratio of disturbance to command, and with nothing but the sensors' noise left it is unbiased:
Forssell and Ljung, Automatica 35, 1999, sec. 5).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.posterior import Posterior
from wrenchgap.learn.posterior.relinearisation import spectrum_of
from wrenchgap.learn.posterior.single_effects import ModelResidual, model_residual
from wrenchgap.learn.posterior.spectrum import Spectrum, mean_squares, transformed

LITTLE = 0.05
"""Share of the rms that the model leaves in a band which a set that explains it may leave: laws are not exact."""
INEXACT = 0.02
"""Share of the rms of the commands in a band which may be left: no actuation is known better. Of slow torques the
sensors' noise is far below that, so that without it a vehicle of which nothing is missing seemed disturbed."""
CLOSE = 0.35
"""Share of the rms on an axis that all candidates at once may leave, straight lines that they are."""


def without_feedback(on: ModelResidual) -> ModelResidual:
    """The same flights, the wrench as it is."""
    return model_residual(on.data.unanswering(), on.model, on.settings)


def may_be_disturbance_free(on: ModelResidual, free: ModelResidual, columns: Sequence[Column]) -> bool:
    """Whether all of the candidates at once leave little on the axes where commands of `on` answer."""
    space = spectrum_of(free, columns)

    def in_all(squares: Array) -> Array:
        return np.asarray(np.sum(space.count * squares, axis=0))

    enough = np.maximum(on.settings.structure**2 * in_all(space.sensor), CLOSE**2 * in_all(space.products[:, :, 0, 0]))
    enough = np.maximum(enough, INEXACT**2 * in_all(commanded(space, on)))
    return bool(np.all((in_all(space.saturated()[0]) < enough)[_answering(space, on)]))


def disturbance_free(on: ModelResidual, free: ModelResidual, found: Posterior) -> bool:
    """Whether one of the likeliest sets on the wrench as it is leaves no disturbance, where commands say something."""
    space = spectrum_of(free, ())
    enough = np.maximum(on.settings.structure**2 * space.sensor, LITTLE**2 * space.products[:, :, 0, 0])
    enough = np.maximum(enough, INEXACT**2 * commanded(space, on))
    little = [((c.scored.left < enough) | (space.count == 0.0))[:, _answering(space, on)] for c in found.wholes]
    return any(bool(np.all(cells)) for cells in little)


def commanded(space: Spectrum, on: ModelResidual) -> Array:
    """Mean squares (bands, A) of the commands, their means over blocks aside."""
    sent = transformed(on.data.records, on.data.commanded[:, space.axes, None], on.settings.block, without_mean=True)[0]
    return mean_squares(sent[:, :, 0], space.band)


def _answering(space: Spectrum, on: ModelResidual) -> NDArray[np.bool_]:
    return np.isin(space.axes, on.data.answering)
