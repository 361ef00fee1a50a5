"""Gains where a model file gives none: any vehicle from the mandatory keys alone flies."""

import numpy as np
import pytest

from wrenchgap.flight import so3
from wrenchgap.plant import model_file
from wrenchgap.plant.controller import control_law, default_gains
from wrenchgap.plant.simulation.simulate import physics_rate, simulate
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import named
from wrenchgap.plant.vehicle import GRAVITY

BODIES = {
    "30 g": ("mass = 0.03\ninertia = [1.4e-5, 1.4e-5, 2.2e-5]\n", (0.046, 2e-8, 0.006, 0.023, 2600)),
    "4 kg": ("mass = 4.0\ninertia = [0.1, 0.1, 0.19]\n", (0.35, 2e-5, 0.016, 0.15, 1100)),
}


def model(body, arms="none"):
    """From the mandatory keys alone, or with four arms that tilt or not."""
    keys, (length, c_f, kappa, radius, fastest) = BODIES[body]
    text = f"schema = 1\n[vehicle]\nname = 'minimal'\n{keys}"
    if arms != "none":
        text += f"[vehicle.arm]\nlength = {length}\ntilts = {str(arms == 'tilting').lower()}\n"
        text += f"[vehicle.rotor]\nc_f = {c_f}\nkappa = {kappa}\nradius = {radius}\nspeed_max = {fastest}\n"
        for azimuth, spin in ((45, 1), (135, -1), (225, 1), (315, -1)):
            text += f"[[vehicle.arms]]\nazimuth_deg = {azimuth}\nrotors = [{{ spin = {spin} }}]\n"
    return model_file.loads(text)


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize(
    ("arms", "trajectory"),
    [("none", "hover"), ("none", "pitch"), ("fixed", "hover"), ("fixed", "figure8_level"), ("tilting", "figure8")],
)
def test_it_flies(body, arms, trajectory):
    made = model(body, arms)
    flown = simulate(made, None, named(trajectory, 12.0), rng=np.random.default_rng(0), physics_rate=physics_rate(made))
    true, asked = flown.odometry, flown.reference
    assert true.time[-1] == pytest.approx(12.0, abs=0.02)  # a flight in which control is lost ends there
    wanted = np.stack([np.interp(true.time, asked.time, column) for column in asked.position_E.T], axis=-1)
    assert np.linalg.norm(true.position_E - wanted, axis=1).max() < 0.15


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("axis", np.eye(3))
def test_a_small_attitude_error_asks_for_the_weight_at_the_radius_of_gyration(body, axis):
    made, rest = model(body), named("hover", 1.0).at(np.zeros(1))
    body = made.vehicle.body
    still = State(np.zeros(1), rest.position_E, so3.exp(1e-4 * axis[None]), np.zeros((1, 3)), np.zeros((1, 3)))
    wrench, _ = control_law(made.controller, body, still, rest, np.zeros((1, 3)))
    radius = np.sqrt(axis @ body.inertia @ axis / body.mass)
    assert wrench[0, 3:] @ axis == pytest.approx(-1e-4 * body.mass * GRAVITY * radius, rel=1e-6)


def test_a_vehicle_half_as_long_is_faster_by_the_root_of_two():
    """Froude scaling; a quarter of the inertia per mass is half the length."""
    one = model_file.loads("schema = 1\n[vehicle]\nname = 'a'\nmass = 1.0\ninertia = [0.01, 0.01, 0.02]\n")
    half = model_file.loads("schema = 1\n[vehicle]\nname = 'a'\nmass = 2.0\ninertia = [0.005, 0.005, 0.01]\n")
    ratio = np.array(half.controller.omega_attitude) / one.controller.omega_attitude
    np.testing.assert_allclose(ratio, np.sqrt(2.0))
    assert half.controller.omega_position / one.controller.omega_position == pytest.approx(np.sqrt(2.0))


def test_yaw_of_fixed_rotors_asks_for_no_more_than_their_drag_torque():
    vehicle = model("4 kg", "fixed").vehicle
    omega = default_gains(vehicle).omega_attitude[2]
    assert vehicle.body.inertia[2, 2] * omega**2 == pytest.approx(0.016 * 4.0 * GRAVITY)


@pytest.mark.parametrize("body", BODIES)
def test_position_and_attitude_together_are_damped(body):
    """Poles of the chain from attitude to position, for small errors."""
    gains = model(body, "fixed").controller
    wp, zp, wa, za = gains.omega_position, gains.zeta_position, gains.omega_attitude[0], gains.zeta_attitude[0]
    poles = np.roots([1.0, 2 * za * wa, wa**2, 2 * zp * wp * wa**2, wp**2 * wa**2])
    assert np.max(poles.real / np.abs(poles)) < -0.4


def test_what_is_given_stays():
    given = default_gains(model("30 g").vehicle, {"omega_attitude": (5.0, 6.0, 7.0), "rate_hz": 100.0})
    assert given.omega_attitude == (5.0, 6.0, 7.0)
    assert (given.omega_position, given.rate_hz) == (1.0, 100.0)
    slow = default_gains(model("30 g").vehicle, {"rate_hz": 40.0})
    assert max(slow.omega_attitude) == pytest.approx(10.0)
