"""What the residual depends on comes out by name; noise depends on nothing."""

import time

import numpy as np
import pytest

from wrenchgap.learn.diagnose.quantities import input_groups
from wrenchgap.learn.diagnose.relevance import relevance, shifted


def group(data, name):
    return next(g.values for g in input_groups(data)[0] if g.name == name)


def white(data, seed):
    return np.random.default_rng(seed).standard_normal(data.measured.shape) * data.noise


def test_a_torque_that_depends_on_heading(turning):
    """Half of the torque's variance is noise: the share that is found is the share that was put in."""
    residual = white(turning, 0)
    signal = 0.02 * group(turning, "heading")[:, 0]
    residual[:, 5] = signal + signal.std() * np.random.default_rng(1).standard_normal(len(signal))
    found = relevance(turning, residual)
    assert [g.name for g in found.chosen] == ["heading"]
    first = found.groups[0]
    assert first.alone_axes[5] == pytest.approx(0.5, abs=0.06)
    assert first.lost_axes[5] == pytest.approx(0.5, abs=0.06)
    assert first.alone_axes[:5].max() < 0.05


def test_a_force_that_depends_on_height_without_a_straight_line(fly):
    data, _ = fly("none", None, "low", seconds=30, seed=7)
    height = group(data, "height")[:, 0]
    residual = white(data, 2)
    residual[:, 2] += 2.0 * np.exp(-(((height - np.median(height)) / height.std()) ** 2))
    found = relevance(data, residual)
    assert found.groups[0].name == "height"
    assert found.groups[0].alone_axes[2] > 0.85


def test_two_causes_are_both_found_and_each_is_missed(tumbling):
    residual = white(tumbling, 3)
    for axis, name in ((3, "velocity"), (5, "rates")):
        values = group(tumbling, name)[:, 2]
        residual[:, axis] += 4 * tumbling.noise[axis] * values / values.std()
    found = relevance(tumbling, residual)
    assert {g.name for g in found.chosen} == {"velocity", "rates"}
    for g in found.chosen:
        assert g.lost == pytest.approx(g.alone, abs=0.1)
    assert found.explained == pytest.approx(sum(g.lost for g in found.chosen), abs=0.05)


def test_noise_depends_on_nothing(tumbling):
    assert not any(relevance(tumbling, white(tumbling, seed)).chosen for seed in range(5))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "trajectory", "inputs"), [("compass", "turn", "heading"), ("ground", "low", "height")]
)
def test_on_the_independent_engine(fly, hexarotor, effect, trajectory, inputs):
    """The controller counteracts both, so the command follows them; it must not take their place."""
    data, _ = fly(effect, None, trajectory, seconds=30, seed=31)
    residual = data.measured - data.predict(hexarotor.wrench_model)
    started = time.process_time()
    found = relevance(data, residual)
    assert time.process_time() - started < 10
    assert found.chosen[0].name == inputs
    again = relevance(data, residual)
    assert [(g.name, g.alone, g.lost) for g in again.groups] == [(g.name, g.alone, g.lost) for g in found.groups]


def test_what_moves_the_state_is_not_driven_by_it(tumbling):
    """A force that velocity follows a moment later, as a gust's, and one that follows velocity, as drag's: both
    are explained by velocity, and only the second depends on it.
    """
    values = group(tumbling, "velocity")[:, 0]
    size = 4 * tumbling.noise[0] / values.std()
    behind, ahead = (white(tumbling, 3) for _ in range(2))
    behind[:, 0] += size * values
    ahead[:, 0] += size * shifted(tumbling, values[:, None], 0.15)[:, 0]
    assert relevance(tumbling, behind).driven > 0.8 * relevance(tumbling, behind).explained
    found = relevance(tumbling, ahead)
    assert "velocity" in {g.name for g in found.chosen}
    assert found.driven < 0.6 * found.explained
