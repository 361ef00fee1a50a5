"""The scale of the gyroscope, axis by axis, against the attitude (`sensor_scales`)."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.channels import is_clipped
from wrenchgap.flight.checks.remedies import factor, option, turns
from wrenchgap.flight.checks.sensor_scales import Scale, sensor_scales
from wrenchgap.flight.checks.sensor_windows import SCALE
from wrenchgap.flight.flight import Flight

BEFORE = ("body-frame", "inertial-frame", "clock-unit")
"""Checks that leave no scale to speak of where they are bad."""


def gyroscope_scale(flight: Flight, known: Sequence[Check]) -> Iterator[Check]:
    """Scale of the gyroscope against the attitude; nothing where `known` says that it is another quantity."""
    bad = {c.name for c in known if c.level == "bad"}
    if flight.imu is None or not bad.isdisjoint(BEFORE):
        return
    scales = sensor_scales(flight, "gyroscope")
    if scales is not None and any(scale.unsteady for scale in scales.values()):
        yield _unsteady(scales)
    elif "gyroscope" in bad:
        return
    elif scales is None:
        why = "no attitude is logged" if flight.odometry is None else "attitude or IMU come too slowly or too briefly"
        yield Check("gyroscope-scale", "ok", f"Not tested: {why}.")
    elif off := {axis: scale for axis, scale in scales.items() if scale.off}:
        yield _wrong(flight, scales, off, is_clipped(known, "gyroscope"))
    else:
        yield Check("gyroscope-scale", "ok", _bounds_in_words(scales))


def without_factor(found: Sequence[Check]) -> list[Check]:
    """The checks; of a gyroscope that is clipped, or has no one scale, none offers a factor."""
    unsteady = any(c.name == "gyroscope-scale" and c.level != "ok" and c.mend is None for c in found)
    if not unsteady and not is_clipped(found, "gyroscope"):
        return [*found]
    return [replace(c, mend=None) if c.name == "gyroscope" and "unit or scale" in c.words else c for c in found]


def _bounds_in_words(scales: dict[str, Scale]) -> str:
    """The bounds of every axis, and of which axes they say nothing."""
    known, unknown = list[str](), list[str]()
    for axis, b in ((axis, scale.best) for axis, scale in scales.items()):
        said = f"{axis} {b.low:.3f} to {b.high:.3f}" if 0.0 < b.low < b.high < 2.0 else axis
        (known if b.width < SCALE.widest else unknown).append(said)
    words = [f"No axis is off by {100 * SCALE.reported:g} % beyond doubt ({', '.join(known)})."] if known else []
    words += [f"Not known, for too little motion next to noise: {', '.join(unknown)}."] if unknown else []
    return " ".join(words)


def _unsteady(scales: dict[str, Scale]) -> Check:
    """Of axes that have no one scale."""
    faults = {axis: fault for axis, scale in scales.items() if (fault := scale.fault()) is not None}
    said = "; ".join(f"{axis} {fault.words}" for axis, fault in faults.items())
    words = f"The gyroscope is not the attitude's rate: {said}. No factor mends that: "
    words += "one of the two failed or was set anew, or the sensor reaches the end of its range"
    worst = max(fault.size for fault in faults.values())
    return Check("gyroscope-scale", "bad" if worst > SCALE.refused else "warn", words)


def _wrong(flight: Flight, scales: dict[str, Scale], off: dict[str, Scale], clipped: bool) -> Check:
    """Of axes `off` that have a wrong scale; what mends it is no factor where the sensor is `clipped`."""
    furthest = max(abs(scale.value - 1.0) for scale in off.values())
    said = ", ".join(f"{axis} {scale.value:.3f}" for axis, scale in off.items())
    words = f"The gyroscope is not the attitude's rate: scale {said}, steady over time, size and frequency; its "
    words += "datasheet's sensitivity, or the full-scale range that the driver assumes, may be another"
    common, mend = float(np.mean([scale.value for scale in off.values()])), None
    if clipped:
        words += ", or what it missed beyond its range (see `clipped`)"
    elif all(scale.allows(common) for scale in scales.values()):
        mend = option(flight, f"gyro*{factor(1.0 / common)}", "imu")
    elif not turns(flight, "imu", "gyroscope"):  # else the sensor's axes are not the body's
        mend = option(flight, ",".join(f"gyro.{axis}*{factor(1.0 / s.value)}" for axis, s in off.items()), "imu")
    return Check("gyroscope-scale", "bad" if furthest > SCALE.refused else "warn", words, mend)
