"""Where a set of effects leaves nothing but the sensors' noise, there was no disturbance that commands could answer.

Flights of the independent engine, declared to have commands that answer on four axes: a lag is a linear response to the
commands, and so no evidence as long as a disturbance may have made it.
"""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.identify.candidates import Candidates
from wrenchgap.learn.posterior.explain import search_dataset
from wrenchgap.learn.posterior.table import ground, table
from wrenchgap.learn.posterior.undisturbed import may_be_undisturbed, unanswering

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
    found = search_dataset(replace(late, answering=ANSWERING), hexarotor, Candidates(NAMES, ()))
    plain = search_dataset(late, hexarotor, Candidates(NAMES, ()))
    assert "command_delay" in plain.effects
    assert found.effects == plain.effects
    assert found.firm == plain.firm
    np.testing.assert_array_equal(found.fit.theta, plain.fit.theta)


def test_it_is_none_where_something_else_is_left(late, hexarotor):
    data = blown_about(replace(late, answering=ANSWERING), hexarotor)
    on = ground(data, hexarotor)
    assert not may_be_undisturbed(on, unanswering(on), table(on, NAMES).columns)
