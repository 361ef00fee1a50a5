"""Vibration in the air: the autopilot's own levels, clipping, and peaks of the logged specific force.

Levels have the limits that their autopilot's projects give: ArduPilot's VIBE, below 30 m/s^2 acceptable, above 60
nearly always trouble ("Measuring Vibration", ardupilot.org); PX4's accel_vibration_metric, 4.905 and 9.81 m/s^2 where
Flight Review changes its colours. Readings of a log have none: they are averaged before they are logged.

A peak belongs to a rotor where it lies at a multiple of a measured speed. What is faster than half of the logged rate
is folded to below it, where the sensor's filter lets it through; a folded peak has no place of its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import find_peaks, welch

from wrenchgap.flight.check import Level
from wrenchgap.flight.flight import Array, Flight, ImuSeries, Indices, Mask
from wrenchgap.flight.row_kernels import runs
from wrenchgap.flight.unmeasured import unmeasured_axes
from wrenchgap.learn.health.autopilot_messages import Recorded
from wrenchgap.learn.health.phases import AIRBORNE, FlightPhases, NoPhases, doubtful

RPM_TOPICS = ("/px4/esc_measured", "/ardupilot/esc_measured")


@dataclass(frozen=True)
class VibrationSettings:
    """Limits of levels, and what counts as a peak."""

    vibe: tuple[float, float] = (30.0, 60.0)
    """ArduPilot's limits of VIBE [m/s^2]: may have problems, nearly always have."""
    metric: tuple[float, float] = (4.905, 9.81)
    """PX4's limits of accel_vibration_metric [m/s^2], half of g and g."""
    share: float = 95.0
    """Percentile of a level that is held against the limits: landings and bumps are not vibration."""
    clips: int = 100
    """Clipped samples in a flight up to which ArduPilot's documentation calls them likely harmless."""
    slow_hz: float = 20.0
    """Below [Hz] lies the vehicle's own motion, above the vibration."""
    resolution_hz: float = 1.0
    """Of the spectrum."""
    prominence: float = 6.0
    """Of a peak, over the higher of the valleys beside it [dB]: of 300 logs of white noise none reaches it with so many
    `pieces` of time, 5 % do with half of them."""
    smoothed_hz: float = 3.0
    """Width [Hz] over which the density is averaged before peaks are looked for: rotors in hover vary by as much."""
    least: float = 0.05
    """Root mean square [m/s^2] below which no peak is worth a word: 0.005 g."""
    most: int = 4
    """Peaks that are told."""
    pieces: int = 8
    """Pieces of time for a spectrum, at least; they overlap by half, so 4.5 s."""
    near: float = 0.03
    """Distance of a peak from a multiple of a rotor's speed, relative, up to which it belongs to it."""
    multiples: tuple[int, ...] = (1, 2, 3, 4)
    """Of a rotor's speed: its imbalance, and the passage of two, three or four blades."""


VIBRATION = VibrationSettings()
SLOW_HZ = 2.5 * VIBRATION.slow_hz
"""Rate of readings [Hz] below which hardly a band is left between the vehicle's own motion and half of the rate."""


@dataclass(frozen=True)
class Peak:
    """A peak of the specific force: where [Hz], its root mean square [m/s^2], and what it belongs to.

    `rotors` are the names of those at whose `multiple` it lies, folded by the logged rate if `folded`. Without measured
    speeds, `harmonic` says that another peak lies at twice or half of it, as of something that turns.
    """

    hz: float
    rms: float
    rotors: tuple[str, ...] = ()
    multiple: int = 0
    folded: bool = False
    harmonic: bool = False


