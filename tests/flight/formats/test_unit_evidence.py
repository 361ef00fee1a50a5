"""Units that numbers give away, and numbers that give nothing away."""

import numpy as np
import pytest

from wrenchgap.flight.flight import GRAVITY
from wrenchgap.flight.formats import unit_evidence

TIME = np.arange(0, 8.0, 0.01)
STAMPS = np.round(1e9 * TIME).astype(np.int64)


@pytest.mark.parametrize(("factor", "unit"), [(1.0, "rad s"), (180.0 / np.pi, "deg s")])
def test_the_attitude_tells_the_unit_of_a_rate(logs, factor, unit):
    motion = logs.Motion(TIME)
    shaking = np.random.default_rng(0).normal(0.0, 0.5, (len(TIME), 3))  # rad/s, as a frame shakes
    found, ratio = unit_evidence.rate_unit(STAMPS, factor * (motion.omega_B + shaking), motion.quat_EB)
    assert found == unit
    assert ratio == pytest.approx(factor, rel=0.5)


def test_an_attitude_at_rest_and_a_rate_between_the_units_tell_nothing(logs):
    motion = logs.Motion(TIME)
    rest = np.tile([1.0, 0.0, 0.0, 0.0], (len(TIME), 1))
    assert unit_evidence.rate_unit(STAMPS, motion.omega_B, rest) is None
    assert unit_evidence.rate_unit(STAMPS, 7.5 * motion.omega_B, motion.quat_EB) is None


@pytest.mark.parametrize("rows", [0, 1, 5])
def test_a_few_rows_tell_nothing(logs, rows):
    motion = logs.Motion(TIME)
    assert unit_evidence.rate_unit(STAMPS[:rows], motion.omega_B[:rows], motion.quat_EB[:rows]) is None


@pytest.mark.parametrize(("one", "unit"), [(1.0, "g"), (GRAVITY, "m s2"), (1000.0, "mg"), (3.0, None)])
def test_gravity_tells_the_unit_of_an_accelerometer(logs, one, unit):
    size = unit_evidence.upright_median(logs.Motion(TIME).specific_force_B * one / GRAVITY)
    assert unit_evidence.acceleration_unit(size) == unit


def test_a_sustained_turn_without_gravity_is_not_1_g():
    """Acceleration of a circle in m/s^2, gravity removed: 1 across the body, for as long as it lasts."""
    assert unit_evidence.upright_median(np.tile([0.0, 1.0, 0.02], (100, 1))) is None


@pytest.mark.parametrize(("median", "counts"), [(2048, 2048), (2232, 2048), (3000, None), (520, 512), (10, None)])
def test_counts_of_an_accelerometer(median, counts):
    assert unit_evidence.counts_of_gravity(median) == counts


def test_motor_outputs_of_a_blackbox():
    dshot, unit = unit_evidence.blackbox_outputs(np.array([[48.0, 2047.0], [1047.5, 158.0]]))
    assert unit == "normalised"
    np.testing.assert_allclose(dshot, [[0.0, 1.0], [0.5, 110 / 1999]], atol=1e-3)
    pulses, unit = unit_evidence.blackbox_outputs(np.array([[1000.0, 2000.0], [1150.0, 0.0]]))
    assert (unit, pulses.max()) == ("pwm", 2000.0)
    assert unit_evidence.blackbox_outputs(np.array([[0.0, 5000.0]])) is None
    assert unit_evidence.blackbox_outputs(np.zeros((3, 4))) is None
