"""What a notebook shows of results: an answer on one screen, and numbers by the names of the axes."""

import numpy as np
import pytest

from wrenchgap import add, calibrate, compare, explain, load_model, open_flights, simulate, where
from wrenchgap.flight import AXES, UsageError
from wrenchgap.plant.drafts.draft import Sheet

MODEL = load_model("asymmetric_quadrotor")
SCREEN, WIDTH = 34, 132
"""Lines and columns of a notebook's output that need no scrolling."""


@pytest.fixture(scope="module")
def flights():
    hidden = ["mass=added:0.1"]
    flown = [simulate(MODEL, "hover", duration=8, excitation=1, seed=s, hide=hidden, name=f"f{s}") for s in (1, 2)]
    return open_flights(flown, MODEL)


@pytest.fixture(scope="module")
def results(flights, small_processes):
    added = add(MODEL, "mass", flights)
    return {
        "add": added,
        "calibrate": calibrate(flights, MODEL),
        "compare": compare(flights, MODEL, added),
        "explain": explain(flights, MODEL, names=["mass", "com_offset"]),
        "where": where(flights, MODEL),
    }


def test_every_result_fits_a_screen_and_shows_no_arrays(results, flights):
    for name, result in results.items():
        lines = repr(result).splitlines()
        assert len(lines) <= SCREEN, name
        assert max(map(len, lines)) <= WIDTH, name
        assert "array(" not in repr(result), name
    for held in (flights, flights[0].flight):
        assert "array(" not in repr(held)
        assert len(repr(held)) < 3 * WIDTH


def test_the_screen_has_the_answer_and_print_has_all(results):
    shown, printed = repr(results["explain"]), str(results["explain"])
    assert shown.startswith("Explained by mass (added ")
    assert shown.endswith("print() shows all of it.")
    assert "held-out time of the given logs" in printed
    assert "held-out time of the given logs" not in shown
    assert repr(results["add"]) == str(results["add"]), "what is short is shown whole"


def test_numbers_by_the_name_of_the_axis(results):
    found = results["explain"]
    table = found.by_axis()
    assert tuple(table.index) == AXES
    assert table.loc["force_z", "unit"] == "N"
    assert table.loc["torque_y", "unit"] == "Nm"
    for k, axis in enumerate(AXES):
        assert table.loc[axis, "rms_after"] == found.rms_after[k]
    np.testing.assert_allclose(1.0 - table["rms_after"] / table["rms_before"], table["reduction"])
    assert {"nominal", "noise"} <= set(results["compare"].by_axis().columns)
    for name, result in results.items():
        assert len(result.by_axis()) == 6, name


def test_a_result_without_axes_says_which_have_them():
    with pytest.raises(UsageError, match="Sheet has no numbers of axes; results of compare, where, explain"):
        Sheet(MODEL).by_axis()
    with pytest.raises(UsageError, match="Sheet has no numbers of parameters; results of explain, add"):
        Sheet(MODEL).by_parameter()


def test_parameters_by_effect_and_name(results):
    for name in ("explain", "add"):
        one = results[name].by_parameter().loc[("mass", "added")]
        assert one["value"] == pytest.approx(0.1, abs=4 * one["std"])
        assert one["unit"] == "kg"
