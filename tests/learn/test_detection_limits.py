"""What flights could have shown: limits that hold when the effect is put into the flights, and what they depend on."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from wrenchgap.learn.data.candidates import Candidates
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.posterior import detection_limits
from wrenchgap.learn.posterior.detection_limits import DetectionLimit, InjectedSpectrum
from wrenchgap.learn.posterior.explain import search_dataset
from wrenchgap.learn.posterior.injection import Injection, Recovery, injection, recoveries
from wrenchgap.learn.posterior.relinearisation import spectrum_of
from wrenchgap.learn.posterior.score import Scorer
from wrenchgap.learn.posterior.single_effects import model_residual, single_effects
from wrenchgap.plant.effects import catalogue, find
from wrenchgap.plant.wrench_model import ModelEffect
from wrenchgap.replay.present import detection

NAMES = ("com_offset", "mass", "thrust_scale", "rotor_thrust", "imu_lever_arm", "servo_lag", "arm_reaction")


@pytest.fixture(scope="module")
def searched(plain, hexarotor):
    return search_dataset(plain, hexarotor, Candidates(NAMES, ()))


def limit_of(found, effect, parameter):
    return next(one for one in found.limits if (one.effect, one.parameter) == (effect, parameter))


def injected(data, model, one):
    return dataset(one.into(data.records, model), model, data.answering)


def added(data, model, one):
    return injected(data, model, one).measured - data.measured


def of_typical_size(name, parameter):
    return DetectionLimit(name, parameter.name, parameter.unit, parameter.scale, parameter.high)


def test_parameters_that_are_not_alone_do_nothing_alone(tumbling, hexarotor):
    """A force acts wherever its point is; a point of no force moves nothing."""
    seen = 0
    for name in catalogue():
        parameters = find(name).parameters(hexarotor.vehicle)
        for k, parameter in enumerate(parameters):
            if not parameter.alone:
                change = np.where(np.arange(len(parameters)) == k, parameter.scale, 0.0)
                np.testing.assert_allclose(added(tumbling, hexarotor, Injection(name, change)), 0.0, atol=1e-12)
                seen += 1
    assert seen >= 10


@pytest.mark.parametrize("effect", ["mass", "com_offset", "rotor_thrust", "servo_lag", "tilt_offset", "inertia"])
def test_parameters_that_are_alone_do_something_alone(tumbling, hexarotor, effect):
    for parameter in find(effect).parameters(hexarotor.vehicle):
        one = injection(of_typical_size(effect, parameter), 1.0, hexarotor)
        assert np.abs(added(tumbling, hexarotor, one)).max() > 1e-3


def test_an_effect_is_injected_where_its_limit_was_found(tumbling, hexarotor):
    """A tether's force has a torque about its point: the limit of a force says which point that was."""
    force = DetectionLimit("tether", "force_x", "N", 0.5, 5.0, where=(("point_z", 0.2),))
    np.testing.assert_allclose(
        added(tumbling, hexarotor, injection(force, 1.0, hexarotor)),
        added(tumbling, hexarotor, Injection("tether", np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.2]))),
    )


def test_an_injected_mass_takes_its_share_of_the_force(plain, hexarotor):
    """A vehicle that is heavier by d has m / (m + d) of the specific force, which is measured as force with m."""
    more, mass = 0.3, hexarotor.vehicle.body.mass
    without = plain.predict(hexarotor.wrench_model)[:, :3]
    found = added(plain, hexarotor, Injection("mass", np.array([more])))[:, :3]
    np.testing.assert_allclose(found, without * (mass / (mass + more) - 1.0), atol=1e-9)


def test_a_little_of_one_effect_is_seen_beside_much_of_another(tumbling, hexarotor):
    """Alone, moments of inertia fit what the centre of mass does, far from what they are: the straight line that is
    taken there has it that nothing of them is worse than nothing beside the centre of mass.
    """
    off = ModelEffect(find("com_offset"), np.array([-0.004, 0.007, -0.005]))
    there = Injection("com_offset", off.theta).into(tumbling.records, hexarotor)
    moments = Injection("inertia", np.array([0.0, 0.0, 0.0, 0.0012, 0.0, 0.0]))
    both = dataset(moments.into(there, hexarotor.with_replaced([off])), hexarotor, tumbling.answering)
    found = search_dataset(both, hexarotor, Candidates((*NAMES, "inertia", "tether"), ()), limits_of=())
    assert {"com_offset", "inertia"} <= set(found.firm) <= {"com_offset", "inertia", "servo_lag", "arm_reaction"}
    assert found.changes("inertia")["xy"] == pytest.approx(0.0012, rel=0.15)


