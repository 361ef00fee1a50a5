"""Whether one sensor of the IMU is later than the other (a low-pass, a clock of its own), or both than they were.

The odometry's attitude shows when the vehicle turned, its velocity when it was pushed (`sensor_scales`). An estimator
is late, so that an odometry that leads a sensor, and leads the other one by less, says something of the sensor.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.scale_thresholds import SCALE
from wrenchgap.flight.checks.sensor_scales import Sensor, delay_step, sensor_delay
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
        words = f"From about {step[0]:.0f} s on the IMU's stamps are {abs(1e3 * step[1]):.0f} ms"
        words += (
            f" {'earlier' if step[1] > 0.0 else 'later'} than before, by the odometry's: one of the two clocks was "
        )
        yield Check("clock-jump", "warn", f"{words}set. Commands and motion do not belong together on both sides.")
        return
    delays = {sensor: sensor_delay(flight, sensor) for sensor, *_ in PAIRS}
    for late, other, what in PAIRS:
        own, its = delays[late], delays[other]
        if own is None or its is None:
            continue
        seconds, std = min(-own[0], its[0] - own[0]), float(np.hypot(own[1], its[1]))
        if seconds > max(SCALE.late, SCALE.certain * std):
            words = (
                f"The {late} is {1e3 * seconds:.1f} +- {1e3 * std:.1f} ms later than the {other}, by the odometry: a "
            )
            words += f"low-pass or a clock of its own. The {what} come late, and part of a lag or delay that is fitted "
            yield Check("rate", "warn", f"{words}may be the sensor's: log both sensors with one filter.")
