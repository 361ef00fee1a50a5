"""What is written down of a loop beside the same called in numpy, step by step: whole flights of every kind."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchgap.flight.errors import UsageError
from wrenchgap.plant import model_file
from wrenchgap.plant.effects import catalogue
from wrenchgap.plant.effects.effect import WrenchEffect
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import physics_rate, simulate
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import named
from wrenchgap.plant.wrench_model import ModelEffect

HEXAROTOR = model_file.load("tilt_hexarotor")
SERIES = {
    "odometry": ("position_E", "quat_EB", "velocity_E", "omega_B"),
    "imu": ("omega_B", "specific_force_B"),
    "commanded": ("wrench_B",),
    "desired": ("wrench_B",),
    "actuators": ("tilt", "rotor_speed"),
}


def with_effects(model, *names, size=0.5):
    """The model with these effects, all parameters at half their typical size, or where a search begins."""
    made = []
    for name in names:
        parameters = catalogue()[name].parameters(model.vehicle)
        made.append(make_effect(model.vehicle, name, tuple(p.start or size * p.scale for p in parameters)))
    return model.with_effects(made)


def both(truth, believed=None, seconds=1.0, seed=5, excitation=1.0, helper=None, **options):
    """The same flight in compiled code and in plain numpy; and the generators afterwards."""
    believed = truth.nominal if believed is None else believed
    asked, found = named("multi_axis", seconds, excitation, seed), []
    for compiled in (True, False):
        rng = np.random.default_rng(seed)
        options = {"physics_rate": physics_rate(believed)} | options
        given = options if helper is None else options | {"compensator": helper()}
        flown = simulate(truth, believed, asked, seconds, rng=rng, compiled=compiled, **given)
        found.append((flown, rng.bit_generator.state))
    return found


def assert_equal(found, tolerance=1e-10):
    (one, drawn), (other, drawn_plainly) = found
    for role, names in SERIES.items():
        assert (getattr(one, role) is None) == (getattr(other, role) is None)
        for name in names if getattr(one, role) is not None else ():
            values, plain = (getattr(getattr(f, role), name) for f in (one, other))
            assert values.shape == plain.shape
            size = max(1.0, float(np.abs(plain).max(initial=0.0)))
            assert values == pytest.approx(plain, abs=tolerance * size, nan_ok=True), f"{role}.{name}"
            assert np.array_equal(getattr(one, role).time, getattr(other, role).time)
    assert one.notes == other.notes
    assert drawn == drawn_plainly
    assert one.start_ns == other.start_ns


@pytest.mark.parametrize("name", ["tilt_hexarotor", "voliro_x", "asymmetric_quadrotor", "crazyflie"])
def test_every_vehicle_flies_as_in_plain_numpy(name):
    assert_equal(both(model_file.load(name)))


def test_a_vehicle_of_which_only_the_wrench_is_known():
    bare = replace(HEXAROTOR, vehicle=replace(HEXAROTOR.vehicle, arms=None, rotors=None))
    found = both(with_effects(bare, "com_offset", "body_drag", "command_delay"), bare)
    assert found[0][0].actuators is None
    assert_equal(found)


@pytest.mark.parametrize("name", sorted(set(catalogue()) - {"asymmetric_motor_lag"}))
def test_every_effect_of_the_catalogue_acts_as_in_plain_numpy(name):
    model = model_file.load("voliro_x") if catalogue()[name].needs_coaxial else HEXAROTOR
    truth = with_effects(model, name)
    found = both(truth, model, seconds=0.25, voltage=lambda t: 16.0 - 0.5 * t)
    assert not any("plain numpy" in note for note in found[0][0].notes)
    assert_equal(found)


def test_many_effects_at_a_thousand_steps_a_second():
    names = ("com_offset", "body_drag", "wind", "rotor_drag", "servo_lag", "motor_lag", "command_delay", "arm_reaction")
    truth = with_effects(HEXAROTOR, *names, "imu_misalignment", "battery_sag", "ground_effect", "inertia")
    assert_equal(both(truth, HEXAROTOR, physics_rate=1000.0, voltage=lambda t: 15.0 + 0.1 * np.sin(t)))


def test_what_decides_by_a_value_flies_in_plain_numpy():
    truth = with_effects(HEXAROTOR, "asymmetric_motor_lag")
    (asked, drawn), plain = both(truth, HEXAROTOR, seconds=0.3)
    (said,) = (note for note in asked.notes if "plain numpy" in note)
    assert "asymmetric_motor_lag" in said
    notes = tuple(note for note in asked.notes if note != said)
    assert_equal([(replace(asked, notes=notes), drawn), plain])


class Jolting(WrenchEffect):
    """A user's own effect, which remembers how often it was asked."""

    name, excited_by = "jolting", "anything"

    def __init__(self):
        self.asked = 0

    def parameters(self, vehicle):
        return ()

    def apply(self, actuation, wrench_B, theta, context):
        self.asked += 1
        return np.full((len(wrench_B), 6), 1e-3 * (self.asked % 7))


