"""`model new`, `model show` and `calibrate` as a user calls them: from a PX4 log to a report, and what is refused."""

import importlib.util
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.plant import model_file
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.replay.present.model import hover_command
from wrenchgap.replay.session.log_session import LogSession

ROOT = Path(__file__).resolve().parents[2]
FULL, FACTOR = 9.0, 0.6
"""Thrust of one rotor at full throttle [N] and the shape of its curve, as the vehicle has them."""
PLACES = ((0.17, 0.2, 0.02), (-0.17, -0.2, 0.02), (0.17, -0.2, -0.02), (-0.17, 0.2, -0.02))
"""Forward, right, KM of the rotors, in PX4's order."""
MASS, INERTIA = 1.5, (0.02, 0.016, 0.032)
STAMP = "uint64_t timestamp"


def autopilots():
    """The tests' writer of ULog files."""
    path = ROOT / "tests" / "flight" / "formats" / "conftest.py"
    spec = importlib.util.spec_from_file_location("autopilots_conftest", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def true_vehicle():
    """The vehicle that flies, as a model file: PX4's numbers with left for right and up for down."""
    arms = "".join(
        f"[[vehicle.arms]]\nposition = [{x}, {-y}, 0.0]\nrotors = [{{ spin = {turn}, kappa = 0.02 }}]\n"
        for (x, y, _), turn in zip(PLACES, (1, 1, -1, -1), strict=True)
    )
    return model_file.loads(
        f'schema = 1\n[vehicle]\nname = "true"\nmass = {MASS}\ninertia = {list(INERTIA)}\n[vehicle.arm]\n'
        f"tilts = false\n[vehicle.rotor]\nc_f = 9.0e-6\nradius = 0.12\nspeed_max = 1000.0\n{arms}"
    )


def parameters():
    found = {"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 4, "THR_MDL_FAC": 0.0, "MPC_THR_HOVER": 0.5}
    for number, (x, y, km) in enumerate(PLACES):
        row = {"PX": x, "PY": y, "PZ": 0.0, "AX": 0.0, "AY": 0.0, "AZ": -1.0, "KM": km, "CT": 6.5}
        found |= {f"CA_ROTOR{number}_{key}": float(value) for key, value in row.items()}
    return found


def flipped(vectors):
    """Forward, left, up to forward, right, down, and back."""
    return vectors * [1.0, -1.0, -1.0]


def write_ulog(flown, path):
    """The flight as PX4 logs it: FRD and NED, microseconds, throttles."""
    log = autopilots().Ulog(parameters())
    imu, sent, odometry = flown.imu, flown.actuators, flown.odometry
    share = 9.0e-6 * sent.rotor_speed**2 / FULL
    u = (FACTOR - 1 + np.sqrt((1 - FACTOR) ** 2 + 4 * FACTOR * share)) / (2 * FACTOR)

    def micro(time):
        return np.round(1e6 * (5.0 + time)).astype(int)

    middle = np.full(len(imu.time), round(1e6 * float(np.median(np.diff(imu.time)))))
    columns = {"timestamp": micro(imu.time) + middle // 2, "gyro_rad": flipped(imu.omega_B)}
    columns |= {"accelerometer_m_s2": flipped(imu.specific_force_B), "gyro_integral_dt": middle}
    columns |= {"accelerometer_timestamp_relative": np.zeros(len(imu.time), int)}
    fields = f"{STAMP};float[3] gyro_rad;uint32_t gyro_integral_dt;int32_t accelerometer_timestamp_relative"
    log.topic("sensor_combined", f"{fields};float[3] accelerometer_m_s2", columns)
    log.topic("actuator_motors", f"{STAMP};float[4] control", {"timestamp": micro(sent.time), "control": u})
    w, x, y, z = odometry.quat_EB.T
    q = np.stack((w + z, x + y, x - y, w - z), axis=1) / np.sqrt(2.0)  # its own inverse
    log.topic("vehicle_attitude", f"{STAMP};float[4] q", {"timestamp": micro(odometry.time), "q": q})
    ned, velocity = (v[:, [1, 0, 2]] * [1.0, 1.0, -1.0] for v in (odometry.position_E, odometry.velocity_E))
    rows = dict(zip(("x", "y", "z", "vx", "vy", "vz"), np.hstack((ned, velocity)).T, strict=True))
    rows |= {"timestamp": micro(odometry.time)} | dict.fromkeys(("xy_valid", "z_valid"), np.ones(len(ned), bool))
    fields = f"{STAMP};float x;float y;float z;float vx;float vy;float vz;bool xy_valid;bool z_valid"
    log.topic("vehicle_local_position", fields, rows)
    return log.save(path)


@pytest.fixture(scope="module")
def ulogs(tmp_path_factory):
    """Two flights of a vehicle whose centre of mass is 6 mm ahead and 4 mm to the left."""
    folder = tmp_path_factory.mktemp("px4")
    hidden = ["com_offset=x:0.006,y:0.004"]
    how = {"duration": 16.0, "excitation": 0.5, "hide": hidden}
    return [
        write_ulog(wg.simulate(true_vehicle(), "multi_axis", seed=k, **how), folder / f"flight{k}.ulg") for k in (1, 2)
    ]


NEW = ("model", "new", "--mass", MASS, "--mass-tolerance", 0.005, "-o", "vehicle.toml", "--from")


@pytest.fixture
def model(run, ulogs, tmp_path):
    done = run(*NEW, ulogs[0])
    assert done.exit_code == 0, done.output
    return model_file.load(tmp_path / "vehicle.toml")


def test_a_log_becomes_a_model(model, tmp_path):
    """Geometry of the parameters; the curve, of which PX4 knows nothing here, from the flight."""
    arms, rotors = model.vehicle.geometry()
    assert arms.position_B == pytest.approx(np.array([(x, -y, 0.0) for x, y, _ in PLACES]), abs=1e-6)
    assert rotors.spin.tolist() == [1, 1, -1, -1]
    assert rotors.kappa == pytest.approx(np.full(4, 0.02))
    full = rotors.c_f * model.command.speeds(np.ones((1, 4)), None, model.vehicle) ** 2
    assert full[0] == pytest.approx(np.full(4, FULL), rel=0.06)
    share = (FACTOR - 1 + np.sqrt((1 - FACTOR) ** 2 + 4 * FACTOR * MASS * GRAVITY / 4 / FULL)) / (2 * FACTOR)
    assert hover_command(model) == pytest.approx(share, abs=0.02)
    away = (np.array(INERTIA) - np.diag(model.vehicle.body.inertia)) / np.diag(model.vehicle.tolerances.inertia)
    assert np.all(np.abs(away) < 3.0)
    assert "fitted: " in (tmp_path / "vehicle.toml").read_text()


def test_the_new_model_flies(model):
    flown = wg.simulate(model, "hover", duration=4.0)
    away = np.linalg.norm(flown.odometry.position_E - flown.odometry.position_E[0], axis=1)
    assert away.max() < 0.3


def test_from_a_log_to_a_report(run, result_of, ulogs, model, tmp_path):
    """The commands of docs/px4.md, on a small log: each does its job, and the calibration finds what was hidden."""
    first, second = ulogs
    inspected = result_of("inspect", first, "-m", "vehicle.toml")
    assert {c["level"] for c in inspected["logs"][0]["model_checks"]} <= {"ok", "warn"}
    compared = result_of("compare", second, "-m", "vehicle.toml")
    calibrated = result_of("calibrate", first, "-m", "vehicle.toml", "-o", "calibrated.toml", "--validate", second)
    assert calibrated["schema"] == "wrenchgap.calibrate/1"
    assert "com_offset" in {t["effect"] for t in calibrated["tried"] if t["fate"] == "kept"}
    com = {p["name"]: p for p in calibrated["parameters"] if p["effect"] == "com_offset"}
    for axis, true in (("x", 0.006), ("y", 0.004)):
        assert com[axis]["value"] == pytest.approx(true, abs=1.5e-3)
        assert abs(com[axis]["value"] - true) < 3.0 * com[axis]["std"]
    (unseen,) = calibrated["unseen"]
    assert all(unseen["rms_after"][k] < 0.5 * unseen["rms_before"][k] for k in (3, 4))
    after = result_of("compare", second, "-m", "calibrated.toml")
    assert sum(after["models"][1]["rms"][3:]) < 0.5 * sum(compared["models"][0]["rms"][3:])
    explained = result_of("explain", second, "-m", "calibrated.toml", "--effects-only", "com_offset,mass,thrust_scale")
    assert {u["effect"]: u["lack"] for u in explained["not_tried"]}["mass"] == "known"
    report = run("report", second, "-m", "calibrated.toml", "-o", "report.html", "--between", "2:9")
    assert report.exit_code == 0, report.output
    assert "com_offset" in (tmp_path / "report.html").read_text()
    history = run("history", "calibrated.toml")
    assert "com_offset" in history.output
    session = LogSession([second], model_file.load("calibrated.toml"), cutoff_hz=3.0)
    assert list(session.flights) == ["flight2"]


def test_an_ardupilot_log_becomes_a_model_with_its_level(run, tmp_path):
    """Motors in the order of the frame; the level is that of 1.5 kg over the pulses, whatever MOT_THST_HOVER says."""
    known = {"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0, "MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0}
    known |= {"MOT_SPIN_MIN": 0.0, "MOT_SPIN_MAX": 1.0, "MOT_THST_EXPO": FACTOR, "MOT_THST_HOVER": 0.2}
    known |= {f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 5)}
    flown = wg.simulate(true_vehicle(), "multi_axis", seed=4, duration=12.0, excitation=0.5)
    log, imu, sent = autopilots().Dataflash(known), flown.imu, flown.actuators
    columns = (*flipped(imu.omega_B).T, *flipped(imu.specific_force_B).T)
    stamps = np.round(1e6 * (30.0 + imu.time))
    names = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
    log.add("IMU", "QBffffff", names, stamps, np.zeros(len(stamps)), *columns, instance="I")
    share = 9.0e-6 * sent.rotor_speed**2 / FULL
    u = (FACTOR - 1 + np.sqrt((1 - FACTOR) ** 2 + 4 * FACTOR * share)) / (2 * FACTOR)
    pulses = np.round(1000.0 + 1000.0 * u)
    log.add("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4", np.round(1e6 * (30.0 + sent.time)), *pulses.T)
    path = log.save(tmp_path / "quad.bin")
    done = run("model", "new", "--from", path, "--mass", MASS, "--arm", 0.26, "-o", "quad.toml")
    assert done.exit_code == 0, done.output
    model = model_file.load(tmp_path / "quad.toml")
    _, rotors = model.vehicle.geometry()
    assert rotors.spin.tolist() == [1, 1, -1, -1]
    full = rotors.c_f * model.command.speeds(np.full((1, 4), 2000.0), None, model.vehicle) ** 2
    assert full[0] == pytest.approx(np.full(4, FULL), rel=0.02)
    opened = wg.open_flights(path, model)[0]
    assert np.median(opened.records[0].commanded[:, 2]) == pytest.approx(MASS * GRAVITY, rel=0.03)


def test_the_page_of_px4_has_the_commands_that_are_tested():
    page = (ROOT / "docs" / "px4.md").read_text()
    for command in ("model new", "inspect", "compare", "calibrate", "explain", "report", "view"):
        assert f"    wrenchgap {command} " in page


def test_model_new_says_what_it_assumed_and_writes_its_json(result_of, ulogs, tmp_path):
    result = result_of(*NEW, ulogs[0], "--name", "mine", "--figure", "top.png")
    assert result["schema"] == "wrenchgap.model/1"
    assert result["name"] == "mine"
    assert [i["role"] for i in result["inputs"]] == ["source"]
    assert any(line.startswith("inertia: estimated") for line in result["assumed"])
    assert len(result["rotors"]) == 4
    assert result["tolerances"]["mass"] == 0.005
    assert result["command"]["unit"] == "normalised"
    assert (tmp_path / "top.png").read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "vehicle.toml").read_text()
    assert "wrenchgap model new --output vehicle.toml" in text
    assert tomllib.loads(text)["vehicle"]["mass"] == {"value": MASS, "tolerance": 0.005}


def test_model_show_prints_what_was_understood(result_of, run, model, tmp_path):
    assert result_of("model", "show", "vehicle.toml", "--figure", "v.png")["mass"] == MASS
    printed = run("model", "show", "vehicle.toml").output
    assert "counter-clockwise" in printed
    assert "hover at" in printed
    assert run("model", "show", "crazyflie").exit_code == 0


def test_a_model_without_rotors_is_shown(run, tmp_path):
    done = run("model", "show", "variable_tilt_hexacopter")
    assert done.exit_code == 0, done.output


def test_answers_make_a_model(tmp_path, monkeypatch):
    """Mass, its tolerance, frame, arm, radius, thrust; then the turning of nothing, since the frame says it."""
    from typer.testing import CliRunner

    from wrenchgap.replay.cli.main import app

    monkeypatch.chdir(tmp_path)
    answers = "\n".join(["-1", "2.4", "", "hexa_x", "0.35", "0.15", "12.0"])
    done = CliRunner().invoke(
        app, ["model", "new", "-i", "-o", "hexa.toml"], input=answers + "\n", prog_name="wrenchgap"
    )
    assert done.exit_code == 0, done.output
    made = model_file.load(tmp_path / "hexa.toml")
    _, rotors = made.vehicle.geometry()
    assert len(rotors) == 6
    assert made.vehicle.body.mass == 2.4
    assert rotors.radius == pytest.approx(np.full(6, 0.15))
    assert rotors.c_f * rotors.speed_max**2 == pytest.approx(np.full(6, 12.0), rel=1e-4)


def test_nothing_that_helps_leaves_the_model_as_it_is(run, tmp_path):
    """The vehicle flown as its model file has it, without noise in the plant: nothing to trim."""
    true = true_vehicle()
    model_file.save(replace(true, path=None), tmp_path / "true.toml")
    wg.save_log(wg.simulate(true, "multi_axis", duration=12.0, excitation=0.5, seed=3), tmp_path / "right.mcap")
    done = run("calibrate", "right.mcap", "-m", "true.toml", "-o", "same.toml")
    assert done.exit_code == 0, done.output
    same = model_file.load(tmp_path / "same.toml")
    moved = [v for e in same.snapshot for v in e.values if v.unit != "s" and abs(v.value) > 3.0 * v.std]
    assert moved == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "x.toml"), "nothing to start from; say --from SOURCE, or --interactive"),
        (("--from", "nix.ulg", "-o", "x.toml"), "no such file; expected .ulg"),
        (("--from", "here.param", "-o", "x.toml"), "say --mass KG"),
        (("--from", "here.param", "--mass", "0", "-o", "x.toml"), "--mass 0: expected a positive number"),
        (("--from", "here.param", "--mass", "1", "-o", "here.param"), "is read by this command|exists|input"),
    ],
)
def test_wrong_use_is_told_in_one_line(refused, tmp_path, arguments, message):
    import re

    (tmp_path / "here.param").write_text("MOT_PWM_MIN,1000\n")
    assert re.search(message, refused("model", "new", *arguments))


def test_a_log_that_is_no_log_is_refused(refused, tmp_path):
    (tmp_path / "bad.ulg").write_bytes(b"not a log at all")
    assert "not a PX4 log" in refused("model", "new", "--from", "bad.ulg", "--mass", "1", "-o", "x.toml")
    (tmp_path / "bad.bin").write_bytes(b"\xa3\x95nothing")
    assert "bad.bin" in refused("model", "new", "--from", "bad.bin", "--mass", "1", "-o", "x.toml")
