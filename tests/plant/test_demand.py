"""What a motion asks of rotors: hover, a weak rotor, acceleration, drag in wind, and margins of known loops."""

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.flight import GRAVITY
from wrenchgap.plant.demand import demand
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.stability import FREQUENCIES, phase_and_gain_margins
from wrenchgap.plant.state import Motion, State
from wrenchgap.plant.wrench_model import WrenchModel

QUADROTOR, HEXAROTOR = wg.load_model("crazyflie"), wg.load_model("tilt_hexarotor")
DT, N = 0.02, 80


def level(up=0.0):
    """N samples level, with so much acceleration upwards [m/s^2]."""
    zero, still = np.zeros((N, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (N, 1))
    return State(DT * np.arange(N), zero, still, zero, zero), Motion(zero, zero, zero + (GRAVITY + up) * np.eye(3)[2])


def of(model, effects=(), up=0.0, disturbance=(0.0,) * 6):
    state, motion = level(up)
    made = WrenchModel(model.vehicle, tuple(make_effect(model.vehicle, name, values) for name, values in effects))
    return demand([made], state, motion, DT, np.tile(disturbance, (1, N, 1)))


def hovering(model):
    """The share of its full thrust that each of equal rotors takes in hover."""
    _, rotors = model.vehicle.geometry()
    return model.vehicle.body.mass * GRAVITY / (len(rotors) * rotors.c_f * rotors.speed_max**2)


def test_a_hover_takes_the_weight_of_all_rotors():
    found = of(QUADROTOR)
    assert found.reached.all()
    assert found.thrust[0] == pytest.approx(hovering(QUADROTOR))
    assert of(QUADROTOR, up=0.5 * GRAVITY).thrust[0] == pytest.approx(1.5 * hovering(QUADROTOR))
    assert of(QUADROTOR, [("payload", [0.01, *QUADROTOR.vehicle.body.com_B])]).thrust[0] == pytest.approx(
        hovering(QUADROTOR) * (1.0 + 0.01 / QUADROTOR.vehicle.body.mass), rel=1e-3
    )


def test_of_a_weak_rotor_more_is_asked():
    """A fifth weaker, it has to be asked for a quarter more; the others as before."""
    asked = of(QUADROTOR, [("rotor_thrust", [-0.2, 0.0, 0.0, 0.0])]).thrust[0] / hovering(QUADROTOR)
    assert asked == pytest.approx([1.25, 1.0, 1.0, 1.0], rel=2e-3)


def test_rotors_that_push_along_z_make_a_side_force_by_leaning():
    """The thrust is the length of weight and side force; the wrench about the other axes stays."""
    weight = QUADROTOR.vehicle.body.mass * GRAVITY
    asked = of(QUADROTOR, disturbance=(0.5 * weight, 0.0, 0.0, 0.0, 0.0, 0.0)).thrust[0]
    assert asked == pytest.approx(np.sqrt(1.25) * hovering(QUADROTOR), rel=2e-3)


def test_arms_that_tilt_make_a_side_force_level():
    """Arms turn until their thrusts add up to weight and side force, of which each arm makes its part."""
    weight = HEXAROTOR.vehicle.body.mass * GRAVITY
    found = of(HEXAROTOR, disturbance=(0.0, 0.3 * weight, 0.0, 0.0, 0.0, 0.0))
    assert found.reached.all()
    assert found.tilt[0].max() > 0.0
    most = of(HEXAROTOR).thrust[0].max() * np.sqrt(1.0 + 0.6**2)  # arms across the force cannot help
    assert of(HEXAROTOR).thrust[0].max() < found.thrust[0].max() <= most * (1.0 + 1e-9)


def test_a_wrench_that_nothing_makes_is_not_reached():
    """A rotor that has lost all of its thrust cannot be asked for more."""
    found = of(QUADROTOR, [("rotor_thrust", [-1.0, 0.0, 0.0, 0.0])])
    assert not found.reached.any()


def test_margins_of_a_second_order_loop():
    """L = (2 zeta w s + w^2) / s^2 exp(-s T): |L| = 1 at wc, where the phase is that of its zero less wc T."""
    zeta, w, delay, s = 0.8, 6.0, 0.02, 1j * FREQUENCIES
    bare = (2.0 * zeta * w * s + w**2) / s**2
    crossing = w * np.sqrt(2.0 * zeta**2 + np.sqrt(4.0 * zeta**4 + 1.0))
    phase, gain = phase_and_gain_margins(np.stack((bare, bare * np.exp(-delay * s))))
    lead = np.degrees(np.arctan(2.0 * zeta * crossing / w))
    assert phase == pytest.approx([lead, lead - np.degrees(delay * crossing)], abs=0.05)
    assert np.isinf(gain[0])
    factor = 10.0 ** (gain[1] / 20.0)
    assert phase_and_gain_margins(factor * bare[None] * np.exp(-delay * s))[0] == pytest.approx(0.0, abs=0.3)


def test_a_loop_that_is_unstable_has_no_gain_margin():
    s = 1j * FREQUENCIES
    phase, gain = phase_and_gain_margins(((3.0 * s + 9.0) / s**2 * np.exp(-0.6 * s))[None])
    assert phase[0] < 0.0
    assert gain[0] == 0.0


def test_a_drag_in_wind_is_leant_against():
    """Linear drag k against a wind v: the thrust is the length of the weight and k v."""
    k, v, weight = 0.02, 5.0, QUADROTOR.vehicle.body.mass * GRAVITY
    parameters = [p.name for p in make_effect(QUADROTOR.vehicle, "body_drag", {}).effect.parameters(QUADROTOR.vehicle)]
    values = {name: k for name in parameters if name.startswith("linear")}
    asked = of(QUADROTOR, [("body_drag", values), ("wind", [v, 0.0])]).thrust[0]
    assert asked == pytest.approx(np.hypot(1.0, k * v / weight) * hovering(QUADROTOR), rel=2e-3)
