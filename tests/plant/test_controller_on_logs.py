"""The control law against what an independent flight controller logged. An extra: skipped where the logs are absent."""

from pathlib import Path

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight import so3
from wrenchgap.plant.controller import ControllerGains, evaluate, integrate_error
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import recorded
from wrenchgap.plant.vehicle import Body

LOGS = Path("/work/shared/data/multibody")
BODY = Body(4.0, np.diag([0.1035, 0.1045, 0.1914]), np.zeros(3))
GAINS = ControllerGains(transport=0.0)  # that controller leaves the transport term out


@pytest.mark.skipif(not LOGS.is_dir(), reason="the multibody logs are not here")
@pytest.mark.parametrize("name", ["ideal.train", "ideal.test", "com_offset.train"])
def test_the_logged_desired_wrench_is_reproduced_to_sensor_noise(name):
    log = flight.load(LOGS / f"{name}.mcap")
    t, odometry = log.desired.time, log.odometry
    known = State(
        t,
        *(
            np.stack([np.interp(t, odometry.time, c) for c in x.T], axis=-1) if x.shape[1] == 3
            else so3.interpolate(t, odometry.time, x)
            for x in (odometry.position_E, odometry.quat_EB, odometry.velocity_E, odometry.omega_B)
        ),
    )  # fmt: skip
    asked = recorded(log.reference).at(t - log.reference.time[0])
    error = evaluate(GAINS, BODY, known, asked, np.zeros((len(t), 3)))[1]
    wrench, _ = evaluate(GAINS, BODY, known, asked, integrate_error(GAINS, error, 0.005))
    residual = (wrench - log.desired.wrench_B)[10:-10]
    typical = 1.4826 * np.median(np.abs(residual), axis=0)
    assert np.all(typical[:3] < 0.1)  # N: velocity noise of 5 mm/s times 2 zeta w m
    assert np.all(typical[3:] < 0.006)  # Nm: rate noise of 4 mrad/s times 2 zeta w J
    assert np.all(np.abs(residual.mean(axis=0)) < [0.02, 0.02, 0.02, 5e-4, 5e-4, 5e-4])
