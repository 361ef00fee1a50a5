"""Feed-forward and observer together, against first-order responses in closed form behind a lag and a delay."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import step

from wrenchgap.compensate import Combined, Compensator, DisturbanceObserver, Settings
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant import model_file
from wrenchgap.plant.effects.lag import delay as delayed
from wrenchgap.plant.effects.lag import first_order
from wrenchgap.plant.mismatch import LinearMismatch
from wrenchgap.plant.state import State

MODEL = model_file.load("tilt_hexarotor")
J = MODEL.vehicle.body.inertia
TORQUES = ("torque_x", "torque_y", "torque_z")
DT = 0.001
D = np.array([0.15, -0.1, 0.06])
HOVER = np.array([0.0, 0.0, 39.2, 0.0, 0.0, 0.0])


def known(omega):
    rest, level = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])
    return State(np.zeros(1), rest, level, rest, np.asarray(omega)[None])


def flown(helper, *, lag=0.0, late=0.0, disturbance=D, seconds=1.0):
    """Times (K,) and the torque of the correction (K, 3) on a body whose torque follows late.

    Small rates, so that J omega' = H(M) + d. The loop is closed: M is what the helper commands.
    """
    time, omega = np.arange(round(seconds / DT)) * DT, np.zeros(3)
    memory, line, found = None, None, []
    for t in time:
        d = disturbance(t) if callable(disturbance) else disturbance
        result = helper.step(HOVER, known(omega))
        found.append(result.correction[3:])
        sent, line = delayed(result.wrench_cmd[None, 3:], late, DT, line)
        torque, memory = first_order(sent, lag, DT, memory)
        omega = omega + DT * np.linalg.solve(J, torque[0] + d)
        omega *= 1e-6 if np.abs(omega).max() > 1e6 else 1.0
    return time, np.array(found)


def response(time, hz, d=D):
    return -d * (1.0 - np.exp(-2.0 * np.pi * hz * time))[:, None]


def test_constant_disturbance_is_found_as_a_first_order_lag_says():
    time, correction = flown(Combined(MODEL.vehicle, DT, 2.0))
    assert np.abs((correction - response(time, 2.0)) / D).max() < 0.02


@pytest.mark.parametrize(("lag", "late"), [(0.06, 0.0), (0.0, 0.02), (0.06, 0.02)])
def test_lag_that_is_known_changes_nothing(lag, late):
    """The response is that without a lag, at a bandwidth with which an observer that does not know it rings."""
    hz = 6.0
    time, correction = flown(Combined(MODEL.vehicle, DT, hz, lag=lag, delay=late), lag=lag, late=late)
    assert np.abs((correction - response(time, hz)) / D).max() < 0.03
    _, ringing = flown(DisturbanceObserver(MODEL.vehicle, DT, hz), lag=lag, late=late)
    assert np.abs(ringing / D).max() > 1.2


def test_lag_that_is_not_known_makes_the_loop_of_the_closed_form():
    """d_hat' = k (d - M_made) behind 1 / (1 + tau s): tau s^2 + s + k, at the bandwidth that the log allows."""
    tau, k = 0.06, 1.5 / 0.06
    time, correction = flown(Combined(MODEL.vehicle, DT, k / (2.0 * np.pi)), lag=tau)
    _, expected = step(([tau * k, k], [tau, 1.0, k]), T=time)
    assert np.abs(correction + D * expected[:, None]).max() < 0.05 * np.abs(D).max()
    assert expected.max() < 1.6
    assert correction[-50:] == pytest.approx(np.tile(-D, (50, 1)), rel=0.02)


def constant(offset, sigma=1e-3):
    return LinearMismatch(TORQUES, np.asarray(offset), np.zeros((3, 6)), np.full(3, sigma))


def test_observer_takes_what_the_feed_forward_leaves():
    """Known: two thirds of it, at once. The rest comes as the observer's response."""
    ahead = Compensator(constant(2.0 / 3.0 * D), Settings(dt=DT))
    time, correction = flown(Combined(MODEL.vehicle, DT, 2.0, ahead))
    assert correction[0] == pytest.approx(-2.0 / 3.0 * D, rel=1e-6)
    assert np.abs((correction - (-2.0 / 3.0 * D + response(time, 2.0, D / 3.0))) / D).max() < 0.02


def test_wrong_feed_forward_is_taken_back():
    """Harmful knowledge, with the sign turned over, is a disturbance like any other."""
    time, correction = flown(Combined(MODEL.vehicle, DT, 2.0, Compensator(constant(-D), Settings(dt=DT))))
    assert np.abs((correction - (D + response(time, 2.0, 2.0 * D))) / D).max() < 0.03


