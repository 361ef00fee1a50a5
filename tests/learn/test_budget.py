"""Parts of the error add up, and are as large as they were made."""

import numpy as np
import pytest

from wrenchgap.learn.diagnose.where import budget, held_out_process


def parts(tumbling, seed=0):
    """(noise, physics, smooth function of the command, something else) (K, 6) each, of sizes known by their making."""
    rng = np.random.default_rng(seed)
    k = len(tumbling.measured)
    white = rng.standard_normal((k, 6)) * tumbling.noise
    force = tumbling.commanded[:, :3]
    direction = force / np.linalg.norm(force, axis=1, keepdims=True)
    smooth = np.column_stack((direction[:, 1] ** 2, direction[:, 0], direction[:, 2] * direction[:, 1])) - 0.2
    smooth = 8 * np.column_stack((smooth, smooth[:, ::-1])) * tumbling.noise
    known = 5 * np.roll(smooth, 1, axis=1)
    time = np.concatenate([r.time for r in tumbling.records])
    other = 3 * tumbling.noise * np.sin(2 * np.pi * 2.7 * time)[:, None]
    return white, known, smooth, other


def test_parts_add_up_to_the_nominal_error(tumbling):
    white, known, smooth, other = parts(tumbling)
    for process in (None, smooth, -smooth):
        made = budget(tumbling, known + smooth + white + other, smooth + white + other, process, "fitted")
        total = made.noise + made.physics + made.process + made.unexplained
        assert total == pytest.approx(np.mean((known + smooth + white + other) ** 2, axis=0))
        assert sum(made.whole().values()) == pytest.approx(1)
        assert (made.process >= 0).all()
        assert (made.unexplained >= 0).all()


@pytest.mark.slow
def test_known_sizes_are_recovered(tumbling):
    """Noise, a function of the command and a 2.7 Hz hum, each found as large as it is (they hardly correlate)."""
    white, known, smooth, other = parts(tumbling)
    left = smooth + white + other
    made = budget(tumbling, known + left, left, held_out_process(tumbling, left), "fitted")
    assert made.noise == pytest.approx(tumbling.noise**2)
    assert made.process == pytest.approx(np.mean(smooth**2, axis=0), rel=0.2)
    assert made.unexplained == pytest.approx(np.mean(other**2, axis=0), rel=0.2)
    assert made.physics == pytest.approx(np.mean((known + left) ** 2 - left**2, axis=0))


def test_a_process_on_noise_explains_nothing(tumbling):
    """Held out it does harm, which is no negative part."""
    white, *_ = parts(tumbling, seed=3)
    made = budget(tumbling, white, white, held_out_process(tumbling, white, points=30), "fitted")
    assert (made.process <= 0.02 * tumbling.noise**2).all()
    assert made.whole()["noise"] > 0.95


def test_physics_that_does_harm_counts_against_it(tumbling):
    white, known, _, _ = parts(tumbling)
    made = budget(tumbling, white, white + known, None, "none")
    assert (made.physics < 0).all()
    assert made.source == "none"
    assert made.shares()["noise"] == pytest.approx(np.ones(6), rel=0.15)


def test_the_process_did_not_see_what_it_is_judged_on(tumbling):
    """A residual that is a different constant in every block of 2 s cannot be guessed from the others."""
    rng = np.random.default_rng(4)
    residual = rng.standard_normal((int(tumbling.block.max()) + 1, 6))[tumbling.block]
    process = held_out_process(tumbling, residual, points=30)
    assert np.mean((residual - process) ** 2) > 0.8 * np.mean(residual**2)
