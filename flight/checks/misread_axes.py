"""Whether a sensor's axis reads its own motion, at all times, or, from a moment on, the opposite or another axis's.

In windows of time (`sensor_scales`) the odometry shows T_j on axis j, and a sensor reads R_k on axis k. The correlation
c_jk has a Fisher transform z = arctanh(c) sqrt(n - 3) of standard deviation one (Fisher 1921), with n windows that do
not overlap. Axis k misreads in an interval where z of another axis or sign is beyond chance, and beyond chance larger
than that of its own. The largest of N Gaussians exceeds sqrt(z^2 + 2 log N) about as rarely as one exceeds z. Noise on
either makes all of them small, and says nothing. Intervals begin or end with the flight: what fails or is set anew
stays so, and an estimator that is wrong for a while is no sensor that lies.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.checks.sensor_windows import SCALE
from wrenchgap.flight.flight import Array, Indices


@dataclass(frozen=True)
class Misreading:
    """What an axis reads instead (`axis` times `sign`) from `start` on, or until `stop` [s]; both None: throughout.

    `inside` and `outside` are correlations with what it should read, the latter None where it is so throughout.
    """

    own: str
    axis: str
    sign: float
    start: float | None
    stop: float | None
    inside: float
    outside: float | None

    @property
    def words(self) -> str:
        """What, when, and both numbers."""
        what = "what it should" if self.axis == self.own else f"what {self.axis} should"
        what = what if self.sign > 0.0 else f"the opposite of {what}"
        if self.outside is None:
            return f"{what} throughout (correlation {self.inside:.2f})"
        side = f"until {self.stop:.0f} s" if self.start is None else f"from {self.start:.0f} s on"
        return f"{what} {side} (correlation {self.inside:.2f}, elsewhere {self.outside:.2f})"


def misreading(bands: Sequence[Array], own: int, when: Array) -> Misreading | None:
    """The likeliest misreading of axis `own`; `bands` hold, by band, sums (3, 3, P) of T_j^2, T_j R, R^2 by segment.

    Segments begin at `when` (P,) [s].
    """
    lengths = np.arange(SCALE.fewest_segments // 2, len(when) - SCALE.fewest_segments // 2 + 1)
    first = np.concatenate(([0], 0 * lengths, len(when) - lengths))
    last = np.concatenate(([len(when)], lengths, 0 * lengths + len(when)))
    least = float(np.sqrt(SCALE.sigmas**2 + 2.0 * np.log(len(first))))
    most, found = 0.0, None
    for window, sums in zip(SCALE.windows, bands, strict=True):
        (z, correlation, motion, size), (z_rest, rest, usual, _) = _inside_and_outside(sums, first, last, window)
        enough = motion[own] >= SCALE.least_motion * usual[own]
        for j, sign in ((j, sign) for j in range(3) for sign in (1.0, -1.0) if (j, sign) != (own, 1.0)):
            alike = enough & (size[j] > SCALE.least_motion) & (size[j] < 1.0 / SCALE.least_motion)
            better = sign * z[j] - z[own]
            beyond = np.where(alike, np.minimum(sign * z[j], better / np.sqrt(2.0)), 0.0)
            evidence = np.where(beyond > least, better + z_rest[own], 0.0)  # of both sides: it tells the moment
            at = int(np.argmax(evidence))
            if evidence[at] <= most:
                continue
            most, throughout = float(evidence[at]), bool(beyond[0] > SCALE.sigmas and z_rest[own, at] < SCALE.sigmas)
            start = None if throughout or first[at] == 0 else float(when[first[at]])
            stop = None if throughout or last[at] == len(when) else float(when[last[at]])
            outside = None if throughout else float(rest[own, at])
            inside = float(correlation[own, 0 if throughout else at])
            found = Misreading("xyz"[own], "xyz"[j], sign, start, stop, inside, outside)
    return found


def _inside_and_outside(
    sums: Array, first: Indices, last: Indices, window: float
) -> list[tuple[Array, Array, Array, Array]]:
    """Inside and outside of the intervals: z, correlation, mean T^2, and size of R over that of T, (3, I) each."""
    power = np.sqrt(sums[:, 0] * sums[:, 2])
    rows = np.concatenate((sums, power[:, None], power[:, None] ** 2), axis=1)
    until = np.cumsum(np.concatenate((np.zeros((*rows.shape[:2], 1)), rows), axis=2), axis=2)
    inside = until[..., last] - until[..., first]
    out, most = [], SCALE.largest_correlation
    for part, parts in ((inside, last - first), (until[..., -1:] - inside, sums.shape[2] - (last - first))):
        tt, tr, rr, e, ee = np.moveaxis(part, 1, 0)
        correlation = tr / np.sqrt(np.maximum(tt * rr, 1e-30))
        count = SCALE.segment / window * e**2 / np.maximum(ee, 1e-30)  # loud segments alone are fewer windows
        z = np.arctanh(np.clip(correlation, -most, most)) * np.sqrt(np.maximum(count - 3.0, 0.0))
        size = np.sqrt(np.maximum(rr, 0.0) / np.maximum(tt, 1e-30))
        out.append((z, correlation, tt / np.maximum(parts, 1), size))
    return out
