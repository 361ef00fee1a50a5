"""The hidden effect is named, on flights of the independent engine."""

import numpy as np
import pytest

from learn.explain import explain

TIMING = {"servo_lag", "command_delay", "motor_lag"}
ALWAYS = TIMING | {"arm_reaction"}  # the engine: servos lag 15 ms, and its arms have inertia


@pytest.mark.parametrize(
    ("hidden", "named"),
    [
        ("com_offset", "com_offset"),
        ("weak_rotor", "rotor_thrust"),
        ("wake", "rotor_interference"),
        ("servo_lag", "servo_lag"),
        ("tilt_offset", "tilt_offset"),
    ],
)
def test_names_the_hidden_effect_first(fly, hexarotor, hidden, named):
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
    from dataclasses import replace

    data, _ = fly("none", None, "train", seed=23, seconds=25)
    rng = np.random.default_rng(0)
    said = data.predict(hexarotor.wrench_model)
    clean = replace(data, measured=said + data.noise * rng.normal(size=said.shape))
    found = explain(clean, hexarotor)
    assert found.verdict == "nothing"
    assert found.effects == ()


def test_what_no_effect_explains_is_unknown(fly, hexarotor):
    """A torque that rings at 3 Hz whatever is commanded is in no catalogue."""
    from dataclasses import replace

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
    from dataclasses import replace

    from learn.explain import SEARCH_SECONDS
    from learn.fit import dataset

    one, _ = fly("com_offset", None, "train", seed=21, seconds=25)
    records = [replace(r, flight=f"flight {k}") for k in range(10) for r in one.records]
    assert SEARCH_SECONDS < 10 * 25
    found = explain(dataset(records, hexarotor), hexarotor, names=["com_offset", "servo_lag", "thrust_scale"])
    assert found.effects == ("com_offset", "servo_lag")
    assert found.fit.bias.shape == (10, 3)
    assert len(found.fit.residual) == 10 * len(one.measured)
