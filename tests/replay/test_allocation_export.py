"""The corrected allocation as files: the wrench of the vehicle, written out by hand, at what C and Python answer."""

import importlib.util
import subprocess
from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from benchmarks.attacks.outputs import NASTY
from tests.compensate.test_allocator import FULL, model_of, weak, wrench_by_hand
from tests.plant.conftest import star
from tests.replay.exported_c import COMPILER, SANITISED, STRICT, needs_compiler
from wrenchgap.compensate.allocator import Left
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.replay.export import allocation

GAIN, ZERO, COM = np.where(np.arange(12) == 3, 0.9, 1.0), 0.05 * (np.arange(6) == 1), (0.004, -0.006, 0.01)
WEIGHT = np.array([0.0, 0.0, 4.0 * GRAVITY, 0.0, 0.0, 0.0])


def tilting():
    effects = {
        "rotor_thrust": {f"rotor_{r}": -0.1 * (r == 3) for r in range(12)},
        "tilt_offset": {f"arm_{a}": 0.05 * (a == 1) for a in range(6)},
        "com_offset": dict(zip("xyz", COM, strict=True)),
    }
    return model_of(star(), **effects)


def built(folder, *flags):
    sources = [folder / "wrenchgap_allocation.c", folder / "allocation_selftest.c"]
    words = [COMPILER, *STRICT, *flags, "-o", folder / "run", *sources, "-lm"]
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "run"


def answers(program, wanted, rotors, arms):
    """Thrusts, tilts, wrench made, margin and status of demands (N, 6)."""
    text = "\n".join(" ".join(repr(float(v)) for v in row) for row in wanted)
    done = subprocess.run([str(program), "-"], input=text, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rows = np.array([[float(v) for v in line.split()] for line in done.stdout.splitlines()])
    return np.split(rows, np.cumsum([rotors, arms, 6, 1]), axis=1)


@needs_compiler
@pytest.mark.parametrize(("precision", "near"), [("double", 1e-6), ("float", 2e-3)])
def test_the_vehicle_makes_what_the_c_was_asked_for(tmp_path, precision, near):
    model, rng = tilting(), np.random.default_rng(3)
    wg.export_allocation(model, tmp_path / "out", precision=precision)
    program = built(tmp_path / "out", *SANITISED)
    wanted = WEIGHT + rng.uniform(-1.0, 1.0, (60, 6)) * [15.0, 15.0, 8.0, 2.0, 2.0, 1.5]
    thrust, tilt, made, margin, status = answers(program, wanted, 12, 6)
    assert (status == 0).all()
    assert (margin > 0.0).all()
    by_hand = [wrench_by_hand(model.vehicle, t, a, GAIN, ZERO, COM) for t, a in zip(thrust, tilt, strict=True)]
    np.testing.assert_allclose(by_hand, wanted, atol=near)
    np.testing.assert_allclose(made, wanted, atol=near)
    assert subprocess.run([str(program)], check=False, capture_output=True).returncode == 0


@needs_compiler
@pytest.mark.parametrize("precision", ["double", "float"])
def test_whatever_is_asked_for_the_c_answers_within_the_limits(tmp_path, precision):
    """Huge and tiny numbers, none, and demands far out: thrusts within the rotors' limits, no undefined behaviour."""
    model = weak(6, 2, 0.8)
    slow = replace(model.vehicle.rotors, speed_min=np.full(6, 200.0))
    model = model_of(replace(model.vehicle, rotors=slow))
    wg.export_allocation(model, tmp_path / "out", precision=precision)
    program, rng = built(tmp_path / "out", *SANITISED), np.random.default_rng(4)
    odd = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1e308, -1e308, 1e38, 1e-320, 40.0, -3.0])
    wanted = np.vstack((rng.choice(odd, (400, 6)), WEIGHT + rng.normal(size=(200, 6)) * [50, 50, 50, 20, 20, 5]))
    thrust, tilt, made, margin, status = answers(program, wanted, 6, 6)
    least = 7.2e-6 * 200.0**2
    assert (thrust >= least * (1.0 - 1e-6)).all()
    assert (thrust <= FULL * (1.0 + 1e-6)).all()
    assert not tilt.any()
    assert np.isfinite(made).all()
    assert np.isfinite(margin).all()
    largest = float(np.finfo(np.float32 if precision == "float" else float).max)
    number = (np.abs(wanted) <= largest).all(axis=1)
    np.testing.assert_array_equal(status[:, 0] == 1, ~number)
    for k in np.flatnonzero(~number)[1:50]:
        np.testing.assert_array_equal(thrust[k], thrust[k - 1])


