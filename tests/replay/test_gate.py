"""Every command asks: a bad log stops with one line, what is accepted goes on and stays on record."""

import json
import re
from dataclasses import replace

import pytest

import wrenchgap as wg
from wrenchgap.flight import LogError
from wrenchgap.flight.write import write

MODEL = "tilt_hexarotor"


@pytest.fixture(scope="module")
def in_g(logs, tmp_path_factory):
    """The training flight with its accelerometer in units of g."""
    one = wg.flight.load(logs.train)
    imu = replace(one.imu, specific_force_B=one.imu.specific_force_B / 9.80665)
    return write(replace(one, imu=imu), tmp_path_factory.mktemp("g") / "in_g.mcap")


@pytest.mark.parametrize(
    "command",
    [
        ("compare",), ("predict",), ("where",), ("explain",), ("learn", "-o", "x.gp"), ("report", "-o", "x.html"),
        ("trend",), ("counterfactual", "-o", "x.mcap"), ("view",),
    ],
)  # fmt: skip
def test_every_command_stops_at_a_bad_log(command, run, in_g):
    name, *rest = command
    done = run(name, in_g, "-m", MODEL, *rest)
    assert done.exit_code == 2, done.output
    (line,) = done.stderr.strip().splitlines()
    assert "accelerometer-unit" in line
    assert "--topic imu=/imu:g" in line
    assert "--accept accelerometer-unit" in line


def test_add_writes_no_model_from_a_bad_log(run, in_g, tmp_path):
    done = run("add", "com_offset", "-m", MODEL, "--from", in_g, "-o", "new.toml")
    assert done.exit_code == 2
    assert not (tmp_path / "new.toml").exists()


def test_the_proposed_option_mends_it(run, in_g, logs):
    mended = run("compare", in_g, "-m", MODEL, "--topic", "imu=/imu:g", "--json", "m.json")
    assert mended.exit_code == 0, mended.output
    right = run("compare", logs.train, "-m", MODEL, "--json", "r.json")
    assert right.exit_code == 0
    rms = [json.loads(open(p).read())["models"][0]["rms"] for p in ("m.json", "r.json")]  # noqa: PTH123, SIM115
    assert rms[0] == pytest.approx(rms[1], rel=1e-6)


def test_what_is_accepted_goes_on_and_stays_on_record(run, in_g):
    done = run(
        "compare",
        in_g,
        "-m",
        MODEL,
        "--accept",
        "accelerometer-unit,weight",
        "--accept",
        "force-unit",
        "--json",
        "a.json",
    )
    assert done.exit_code == 0, done.output
    answer = done.stdout.split("\n\n")[0].splitlines()
    assert any(line.startswith("check:") for line in answer), "before any table"
    assert "(accepted)" in done.stdout
    found = json.loads(open("a.json").read())["checks"]  # noqa: PTH123, SIM115
    (check,) = [c for c in found if c["name"] == "accelerometer-unit"]
    assert (check["level"], check["accepted"], check["flight"]) == ("bad", True, "in_g")
    assert "imu=/imu:g" in check["mend"]


def test_a_check_that_there_is_not_is_refused(run, logs):
    done = run("compare", logs.train, "-m", MODEL, "--accept", "gravity")
    assert done.exit_code == 2
    assert "no check is called so" in done.stderr


def test_inspect_shows_and_leaves_with_three(run, in_g, logs):
    done = run("inspect", in_g, "--json", "i.json")
    assert done.exit_code == 3
    assert "it is in units of g" in done.stdout
    assert json.loads(open("i.json").read())["logs"][0]["level"] == "bad"  # noqa: PTH123, SIM115
    assert run("inspect", in_g, "--accept", "accelerometer-unit").exit_code == 0
    assert run("inspect", logs.train).exit_code == 0


def test_python_is_asked_as_well(in_g, logs):
    with pytest.raises(LogError, match="accelerometer-unit"):
        wg.open_flights(in_g, wg.load_model(MODEL))
    bad = ["accelerometer-unit", "force-unit", "weight"]
    (one,) = wg.open_flights(in_g, wg.load_model(MODEL), accept=bad)
    assert next(c.name for c in one.checks if c.accepted) == "accelerometer-unit"
    compared = wg.compare(one, wg.load_model(MODEL))
    assert {"checks", "left_out"} <= set(compared.to_json())
    assert not any("Finding" in note for note in compared.to_json()["notes"])


def test_a_mapping_in_the_model_file_is_said_once(run, in_g, tmp_path):
    text, found = re.subn(r'^imu = ".*"', 'imu = "/imu:g"', wg.load_model(MODEL).text, flags=re.MULTILINE)
    text += "" if found else '\n[topics]\nimu = "/imu:g"\n'
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    done = run("compare", in_g, "-m", "mine.toml")
    assert done.exit_code == 0, done.output


def test_between_is_in_what_was_left_out(logs):
    (one,) = wg.open_flights(logs.train, wg.load_model(MODEL), between=(3.0, 12.0))
    left = wg.compare(one, wg.load_model(MODEL)).to_json()["left_out"]
    assert (left[0]["stop"], left[0]["why"]) == (3.0, "not asked for (--between)")
    assert left[0]["start"] is None
