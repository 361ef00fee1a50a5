"""A model that says how well it knows its thrust and its rotors' axes: a whole rotor is not named for either."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from tests.independent.flown_quadrotor import MASS, MODEL, PLACES, Case, fly
from wrenchgap.flight.flight import GRAVITY
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.identify.add import addition, trial
from wrenchgap.learn.identify.bias_and_trim import twist_of_axes, with_thrust_as_given
from wrenchgap.learn.identify.fit import fit
from wrenchgap.learn.identify.least_squares import left_by
from wrenchgap.plant.history import Outcome
from wrenchgap.plant.vehicle import Tolerances

LESS, TWIST, WEAK = 0.87, 0.03, 0.8
"""Of the thrust of all rotors; a yaw torque [Nm]; of the third rotor's."""


def unsure(**known):
    return replace(MODEL, vehicle=replace(MODEL.vehicle, tolerances=Tolerances(**known)))


def pushed(time, position, velocity, attitude, rate, thrusts):
    return np.zeros(3), np.array([0.0, 0.0, TWIST])


@pytest.fixture(scope="module")
def hovers(once):
    """Seeds 61 and 62: nothing but less thrust and a yaw torque; and the third rotor weaker besides."""

    def made():
        blades = [(LESS,) * 4, (LESS, LESS, LESS * WEAK, LESS)]
        cases = [
            Case(f"h{k}", seed=61 + k, seconds=30.0, gusts=0.2, blades=b, law=pushed) for k, b in enumerate(blades)
        ]
        return [one.records for one in wg.open_flights(fly(cases), MODEL)]

    return once("unsure-thrust", made)


def test_the_twist_of_axes_is_that_of_thrusts_turned_about_their_arms():
    """Each of four axes turned by delta about its arm gives r m g / 4 delta about z; by chance, half of all in line."""
    delta = 0.01
    turned = [np.cross(p, np.cross(p / np.linalg.norm(p), [0.0, 0.0, -delta * MASS * GRAVITY / 4])) for p in PLACES]
    each = np.abs(np.array(turned)[:, 2])
    assert twist_of_axes(unsure(thrust_axis=delta)) == pytest.approx(np.sqrt(np.sum(each**2)), rel=1e-12)
    assert twist_of_axes(MODEL) == 0.0


def test_a_yaw_trim_and_less_thrust_are_no_pair_of_opposite_rotors(hovers):
    """The rotors lose 13 % all alike; exact in its thrust the model lets two of them lose more than the others."""
    sure, granted = (
        fit(dataset(hovers[0], m), m, ["rotor_thrust"]) for m in (MODEL, unsure(thrust=0.15, thrust_axis=0.05))
    )
    assert np.all(sure.theta[[0, 2]] < LESS - 1.0 - 5.0 * sure.std[[0, 2]])
    assert np.abs(granted.theta / granted.std).max() < 3.0
    assert granted.thrust == pytest.approx(LESS - 1.0, abs=0.05)


def test_a_weak_rotor_is_seen_beside_them(hovers):
    model = unsure(thrust=0.15, thrust_axis=0.05)
    found = fit(dataset(hovers[1], model), model, ["rotor_thrust"])
    assert abs(found.theta[2] - LESS * (WEAK - 1.0)) < 2.0 * found.std[2]
    assert found.theta[2] < -4.0 * found.std[2]
    assert np.abs(found.theta[[0, 1, 3]] / found.std[[0, 1, 3]]).max() < 3.0


def test_calibration_finds_the_thrust_that_is_granted_elsewhere():
    cases = [Case(f"c{k}", seed=71 + k, seconds=24.0, excited=0.3, blades=(LESS,) * 4) for k in range(2)]
    found = wg.calibrate(wg.open_flights(fly(cases), unsure(thrust=0.15)), unsure(thrust=0.15))
    scale = next(one for one in found.trimmed if one.effect == "thrust_scale")
    assert scale.value == pytest.approx(LESS - 1.0, abs=0.01)


@pytest.mark.parametrize(("name", "left"), [("thrust_scale", 0.1), ("com_offset", 1.0)])
def test_the_error_falls_by_what_the_added_model_has_and_not_by_what_was_granted(hovers, name, left):
    """In hover the command is larger than the weight by as much as thrust is missing."""
    model = unsure(thrust=0.15)
    data = dataset(hovers[0], model)
    found = trial(data, model, [name], fit(data, with_thrust_as_given(model), [name]))
    missing = (1.0 / LESS - 1.0) * MASS * GRAVITY
    assert found.before[2] == pytest.approx(missing, rel=0.1)  # less 5 mg, an accelerometer's own
    assert found.after[2] == pytest.approx(left * missing, abs=0.1 * missing)


def test_a_constant_that_is_added_holds_with_the_thrust_that_the_model_has(hovers):
    """In hover the constant takes all that is missing: a thrust that `explain` was granted is not written beside it."""
    model = unsure(thrust=0.15)
    data = dataset(hovers[0], model)
    granted = fit(data, model, ["constant_wrench"])
    assert granted.thrust.size == 1
    added = addition(model, model, ["constant_wrench"], [], data, granted, "as explain fitted it")
    missing = (1.0 / LESS - 1.0) * MASS * GRAVITY
    (made,) = added.model.effects
    assert made.theta[2] == pytest.approx(-missing, rel=0.1)
    assert added.model.vehicle.tolerances.thrust == 0.15
    assert added.trial.after[2] < 0.1 * added.trial.before[2]
    assert added.trial.outcome is Outcome.BETTER


def test_thrust_that_is_asked_for_is_not_granted_besides(hovers):
    """`add thrust_scale` and `calibrate` have all of it; a model that was told better by a flight grants none."""
    model = unsure(thrust=0.15)
    found = fit(dataset(hovers[0], model), model, ["thrust_scale"])
    assert found.theta[0] == pytest.approx(LESS - 1.0, abs=0.01)
    assert found.thrust.size == 0
    added = model.with_effects(found.effects)
    assert fit(dataset(hovers[0], added), added, []).thrust.size == 0
    assert np.abs(left_by(dataset(hovers[0], added), added)[:, 2].mean()) < 0.02 * MASS * GRAVITY
