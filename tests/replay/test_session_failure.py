"""The failure map of the viewer: its numbers are those of the library, its instants lie where the error is."""

from unittest.mock import Mock

import numpy as np
import pytest

from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.opening import open_flight, open_flights
from wrenchgap.learn.diagnose.failure_map import failure_map
from wrenchgap.learn.diagnose.quantities import quantities
from wrenchgap.learn.diagnose.where import Source, budget
from wrenchgap.plant import model_file
from wrenchgap.replay.session.log_session import LogSession
from wrenchgap.replay.session.panels import failure as session_failure
from wrenchgap.replay.session.panels.failure import UNITS, VIEWS

MODEL = model_file.load("tilt_hexarotor")


@pytest.fixture(scope="module")
def session(logs):
    return LogSession(open_flights([logs.train, logs.test], MODEL), MODEL)


@pytest.fixture(scope="module")
def failure(session):
    return session.failures.of("train")


@pytest.fixture(scope="module")
def direct(logs):
    """Data and residual of the nominal model, without any session."""
    data = dataset(open_flight(logs.train, MODEL).records, MODEL)
    return data, data.measured - data.predict(MODEL.wrench_model)


def test_cells_hold_the_errors_that_the_library_finds(failure, direct):
    data, residual = direct
    mapped = failure_map(data, residual, permutations=110)
    assert [d.label for d in failure.map.dependences] == [d.label for d in mapped.dependences]
    for own, cells, found in zip(failure.map.dependences, failure.cells, mapped.dependences, strict=True):
        assert len(cells) == len(found.binned)
        rms, mean = (np.array([getattr(c, kind) for c in cells]) for kind in ("rms", "mean"))
        assert rms[:, 0] == pytest.approx(found.binned.whole_rms)
        assert rms[:, 3:] == pytest.approx(found.binned.rms)
        assert mean[:, 3:] == pytest.approx(found.binned.mean)
        step = np.diff(data.records[0].time).mean()
        assert [c.seconds for c in cells] == pytest.approx(found.binned.samples * step)
        assert own.significant == found.significant


def test_views_are_norms_of_their_axes(failure):
    assert len(VIEWS) == len(UNITS) == 9
    for cell in failure.cells[0]:
        assert cell.rms[1] == pytest.approx(np.linalg.norm(cell.rms[3:6]))
        assert cell.rms[2] == pytest.approx(np.linalg.norm(cell.rms[6:]))
        assert cell.mean[2] == pytest.approx(np.linalg.norm(cell.mean[6:]))
        assert np.all(np.abs(cell.mean) <= cell.rms + 1e-12)


def test_the_instant_of_a_cell_lies_in_it_and_nowhere_in_it_is_the_error_larger(failure, direct):
    data, residual = direct
    time = data.records[0].time
    values = {q.label: q for q in quantities(data)[0]}
    energy = np.sum((residual * data.weights) ** 2, axis=1)
    width = round(0.2 / np.diff(time).mean())
    smooth = np.convolve(energy, np.ones(width) / width, mode="same")
    labels = [d.label for d in failure.map.dependences]
    for cell in failure.cells[labels.index("tilt")]:
        low, high = (float(part) for part in cell.words.removesuffix(" deg").split(" to "))
        k = int(np.argmin(np.abs(time - cell.time[0])))
        at = values["tilt"].values
        assert low - 0.6 <= at[k] <= high + 0.6  # words are rounded
        inside = (at > low + 0.6) & (at < high - 0.6) & (time > time[width]) & (time < time[-width])
        assert smooth[k] >= 0.999 * smooth[inside].max()


def test_grid_cells_add_up_to_the_time_with_a_direction(failure, direct):
    data, residual = direct
    grid = failure.grid
    found = failure_map(data, residual, permutations=2).grid
    cells = {(i, j): c for j, row in enumerate(grid.rows) for i, c in enumerate(row) if c is not None}
    assert len(cells) == np.isfinite(found.force).sum()
    for (i, j), cell in cells.items():
        assert cell.rms[1] == pytest.approx(found.force[i, j])
        assert cell.rms[2] == pytest.approx(found.torque[i, j])


def test_budget_adds_up_and_is_that_of_the_library(failure, direct):
    data, residual = direct
    made = budget(data, residual, residual, None, "none")
    assert failure.budget.source is Source.NONE
    whole = failure.budget.whole()
    assert whole["process"] == 0.0
    assert sum(whole.values()) == pytest.approx(1.0)
    assert sum(failure.budget.shares().values()) == pytest.approx(np.ones(6))
    assert failure.budget.nominal == pytest.approx(made.nominal)
    assert whole["unexplained"] > 0.9


def test_full_budget_says_what_a_process_would_explain(session, failure, monkeypatch):
    """A process that predicts half of the residual leaves a quarter of its square."""
    half = Mock(side_effect=lambda data, residual, progress: progress(0, 4) or 0.5 * residual)
    monkeypatch.setattr(session_failure, "held_out_process", half)
    told = []
    found = session.failures.full_budget("train", lambda share, words: told.append(words))
    assert found.source is Source.FITTED
    shares, quick = found.shares(), failure.budget.shares()
    assert shares["process"] == pytest.approx(np.full(6, 0.75))
    assert shares["noise"] + shares["unexplained"] == pytest.approx(np.full(6, 0.25))
    assert np.all(shares["unexplained"] < quick["unexplained"])
    assert "Gaussian process, fold 1" in told


def test_with_the_effect_in_the_map_falls_to_the_noise(logs):
    session = LogSession(open_flights([logs.train], MODEL), MODEL)
    before = session.failures.of("train")
    session.effects.add(("com_offset",), "train")
    after = session.failures.of("train")
    for cell in after.cells[0]:
        assert cell.rms[0] < 2.0 * cell.noise[0]
    assert max(c.rms[0] for c in before.cells[0]) > 5.0 * before.cells[0][0].noise[0]
    assert after.budget.whole()["physics"] > 0.9
    session.effects.undo()
    again = session.failures.of("train")
    for old, new in zip(before.cells, again.cells, strict=True):
        assert all(np.array_equal(a.rms, b.rms) for a, b in zip(old, new, strict=True))
