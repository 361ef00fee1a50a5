"""An offset that drifts is two clocks, unless one clock is known to stamp both signals."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.learn.diagnose.timing import Drift, timing
from wrenchgap.replay.present.timing import warnings


@pytest.fixture(scope="module")
def flown():
    return wg.simulate(wg.load_model("tilt_hexarotor"), "hover", duration=24.0, excitation=1.0, seed=3)


def drifting(flight, prefix):
    """Odometry whose attitude is late by ever more, up to 20 ms, and whose stamps are those of the IMU or 1 ms off."""
    time = flight.odometry.time
    quat = np.stack([np.interp(time - 0.02 * time / time[-1], time, c) for c in flight.odometry.quat_EB.T], axis=1)
    quat /= np.linalg.norm(quat, axis=1)[:, None]
    series = {role: replace(s, topic=f"{prefix}/{role}") for role, s in flight.series().items()}
    return replace(flight, **series | {"odometry": replace(series["odometry"], quat_EB=quat, time=time + 1e-3)})


@pytest.mark.parametrize(("prefix", "one"), [("/px4", True), ("/uav1/ardupilot", True), ("", False)])
def test_an_autopilots_own_log_has_one_clock(prefix, one, flown):
    found = timing(drifting(flown, prefix))
    (drift,) = [w for w in found.warnings if isinstance(w, Drift) and w.offset.first == "gyroscope"
                and w.offset.second == "odometry attitude"]  # fmt: skip
    assert drift.one_clock is one
    assert any(("two clocks" in words) is not one and "the offset moves by" in words for words in warnings(found))


def test_a_fast_drift_is_said_without_an_exponent(flown):
    """-2.5 ms a second are -150 ms a minute."""
    found = timing(drifting(flown, ""))
    drift = next(w for w in found.warnings if isinstance(w, Drift))
    fast = replace(drift, offset=replace(drift.offset, drift=-2.5e-3, drift_std=1.63e-4))
    (words,) = warnings(SimpleNamespace(warnings=(fast,)))
    assert "moves by -150 +- 9.8 ms/min" in words


def test_pose_and_twist_of_one_topic_have_one_clock(flown):
    found = timing(drifting(flown, ""))
    own = [w for w in found.warnings if isinstance(w, Drift) and w.offset.first.startswith("odometry")]
    assert own
    assert all(w.one_clock for w in own)


def test_rows_of_one_table_have_one_clock(flown):
    flight = drifting(flown, "")
    stepped = replace(flight, odometry=replace(flight.odometry, time=flown.odometry.time))
    assert all(w.one_clock for w in timing(stepped).warnings if isinstance(w, Drift))
