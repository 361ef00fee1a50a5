"""What a process looks at on a recorded flight: the command, and the groups of inputs behind it."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight import so3
from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Samples
from wrenchgap.learn.data.measurement import prepare
from wrenchgap.learn.data.prediction import pooled_inputs, process_inputs
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.learn.process.train import fit
from wrenchgap.plant import model_file
from wrenchgap.plant.mismatch_inputs import PAST_SECONDS

VEHICLE = model_file.load("tilt_hexarotor").vehicle
DT = 0.005
SLOPE = np.array([0.5, 0.0, 1.0, 0.02, -0.03, 0.01])
OMEGA = np.array([0.0, 0.0, 0.4])
VELOCITY = np.array([2.0, -1.0, 0.5])


def samples(**change):
    """Four seconds at constant velocity and yaw rate, under a command that rises steadily."""
    time = np.arange(800) * DT
    omega, force, velocity = (np.tile(row, (800, 1)) for row in (OMEGA, [0.0, 0.0, 9.80665], VELOCITY))
    wrench = 39.0 * np.eye(6)[2] + time[:, None] * SLOPE
    moved = {"position_E": time[:, None] * VELOCITY, "velocity_E": velocity, "quat_EB": so3.exp(time[:, None] * OMEGA)}
    return Samples("steady", time, DT, omega, force, wrench, **(moved | change))


@pytest.fixture(scope="module")
def record():
    return prepare(samples(), VEHICLE)


@pytest.mark.parametrize(("groups", "columns"), [((), 6), (("velocity", "past"), 6 + 3 + 6)])
def test_command_comes_first(record, groups, columns):
    found = process_inputs(groups, record)
    assert found.shape == (len(record), columns)
    assert np.array_equal(found[:, :6], record.commanded)


def test_past_of_a_rising_command_is_its_slope_in_one_record_after_the_other(record):
    """A filter without phase or loss at rest lets a constant pass: tau dW/dt."""
    found = pooled_inputs(("past",), [record, record])[:, 6:]
    assert found == pytest.approx(np.tile(PAST_SECONDS * SLOPE, (2 * len(record), 1)), rel=2e-3, abs=1e-6)


def test_velocity_turns_with_the_body(record):
    """v_B of a constant v_E goes round with the yaw rate, at the same filter's gain of one (0.06 Hz)."""
    found = process_inputs(("velocity",), record)[:, 6:]
    c, s, one = np.cos(OMEGA[2] * record.time), np.sin(OMEGA[2] * record.time), np.ones(len(record))
    x, y, z = VELOCITY
    assert found == pytest.approx(np.column_stack([c * x + s * y, c * y - s * x, z * one]), abs=2e-3)


def test_rates_and_position(record):
    found = process_inputs(("rates", "position"), record)[:, 6:]
    assert found[:, :3] == pytest.approx(np.tile(OMEGA, (len(record), 1)))
    assert found[:, 3:] == pytest.approx(record.time[:, None] * VELOCITY, abs=2e-3)


def test_group_that_needs_a_pose_says_so():
    """Past and rates do without; velocity and position cannot be made up."""
    blind = prepare(samples(position_E=None, velocity_E=None, quat_EB=None), VEHICLE)
    assert process_inputs(("rates", "past"), blind).shape == (len(blind), 15)
    with pytest.raises(FitError, match="steady: input velocity, position needs odometry") as caught:
        process_inputs(("velocity", "position", "past"), blind)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def flown():
    """Inputs, and a torque that depends on force_x and, twice as much, on velocity_x; processes with it and without."""
    x = np.random.default_rng(0).normal(size=(600, 9)) * [8, 8, 3, 0.3, 0.3, 0.2, 2, 2, 2] + 39 * np.eye(9)[2]
    torque = 0.02 * x[:, [0]] + 0.04 * x[:, [6]]
    settings = FitSettings(points=100, restarts=0, inputs=("velocity",)), FitSettings(points=100, restarts=0)
    seeing, blind = (fit(x[:, :n], torque, ("torque_x",), s) for n, s in zip((9, 6), settings, strict=True))
    return x, torque, seeing, blind


def test_a_process_uses_what_it_is_given(flown):
    x, torque, seeing, blind = flown
    assert np.abs(seeing.mean(x) - torque).mean() < 0.15 * np.abs(blind.mean(x[:, :6]) - torque).mean()


def test_given_the_rest_it_is_a_function_of_the_command(flown):
    x, _, gp, _ = flown
    here = gp.given(np.array([1.0, 0.0, -2.0]))
    commands = x[:20, :6]
    full = np.hstack((commands, np.tile([1.0, 0.0, -2.0], (20, 1))))
    assert np.array_equal(here.mean(commands), gp.mean(full))
    assert np.array_equal(here.std(commands), gp.std(full))
    assert np.array_equal(here.jacobian(commands), gp.jacobian(full)[:, :, :6])
    faster = gp.given(np.array([3.0, 0.0, -2.0]))
    assert faster.mean(commands) - here.mean(commands) == pytest.approx(np.full((20, 1), 0.08), abs=0.015)


def test_settings_and_columns_must_agree(flown):
    gp = flown[2]
    with pytest.raises(FitError, match="9 inputs, expected 12"):
        replace(gp, settings=replace(gp.settings, inputs=("past",)))
