"""The stability margin: peaks of |T| in closed form, loops at the margin by their characteristic roots."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight.filters import butterworth
from wrenchgap.flight.formats.rate_loop import RateLoop
from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.mismatch import LinearMismatch
from wrenchgap.plant.stability import (
    FREQUENCIES,
    Loop,
    Observer,
    growing_modes,
    loop_peak,
    margin,
    margin_of_model,
    open_loop,
    phase_and_gain_margins,
    rate_loop,
    sensitivity_peak,
)

AXIS = ("torque_x",)
TORQUES = ("torque_x", "torque_y", "torque_z")
J = np.diag([0.1, 0.2, 0.4])


def gains(zeta, omega):
    return ControllerGains(zeta_attitude=(zeta,) * 3, omega_attitude=(omega,) * 3)


def slope(*values):
    found = np.zeros((1, len(values), 6))
    found[0, range(len(values)), range(3, 3 + len(values))] = values
    return found


@pytest.mark.parametrize(("zeta", "omega"), [(0.3, 2.0), (0.7, 3.5), (1.3, 9.0)])
def test_peak_without_lag_is_that_of_the_closed_form(zeta, omega):
    """|T|^2 = (1 + r^2 u) / ((1 - u)^2 + r^2 u) with r = 2 zeta, u = (w / omega)^2; largest at u = (sqrt(1 + 2 r^2) - 1) / r^2."""  # noqa: E501
    r2 = 4.0 * zeta**2
    u = (np.sqrt(1.0 + 2.0 * r2) - 1.0) / r2
    assert loop_peak(Loop(gains(zeta, omega), J)) == pytest.approx(
        np.sqrt((1 + r2 * u) / ((1 - u) ** 2 + r2 * u)), rel=1e-4
    )


@pytest.mark.parametrize("s", [0.2, 0.5, 0.9])
def test_scalar_margin_is_known(s):
    """A = 1 - s, D = A^-1 - 1 = s / (1 - s)."""
    loop = Loop(gains(0.7, 3.5), J)
    assert margin(slope(-s), AXIS, loop).least == pytest.approx((1.0 - s) / s / loop_peak(loop), rel=1e-9)


def roots(zeta, omega, lag, delay, gain):
    """Of 1 + gain L, the delay by its third-order Pade approximant."""
    d = delay
    top, bottom = np.poly1d([-(d**3), 12 * d**2, -60 * d, 120]), np.poly1d([d**3, 12 * d**2, 60 * d, 120])
    plant = np.poly1d([1, 0, 0]) * np.poly1d([lag, 1])
    return (plant * bottom + gain * np.poly1d([2 * zeta * omega, omega**2]) * top).roots


@pytest.mark.parametrize(("lag", "delay"), [(0.0, 0.05), (0.06, 0.01), (0.06, 0.03), (0.1, 0.02)])
def test_loop_is_stable_up_to_its_margin_and_not_everywhere_beyond(lag, delay):
    """A slope that is not there multiplies the loop by A^-1. Stable at a margin of 1, not at 1/15."""
    zeta, omega = 1.3, 3.5
    loop = Loop(gains(zeta, omega), J, lag, delay)
    peak = loop_peak(loop)
    for times, stable in ((0.5, True), (1.0, True), (15.0, False)):
        change = times / peak
        s = change / (1.0 + change)
        assert margin(slope(-s), AXIS, loop).least == pytest.approx(1.0 / times)
        assert (roots(zeta, omega, lag, delay, 1.0 + change).real < 0).all() == stable


def test_no_slope_has_no_limit_and_a_singular_one_no_margin():
    loop = Loop(gains(0.7, 3.5), J)
    assert margin(slope(0.0, 0.0, 0.0), TORQUES, loop).least > 1e6
    assert margin(slope(0.0, -1.0, 0.0), TORQUES, loop).least == 0.0


def test_margin_does_not_depend_on_the_unit_of_torque():
    full = np.zeros((1, 3, 6))
    full[0, :, 3:] = [[-0.2, 0.3, 0.0], [0.05, -0.1, 0.1], [0.0, 0.02, -0.3]]
    loop = Loop(gains(0.7, 3.5), J)
    scaled = replace(loop, inertia=1e-4 * J)
    assert margin(full, TORQUES, loop).least == pytest.approx(margin(full, TORQUES, scaled).least)


def test_delay_costs_margin():
    at = [margin(slope(-0.3), AXIS, Loop(gains(1.3, 3.5), J, 0.05, d)).least for d in (0.0, 0.01, 0.025)]
    assert at[0] > at[1] > at[2]


def test_past_of_the_command_counts_by_its_own_loop():
    """W_k = W_des + c W_(k-1) at high frequencies: stable for |c| < 1."""
    loop, past = Loop(gains(0.7, 3.5), J), np.zeros((1, 1, 6))
    past[0, 0, 3] = -0.8
    assert margin(slope(0.0), AXIS, loop, past).least == pytest.approx(1.0 / 0.8)


def test_model_is_looked_at_along_its_inputs():
    line = LinearMismatch(AXIS, np.zeros(1), slope(-0.5)[0], np.ones(1))
    found = margin_of_model(line, np.zeros((7, 6)), Loop(gains(0.7, 3.5), J))
    assert len(found.along) == 7
    assert found.least == pytest.approx(1.0 / loop_peak(Loop(gains(0.7, 3.5), J)))


def test_observer_multiplies_the_sensitivity_by_its_high_pass():
    """Without lag and delay S = s^2 / (s^2 + 2 zeta w s + w^2) s / (s + k): the peak is that of the product."""
    zeta, w, hz = 0.4, 3.5, 1.0
    s, k = 1j * FREQUENCIES, 2.0 * np.pi * hz
    for high_pass, asked in ((1.0, 0.0), (s / (s + k), hz)):
        expected = np.abs(s**2 / (s**2 + 2 * zeta * w * s + w**2) * high_pass).max()
        assert sensitivity_peak(Loop(gains(zeta, w), J), Observer(asked)) == pytest.approx(expected, rel=1e-9)


def test_lag_makes_an_observer_ring():
    """Behind a lag the peak grows with the bandwidth; an observer of 1 Hz that is quiet at 10 ms is not at 80 ms."""
    peaks = [sensitivity_peak(Loop(gains(1.3, 3.5), J, 0.08, 0.0075), Observer(hz)) for hz in (0.0, 0.5, 1.0, 2.0)]
    assert peaks == sorted(peaks)
    assert sensitivity_peak(Loop(gains(1.3, 3.5), J, 0.01), Observer(1.0)) < 1.3 < 2.0 < peaks[2]


@pytest.mark.parametrize("hz", [0.5, 3.0, 9.0])
def test_observer_that_is_told_lag_and_delay_leaves_the_controllers_loop(hz):
    """H_o = H: 1 + L = (1 + H c / s^2) / (1 - Q H), so that its zeros are the controller's own."""
    loop = Loop(gains(1.3, 3.5), J, 0.08, 0.0075)
    s, k = 1j * FREQUENCIES, 2.0 * np.pi * hz
    H, Q = np.exp(-s * 0.0075) / (1.0 + 0.08 * s), k / (s + k)
    expected = (1.0 + open_loop(loop)) / (1.0 - Q * H)
    assert 1.0 + open_loop(loop, Observer(hz, 0.08, 0.0075)) == pytest.approx(expected, rel=1e-9)


