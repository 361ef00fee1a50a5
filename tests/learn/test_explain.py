"""The hidden effect is named, on flights of the independent engine."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.learn.data.candidates import candidates
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.posterior.explain import SEARCH_SECONDS, search_dataset
from wrenchgap.learn.posterior.settings import DEFAULT
from wrenchgap.plant.effects import family

TIMING = {"servo_lag", "command_delay", "motor_lag"}
SOME = ("com_offset", "payload", "mass", "thrust_scale", "tether", "constant_wrench", "servo_lag", "arm_reaction")
ALWAYS = TIMING | {"arm_reaction"}  # the engine: servos lag 15 ms, and its arms have inertia


def explain(data, model, names=()):
    """What is missing on a data set, without the flights that it was made of."""
    return search_dataset(data, model, candidates(data.records, model, names), limits_of=())


@pytest.mark.parametrize(
    ("hidden", "names"),
    [("servo_lag", SOME), *(pytest.param(name, (), marks=pytest.mark.slow) for name in ("servo_lag", "tilt_offset"))],
)
def test_names_the_hidden_effect_first(fly, hexarotor, hidden, names):
    """The others are in tests/independent/test_hidden_effects.py."""
    found = explain(fly(hidden, None, "train", seed=21, seconds=25)[0], hexarotor, names)
    assert found.effects[0] == hidden
    assert found.verdict == "effect"
    assert set(found.effects[1:]) <= ALWAYS


@pytest.mark.slow
def test_exact_aliases_are_one_group(fly, hexarotor):
    """At equal speeds within a pair a coaxial loss and a thrust scale are the same thing."""
    data, _ = fly("coaxial_loss", None, "train", seed=22, seconds=25)
    found = explain(data, hexarotor)
    assert found.verdict == "group"
    assert {"coaxial_loss", "thrust_scale"} <= {family(n) for n in found.groups[0]}  # in either form of the loss


@pytest.mark.slow
def test_only_timing_is_missing_on_the_plain_vehicle(plain, hexarotor):
    found = explain(plain, hexarotor)
    assert set(found.effects) <= ALWAYS
    assert found.effects[0] in TIMING


@pytest.mark.parametrize("names", [SOME, pytest.param((), marks=pytest.mark.slow)], ids=["some", "all"])
def test_what_no_effect_explains_is_unknown(plain, hexarotor, names):
    """A torque that rings at 3 Hz whatever is commanded is in no catalogue."""
    ringing = plain.predict(hexarotor.wrench_model)
    time = np.concatenate([r.time for r in plain.records])
    ringing[:, 3] += 0.2 * np.sin(2 * np.pi * 3.0 * time)
    ringing[:, 4] += 0.2 * np.cos(2 * np.pi * 3.1 * time)
    assert explain(replace(plain, measured=ringing), hexarotor, names).verdict == "unknown"


@pytest.mark.slow
def test_a_name_is_no_explanation_while_a_band_is_open(offset, hexarotor):
    """A force that beats at 1 Hz, by less than the sensors' noise, whatever is commanded: the centre of mass is as
    firm as before, but not all there is.
    """
    data, names = offset.data, SOME
    time = np.concatenate([r.time for r in data.records])
    beating = data.measured.copy()
    beating[:, 1] += 0.8 * np.sqrt(2.0) * data.noise[1] * np.sin(2 * np.pi * 0.95 * time)
    before, after = (explain(d, hexarotor, names) for d in (data, replace(data, measured=beating)))
    assert (before.verdict, before.bands) == ("effect", ())
    assert after.verdict == "unknown"
    assert [(b.axis, b.low_hz, b.high_hz) for b in after.bands] == [(1, 0.7, 1.2)]
    assert after.open.tolist() == [False, True, False, False, False, False]
    assert after.effects == before.effects
    assert "com_offset" in after.firm


def test_many_flights_are_searched_in_part_and_fitted_in_full(offset, hexarotor):
    """Ten flights, more than the search looks at: the answer is that of one, and every flight gets its own bias."""
    records = [replace(r, flight=f"flight {k}") for k in range(10) for r in offset.data.records]
    assert SEARCH_SECONDS < 10 * 25
    found = explain(dataset(records, hexarotor), hexarotor, names=["com_offset", "servo_lag", "thrust_scale"])
    assert found.effects == ("com_offset", "servo_lag")
    assert found.fit.bias.shape == (10, 3)
    assert len(found.fit.residual) == 10 * len(offset.data.measured)


def test_a_load_on_a_rope_is_named_in_part_and_seen_to_swing(fly, hexarotor):
    """Its weight is a payload's, or a mass at a place. The rest swings at sqrt(g / l), or a little faster for the hull
    being free.
    """
    data, truth = fly("slung_load", None, "train", seed=921, seconds=25)
    load = truth.parameters["slung_load"]
    found = explain(data, hexarotor, names=SOME)
    assert found.verdict == "unknown"
    sets = {frozenset(s.names) - ALWAYS: s.values(hexarotor.vehicle) for s in found.classes[0].sets}
    assert sets.keys() >= {frozenset({"mass", "com_offset"})}
    shifted = sets[frozenset({"mass", "com_offset"})]
    assert shifted["mass"]["added"] == pytest.approx(load["mass"], rel=0.05)
    moment = (hexarotor.vehicle.body.mass + load["mass"]) * shifted["com_offset"]["z"]
    assert moment == pytest.approx(-0.05 * load["mass"], rel=0.1)  # it pulls at the joint, wherever the mass hangs
    assert found.oscillation.frame == "E"
    held = np.sqrt(9.81 / load["length"]) / (2 * np.pi)
    free = held * np.sqrt(1 + load["mass"] / hexarotor.vehicle.body.mass)
    assert 0.97 * held < found.oscillation.frequency_hz < 1.03 * free


def test_a_rigid_payload_does_not_swing(payload, hexarotor):
    found = explain(payload.data, hexarotor, names=SOME)
    assert found.verdict == "effect"
    assert found.effects[0] == "payload"
    assert found.oscillation is None
    assert found.depends is None
    assert found.left < 1.5


@pytest.mark.slow
def test_a_magnet_in_a_field_is_unknown_and_depends_on_heading(fly, hexarotor):
    data, _ = fly("compass", None, "turn", seed=31, seconds=30)
    found = explain(data, hexarotor, names=SOME)
    assert found.verdict == "unknown"
    assert set(found.firm) <= ALWAYS
    assert found.oscillation is None
    assert found.depends.chosen[0].name == "heading"
    assert found.depends.explained > 0.7
    assert found.left > 3 * DEFAULT.structure  # a rope takes some of it in its place, with no confidence


@pytest.mark.slow
def test_one_bad_stretch_is_no_missing_physics(offset, hexarotor):
    """A hand on one arm, of a hundred times the noise, for 2 s of 25. In every other block something is missing."""

    def pushed(when):
        push = np.array([0.5, -0.3, 0.2, 0.2, -0.4, 0.3]) * when[:, None]
        return explain(replace(offset.data, measured=offset.data.measured + push), hexarotor, names=SOME)

    time = np.concatenate([r.time for r in offset.data.records])
    once, again = pushed((time > 10) & (time < 12)), pushed(offset.data.block % 4 < 2)
    assert (once.verdict, once.effects[0]) == ("effect", "com_offset")
    assert once.concentrated > 0.8
    shifted = [v.value for v in once.fit.values("com_offset")]
    np.testing.assert_allclose(shifted, offset.values, atol=2e-3)
    assert again.verdict == "unknown"
    assert again.concentrated < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("size", [1.0, 2.0])
def test_nothing_is_missing_from_noise_in_which_what_is_left_is_counted(plain, hexarotor, size):
    """Noise alone is one; doubled it is two, and spread over all of the time."""
    said = plain.predict(hexarotor.wrench_model)
    noise = plain.noise * np.random.default_rng(5).normal(size=said.shape)
    found = explain(replace(plain, measured=said + size * noise), hexarotor)
    assert found.verdict == "nothing"
    assert found.effects == ()
    assert found.left == pytest.approx(size, rel=0.05)
    assert found.concentrated < 0.3
    np.testing.assert_allclose(found.rms_before, size * plain.noise, rtol=0.1)
