"""Whether one sensor of the IMU is later than the other (a low-pass, a clock of its own), or both than they were.

The odometry's attitude shows when the vehicle turned, its velocity when it was pushed (`sensor_windows`). An estimator
is late, so that an odometry that leads a sensor, and leads the other one by less, says something of the sensor.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.sensor_windows import SCALE, Sensor, comparable_blocks, nearest_delay, odometry_delay
from wrenchgap.flight.flight import Flight

PAIRS: tuple[tuple[Sensor, Sensor, str], ...] = (
    ("gyroscope", "accelerometer", "torques"),
    ("accelerometer", "gyroscope", "forces"),
)


def late_sensors(flight: Flight, known: Sequence[Check]) -> Iterator[Check]:
    """A sensor that is later than the other; nothing where `known` says that it reads something else."""
    if any(check.level == "bad" for check in known):
        return
    step = delay_step(flight)
    if step is not None:
        start, seconds = step
        way = "earlier" if seconds > 0.0 else "later"
        words = f"From about {start:.0f} s on the IMU's stamps are {abs(1e3 * seconds):.0f} ms {way} than before, by "
        words += "the odometry's: one of the two clocks was set. Commands and motion do not belong together on both"
        yield Check("clock-jump", "warn", f"{words} sides.")
        return
    delays = {sensor: sensor_delay(flight, sensor) for sensor, *_ in PAIRS}
    for late, other, what in PAIRS:
        own, its = delays[late], delays[other]
        if own is None or its is None:
            continue
        seconds, std = min(-own[0], its[0] - own[0]), float(np.hypot(own[1], its[1]))
        if seconds > max(SCALE.least_delay, SCALE.delay_sigmas * std):
            words = f"The {late} is {1e3 * seconds:.1f} +- {1e3 * std:.1f} ms later than the {other}, by the odometry: "
            words += f"a low-pass or a clock of its own. The {what} come late, and part of a lag or delay that is "
            yield Check("rate", "warn", f"{words}fitted may be the sensor's: log both sensors with one filter.")


def sensor_delay(flight: Flight, sensor: Sensor) -> tuple[float, float] | None:
    """By how much the odometry is late behind a sensor [s], and the standard deviation; None without common motion.

    The deviation is the jackknife's over `SCALE.jackknife_groups` groups of blocks (Tukey 1958).
    """
    blocks = comparable_blocks(flight, sensor)
    count = min(len(blocks), SCALE.jackknife_groups)
    if count < SCALE.fewest_segments // 2:
        return None
    delay = odometry_delay(blocks)
    if delay is None:
        return None
    others = [nearest_delay([b for k, b in enumerate(blocks) if k % count != g], delay) for g in range(count)]
    known = [other for other in others if other is not None]
    return (delay, float(np.sqrt((count - 1) * np.var(known)))) if len(known) == count else None


def delay_step(flight: Flight) -> tuple[float, float] | None:
    """From when on [s], and by how much [s], the odometry is later behind the gyroscope than before; None if it is not.

    Two means of delays by block, by Student's t, which for so few is sqrt(n log(1 + t^2 / n)) standard deviations of a
    Gaussian with n degrees of freedom (Wallace 1959).
    """
    every = [(float(block.time[0]), odometry_delay([block])) for block in comparable_blocks(flight, "gyroscope")]
    known = np.array([(time, delay) for time, delay in every if delay is not None]).reshape(-1, 2)
    most, found, degrees = SCALE.delay_sigmas, None, len(known) - 2
    for k in range(2, degrees + 1):
        before, after = known[:k, 1], known[k:, 1]
        step = float(np.mean(after) - np.mean(before))
        variance = (np.var(before) * len(before) + np.var(after) * len(after)) / degrees + SCALE.delay_tolerance**2
        t2 = step**2 / (variance * (1.0 / len(before) + 1.0 / len(after)))
        certain = float(np.sqrt(degrees * np.log1p(t2 / degrees)))
        if abs(step) > SCALE.least_step and certain > most:
            most, found = certain, (float(known[k, 0]), step)
    return found