def test_what_is_injected_is_in_the_measurement_and_nowhere_else(plain, hexarotor):
    changed = injected(plain, hexarotor, Injection("mass", np.array([0.1])))
    assert np.abs(changed.measured - plain.measured).max() > 0.1
    np.testing.assert_array_equal(changed.commanded, plain.commanded)
    np.testing.assert_array_equal(changed.block, plain.block)
    np.testing.assert_array_equal(changed.noise, plain.noise)


def test_products_of_flights_with_an_effect_are_those_of_flights_that_had_it(plain, hexarotor):
    """A scale of thrust is linear: what the search is told of an injection is what the flights themselves would say."""
    on = model_residual(plain, hexarotor)
    columns = single_effects(on, ("thrust_scale",)).columns
    size = 0.05
    there = model_residual(injected(plain, hexarotor, Injection("thrust_scale", np.array([size]))), hexarotor)
    given, wanted = (spectrum_of(one, columns) for one in (on, there))
    row = int(given.parameters["thrust_scale"][0])
    found = InjectedSpectrum(given, row, given.offset["thrust_scale"], size, 0.0)
    largest = wanted.products[:, :, 0, 0].max(axis=0)
    np.testing.assert_allclose(found.products[:, :, 0, 0], wanted.products[:, :, 0, 0], atol=1e-6 * largest.min())
    first = np.zeros(given.scale.size)
    first[0] = 1.0
    np.testing.assert_allclose(found.combined(first), wanted.combined(first), atol=1e-5 * np.sqrt(largest.min()))


@pytest.mark.slow
def test_effects_at_their_limits_are_firm_and_nothing_else_is_at_half_of_them(searched, plain, hexarotor):
    tried = [limit_of(searched, "rotor_thrust", "rotor_3"), limit_of(searched, "com_offset", "x")]

    def firm(one):
        return search_dataset(injected(plain, hexarotor, one), hexarotor, Candidates(NAMES, ()), limits_of=()).firm

    found = recoveries(tried, searched.firm, hexarotor, 4, 0, firm)
    assert {(one.effect, one.share) for one in found} == {
        (name, share) for name in ("rotor_thrust", "com_offset") for share in (1.0, 0.5)
    }
    assert all(one.as_stated for one in found), found


def test_what_is_at_its_bound_already_could_not_have_been_shown(plain, hexarotor):
    """A loss of thrust of all that a rotor may lose cannot grow: no change of it is plausible."""
    on = model_residual(plain, hexarotor)
    (column,) = single_effects(on, ("thrust_scale",)).columns
    bound = find("thrust_scale").parameters(hexarotor.vehicle)[0].low
    spectrum = spectrum_of(on, (replace(column, origin=np.array([bound]), high=np.zeros(1)),))
    scorer = Scorer(spectrum, spectrum.saturated()[0])
    (found,) = detection_limits.detection_limits(scorer, (), hexarotor.vehicle)
    assert found.plausible == 0.0
    assert not found.shown


def test_an_effect_that_another_can_make_is_hidden_behind_it(plain, hexarotor):
    """Where upper and lower rotors carry the same share, what the lower ones lose is a loss of all thrust."""
    found = search_dataset(plain, hexarotor, Candidates(("coaxial_loss", "thrust_scale"), ()))
    limit = limit_of(found, "coaxial_loss", "eta")
    assert not limit.shown
    assert limit.instead == ("thrust_scale",)


@pytest.mark.slow
def test_louder_sensors_show_less(searched, plain, hexarotor):
    """Of white noise ten times as large, limits that the noise makes are larger, and none is smaller."""
    rng = np.random.default_rng(0)
    louder = [
        replace(r, measured=r.measured + 10.0 * r.noise * rng.normal(size=r.measured.shape), noise=10.0 * r.noise)
        for r in plain.records
    ]
    found = search_dataset(dataset(louder, hexarotor), hexarotor, Candidates(NAMES, ()))
    for before in searched.limits:
        after = limit_of(found, before.effect, before.parameter)
        assert not after.shown or abs(after.size) >= 0.99 * abs(before.size)
    lever = limit_of(found, "imu_lever_arm", "x")
    assert not lever.shown or abs(lever.size) > 2.0 * abs(limit_of(searched, "imu_lever_arm", "x").size)


def test_what_is_named_has_no_limit_and_others_have_theirs_beside_it(offset, hexarotor):
    found = search_dataset(offset.data, hexarotor, Candidates(NAMES, ()))
    assert "com_offset" in found.effects
    assert "com_offset" not in {one.effect for one in found.limits}
    assert limit_of(found, "rotor_thrust", "rotor_0").shown


