"""The commanded force against the specific force, which it makes: F is about m f, whatever the vehicle."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.motion import MotionMeans
from wrenchgap.flight.checks.remedies import option
from wrenchgap.flight.flight import Flight
from wrenchgap.flight.row_kernels import lengths
from wrenchgap.flight.stamps import interpolated, thinned


def behind_body_frame(found: Iterable[Check], known: Iterable[Check]) -> list[Check]:
    """`found` without a mend of the wrench's axes where the IMU's, by which they were judged, are bad in `known`.

    With both mends followed they would differ again: the wrench is asked anew once the IMU is mended.
    """
    imu = next((check for check in known if check.name == "body-frame" and check.level == "bad"), None)
    out = []
    for check in found:
        if imu is not None and check.name == "wrench-frame" and check.mend:
            axes = {(mend or "").rpartition(":")[2].strip("'").rpartition(",")[2] for mend in (check.mend, imu.mend)}
            same = axes == {"frd"}  # its own inverse: the IMU's mend is all that is needed
            why = "it follows from the IMU's axes (body-frame)" if same else "mend the IMU's axes (body-frame) first"
            out.append(replace(check, words=f"{check.words}; {why}", mend=None))
        else:
            out.append(check)
    return out


def wrench_frame(
    flight: Flight, seen: MotionMeans | None, rows: int = 20_000, lifted: float = 0.3, opposite: float = -0.5
) -> Iterator[Check]:
    """Whether the commanded force points where the specific force does.

    They are compared on so many `rows`, evenly spread, where the commanded force is above the share `lifted` of its
    90th percentile: less is the ground. `opposite` is the median cosine below which they are.
    """
    sent, imu = flight.commanded, flight.imu
    if sent is None:
        return
    some = thinned(len(sent.time), rows)
    time, force = sent.time[some], sent.wrench_B[some, :3]
    if imu is not None and not np.isnan(imu.specific_force_B).any():
        felt = interpolated(time, imu.time, imu.specific_force_B)
    elif seen is not None and len(seen.attitude) > 1 and flight.odometry is not None:
        felt = np.tile(np.median(seen.force(), axis=0), (len(time), 1))
    else:
        return
    size = lengths(force)
    flying = size > lifted * np.percentile(size, 90)
    if not flying.any():
        return
    alike = np.sum(force * felt, axis=1) / np.maximum(size * lengths(felt), 1e-12)
    median, down = float(np.median(alike[flying])), float(np.median(force[flying, 2]))
    if median < opposite:
        words = f"The commanded force (median force_z {down:.3g}) is opposite to the specific force"
        words += f" (cosine {median:.2f})"
        yield Check("wrench-frame", "bad", f"{words}: axes forward-right-down", option(flight, "frd", "commanded"))