def module_at(path):
    spec = importlib.util.spec_from_file_location("written_allocation", path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def test_the_python_module_stands_alone_and_makes_the_same(tmp_path):
    model, rng = tilting(), np.random.default_rng(5)
    wg.export_allocation(model, tmp_path / "out")
    path = tmp_path / "out" / "wrenchgap_allocation.py"
    assert "import wrenchgap" not in path.read_text()
    written = module_at(path)
    for rounds in (None, 0):
        allocation = written.Allocation(rounds)
        for _ in range(5):
            wanted = WEIGHT + rng.uniform(-1.0, 1.0, 6) * [15.0, 15.0, 8.0, 2.0, 2.0, 1.5]
            out = allocation.allocate(wanted)
            assert out.status == written.MADE
            np.testing.assert_allclose(
                wrench_by_hand(model.vehicle, out.thrust, out.tilt, GAIN, ZERO, COM), wanted, atol=1e-6
            )
    again = allocation.allocate([np.nan] * 6)
    np.testing.assert_array_equal(again.thrust, out.thrust)
    assert again.status == written.BAD_DEMAND
    with pytest.raises(ValueError, match="expected 6 numbers"):
        allocation.allocate([1.0, 2.0])


@needs_compiler
def test_names_are_data_in_every_file(tmp_path):
    vehicle = star(6, coaxial=False)
    names = [*NASTY, "*/ int evil; /*", "# -*- coding: rot13 -*-", '"""', "\\"]
    for k in range(0, len(names), 6):
        some = (names[k : k + 6] + [""] * 6)[:6]
        model = model_of(replace(vehicle, name=names[k], rotor_names=tuple(some), arm_names=tuple(some)))
        made = wg.export_allocation(model, tmp_path / f"out{k}", command=names[k])
        built(tmp_path / f"out{k}")
        assert module_at(tmp_path / f"out{k}" / "wrenchgap_allocation.py").Allocation().allocate(WEIGHT).status == 0
        assert all(line.isprintable() for text in made.files.values() for line in text.replace("\t", "").split("\n"))


def test_no_allocation_is_written_where_a_rotor_is_at_the_limit_of_what_is_plausible(tmp_path):
    """A motor that has failed: the effect is left out, and the nominal allocation would use that motor fully."""
    model = wg.load_model("asymmetric_quadrotor")
    (effect,) = [make_effect(model.vehicle, "rotor_thrust", [0.0, 0.0, 0.0, -0.95])]
    fitted = model.with_effects([replace(effect, std=np.full(4, 0.01))])
    with pytest.raises(ModelError, match="rotor_thrust is at a limit"):
        wg.export_allocation(fitted, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert "what rotors make is not known" in str(wg.effectiveness(fitted))


def test_an_allocation_that_would_do_harm_by_the_model_itself_is_not_written(tmp_path, monkeypatch):
    worse = Left(nominal=np.array([0.1, 0.01]), corrected=np.array([0.2, 0.01]))
    monkeypatch.setattr(allocation, "left_by_model", lambda model, problem: worse)
    with pytest.raises(ModelError, match=r"leaves 0\.2 N and 0\.01 Nm of what is asked for, the nominal one 0\.1 N"):
        wg.export_allocation(tilting(), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@needs_compiler
@pytest.mark.parametrize("flag", ["-DWGA_ROUNDS=0", "-DWGA_CALM=WGA(0.0)"])
def test_the_choice_of_thrusts_can_be_made_when_it_is_built(tmp_path, flag):
    """Near the limits the pseudo-inverse leaves less of the weakest rotor than the largest margin."""
    wg.export_allocation(tilting(), tmp_path / "out")
    folder, wanted = tmp_path / "out", WEIGHT + np.array([[40.0, 0.0, 10.0, 3.0, 0.0, 1.0]])
    usual, chosen = (answers(built(folder, *flags), wanted, 12, 6)[3][0, 0] for flags in ((), (flag,)))
    assert chosen < usual - 0.01 if "ROUNDS" in flag else chosen >= usual - 1e-9


def test_what_is_there_stays_without_force(tmp_path):
    folder = tmp_path / "out"
    wg.export_allocation(tilting(), folder)
    with pytest.raises(UsageError, match="exists already"):
        wg.export_allocation(tilting(), folder)
    module_at(folder / "wrenchgap_allocation.py")
    (folder / "__pycache__").mkdir(exist_ok=True)  # of whoever imports the module there
    wg.export_allocation(tilting(), folder, force=True)
    (folder / "mine.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"mine\.txt, which this command did not write"):
        wg.export_allocation(tilting(), folder, force=True)