def test_an_effect_of_a_users_own_is_asked_at_every_step():
    def flown(compiled):
        truth = HEXAROTOR.with_effects([ModelEffect(Jolting(), np.zeros(0))])
        return simulate(
            truth, HEXAROTOR, named("hover", 0.5, 0.0, 0), 0.5, rng=np.random.default_rng(1), compiled=compiled
        )

    one, other = flown(True), flown(False)
    assert any("jolting is not of the catalogue" in note for note in one.notes)
    np.testing.assert_allclose(one.imu.specific_force_B, other.imu.specific_force_B, atol=1e-12)
    assert np.ptp(one.imu.specific_force_B[:, 0]) > 0.0


class Halving:
    """A compensator that looks at the state and remembers."""

    def __init__(self):
        self.last = np.zeros(6)

    def step(self, wrench, state):
        self.last = 0.5 * self.last + 0.01 * np.concatenate((state.velocity_E[0], state.omega_B[0]))
        return SimpleNamespace(wrench_cmd=wrench + self.last + 1e-3 * state.time[0])


def test_a_compensator_is_asked_once_a_period():
    assert_equal(both(with_effects(HEXAROTOR, "com_offset", "servo_lag"), HEXAROTOR, helper=Halving))


def test_disturbance_integral_feedback_and_start_are_those_given():
    r = named("multi_axis", 1.0, 1.0, 5).at(np.zeros(1))
    start = State(r.time, r.position_E + 0.1, r.quat_ED, r.velocity_E - 0.2, r.omega_D + 0.3)
    found = both(
        HEXAROTOR,
        disturbance=lambda t: np.array([0.3, -0.2, 0.1, 0.02, 0.01, -0.02]) * np.sin(9.0 * t),
        integral=np.array([0.02, -0.01, 0.03]),
        feedback="true",
        initial=start,
        physics_rate=600.0,
        gravity=9.79,
    )
    assert_equal(found)


def test_limits_of_the_actuators_are_kept_and_counted():
    v = HEXAROTOR.vehicle
    arms = replace(v.arms, tilt_rate_max=np.full(6, 0.8), tilt_min=np.full(6, -0.2), tilt_max=np.full(6, 0.2))
    narrow = replace(v, arms=arms, rotors=replace(v.rotors, speed_max=np.full_like(v.rotors.speed_max, 740.0)))
    found = both(HEXAROTOR, replace(HEXAROTOR, vehicle=narrow), seconds=3.0)
    assert sum("was limited" in note for note in found[0][0].notes) == 3
    assert_equal(found)


@pytest.mark.parametrize(
    ("pushed", "what"),
    [
        (np.array([0, 0, -300.0, 0, 0, 0]), " m from"),
        (np.array([0, 0, 0, 9.0, 0, 0]), " deg from"),
        (np.full(6, np.inf), "finite"),
    ],
)
def test_loss_of_control_ends_both_at_the_same_step(pushed, what):
    """The generator is left as the plain flight leaves it, which drew only while it flew."""
    found = both(HEXAROTOR, disturbance=lambda t: pushed if t > 0.4 else np.zeros(6), seconds=4.0)
    assert any("control was lost" in note and what in note for note in found[0][0].notes)
    assert_equal(found)


def test_a_flight_that_cannot_begin_says_so():
    r = named("hover", 1.0, 0.0, 0).at(np.zeros(1))
    far = State(r.time, r.position_E + 50.0, r.quat_ED, r.velocity_E, r.omega_D)
    with pytest.raises(UsageError, match=r"position|from the reference: the flight cannot begin there"):
        simulate(HEXAROTOR, None, named("hover", 1.0, 0.0, 0), rng=np.random.default_rng(0), initial=far)
