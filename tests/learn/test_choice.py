"""What else a process should look at: what the mismatch depends on is found, what it does not is not recommended."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight.errors import FitError
from wrenchgap.learn.process import alternatives
from wrenchgap.learn.process.alternatives import compare_alternatives
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.plant.mismatch_inputs import COLUMNS

COUNT = 480
TORQUE = ("torque_z",)
ASKED = FitSettings(points=40, restarts=0)


def smooth(seed: int, columns: int) -> np.ndarray:
    """Slow signals (COUNT, columns) of about unit size, as flights have: two sines each."""
    rng = np.random.default_rng(seed)
    phase, rate = rng.uniform(0, 2 * np.pi, (2, columns)), rng.uniform(0.5, 3.0, (2, columns))
    return np.sin(rate * 0.075 * np.arange(COUNT)[:, None, None] + phase).sum(axis=1)


COMMAND = smooth(0, 6)
EXTRA = {name: smooth(k + 1, len(columns)) for k, (name, columns) in enumerate(COLUMNS.items())}


def inputs(groups: tuple[str, ...]) -> np.ndarray:
    return np.hstack((COMMAND, *(EXTRA[g] for g in groups)))


NOISE = 0.02 * np.random.default_rng(9).normal(size=(COUNT, 1))


def test_drag_and_a_lag_ask_for_velocity_and_past() -> None:
    """A torque from the command, from the speed, and from the change of the command."""
    torque = 0.3 * COMMAND[:, [3]] + 0.3 * EXTRA["velocity"][:, [0]] + 0.4 * EXTRA["past"][:, [5]] + NOISE
    found = compare_alternatives(inputs, torque, TORQUE, ASKED)
    assert found.better is not None
    assert set(found.best.inputs) == {"velocity", "past"}
    assert found.better.gain > 0.5
    assert found.tried[0].settings == ASKED
    assert found.tried[0].gain == 0.0


def test_what_the_command_explains_asks_for_nothing() -> None:
    found = compare_alternatives(inputs, 0.3 * COMMAND[:, [3]] + NOISE, TORQUE, ASKED)
    assert found.best.inputs == ()


def test_fewer_samples_choose_the_same(monkeypatch) -> None:
    torque = 0.3 * EXTRA["velocity"][:, [0]] + 0.4 * EXTRA["past"][:, [5]] + NOISE
    whole = compare_alternatives(inputs, torque, TORQUE, ASKED)
    monkeypatch.setattr(alternatives, "COMPARED", replace(alternatives.COMPARED, seen=240))
    some = compare_alternatives(inputs, torque, TORQUE, ASKED)
    assert len(COMMAND) > 240
    assert some.best.inputs == whole.best.inputs
    assert some.tried[1].gain == pytest.approx(whole.tried[1].gain, abs=0.1)
    assert some.tried[1].rms.tolist() != whole.tried[1].rms.tolist()  # it did look at fewer


def test_groups_that_the_log_lacks_are_left_out() -> None:
    def without_pose(groups: tuple[str, ...]) -> np.ndarray:
        if {"velocity", "position"} & set(groups):
            raise FitError("no odometry")
        return inputs(groups)

    found = compare_alternatives(without_pose, 0.4 * EXTRA["past"][:, [5]] + NOISE, TORQUE, ASKED)
    assert found.best.inputs == ("past",)
    assert not any({"velocity", "position"} & set(c.settings.inputs) for c in found.tried)


def test_few_samples_are_not_compared() -> None:
    found = compare_alternatives(lambda groups: inputs(groups)[:100], NOISE[:100], TORQUE, ASKED)
    assert found.tried == ()
    assert found.better is None
    assert found.best == ASKED
