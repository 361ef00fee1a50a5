"""Air that moves: no force of its own, and only the velocity relative to it counts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.so3 import rotate, rotate_inverse
from wrenchgap.plant import model_file
from wrenchgap.plant.effects import catalogue
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.closed_loop import Clock, command_stage, fly
from wrenchgap.plant.state import rows
from wrenchgap.plant.wrench_model import WrenchModel

AIR = np.array([2.0, -1.5, 0.0])
WIND = {"velocity_x": AIR[0], "velocity_y": AIR[1]}
SEEING = {
    "body_drag": [0.3, 0.2, 0.4, 0.05, 0.03, 0.1, 0.02, -0.01, 0.03],
    "body_drag_areas": [0.1, 0.2, 0.15],
    "rotor_drag": [1.5e-4],
    "axial_inflow": [2e-4],
    "translational_lift": [1e-3],
}
"""Every effect through which the air acts, with values."""
LINEAR = {"body_drag": [0.3, 0.3, 0.3, 0, 0, 0, 0, 0, 0]}
seeing = pytest.mark.parametrize("name", SEEING)


def model(bench, values):
    return WrenchModel(bench.vehicle, tuple(make_effect(bench.vehicle, n, v) for n, v in values.items()))


def wrench(bench, values, u, x):
    return model(bench, values).wrench(u, x)[0]


def test_every_effect_through_which_the_air_acts_is_here():
    assert {name for name, effect in catalogue().items() if effect.aerodynamic} == set(SEEING)


def test_alone_it_has_no_force(bench):
    x, u = bench.moving(0)
    np.testing.assert_array_equal(wrench(bench, {"wind": WIND}, u, x), wrench(bench, {}, u, x))


@seeing
def test_drifting_with_the_air_feels_nothing(bench, name):
    x, u = bench.state(velocity=AIR, quat=bench.turned), bench.commands()
    np.testing.assert_allclose(
        wrench(bench, {name: SEEING[name], "wind": WIND}, u, x), wrench(bench, {}, u, x), atol=1e-9
    )


@seeing
@pytest.mark.parametrize("seed", range(3))
def test_a_velocity_added_to_vehicle_and_air_changes_nothing(bench, name, seed):
    """Galileo: who stands on a ship that moves sees the same forces."""
    x, u = bench.moving(seed)
    ship = np.array([-3.0, 1.0, 0.0])
    aboard = bench.state(velocity=x.velocity_E[0] + AIR + ship, quat=x.quat_EB[0], omega=x.omega_B[0])
    ashore = bench.state(velocity=x.velocity_E[0] + AIR, quat=x.quat_EB[0], omega=x.omega_B[0])
    carried = {"velocity_x": (AIR + ship)[0], "velocity_y": (AIR + ship)[1]}
    still = wrench(bench, {name: SEEING[name]}, u, x)
    assert np.abs(still - wrench(bench, {}, u, x)).max() > 1e-3
    np.testing.assert_allclose(wrench(bench, {name: SEEING[name], "wind": WIND}, u, ashore), still, atol=1e-9)
    np.testing.assert_allclose(wrench(bench, {name: SEEING[name], "wind": carried}, u, aboard), still, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("values", [LINEAR, {"rotor_drag": SEEING["rotor_drag"]}], ids=["body", "rotors"])
def test_drag_does_negative_work_in_the_airs_frame(bench, seed, values):
    x, u = bench.moving(seed)
    W = wrench(bench, {**values, "wind": WIND}, u, x) - wrench(bench, {}, u, x)
    through_air = bench.state(velocity=x.velocity_E[0] - AIR, quat=x.quat_EB[0], omega=x.omega_B[0])
    assert bench.power(W, through_air) < 0


def test_standing_in_the_wind_is_pushed_downwind(bench):
    x, u = bench.leaning(), bench.commands()
    W = wrench(bench, {**LINEAR, "wind": WIND}, u, x) - wrench(bench, {}, u, x)
    np.testing.assert_allclose(rotate(bench.turned, W[:3]), 0.3 * AIR, atol=1e-9)


def drifting(bench, values, velocity, seconds=4.0, dt=0.01):
    """A level vehicle whose thrust balances its weight, left to the air."""
    clock = Clock(np.arange(0.0, seconds, dt), dt)
    u = bench.commands()
    command, signals = command_stage(rows(u, np.zeros(len(clock.time), dtype=int)))
    return fly(model(bench, values), bench.state(velocity=velocity), clock, [command], signals)[0].state


def test_closed_loop_is_carried_along_as_the_closed_form_says(bench):
    """m dv/dt = -D (v - v_w): v = v_w (1 - exp(-D t / m))."""
    x = drifting(bench, {**LINEAR, "wind": WIND}, (0, 0, 0), seconds=20.0)
    rate = 0.3 / bench.body.mass
    expected = AIR * (1.0 - np.exp(-rate * x.time))[:, None]
    assert np.abs(expected[-1]).max() > 0.7 * np.abs(AIR).max()
    np.testing.assert_allclose(x.velocity_E, expected, atol=2e-3)


def test_closed_loop_in_the_wind_is_that_in_still_air_seen_from_a_ship(bench):
    start = np.array([1.0, 0.5, -0.3])
    windy = drifting(bench, {**SEEING, "wind": WIND}, start + AIR)
    still = drifting(bench, SEEING, start)
    np.testing.assert_allclose(windy.position_E, still.position_E + AIR * still.time[:, None], atol=1e-9)
    np.testing.assert_allclose(windy.quat_EB, still.quat_EB, atol=1e-9)


FILE = """schema = 1
[vehicle]
name = "kite"
mass = 2.0
inertia = [0.02, 0.02, 0.03]
[[effects]]
name = "wind"
[effects.parameters]
drag = {drag}
force_x = 0.8
force_y = -0.4
"""


@pytest.mark.parametrize(
    ("drag", "remedy"),
    [
        (0.4, r"linear_x = linear_y = linear_z = 0.4 .*velocity_x = 2, velocity_y = -1 instead"),
        (0.0, r"a tether with force_x = 0.8, force_y = -0.4 instead"),
    ],
)
def test_parameters_of_an_earlier_version_are_refused_with_the_remedy(drag, remedy):
    with pytest.raises(ModelError, match=remedy) as caught:
        model_file.loads(FILE.format(drag=drag))
    assert "\n" not in str(caught.value)


def test_the_remedy_is_the_force_that_the_earlier_version_had(bench):
    """F_E = -D v + w at the centre of mass."""
    x, u = bench.moving(3)
    new = {"body_drag": [0.4, 0.4, 0.4, 0, 0, 0, 0, 0, 0], "wind": [2.0, -1.0]}
    W = wrench(bench, new, u, x) - wrench(bench, {}, u, x)
    earlier = -0.4 * x.velocity_E[0] + np.array([0.8, -0.4, 0.0])
    np.testing.assert_allclose(W[:3], rotate_inverse(x.quat_EB[0], earlier), atol=1e-9)


@pytest.mark.parametrize(
    ("turned_deg", "speed", "shows"),
    [(4.0, 0.3, False), (0.0, 0.0, False), (25.0, 0.3, True), (4.0, 1.5, True)],
    ids=["a hover indoors", "at rest", "in several directions", "fast"],
)
def test_air_that_neither_turns_nor_is_flown_through_is_a_constant_force(bench, turned_deg, speed, shows):
    """D R^T (v - v_w) is constant in B where R and v hardly change: a trim, a mounting and a wind are one thing."""
    time = np.linspace(0.0, 40.0, 400)
    wave = np.sqrt(2.0) * np.sin(0.5 * time)  # rms 1
    quat = Rotation.from_euler("z", wave[:, None] * turned_deg + 90.0, degrees=True).as_quat(scalar_first=True)
    x, _ = bench.moving(0)
    many = replace(rows(x, np.zeros(len(time), int)), quat_EB=quat, velocity_E=np.outer(wave, [speed, 0.0, 0.0]))
    said = catalogue()["wind"].unexcited(model(bench, {}).context(many))
    assert (said is None) == shows
    if said is not None:
        assert f"turned by {turned_deg:.0f} deg rms and moved by {speed:.2g} m/s rms" in said