def test_a_size_beyond_what_an_effect_can_be_is_no_limit(searched, plain, hexarotor, monkeypatch):
    """A search between flights allows changes of twice the bounds; no rotor loses 114 % of its thrust."""
    seen = abs(limit_of(searched, "rotor_thrust", "rotor_3").size)
    narrow = tuple(
        replace(p, low=-0.5 * seen, high=0.5 * seen) for p in find("rotor_thrust").parameters(hexarotor.vehicle)
    )
    own = Mock(parameters=lambda vehicle: narrow)
    monkeypatch.setattr(detection_limits, "find", lambda name: own if name == "rotor_thrust" else find(name))
    found = search_dataset(plain, hexarotor, Candidates(NAMES, ()))
    assert not limit_of(found, "rotor_thrust", "rotor_3").shown
    assert limit_of(found, "com_offset", "x").shown


def test_a_factor_is_said_as_one_and_a_relative_change_in_per_cent(searched):
    """Of `ground_effect` the gain is 8.6 times the law of one rotor, which is no 860 %."""
    gain = DetectionLimit("ground_effect", "gain", "1", 8.6, 100.0)
    thrust = DetectionLimit("thrust_scale", "scale", "1", 0.086, 0.3)
    said = detection.sentences(replace(searched, limits=(gain, thrust), recoveries=()))[0]
    assert "ground_effect gain from 8.6" in said
    assert "thrust_scale from 8.6 %" in said


def test_what_injections_say_of_limits_is_said_as_good_or_bad(searched):
    limit = limit_of(searched, "thrust_scale", "scale")
    one = Recovery(limit.effect, limit.parameter, limit.unit, 0.01, 1.0, True, ())
    *_, held = detection.sentences(replace(searched, recoveries=(one,)))
    assert (
        held == "Limits checked by injection into these flights, the limits held: thrust_scale scale 1.0 % was found."
    )
    *_, failed = detection.sentences(replace(searched, recoveries=(one, replace(one, firm=False))))
    assert "1 of 2 did not hold (take them as optimistic)" in failed
    assert failed.endswith("thrust_scale scale 1.0 % was missed.")


def test_injections_are_drawn_from_what_would_be_shown(hexarotor):
    limits = [DetectionLimit("mass", "added", "kg", size, 1.0) for size in (0.1, float("nan"), 0.2, 0.3)]
    asked = []
    found = recoveries(limits, (), hexarotor, 4, 3, lambda one: asked.append(float(one.change[0])) or ("mass",))
    assert [one.share for one in found] == [1.0, 0.5, 1.0, 0.5]
    assert asked == [one.size for one in found]
    assert set(asked[::2]) < {0.1, 0.2, 0.3}
    assert all(one.as_stated for one in found)
    missed = recoveries(limits, (), hexarotor, 2, 3, lambda one: ())
    assert [one.as_stated for one in missed] == [False, True]
    other = recoveries(limits, (), hexarotor, 2, 3, lambda one: ("mass", "payload"))
    assert not any(one.as_stated for one in other)


def test_the_lines_say_what_would_have_been_shown_and_what_not(searched):
    said = detection.sentences(searched)
    assert said[0].startswith("By the geometry, not checked by injection, would have been shown: ")
    assert "rotor_thrust from" in said[0]
    found = detection.to_json(searched)
    assert len(found["limits"]) == len(searched.limits)
    assert all(
        (one["size"] is None) == (not limit.shown) for one, limit in zip(found["limits"], searched.limits, strict=True)
    )


def test_what_was_injected_and_not_firm_is_not_said_to_have_been_shown(searched):
    limit = limit_of(searched, "thrust_scale", "scale")
    before = detection.sentences(searched, 100, 100)
    missed = Recovery(limit.effect, limit.parameter, limit.unit, limit.size, 1.0, False, ())
    would, could, *_ = detection.sentences(replace(searched, recoveries=(missed,)), 100, 100)
    assert would.startswith("Would surely have been shown: ")
    assert "thrust_scale from" in before[0]
    assert "thrust_scale" not in would
    assert "thrust_scale scale " in could
    assert "(injected as a test, and missed)" in could


def test_what_is_seen_under_another_name_is_no_effect_that_could_not_have_been_shown(searched):
    """`check` says that such a log is enough for it."""
    weak, alike = (replace(one, size=np.nan) for one in searched.limits[:2])
    limits = (
        replace(weak, effect="mass", instead=()),
        replace(alike, effect="com_offset", instead=("constant_wrench",)),
    )
    said = " ".join(detection.sentences(replace(searched, limits=limits, recoveries=())))
    assert "Could not have been shown: mass (too weak here)" in said
    assert "Could not have been told apart: com_offset from constant_wrench." in said
