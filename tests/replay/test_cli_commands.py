"""Every command does its job on simulated logs, and writes the JSON of its schema."""

import hashlib
import json
import math
import os
import signal
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from wrenchgap import _signals, flight
from wrenchgap.flight.flight import AXES
from wrenchgap.flight.roles import ROLE_PARTS
from wrenchgap.flight.write import provenance as log_provenance
from wrenchgap.learn.discover import law_file
from wrenchgap.learn.discover.atoms import atoms
from wrenchgap.learn.process import store
from wrenchgap.plant import model_file
from wrenchgap.plant.effects import catalogue
from wrenchgap.plant.trajectory import TRAJECTORIES
from wrenchgap.replay.cli import main as cli
from wrenchgap.replay.cli import values
from wrenchgap.replay.present.learning import caution

MODEL = "tilt_hexarotor"
ROOT = Path(__file__).resolve().parents[2]


def six(values):
    return len(values) == 6 and all(isinstance(v, float) and math.isfinite(v) for v in values)


def sha256(path):
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def head(result, command, *roles, version=1):
    """The keys that all results share; `result_of` holds every result against its schema."""
    assert result["schema"] == f"wrenchgap.{command}/{version}"
    assert result["version"] == model_file.tool_version()
    assert [i["role"] for i in result["inputs"]] == list(roles)
    assert all(given["sha256"] == sha256(given["file"]) for given in result["inputs"])


