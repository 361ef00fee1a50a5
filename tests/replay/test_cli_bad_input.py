"""Bad input of every kind: exit code 2, one line on standard error, no file left behind."""

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.core import TyperGroup

import wrenchgap as wg
from wrenchgap import flight
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.plant.effect_values import with_values
from wrenchgap.plant.trajectory import file as trajectory_file
from wrenchgap.plant.trajectory.file import TrajectoryFile
from wrenchgap.plant.trajectory.maneuvers import Moves, Tilt
from wrenchgap.replay.cli.main import app, report

MODEL = "tilt_hexarotor"
ROOT = Path(__file__).resolve().parents[2]
PLACES = {"MODEL": MODEL, "HEXA": f"-m {MODEL}", "OUT": "--json out.json --figure out.png --csv out.csv"}
"""What stands for what in CASES, beside LOG and TRAIN, the logs, and @NAME, a file of the fixture `spoilt`."""

STARTED = "from wrenchgap.__main__ import main; main()"

CASES = {
    "compare gone.mcap HEXA OUT": "gone.mcap | no such file",
    "compare @empty.mcap HEXA OUT": "empty.mcap | empty",
    "compare @cut.mcap HEXA OUT": "cut.mcap",
    "compare @notes.txt HEXA OUT": "notes.txt",
    "explain @notes.mcap HEXA --json out.json": "notes.mcap",
    "compare @no_imu.mcap HEXA OUT": "imu | --topic",
    "learn @no_command.mcap HEXA -o out.gp": "commanded | --topic",
    "compare @nan_imu.mcap HEXA OUT": "imu",
    "compare LOG HEXA --cutoff 0.01 OUT": "too short",
    "compare LOG -m @massless.toml OUT": "massless.toml | mass | missing",
    "add com_offset -m @negative.toml --from LOG -o out.toml": "negative.toml | mass | -4",
    "compare LOG -m @weight.toml OUT": "weight | mass",
    "add witchcraft HEXA --from LOG -o out.toml": "witchcraft | com_offset",
    "explain LOG HEXA --effects-only witchcraft --json out.json": "witchcraft | com_offset",
    "add com_ofset HEXA --from LOG -o out.toml": "com_ofset | did you mean 'com_offset'?",
    "compare LOG -m tilt_hexrotor OUT": "tilt_hexrotor | did you mean 'tilt_hexarotor'?",
    "compare LOG HEXA --topic imu=/imuu OUT": "/imuu | did you mean '/imu'?",
    "remove servo_lag HEXA -o out.toml": "servo_lag | none",
    "simulate HEXA -t hover --hide com_offset=q:1 -o out.mcap": "'q' | x, y, z",
    "simulate HEXA -t hover --hide com_offset=x:much -o out.mcap": "much | not a number",
    "simulate HEXA -t hover --hide wind=velocity_x:3 -o out.mcap": "wind: has no force of its own | body_drag",
    "simulate HEXA -t looping -o out.mcap": "looping | figure8",
    "simulate HEXA -t hover -o out.bag": "out.bag | .mcap",
    "simulate HEXA -t @long.toml -o out.mcap": "long.toml: lasts 20000 s | at most 3600 s",
    "compare LOG -m @another.toml --gp @some.gp OUT": "another | tilt_hexarotor | wrenchgap learn",
    "compare LOG HEXA --gp TRAIN OUT": "train.mcap | GP",
    "compare LOG -m crazyflie OUT": "rotor speeds | crazyflie",
    "explain LOG HEXA --validate LOG --json out.json": "same flight",
    "add com_offset HEXA --from LOG -o kept.html": "kept.html | --force",
    "compare LOG HEXA --json kept.html": "kept.html | --force",
    "learn LOG HEXA -o LOG --force": "one of the inputs",
    "compare LOG -m @round.toml": "round.toml | leads back to itself",
    "add mass HEXA --from LOG -o @round.toml --force": "round.toml | leads back to itself",
    "inspect LOG --json @round.toml --force": "round.toml | leads back to itself",
    "export -m MODEL -o @round.toml --force": "round.toml | leads back to itself",
    "inspect LOG -m @logs/tuned.toml --json @logs/tuned.toml --force": "one of the inputs",
    "simulate -m @logs/tuned.toml -t hover -o s.mcap --json @logs/tuned.toml --force": "one of the inputs",
    "simulate HEXA -t hover -o s.mcap --hide mass=0.1 --truth s.mcap": "--truth s.mcap",
    "add com_offset -m @logs/tuned.toml -o n.toml --from LOG --json @logs/tuned.toml --force": "one of the inputs",
    "calibrate LOG -m @logs/tuned.toml -o n.toml --json @logs/tuned.toml --force": "one of the inputs",
    "compare @logs HEXA --json @logs/a.mcap --force": "one of the inputs",
    "where @logs HEXA --json @logs/a.mcap --force": "one of the inputs",
    "report @logs HEXA -o r.html --json @logs/a.mcap --force": "one of the inputs",
    "calibrate LOG --validate @logs HEXA -o n.toml --json @logs/a.mcap --force": "one of the inputs",
    "simulate HEXA -t hover --duration 2 --effects @mine.py -o s.mcap --json @mine.py --force": "one of the inputs",
    "add field_torque HEXA --from LOG --effects @mine.py -o @mine.py --force": "one of the inputs",
    "ready LOG HEXA --for @logs/still.toml --json @logs/still.toml --force": "one of the inputs",
    "ready LOG HEXA": "Missing option '--for', as in `wrenchgap ready ",
    "ready LOG HEXA --for step": "step: jumps, or moves too fast | 0.98 s | slower",
    "ready LOG HEXA --for @long.toml": "lasts 20000 s; expected at most 600 s",
    "simulate -m @logs/bench.toml -t hover -o s.mcap --json @logs/bench.csv --force": "one of the inputs",
    "effectiveness @logs/bench.toml --csv @logs/bench.csv --force": "one of the inputs",
    "add mass -m @logs/bench.toml --from LOG -o @logs/bench.csv --force": "one of the inputs",
    "model new --from @logs/quad.xml -o n.toml --json @logs/hull.xml --force": "one of the inputs",
    "model new --from @logs/quad.xml -o @logs/hull.xml --force": "one of the inputs",
    "convert @a.mcap @logs/a.mcap -o @logs": "written as a.mcap | convert them apart",
    "export @some.gp HEXA -o c --dt 1e6": "dt is 1e+06 s | at most",
    "export @logs/Makefile HEXA -o @logs --force": "Makefile, which is read | another folder",
    "compare LOG HEXA --json nowhere/out.json": "nowhere | does not exist",
    "inspect LOG --topic /imu": "ROLE=/TOPIC",
    "inspect LOG --topic imu=/nope --json out.json": "/nope | /imu",
    "learn LOG HEXA --restarts 99999999999999999999 -o out.gp": "--restarts | 1000",
    "learn LOG HEXA --outputs torque_w -o out.gp": "torque_w | torque_x",
    "learn LOG HEXA --mean physics -o out.gp": "--mean physics | tilt_hexarotor | wrenchgap explain | --mean zero",
    "learn LOG HEXA --mean cubic -o out.gp": "cubic | physics | zero",
    "learn LOG HEXA --inputs past,weather -o out.gp": "weather | velocity, rates, position, past",
    "learn LOG HEXA --inputs past,rates,past -o out.gp": "past | twice",
    "learn @no_pose.mcap HEXA --inputs velocity -o out.gp": "velocity | odometry | --inputs",
    "learn LOG -m @sag.toml -o out.gp": "battery_sag | --topic battery | wrenchgap remove battery_sag",
    "counterfactual LOG HEXA --with battery_sag=2,0.08 --json out.json": "battery_sag | --topic battery",
    "replay LOG HEXA --gp @some.gp --lead 0.05 -o out.mcap": "--lead | without physics | wrenchgap add",
    "replay LOG HEXA --gp @some.gp --cutoff 0 -o out.mcap": "--cutoff 0: expected a positive number of Hz",
    "design mass tether HEXA -o x.toml --unmeasured force_w": "--unmeasured: 'force_w' is no axis",
    "counterfactual LOG HEXA --gp @some.gp --lead 0.05 -o out.mcap": "--lead | without physics | wrenchgap add",
    "counterfactual LOG HEXA --lead 0.05 -o out.mcap": "--lead 0.05 | --gp",
    "counterfactual LOG HEXA --allocation tilt_hexarotor -o out.mcap": "is the nominal one | wrenchgap add",
    "counterfactual @no_pose.mcap HEXA --json out.json": "no topic plays the role 'odometry' | --topic odometry=",
    "counterfactual @no_reference.mcap HEXA --json out.json": "no topic plays the role 'reference'",
    "counterfactual LOG HEXA --start 50 --json out.json": "can be re-simulated within 0.0",
    "counterfactual LOG HEXA --start -1 --json out.json": "expected seconds since",
    "counterfactual LOG HEXA --duration 0 --json out.json": "expected a positive number",
    "compare LOG HEXA --between 100:200 OUT": "between 100 and 200 s; the flight lasts from",
    "compare LOG HEXA --cutoff -1 OUT": "--cutoff -1",
    "compare LOG HEXA --cutoff 1e-308 OUT": "too short",
    "compare LOG HEXA --cutoff 5e-324 OUT": "expected between 0 and",
    "view LOG HEXA --save-to=": "--save-to: is empty",
    "inspect LOG --topic imu=/imu[0:99999999999]": "columns '0:99999999999' | numbers below 100,000",
    "inspect LOG -m @columns.toml": "selects more than 256 columns",
    "inspect LOG --topic imu=/imu:stamp*1e12 --json out.json": "/imu:stamp*1e12 | a unit in which they are times",
    "compare LOG HEXA --csv -": "--csv -: --json alone writes to standard output",
    "explain LOG HEXA --effects-only ,": "',': names nothing, or one twice",
    "trend LOG TRAIN HEXA --fit mass,mass": "'mass,mass': names nothing, or one twice",
    "trend LOG TRAIN HEXA --vehicle alpha": "--vehicle alpha: does nothing with logs",
    "compare LOG HEXA --topic imu=/imu:stamp*1e12": "/imu:stamp*1e12 | a unit in which they are times",
    "simulate HEXA -t hover --hide com_offset=x:0.001,x:0.002 -o out.mcap": "a parameter is given twice",
    "ready LOG HEXA --for hover --duration 1e-9": "--duration 1e-09: expected 1 to 600 s",
    "simulate HEXA -t hover --duration 1e-9 -o out.mcap": "two control periods, 0.01 s",
    "counterfactual LOG HEXA --gains integral=0 integral=0.1": "--gains integral: given twice",
    "counterfactual LOG HEXA --gains omega_attitude=1e308": "--gains omega_attitude=1e308 | up to 1e+12",
    "compare LOG HEXA --colour": "--colour | wrenchgap compare --help",
    "compare LOG": "--model | wrenchgap compare --help",
    "explode": "explode | wrenchgap --help",
    "where gone.mcap HEXA": "gone.mcap",
    "where LOG -m no_such_model": "no_such_model",
    "where LOG HEXA --cutoff 0": "positive number of Hz",
    "where LOG HEXA --between 5:2": "T0 before T1",
    "where LOG HEXA --gp LOG": "mcap",
    "where LOG HEXA --figure LOG": "is one of the inputs",
    "where LOG HEXA --figure no/where.png": "does not exist",
    "where LOG HEXA --figure where.xyz": "--figure where.xyz | .png",
    "where LOG HEXA --json /proc/where.json": "/proc | cannot be written",
    "report LOG HEXA -o /proc/report.html": "/proc | cannot be written",
    "learn LOG HEXA -o /proc/torque.gp": "/proc | cannot be written",
    "where LOG LOG HEXA": "is the same flight",
    "report LOG HEXA -o kept.html": "exists already",
    "discover LOG HEXA -o law.toml": "--output law.toml | .py",
    "discover LOG HEXA -o gone/law.py": "does not exist",
    "discover LOG HEXA --validate LOG": "is the same flight",
    "discover LOG HEXA -o LOG": "is one of the inputs",
    "report LOG HEXA -o report.pdf": "expected a name that ends in .html",
    "report LOG HEXA -o gone/report.html": "does not exist",
    "report LOG HEXA -o new.html --gp gone.gp": "gone.gp",
    "report LOG HEXA -o new.html --validate gone.mcap": "gone.mcap",
    "design mass HEXA -o x.toml": "expected at least two different effects",
    "design mass nope HEXA -o x.toml": "'nope' is not in the catalogue",
    "design mass tether HEXA -o x.toml --room 4,4": "--room 4,4: expected three lengths in metres",
    "design mass tether HEXA -o x.toml --room 4,4,-1": "expected three positive lengths",
    "design mass tether HEXA -o x.toml --duration 1": "--duration 1: expected 8 to 120 s",
    "design mass tether HEXA -o x.toml --max-tilt 0": "largest tilt: got 0 deg",
    "design mass tether HEXA -o x.toml --also nope": "'nope' is not in the catalogue",
    "design mass tether HEXA -o x.txt": "expected a name that ends in .toml",
    "design mass tether HEXA -o x.toml --from gone.mcap": "gone.mcap",
    "simulate HEXA -t @tilt.toml --duration 2 -o x.mcap": "--duration: tilt.toml sets its own duration",
    "simulate HEXA -t @tilt.toml --excitation 1 -o x.mcap": "leave --excitation out",
    "simulate HEXA -t hover --excitation 1e308 -o x.mcap": "--excitation 1e+308: expected 0 to 1000; 1 is usual",
    "simulate HEXA -t hover --excitation nan -o x.mcap": "--excitation nan: expected 0 to 1000",
    "simulate -m crazyflie -t @tilt.toml -o x.mcap": "can only push along its z axis",
    "simulate HEXA -t gone.toml -o x.mcap": "gone.toml: cannot be read as a trajectory file",
    "inspect LOG HEXA --shift commanded=0.01": "command_delay",
    "history gone.toml": "gone.toml",
    "view none.mcap HEXA": "none.mcap: no such file",
    "view LOG -m no_such_model": "no_such_model",
    "view LOG HEXA --against no_such_model": "no_such_model",
    "view LOG HEXA --gp none.gp": "none.gp: no such file",
    "view LOG HEXA --view none.json": "none.json: cannot be read",
    "view LOG HEXA --view @bad.json": "not JSON",
    "view LOG HEXA --between 9:3": "expected T0:T1",
    "view LOG HEXA --host 192.0.2.1": "cannot listen there",
    "view LOG HEXA --port 70000": "65535",
}
"""Commands, and what their one line says, parts between bars."""