def closed_loop_poles(loop, observer, zeta, omega):
    """Poles of J s^2 theta = H M, M = -c theta - d_hat, d_hat = Q (s^2 theta - H_o M), delays by third-order Pade."""

    def late(tau, d):
        top, bottom = np.poly1d([-(d**3), 12 * d**2, -60 * d, 120]), np.poly1d([d**3, 12 * d**2, 60 * d, 120])
        return (np.poly1d([1.0]), np.poly1d([tau, 1])) if d == 0 else (top, bottom * np.poly1d([tau, 1]))

    (a, b), (ao, bo) = late(loop.lag, loop.delay), late(observer.lag, observer.delay)
    k, c = 2.0 * np.pi * observer.hz, np.poly1d([2 * zeta * omega, omega**2])
    square, low = np.poly1d([1, 0, 0]), np.poly1d([1, k])
    return (b * square * (low * bo - k * ao) + a * bo * (c * low + k * square)).roots


@pytest.mark.parametrize("told", [0.0, 0.05, 0.1])
@pytest.mark.parametrize(("lag", "delay"), [(0.0, 0.03), (0.05, 0.01), (0.1, 0.0075), (0.1, 0.03)])
def test_unstable_loops_are_told_by_nyquist_as_by_their_characteristic_roots(lag, delay, told):
    for hz in (0.3, 1.0, 2.0, 4.0, 8.0, 12.0):
        loop, observer = Loop(gains(1.3, 3.5), J, lag, delay), Observer(hz, told)
        roots = closed_loop_poles(loop, observer, 1.3, 3.5)
        roots = roots[np.abs(roots) > 1e-6]  # the zero of 1 - Q H_o at s = 0 is cancelled by the observer's integral
        growing = int((roots.real > 0).sum())
        assert growing_modes(open_loop(loop, observer), 3).tolist() == [growing] * 3
        assert np.isinf(sensitivity_peak(loop, observer)) == (growing > 0)


