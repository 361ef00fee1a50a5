"""The vertical axis of a plot: its unit with a prefix, its range with a least height, and ticks that differ.

The charts of the browser round their ticks to three decimals, which makes "0.001, 0.001, 0" of the torques of a vehicle
of 30 g; ticks are therefore placed and written here.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wrenchgap.flight.flight import Array

PREFIXES = ((0.1, 1.0, ""), (1e-4, 1e3, "m"), (0.0, 1e6, "\u00b5"))
"""From which size on [unit], the factor of the shown numbers, and the letter of the SI."""
PREFIXED = ("N", "Nm", "rad", "rad/s", "m", "m/s")
"""Units that take a prefix; others have one already, or are not of the SI."""


def prefixed(unit: str, largest: float) -> tuple[float, str]:
    """Factor and unit in which sizes up to `largest` [unit] are shown, e.g. 1e3 and "mNm"."""
    if unit not in PREFIXED or not np.isfinite(largest):
        return 1.0, unit
    factor, letter = next((factor, letter) for least, factor, letter in PREFIXES if largest >= least)
    return factor, letter + unit


def limits(values: Array, floor: float = 0.0) -> tuple[float, float]:
    """Range of an axis: all finite values with a margin, about their middle.

    At least `floor`, 1e-6 [unit] and 1e-9 of the values high: below that a curve is rounding noise.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return -1.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    least = max(floor, 1e-6, 1e-9 * max(abs(low), abs(high)))
    half = max(0.56 * (high - low), 0.5 * least)
    middle = 0.5 * (low + high)
    return middle - half, middle + half


def ticks(low: float, high: float, most: int = 5, letters: int = 7) -> tuple[tuple[float, ...], tuple[str, ...]]:
    """Round numbers within a range, at most `most`, and each as text with the digits that tell it from the next.

    Where that takes more `letters` than fit beside a chart, as for a latitude, the first is written shortly and the
    others as what is added to it.
    """
    rough = (high - low) / most
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(next(s for s in (1.0, 2.0, 2.5, 5.0, 10.0) if s * power >= rough * (1.0 - 1e-9)) * power)
    first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
    places = tuple(k * step for k in range(first, last + 1))
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    decimals += round(step * 10.0**decimals, 6) % 1.0 > 0.0  # of a step of 2.5
    words = tuple(f"{place:.{decimals}f}" if k else "0" for k, place in enumerate(places, first))
    return places, words if max(map(len, words), default=0) <= letters else _offsets(places, step)


def _offsets(places: Sequence[float], step: float) -> tuple[str, ...]:
    return (f"{places[0]:.5g}", *(f"+{k * step:.3g}" for k in range(1, len(places))))
