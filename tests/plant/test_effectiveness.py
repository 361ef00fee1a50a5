"""Effectiveness as flown: closed forms of single effects, and that the corrected allocation gives what is asked for."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.vehicle import GRAVITY


def flown(vehicle, tilt=0.0, **effects):
    """Of effects with these values, each known to a tenth."""
    made = []
    for name, values in effects.items():
        one = make_effect(vehicle, name, values)
        made.append(replace(one, std=0.1 * np.abs(one.theta)))
    model = replace(wg.load_model("crazyflie"), path=None, vehicle=vehicle)
    return wg.effectiveness(model.with_effects(made), tilt)


def test_nominally_a_newton_is_a_newton_along_the_thrust_and_a_torque_by_its_arm(quadrotor):
    found = flown(quadrotor)
    x, y, _ = quadrotor.arms.position_B.T
    drag = -quadrotor.rotors.spin * quadrotor.rotors.kappa
    np.testing.assert_allclose(found.matrix.value, [0 * x, 0 * x, 1 + 0 * x, y, -x, drag], atol=1e-12)
    np.testing.assert_allclose(found.achieved.value, np.diag([0, 0, 1, 1, 1, 1]), atol=1e-9)
    assert not found.matrix.identified


def test_a_weak_rotor_a_moved_centre_and_more_drag_torque(quadrotor):
    found = flown(
        quadrotor,
        rotor_thrust={"rotor_2": -0.2},
        com_offset={"x": 0.01, "y": 0.0, "z": 0.0},
        drag_torque={"change": 0.5},
    )
    x, y, _ = quadrotor.arms.position_B.T
    gain, drag = 1.0 - 0.2 * (np.arange(4) == 2), -1.5 * quadrotor.rotors.spin * quadrotor.rotors.kappa
    np.testing.assert_allclose(found.matrix.value[2:], gain * np.array([1 + 0 * x, y, 0.01 - x, drag]), atol=1e-9)
    np.testing.assert_allclose(found.matrix.std[2], 0.02 * (np.arange(4) == 2), atol=1e-9)
    np.testing.assert_allclose(found.matrix.std[4, 0], 0.001, rtol=1e-6)  # 1 mm of the centre of mass
    assert found.achieved.value[5, 5] == pytest.approx(1.5 * gain.mean())
    assert found.achieved.value[4, 2] == pytest.approx(0.01 * gain.mean() + 0.2 * x[2] / 4.0)


def test_a_curve_counts_by_its_slope_in_hover(quadrotor):
    """T = T_h (s^2 + 2 p (s - 1)) over the speed s relative to hover: dT/ds = 2 (1 + p) T_h."""
    found = flown(quadrotor, thrust_curve={"slope": -0.3, "curvature": 0.0})
    np.testing.assert_allclose(found.matrix.value[2], 0.7, rtol=1e-3)


def test_a_value_at_its_limit_is_left_out_and_said(quadrotor):
    found = flown(quadrotor, drag_torque={"change": -0.8})
    assert found.left_out == ("drag_torque",)
    np.testing.assert_array_equal(found.matrix.value, found.matrix.nominal)
    assert "drag_torque is left out" in str(found)


def test_what_the_corrected_allocation_asks_for_is_what_comes(hexarotor):
    """At the tilts and thrusts of the corrected allocation the model itself makes the wrench that was asked for."""
    effects = {
        "rotor_thrust": {f"rotor_{r}": -0.1 * (r == 3) for r in range(12)},
        "tilt_offset": {f"arm_{a}": 0.05 * (a == 1) for a in range(6)},
        "com_offset": {"x": 0.004, "y": -0.006, "z": 0.01},
    }
    found = flown(hexarotor, **effects)
    wanted = np.array([3.0, -2.0, hexarotor.body.mass * GRAVITY, 0.3, -0.2, 0.25])
    along, across = np.split(found.allocation.value @ wanted, 2)
    thrust, tilt = np.hypot(along, across), np.arctan2(across, along)
    normal = np.cos(tilt + 0.05 * (hexarotor.rotors.arm == 1))[:, None] * hexarotor.arms.normal_B[hexarotor.rotors.arm]
    normal += (
        np.sin(tilt + 0.05 * (hexarotor.rotors.arm == 1))[:, None] * hexarotor.arms.lateral_B[hexarotor.rotors.arm]
    )
    force = (thrust * (1.0 - 0.1 * (np.arange(12) == 3)))[:, None] * normal
    hub = hexarotor.arms.position_B[hexarotor.rotors.arm] - [0.004, -0.006, 0.01]
    torque = np.cross(hub, force) - (hexarotor.rotors.spin * hexarotor.rotors.kappa)[:, None] * force
    np.testing.assert_allclose(np.concatenate((force.sum(axis=0), torque.sum(axis=0))), wanted, atol=1e-6)


def test_arms_that_do_not_tilt_are_told(quadrotor, hexarotor):
    with pytest.raises(UsageError, match="does not tilt"):
        flown(quadrotor, 0.1)
    with pytest.raises(UsageError, match="got 2 angles, expected one for all, or one for each of 6 arms"):
        flown(hexarotor, [0.1, 0.2])
    with pytest.raises(UsageError, match="expected degrees, from -360 to 360"):
        flown(hexarotor, np.nan)
    with pytest.raises(UsageError, match="expected degrees, from -360 to 360"):
        flown(hexarotor, 1e300)
    tilted = flown(hexarotor, [0.5, 0.0, 0.0, 0.0, 0.0, 0.0]).matrix.nominal
    np.testing.assert_allclose(tilted[2, :4], [np.cos(0.5), np.cos(0.5), 1.0, 1.0], atol=1e-9)
