"""The attitude and rate controller of an autopilot, by its parameters, and what a log of it shows.

With the attitude error e = 2 q_e (vector part, to the setpoint, the shorter way) and the rates w behind the gyroscope's
filters G, each about a body axis, torques in shares of full authority:

    w_sp = A e + rates of the setpoint        error = E (T w_sp - w)
    torque = O [P error + I int error dt + D F d/dt (-w, or error) + FF T w_sp]

G is a second-order Butterworth and notches of centre f, bandwidth b and depth d, all others are first order:

    (s^2 + d 2 pi b s + (2 pi f)^2) / (s^2 + 2 pi b s + (2 pi f)^2)          1 / (1 + s / (2 pi cut-off))
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.flight.formats.dataflash import DataflashReader
from wrenchgap.flight.formats.standard_topics import Messages
from wrenchgap.flight.formats.ulog import UlogReader

FLYING = 0.1
"""Share of full thrust below which nothing counts: landed, autopilots hold their integrals."""
Pair = tuple[Array, Array]
"""What a log has, and what the gains make (N, 3), about the axes of FRD."""


def _none() -> Array:
    return np.full(3, np.inf)


@dataclass(frozen=True)
class RateLoop:
    """Gains about body x, y, z, (3,) each: A `angle` [1/s], P `rate` [s], I `integral`, D `derivative` [s^2] and FF
    `forward` [s] per radian.

    Cut-offs [Hz], infinite for none: `gyro` of the Butterworth, and (3,) `acceleration` F, `error` E, `target` T and
    `output` O. `notches` (K, 3): centre [Hz], bandwidth [Hz], depth (gain at the centre). `of_error`: the derivative is
    that of the error. `period` [s] of the loop.
    """  # noqa: D205

    angle: Array
    rate: Array
    integral: Array
    derivative: Array
    period: float
    forward: Array = field(default_factory=lambda: np.zeros(3))
    gyro: float = np.inf
    acceleration: Array = field(default_factory=_none)
    error: Array = field(default_factory=_none)
    target: Array = field(default_factory=_none)
    output: Array = field(default_factory=_none)
    notches: Array = field(default_factory=lambda: np.zeros((0, 3)))
    of_error: bool = False


@dataclass(frozen=True)
class LoggedLoop:
    """The gains of a log of an `autopilot`; its `torques` and `rates`, each with what the gains make of the motion.

    `dt` [s] between those of the rates. `motors` (R, 3) are the motor commands that a unit of torque about B's axes
    asks for, at the mean commands `hover` (R,); None where commands are the mixer's for the frame.
    """

    autopilot: str
    gains: RateLoop
    torques: Pair
    rates: Pair
    dt: float
    motors: Array | None = None
    hover: Array | None = None


def messages_of(path: Path, kind: type[UlogReader] | type[DataflashReader]) -> Messages | None:
    """The messages and parameters of a log of this kind; None of another file."""
    if not path.is_file():
        return None
    with path.open("rb") as file:
        if file.read(len(kind.magic)) != kind.magic:
            return None
    reader = kind(path)
    tables = reader.tables(lambda *of: True)
    return Messages("", tables, {} if reader.autopilot is None else reader.autopilot.parameters)