@pytest.fixture(scope="session")
def spoilt(logs, tmp_path_factory):
    """A folder of files that each lack something, and a GP of torques on the nominal vehicle."""
    folder = tmp_path_factory.mktemp("spoilt")
    (folder / "empty.mcap").write_bytes(b"")
    (folder / "cut.mcap").write_bytes(logs.train.read_bytes()[:300])
    (folder / "round.toml").symlink_to("round.toml")
    for name, text in (("notes.txt", "flew well\n"), ("notes.mcap", "flew well\n" * 100), ("bad.json", "{")):
        (folder / name).write_text(text)
    tilt = TrajectoryFile("tilt", Moves(4.0, (0.0, 0.0, 1.0), (Tilt(0.0, 4.0, np.radians(20.0), ramp=1.0),)))
    (folder / "tilt.toml").write_text(trajectory_file.dumps(tilt))
    still = TrajectoryFile("long", Moves(20000.0, (0.0, 0.0, 1.0), ()))
    (folder / "long.toml").write_text(trajectory_file.dumps(still))
    flown = flight.load(logs.test)
    nan_imu = replace(flown.imu, omega_B=np.full_like(flown.imu.omega_B, np.nan))
    for name, lacks in {
        "no_imu": {"imu": None, "odometry": None},
        "no_command": {"commanded": None, "desired": None, "actuators": None},
        "nan_imu": {"imu": nan_imu, "odometry": None},
        "no_pose": {"odometry": None},
        "no_reference": {"reference": None},
    }.items():
        flight.write(replace(flown, **lacks), folder / f"{name}.mcap")
    own = re.search(r"```python\n(.*?)```", (ROOT / "docs/effects/your-own.md").read_text(encoding="utf-8"), re.DOTALL)
    (folder / "mine.py").write_text(own[1], encoding="utf-8")
    text = (ROOT / "models" / f"{MODEL}.toml").read_text(encoding="utf-8")
    for name, old, new in (
        ("massless", "mass = 4.0 ", "# "),
        ("negative", "mass = 4.0 ", "mass = -4.0 "),
        ("weight", "mass = 4.0 ", "mass = 4.0\nweight = 40.0 "),
        ("another", f'name = "{MODEL}"', 'name = "another"'),
        ("columns", 'imu = "/imu"', 'imu = "/imu[0:99999]"'),
    ):
        assert old in text
        (folder / f"{name}.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    (folder / "logs").mkdir()
    for place in (folder, folder / "logs"):
        (place / "a.mcap").write_bytes(logs.test.read_bytes())
    (folder / "logs" / "tuned.toml").write_text(text, encoding="utf-8")
    (folder / "logs" / "still.toml").write_text((folder / "tilt.toml").read_text())
    curve = '\n[command]\nunit = "normalised"\ntable = "bench.csv"\n'
    (folder / "logs" / "bench.toml").write_text(text + curve, encoding="utf-8")
    (folder / "logs" / "bench.csv").write_text("command,thrust\n0,0\n0.5,4\n1,11.25\n")
    hexarotor = wg.export_model(wg.load_model(MODEL), "mjcf").text
    included = hexarotor.replace("<worldbody>", '<include file="hull.xml"/><worldbody>', 1)
    (folder / "logs" / "quad.xml").write_text(included, encoding="utf-8")
    (folder / "logs" / "hull.xml").write_text("<mujoco><default/></mujoco>")
    model = wg.load_model(MODEL)
    wg.save_model(with_values(model, ["battery_sag=2.0,0.08"]), folder / "sag.toml")
    (folder / "logs" / "Makefile").write_text("a process under a name that an export has")
    few = FitSettings(points=20, restarts=0)
    wg.save_gp(wg.learn_gp(wg.open_flights(logs.ideal, model), model, settings=few, guard=False), folder / "some.gp")
    return folder


@pytest.mark.parametrize("case", CASES)
def test_bad_input_gets_one_line_and_leaves_nothing(case, spoilt, logs, refused, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(spoilt / "cache"))
    (tmp_path / "kept.html").write_text("kept")
    places = PLACES | {"LOG": str(logs.test), "TRAIN": str(logs.train)}
    before = {
        path: path.read_bytes() for folder in (tmp_path, logs.folder, spoilt / "logs") for path in folder.iterdir()
    }
    words = " ".join(places.get(word, word) for word in case.split()).replace("@", f"{spoilt}/")
    line = refused(*words.split())
    for word in CASES[case].split(" | "):
        assert word in line
    after = {
        path: path.read_bytes() for folder in (tmp_path, logs.folder, spoilt / "logs") for path in folder.iterdir()
    }
    assert after == before


def test_a_real_process_says_one_line_too(tmp_path):
    command = [sys.executable, "-m", "wrenchgap", "compare", str(tmp_path / "gone.mcap"), "-m", MODEL]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)