@dataclass(frozen=True)
class Vibration:
    """Vibration in the air.

    `levels` [m/s^2] (one, or one an axis) are 95th percentiles of what `source` logs, with its `limits`; empty where
    the autopilot logs none. `clipped` counts samples at the end of the accelerometer's range, None where nobody
    counts. `rms` (3,) [m/s^2] is that of the logged specific force above 20 Hz, None where the `rate` [Hz] of its
    readings does not reach there. `rotor_hz` are measured speeds of the rotors, `spectrum` (frequency [Hz], density
    [m^2/s^4/Hz]) of all axes; what is above `rate` / 2 is not in the log.
    """

    source: str
    levels: tuple[float, ...]
    limits: tuple[float, float] | None
    clipped: int | None
    rate: float | None
    rms: tuple[float, float, float] | None
    peaks: tuple[Peak, ...]
    rotor_hz: tuple[float, ...]
    spectrum: tuple[Array, Array] | None

    @property
    def level(self) -> Level:
        """How bad it is."""
        high = max(self.levels, default=0.0)
        warn, bad = self.limits or (np.inf, np.inf)
        if high > bad:
            return "bad"
        return "warn" if high > warn or (self.clipped or 0) > VIBRATION.clips else "ok"


def vibration_of(flight: Flight, recorded: Recorded, phases: FlightPhases, names: tuple[str, ...]) -> Vibration:
    """The vibration of a flight whose rotors have these names; all of the log counts where no phase is known."""
    source, levels, limits = _levels(recorded, phases)
    speeds = _rotor_speeds(recorded, phases)
    unknown = doubtful(flight) or bool({"force_x", "force_y", "force_z"} & {*unmeasured_axes(flight)})
    rate = None if flight.imu is None else 1.0 / flight.imu.period
    imu = None if unknown else flight.imu
    spectrum = None if imu is None or rate is None else _spectrum(imu, rate, phases)
    rms: tuple[float, float, float] | None = None
    peaks: tuple[Peak, ...] = ()
    if spectrum is not None and rate is not None:
        above = spectrum[0] > VIBRATION.slow_hz
        x, y, z = np.sqrt(np.sum(spectrum[1][:, above], axis=1) * VIBRATION.resolution_hz).tolist()
        rms = (x, y, z)
        found = _peaks(spectrum[0], spectrum[1].sum(axis=0))
        peaks = tuple(_owned(found, speeds, names, rate))
    density = None if spectrum is None else (spectrum[0], spectrum[1].sum(axis=0))
    return Vibration(source, levels, limits, _clipped(recorded, phases), rate, rms, peaks, speeds, density)


def _air(phases: FlightPhases, time: Array, *names: str) -> Mask:
    """Which times (N,) [s] lie in these phases, by default in the air; all where no phase is known."""
    known = phases.lack in (None, NoPhases.POWER)
    return phases.within(time, *(names or AIRBORNE)) if known else np.ones(len(time), dtype=bool)


def _aloft(recorded: Recorded, phases: FlightPhases, topic: str, *names: str) -> Iterator[tuple[str, Array, Indices]]:
    """Every instance of a topic, its fields (N, K), and which of its messages are from the air; none without any."""
    for place in recorded.instances(topic):
        known = recorded.columns(place, *names)
        if known is not None and len(rows := np.flatnonzero(_air(phases, known[0]))):
            yield place, known[1], rows


def _levels(recorded: Recorded, phases: FlightPhases) -> tuple[str, tuple[float, ...], tuple[float, float] | None]:
    """The levels that the autopilot logs, of the sensor where they are largest."""
    found: list[tuple[str, Array, tuple[float, float]]] = []
    for topic, names, limits in (
        ("VIBE", ("VibeX", "VibeY", "VibeZ"), VIBRATION.vibe),
        ("vehicle_imu_status", ("accel_vibration_metric",), VIBRATION.metric),
    ):
        for place, values, air in _aloft(recorded, phases, topic, *names):
            known = values[air][np.isfinite(values[air]).all(axis=1)]
            if known.any():
                high = np.percentile(known, VIBRATION.share, axis=0)
                found.append((place, high, limits))
    if not found:
        return "", (), None
    place, high, limits = max(found, key=lambda one: float(one[1].max()))
    return place, tuple(map(float, high)), limits


def _clipped(recorded: Recorded, phases: FlightPhases) -> int | None:
    """Clipped samples in the air by the autopilot's counters, of the sensor that clips most."""
    counts = []
    for topic, fields in (
        ("VIBE", ("Clip",)),
        ("VIBE", ("Clip0", "Clip1", "Clip2")),
        ("vehicle_imu_status", ("accel_clipping",)),
    ):
        for _, values, air in _aloft(recorded, phases, topic, *fields):
            first, last = values[max(air[0] - 1, 0)], values[min(air[-1] + 1, len(values) - 1)]
            grown = np.maximum(last - first, 0.0)
            counts.append(int(grown.sum() if topic == "vehicle_imu_status" else grown.max()))
    return max(counts, default=None)


