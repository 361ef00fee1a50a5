"""Parameters recovered from flights of the independent engine, and what they are worth on a flight not used."""

from dataclasses import replace

import numpy as np
import pytest

from flight.errors import FitError
from learn.fit import fit, held_out, inapplicable, with_fit


def fall(data, model, fitted):
    """Fraction of each axis' rms that the fitted model takes off, (6,)."""
    before = data.measured - data.predict(model.wrench_model)
    after = data.measured - data.predict(with_fit(model, fitted).wrench_model)
    return 1 - np.sqrt(np.mean(after**2, axis=0) / np.mean(before**2, axis=0))


def test_com_offset_is_recovered_and_helps_on_an_unseen_trajectory(fly, hexarotor):
    data, truth = fly("com_offset", None, "train", seed=11, seconds=25)
    unseen, _ = fly("com_offset", dict(truth.parameters["com_offset"]), "figure8", seed=12, seconds=15)
    fitted = fit(data, hexarotor, ["com_offset", "servo_lag"])
    expected = [truth.parameters["com_offset"][a] for a in "xyz"]
    np.testing.assert_allclose(fitted.theta[:3], expected, atol=3e-4)
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
    data, _ = fly("inertia", None, "train", seed=5, seconds=25)
    alone, _ = fly("none", None, "train", seed=5, seconds=25)
    heavy = fit(data, hexarotor, ["inertia", "servo_lag"]).theta[:3]
    plain = fit(alone, hexarotor, ["inertia", "servo_lag"]).theta[:3]
    # the engine's own arms act as a small dJ that is always there; the hidden part is the difference
    assert (heavy - plain > 0).all()
    assert (heavy - plain)[2] == pytest.approx(0.0161, rel=0.1)


def test_held_out_error_is_not_below_the_fitted_one_and_near_it(fly, hexarotor):
    data, _ = fly("com_offset", None, "train", seed=11, seconds=25)
    fitted = fit(data, hexarotor, ["com_offset"])
    unseen = held_out(data, hexarotor, ["com_offset"], fitted)
    ratio = np.sum((unseen * fitted.axis_weights) ** 2) / np.sum((fitted.residual * fitted.axis_weights) ** 2)
    assert 1.0 <= ratio < 1.1


def test_trying_one_more_effect_on_a_base_ends_where_a_full_fit_does(fly, hexarotor):
    data, _ = fly("com_offset", None, "train", seed=11, seconds=25)
    base = fit(data, hexarotor, ["com_offset"])
    quick = fit(data, hexarotor, ["com_offset", "servo_lag"], base=base)
    full = fit(data, hexarotor, ["com_offset", "servo_lag"])
    assert (np.abs(quick.theta - full.theta) < [1e-4, 1e-4, 1e-4, 3e-4]).all()


def test_small_constant_force_is_taken_for_the_accelerometers_bias(fly, hexarotor):
    """0.03 m/s^2 is a sensor's, 0.5 N on 4 kg is not."""
    data, _ = fly("none", None, "train", seed=5, seconds=25)
    for shift, stays in ((0.12, False), (1.0, True)):
        moved = replace(data, measured=data.measured + np.array([0, shift, 0, 0, 0, 0]))
        fitted = fit(moved, hexarotor, ["servo_lag"])
        assert (abs(fitted.residual[:, 1].mean()) > 0.5) == stays


def test_effects_that_the_log_cannot_carry_say_why(fly, hexarotor):
    data, _ = fly("none", None, "train", seed=5, seconds=25)
    bare = replace(
        data,
        records=tuple(
            replace(r, has_pose=False, commands=replace(r.commands, tilt=None, rotor_speed=None)) for r in data.records
        ),
    )
    assert "rotor commands" in inapplicable("rotor_thrust", hexarotor, bare.records)
    assert "--topic odometry" in inapplicable("body_drag", hexarotor, bare.records)
    assert inapplicable("com_offset", hexarotor, bare.records) is None
    with pytest.raises(FitError, match="rotor commands"):
        fit(bare, hexarotor, ["rotor_thrust"])
