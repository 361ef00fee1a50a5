"""What the phases of a flight are called, which an analysis leaves out, and the signals of which they are found.

On the ground the accelerometer reads g whatever the rotors do; in the air it reads what they push, over the mass. With
the mass of the model, |m f| / (m g) = |f| / g: a wrong mass does not matter, and what the commands are off by
throughout is measured (`command_scale`).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array, Mask, Samples
from wrenchgap.flight.memory import give_back, on_disk
from wrenchgap.flight.row_kernels import lengths, runs
from wrenchgap.flight.stamps import pieces
from wrenchgap.learn.data.measurement import derivative, felt_at_origin, low_pass
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import GRAVITY, Vehicle

NAMES: dict[str, str] = {
    "ground": "standing still on the ground",
    "held": "moved while something else than the rotors carries it: a hand, a stand, a landing on the side",
    "take-off": "from the ground until it is out of the ground's reach",
    "landing": "from the ground's reach down to it",
    "impact": "struck something, and flew on",
    "crash": "motion contradicts the commands until the end, or the vehicle comes to lie",
    "saturation": "commands at or beyond the limits of the model file",
}
"""Every phase besides flight, in the spelling of `--keep`, and what it is; docs/checks.md."""
EVERY = "all"


@dataclass(frozen=True)
class Phase:
    """A part of a flight from `start` to `stop` [s] that is no ordinary flight: its `name` (of `NAMES`), and `why`.

    `left_out` says whether the analyses do without it: not where `--keep` names it, nor where it changes nothing.
    `event` is when it happens [s]: of an impact its first sample, of a crash its impact or, without one, where
    motion begins to contradict the commands; None of the other phases. A phase begins before its event, by what the
    filters mix of it.
    """

    name: str
    start: float
    stop: float
    why: str
    left_out: bool = True
    event: float | None = None

    @property
    def title(self) -> str:
        """What it is called: a crash of which no impact was logged is a loss of control."""
        seen = "impact" in self.why or "comes to lie" in self.why
        return "Loss of control" if self.name == "crash" and not seen else self.name.capitalize()


def phase_names(names: Iterable[str], said: str = "--keep") -> tuple[str, ...]:
    """Names of phases, however they are spelt, "all" for all of them; raises UsageError for one that there is not."""
    found = [name.strip().lower().replace(" ", "-").replace("_", "-") for name in names]
    found = ["take-off" if name == "takeoff" else name for name in found]
    wrong = [name for name in found if name not in NAMES and name != EVERY]
    if wrong:
        raise UsageError(f"{said} {wrong[0]}: no phase is called so; phases: {', '.join(NAMES)}, {EVERY}")
    return tuple(NAMES) if EVERY in found else tuple(dict.fromkeys(found))


def used_samples(time: Array, phases: Sequence[Phase]) -> Mask:
    """Which of the samples at `time` (N,) [s] lie in no phase that is left out."""
    keep = np.ones(len(time), dtype=bool)
    for phase in phases:
        if phase.left_out:
            keep &= (time < phase.start) | (time > phase.stop)
    return keep


def closed(flags: Mask, most: int) -> Mask:
    """Mask (N,) with interruptions of up to `most` samples between true values filled."""
    out = flags.copy()
    for a, b in runs(~flags):
        if a > 0 and b < len(flags) and b - a <= most:
            out[a:b] = True
    return out


@dataclass(frozen=True)
class SignalSettings:
    """How the signals are made of which phases are found."""

    slow_hz: float = 1.0
    """Low-pass of forces, of which phases are made [Hz]."""
    rates_hz: float = 8.0
    """Low-pass of the rates of which a lever arm's acceleration is made [Hz]."""
    of_nyquist: float = 0.3
    """Largest cut-off, over the clock's rate."""
    pushing: float = 0.6
    """Share of the large commands (90th percentile) from which on one of them carries the vehicle."""
    scales: tuple[float, float] = (0.5, 2.0)
    """Between these commands may be off throughout; beyond, the check `force-unit` speaks."""
    fewest: int = 16
    """Samples of a stretch below which nothing is said of it."""


SIGNALS = SignalSettings()


