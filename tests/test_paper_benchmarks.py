"""The paper's experiments: the plant, the judges and the page. The experiments themselves take minutes."""

from contextlib import nullcontext
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from benchmarks.paper import feedback, figure8, pitch, uncertainty
from benchmarks.paper import methods as m
from benchmarks.paper.compute import ByGPy
from benchmarks.paper.corrected import COMBINED, VARIANTS, tables
from benchmarks.paper.page import renewed
from benchmarks.paper.pitch import summary
from benchmarks.paper.plants import LegWake, vehicle
from benchmarks.paper.prediction import PAPER, knowledge
from benchmarks.paper.running import EXPERIMENTS, PAGES, Output, in_parallel, plain
from wrenchgap.learn.identify.learning import TORQUE
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.learn.process.train import fit
from wrenchgap.plant.actuation import actuation
from wrenchgap.plant.effects import catalogue
from wrenchgap.plant.effects.effect import Context
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.state import Commands, State


def hovering(tilt):
    """All rotors at hover speed, arms at `tilt` (N, 6)."""
    believed, count = vehicle().believed.vehicle, len(tilt)
    rest = np.zeros((count, 3))
    state = State(np.zeros(count), rest, np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), rest, rest)
    commands = Commands(np.zeros((count, 6)), tilt, np.full((count, 12), 676.0))
    return actuation(believed, commands), Context(believed, state)


def wake(tilt, theta):
    act, context = hovering(tilt)
    return LegWake().apply(act, np.zeros((len(tilt), 6)), np.array(theta), context)


def test_a_leg_catches_most_where_the_wake_points_at_it_and_nothing_without_loss():
    angles = np.radians(np.arange(-80.0, 81.0, 2.0))
    tilt = np.outer(angles, np.eye(6)[0])
    push, rest = (wake(t, (0.1, np.radians(40.0), np.radians(15.0))) for t in (tilt, np.zeros((1, 6))))
    moved = np.linalg.norm(push[:, :3] - rest[:, :3], axis=1)
    assert abs(np.degrees(angles[int(np.argmax(moved))]) - 40.0) <= 4.0
    assert not wake(tilt, (0.0, 0.7, 0.3)).any()


def test_the_push_on_a_leg_is_against_the_thrust():
    act, _ = hovering(np.zeros((1, 6)))
    push = wake(np.zeros((1, 6)), (0.1, 0.0, 0.3))[0]
    assert push[2] < 0.0
    assert abs(push[2]) < 0.1 * act.thrust.sum()
    np.testing.assert_allclose(push[:2], 0.0, atol=1e-12)


def test_the_truth_holds_something_that_the_catalogue_lacks():
    names = {e.name for e in vehicle().truth.effects}
    assert names - set(catalogue()) == {"leg_wake"}
    assert not vehicle().believed.effects


def test_vehicles_differ_and_repeat():
    third, again, other = (np.concatenate([e.theta for e in vehicle(k).truth.effects]) for k in (3, 3, 0))
    np.testing.assert_array_equal(third, again)
    assert np.abs(third - other).max() > 1e-3


@pytest.fixture(scope="module")
def known():
    return knowledge(0, seconds=12.0)


def test_a_straight_line_learnt_from_a_flight_explains_most_of_that_flight(known):
    record = known.flights[0].records[0]
    z = (record.measured - m.nominal(known, record))[:, 3:]
    line, constant = (np.abs(z - p.predict(known, record)).mean(axis=0) for p in (m.LINEAR, m.CONSTANT))
    assert (line < constant).all()
    assert (line < 0.5 * np.abs(z).mean(axis=0)).all()


def test_gpy_and_the_closed_form_say_the_same():
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=(60, 6)) * (5.0, 5.0, 10.0, 0.3, 0.3, 0.3)
    outputs = 0.3 * np.sin(inputs[:, 3:]) + 0.01 * rng.normal(size=(60, 3))
    gp = fit(inputs, outputs, TORQUE, FitSettings(points=30, restarts=0))
    other, asked = ByGPy(gp), inputs[:7] + 0.1
    np.testing.assert_allclose(other.mean(asked), gp.mean(asked), atol=1e-6)
    np.testing.assert_allclose(other.std(asked), gp.std(asked), rtol=1e-4)
    np.testing.assert_allclose(other.jacobian(asked), gp.jacobian(asked), atol=1e-6)


def test_parallel_results_keep_their_order():
    said = Mock()
    assert in_parallel(lambda k: k + 10, [3, 1, 2], said, "adding") == [13, 11, 12]
    assert said.call_args.args[0] == 1.0


def test_boxes_and_medians():
    found = summary(np.tile(np.arange(101.0)[:, None], (1, 3)))
    assert plain(found)["median"] == [50.0] * 3
    assert plain(found)["box"] == [50.0] * 3
    assert plain({"x": np.float64(1.23456), "n": np.int64(12345), "i": np.inf}) == {"x": 1.235, "n": 12345, "i": None}