def test_gate_acts_on_the_process_alone():
    """A distrusted process corrects nothing, and the observer does it all as if there were none."""
    shut = Compensator(constant(D), Settings(dt=DT, sigma_threshold=1e-9, kappa=1e9))
    time, correction = flown(Combined(MODEL.vehicle, DT, 2.0, shut))
    assert np.abs((correction - response(time, 2.0)) / D).max() < 0.02


def test_estimate_stays_within_its_bounds_and_does_not_wind_up():
    most = np.array([0.05, 0.5, 0.5])
    helper = Combined(MODEL.vehicle, DT, 2.0, torque_max=most)
    time, correction = flown(helper, disturbance=lambda t: D * (t < 1.0), seconds=2.0)
    assert np.abs(correction[:, 0]).max() == pytest.approx(0.05)
    after = time > 1.0
    expected = 0.05 * np.exp(-2.0 * np.pi * 2.0 * (time[after] - 1.0))
    assert -correction[after, 0] == pytest.approx(expected, abs=0.002)


def test_reset_forgets():
    helper = Combined(MODEL.vehicle, DT, 2.0, Compensator(constant(0.5 * D), Settings(dt=DT)), lag=0.03, delay=0.004)
    first = flown(helper, seconds=0.1)[1]
    helper.reset()
    assert np.array_equal(flown(helper, seconds=0.1)[1], first)


def test_numbers_that_are_not_finite_hold_the_estimate():
    """Refused, and the next step goes on with what was found, whatever the vehicle did in between."""
    helper = Combined(MODEL.vehicle, DT, 2.0)
    flown(helper, seconds=0.5)
    found = helper.estimate
    for wrench, omega in ((HOVER * np.nan, [0.0, 0.0, 0.0]), (HOVER, [np.nan, 0.0, 0.0])):
        with pytest.raises(UsageError, match="not finite"):
            helper.step(HOVER if np.isfinite(wrench).all() else wrench, known(omega))
    helper.step(HOVER, known([0.3, 0.0, 0.0]))
    assert helper.estimate == pytest.approx(found, abs=1e-12)


def test_forces_are_left_alone():
    result = Combined(MODEL.vehicle, DT, 2.0).step(HOVER, known([0.1, 0.0, 0.0]))
    assert (result.correction[:3] == 0).all()


@pytest.mark.parametrize(
    ("dt", "hz", "more", "said"),
    [(0.01, 20.0, {}, "at most 15.9 Hz"), (0.0, 1.0, {}, "positive"), (0.01, 1.0, {"lag": -1.0}, "zero or more")],
)
def test_impossible_settings_are_refused(dt, hz, more, said):
    with pytest.raises(UsageError, match=said):
        Combined(MODEL.vehicle, dt, hz, **more)


def test_missing_state_gets_one_line():
    with pytest.raises(UsageError, match="needs the state"):
        Combined(MODEL.vehicle, DT, 1.0).step(HOVER)


@pytest.mark.parametrize("wrench", [HOVER[:3], None, ["a"] * 6, HOVER * np.nan])
def test_a_step_that_is_refused_is_as_if_it_had_not_been(wrench):
    """Three numbers, once, were an IndexError in every later step."""
    observer, fresh = DisturbanceObserver(MODEL.vehicle, 0.005), DisturbanceObserver(MODEL.vehicle, 0.005)
    state = known(np.zeros(3))
    for one in range(3):
        if one:
            observer.step(HOVER + 0.1 * np.eye(6)[3], state)
        with pytest.raises(UsageError, match=r"combined|compensate"):
            observer.step(wrench, state)
        fresh.reset()
        fresh._estimate = observer.estimate
        for _ in range(4):
            assert observer.step(HOVER, state).wrench_cmd == pytest.approx(fresh.step(HOVER, state).wrench_cmd)


def test_a_state_that_raises_leaves_nothing_behind():
    observer, state = DisturbanceObserver(MODEL.vehicle, 0.005), known(np.zeros(3))
    observer.step(HOVER, state)
    with pytest.raises(IndexError):
        observer.step(HOVER, replace(state, omega_B=np.zeros((0, 3))))
    assert observer.step(HOVER, state).wrench_cmd == pytest.approx(HOVER)


@pytest.mark.parametrize("most", [[np.nan] * 3, [-1.0] * 3, [1.0, 1.0]])
def test_a_bound_that_is_none_is_refused(most):
    with pytest.raises(UsageError, match="torque_max"):
        Combined(MODEL.vehicle, 0.005, 1.0, torque_max=most)


def test_a_delay_that_no_vehicle_has_is_refused():
    with pytest.raises(UsageError, match="delay"):
        Combined(MODEL.vehicle, 0.005, 1.0, delay=1e300)
