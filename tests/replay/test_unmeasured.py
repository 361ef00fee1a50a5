"""Commands on a log whose accelerometer has no x and no y: nothing where nothing was measured, numbers elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap import flight, load_model, open_flights, simulate
from wrenchgap.replay.session.log_session import LogSession
from wrenchgap.replay.session.panels.failure import VIEWS
from wrenchgap.viewer.plots import plots_of

NAME = "asymmetric_quadrotor"
OPTION = ("--unmeasured", "force_x,force_y")
GONE = ["force_x", "force_y"]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """10 s with a heavier vehicle; white noise where the lateral specific force would be."""
    flown = simulate(load_model(NAME), "figure8", duration=10.0, excitation=1.0, seed=2, hide=("mass=added:0.1",))
    force = flown.imu.specific_force_B.copy()
    force[:, :2] = 0.5 * np.random.default_rng(0).standard_normal(force[:, :2].shape)
    noisy = replace(flown, imu=replace(flown.imu, specific_force_B=force))
    return flight.write(noisy, tmp_path_factory.mktemp("log") / "noisy.mcap")


def nothing_lateral(six):
    """Whether a list of six has null on the two axes, and numbers on the others."""
    return six[:2] == [None, None] and all(isinstance(v, float) for v in six[2:])


def test_inspect(log, result_of):
    (seen,) = result_of("inspect", log, "-m", NAME, *OPTION)["logs"]
    assert seen["unmeasured"] == GONE
    assert [r["axis"] for r in seen["timing"]["responses"]] == list(flight.AXES[2:])
    assert any("force_x, force_y (declared)" in c["words"] for c in seen["checks"])


def test_compare(log, result_of, run, tmp_path):
    found = result_of("compare", log, "-m", NAME, *OPTION, "--figure", tmp_path / "compare.png", "--csv", "all.csv")
    assert found["unmeasured"] == GONE
    assert nothing_lateral(found["noise"])
    for key in ("mean_abs", "std_abs", "rms", "max_abs"):
        assert nothing_lateral(found["models"][0][key])
    assert found["models"][0]["worst"][0]["axis"] not in GONE
    printed = " ".join(run("compare", log, "-m", NAME, *OPTION).stdout.split())
    assert "noisy: not measured, and left out everywhere: force_x, force_y (declared)." in printed
    assert "rms - - " in printed
    assert "nan" not in printed
    assert f"-m {NAME} --unmeasured force_x,force_y" in printed


def test_where(log, result_of, small_processes):
    found = result_of("where", log, "-m", NAME, *OPTION)
    assert found["unmeasured"] == GONE
    assert nothing_lateral(found["rms"])
    assert nothing_lateral(found["budget"]["mean_square"]["nominal"])


def test_add_writes_a_model_that_is_read_again(log, result_of, run, tmp_path):
    fitted = tmp_path / "fitted.toml"
    found = result_of("add", "mass", "-m", NAME, "--from", log, *OPTION, "-o", fitted)
    assert found["unmeasured"] == GONE
    assert nothing_lateral(found["held_out"]["rms_after"])
    assert load_model(fitted).effect("mass").theta[0] == pytest.approx(0.1, rel=0.1)
    assert np.isnan(load_model(fitted).history[-1].trial.after[:2]).all()
    assert run("history", fitted).exit_code == 0


def test_what_explain_says_to_do_next_leaves_them_out_too(log, run):
    done = run("explain", log, "-m", NAME, *OPTION, "--effects-only", "mass,thrust_scale")
    assert done.exit_code == 0, done.output
    (add,) = [
        line for line in " ".join(done.stdout.split()).split("next: ")[1:] if line.startswith("wrenchgap add mass")
    ]
    assert "--unmeasured force_x,force_y" in add


def test_learn_replay_and_counterfactual(log, result_of, tmp_path):
    gp = tmp_path / "residual.gp"
    words = ("--points", "30", "--restarts", "0", "--outputs", "wrench", "-o", gp, "--mean", "zero")
    learnt = result_of("learn", log, "-m", NAME, *OPTION, *words)
    assert learnt["outputs"] == list(flight.AXES[2:])
    assert learnt["unmeasured"] == GONE
    replayed = result_of("replay", log, "-m", NAME, *OPTION, "--gp", gp, "--between", "2:6", "--figure", "r.png")
    assert replayed["unmeasured"] == GONE
    assert nothing_lateral(replayed["measured_minus_predicted"])
    again = result_of("counterfactual", log, "-m", NAME, *OPTION)
    assert again["unmeasured"] == GONE
    assert nothing_lateral(again["disturbance"]["rms"])
    assert again["null_run"]["position_m_max"] < 0.05


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("force_w", "--unmeasured: 'force_w' is no axis; expected names out of force_x, force_y"),
        (",".join(flight.AXES), "--unmeasured: got all six axes"),
    ],
)
@pytest.mark.parametrize("command", ["inspect", "compare"])
def test_wrong_names(command, names, words, log, refused):
    assert words in refused(command, log, "-m", NAME, "--unmeasured", names)


def test_the_model_file_says_it(log, result_of, refused, tmp_path):
    text = load_model(NAME).text
    declaring, wrong = tmp_path / "declaring.toml", tmp_path / "wrong.toml"
    declaring.write_text(f'unmeasured = ["force_y", "force_x"]\n{text}', encoding="utf-8")
    wrong.write_text(f'unmeasured = ["lateral"]\n{text}', encoding="utf-8")
    assert load_model(declaring).unmeasured == ("force_x", "force_y")
    by_file = result_of("compare", log, "-m", declaring)
    by_option = result_of("compare", log, "-m", NAME, *OPTION)
    assert by_file["models"][0]["rms"] == by_option["models"][0]["rms"]
    assert "unmeasured: got ['lateral'], expected a list of at most five of force_x" in refused(
        "compare", log, "-m", wrong
    )


def test_the_viewer_draws_nothing_there(log):
    model = load_model(NAME)
    session = LogSession(open_flights(log, model, unmeasured=GONE), model)
    (name,) = session.flights
    lines = {p.title: [line.name for line in p.lines] for p in plots_of(session.scene(name))}
    assert "measured" not in lines["force x"]
    assert "measured" in lines["force z"]
    failure = session.failures.of(name)
    cell = failure.cells[0][0]
    known = dict(zip(VIEWS, np.isfinite(cell.rms), strict=True))
    assert [view for view, there in known.items() if not there] == GONE
    assert [a for a, e in zip(flight.AXES, failure.budget.nominal, strict=True) if np.isnan(e)] == GONE


def test_figures_of_a_flight_without_any_force(log):
    """Pictures with panels that have nothing to show."""
    from wrenchgap import add, compare, where

    model = load_model(NAME)
    opened = open_flights(log, model, unmeasured=flight.AXES[:3])
    for found in (compare(opened, model), where(opened, model), add(model, ["com_offset"], opened)):
        assert found.plot() is not None
