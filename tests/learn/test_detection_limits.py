"""What flights could have shown: limits that hold when the effect is put into the flights, and what they depend on."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.learn.data.candidates import Candidates
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.posterior.detection_limits import DetectionLimit
from wrenchgap.learn.posterior.explain import recovery, search_dataset
from wrenchgap.learn.posterior.injection import added_by, change_at, injected, injected_limits
from wrenchgap.plant.effects import catalogue, find
from wrenchgap.replay.present import detection

NAMES = ("com_offset", "mass", "thrust_scale", "rotor_thrust", "imu_lever_arm", "servo_lag", "arm_reaction")


@pytest.fixture(scope="module")
def searched(plain, hexarotor):
    return search_dataset(plain, hexarotor, Candidates(NAMES, ()))


def limit_of(found, effect, parameter):
    return next(one for one in found.limits if (one.effect, one.parameter) == (effect, parameter))


def test_parameters_that_are_not_alone_do_nothing_alone_and_only_they(plain, tumbling, hexarotor):
    """A force acts wherever its point is; a point of no force moves nothing."""
    for name in catalogue():
        for parameter in find(name).parameters(hexarotor.vehicle):
            if parameter.alone:
                continue
            limit = DetectionLimit(name, parameter.name, parameter.unit, parameter.scale, parameter.high)
            others = [p for p in find(name).parameters(hexarotor.vehicle) if p.alone]
            change = change_at(limit, 1.0, hexarotor.vehicle)
            for k, p in enumerate(find(name).parameters(hexarotor.vehicle)):
                change[k] = 0.0 if p in others else change[k]
            np.testing.assert_array_equal(added_by(plain, hexarotor, name, change), 0.0)


@pytest.mark.parametrize("effect", ["mass", "com_offset", "rotor_thrust", "servo_lag", "tilt_offset", "inertia"])
def test_parameters_that_are_alone_do_something_alone(tumbling, hexarotor, effect):
    for parameter in find(effect).parameters(hexarotor.vehicle):
        limit = DetectionLimit(effect, parameter.name, parameter.unit, parameter.scale, parameter.high)
        assert np.any(added_by(tumbling, hexarotor, effect, change_at(limit, 1.0, hexarotor.vehicle)) != 0.0)


def test_an_injected_mass_takes_its_share_of_the_force(plain, hexarotor):
    """A vehicle that is heavier by d has m / (m + d) of the specific force, which is measured as force with m."""
    added, mass = 0.3, hexarotor.vehicle.body.mass
    without = plain.predict(hexarotor.wrench_model)[:, :3]
    found = added_by(plain, hexarotor, "mass", np.array([added]))[:, :3]
    np.testing.assert_allclose(found, without * (mass / (mass + added) - 1.0), atol=1e-9)


def test_what_is_injected_is_in_the_measurement_and_nowhere_else(plain, hexarotor):
    changed = injected(plain, hexarotor, "mass", np.array([0.1]))
    np.testing.assert_allclose(
        changed.measured - plain.measured, added_by(plain, hexarotor, "mass", np.array([0.1])), atol=1e-12
    )
    np.testing.assert_array_equal(changed.commanded, plain.commanded)
    np.testing.assert_array_equal(changed.block, plain.block)


def test_effects_at_their_limits_are_firm_and_nothing_else_is_at_half_of_them(searched, plain, hexarotor):
    tried = [limit_of(searched, "rotor_thrust", "rotor_3"), limit_of(searched, "com_offset", "x")]
    for limit in tried:
        for share in (1.0, 0.5):
            changed = injected(plain, hexarotor, limit.effect, change_at(limit, share, hexarotor.vehicle))
            again = search_dataset(changed, hexarotor, Candidates(NAMES, ()))
            assert recovery(searched, limit, share, again).as_stated, (limit, share, again.firm)


def test_an_effect_that_another_can_make_is_hidden_behind_it(plain, hexarotor):
    """In hover a bias of the accelerometer is a constant force."""
    names = ("accelerometer_bias", "constant_wrench")
    found = search_dataset(plain, hexarotor, Candidates(names, ()))
    limit = limit_of(found, "accelerometer_bias", "z")
    assert not limit.shown
    assert "constant_wrench" in limit.instead


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


def test_injections_are_drawn_from_what_would_be_shown():
    limits = [DetectionLimit("mass", "added", "kg", size, 1.0) for size in (0.1, float("nan"), 0.2, 0.3)]
    drawn = injected_limits(limits, 4, seed=3)
    assert len(drawn) == 4
    assert all(limit.shown for limit, _ in drawn)
    assert [share for _, share in drawn] == [1.0, 0.5, 1.0, 0.5]
    assert injected_limits(limits, 100, seed=3)[:4] == drawn


def test_the_lines_say_what_would_have_been_shown_and_what_not(searched):
    said = detection.sentences(searched)
    assert said[0].startswith("Would have been shown: ")
    assert "rotor_thrust from" in said[0]
    found = detection.to_json(searched)
    assert len(found["limits"]) == len(searched.limits)
    assert all(
        (one["size"] is None) == (not limit.shown) for one, limit in zip(found["limits"], searched.limits, strict=True)
    )
