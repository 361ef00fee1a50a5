"""The compensator in a loop: what the plant does, what happens off the data, what trouble looks like."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.compensate import Compensator, Settings
from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.mismatch import LinearMismatch
from wrenchgap.plant.model_file import load as load_model

TORQUES = ("torque_x", "torque_y", "torque_z")
HOVER = np.array([0.0, 0.0, 39.0, 0.0, 0.0, 0.0])
SCALE = np.array([8.0, 8.0, 5.0, 0.5, 0.5, 0.5])
FAR = np.array([90.0, -90.0, 0.0, 5.0, 5.0, 5.0])


def truth(wrench):
    """Torque of the weight about a centre of mass that is off, a loss of control power, and a bias."""
    force, torque = wrench[:, :3], wrench[:, 3:]
    return np.cross(force, [0.004, -0.007, 0.005]) - 0.2 * torque + [0, 0, 0.3]


@pytest.fixture(scope="module")
def gp():
    """A GP through 150 exact samples of `truth`, hyperparameters by hand."""
    x = np.random.default_rng(0).uniform(-1.5, 1.5, size=(150, 6))
    outputs = truth(HOVER + x * SCALE)
    scale = np.sqrt((outputs**2).mean(axis=0))
    made = GaussianProcess(
        outputs=TORQUES,
        input_mean=HOVER,
        input_scale=SCALE,
        output_scale=scale,
        mean_coefficients=np.zeros((3, 7)),
        inputs=x,
        residuals=outputs / scale,
        lengthscales=np.full((3, 6), 4.0),
        signal_variance=np.full(3, 4.0),
        noise_variance=np.full(3, 1e-5),
        sigma_training=np.ones(3),
        mismatch_max=np.abs(outputs).max(axis=0),
    )
    seen = HOVER + SCALE * np.random.default_rng(1).uniform(-1.5, 1.5, size=(2000, 6))
    return replace(made, sigma_training=np.percentile(made.std(seen), 99, axis=0))


def near(seed):
    return HOVER + SCALE * np.random.default_rng(seed).uniform(-1, 1, 6)


def test_plant_gives_what_was_asked_for(gp):
    compensator = Compensator(gp)
    for seed in range(30):
        wrench = near(seed)
        command = compensator.step(wrench).wrench_cmd
        assert (command[:3] == wrench[:3]).all(), "forces are left alone"
        before = np.abs(truth(wrench[None])[0]).max()
        after = np.abs(command[3:] + truth(command[None])[0] - wrench[3:]).max()
        assert after < 0.1 * before


def test_parts_of_a_result_fit_together(gp):
    compensator = Compensator(gp)
    previous = np.zeros(6)
    for seed in range(5):
        wrench = near(seed) * 1.4
        result = compensator.step(wrench)
        decay = math.exp(-0.01 / 0.15)
        expected = decay * result.beta * previous + (1 - result.beta) * result.optimum
        assert result.correction == pytest.approx(expected)
        assert result.wrench_cmd == pytest.approx(wrench + result.correction)
        assert result.sigma == pytest.approx(gp.std((wrench + result.optimum)[None]).max())
        residual = gp.mean((wrench + result.optimum)[None])[0] + result.optimum[3:]
        assert result.cost == pytest.approx(residual @ residual, abs=1e-12)
        assert result.accepted == (result.cost < 1e-4)
        previous = result.correction


@pytest.mark.parametrize("dt", [0.02, 0.01, 0.0025])
def test_off_the_data_the_correction_dies_out_whatever_the_rate(gp, dt):
    compensator = Compensator(gp, Settings(dt=dt, decay_time=0.15, kappa=1e4))
    steady = compensator.step(near(2))
    assert steady.beta < 1e-6
    assert np.abs(steady.correction).max() > 0.1
    for count in range(1, 40):
        result = compensator.step(FAR)
        assert result.sigma > 2 * steady.sigma
        assert result.correction == pytest.approx(steady.correction * math.exp(-dt * count / 0.15), abs=1e-9)


def test_default_threshold_lets_go_far_away(gp):
    compensator = Compensator(gp)
    for _ in range(200):
        result = compensator.step(FAR)
    assert result.beta > 0.98
    assert np.abs(result.correction).max() < 0.3 * np.abs(truth(FAR[None])).max()


def test_filter_can_be_switched_off(gp):
    result = Compensator(gp, Settings(filter_uncertain=False)).step(FAR)
    assert result.beta == 0.0
    assert (result.correction == result.optimum).all()


def test_next_search_starts_at_the_unfiltered_optimum(gp):
    """While the filter suppresses the correction, a repeated command still costs one evaluation."""
    compensator = Compensator(gp, Settings(sigma_threshold=0.0, kappa=1e6))
    first, again = compensator.step(near(3)), compensator.step(near(3))
    assert np.abs(first.correction).max() < 1e-9 < np.abs(first.optimum).max()
    assert again.iterations <= 2 < first.iterations


def test_runs_repeat_and_reset_forgets(gp):
    compensator = Compensator(gp)
    runs = []
    for _ in range(2):
        runs.append([compensator.step(near(seed)) for seed in range(10)])
        compensator.reset()
    for one, other in zip(*runs, strict=True):
        for name in ("wrench_cmd", "sigma", "beta", "cost", "iterations"):
            assert np.array_equal(getattr(one, name), getattr(other, name))


def test_arguments_and_results_are_nobodys_but_the_callers(gp):
    compensator = Compensator(gp)
    wrench = near(4)
    first = compensator.step(wrench)
    assert (wrench == near(4)).all()
    first.correction[:] = 9.0
    first.optimum[:] = 9.0
    fresh = Compensator(gp)
    fresh.step(near(4))
    assert compensator.step(near(5)).correction == pytest.approx(fresh.step(near(5)).correction, abs=0)


def test_default_bounds_come_from_the_data(gp):
    """A mismatch of -99 % of the torque would ask for a hundredfold command; three times what was seen is the limit."""
    weak = replace(gp, mismatch_max=np.full(3, 0.01))
    assert np.abs(Compensator(weak).step(near(5)).optimum[3:]).max() <= 0.03 + 1e-12
    wider = Compensator(weak, Settings(correction_max=(9, 9, 9, 0.05, 9, 9))).step(near(5))
    assert abs(wider.optimum[3]) <= 0.05 + 1e-12
    assert np.abs(wider.optimum[4:]).max() > 0.03


def test_a_correction_stays_within_what_the_vehicle_makes(gp):
    """Three times what was seen may be more than its rotors have; what was seen cannot be."""
    vehicle = load_model("tilt_hexarotor").vehicle
    most = Compensator(gp, vehicle=vehicle).reach.authority[3:]
    half = Compensator(replace(gp, mismatch_max=0.5 * most), vehicle=vehicle)
    np.testing.assert_allclose(half.correction_max[3:], most)
    tenth = Compensator(replace(gp, mismatch_max=0.1 * most), vehicle=vehicle)
    np.testing.assert_allclose(tenth.correction_max[3:], 0.3 * most)
    with pytest.raises(FitError, match="its file is damaged or of another vehicle"):
        Compensator(replace(gp, mismatch_max=1.1 * most), vehicle=vehicle)


@pytest.mark.parametrize("size", [1e-3, 1.0, 30.0])
def test_accuracy_follows_the_size_of_the_vehicle(gp, size):
    """Torques of a palm-sized quadrotor are a thousandth of these; its correction must be as accurate in proportion."""
    scaled = SCALE * [1, 1, 1, size, size, size]
    small = replace(gp, input_scale=scaled, output_scale=gp.output_scale * size, mismatch_max=gp.mismatch_max * size)
    compensator = Compensator(small, Settings(filter_uncertain=False))
    for seed in range(10):
        wrench = HOVER + scaled * np.random.default_rng(seed).uniform(-1, 1, 6)
        result = compensator.step(wrench)
        left = small.mean(result.wrench_cmd[None])[0] + result.correction[3:]
        assert result.accepted
        assert np.abs(left).max() < 2e-3 * np.abs(small.mean(wrench[None])[0]).max()


def test_trouble_is_told_and_passes(monkeypatch):
    line = LinearMismatch(TORQUES, np.full(3, 0.2), np.zeros((3, 6)), np.full(3, 0.1))
    compensator = Compensator(line, Settings(solver="lbfgs"))  # a plain model: what is compiled does not change
    good = compensator.step(HOVER)
    with monkeypatch.context() as broken:
        for method in ("mean", "std"):
            broken.setattr(LinearMismatch, method, lambda self, wrench: np.full((len(wrench), 3), np.nan))
        bad = compensator.step(HOVER)
    again = compensator.step(HOVER)
    assert good.correction == pytest.approx([0, 0, 0, -0.2, -0.2, -0.2], abs=1e-6)
    assert (good.accepted, good.beta) == (True, 0.0)
    assert "not finite" in bad.trouble
    assert not bad.accepted
    assert (bad.optimum == 0).all()
    assert bad.correction == pytest.approx(good.correction * math.exp(-0.01 / 0.15))
    assert again.trouble == ""
    assert again.correction == pytest.approx(good.correction, abs=1e-5)


@pytest.mark.parametrize(
    ("wrench", "message"),
    [
        ([0, 0, 39, 0, 0], r"shape \(5,\), expected \(6,\)"),
        ([[0, 0, 39, 0, 0, 0]], r"shape \(1, 6\)"),
        ([0, 0, np.nan, 0, 0, 0], "not finite; check the controller"),
        ("hover", "not six numbers"),
        ([0, 0, [39], 0, 0, 0], "not six numbers"),
    ],
)
def test_bad_wrench_gets_one_line(gp, wrench, message):
    with pytest.raises(UsageError, match=message) as caught:
        Compensator(gp).step(wrench)
    assert "\n" not in str(caught.value)


IMPOSSIBLE = [
    *[("dt", 0.0), ("decay_time", -1.0), ("kappa", math.nan), ("regulariser", -1e-3), ("max_evaluations", 0)],
    ("max_evaluations", 10**20),
    *[("sigma_threshold", math.nan), ("correction_max", (1.0,) * 3), ("correction_max", (1, 1, 1, 1, 1, math.nan))],
]


@pytest.mark.parametrize(("name", "value"), IMPOSSIBLE)
def test_bad_settings_get_one_line(name, value):
    with pytest.raises(UsageError, match=rf"{name} .*(expected|is not a number)") as caught:
        Settings(**{name: value})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("threshold", [-np.inf, -1.0, np.nan])
def test_a_threshold_below_all_deviations_is_none(threshold):
    """It opened the gate altogether, or shut it without a word."""
    with pytest.raises(UsageError, match=f"sigma_threshold is {threshold}, expected zero or a positive number"):
        Settings(sigma_threshold=threshold)
