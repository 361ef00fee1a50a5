"""Rotors that speed up and slow down with different time constants."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wrenchgap.plant.effects.asymmetric_motor_lag import switched_lag
from wrenchgap.plant.state import Commands

UP, DOWN = 0.0125, 0.025


def lagged(bench, u, up, down):
    model = bench.model("asymmetric_motor_lag", {"tau_up": up, "tau_down": down})
    return model.command(u, bench.state(len(u.wrench_B)), bench.dt)[0]


def solved(bench, signal, up, down, start=None):
    """The switched equation by a general solver, on straight lines between samples."""
    t = np.arange(len(signal)) * bench.dt

    def rate(s, y):
        error = np.interp(s, t, signal) - y
        return error / np.where(error > 0, up, down)

    span = {"t_eval": t, "max_step": bench.dt / 10, "rtol": 1e-9, "atol": 1e-9}
    return solve_ivp(rate, (0, t[-1]), [signal[0] if start is None else start], **span).y[0]


def test_with_equal_constants_it_is_motor_lag(bench):
    plain, u = bench.lag("motor_lag", 0.03)
    np.testing.assert_allclose(lagged(bench, u, 0.03, 0.03).rotor_speed, plain.rotor_speed, rtol=1e-13)


@pytest.mark.parametrize(("up", "down"), [(UP, DOWN), (0.06, 0.02), (0.001, 0.1)])
def test_solves_the_switched_equation(bench, up, down):
    u = bench.wandering(150)
    out = lagged(bench, u, up, down)
    np.testing.assert_array_equal(out.tilt, u.tilt)
    for rotor in (0, 7):
        signal = u.rotor_speed[:, rotor]
        assert np.abs(np.diff(np.sign(signal - out.rotor_speed[:, rotor]))).sum() >= 2  # it changes direction
        np.testing.assert_allclose(out.rotor_speed[:, rotor], solved(bench, signal, up, down), rtol=1e-6)


def test_is_exact_whatever_the_step(bench):
    """One straight line that crosses the output: in one step what it is in a thousand."""
    start, output = np.array([600.0]), np.array([640.0])
    once, _ = switched_lag(np.array([[780.0]]), UP, DOWN, 0.04, (start, output))
    line = np.linspace(600.0, 780.0, 1001)[1:, None]
    fine, _ = switched_lag(line, UP, DOWN, 0.04e-3, (start, output))
    assert once[0, 0] == pytest.approx(fine[-1, 0], rel=1e-12)


def test_rises_with_one_constant_and_falls_with_the_other(bench):
    k = np.arange(200)
    u = Commands(
        np.zeros((200, 6)), np.zeros((200, 6)), np.tile(np.where((k > 0) & (k < 100), 700.0, 600.0)[:, None], 12)
    )
    out = lagged(bench, u, UP, DOWN).rotor_speed[:, 0]
    rise, fall = 700.0 - out[1:20], out[100:140] - 600.0
    np.testing.assert_allclose(rise[1:] / rise[:-1], np.exp(-bench.dt / UP), rtol=1e-9)
    np.testing.assert_allclose(fall[1:] / fall[:-1], np.exp(-bench.dt / DOWN), rtol=1e-9)


def test_slow_coming_down_raises_the_mean(bench):
    """Over whole periods of 4 Hz; with equal constants the mean stays."""
    t = np.arange(400) * bench.dt
    signal = 650.0 + 80.0 * np.sin(2 * np.pi * 4.0 * t)[:, None]
    slow, equal = (switched_lag(signal, UP, down, bench.dt, None)[0][200:].mean() for down in (DOWN, UP))
    assert equal == pytest.approx(650.0, abs=1e-3)
    assert slow > 653.0


@pytest.mark.parametrize(("up", "down"), [(UP, DOWN), (0.2, 0.001), (0.0, 0.03), (0.03, 0.0)])
def test_one_sample_at_a_time_is_all_at_once_on_wild_commands(bench, up, down):
    """White noise turns the rotors round in nearly every step."""
    signal = 600.0 + 300.0 * np.random.default_rng(5).normal(size=(500, 3))
    whole, _ = switched_lag(signal, up, down, bench.dt, None)
    memory, rows = None, []
    for one in signal:
        out, memory = switched_lag(one[None], up, down, bench.dt, memory)
        rows.append(out[0])
    np.testing.assert_allclose(whole, rows, rtol=1e-11, atol=1e-10)  # of samples of some 600


@pytest.mark.parametrize(("up", "down"), [(UP, DOWN), (0.06, 0.02), (0.2, 0.001)])
def test_wild_commands_from_a_memory_solve_the_switched_equation(bench, up, down):
    """White noise, from outputs that are far from the last command; what is remembered is that command and output."""
    signal = 600.0 + 300.0 * np.random.default_rng(6).normal(size=(60, 3))
    memory = np.full(3, 500.0), np.array([450.0, 600.0, 900.0])
    out, kept = switched_lag(signal, up, down, bench.dt, memory)
    for d in range(3):
        expected = solved(bench, np.append(500.0, signal[:, d]), up, down, memory[1][d])[1:]
        np.testing.assert_allclose(out[:, d], expected, rtol=1e-5)
    np.testing.assert_array_equal(kept, (signal[-1], out[-1]))


@pytest.mark.parametrize(("up", "down"), [(UP, DOWN), (0.06, 0.02), (0.2, 0.001)])
def test_commands_between_commands_change_nothing(bench, up, down):
    """Seven steps along a straight line end where one does."""
    signal = 600.0 + 300.0 * np.random.default_rng(6).normal(size=(400, 3))
    fine = np.stack([np.interp(np.arange(7 * 399 + 1) / 7, np.arange(400), column) for column in signal.T], axis=1)
    once, often = (switched_lag(s, up, down, dt, None)[0] for s, dt in ((signal, bench.dt), (fine, bench.dt / 7)))
    np.testing.assert_allclose(once, often[::7], rtol=1e-11, atol=1e-9)
