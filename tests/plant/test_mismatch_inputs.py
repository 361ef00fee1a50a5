"""Inputs of a mismatch besides the command: closed forms of `past`, and the motion in the right frame."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.mismatch_inputs import COLUMNS, PAST_SECONDS, columns, extra_inputs, ordered_groups
from wrenchgap.plant.state import State

DT = 0.005


def states(count, **parts):
    """At rest in the origin but for `parts`."""
    level, zeros = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), np.zeros((count, 3))
    return replace(State(np.arange(count) * DT, zeros, level, zeros, zeros), **parts)


def past(sent, dt=DT):
    return extra_inputs(("past",), sent, states(len(sent)), dt)[0]


def test_past_of_a_constant_is_nothing_and_of_a_ramp_its_slope_times_the_time_constant():
    """Of y' = (W - y) / tau under W = s t, W - y = tau s (1 - exp(-t / tau))."""
    slope = np.array([2.0, -1.0, 5.0, 0.3, 0.0, -0.1])
    time = np.arange(400) * DT
    expected = PAST_SECONDS * slope * (1.0 - np.exp(-time / PAST_SECONDS))[:, None]
    assert past(np.arange(6.0) + time[:, None] * slope) == pytest.approx(expected, abs=1e-9)
    assert expected[-1] == pytest.approx(PAST_SECONDS * slope, rel=1e-9)


@pytest.mark.parametrize("hertz", [0.2, 2.0, 8.0])
def test_past_of_a_sine_is_a_first_order_high_pass(hertz):
    """1 - 1 / (1 + j w tau) = j w tau / (1 + j w tau): amplitude and phase."""
    dt, w = 0.002, 2.0 * np.pi * hertz
    time = np.arange(round(3.0 / dt)) * dt
    settled = time > 1.0
    wave = past(np.tile(np.sin(w * time)[:, None], (1, 6)), dt)[settled]
    basis = np.column_stack([np.sin(w * time), np.cos(w * time)])[settled]
    found = np.linalg.lstsq(basis, wave, rcond=None)[0]
    gain = 1j * w * PAST_SECONDS / (1.0 + 1j * w * PAST_SECONDS)
    assert found == pytest.approx(np.tile([[gain.real], [gain.imag]], (1, 6)), abs=2e-3)


def test_past_of_a_step_dies_out_with_the_time_constant():
    sent = np.zeros((100, 6))
    sent[10:, 2] = 4.0
    found = past(sent)[:, 2]
    assert (found[:10] == 0).all()
    assert found[11:] / found[10:-1] == pytest.approx(np.full(89, np.exp(-DT / PAST_SECONDS)))


def test_one_by_one_is_all_at_once():
    rng = np.random.default_rng(0)
    count, names = 40, ("velocity", "rates", "position", "past")
    sent = rng.normal(size=(count, 6))
    position, velocity, omega, turn = rng.normal(size=(4, count, 3))
    motion = states(count, position_E=position, velocity_E=velocity, omega_B=omega, quat_EB=so3.exp(turn))
    whole, _ = extra_inputs(names, sent, motion, DT)
    memory, rows = None, []
    for k in range(count):
        row, memory = extra_inputs(names, sent[[k]], motion.take(slice(k, k + 1)), DT, memory)
        rows.append(row[0])
    assert np.array(rows) == pytest.approx(whole, abs=1e-12)
    first, kept = extra_inputs(names, sent[:25], motion.take(slice(0, 25)), DT)
    second, _ = extra_inputs(names, sent[25:], motion.take(slice(25, count)), DT, kept)
    assert np.vstack((first, second)) == pytest.approx(whole, abs=1e-12)


def test_velocity_is_seen_from_the_body():
    """Flying east: with the nose north it comes from the left (-y), upside down about x it is still forwards."""
    east = np.array([3.0, 0.0, 0.0])
    turns = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2], [np.pi, 0.0, 0.0], [0.0, np.pi / 2, 0.0]])
    motion = states(4, velocity_E=np.tile(east, (4, 1)), quat_EB=so3.exp(turns))
    found, _ = extra_inputs(("velocity",), np.zeros((4, 6)), motion, DT)
    assert found == pytest.approx(np.array([[3, 0, 0], [0, -3, 0], [3, 0, 0], [0, 0, 3]]), abs=1e-12)


def test_rates_and_position_are_those_of_the_state():
    motion = states(2, omega_B=np.arange(6.0).reshape(2, 3), position_E=-np.arange(6.0).reshape(2, 3))
    found, memory = extra_inputs(("rates", "position"), np.zeros((2, 6)), motion, DT)
    assert found.tolist() == [[0, 1, 2, 0, -1, -2], [3, 4, 5, -3, -4, -5]]
    assert memory is None


def test_columns_have_names_in_one_order():
    for names in ((), *((name,) for name in COLUMNS)):
        found, _ = extra_inputs(names, np.zeros((3, 6)), states(3), DT)
        assert found.shape == (3, len(columns(names)))
    every = columns(tuple(COLUMNS))
    assert len(set(every)) == len(every) == 15
    assert columns(("past",))[5] == "past_torque_z"
    assert ordered_groups(()) == ()
    assert ordered_groups(("past", "velocity")) == ordered_groups(("velocity", "past")) == ("velocity", "past")


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("past", "weather"), "unknown group 'weather'; available besides the wrench: velocity, rates, position, past"),
        (("past", "rates", "past"), "past, rates, past names a group twice"),
    ],
)
def test_unknown_and_doubled_names_are_refused(names, message):
    with pytest.raises(UsageError, match=message):
        ordered_groups(names)
