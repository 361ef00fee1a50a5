"""The hidden effect is named, on flights of the independent engine."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.learn.identify.candidates import candidates
from wrenchgap.learn.identify.explain import search_dataset

TIMING = {"servo_lag", "command_delay", "motor_lag"}
ALWAYS = TIMING | {"arm_reaction"}  # the engine: servos lag 15 ms, and its arms have inertia


def explain(data, model, names=()):
    """What is missing on a data set, without the flights that it was made of."""
    return search_dataset(data, model, candidates(data.records, model, names))


@pytest.mark.parametrize(
    ("hidden", "named"),
    [
        ("servo_lag", "servo_lag"),
        ("tilt_offset", "tilt_offset"),
    ],
)
def test_names_the_hidden_effect_first(fly, hexarotor, hidden, named):
    """The others are in tests/independent/test_hidden_effects.py."""
    data, _ = fly(hidden, None, "train", seed=21, seconds=25)
    found = explain(data, hexarotor)
    assert found.effects[0] == named
    assert found.verdict == "effect"
    assert set(found.effects[1:]) <= ALWAYS


def test_exact_aliases_are_one_group(fly, hexarotor):
    """At equal speeds within a pair a coaxial loss and a thrust scale are the same thing."""
    data, _ = fly("coaxial_loss", None, "train", seed=22, seconds=25)
    found = explain(data, hexarotor)
    assert found.verdict == "group"
    assert {"coaxial_loss", "thrust_scale"} <= set(found.groups[0])


def test_only_timing_is_missing_on_the_plain_vehicle(fly, hexarotor):
    data, _ = fly("none", None, "train", seed=23, seconds=25)
    found = explain(data, hexarotor)
    assert set(found.effects) <= ALWAYS
    assert found.effects[0] in TIMING


def test_nothing_is_missing_from_noise(fly, hexarotor):
    """A measurement that is the prediction plus sensor noise: nothing to name."""
    data, _ = fly("none", None, "train", seed=23, seconds=25)
    rng = np.random.default_rng(0)
    said = data.predict(hexarotor.wrench_model)
    clean = replace(data, measured=said + data.noise * rng.normal(size=said.shape))
    found = explain(clean, hexarotor)
    assert found.verdict == "nothing"
    assert found.effects == ()


def test_what_no_effect_explains_is_unknown(fly, hexarotor):
    """A torque that rings at 3 Hz whatever is commanded is in no catalogue."""
    data, _ = fly("none", None, "train", seed=23, seconds=25)
    said = data.predict(hexarotor.wrench_model)
    time = np.concatenate([r.time for r in data.records])
    ringing = said.copy()
    ringing[:, 3] += 0.2 * np.sin(2 * np.pi * 3.0 * time)
    ringing[:, 4] += 0.2 * np.cos(2 * np.pi * 3.1 * time)
    found = explain(replace(data, measured=ringing), hexarotor)
    assert found.verdict == "unknown"


def test_many_flights_are_searched_in_part_and_fitted_in_full(fly, hexarotor):
    """Ten flights, more than the search looks at: the answer is that of one, and every flight gets its own bias."""
    from wrenchgap.learn.data.dataset import dataset
    from wrenchgap.learn.identify.explain import SEARCH_SECONDS

    one, _ = fly("com_offset", None, "train", seed=21, seconds=25)
    records = [replace(r, flight=f"flight {k}") for k in range(10) for r in one.records]
    assert SEARCH_SECONDS < 10 * 25
    found = explain(dataset(records, hexarotor), hexarotor, names=["com_offset", "servo_lag", "thrust_scale"])
    assert found.effects == ("com_offset", "servo_lag")
    assert found.fit.bias.shape == (10, 3)
    assert len(found.fit.residual) == 10 * len(one.measured)


# ---------------------------------------------------------------- what has no name, and what is left

SOME = ("com_offset", "payload", "mass", "thrust_scale", "tether", "constant_wrench", "servo_lag", "arm_reaction")


def test_a_load_on_a_rope_is_named_in_part_and_seen_to_swing(fly, hexarotor):
    """Its weight is a payload's. The rest swings at sqrt(g / l), or a little faster for the hull being free."""
    data, truth = fly("slung_load", None, "train", seed=921, seconds=25)
    load = truth.parameters["slung_load"]
    found = explain(data, hexarotor, names=SOME)
    assert found.verdict == "unknown"
    assert found.effects[0] == "payload"
    carried = found.fit.theta[[n == "payload" for n, _ in found.fit.parameters]]
    assert carried[0] == pytest.approx(load["mass"], rel=0.05)
    assert carried[3] == pytest.approx(-0.05, abs=0.005)  # it pulls at the joint, wherever the mass hangs
    assert found.oscillation is not None
    assert found.oscillation.frame == "E"
    held = np.sqrt(9.81 / load["length"]) / (2 * np.pi)
    free = held * np.sqrt(1 + load["mass"] / hexarotor.vehicle.body.mass)
    assert 0.97 * held < found.oscillation.frequency_hz < 1.03 * free


def test_a_rigid_payload_does_not_swing(fly, hexarotor):
    data, _ = fly("payload", None, "train", seed=3, seconds=20)
    found = explain(data, hexarotor, names=SOME)
    assert found.verdict == "effect"
    assert found.effects[0] == "payload"
    assert found.oscillation is None
    assert found.depends is None
    assert found.left < 1.5


def test_a_magnet_in_a_field_is_unknown_and_depends_on_heading(fly, hexarotor):
    data, _ = fly("compass", None, "turn", seed=31, seconds=30)
    found = explain(data, hexarotor, names=SOME)
    assert found.verdict == "unknown"
    assert set(found.effects) <= ALWAYS
    assert found.oscillation is None
    assert found.depends.chosen[0].name == "heading"
    assert found.depends.explained > 0.7
    assert found.left > 10


def pushed(data, when):
    """A hand on one arm at these samples: up to 0.4 Nm, a hundred times the noise."""
    push = np.array([0.5, -0.3, 0.2, 0.2, -0.4, 0.3]) * when[:, None]
    return replace(data, measured=data.measured + push)


def test_one_bad_stretch_is_no_missing_physics(fly, hexarotor):
    """Two seconds of 25. The same hand in every other block is something that is missing."""
    data, truth = fly("com_offset", None, "train", seed=21, seconds=25)
    time = np.concatenate([r.time for r in data.records])
    once = explain(pushed(data, (time > 10) & (time < 12)), hexarotor, names=SOME)
    assert once.verdict == "effect"
    assert once.effects[0] == "com_offset"
    assert once.concentrated > 0.8
    expected = [truth.parameters["com_offset"][a] for a in "xyz"]
    np.testing.assert_allclose(once.fit.theta[:3], expected, atol=2e-3)
    again = explain(pushed(data, data.block % 4 < 2), hexarotor, names=SOME)
    assert again.verdict == "unknown"
    assert again.concentrated < 0.5


def test_what_is_left_is_counted_in_the_noise(fly, hexarotor):
    """Noise alone is one; doubled it is two, and spread over all of the time."""
    data, _ = fly("none", None, "train", seed=23, seconds=25)
    said = data.predict(hexarotor.wrench_model)
    noise = data.noise * np.random.default_rng(5).normal(size=said.shape)
    for size in (1.0, 2.0):
        found = explain(replace(data, measured=said + size * noise), hexarotor, names=("com_offset", "mass"))
        assert found.verdict == "nothing"
        assert found.left == pytest.approx(size, rel=0.05)
        assert found.concentrated < 0.3
        np.testing.assert_allclose(found.rms_before, size * data.noise, rtol=0.1)
