"""Whether anything disturbed the flights, on the axes where commands answer the motion.

Where they answer a disturbance, what linear responses to the commands explain is no evidence, and what no command
explains moved with the disturbance (`learn.posterior.spectrum`). But motors that speed up and slow down otherwise, or a
curved thrust, are no linear response either: what they make would be called a disturbance, and no effect could
explain it. So where all candidates at once come close, sets are searched on the whole wrench too. One that leaves no
more there than the sensors' noise, a few per cent of what was there or of what was commanded, or what clocks make that
are half a sample apart, in every band, leaves no room for a disturbance: the commands answered none, and the wrench is
evidence as it is (the direct regression in a closed loop errs by the ratio of disturbance to command, and with nothing
but the sensors' noise left it is unbiased: Forssell and Ljung, Automatica 35, 1999, sec. 5).
"""

from collections.abc import Sequence

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.errors import means_by
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.relinearisation import spectrum_of
from wrenchgap.learn.posterior.score import Scored
from wrenchgap.learn.posterior.single_effects import ModelResidual, model_residual
from wrenchgap.learn.posterior.spectrum import Spectrum, transformed

LITTLE = 0.05
"""Share of the rms that the model leaves in a band which a set that explains it may leave: laws are not exact."""
INEXACT = 0.02
"""Share of the rms of the commands in a band which may be left: no actuation is known better. Of slow torques the
sensors' noise is far below that, so that without it a vehicle of which nothing is missing seemed disturbed."""
STAMPS = 0.5
"""Share of a sample's period by which clocks may be apart: a stamp is of the beginning of a sample or of its end."""
CLOSE = 0.35
"""Share of the rms that candidates may leave as straight lines: all at once on an axis, a likely set in a band."""


def without_feedback(on: ModelResidual) -> ModelResidual:
    """The same flights, the wrench as it is."""
    return model_residual(on.data.unanswering(), on.model, on.settings)


def may_be_disturbance_free(on: ModelResidual, free: ModelResidual, columns: Sequence[Column]) -> bool:
    """Whether all of the candidates at once leave little on the axes where commands of `on` answer."""
    space = spectrum_of(free, columns)
    in_all = [np.sum(space.count * squares, axis=0) for squares in (space.saturated()[0], *_scales(space, on))]
    return bool(np.all((in_all[0] < _enough(on, CLOSE, *in_all[1:]))[np.isin(space.axes, on.data.answering)]))


def disturbance_free(on: ModelResidual, free: ModelResidual, sets: Sequence[Scored], *, nearly: bool = False) -> bool:
    """Whether one of these sets on the wrench as it is leaves no disturbance, where commands say something.

    `nearly`, for sets of straight lines: `CLOSE` over `LITTLE` times the rms that is none is near enough.
    """
    space, most = spectrum_of(free, ()), (CLOSE / LITTLE) ** 2 if nearly else 1.0
    enough, answering = most * _enough(on, LITTLE, *_scales(space, on)), np.isin(space.axes, on.data.answering)
    return any(np.all(((one.left < enough) | (space.count == 0.0))[:, answering]) for one in sets)


def _scales(space: Spectrum, on: ModelResidual) -> tuple[Array, Array, Array, Array]:
    """Mean squares (bands, A) of the sensors' noise, of what the model leaves, of the commands, their means over blocks
    aside, and of what of them clocks make that are `STAMPS` apart.
    """  # noqa: D205
    records, sent = on.data.records, on.data.commanded[:, space.axes, None]
    apart = np.concatenate([STAMPS * r.dt * np.gradient(r.commanded, r.dt_kept, axis=0) for r in records])
    commanded = transformed(records, sent, on.settings.block, without_mean=True)[0]
    shifted = transformed(records, apart[:, space.axes, None], on.settings.block)[0]
    squares = [means_by(space.band, each[:, :, 0] ** 2) for each in (commanded, shifted)]
    return space.sensor, space.products[:, :, 0, 0], squares[0], squares[1]


def _enough(on: ModelResidual, share: float, sensor: Array, given: Array, commanded: Array, shifted: Array) -> Array:
    """Mean squares that leave no room for a disturbance, from those of `_scales`."""
    each = (on.settings.structure**2 * sensor, share**2 * given, INEXACT**2 * commanded, shifted)
    return np.asarray(np.max(each, axis=0))