def _rotor_speeds(recorded: Recorded, phases: FlightPhases) -> tuple[float, ...]:
    """Measured speeds of the rotors [Hz], medians in the air; empty where nobody measures them."""
    for topic in RPM_TOPICS:
        known = recorded.columns(topic, "velocity")
        if known is not None and (air := _air(phases, known[0])).any():
            turns = np.median(known[1][air], axis=0) / (2.0 * np.pi)
            return tuple(map(float, turns)) if np.isfinite(turns).all() and (turns > 0.0).all() else ()
    return ()


def _spectrum(imu: ImuSeries, rate: float, phases: FlightPhases) -> tuple[Array, Array] | None:
    """Frequencies (F,) [Hz] and densities (3, F) of the specific force, in hover where there is enough of it."""
    if rate < SLOW_HZ:
        return None
    count = round(rate / VIBRATION.resolution_hz)
    for names in (("hover",), AIRBORNE):
        inside = _air(phases, imu.time, *names)
        for gap in imu.gaps:
            inside &= (imu.time <= gap.start) | (imu.time >= gap.stop)
        parts = [imu.specific_force_B[a:b] for a, b in runs(inside) if b - a >= count]
        pieces = [max(1, 2 * len(part) // count - 1) for part in parts]
        if sum(pieces) >= VIBRATION.pieces:
            both = [welch(part, rate, nperseg=count, axis=0) for part in parts]
            return both[0][0], np.average([density.T for _, density in both], axis=0, weights=pieces)
    return None


def _peaks(hz: Array, density: Array) -> list[Peak]:
    """The largest peaks above the vehicle's own motion, each as wide as at half of its prominence."""
    step = float(hz[1] - hz[0])
    smooth = uniform_filter1d(density, max(1, round(VIBRATION.smoothed_hz / step)))
    level = 10.0 * np.log10(np.maximum(smooth, 1e-20))
    places, about = find_peaks(level, prominence=VIBRATION.prominence, width=0.0)
    found = []
    for k, prominence, left, right in zip(
        places, about["prominences"], about["left_ips"], about["right_ips"], strict=True
    ):
        inside = density[int(np.ceil(left)) : int(right) + 1]
        excess = float(np.sum(np.maximum(inside - smooth[k] / 10.0 ** (0.1 * prominence), 0.0)) * step)
        if hz[k] > VIBRATION.slow_hz and np.sqrt(excess) > VIBRATION.least:
            found.append(Peak(float(hz[k]), float(np.sqrt(excess))))
    return sorted(found, key=lambda peak: -peak.rms)[: VIBRATION.most]


def _owned(found: list[Peak], speeds: tuple[float, ...], names: tuple[str, ...], rate: float) -> Iterator[Peak]:
    """The peaks with what they belong to."""
    for peak in found:
        mine = [
            (abs(_folded(m * f, rate) - peak.hz) / max(m * f, 1e-9), name, m, m * f > 0.5 * rate)
            for f, name in zip(speeds, names, strict=False)
            for m in VIBRATION.multiples
        ]
        near, _, multiple, folded = min(mine, default=(np.inf, "", 0, False))
        if near < VIBRATION.near:
            alike = tuple(n for far, n, m, _ in mine if far < VIBRATION.near and m == multiple)
            yield Peak(peak.hz, peak.rms, alike, multiple, folded)
        else:
            others = [other.hz / peak.hz for other in found if other is not peak]
            twice = any(min(abs(r - 2.0) / 2.0, abs(r - 0.5) / 0.5) < VIBRATION.near for r in others)
            yield Peak(peak.hz, peak.rms, harmonic=twice and not speeds)


def _folded(hz: float, rate: float) -> float:
    """Where a frequency [Hz] appears at a rate [Hz] of readings."""
    return abs(hz - rate * round(hz / rate))
