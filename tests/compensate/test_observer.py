"""The disturbance observer against Euler's equation, integrated here, and in a closed loop."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wrenchgap.compensate import DisturbanceObserver
from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant import model_file
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import named

MODEL = model_file.load("tilt_hexarotor")
J = MODEL.vehicle.body.inertia
HOVER = np.array([0.0, 0.0, 39.2, 0.0, 0.0, 0.0])


def known(omega):
    rest, level = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])
    return State(np.zeros(1), rest, level, rest, np.asarray(omega)[None])


def accelerated(omega, torque):
    """Euler: J domega = M - omega x J omega."""
    return np.linalg.solve(J, torque - np.cross(omega, J @ omega))


def turned(observer, *, disturbance, omega, seconds, torque=lambda t: np.zeros(3)):
    """Times (K,), and the torque of the correction (K, 3), of a body under the commanded torque and the disturbance."""
    dt, omega, found = observer.dt, np.array(omega, dtype=float), []
    time = np.arange(round(seconds / dt)) * dt
    for t in time:
        result = observer.step(np.concatenate((HOVER[:3], torque(t))), known(omega))
        found.append(result.correction[3:])
        total = result.wrench_cmd[3:] + disturbance
        held = solve_ivp(lambda _, w, total=total: accelerated(w, total), (0.0, dt), omega, rtol=1e-8, atol=1e-10)
        omega = held.y[:, -1]
    return time, np.array(found)


DISTURBANCE = np.array([0.15, -0.1, 0.06])


def from_the_closed_form(dt, bandwidth_hz=1.0):
    """Largest distance from -d (1 - exp(-k t)), relative to d, on a body that starts at rest and is shaken."""
    observer = DisturbanceObserver(MODEL.vehicle, dt, bandwidth_hz)
    motion = {"disturbance": DISTURBANCE, "omega": np.zeros(3), "seconds": 1.2}
    time, correction = turned(observer, **motion, torque=lambda t: 0.1 * np.sin([3.0 * t, 5.0 * t, 4.0 * t]))
    expected = -DISTURBANCE * (1.0 - np.exp(-2.0 * np.pi * bandwidth_hz * time))[:, None]
    return np.abs((correction - expected) / DISTURBANCE).max()


@pytest.mark.parametrize("bandwidth_hz", [0.5, 2.0])
def test_constant_disturbance_is_found_as_a_first_order_lag_says(bandwidth_hz):
    assert from_the_closed_form(1e-3, bandwidth_hz) < 0.01


def test_error_of_the_discretisation_is_of_first_order():
    assert from_the_closed_form(0.004) / from_the_closed_form(0.002) == pytest.approx(2.0, rel=0.1)


def test_turning_body_is_no_disturbance():
    """Without the gyroscopic torque the observer would fight omega x J omega, here up to 0.4 Nm."""
    omega = np.array([2.0, -1.0, 3.0])
    observer = DisturbanceObserver(MODEL.vehicle, 1e-3, 2.0)
    _, correction = turned(observer, disturbance=np.zeros(3), omega=omega, seconds=2.0)
    gyroscopic = np.abs(np.cross(omega, J @ omega)).max()
    assert gyroscopic > 0.3
    assert np.abs(correction).max() < 0.01 * gyroscopic


def test_constant_rate_is_no_disturbance_at_the_first_step():
    """A vehicle that already turns when the observer is switched on has not been pushed by anything."""
    observer = DisturbanceObserver(MODEL.vehicle, 0.005)
    assert observer.step(HOVER, known([1.0, 2.0, 3.0])).correction == pytest.approx(np.zeros(6), abs=1e-12)


def test_forces_are_left_alone_and_the_parts_fit_together():
    observer = DisturbanceObserver(MODEL.vehicle, 0.005)
    observer.step(HOVER, known(np.zeros(3)))
    result = observer.step(HOVER, known([0.01, 0.0, -0.02]))
    assert (result.correction[:3] == 0).all()
    assert np.abs(result.correction[3:]).max() > 1e-3
    assert result.wrench_cmd == pytest.approx(HOVER + result.correction)


def test_reset_forgets():
    observer = DisturbanceObserver(MODEL.vehicle, 0.005)
    motion = {"disturbance": DISTURBANCE, "omega": np.zeros(3), "seconds": 0.1}
    first = turned(observer, **motion)[1]
    observer.reset()
    assert np.array_equal(turned(observer, **motion)[1], first)


def test_constant_torque_no_longer_turns_the_vehicle():
    """PD alone leaves e_R = J^-1 M / w^2 against a constant torque M; with the observer less than a tenth is left."""
    still = replace(MODEL, controller=replace(MODEL.controller, integral=0.0))
    pushed = np.concatenate((np.zeros(3), DISTURBANCE))

    def lean(helper):
        more = {"rng": np.random.default_rng(0), "compensator": helper, "disturbance": lambda t: pushed}
        flown = simulate(still, still, named("hover"), 3.0, **more)
        return np.sin(so3.log(flown.odometry.quat_EB[-50:])).mean(axis=0)

    alone = lean(None)
    observed = lean(DisturbanceObserver(MODEL.vehicle, 1.0 / MODEL.controller.rate_hz, 1.0))
    assert alone == pytest.approx(np.linalg.solve(J, DISTURBANCE) / 3.5**2, rel=0.1)
    assert (np.abs(observed) < 0.1 * np.abs(alone)).all()


def test_missing_state_gets_one_line():
    with pytest.raises(UsageError, match=r"needs the state: step\(wrench_des, state\)") as caught:
        DisturbanceObserver(MODEL.vehicle, 0.005).step(HOVER)
    assert "\n" not in str(caught.value)


IMPOSSIBLE = [(0.0, 1.0), (0.005, -1.0), (np.nan, 1.0), (0.005, np.inf), (0.01, 20.0)]


@pytest.mark.parametrize(("dt", "bandwidth_hz"), IMPOSSIBLE)
def test_impossible_settings_are_refused(dt, bandwidth_hz):
    """Beyond k dt = 1 an estimate overshoots by itself, beyond 2 it grows."""
    with pytest.raises(UsageError, match="at most 15.9 Hz" if bandwidth_hz == 20.0 else "must be positive"):
        DisturbanceObserver(MODEL.vehicle, dt, bandwidth_hz)
