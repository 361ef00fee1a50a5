"""Replay and compare of simulated flights give what they gave; else the first divergence is named."""

import copy

import pytest

from scripts import golden_replays as golden


@pytest.mark.parametrize("name", sorted(golden.CASES))
def test_golden_results(name):
    found = golden.divergence(name, golden.load(name), golden.results(name))
    assert found is None, str(found)


def test_the_first_divergence_is_named_with_both_values():
    kept = golden.load("quadrotor")
    assert golden.divergence("quadrotor", kept, copy.deepcopy(kept)) is None
    now = copy.deepcopy(kept)
    times, values = now["replay"]["time"], now["replay"]["series"]
    values["correction.torque_y"][7] += 0.01
    values["measured.torque_x"][5] = 12.5
    now["compare"][0]["rms"][2] *= 2.0
    found = golden.divergence("quadrotor", kept, now)
    assert (found.quantity, found.now) == ("replay.measured.torque_x", 12.5)
    assert (found.sample, found.time) == (5 * kept["replay"]["every"], times[5])
    assert found.golden == kept["replay"]["series"]["measured.torque_x"][5]
    for words in ("first divergence", "measured.torque_x", f"sample {found.sample}", "12.5", "make golden"):
        assert words in str(found)


def test_numbers_that_differ_by_their_last_digits_are_the_same_and_others_are_not():
    kept = golden.load("hexarotor")
    now = copy.deepcopy(kept)
    now["compare"][0]["rms"][3] *= 1.0 + 1e-8
    assert golden.divergence("hexarotor", kept, now) is None
    now["compare"][0]["rms"][3] *= 1.0 + 1e-5
    found = golden.divergence("hexarotor", kept, now)
    assert (found.quantity, found.sample) == ("compare[0].rms[3]", None)
    gone = copy.deepcopy(kept)
    del gone["replay"]["series"]["beta"]
    assert golden.divergence("hexarotor", kept, gone).now == "missing"