@dataclass(frozen=True)
class Signals:
    """One stretch of N samples, forces in shares of the weight, in B: `pushed` (N, 3) commanded, `felt` (N, 3) m f.

    `slow_pushed`, `slow_felt` (N, 3) are low-passed, `turning` (N,) [rad/s] is the size of the low-passed rate.
    Of force axes that were not measured, `felt` says what was commanded. `height` (N,) [m] and `speed` (N,) [m/s] are
    None where no pose is logged; `vertical` says whether the accelerometer's z was measured.
    """

    time: Array
    dt: float
    pushed: Array
    felt: Array
    slow_pushed: Array
    slow_felt: Array
    turning: Array
    height: Array | None
    speed: Array | None
    vertical: bool

    def samples(self, seconds: float) -> int:
        """So many samples, one at least."""
        return max(1, round(seconds / self.dt))

    def carried(self, scale: float) -> Array:
        """Share (N,) of the felt force that the rotors do not make: what the ground, or a hand, carries."""
        return by_rows(lambda felt, pushed: lengths(felt) - scale * lengths(pushed), self.slow_felt, self.slow_pushed)

    def contradiction(self, scale: float) -> Array:
        """Size (N,) of the slow difference between felt and commanded force, in shares of the weight."""
        return by_rows(lambda felt, pushed: lengths(felt - scale * pushed), self.slow_felt, self.slow_pushed)

    def spikes(self, scale: float) -> Array:
        """Size (N,) of what is felt and neither commanded nor lasting, in weights."""

        def least(felt: Array, slow: Array, pushed: Array) -> Array:
            return np.asarray(np.minimum(lengths(felt - slow), lengths(felt - scale * pushed)))

        return by_rows(least, self.felt, self.slow_felt, self.pushed)


def signals(samples: Samples, commands: Commands, vehicle: Vehicle) -> Signals | None:
    """What phases are made of; None for a stretch that is too short for a filter."""
    if len(samples) < SIGNALS.fewest:
        return None
    pushed = on_disk(commands.wrench_B[:, :3] / (vehicle.body.mass * GRAVITY))
    omega = low_pass(np.nan_to_num(samples.omega_B), samples.dt, min(SIGNALS.rates_hz, SIGNALS.of_nyquist / samples.dt))
    turning = derivative(omega, samples.dt)
    felt = felt_at_origin(np.nan_to_num(samples.specific_force_B), omega, turning, vehicle.imu_position_B)
    return signals_of(samples, pushed, felt / GRAVITY, omega)


def signals_of(samples: Samples, pushed: Array, felt: Array, omega: Array) -> Signals:
    """`Signals` of commanded and felt forces in shares of the weight, and rates [rad/s], (N, 3) each."""
    dt, slow = samples.dt, min(SIGNALS.slow_hz, SIGNALS.of_nyquist / samples.dt)
    known: Mask = np.asarray(np.isfinite(samples.specific_force_B).all(axis=0))
    felt = on_disk(np.where(known, felt, pushed))
    give_back(len(felt))
    return Signals(
        time=samples.time,
        dt=dt,
        pushed=pushed,
        felt=felt,
        slow_pushed=on_disk(low_pass(pushed, dt, slow)),
        slow_felt=on_disk(low_pass(felt, dt, slow)),
        turning=sizes(low_pass(omega, dt, slow)),
        height=None if samples.position_E is None else samples.position_E[:, 2],
        speed=None if samples.velocity_E is None else sizes(samples.velocity_E),
        vertical=bool(known[2]),
    )


def command_scale(parts: Sequence[Signals]) -> float:
    """Felt over commanded force while the commands are large: what they are off by throughout; 1 where none is.

    Large is held against the median of what is no idling, or against the 90th percentile where most of the log is
    rotors that turn on the ground; after a loss of control that one is off, and what is nearer to 1 counts.
    """
    pushed, felt = (
        np.concatenate([sizes(getattr(part, name)) for part in parts]) for name in ("slow_pushed", "slow_felt")
    )
    busy = pushed > SIGNALS.scales[0] * SIGNALS.pushing
    if not busy.any():
        return 1.0
    larges = (pushed > SIGNALS.pushing * high for high in np.percentile(pushed[busy], (50.0, 90.0)))
    found = [float(np.clip(np.median(felt[large] / pushed[large]), *SIGNALS.scales)) for large in larges]
    return min(found, key=lambda scale: abs(np.log(scale)))


def sizes(vectors: Array) -> Array:
    """Lengths (N,) of vectors (N, C)."""
    return by_rows(lengths, vectors)


def by_rows(make: Callable[..., Array], *signals: Array) -> Array:
    """What `make` gives of the rows of signals (N, C), (N,); of hours, piece by piece."""
    out = np.empty(len(signals[0]))
    for rows in pieces(len(out)):
        out[rows] = make(*(signal[rows] for signal in signals))
    return out