def turned(loop, observer, zeta, omega, seconds, push):
    """Angle of the attitude loop after a push, by Runge-Kutta 4 at 1 ms, with no code of ours.

    Body, actuator, observer and its model of the actuator; the delay is a line of past torques.
    """
    dt, k, J0 = 1e-3, 2.0 * np.pi * observer.hz, 0.1
    line, x, found = [0.0] * max(round(loop.delay / dt), 1), np.zeros(5), []

    def asked(x):  # theta, omega, torque, observer's integral, torque that it expects
        return -J0 * (2 * zeta * omega * x[1] + omega**2 * x[0]) - k * (J0 * x[1] - x[3])

    def rate(x, sent, d):
        told = x[4] if observer.lag > 0 else asked(x)
        follows = (asked(x) - x[4]) / observer.lag if observer.lag > 0 else 0.0
        return np.array([x[1], (x[2] + d) / J0, (sent - x[2]) / loop.lag, told + k * (J0 * x[1] - x[3]), follows])

    for n in range(round(seconds / dt)):
        sent, d = line[0], push if n * dt < 0.2 else 0.0
        line = [*line[1:], asked(x)]
        k1 = rate(x, sent, d)
        k2 = rate(x + 0.5 * dt * k1, sent, d)
        k3 = rate(x + 0.5 * dt * k2, sent, d)
        x = x + dt / 6.0 * (k1 + 2 * k2 + 2 * k3 + rate(x + dt * k3, sent, d))
        found.append(x[0])
    return np.array(found)


def critical_hz(loop, told):
    """Between the largest stable and the smallest unstable bandwidth of a fine grid [Hz]."""
    grid = np.geomspace(0.5, 12.0, 400)
    return next(f for f in grid if np.isinf(sensitivity_peak(loop, Observer(f, told))))


def test_simulated_loop_diverges_where_predicted_and_not_before():
    loop = Loop(gains(1.3, 3.5), J, 0.08, 0.02)
    edge = critical_hz(loop, 0.0)
    below, above = (turned(loop, Observer(f * edge), 1.3, 3.5, 12.0, 0.1) for f in (0.93, 1.07))
    assert np.abs(below[-2000:]).max() < 0.5 * np.abs(below[2000:4000]).max()
    assert np.abs(above[-2000:]).max() > 2.0 * np.abs(above[2000:4000]).max()


def test_simulated_loop_rings_where_the_peak_is_large_and_not_where_it_is_kept_below_two():
    """Swings after the push are counted by sign changes of size; at M_s of 10 many, below 2 few."""
    loop, swings = Loop(gains(1.3, 3.5), J, 0.08, 0.0075), {}
    for observer in (Observer(0.3), Observer(3.0, 0.08), Observer(3.0)):
        angle = turned(loop, observer, 1.3, 3.5, 6.0, 0.1)
        turns = angle[1:-1][(np.diff(angle)[1:] * np.diff(angle)[:-1]) < 0]
        swings[observer] = int((np.abs(turns) > 0.1 * np.abs(angle).max()).sum())
    few, told, ringing = swings.values()
    assert [sensitivity_peak(loop, o) < 2.0 for o in swings] == [True, True, False]
    assert max(few, told) <= 4
    assert ringing >= 10


EVERY = np.ones(3)
PX4 = RateLoop(6.5 * EVERY, 0.15 * EVERY, 0.2 * EVERY, 0.003 * EVERY, 1.0 / 800.0, gyro=40.0, acceleration=30.0 * EVERY)


def test_margins_of_a_proportional_rate_loop_behind_a_delay():
    """L = k e^(-s T) / s crosses one at k, with pi / 2 - k T to spare, and turns by pi at pi / (2 T)."""
    k, late = 20.0, 0.02
    alone = RateLoop(0.0 * EVERY, 0.1 * EVERY, 0.0 * EVERY, 0.0 * EVERY, 0.0)
    phase, gain = phase_and_gain_margins(rate_loop(alone, k / 0.1 * EVERY, 0.0, late))
    np.testing.assert_allclose(phase, np.degrees(np.pi / 2.0 - k * late), atol=0.1)
    np.testing.assert_allclose(gain, 20.0 * np.log10(np.pi / (2.0 * k * late)), atol=0.05)


def notch(centre, width, depth, rate):
    """Numerator and denominator (6,), by the bilinear transform with the centre where it is wanted, as firmwares do."""
    half = np.tan(np.pi * centre / rate) / (centre / width)
    middle, scale = 2.0 * (np.tan(np.pi * centre / rate) ** 2 - 1.0), 1.0 + np.tan(np.pi * centre / rate) ** 2
    return np.array([scale + depth * half, middle, scale - depth * half, scale + half, middle, scale - half]) / (
        scale + half
    )


