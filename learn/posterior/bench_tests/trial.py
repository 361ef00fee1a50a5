"""What a bench check is: which effects change its reading, what they make it, and what difference it resolves."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array, Mask
from wrenchgap.plant.vehicle import Vehicle

INEXACT = 0.1
"""Share of a fitted value that is open: laws are right to 3 % at best (docs/decisions/0009-honest-intervals.md), two of
them are compared, at two standard deviations."""
Fitted = Mapping[str, Array]
"""Effects of known values: theta (P,) in the order of `Effect.parameters`, by name."""


@dataclass(frozen=True)
class Setup:
    """A bench check on one vehicle.

    `action` says what to do, without a full stop. `predict` gives the reading (K,) that effects of known values lead
    to, in SI units, NaN where its amount is not known; none of them: what the model expects. `resolution` () or (K,) is
    the difference between two readings that the check resolves, in the same unit. `says` puts a reading into words,
    `changed` the reading of an effect that is there by an unknown amount.
    """

    action: str
    predict: Callable[[Fitted], Array]
    resolution: float | Array
    says: Callable[[Array], str]
    changed: str

    def alike(self, readings: Array) -> Mask:
        """Which readings (n, K) the check does not tell apart, (n, n).

        Their difference must exceed the resolution and what fitted values leave open: `INEXACT` of the larger deviation
        from the model's reading.
        """
        change = np.abs(readings - self.predict({}))
        larger = np.maximum(change[:, None], change)
        close = np.abs(readings[:, None] - readings) <= self.resolution + INEXACT * larger
        return np.asarray(close.all(axis=-1))

    def same(self, one: Array, other: Array) -> bool:
        """Whether the check does not tell these two readings (K,) apart."""
        return bool(self.alike(np.array([one, other]))[0, 1])


@dataclass(frozen=True)
class Trial:
    """A kind of bench check, for any vehicle.

    `minutes` is its cost, our estimate, tools at hand. Effects in `shows` change the reading; those in `unclear` may
    or may not, so that the check says nothing of a set with one of them; no other effect of the catalogue does.
    `setup` is called with the vehicle and with the known values of every set that is to be told apart, heaviest first,
    when one of them has an effect in `shows`; with `tilts` only where the vehicle has arms that tilt. `measures` and
    `resolves` say in words what is measured, and to what resolution.
    """

    name: str
    minutes: int
    shows: tuple[str, ...]
    setup: Callable[[Vehicle, Sequence[Fitted]], Setup]
    measures: str
    resolves: str
    unclear: tuple[str, ...] = ()
    tilts: bool = False


def bench_test(
    name: str,
    minutes: int,
    shows: tuple[str, ...],
    measures: str,
    resolves: str,
    unclear: tuple[str, ...] = (),
    *,
    tilts: bool = False,
) -> Callable[[Callable[[Vehicle, Sequence[Fitted]], Setup]], Trial]:
    """Decorates a `Trial.setup`; the name then is that of the trial."""
    return lambda setup: Trial(name, minutes, shows, setup, measures, resolves, unclear, tilts)


def whole(theta: Array) -> Array:
    """A reading that is the effect's parameters."""
    return theta


def reads(size: int, **parts: Callable[[Array], Array | Sequence[float]]) -> Callable[[Fitted], Array]:
    """`Setup.predict` of a reading (size,) that is the sum of what each effect adds: its theta to its part, by name."""

    def predict(fitted: Fitted) -> Array:
        there = [np.asarray(part(fitted[name]), dtype=float) for name, part in parts.items() if name in fitted]
        return np.asarray(sum(there, np.zeros(size)))

    return predict


def above(least: float, words: Callable[[float], str], none: str) -> Callable[[Array], str]:
    """`Setup.says` of one number: `words` for it where it is larger than this, else `none`."""
    return lambda reading: words(float(reading[0])) if reading[0] > least else none


def digits(value: float, resolution: float) -> str:
    """A number with as many decimals as its resolution is worth."""
    decimals = max(0, int(np.ceil(-np.log10(resolution) - 1e-9)))
    return f"{round(value, decimals) + 0.0:.{decimals}f}"  # + 0.0: no minus before a zero


def per_cent(value: float) -> str:
    """A relative change in per cent, with its sign and one decimal."""
    return f"{100 * value:+.1f} %"


def off(names: Sequence[str], resolution: float, write: Callable[[float], str], none: str) -> Callable[[Array], str]:
    """`Setup.says` of several numbers: those that are off by more than the resolution, the largest three by name."""

    def says(values: Array) -> str:
        large = np.flatnonzero(np.abs(values) > resolution)
        if large.size == 0:
            return none
        if large.size == len(values) > 2 and np.ptp(values) <= resolution:
            return f"{write(float(values.mean()))} on all"
        shown = large[np.argsort(-np.abs(values[large]), kind="stable")][:3]
        listed = ", ".join(f"{names[k]} {write(float(values[k]))}" for k in shown)
        return listed + (f" and {large.size - 3} more" if large.size > 3 else "")

    return says
