"""The second-order Butterworth filter of every analysis, in closed form, and what a Hann window is.

`scipy.signal` gives the same numbers to the last digit (tests/flight/test_second_order.py); importing it takes a third
of the time in which `wrenchgap inspect` or the page is there, since it brings `scipy.stats` and much else along.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from wrenchgap.flight.block_integrals import Complex
from wrenchgap.flight.flight import Array


def butterworth(cutoff_hz: float, rate: float) -> Array:
    """Numerator and denominator (6,) of a second-order low-pass at `rate` [Hz], -3 dB at the cut-off.

    Poles at 45 deg of the half circle, of a cut-off that the bilinear transform bends back to where it is wanted.
    """
    bent = 4.0 * np.tan(np.pi * (2.0 * cutoff_hz / rate) / 2.0)
    poles = bent * -np.exp(1j * np.pi * np.array([-1.0, 1.0]) / 4.0)
    gain = bent**2 * np.real(1.0 / np.prod(4.0 - poles))
    first, second = (4.0 + poles) / (4.0 - poles)
    return np.concatenate((gain * np.array([1.0, 2.0, 1.0]), [1.0, -(first + second).real, (first * second).real]))


def steady_state(section: Array) -> Array:
    """State (2,) that a constant input of one leaves in the transposed direct form II of a section (6,)."""
    b, a = section[:3], section[3:]
    moves = np.array([[1.0 + a[1], -1.0], [a[2], 1.0]])
    return np.asarray(np.linalg.solve(moves, b[1:] - a[1:] * b[0]))


@lru_cache(maxsize=16)
def low_pass_section(dt: float, cutoff_hz: float) -> tuple[Array, Array]:
    """The section (6,) of a low-pass for samples every `dt` [s], and its `steady_state` (2,)."""
    section = butterworth(cutoff_hz, 1.0 / dt)
    return section, steady_state(section)


def response(section: Array, frequency: Array, rate: float) -> Complex:
    """Of a section (6,) at `frequency` (F,) [Hz]."""
    back = np.exp(-1j * (2.0 * np.pi * frequency / rate))
    top, bottom = ((c + back * (b + back * a)) for c, b, a in (section[:3], section[3:]))
    return np.asarray(top / bottom)


def hann(count: int) -> Array:
    """The periodic window of Hann (count,): one period of a raised cosine."""
    return np.asarray(0.5 + 0.5 * np.cos(np.linspace(-np.pi, np.pi, count + 1)[:-1]))
