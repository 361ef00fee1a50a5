"""Logs without a model, as the page shows them, and the model that is made of them."""

import shutil
from types import SimpleNamespace

import numpy as np
import pytest

import wrenchgap as wg
from tests.flight.formats.test_blackbox import TIME, decoded
from tests.replay.autopilot_logs import MASS, every, write_dataflash, write_ulog
from wrenchgap.plant.drafts.sources import Given
from wrenchgap.replay.session.intake import NOTHING_YET, BareSession, Intake, filtered
from wrenchgap.replay.session.log_session import LogSession


def quiet(share, words):
    """Progress that nobody reads."""


@pytest.fixture(scope="module")
def folder(autopilot_flights, tmp_path_factory):
    place = tmp_path_factory.mktemp("intake")
    write_ulog(autopilot_flights[0], place / "flight1.ulg")
    write_ulog(autopilot_flights[1], place / "flight2.ulg")
    write_dataflash(autopilot_flights[0], place / "quad.bin")
    return place


def test_a_page_begins_with_nothing():
    session = Intake().session(quiet)
    assert session.flights == (NOTHING_YET,)
    assert session.channels(NOTHING_YET) == {}
    assert not session.scene(NOTHING_YET).wrenches


def test_a_log_without_a_model_shows_what_it_holds(folder, autopilot_flights):
    """Path, attitude, what the IMU felt and what the motors were told; no wrench, for which a mass is needed."""
    intake = Intake().with_file(folder / "flight1.ulg", quiet)
    session = intake.session(quiet)
    assert isinstance(session, BareSession)
    assert intake.cutoff_hz == 8.0
    assert intake.health.logs[0].motors is not None
    scene, truth = session.scene("flight1.ulg"), autopilot_flights[0].odometry
    middle = 0.5 * (scene.time[0] + scene.time[-1])
    flown = np.array([np.interp(truth.time[0] + middle - scene.time[0], truth.time, c) for c in truth.position_E.T])
    shown = np.array([np.interp(middle, scene.time, c) for c in scene.position_E.T])
    np.testing.assert_allclose(np.linalg.norm(shown), np.linalg.norm(flown), atol=0.05)
    felt = next(s for s in scene.series if s.title == "specific force")
    assert np.median(felt.values["z"]) == pytest.approx(9.81, abs=0.5)
    assert {s.title for s in scene.series} == {"specific force", "body rate", "motor command"}
    assert not scene.wrenches
    assert len(session.channels("flight1.ulg")) > 10


def test_the_form_makes_the_model_of_a_px4_log_and_a_second_log_joins(folder):
    intake = Intake().with_file(folder / "flight1.ulg", quiet)
    intake = intake.drafted(Given(mass=MASS), quiet)
    session = intake.session(quiet)
    assert isinstance(session, LogSession)
    assert session.model.vehicle.body.mass == MASS
    assert any("kappa" in words or "radius" in words for words in intake.sheet.assumed)
    assert not session.working.saved, "no file has it"
    both = intake.with_file(folder / "flight2.ulg", quiet).session(quiet)
    assert both.flights[0] == "flight2", "what was dropped last is shown, and is the suspect of `changed`"
    assert not both.working.saved
    assert len(both.flights) == 2
    assert both.comparisons is not None, "two flights can be compared"


def test_an_ardupilot_log_says_what_it_lacks_and_then_is_a_model(folder):
    intake = Intake().with_file(folder / "quad.bin", quiet)
    with pytest.raises(wg.ModelError, match="--arm"):
        intake.drafted(Given(mass=MASS), quiet)
    made = intake.drafted(Given(mass=MASS, arm=0.26), quiet)
    assert len(made.session(quiet).model.vehicle.rotors) == 4


def test_a_dropped_model_file_is_the_model_and_opens_no_other_file(folder, tmp_path):
    intake = Intake().with_file(folder / "flight1.ulg", quiet)
    path = tmp_path / "mine.toml"
    path.write_text((wg.load_model("asymmetric_quadrotor")).text)
    assert intake.with_file(path, quiet).model.vehicle.name == wg.load_model("asymmetric_quadrotor").vehicle.name
    path.write_text('schema = 1\n[vehicle]\nname = "x"\n[command]\ntable = "/etc/passwd"\n')
    with pytest.raises(wg.ModelError) as refused:
        intake.with_file(path, quiet)
    assert "root:" not in str(refused.value)


def test_what_is_no_log_leaves_the_others_as_they_are(folder, tmp_path):
    intake = Intake().with_file(folder / "flight1.ulg", quiet)
    (tmp_path / "notes.ulg").write_text("no log")
    with pytest.raises(wg.LogError):
        intake.with_file(tmp_path / "notes.ulg", quiet)
    with pytest.raises(wg.UsageError, match="same log"):
        intake.with_file(folder / "flight1.ulg", quiet)
    assert [p.name for p in intake.logs] == ["flight1.ulg"]


def test_two_logs_of_one_name_are_two_flights(folder, tmp_path):
    shutil.copy(folder / "flight2.ulg", tmp_path / "flight1.ulg")
    both = Intake().with_logs((folder / "flight1.ulg", tmp_path / "flight1.ulg"), quiet).session(quiet)
    assert both.flights == ("flight1.ulg (1)", "flight1.ulg (2)")
    assert [both.scene(name).name for name in both.flights] == list(both.flights)


def test_motors_at_ten_hertz_get_a_low_pass_that_they_allow(autopilot_flights, tmp_path):
    """10 Hz over 2.5, less 3 %: with 8 Hz the log is refused."""
    slow = Intake().with_file(write_ulog(every(autopilot_flights[0], 10.0), tmp_path / "slow.ulg"), quiet)
    assert slow.cutoff_hz == pytest.approx(3.8, abs=0.11)
    (flight,) = slow.drafted(Given(mass=MASS), quiet).session(quiet).working.flights.values()
    assert flight.records[0].cutoff_hz == slow.cutoff_hz


@pytest.mark.parametrize(
    ("unit", "motors", "asked"), [("normalised", True, False), ("normalised", False, True), ("N", True, True)]
)
def test_a_normalised_wrench_beside_the_motors_commands_asks_for_no_low_pass(unit, motors, asked):
    """What a model makes of motors logged at 50 Hz does not wait for setpoints at 10 Hz."""
    flight = SimpleNamespace(actuators=object() if motors else None, commanded=SimpleNamespace(unit=unit))
    assert ("commanded" in filtered(SimpleNamespace(inspection=SimpleNamespace(flight=flight)))) == asked


def test_a_betaflight_table_makes_a_model_with_its_thrust_curve(tmp_path):
    """Half of full throttle carries 0.6 kg: a quarter of the full thrust."""
    motor = 48.0 + (2047.0 - 48.0) * np.tile(0.5 * np.sqrt(1.0 + 0.1 * np.cos(TIME))[:, None], (1, 4))
    motor[0] = 48.0  # not yet armed
    decoded(tmp_path / "log.csv", motor)
    intake = Intake().with_file(tmp_path / "log.csv", quiet)
    model = intake.drafted(Given(mass=0.6, frame="quad_bf_x", arm=0.12), quiet).model
    full = model.vehicle.rotors.c_f * model.command.speeds(np.ones((1, 4)), np.array([15.58]), model.vehicle) ** 2
    np.testing.assert_allclose(full, [[0.6 * 9.80665 / 4 / 0.25] * 4], rtol=0.02)
