"""Fits recover what made the data, on commands they have not seen."""

import numpy as np
import pytest

from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.learn.process.gp import FitSettings, LogSource, Provenance
from wrenchgap.learn.process.train import fit, fit_linear
from wrenchgap.plant.mismatch import conditioning

TORQUES = ("torque_x", "torque_y", "torque_z")
NOISE = np.array([0.02, 0.03, 0.04])
QUICK = FitSettings(points=120, restarts=0)


def commands(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, 6)) * [8, 8, 3, 0.3, 0.3, 0.2] + [0, 0, 39, 0, 0, 0]


def truth(wrench: np.ndarray) -> np.ndarray:
    """A centre of mass 5 mm off, a saturating loss, and a constant with a wave in it."""
    x, y, z = wrench[:, :3].T
    loss = 0.2 * np.tanh(2 * wrench[:, 4]) + 0.005 * x
    return np.column_stack([0.005 * z - 0.003 * y, loss, 0.5 + 0.15 * np.sin(x / 8)])


def samples(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    wrench = commands(count, seed)
    return wrench, truth(wrench) + NOISE * np.random.default_rng(seed + 100).normal(size=(count, 3))


@pytest.fixture(scope="module")
def fitted():
    return fit(*samples(2000, 0), TORQUES, QUICK)


def test_recovers_the_function_on_unseen_commands_and_the_noise(fitted):
    wrench = commands(500, 7)
    error = np.abs(fitted.mean(wrench) - truth(wrench)).mean(axis=0)
    assert (error < 0.6 * NOISE).all()
    every = [error, *(np.abs(fit(*samples(2000, k), TORQUES, QUICK).mean(wrench) - truth(wrench)).mean(axis=0)
                      for k in (1, 2, 3, 4))]  # fmt: skip
    assert (np.mean(every, axis=0) < 0.1 * np.abs(truth(wrench)).mean(axis=0)).all()  # one draw: 5 to 13 %
    assert np.sqrt(fitted.noise_variance) * fitted.output_scale == pytest.approx(NOISE, rel=0.25)
    assert fitted.mismatch_max == pytest.approx(np.abs(samples(2000, 0)[1]).max(axis=0))


def test_sigma_is_honest_on_unseen_measurements_and_rises_outside(fitted):
    wrench, measured = samples(2000, 3)
    score = (measured - fitted.mean(wrench)) / fitted.std(wrench)
    assert np.sqrt((score**2).mean(axis=0)) == pytest.approx(np.ones(3), abs=0.2)
    inside, outside = fitted.std(commands(1000, 8)), fitted.std(np.array([[80.0, 80.0, 39.0, 3.0, 3.0, 2.0]]))
    assert np.mean(inside < fitted.sigma_training, axis=0) == pytest.approx(np.full(3, 0.99), abs=0.02)
    assert (outside > 2 * fitted.sigma_training).all()
    assert fitted.mean(np.full((1, 6), 1e5))[0] == pytest.approx(np.zeros(3), abs=1e-12)


def test_lengthscales_tell_what_matters(fitted):
    x, _, z = fitted.lengthscales
    assert z[0] < 3  # the wave in force_x
    assert z[1:].min() > 3 * z[0]
    assert x.argmin() in (1, 2)


def test_fit_repeats():
    data = samples(300, 1)
    settings = FitSettings(points=40, restarts=1, seed=4)
    first, again = (fit(*data, TORQUES, settings) for _ in range(2))
    for name in first.array_shapes():
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()


def test_units_do_not_matter():
    """Millinewton metres in, millinewton metres out."""
    wrench, measured = samples(300, 1)
    settings = FitSettings(points=60, restarts=0)
    si, milli = fit(wrench, measured, TORQUES, settings), fit(1e3 * wrench, 1e3 * measured, TORQUES, settings)
    query = commands(50, 5)
    assert milli.mean(1e3 * query) == pytest.approx(1e3 * si.mean(query), rel=1e-3, abs=0.5)
    assert milli.sigma_prior == pytest.approx(1e3 * si.sigma_prior, rel=1e-2)


def test_white_noise_is_recognised_as_noise():
    """No function is found where there is none: the prediction is small beside the noise."""
    wrench = commands(1500, 2)
    measured = np.random.default_rng(9).normal(size=(1500, 1))
    gp = fit(wrench, measured, ("torque_x",), QUICK)
    assert np.abs(gp.mean(commands(300, 3))).mean() < 0.25
    assert gp.sigma_training[0] == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize("kind", ["constant", "linear"])
def test_mean_function_takes_what_is_linear(kind):
    wrench, measured = samples(800, 4)
    gp = fit(wrench, measured, TORQUES, FitSettings(points=80, restarts=0, mean=kind))
    error = np.abs(gp.mean(commands(300, 6)) - truth(commands(300, 6))).mean(axis=0)
    assert (error < 0.8 * NOISE).all()
    far = np.array([[0.0, 0.0, 1e4, 0.0, 0.0, 0.0]])
    expected = 0.005 * 1e4 if kind == "linear" else measured[:, 0].mean()
    assert gp.mean(far)[0, 0] == pytest.approx(expected, rel=0.1)


def test_line_is_recovered_exactly_and_without_slope_it_is_the_mean():
    rng = np.random.default_rng(0)
    offset, gain = rng.normal(size=3), rng.normal(size=(3, 6))
    wrench = commands(50, 0)
    measured = offset + wrench @ gain.T
    line, level = (fit_linear(wrench, measured, TORQUES, slope=slope) for slope in (True, False))
    assert line.gain == pytest.approx(gain)
    assert line.offset == pytest.approx(offset)
    assert line.sigma == pytest.approx(np.zeros(3), abs=1e-10)
    assert (level.gain == 0).all()
    assert level.offset == pytest.approx(measured.mean(axis=0))
    assert level.sigma == pytest.approx(measured.std(axis=0))


def test_closed_loop_trap_is_shown_by_the_conditioning():
    """Measured torque that never varies: z = c - M_cmd, whatever the plant; the fit finds slope -1."""
    wrench = commands(1500, 0)
    rng = np.random.default_rng(1)
    trapped = fit(wrench, 0.01 * rng.normal(size=(1500, 3)) - wrench[:, 3:], TORQUES, QUICK)
    along = conditioning(trapped, commands(50, 2))
    assert np.median(along.singular_min) < 0.05
    good = conditioning(fit(*samples(1500, 0), TORQUES, QUICK), commands(50, 2))
    assert np.median(good.singular_min) > 0.5


def test_provenance_and_settings_travel():
    origin = Provenance("voliro_x", "ab12", "nominal", 8.0, (LogSource("a.mcap", "cd34"),), "0.1.0", "2026-01-01")
    settings = FitSettings(points=20, restarts=0, method="pyclustering", scale="raw")
    gp = fit(*samples(200, 0), TORQUES, settings, provenance=origin)
    assert (gp.provenance, gp.settings, gp.inputs.shape) == (origin, settings, (20, 6))


def test_is_silent_and_reports_progress(capfd):
    told = []
    fit(*samples(60, 0), TORQUES, FitSettings(points=10), progress=lambda *news: told.append(news))
    assert capfd.readouterr() == ("", "")
    fractions = [fraction for fraction, _ in told]
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0.0, 1.0)


def broken(**change):
    wrench, measured = samples(60, 0)
    return {"inputs": wrench, "outputs": measured, "names": TORQUES} | change


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (broken(outputs=np.zeros((60, 2))), FitError, "do not match 3 outputs"),
        (broken(inputs=np.full((60, 6), np.nan)), FitError, "60 of 60 inputs are not finite"),
        (broken(inputs=np.ones((60, 6))), FitError, "the command never changes"),
        (broken(inputs=np.ones((5, 6)), outputs=np.ones((5, 3))), FitError, "5 samples, expected at least 12"),
        (broken(settings=FitSettings(points=1)), UsageError, "got 1 points"),
    ],
)
def test_bad_data_gets_one_line(arguments, error, message):
    with pytest.raises(error, match=message) as caught:
        fit(**arguments)
    assert "\n" not in str(caught.value)


def test_an_output_that_is_always_zero_predicts_zero():
    gp = fit(commands(60, 0), np.zeros((60, 1)), ("force_x",), FitSettings(points=20, restarts=0))
    assert gp.mean(commands(5, 1)) == pytest.approx(np.zeros((5, 1)), abs=1e-9)