def test_compare_puts_models_side_by_side(logs, run, result_of, tmp_path):
    assert run("add", "-m", MODEL, "--value", "com_offset=-0.004,0.007,-0.005", "-o", "good.toml").exit_code == 0
    assert run("add", "-m", MODEL, "--value", "com_offset=x:0.004", "-o", "bad.toml").exit_code == 0
    result = result_of(
        *("compare", logs.train, logs.test, "-m", "good.toml", "--against", "bad.toml", MODEL),
        *("--figure", "c.png", "--csv", "c.csv"),
    )
    head(result, "compare", "log", "log", "model", "against", "against")
    assert result["axes"] == list(AXES)
    assert result["flights"] == ["train", "test"]
    models = {m["name"]: m for m in result["models"]}
    assert list(models) == ["nominal", "good", "bad", MODEL]
    for model in models.values():
        assert all(six(model[key]) for key in ("mean_abs", "std_abs", "rms", "max_abs", "fall_of_rms"))
        assert [f["flight"] for f in model["per_flight"]] == ["train", "test"]
        assert all(0.5 < s["stop"] - s["start"] < 1.5 for s in model["worst"])
        mean, std, rms = (np.array(model[key]) for key in ("mean_abs", "std_abs", "rms"))
        assert rms**2 == pytest.approx(mean**2 + std**2)
    assert models[MODEL]["rms"] == models["nominal"]["rms"]
    assert all(fall > 0.95 for fall in models["good"]["fall_of_rms"][3:])
    assert models["bad"]["fall_of_rms"][4] < 0
    for one, other in (("good.toml", "bad.toml"), ("bad.toml", "good.toml"), (MODEL, "good.toml")):
        told = run("compare", logs.test, "-m", one, "--against", other).output
        assert told.rstrip().endswith("-m good.toml"), "what is next goes on with the model that leaves least"
    floor = np.array(models["good"]["rms"]) / result["noise"]
    assert np.all((floor > 0.5) & (floor < 2.0))
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    lines = (tmp_path / "c.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) == result["samples"] + 1
    assert lines[0].startswith("flight,time,commanded.force_x")


def test_explain_names_what_was_hidden(logs, result_of):
    tried = "com_offset,thrust_scale,inertia"
    result = result_of("explain", logs.train, "-m", MODEL, "--validate", logs.test, "--effects-only", tried)
    head(result, "explain", "log", "validation", "model", version=2)
    assert result["effects"][0] == result["ranking"][0]["effect"] == "com_offset"
    assert {c["effect"] for c in result["ranking"]} == set(tried.split(","))
    for candidate in result["ranking"]:
        assert six(candidate["heldout_fall"])
        assert candidate["score"] <= 1.0
        assert all(set(p) == {"name", "value", "std", "unit"} for p in candidate["parameters"])
    found = {p["name"]: p["value"] for p in result["fitted"][0]["parameters"]}
    assert found == pytest.approx({"x": -0.004, "y": 0.007, "z": -0.005}, abs=2e-4)
    assert min(result["validation"]["fall"][3:]) > 0.9
    assert "com_offset" in result["summary"]


def test_explain_warns_of_a_validation_flight_outside_what_was_fitted(logs, run, result_of):
    assert run("simulate", "-m", MODEL, "-t", "hover", "--duration", 8, "-o", "hover.mcap").exit_code == 0
    result = result_of("explain", "hover.mcap", "-m", MODEL, "--validate", logs.test, "--effects-only", "com_offset")
    assert any("tilt" in warning and "test" in warning for warning in result["validation"]["warnings"])
    back = result_of("explain", logs.train, "-m", MODEL, "--validate", "hover.mcap", "--effects-only", "com_offset")
    assert not any("outside" in warning for warning in back["validation"]["warnings"])
    # the hovering vehicle has nothing hidden: what was named on the other one makes it worse, and that is said
    assert any("torque_x" in warning and "grows" in warning for warning in back["validation"]["warnings"])


def test_a_file_of_effects_that_is_not_as_it_was_is_said_by_every_command(run, tmp_path):
    """`export` and `ready` took the changed law for the fitted one without a word."""
    law = next(a for a in atoms(model_file.load(MODEL).vehicle) if a.name == "torque_w")
    text = law_file.source([law], {"SPAN": "0.3", "VOLTS": "15.0"}, [])
    (tmp_path / "law.py").write_text(text)
    own = ("--effects", "law.py")
    assert run("add", "-m", MODEL, "--value", "law_torque_w=-0.02", *own, "-o", "fitted.toml").exit_code == 0
    for content, said in ((text, 0), (f"{text}\n# changed\n", 1)):
        (tmp_path / "law.py").write_text(content)
        for command in (("export", "-m"), ("effectiveness",), ("write", "--to", "mjcf")):
            done = run(*command, "fitted.toml", *own, *(("-o", "out", "--force") if command[0] == "export" else ()))
            assert done.stdout.count("law.py is not as it was") == said, done.output


def test_a_model_may_be_changed_in_place_with_force(run, refused):
    assert run("add", "-m", MODEL, "--value", "servo_lag=tau:0.05", "-o", "m.toml").exit_code == 0
    assert "--force" in refused("remove", "servo_lag", "-m", "m.toml", "-o", "m.toml")
    assert run("remove", "servo_lag", "-m", "m.toml", "-o", "m.toml", "--force").exit_code == 0
    assert model_file.load("m.toml").effects == ()


def test_learn_predicts_an_unseen_flight_and_compare_uses_it(logs, run, result_of, tmp_path):
    """The torque of a displaced centre of mass, -c x F, is a straight line in the command, and that is said."""
    result = result_of(
        *("learn", logs.train, "-m", MODEL, "--validate", logs.test, "-o", "rest.gp"),
        *("--points", 60, "--restarts", 0, "--seed", 3),
    )
    head(result, "learn", "log", "validation", "model")
    assert result["outputs"] == ["torque_x", "torque_y", "torque_z"]
    assert result["points"] == 60
    assert result["spacing_s"] >= 1.0 / (2.0 * result["cutoff_hz"])
    assert result["conditioning"]["percentile_1"] <= result["conditioning"]["median"]
    unseen = {m["name"]: m for m in result["validation"]["models"]}
    assert min(unseen["nominal+GP"]["fall_of_rms"][3:]) > 0.6  # the paper's own figures are 62 to 74 %
    assert unseen["nominal+GP"]["rms"][:3] == unseen["nominal"]["rms"][:3]  # forces are left alone
    rms = {name: np.array(model["rms"][3:]) for name, model in unseen.items()}
    assert list(rms) == ["nominal", "constant offset", "linear in the command", "nominal+GP"]
    assert (rms["linear in the command"] < 0.05 * rms["nominal"]).all()
    assert (rms["constant offset"] > 5 * rms["linear in the command"]).all()
    (said,) = [w for w in result["warnings"] if "no advantage" in w]
    assert "torque_x, torque_y, torque_z" in said
    assert result["absorbs"]["effects"] == ["com_offset"]
    assert "wrenchgap add com_offset" in result["absorbs"]["summary"]
    first = result["absorbs"]["tried"][0]
    assert (first["effect"], first["named"]) == ("com_offset", True)
    assert first["share"] > 0.9
    kept = store.load(tmp_path / "rest.gp").provenance
    assert kept.vehicle == MODEL
    assert kept.logs[0].sha256 == sha256(logs.train)
    assert said in [caution(one) for one in kept.warnings]

    compared = result_of("compare", logs.test, "-m", MODEL, "--gp", "rest.gp", "--figure", "gp.png")
    assert compared["models"][1]["rms"] == pytest.approx(unseen["nominal+GP"]["rms"])
    assert compared["notes"] == result["notes"]
    other = result_of("compare", logs.test, "-m", MODEL, "--gp", "rest.gp", "--cutoff", 5)
    assert any("8 Hz" in note and "5 Hz" in note for note in other["notes"])

    run("add", "-m", MODEL, "--value", "com_offset=-0.004,0.007,-0.005", "-o", "good.toml")
    added = result_of("compare", logs.test, "-m", "good.toml", "--gp", "rest.gp")["models"]
    assert [m["name"] for m in added] == ["nominal", "good", "nominal+GP"]
    assert min(added[2]["fall_of_rms"][3:]) > 0.5  # on top of `good` it would count the offset twice


def test_inspect_reports_roles_and_checks_against_the_model(logs, result_of):
    result = result_of("inspect", logs.train, logs.test, "-m", MODEL)
    head(result, "inspect", "log", "log", "model", version=2)
    for log in result["logs"]:
        assert log["level"] == "ok"
        assert log["mapping"]["imu"] == "/imu"
        assert {"weight", "actuation", "actuators", "rotors", "inertia"} <= {c["name"] for c in log["model_checks"]}
        assert all(c["level"] == "ok" for c in log["model_checks"])
        assert {t["topic"] for t in log["topics"]} >= {"/imu", "/command/wrench", "/odometry"}


def test_inspect_keeps_in_a_model_how_it_read(logs, result_of, run):
    result = result_of(
        "inspect", logs.test, "-m", MODEL, "--shift", "odometry=-0.004", "--cutoff", "6", "-o", "kept.toml"
    )
    assert (result["model"], result["model_version"]) == ("kept.toml", 2)
    assert model_file.load("kept.toml").history[0].file == MODEL  # and no path of the installation
    said = run("inspect", logs.test, "-m", MODEL, "--topic", "imu=/imu", "--shift", "odometry=-0.004", "-o", "b.toml")
    assert "kept in b.toml: imu = /imu, shift of odometry -0.004 s\n" in said.output
    result = result_of("compare", logs.test, "-m", "kept.toml")
    assert (result["inputs"][0]["shift_s"], result["cutoff_hz"]) == ({"odometry": -0.004}, 6.0)
    for said, expected in (
        ((), "and what to keep"),
        (("--cutoff", "6", "-o", "kept.toml"), "kept.toml: exists already"),
    ):
        done = run("inspect", logs.test, "-m", MODEL, "-o", "other.toml", *said)
        assert done.exit_code == 2
        assert expected in done.output


def test_inspect_keeps_nothing_where_a_check_is_bad(logs, run, tmp_path):
    done = run("inspect", logs.test, "-m", MODEL, "--topic", "imu=/imu:frd", "-o", "kept.toml")
    assert done.exit_code == 3
    assert not (tmp_path / "kept.toml").exists()


def test_inspect_notices_the_wrong_vehicle(logs, run, tmp_path):
    text = (ROOT / "models" / f"{MODEL}.toml").read_text(encoding="utf-8")
    (tmp_path / "heavy.toml").write_text(text.replace("mass = 4.0 ", "mass = 5.0 "), encoding="utf-8")
    (tmp_path / "spun.toml").write_text(text.replace("c_f = 7.2e-6", "c_f = 5.0e-6"), encoding="utf-8")

    def checks(model):
        done = run("inspect", logs.train, "-m", model, "--json", "seen.json", "--force")
        found = json.loads((tmp_path / "seen.json").read_text(encoding="utf-8"))["logs"][0]["model_checks"]
        assert (done.exit_code == 3) == any(c["level"] == "bad" for c in found)
        return [(c["name"], c["level"]) for c in found]

    assert ("weight", "warn") in checks("heavy.toml")
    assert ("actuation", "warn") in checks("spun.toml")
    assert [level for _, level in checks("crazyflie")] == ["bad"]


def test_simulate_hides_what_it_is_told_to_hide(run, result_of, tmp_path):
    asked = ("simulate", "-m", "voliro_x", "-t", "pitch", "--duration", 4, "--seed", 5, "--no-integral")
    result = result_of(
        *asked, "--hide", "com_offset=x:0.004", "servo_lag=0.05", "-o", "a.mcap", "--truth", "truth.toml"
    )
    head(result, "simulate", "model")
    truth = model_file.load("truth.toml")
    assert [e.name for e in truth.effects] == ["com_offset", "servo_lag"]
    assert truth.effects[0].theta.tolist() == [0.004, 0.0, 0.0]
    said = log_provenance(tmp_path / "a.mcap")
    assert said["model"] == "voliro_x"
    assert not any("offset" in v or "lag" in v for v in (*said.values(), *map(str, result.values())))

    assert run(*asked, "--hide", "com_offset=x:0.004", "--hide", "servo_lag=0.05", "-o", "b.mcap").exit_code == 0
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    assert run(*asked, "-o", "c.mcap").exit_code == 0
    with_lag, without = flight.load("a.mcap"), flight.load("c.mcap")
    # A centre of mass 4 mm ahead turns the nose down, +y, by m g x; the controller holds it with the opposite torque.
    change = (with_lag.commanded.wrench_B - without.commanded.wrench_B)[:200, 4].mean()
    assert change == pytest.approx(-4.04 * 9.81 * 0.004, rel=0.1)


def test_every_shipped_vehicle_flies_as_its_own_model_says(run, result_of):
    for name in ("voliro_x", "crazyflie", "asymmetric_quadrotor", "variable_tilt_hexacopter"):
        log, trajectory = f"{name}.mcap", "pitch" if name == "voliro_x" else "circle"
        assert run("simulate", "-m", name, "-t", trajectory, "--duration", 6, "-o", log).exit_code == 0
        result = result_of("compare", log, "-m", name)
        assert np.all(np.array(result["models"][0]["rms"]) < 3.0 * np.array(result["noise"])), name


def test_quiet_prints_nothing(logs, run):
    done = run("compare", logs.test, "-m", MODEL, "--quiet")
    assert (done.exit_code, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("command", ["inspect", "simulate", "compare", "explain", "add", "remove", "learn"])
def test_help_of_every_command_has_an_example(run, command):
    done = run(command, "--help")
    assert done.exit_code == 0
    assert f"wrenchgap {command} " in done.stdout.split("Example:")[1]


def printed(code, **variables):
    """What a program prints in a process of its own."""
    environment = os.environ | variables
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, env=environment)
    return done.stdout


def test_help_loads_nothing_heavy():
    code = (
        "import sys; from wrenchgap.replay.cli import main as cli\n"
        "try: cli.app(['--help'])\n"
        "except SystemExit: pass\n"
        "print(sorted(m for m in ('numpy', 'scipy', 'pandas', 'matplotlib', 'GPy', 'rosbags') if m in sys.modules))"
    )
    assert printed(code).splitlines()[-1] == "[]"


def test_completion_knows_models_effects_and_trajectories():
    words = {"_WRENCHGAP_COMPLETE": "complete_bash", "COMP_WORDS": "wrenchgap compare -m vol", "COMP_CWORD": "3"}
    assert printed("from wrenchgap.replay.cli import main as cli; cli.main()", **words).split() == ["voliro_x"]


def test_completion_offers_what_is_there():
    assert {name for name, _ in values.complete_effects("")} == set(catalogue())
    assert values.complete_effects("com_o")[0][1].startswith("The centre of mass")
    assert values.complete_trajectories("") == list(TRAJECTORIES)
    assert set(values.ROLES) == {name for role, parts in ROLE_PARTS.items() for name in (role, *parts)}
    assert values.complete_topics("im") == ["imu="]


def test_completion_offers_no_name_that_a_shell_would_run(tmp_path, monkeypatch):
    """Shells put what is completed on the command line as it is, and zsh evaluates it even before."""
    monkeypatch.chdir(tmp_path)
    nasty = (
        "$(touch pwned)",
        "`id`",
        "a;id",
        "a b",
        "a\x1b]0;x\x07",
        "-rf",
        "a\\$(id)",
        "=id",
        "a|b",
        "~root",
        "a'b",
        "*",
    )
    for name in (*nasty, "fitted", "my_quad-2.1"):
        (tmp_path / f"{name}.toml").touch()
    assert set(values.complete_models("")) - {"fitted.toml", "my_quad-2.1.toml"} <= set(shipped_models())
    assert values.complete_models("f") == ["fitted.toml"]
    assert values.complete_trajectories("x/$") == []
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "$(id).toml").touch()
    (tmp_path / "x" / "ramp.toml").touch()
    assert values.complete_trajectories("x/r") == ["x/ramp.toml"]


