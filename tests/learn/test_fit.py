"""Parameters recovered from flights of the independent engine, and what they are worth on a flight not used."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap import simulate
from wrenchgap.flight.errors import FitError
from wrenchgap.learn.data.candidates import Lack, inapplicable
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.identify.fit import fit, held_out, with_fit
from wrenchgap.plant.effects import find
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel


def fall(data, model, fitted):
    """Fraction of each axis' rms that the fitted model takes off, (6,)."""
    before = data.measured - data.predict(model.wrench_model)
    after = data.measured - data.predict(with_fit(model, fitted).wrench_model)
    return 1 - np.sqrt(np.mean(after**2, axis=0) / np.mean(before**2, axis=0))


def test_com_offset_is_recovered_and_helps_on_an_unseen_trajectory(fly, offset, hexarotor):
    unseen, _ = fly("com_offset", dict(zip("xyz", offset.values, strict=True)), "figure8", seed=12, seconds=15)
    fitted = fit(offset.data, hexarotor, ["com_offset", "servo_lag"])
    np.testing.assert_allclose(fitted.theta[:3], offset.values, atol=3e-4)
    assert (fall(unseen, hexarotor, fitted)[3:] > 0.8).all()


def test_weak_rotor_is_put_on_the_right_arm(fly, hexarotor):
    data, truth = fly("weak_rotor", None, "train", seed=13, seconds=25)
    fitted = fit(data, hexarotor, ["rotor_thrust", "servo_lag"])
    per_arm = fitted.theta[:12].reshape(6, 2).sum(axis=1)
    rotor = int(truth.parameters["weak_rotor"]["rotor"])
    assert int(np.argmin(per_arm)) == rotor // 2
    loss = truth.parameters["weak_rotor"]["loss"]
    assert per_arm[rotor // 2] == pytest.approx(-loss, rel=0.15)
    assert np.abs(np.delete(per_arm, rotor // 2)).max() < 0.2 * loss


def test_inertia_is_recovered_together_with_the_lag(fly, hexarotor):
    flights = (fly(effect, None, "train", seed=5, seconds=25)[0] for effect in ("inertia", "none"))
    heavy, plain = (fit(data, hexarotor, ["inertia", "servo_lag"]).theta[:3] for data in flights)
    # the engine's own arms act as a small dJ that is always there; the hidden part is the difference
    assert (heavy - plain > 0).all()
    assert (heavy - plain)[2] == pytest.approx(0.0161, rel=0.1)


def test_products_that_no_body_has_end_no_search(offset, hexarotor):
    """Each entry of the change is within its range; all together they make a moment of inertia that is negative."""
    body, tolerances = hexarotor.vehicle.body, hexarotor.vehicle.tolerances
    size = np.sqrt(np.outer(np.diag(body.inertia), np.diag(body.inertia)))
    loose = replace(hexarotor.vehicle, tolerances=replace(tolerances, inertia=0.3 * size))
    wanted = np.concatenate((-0.58 * np.diag(size), 0.45 * np.array([size[0, 1], -size[0, 2], size[1, 2]])))
    assert np.linalg.eigvalsh(symmetric(np.concatenate((np.diag(body.inertia), np.zeros(3))) + wanted))[0] < 0.0
    plain = offset.data.predict(WrenchModel(loose, ()))
    small = offset.data.predict(WrenchModel(loose, (ModelEffect(find("inertia"), 0.01 * wanted),)))
    data = replace(offset.data, measured=plain + 100.0 * (small - plain))  # the wrench is linear in the inertia
    model = replace(hexarotor, vehicle=loose)
    fitted = fit(data, model, ["inertia"])
    assert np.isfinite(held_out(data, model, ["inertia"], fitted)[:, 3:]).any()
    found = symmetric(np.concatenate((np.diag(body.inertia), np.zeros(3))) + fitted.theta)
    assert np.linalg.eigvalsh(found)[0] > 0.0
    assert np.trace(found) < 0.8 * np.trace(body.inertia)  # as far that way as it goes


def symmetric(entries):
    """xx, yy, zz, xy, xz, yz as a matrix."""
    xx, yy, zz, xy, xz, yz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def test_held_out_error_is_not_below_the_fitted_one_and_near_it(offset, hexarotor):
    fitted = fit(offset.data, hexarotor, ["com_offset"])
    unseen = held_out(offset.data, hexarotor, ["com_offset"], fitted)
    ratio = np.sum((unseen * fitted.axis_weights) ** 2) / np.sum((fitted.residual * fitted.axis_weights) ** 2)
    assert 1.0 <= ratio < 1.1


def test_trying_one_more_effect_on_a_base_ends_where_a_full_fit_does(offset, hexarotor):
    base = fit(offset.data, hexarotor, ["com_offset"])
    quick, full = (fit(offset.data, hexarotor, ["com_offset", "servo_lag"], base=b) for b in (base, None))
    assert (np.abs(quick.theta - full.theta) < [1e-4, 1e-4, 1e-4, 3e-4]).all()


@pytest.mark.parametrize(("shift", "stays"), [(0.12, False), (1.0, True)])
def test_small_constant_force_is_taken_for_the_accelerometers_bias(plain, hexarotor, shift, stays):
    """0.03 m/s^2 is a sensor's, 0.5 N on 4 kg is not."""
    fitted = fit(replace(plain, measured=plain.measured + shift * np.eye(6)[1]), hexarotor, ["servo_lag"])
    assert (abs(fitted.residual[:, 1].mean()) > 0.5) == stays


def test_effects_that_the_log_cannot_carry_say_why(plain, hexarotor):
    (record,) = plain.records
    bare = replace(record, has_pose=False, commands=replace(record.commands, tilt=None, rotor_speed=None))
    assert inapplicable("rotor_thrust", hexarotor, (bare,)).lack is Lack.ROTORS
    assert inapplicable("body_drag", hexarotor, (bare,)).lack is Lack.POSE
    assert inapplicable("com_offset", hexarotor, (bare,)) is None
    assert inapplicable("imu_lever_arm", hexarotor, (record,)) is None
    with pytest.raises(FitError, match="rotor commands"):
        fit(replace(plain, records=(bare,)), hexarotor, ["rotor_thrust"])


@pytest.mark.parametrize("name", ["accelerometer_bias", "imu_misalignment", "imu_lever_arm"])
def test_errors_of_an_imu_are_not_tried_where_the_motion_is_the_odometrys(hexarotor, name):
    flight = simulate(hexarotor, "multi_axis", duration=8.0, excitation=1.0, seed=5)
    with_imu, without = (open_flight(log, hexarotor).records for log in (flight, replace(flight, imu=None)))
    assert inapplicable(name, hexarotor, with_imu) is None
    assert inapplicable(name, hexarotor, without).lack is Lack.IMU
    assert "needs an IMU" in str(inapplicable(name, hexarotor, without))
    assert inapplicable("inertia", hexarotor, without) is None


def values(fitted, name):
    return np.array([v for (owner, _), v in zip(fitted.parameters, fitted.theta, strict=True) if owner == name])


@pytest.mark.parametrize("known", [[], ["servo_lag", "arm_reaction"]])
def test_the_place_of_a_payload_is_found_from_nothing(payload, hexarotor, known):
    """Where there is no mass its place makes no difference; the search must go on until it does.

    Added to a base of what is known, as the search tries it, the other effects' derivatives are kept.
    """
    assert not any(p.start for p in find("payload").parameters(hexarotor.vehicle))
    base = fit(payload.data, hexarotor, known) if known else None
    fitted = fit(payload.data, hexarotor, ["servo_lag", "arm_reaction", "payload"], base=base)
    limit = 1e-3 * (np.array([3, 2, 2, 2]) if known else np.array([2, 1, 1, 1]))
    assert (np.abs(values(fitted, "payload") - payload.values) < limit).all()


def test_the_point_where_a_rope_pulls_is_found_from_nothing(fly, hexarotor):
    """The anchor is 12 m away: the pull hardly changes its direction."""
    data, truth = fly("tether", None, "train", seed=6, seconds=25)
    fitted = fit(data, hexarotor, ["tether", "servo_lag", "arm_reaction"])
    given = truth.parameters["tether"]
    away = np.array(given["anchor"]) - [0, 0, 1.6]
    found = values(fitted, "tether")
    np.testing.assert_allclose(found[:3], given["pull"] * away / np.linalg.norm(away), atol=0.03)
    np.testing.assert_allclose(found[3:], given["at"], atol=3e-3)


def test_linearised_and_exact_held_out_residuals_agree_where_the_steps_are_small(offset, hexarotor):
    names = ["com_offset", "servo_lag", "rotor_thrust"]
    fitted = fit(offset.data, hexarotor, names)
    exact, quick = (held_out(offset.data, hexarotor, names, fitted, exact=e) for e in (True, False))
    between = np.linalg.norm(exact - quick, axis=0) / np.linalg.norm(exact - fitted.residual, axis=0)
    assert (between > 0).all()  # a lag is not linear
    assert (between < 0.02).all()


def test_large_steps_are_evaluated_in_full(offset, hexarotor):
    """From a lag of 90 ms back to the true 15 ms the linearisation is far off, and is not used."""
    names = ["com_offset", "servo_lag"]
    best = fit(offset.data, hexarotor, names)
    theta = best.theta + 0.075 * np.eye(4)[3]
    parts = zip(names, (theta[:3], theta[3:]), strict=True)
    far = WrenchModel(hexarotor.vehicle, tuple(ModelEffect(find(n), v) for n, v in parts))
    residual = offset.data.measured - offset.data.predict(far)
    residual[:, :3] -= hexarotor.vehicle.body.mass * best.bias
    moved = replace(best, theta=theta, residual=residual)
    exact, quick = (held_out(offset.data, hexarotor, names, moved, exact=e) for e in (True, False))
    np.testing.assert_array_equal(exact, quick)


def test_what_happens_in_a_block_does_not_reach_its_own_prediction(offset, hexarotor):
    """A torque of 0.3 Nm in every fourth block is still all there; a fit to all blocks takes a part of it away."""
    names, pushed = ["com_offset", "servo_lag"], offset.data.block % 4 == 0
    push = np.outer(pushed, [0, 0, 0, 0.3, 0, 0])
    flights = offset.data, replace(offset.data, measured=offset.data.measured + push)
    fits = [fit(d, hexarotor, names) for d in flights]
    before, after = (held_out(d, hexarotor, names, f)[pushed] for d, f in zip(flights, fits, strict=True))
    lost = np.abs(after - before - push[pushed])[:, 3].mean()
    assert lost < 3e-3
    assert np.abs(fits[1].residual - fits[0].residual - push)[pushed, 3].mean() > 1.5 * lost
