"""Loops of stages: a closed form, what is due when, and how compiled and called stages share their signals."""

import numpy as np
import pytest

from wrenchgap.plant.simulation.loop import ALWAYS, Loop, Stage
from wrenchgap.plant.trace.arrays import Untraceable

NOTHING = np.zeros((100, 0))


def counting(steps, stages, **signals):
    first = {"x": np.zeros(1), "seen": np.zeros(1), "stop": np.zeros(1)} | signals
    return Loop(first, stages, steps, "stop")


@pytest.mark.parametrize("numpy_steps", [0, 3, ALWAYS])
def test_a_rotation_of_one_step_gives_the_circle(numpy_steps):
    """x_n = R(a)^n x_0, whether the stage is compiled, called, or first called and then compiled."""
    c, s = np.cos(0.1), np.sin(0.1)
    turn = Stage(
        "turn",
        lambda now, row: {"x": np.array([[c, -s], [s, c]]) @ now["x"]},
        NOTHING,
        log=("x",),
        numpy_steps=numpy_steps,
    )
    loop = Loop({"x": np.array([1.0, 0.0]), "stop": np.zeros(1)}, [turn], 50, "stop")
    assert loop.run() == (50, False)
    angle = 0.1 * np.arange(1, 51)
    np.testing.assert_allclose(
        loop.logged("turn", "x", 50), np.column_stack((np.cos(angle), np.sin(angle))), atol=1e-13
    )
    np.testing.assert_allclose(loop.now("x"), [np.cos(5.0), np.sin(5.0)], atol=1e-13)


@pytest.mark.parametrize("numpy_steps", [0, ALWAYS])
def test_stages_act_in_their_order_with_the_row_of_their_own_time(numpy_steps):
    """Added at every step; every third step another stage sees what the first has made of it by then."""
    given = np.arange(1.0, 11.0)[:, None]
    add = Stage("add", lambda now, row: {"x": now["x"] + row}, given, numpy_steps=numpy_steps)
    look = Stage(
        "look", lambda now, row: {"seen": now["x"] * row}, np.array([[1.0], [10.0], [100.0], [1.0]]), 3, ("seen",)
    )
    loop = counting(10, [add, look])
    loop.run()
    np.testing.assert_allclose(loop.logged("look", "seen", 4)[:, 0], [1.0, 10.0 * 10.0, 28.0 * 100.0, 55.0])


@pytest.mark.parametrize("numpy_steps", [0, ALWAYS])
def test_a_stage_stops_the_loop_before_the_next_one_acts(numpy_steps):
    count = Stage(
        "count",
        lambda now, row: {"x": now["x"] + 1.0, "stop": 1.0 * (now["x"] > 6.5)},
        NOTHING,
        numpy_steps=numpy_steps,
    )
    after = Stage("after", lambda now, row: {"seen": now["x"]}, NOTHING, log=("seen",))
    loop = counting(100, [count, after])
    assert loop.run() == (7, True)
    np.testing.assert_allclose(loop.logged("after", "seen", 7)[:, 0], np.arange(1.0, 8.0))
    assert loop.now("seen") == 7.0


def test_only_a_stage_with_user_code_that_decides_by_a_value_is_called_in_numpy_and_says_why():
    def deciding(now, row):
        return {"x": now["x"] + 1.0 if now["x"][0] < 3.0 else now["x"]}

    with pytest.raises(Untraceable):
        counting(10, [Stage("odd", deciding, NOTHING)])
    loop = counting(10, [Stage("odd", deciding, NOTHING, user_code=True)])
    loop.run()
    assert loop.now("x") == 3.0
    assert list(loop.not_compiled) == ["odd"]


def test_progress_grows_to_one():
    seen = []
    counting(1000, [Stage("add", lambda now, row: {"x": now["x"] + 1.0}, NOTHING)]).run(seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert len(seen) > 3
