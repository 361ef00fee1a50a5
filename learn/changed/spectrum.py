"""What flights say of changes, by frequency: as `learn.posterior.spectrum`, or by means where nothing was excited.

Where commands answer the motion on all torques and the commanded force hardly varies, a hover, everything that changes
within a flight is the controller's answer to air and sensors: the measured torque hardly differs from zero while the
commanded one does, and any law that takes the command away again explains that. Whether something changed between two
flights shows there in the mean over a flight alone. The mean over a flight of all that may explain then stands in every
block of time, and the residual keeps what it wanders by, as the noise of that mean; all other frequencies are left out.
What leaks from axis to axis is no concern here: healthy flights leak alike.
"""

from collections.abc import Sequence

import numpy as np

from wrenchgap.flight.flight import Array, Indices
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.posterior.spectrum import Spectrum

EXCITED = 0.1
"""Standard deviation of the commanded force over its size from which on a flight is no hover."""
CALMER = 0.34
"""Quantile over flights whose excitation counts."""


class ChangeSpectrum(Spectrum):
    """Products of everything linear, by band and axis; band 0 is the mean over blocks of time."""

    def _arrange(self, data: Dataset) -> None:
        sensor = np.concatenate((self.sensor[:1], self.sensor))
        self.band = self.band + 1
        self.band[self.starts] = 0
        filled = np.flatnonzero(np.bincount(self.band))
        self.band = np.searchsorted(filled, self.band)
        self.sensor, self.leak = sensor[filled], np.zeros((len(filled), len(self.axes)))
        self.count, self.flight_of_block = self.counted(), data.flight[self.starts]
        self._means_alone([k for k, axis in enumerate(self.axes) if axis in answered(data)])

    def inexact(self, rows: Indices) -> Array:
        """The same without the mean over a flight: what a law is off by there is a constant wrench, a trim."""
        out = super().inexact(rows).copy()
        lines = self.coefficients[self.starts[:, None], :, rows].transpose(0, 2, 1)
        size = self.factors * np.sqrt(np.bincount(self.block))
        for f in np.unique(self.flight_of_block):
            own = np.where(self.flight_of_block == f, size, 0.0)
            own /= np.linalg.norm(own)
            lines = lines - own[:, None, None] * np.tensordot(own, lines, 1)
        out[0] = np.einsum("kap,kaq->apq", lines, lines) / np.maximum(self.count[0], 1.0)[:, None, None]
        return out

    def _means_alone(self, answering: Sequence[int]) -> None:
        """On these axes, of `axes`: means over flights of all but the residual, and nothing but means."""
        if not answering:
            return
        flight = self.flight_of_block
        for axis in answering:
            self.coefficients[self.within, axis] = 0.0
            self.count[1:, axis] = 0.0
            for f in np.unique(flight):
                rows = self.starts[flight == f]
                self.coefficients[rows, axis, 1:] = self.coefficients[rows, axis, 1:].mean(axis=0)


def answered(data: Dataset) -> tuple[int, ...]:
    """Axes on which the means of flights alone count: all where nothing was excited, else none.

    That is so where commands answer the motion on all measured torques, and the commanded force hardly varies.
    """
    torques = {axis for axis in range(3, 6) if data.measured_axes[axis]}
    if not torques or not torques <= set(data.answering):
        return ()
    return tuple(range(6)) if excitation(data) < EXCITED else ()


def excitation(data: Dataset) -> float:
    """How much the commanded force varies within a flight: its standard deviation over its size, of the calmer flights.

    Of two flights the calmer one counts: the other one alone has nothing to be compared with.
    """
    found = []
    for f in np.unique(data.flight):
        force = data.commanded[data.flight == f, :3]
        found.append(float(np.sqrt(force.var(axis=0).sum()) / np.linalg.norm(force, axis=1).mean()))
    return float(np.quantile(found, CALMER, method="lower"))
