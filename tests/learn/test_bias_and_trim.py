"""What differs between flights as a whole: measured, granted to later flights, and written into the model file."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.identify.bias_and_trim import (
    WORTH,
    between_flights,
    flights_apart,
    granted_trims,
    trim_of,
    typical_trim,
    unclear_constant,
)
from wrenchgap.learn.identify.fit import fit
from wrenchgap.plant import model_file
from wrenchgap.plant.history import Value
from wrenchgap.plant.model_file import dumps, loads
from wrenchgap.plant.vehicle import GRAVITY


def several(fly, hexarotor, count=4):
    """The same flight several times over, as so many flights."""
    records = fly("none", None, "train", seed=23, seconds=25)[0].records
    return dataset([replace(r, flight=str(k)) for k in range(count) for r in records], hexarotor)


def noise(data, seed=0):
    return np.random.default_rng(seed).standard_normal(data.measured.shape) * data.noise


def test_flights_that_differ_by_noise_do_not_differ(fly, hexarotor):
    data = several(fly, hexarotor)
    assert all(between_flights(data, noise(data, seed), hexarotor) is None for seed in range(20))


def test_one_flight_says_nothing(plain, hexarotor):
    assert between_flights(plain, noise(plain), hexarotor) is None


def test_the_scatter_is_that_which_was_put_in_pooled_with_what_is_typical(fly, hexarotor):
    """Random effects: the sum of squares over count - 1, with typical values that are worth two flights; a later
    flight differs from the mean of the others by that times sqrt(1 + 1/n).
    """
    data = several(fly, hexarotor)
    sizes = np.array([0.3, -0.1, -0.5, 0.3])  # their mean is zero
    left = noise(data)
    left[:, 3] += sizes[data.flight]
    found = between_flights(data, left, hexarotor)
    usual = typical_trim(hexarotor)
    assert found[3] == pytest.approx(np.sqrt((np.sum(sizes**2) + WORTH * usual[3] ** 2) / (3 + WORTH) * 1.25), rel=0.02)
    assert found[5] == pytest.approx(usual[5] * np.sqrt(WORTH / (3 + WORTH) * 1.25), rel=0.2)


def test_flights_that_differ_by_more_than_vehicles_do_are_told_apart(fly, hexarotor):
    """Centres of mass 16 % of the arm apart on two flights, not 4 %: that is how a battery goes in."""
    data = several(fly, hexarotor, 2)
    usual = typical_trim(hexarotor)[4]
    for share, axes in ((4.0, [4]), (1.0, [])):
        left = noise(data)
        left[:, 4] += share * usual * np.array([-1.0, 1.0])[data.flight]
        found = flights_apart(data, left, hexarotor)
        assert [one.axis for one in found] == axes
    left[:, 4] += 3.0 * usual * np.array([-1.0, 1.0])[data.flight]
    (one,) = flights_apart(data, left, hexarotor)
    assert one.names == ("0", "1")
    assert one.means == pytest.approx([-4.0 * usual, 4.0 * usual], rel=0.02)


def test_typical_trims_follow_from_weight_and_arm(hexarotor):
    """A centre of mass that is 2 % of the arm off turns the vehicle by weight times that; rotors add little."""
    weight, arm = hexarotor.vehicle.body.mass * GRAVITY, np.linalg.norm(hexarotor.vehicle.arms.position_B[0, :2])
    usual = typical_trim(hexarotor)
    assert usual[3] == pytest.approx(0.02 * arm * weight, rel=0.05)
    assert usual[2] == pytest.approx(0.015 * weight)
    assert np.all(usual[:2] < usual[2])


def test_a_flight_that_differs_as_much_as_others_did_shows_no_torque(fly, hexarotor, plain):
    """A constant torque of one standard deviation is the flight's own; without that knowledge it is an effect's."""
    moved = replace(plain, measured=plain.measured + np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0]))
    knows = replace(hexarotor, between_flights=(0.0, 0.0, 0.0, 0.1, 0.1, 0.1))
    names = ["constant_wrench"]
    without, with_it = (fit(moved, m, names) for m in (hexarotor, knows))
    at = [p.name for _, p in without.parameters].index("torque_x")
    assert without.theta[at] == pytest.approx(0.1, rel=0.05)
    assert without.theta[at] > 10.0 * without.std[at]
    assert abs(with_it.theta[at]) < 2.0 * with_it.std[at]
    assert with_it.bias[0, 3] == pytest.approx(0.1 - with_it.theta[at], rel=0.1)


def test_a_torque_that_no_flight_had_is_still_an_effect(plain, hexarotor):
    moved = replace(plain, measured=plain.measured + np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]))
    found = fit(moved, replace(hexarotor, between_flights=(0.0, 0.0, 0.0, 0.01, 0.01, 0.01)), ["constant_wrench"])
    at = [p.name for _, p in found.parameters].index("torque_x")
    assert found.theta[at] > 0.9


def test_axes_without_scatter_have_no_trim_but_the_accelerometers_bias(hexarotor, plain):
    alone = trim_of(hexarotor)
    assert list(alone.axes) == [0, 1, 2]
    knows = trim_of(replace(hexarotor, between_flights=(0.0, 0.0, 0.5, 0.0, 0.1, 0.0)))
    assert list(knows.axes) == [0, 1, 2, 4]
    assert knows.scale[2] == pytest.approx(np.hypot(alone.scale[2], 0.5 / hexarotor.vehicle.body.mass))
    assert knows.columns(plain).shape == (len(plain.measured), 6, 4)


def test_the_model_file_keeps_it():
    model = replace(model_file.load("tilt_hexarotor"), between_flights=(0.1, 0.2, 0.3, 0.01, 0.02, 0.03))
    again = loads(dumps(model))
    assert again.between_flights == model.between_flights
    assert loads(dumps(replace(again, between_flights=None))).between_flights is None


def test_a_constant_that_flights_share_beyond_their_scatter_is_told(fly, hexarotor):
    """Four flights with 1.5 standard deviations each: their mean is three of its own from none. One flight's is not."""
    usual = 0.1
    knows = replace(hexarotor, between_flights=(0.1, 0.1, 0.1, usual, usual, usual))
    for count, share, told in ((4, 1.5, True), (4, 0.5, False), (1, 1.5, False)):
        data = several(fly, hexarotor, count)
        left = noise(data)
        left[:, 4] += share * usual
        found = granted_trims(data, left, left, knows)
        assert [one.axis for one in found] == ([4] if told else [])
        assert not granted_trims(data, left, left, hexarotor)  # that model grants no torque
        assert not granted_trims(data, left, noise(data), knows)  # it came with the fit
    more = left + np.array([0.0, 0.0, 0.0, 0.0, 2.0 * usual, 0.0])
    (one,) = granted_trims(data, more, more, knows)
    assert (one.mean, one.ratio) == pytest.approx((3.5 * usual, 3.5), rel=0.02)


def test_what_a_constant_wrench_has_of_a_trim_within_chance_is_counted_with_it():
    """0.5 +- 0.3 Nm of a yaw that is granted as well; 4 +- 0.5 N are the effect's own."""
    values = [Value("force_x", 4.0, 0.5, "N"), Value("torque_z", 0.5, 0.3, "Nm")]
    np.testing.assert_array_equal(unclear_constant(values), [0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    np.testing.assert_array_equal(unclear_constant([]), np.zeros(6))


def test_a_yaw_bias_beyond_unsure_thrust_axes_is_told_by_explain():
    """0.6 mNm, where axes that are off by a degree each make 0.13: every fit grants it, and it is there."""
    model = wg.load_model("crazyflie")
    flown = wg.simulate(model, "multi_axis", duration=12, excitation=0.5, hide=["constant_wrench=torque_z:0.0006"])
    found = wg.explain(wg.open_flights([flown], model), model, names=("com_offset", "motor_lag"), injections=0)
    (one,) = found.granted
    assert (one.axis, one.mean) == (5, pytest.approx(6e-4, rel=0.1))