def test_every_experiment_has_results_and_the_page_is_as_they_make_it():
    pages = [page.read_text(encoding="utf-8") for page in PAGES]
    shown = [sum(f"<!-- /{name} -->" in page for page in pages) for name in EXPERIMENTS]
    lacking = [n for n, count in zip(EXPERIMENTS, shown, strict=True) if Output().read(n) is None or count != 1]
    assert lacking == [], "run `make paper PAPER=name`"
    for page in pages:
        assert renewed(page, Output()) == page, "the page is not that of the results: python -m benchmarks.paper.page"


def test_nominal_errors_are_of_the_papers_size():
    body = Output().read("prediction")
    ratio = np.array(body["errors"]["nominal"]["smooth mean"]) / PAPER["nominal"][0]
    assert np.all((ratio > 0.8) & (ratio < 1.25))


@pytest.mark.parametrize("experiment", [pitch, figure8, uncertainty])
def test_rows_that_are_missing_are_kept_one_by_one(experiment, monkeypatch):
    """Where the run is interrupted, what was made before is in the results already."""
    kept = Output().read(experiment.__name__.split(".")[-1])
    kept.pop("corrected", None)
    for name in ("knowledge", "own", "one", "on_engine", "summary"):
        monkeypatch.setattr(experiment, name, Mock(return_value=(np.arange(5.0), np.ones((5, 3)))), raising=False)
    monkeypatch.setattr(figure8, "on_engine", Mock(return_value={m.ALL_TOGETHER.name: np.ones(3)}))
    monkeypatch.setattr(uncertainty.corrected, "one", Mock(side_effect=[{"a": {}}, {"b": {}}, KeyboardInterrupt]))
    sizes = []
    with pytest.raises(KeyboardInterrupt) if experiment is uncertainty else nullcontext():
        experiment.missing(kept, Mock(), lambda body: sizes.append(len(str(body))))
    assert sizes == sorted(sizes)
    assert len(sizes) == (2 if experiment is uncertainty else len(sizes))
    if experiment is not uncertainty:
        assert m.ALL_TOGETHER.name in kept["rows" if experiment is pitch else "own"]


def test_corrected_steps_are_judged_beside_the_uncompensated():
    rest = [0.1] * (len(VARIANTS) - 3)
    found = {
        "0": {
            name: {"lost": 0.0, "late": late, "swing": 0.001}
            for name, late in zip(VARIANTS, (0.3, 0.1, 0.01, *rest), strict=True)
        },
        "1": {
            name: {"lost": 0.0, "late": late, "swing": 0.03}
            for name, late in zip(VARIANTS, (0.2, 0.22, 0.01, *rest), strict=True)
        },
    }
    found["1"][COMBINED] = {"lost": 1.0, "late": float("inf"), "swing": float("inf")}
    lines = tables(found).splitlines()[2:]
    assert lines[1].split("|")[2:6] == [" 0 ", " 1 ", " 1.10 ", " 0.160 "]
    assert lines[2].split("|")[2:6] == [" 1 ", " 0 ", " 0.03 ", " 0.010 "]


def test_effects_process_and_observer_are_one_object(known):
    """On top of what is named, with the bandwidth of the same log."""
    model = known.model.with_effects([make_effect(known.model.vehicle, "com_offset", (0.0, 0.007, -0.006))])
    vars(known)["explanation"] = Mock(model=model)
    made = m.ALL_TOGETHER.build(known)
    assert made.feedforward.physics is not None
    assert made.bandwidth_hz == pytest.approx(known.gp(physics=True, guarded=True).provenance.observer_hz)


@pytest.mark.parametrize("lag", [0.0, 0.06])
def test_indi_given_the_lag_of_a_vehicle_expects_all_of_it_and_a_constant_besides(known, lag, monkeypatch):
    """Behind a first-order lag alone, of a ramp, the torque is lag x slope short; a disturbance comes on top."""
    record, dt, slope, push = known.flights[0].records[0], known.flights[0].records[0].dt_kept, 0.2, 0.03
    ramp = np.zeros((len(record), 6))
    ramp[:, 3] = slope * dt * np.arange(len(record))
    measured = ramp.copy()
    measured[:, 3] += push - slope * lag
    asked = replace(record, measured=measured)
    monkeypatch.setattr(m, "nominal", lambda known, record: ramp)
    expected = m._increments(known, asked, 16.0, lag)
    np.testing.assert_allclose(expected[-1], [push - slope * lag, 0.0, 0.0], atol=1e-9)


def test_indi_and_l1_fly_with_the_cut_offs_that_other_vehicles_chose():
    rows = Output().read("feedback")["rows"]
    assert {law: feedback.chosen(rows, law) for law in m.CUTOFFS_HZ} == m.CUTOFFS_HZ
    lost = [
        {"law": "L1", "hz": 1.0, "10 ms": 0.02, "25 ms": 0.03},
        {"law": "L1", "hz": 2.0, "10 ms": 0.01, "25 ms": None},
    ]
    assert feedback.chosen(lost, "L1") == 1.0
    assert feedback.chosen(lost[1:], "L1") is None