def rate_loop_turned(gains, acceleration, lag, late, seconds, lead=0.0, axis=0, dt=0.0005):
    """Angles (N,) of one axis after a tap, stepped in time: the filters as firmwares', each sample behind the other."""
    sections = [butterworth(gains.gyro, 1.0 / dt)] + [notch(*one, 1.0 / dt) for one in gains.notches]
    b, a = np.split(np.array(sections).T, 2)
    memory, kept, integral, torque = np.zeros((2, len(sections))), {}, 0.0, 0.0
    angle, rate, sent, found = 0.01, 0.0, [0.0] * max(round(late / dt), 1), []

    def low_pass(name, value):
        before, cutoff = kept.get(name, value), getattr(gains, name)[axis]
        kept[name] = before + (value - before) * dt / (dt + 1.0 / (2.0 * np.pi * cutoff))
        return kept[name]

    before = None
    for _ in range(round(seconds / dt)):
        felt = rate
        for k in range(len(sections)):
            out = b[0, k] * felt + memory[0, k]
            memory[:, k] = b[1, k] * felt - a[1, k] * out + memory[1, k], b[2, k] * felt - a[2, k] * out
            felt = out
        wanted = low_pass("target", -gains.angle[axis] * angle)
        error = low_pass("error", wanted - felt)
        falls = error if gains.of_error else -felt
        turning = low_pass("acceleration", (falls - (falls if before is None else before)) / dt)
        before, integral = falls, integral + gains.integral[axis] * error * dt
        asked = gains.rate[axis] * error + integral + gains.derivative[axis] * turning + gains.forward[axis] * wanted
        sent = [low_pass("output", asked), *sent[:-1]]
        speeding_up = (sent[-1] - torque) * (1.0 - np.exp(-dt / lag))
        torque += speeding_up
        rate += acceleration * (torque * dt + lead * speeding_up)
        angle += rate * dt
        found.append(angle)
    return np.array(found)


NOTCHED = replace(PX4, notches=np.array([[60.0, 30.0, 0.0], [90.0, 40.0, 0.1]]))
SLOW_YAW = replace(PX4, rate=0.2 * EVERY, derivative=0.0 * EVERY, angle=2.8 * EVERY, output=2.0 * EVERY)
FEEDING_FORWARD = replace(
    PX4, of_error=True, forward=0.02 * EVERY, target=15.0 * EVERY, error=25.0 * EVERY, acceleration=12.0 * EVERY
)


@pytest.mark.parametrize(
    ("loop", "acceleration", "lead"),
    [(PX4, 150.0, 0.0), (NOTCHED, 100.0, 0.0), (SLOW_YAW, 10.0, 0.1), (FEEDING_FORWARD, 100.0, 0.0)],
    ids=["PX4", "notches", "yaw", "filters of target, error and derivative"],
)
def test_a_rate_loop_stepped_in_time_diverges_beyond_its_gain_margin_and_not_before(loop, acceleration, lead):
    lag, late = 0.04, 0.004
    _, gain = phase_and_gain_margins(rate_loop(loop, acceleration * EVERY, lag, late, lead))
    edge = acceleration * 10.0 ** (gain[0] / 20.0)
    assert 2.0 < gain[0] < 40.0
    below, above = (rate_loop_turned(loop, f * edge, lag, late, 5.0, lead) for f in (0.9, 1.1))
    assert np.ptp(below[-2000:]) < 0.3 * np.ptp(below[1000:3000])
    assert np.ptp(above[-2000:]) > 3.0 * np.ptp(above[1000:3000])


def test_a_notch_takes_its_depth_at_its_centre_and_half_the_power_at_half_its_width():
    """At f_1 f_2 = f^2 with f_2 - f_1 its width, a full notch turns by 45 deg and leaves half the power (-3 dB)."""
    w = FREQUENCIES / (2.0 * np.pi)
    at = int(np.argmin(np.abs(w - 50.0)))
    alone = RateLoop(0.0 * EVERY, 0.0 * EVERY, 0.0 * EVERY, EVERY, 0.0)  # L = s^2 G / s^2
    for depth in (0.0, 0.1):
        H = rate_loop(replace(alone, notches=np.array([[w[at], 10.0, depth]])), EVERY, 0.0, 0.0)[0]
        assert abs(H[at]) == pytest.approx(depth, abs=1e-9)
        if depth == 0.0:
            below = np.interp(np.sqrt(w[at] ** 2 + 25.0) - 5.0, w, H)
            assert abs(below) ** 2 == pytest.approx(0.5, abs=0.01)
            assert np.degrees(np.angle(below)) == pytest.approx(-45.0, abs=0.5)
