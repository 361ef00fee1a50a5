"""Work on all cores gives what work on one gives."""

import os

import numpy as np
import pytest

from wrenchgap.learn.identify.explain import explain
from wrenchgap.learn.parallel import cores, each


def test_answers_come_in_the_order_of_the_questions():
    items = [f"{k}" for k in range(20)]
    assert list(each(lambda text: 2 * text, items, 3)) == list(each(lambda text: 2 * text, items, 1))
    assert list(each(str.upper, [], 3)) == []


@pytest.mark.skipif(cores() < 2, reason="one core")
def test_other_processes_do_the_work():
    parent = os.getpid()
    assert parent not in set(each(lambda _: os.getpid(), ["a", "b", "c"], 2))
    assert set(each(lambda _: os.getpid(), ["a", "b", "c"], 1)) == {parent}


def test_an_error_in_the_work_is_the_callers():
    def fail(text):
        raise ValueError(text)

    for jobs in (1, 2):
        with pytest.raises(ValueError, match="why"):
            list(each(fail, ["why", "not"], jobs))
    assert list(each(str.upper, ["a", "b"], 2)) == ["A", "B"]


def test_explain_finds_the_same_on_two_cores(fly, hexarotor):
    data, _ = fly("com_offset", None, "train", seed=21, seconds=25)
    names = ("com_offset", "mass", "servo_lag", "command_delay", "tether")
    one, two = (explain(data, hexarotor, names=names, jobs=jobs) for jobs in (1, 2))
    assert one.effects == two.effects
    np.testing.assert_array_equal(one.fit.theta, two.fit.theta)
    np.testing.assert_array_equal(one.rms_after, two.rms_after)
    for a, b in zip(one.members, two.members, strict=True):
        assert (a.share, a.significance) == (b.share, b.significance)
        assert [(r.name, r.separation, r.cosine) for r in a.rivals] == [
            (r.name, r.separation, r.cosine) for r in b.rivals
        ]