@pytest.mark.parametrize("words", [["compare", "", "-m", MODEL], ["compare", "gone.mcap", "-m", ""]])
def test_an_empty_argument_is_not_the_working_folder(words, refused):
    assert "is empty" in refused(*words)


@pytest.mark.skipif(os.name != "posix", reason="removes the working folder")
def test_a_working_folder_that_is_gone_is_told(tmp_path):
    said = (
        f'mkdir gone && cd gone && rmdir ../gone && exec {sys.executable} -P -c "{STARTED}" compare a.mcap -m {MODEL}'
    )
    done = subprocess.run(["sh", "-c", said], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "wrenchgap: the working folder cannot be used: No such file or directory; go to another one\n"


def test_settings_of_numba_in_the_working_folder_are_not_obeyed(tmp_path):
    """They name a folder from which compiled code is unpickled."""
    (tmp_path / ".numba_config.yaml").write_text("cache_dir: cache\n")
    said = [sys.executable, "-P", "-c", STARTED, "compare", "a.mcap", "-m", MODEL]
    done = subprocess.run(said, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "wrenchgap: the working folder cannot be used: its .numba_config.yaml would be obeyed; take it away, or go to "
        "another one\n"
    )
    assert [path.name for path in tmp_path.iterdir()] == [".numba_config.yaml"]


def real(said, folder):
    """A real process, started by a shell so that it has an environment and limits of its own, and no setting of numba
    that another test's work left behind.
    """
    own = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "MPL"))}
    command = ["sh", "-c", said]
    return subprocess.run(command, cwd=folder, env=own, capture_output=True, text=True, check=False, timeout=60)


