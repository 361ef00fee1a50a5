"""Where a set of effects leaves nothing but the sensors' noise, there was no disturbance that commands could answer.

Flights of the independent engine, declared to have commands that answer on four axes: a lag is a linear response to the
commands, and so no evidence as long as a disturbance may have made it.
"""

import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchgap.learn.data.candidates import Candidates
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.input_errors import EDGES
from wrenchgap.learn.posterior.disturbance_free import disturbance_free, may_be_disturbance_free, without_feedback
from wrenchgap.learn.posterior.explain import search_dataset
from wrenchgap.learn.posterior.relinearisation import spectrum_of
from wrenchgap.learn.posterior.single_effects import model_residual, single_effects

ANSWERING = (2, 3, 4, 5)
NAMES = ("servo_lag", "command_delay", "arm_reaction", "mass", "thrust_scale")


@pytest.fixture(scope="module")
def late(fly):
    """Commands of the arms and rotors come late; what else the engine has is small beside it."""
    return fly(["command_delay"], None, "train", seconds=15, seed=921)[0]


def blown_about(data, model):
    """The same under a force and torque that no command goes with: a random walk, several times what is missing."""
    rng = np.random.default_rng(5)
    records = []
    for r in data.records:
        walk = np.cumsum(rng.normal(size=r.measured.shape), axis=0)
        walk -= walk.mean(axis=0)
        gust = walk / walk.std(axis=0) * 3.0 * np.std(r.measured - r.commanded, axis=0)
        records.append(replace(r, measured=r.measured + gust))
    return dataset(records, model, data.answering)


def test_a_lag_is_evidence_where_nothing_but_noise_is_left(late, hexarotor):
    found = search_dataset(replace(late, answering=ANSWERING), hexarotor, Candidates(NAMES, ()), limits_of=())
    plain = search_dataset(late, hexarotor, Candidates(NAMES, ()), limits_of=())
    assert "command_delay" in plain.effects
    assert found.effects == plain.effects
    assert found.firm == plain.firm
    np.testing.assert_array_equal(found.fit.theta, plain.fit.theta)


def test_bands_in_which_commands_say_nothing_are_no_disturbance(late, hexarotor):
    """What no set may explain there is no reason to doubt one that explains the rest."""
    error = np.zeros((len(EDGES) + 1, 6))
    error[7:, 3:] = 1.0
    silent = replace(late, records=tuple(replace(r, input_error=error) for r in late.records), answering=ANSWERING)
    assert search_dataset(silent, hexarotor, Candidates(NAMES, ()), limits_of=()).answering == ()


def test_fits_that_begin_where_others_did_are_the_same(late, hexarotor):
    """The derivatives where a fit begins do not depend on what answers: a second table takes those of the first."""
    on = model_residual(replace(late, answering=ANSWERING), hexarotor)
    free = without_feedback(on)
    alone = single_effects(free, NAMES)
    first = single_effects(on, NAMES, twice=True)
    assert set(on.data.starts) == {(name,) for name in NAMES}
    again = single_effects(free, NAMES, twice=True)
    assert not on.data.starts
    for one, other in zip(alone.candidates, again.candidates, strict=True):
        np.testing.assert_array_equal(one.fit.theta, other.fit.theta)
        np.testing.assert_array_equal(one.residual, other.residual)
    assert any(
        not np.array_equal(a.residual, b.residual) for a, b in zip(first.candidates, alone.candidates, strict=True)
    )


def test_unanswering_data_share_what_was_worked_out(late):
    data = replace(late, answering=ANSWERING)
    free = data.unanswering()
    assert free.answering == ()
    assert free.evaluators is data.evaluators
    assert free.root is data
    copied = pickle.loads(pickle.dumps((data, free)))
    assert copied[1].root is copied[0]  # one copy of the records, not two
    np.testing.assert_array_equal(copied[1].measured, late.measured)


def test_it_is_none_where_something_else_is_left(late, hexarotor):
    data = blown_about(replace(late, answering=ANSWERING), hexarotor)
    on = model_residual(data, hexarotor)
    assert not may_be_disturbance_free(on, without_feedback(on), single_effects(on, NAMES).columns)


def test_straight_lines_may_leave_seven_times_as_much(late, hexarotor):
    """Of the rms: 6 % of a large nominal residual in a band is a disturbance, and worth another look; 40 % is not."""
    large = [replace(r, measured=r.commanded + 100.0 * (r.measured - r.commanded)) for r in late.records]
    on = model_residual(dataset(large, hexarotor, ANSWERING), hexarotor)
    free = without_feedback(on)
    given = spectrum_of(free, ()).products[:, :, 0, 0]

    def free_with(share, **nearly):
        return disturbance_free(on, free, [SimpleNamespace(left=share**2 * given)], **nearly)

    assert free_with(0.04)
    assert not free_with(0.06)
    assert free_with(0.06, nearly=True)
    assert free_with(0.34, nearly=True)
    assert not free_with(0.4, nearly=True)
