"""Separability against closed forms, Monte Carlo, and a screening that is written differently."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from wrenchgap.learn.data.blocks import contrast
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.design.manoeuvres import Limits
from wrenchgap.learn.design.screening import Screen, rehearse
from wrenchgap.learn.design.separability import expected_separation, separability, sized, typical
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.trajectory.maneuvers import Moves, Shake, Tilt, Turn

HOME = (0.0, 0.0, 1.5)
LIMITS = Limits((5.0, 5.0, 3.0))
HOVER = Moves(10.0, HOME)
TURN = Moves(10.0, HOME, (Turn(0.0, 10.0, 2 * np.pi),))
TILT = Moves(10.0, HOME, (Tilt(0.0, 10.0, np.radians(50.0), 0.0, 2.0, 2 * np.pi),))


@pytest.fixture(scope="module")
def record(hexarotor):
    return cache(lambda flight: rehearse(flight, hexarotor, LIMITS)[0])


def between(found, truth, imitator):
    return next(d for d in found.directions if (d.truth, d.imitator) == (truth, imitator))


def test_a_force_in_E_and_one_in_B_are_the_same_thing_at_one_heading(hexarotor, record):
    tether = make_effect(hexarotor.vehicle, "tether", {"force_x": 0.8})
    found = [separability(record(f), hexarotor, tether, "constant_wrench", also=()) for f in (HOVER, TURN)]
    hover, turn = (between(f, "tether", "constant_wrench") for f in found)
    assert hover.cosine == pytest.approx(1.0, abs=1e-6)
    assert not found[0].separable
    # Seen from B the force goes round: of (cos, -sin) over a full turn a constant takes next to nothing. (The quintic
    # turn rests at both ends, where a constant can help: it leaves 1 - |mean|^2 of the energy.)
    s = np.linspace(0.0375, 0.9625, 4001)  # without what the filter trims
    mean = np.exp(2j * np.pi * s**3 * (10 - 15 * s + 6 * s**2)).mean()
    assert turn.share == pytest.approx(np.sqrt(1.0 - abs(mean) ** 2), abs=0.02)
    assert turn.told


def test_what_an_accelerometer_s_bias_can_do_tells_nothing(hexarotor, record):
    """A constant force of 0.04 m/s^2 times the mass is within the bias that every fit may use."""
    small = make_effect(hexarotor.vehicle, "constant_wrench", {"force_x": 0.04 * 4.0})
    found = separability(record(TILT), hexarotor, small, "com_offset", also=())
    assert between(found, "constant_wrench", "com_offset").share < 0.02


@pytest.mark.parametrize("pair", [("mass", "thrust_scale"), ("coaxial_loss", "thrust_scale")])
@pytest.mark.parametrize("flight", [TILT, Moves(10.0, HOME, (Shake(0.0, 10.0, 0.05, 0.1, 0.2, 2.0),))])
def test_exact_aliases_stay_aliases_on_any_flight(hexarotor, record, pair, flight):
    found = separability(record(flight), hexarotor, *pair)
    assert not found.separable
    assert found.share < 0.01


def test_an_effect_that_does_not_act_is_not_told(hexarotor, record):
    found = separability(record(HOVER), hexarotor, "servo_lag", "command_delay")
    assert found.separation == 0.0
    assert np.isnan(found.directions[0].cosine)


def test_a_richer_imitator_does_not_count(hexarotor, record):
    found = separability(record(TILT), hexarotor, "com_offset", "rotor_thrust")
    assert not between(found, "com_offset", "rotor_thrust").counts
    assert between(found, "rotor_thrust", "com_offset").counts


@pytest.mark.parametrize("size", [0.3, 1.0])
@pytest.mark.parametrize("uneven", [False, True])
def test_expected_separation_is_what_noise_gives_on_average(hexarotor, record, size, uneven):
    data = replace(dataset([record(HOVER)], hexarotor), independence=1.0)  # samples of this noise are independent
    shape = np.where(data.block % 2 == 0, 1.4, 0.2) if uneven else np.ones(len(data.block))
    left = size * shape[:, None] * data.noise * [1.0, 0.0, 0.0, 0.5, 0.0, 0.0]
    drawn = data.noise * np.random.default_rng(1).standard_normal((60, *left.shape))
    typical_t = np.median([contrast(data, noise + left, noise).t for noise in drawn])
    assert expected_separation(data, left, data.noise) == pytest.approx(typical_t, rel=0.25)


def test_errors_of_the_model_lower_the_expected_separation(hexarotor, record):
    data = dataset([record(HOVER)], hexarotor)
    left = np.tile(2.0 * data.noise, (len(data.block), 1))
    alone = expected_separation(data, left, data.noise)
    # Of an axis' variance 91 % is error of the model, a quarter of which counts; the difference is 4 variances.
    both = 1.0 / np.hypot(1.0 / alone, 0.25 * 0.91 / 4.0)
    assert expected_separation(data, left, 0.3 * data.noise) == pytest.approx(both)


def test_screening_agrees_with_fits_for_effects_that_are_linear(hexarotor, record):
    records = [record(TILT), record(TURN)]
    effects = [typical(name, hexarotor) for name in ("com_offset", "constant_wrench", "thrust_scale")]
    screen = Screen(hexarotor, effects, (), None)
    quick = screen.judge([screen.piece(r) for r in records])
    slow = separability(records, hexarotor, *effects, also=())
    for a, b in zip(quick.directions, slow.directions, strict=True):
        assert (a.truth, a.imitator) == (b.truth, b.imitator)
        assert a.share == pytest.approx(b.share, rel=0.1, abs=0.01)


def test_sizes_come_from_the_model_then_the_log_then_are_typical(hexarotor, record):
    own = make_effect(hexarotor.vehicle, "mass", [0.2])
    assert sized("mass", hexarotor.with_effects([own])) is own
    data = dataset([record(TILT)], hexarotor)
    hidden = make_effect(hexarotor.vehicle, "com_offset", [0.004, -0.003, 0.002])
    seen = replace(data, measured=data.predict(hexarotor.with_effects([hidden]).wrench_model))
    np.testing.assert_allclose(sized("com_offset", hexarotor, seen).theta, hidden.theta, atol=2e-5)
    np.testing.assert_allclose(sized("com_offset", hexarotor).theta, [0.006, -0.006, 0.006])
    nothing = replace(data, measured=data.predict(hexarotor.wrench_model))
    np.testing.assert_allclose(sized("com_offset", hexarotor, nothing).theta, [0.006, -0.006, 0.006])