def shipped_models():
    return [path.stem for path in (ROOT / "models").glob("*.toml")]


def test_a_fault_leaves_a_traceback_in_a_file(run, monkeypatch):
    monkeypatch.delenv("WRENCHGAP_DEBUG", raising=False)
    monkeypatch.setattr(model_file, "load", lambda name: 1 / 0)
    done = run("remove", "servo_lag", "-m", MODEL, "-o", "x.toml")
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    path = Path(next(word for word in line.split() if word.endswith(".txt")))
    assert "ZeroDivisionError" in path.read_text(encoding="utf-8")
    path.unlink()
    monkeypatch.setenv("WRENCHGAP_DEBUG", "1")
    assert "Traceback" in run("remove", "servo_lag", "-m", MODEL, "-o", "x.toml").stderr


def test_an_interrupt_is_one_line_and_130(run, monkeypatch):
    monkeypatch.setattr(model_file, "load", Mock(side_effect=KeyboardInterrupt))
    done = run("remove", "servo_lag", "-m", MODEL, "-o", "x.toml")
    assert (done.exit_code, len(done.stderr.splitlines())) == (130, 1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupt_while_the_command_line_is_read_is_one_line_too(number, run, monkeypatch):
    """Typer, which imports pydantic there, made it 130 without a word."""
    monkeypatch.setattr(cli.TyperGroup, "parse_args", Mock(side_effect=_signals.Interrupted(number)))
    done = run("remove", "servo_lag", "-m", MODEL, "-o", "x.toml")
    assert (done.exit_code, done.stderr) == (128 + number, "wrenchgap: interrupted\n")


def test_version_is_that_of_the_project(run):
    assert run("--version").stdout.split() == [cli.NAME, model_file.tool_version()]
