"""Drag torque with and without the thrust's change."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import null_space

from wrenchgap.flight.flight import Samples
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.errors import rms
from wrenchgap.learn.data.measurement import prepare
from wrenchgap.learn.identify.fit import fit
from wrenchgap.plant import model_file
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.wrench_model import WrenchModel

N0 = np.array([0.0, 0.0, 1.0])


def yaw(bench, *effects, speed=None):
    """Wrench (6,) of level arms at these speeds."""
    made = tuple(make_effect(bench.vehicle, name, values) for name, values in effects)
    return WrenchModel(bench.vehicle, made).wrench(bench.commands(0.0, speed), bench.state())[0]


def test_at_nominal_thrust_both_forms_are_one(bench):
    for seed in range(5):
        x, u = bench.moving(seed)
        one, other = (bench.added(n, {"change": 0.4}, u, x) for n in ("drag_torque", "drag_torque_of_speed"))
        np.testing.assert_allclose(one, other, atol=1e-12)
        np.testing.assert_allclose(bench.added("drag_torque_of_speed", {"of_speed": 1.0}, u, x), 0, atol=1e-12)


@pytest.mark.parametrize(
    ("form", "left"),
    [
        (("drag_torque", {"change": 0.5}), 1.5 * 0.7),  # of the thrust that is there
        (("drag_torque_of_speed", {"change": 0.5}), 0.7 + 0.5),  # only the added torque is of the speed
        (("drag_torque_of_speed", {"of_speed": 1.0}), 1.0),  # as if nothing were lost
        (("drag_torque_of_speed", {"change": 0.5, "of_speed": 1.0}), 1.5),
    ],
)
def test_a_rotor_that_lost_three_tenths_of_its_thrust_drags(bench, form, left):
    """Rotor 1 alone runs, counter-clockwise: drag torque in units of kappa c_f Omega^2, clockwise on the body."""
    W = yaw(bench, ("rotor_thrust", {"rotor_1": -0.3}), form, speed=bench.only(1))
    unit = bench.c_f * bench.hover**2
    np.testing.assert_allclose(W[:3], 0.7 * unit * N0, atol=1e-12)
    assert W[5] == pytest.approx(-left * bench.kappa * unit)


def test_a_pair_at_equal_speeds_makes_no_yaw_torque_though_the_lower_rotor_lifts_less(bench):
    """Rotors 0 and 1 sit on one arm and turn against each other."""
    speed = bench.only(0) + bench.only(1)
    lost = ("coaxial_loss", {"eta": 0.2})
    kept = yaw(bench, lost, ("drag_torque_of_speed", {"of_speed": 1.0}), speed=speed)
    assert kept[5] == pytest.approx(0.0, abs=1e-12)
    assert abs(yaw(bench, lost, speed=speed)[5]) == pytest.approx(0.2 * bench.kappa * bench.c_f * bench.hover**2)


def flown_by_a_quadrotor(vehicle, gain, seconds=30.0):
    """Rotors make `gain` (R,) times their nominal thrust at nominal drag torques; summed rotor by rotor.

    Speeds wander about those at which the torques balance; the body turns freely, by Euler's equations.
    """
    arms, rotors = vehicle.geometry()
    p, J, rng = arms.position_B[rotors.arm], vehicle.body.inertia, np.random.default_rng(0)
    lever = np.stack((gain * p[:, 1], -gain * p[:, 0], -rotors.spin * rotors.kappa))
    balanced = null_space(lever)[:, 0]
    balanced *= vehicle.body.mass * 9.81 / (gain @ balanced)
    rate, phase = 2 * np.pi * rng.uniform(0.3, 3, (4, 4)), rng.uniform(0, 6, (4, 4))

    def thrust(t):
        return balanced * (1.0 + 0.05 * np.sin(rate * t + phase).sum(axis=0))

    def turn(t, w):
        return np.linalg.solve(J, lever @ thrust(t) - np.cross(w, J @ w))

    time = np.arange(0.0, seconds, 0.005)
    omega = solve_ivp(turn, (0, seconds), np.zeros(3), t_eval=time, rtol=1e-9, atol=1e-9).y.T
    nominal = np.array([thrust(t) for t in time])
    force = np.zeros_like(omega)
    force[:, 2] = nominal @ gain / vehicle.body.mass
    noise = rng.standard_normal((2, *omega.shape)) * np.reshape([2e-3, 0.02], (2, 1, 1))
    speed = np.sqrt(nominal / rotors.c_f)
    return Samples(
        "f", time, 0.005, omega + noise[0], force + noise[1], tilt_cmd=np.zeros((len(time), 4)), rotor_speed_cmd=speed
    )


def test_weak_rotor_that_drags_as_before_is_found_as_such():
    """12 % less thrust, all of the drag torque; in the other form of the family the yaw torque stays unexplained."""
    model = model_file.load("crazyflie")
    samples = flown_by_a_quadrotor(model.vehicle, np.array([1.0, 1.0, 0.88, 1.0]))
    data = dataset([prepare(samples, model.vehicle)], model)
    found = fit(data, model, ("rotor_thrust", "drag_torque_of_speed"))
    (change, of_speed), gains = (found.values(n) for n in ("drag_torque_of_speed", "rotor_thrust"))
    assert gains[2].value == pytest.approx(-0.12, abs=0.01)
    assert of_speed.value == pytest.approx(1.0, abs=0.1)
    assert change.value == pytest.approx(0.0, abs=0.03)
    other = fit(data, model, ("rotor_thrust", "drag_torque"))
    assert rms(found.residual)[5] < 0.5 * rms(other.residual)[5]