@pytest.mark.parametrize(
    "setting",
    [
        *("NUMBA_DISABLE_JIT=1", "NUMBA_NUM_THREADS=0", "NUMBA_NUM_THREADS=many"),
        pytest.param("MPLBACKEND=nonsense", marks=pytest.mark.slow),
    ],
)
def test_a_setting_that_a_library_refuses_is_named(setting, logs, tmp_path):
    done = real(f"{setting} {sys.executable} -m wrenchgap compare {logs.test} -m {MODEL} -q --figure f.png", tmp_path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert f"failed where {setting} is set in the environment" in done.stderr
    assert "unset it" in done.stderr


def test_a_setting_of_dask_that_dask_refuses_is_named(logs, tmp_path):
    (tmp_path / "dask").mkdir()
    (tmp_path / "dask" / "own.yaml").write_text("distributed: [", encoding="utf-8")
    for setting in ("DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT=banana", f"DASK_CONFIG={tmp_path}/dask"):
        done = real(f"{setting} {sys.executable} -m wrenchgap batch inspect {logs.test} -m {MODEL} -o out -q", tmp_path)
        assert done.returncode == 2, done.stderr
        assert f"failed where {setting} is set in the environment" in done.stderr


def test_a_name_that_the_terminal_cannot_show_is_no_error(tmp_path):
    text = (ROOT / "models" / f"{MODEL}.toml").read_text(encoding="utf-8")
    named = text.replace(f'name = "{MODEL}"', 'name = "fl\u00fcg"', 1)
    (tmp_path / "m.toml").write_text(named, encoding="utf-8")
    done = real(f"PYTHONIOENCODING=ascii {sys.executable} -m wrenchgap model show m.toml", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "fl?g" in done.stdout


@pytest.mark.skipif(sys.platform != "linux", reason="macOS knows no limit of address space")
def test_too_little_address_space_is_told_and_not_waited_for(tmp_path):
    done = real(f"ulimit -v 400000; {sys.executable} -m wrenchgap inspect gone.mcap", tmp_path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert re.search(r"limit of address space is 400000 kB; expected \d+ kB .*`ulimit -v unlimited`", done.stderr)


def test_running_out_of_memory_is_no_fault_of_the_program(capsys):
    assert report(MemoryError()) == 2
    assert capsys.readouterr().err.startswith("wrenchgap: out of memory; use fewer or shorter logs, or raise the limit")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_while_a_class_is_made_is_an_interrupt(number, capsys, monkeypatch):
    class Field:
        def __set_name__(self, owner, name):
            interrupt = KeyboardInterrupt()
            interrupt.code = 128 + number
            raise interrupt

    def command(*_):
        type("Encoded", (), {"fields": Field()})

    monkeypatch.setattr(TyperGroup, "invoke", command)
    with pytest.raises(SystemExit) as ended:
        app(["inspect", "gone.mcap"])
    assert ended.value.code == 128 + number
    assert capsys.readouterr().err == "wrenchgap: interrupted; nothing was left half-written\n"


def test_json_to_standard_output_is_all_that_is_there(logs, run, tmp_path):
    """In a real process too, of which a date of builds that is no number is no business."""
    compare = f"compare {logs.test} -m {MODEL} --figure f.png --json -"
    done = real(f"SOURCE_DATE_EPOCH=x {sys.executable} -m wrenchgap {compare}", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    for words, text in [(compare, done.stdout)] + [
        (words, run(*words.split()).stdout)
        for words in (f"inspect {logs.test} --json -", f"model show {MODEL} --json -")
    ]:
        assert json.loads(text)["schema"].startswith(f"wrenchgap.{words.split()[0]}/")
    assert [path.name for path in tmp_path.iterdir()] == ["f.png"]


def test_one_run_removes_damaged_kernels_of_every_folder_of_ours(tmp_path):
    code = "from numba import njit\n@njit(cache=True)\ndef twice(x):\n    return 2 * x\n"
    for name in ("learn", "plant"):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}_kernel.py").write_text(code, encoding="utf-8")
    (tmp_path / "both.py").write_text(
        "import sys\nsys.path += ['learn', 'plant']\nimport learn_kernel, plant_kernel\n"
        "from wrenchgap.replay.cli.main import report\n"
        "try:\n    print(learn_kernel.twice(2), plant_kernel.twice(3))\n"
        "except Exception as error:\n    sys.exit(report(error))\n"
    )
    said = f"NUMBA_CACHE_DIR={tmp_path}/kernels {sys.executable} both.py"
    assert real(said, tmp_path).stdout == "4 6\n"
    for index in (tmp_path / "kernels").rglob("*.nbi"):
        index.write_bytes(b"")
    other = tmp_path / "kernels" / "elsewhere_0" / "kernel.nbi"
    other.parent.mkdir()
    other.write_bytes(b"of another project")
    assert real(said, tmp_path).returncode == 2
    assert other.exists()
    assert real(said, tmp_path).stdout == "4 6\n"


@pytest.mark.slow
def test_kernels_that_cannot_be_read_back_are_removed_and_the_next_command_compiles_them(tmp_path):
    code = (
        "import sys\nfrom numba import njit\nfrom wrenchgap.replay.cli.main import report\n"
        "@njit(cache=True)\ndef twice(x):\n    return 2 * x\n"
        "try:\n    print(twice(2))\nexcept Exception as error:\n    sys.exit(report(error))\n"
    )
    (tmp_path / "kernel.py").write_text(code, encoding="utf-8")

    def run():
        env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
        command = [sys.executable, str(tmp_path / "kernel.py")]
        return subprocess.run(command, env=env, cwd=ROOT, capture_output=True, text=True, check=False)

    assert run().stdout == "4\n"
    [index] = (tmp_path / "kernels").rglob("*.nbi")
    for left in (b"", index.read_bytes()[:20], b"\x80garbage"):
        index.write_bytes(left)
        broken = run()
        assert (broken.returncode, broken.stdout, broken.stderr.count("\n")) == (2, "", 1)
        assert "kernels that were compiled before could not be read and were removed" in broken.stderr
    assert run().stdout == "4\n"


@pytest.mark.skipif(os.name != "posix", reason="closes descriptors by a shell")
@pytest.mark.parametrize(
    "closed", ["<&- >&- 2>&-", *(pytest.param(c, marks=pytest.mark.slow) for c in (">&-", "2>&-"))]
)
def test_closed_streams_are_no_fault(closed, logs, tmp_path):
    said = f"{sys.executable} -m wrenchgap inspect {logs.test} --json found.json {closed}"
    done = subprocess.run(["sh", "-c", said], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["found.json"]
    assert json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))["logs"]


def test_a_failed_write_leaves_no_partial_file(logs, refused, tmp_path, monkeypatch):
    def full(self, path, **options):
        Path(path).write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_csv", full)
    line = refused("compare", logs.test, "-m", MODEL, "--csv", "out.csv", "--quiet")
    assert "out.csv: cannot be written: No space left on device" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", ["explain", "compare", "inspect", "report -o r.html", "where", "view"])
def test_a_log_that_is_not_there_is_told_before_anything_heavy_is_imported(words, tmp_path):
    code = (
        "import sys\nfrom wrenchgap.replay.cli.main import app\n"
        "try:\n    app(sys.argv[1:])\n"
        "finally:\n    print(sorted({'numpy', 'scipy', 'viser'} & set(sys.modules)))"
    )
    command, *more = words.split()
    asked = [command, "gone.mcap", *more, *([] if command == "inspect" else ["-m", "crazyflie"])]
    done = subprocess.run(
        [sys.executable, "-c", code, *asked], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "gone.mcap: no such file or folder" in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout.strip() == "[]"
