"""`check` on logs made to have one thing wrong: it is said where it is, with its size, and nowhere else."""

import html
import json
import re
import shlex
import subprocess
import sys
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest

import wrenchgap as wg
from tests.independent.flown_quadrotor import MODEL as QUADROTOR
from tests.independent.flown_quadrotor import Case
from tests.independent.flown_quadrotor import fly as fly_quadrotors
from tests.replay import health_logs
from tests.replay.autopilot_logs import true_vehicle
from tests.replay.health_logs import DOWN, END, STAMP, UP, Wrong, dataflash, flying, micro, ulog
from wrenchgap import flight
from wrenchgap.flight import cache
from wrenchgap.flight.autopilot import Autopilot
from wrenchgap.flight.check import Check
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.write import write
from wrenchgap.learn.diagnose.model_checks import inspect
from wrenchgap.learn.health.answers import Answer, Lack, Question
from wrenchgap.learn.health.logged_messages import changed_before
from wrenchgap.learn.health.motors import Shape
from wrenchgap.learn.health.phases import NoPhases
from wrenchgap.learn.health.rotors import thrusts_of
from wrenchgap.replay.present.changed import other_recordings
from wrenchgap.replay.present.health import answer, flown
from wrenchgap.replay.present.health_rows import ROWS
from wrenchgap.replay.present.inspection import next_command
from wrenchgap.replay.present.notes import grouped
from wrenchgap.replay.present.statements import lack, statements

WEAK = Wrong(thrust=(1.0, 1.0, 1.0, 1.45))
FAULTS = {
    "motors": WEAK,
    "saturation": Wrong(full=0.06),
    "vibration": Wrong(metric=70.0),
    "clipping": Wrong(clips=5000),
    "battery": Wrong(voltage=(0.1, 0.05, 0.05)),
    "estimator": Wrong(ratio=1.4),
    "gaps": Wrong(pause=2.0),
    "crash": Wrong(crash=True),
}
"""Logs by what `check` says of them."""
WRITERS = {"ulg": ulog, "bin": dataflash}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """`made(kind, about)` is the health of a log with one thing wrong, or with none."""
    folder, known = tmp_path_factory.mktemp("health"), {}

    def wrapped(kind, about="", wrong=None):
        key = kind, about, repr(wrong)
        if key not in known:
            path = folder / f"{about or 'sound'}-{len(known)}.{kind}"
            WRITERS[kind](path, wrong or FAULTS.get(about))
            known[key] = wg.check(path)
        return known[key]

    return wrapped


@pytest.fixture(scope="module")
def hover(tmp_path_factory):
    """The log of a vehicle that lacks nothing."""
    flown = wg.simulate(wg.load_model("crazyflie"), "hover", duration=12.0, seed=2)
    return wg.save_log(flown, tmp_path_factory.mktemp("hover") / "hover.mcap")


def said(health):
    return {one.about: one for one in statements(health.logs[0])}


@pytest.mark.parametrize("kind", WRITERS)
def test_of_a_sound_flight_nothing_is_said(made, kind):
    health = made(kind)
    assert said(health) == {}
    log = health.logs[0]
    assert log.phases.seconds("hover") == pytest.approx(DOWN - UP, abs=3.0)
    assert log.phases.seconds("ground") == pytest.approx(UP + 4.0, abs=1.0)
    assert log.motors.unevenness < 0.005
    assert log.estimator.worst.rejected == 0.0


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("about", FAULTS)
def test_what_is_wrong_is_said_and_nothing_else(made, kind, about):
    assert said(made(kind, about)).keys() == {about}


@pytest.mark.parametrize("kind", WRITERS)
def test_a_weak_motor_is_named_by_its_place_with_its_size(made, kind):
    """Commanded thrusts of 1, 1, 1 and 1.45: 31 % above their mean; in both frames motor 4 is back right."""
    motors = made(kind, "motors").logs[0].motors
    assert motors.hardest.rotor.name == "M4"
    assert motors.hardest.deviation == pytest.approx(1.45 / 1.1125 - 1.0, abs=0.005)
    assert motors.shape == "one motor"
    assert "ack right (M4)" in said(made(kind, "motors"))["motors"].words


def test_a_coaxial_pair_is_to_be_inspected_together(made):
    """Commands that are one for both rotors of a pair do not tell which of the two is weak."""
    log = made("ulg", "motors").logs[0]
    twice = [
        [replace(m, rotor=replace(m.rotor, name=f"{m.rotor.name}{side}")) for m in log.motors.motors] for side in "ab"
    ]
    pairs = [replace(m, alike=(other.rotor,)) for ab in zip(*twice, strict=True) for m, other in (ab, ab[::-1])]
    (words,) = [one.words for one in statements(replace(log, motors=replace(log.motors, motors=tuple(pairs))))]
    assert "coaxial pair back right (M4a and M4b)" in words
    assert "inspect both propellers" in words
    mixed = replace(log.motors, shape=Shape.MIXED)
    (words,) = [one.words for one in statements(replace(log, motors=mixed))]
    assert "nspect" not in words
    assert "Compare with a log from when it flew well" in words


def test_saturation_is_the_share_of_the_flight(made):
    assert made("ulg", "saturation").logs[0].motors.at_most == pytest.approx(0.06, abs=0.01)


def test_the_crash_is_where_it_happens(made):
    for kind in WRITERS:
        (crash,) = made(kind, "crash").logs[0].phases.named("crash")
        assert crash.start == pytest.approx(20.0, abs=0.5)
        assert crash.event == pytest.approx(20.0, abs=0.03)  # its impact, whatever the filters mix of it
        assert said(made(kind, "crash"))["crash"].words.startswith("Crash at 20.0 s from the log's start: an impact")


@pytest.mark.parametrize("kind", WRITERS)
def test_a_flight_mode_that_was_chosen_before_the_crash_is_said(made, kind):
    health = made(kind, "crash", Wrong(crash=True, acro=18.5))
    assert "flight mode Acro since 18.5 s; inspect" in said(health)["crash"].words
    assert "flight mode" not in said(made(kind, "crash"))["crash"].words
    modes = health.logs[0].modes
    assert [mode.name for mode in modes][-1] == "Acro"
    assert changed_before(modes, 18.5 + 29.0) is modes[-1]
    assert changed_before(modes, 18.5 + 31.0) is None
    assert changed_before(modes, 18.0) is None  # the first mode was not changed to


def test_a_voltage_of_a_twentieth_of_a_volt_is_no_battery_and_a_low_one_is(made):
    low = made("ulg", "low", Wrong(voltage=(14.6, 13.9, 13.5)))
    assert low.logs[0].battery.below == pytest.approx(DOWN - UP, abs=2.5)  # 4 cells of 3.5 V
    assert not low.logs[0].battery.none
    assert low.logs[0].battery.sag == pytest.approx(14.6 - 13.7, abs=0.05)
    assert made("ulg", "battery").logs[0].battery.none
    assert said(low).keys() == {"battery"}


def test_a_number_of_cells_that_gives_no_cells_voltage_is_told(made):
    wrong = made("ulg", "cells", Wrong(parameters={"BAT1_N_CELLS": 8}))
    assert wrong.logs[0].battery.cells_wrong
    assert not made("ulg").logs[0].battery.cells_wrong


def test_dropouts_are_those_of_the_logger(made):
    assert said(made("ulg", "lost", Wrong(dropouts=(400, 300)))).keys() == {"logger"}
    assert made("ulg", "lost", Wrong(dropouts=(400, 300))).logs[0].autopilot.lost == pytest.approx(0.7)
    assert said(made("ulg", "hardly", Wrong(dropouts=(3,)))) == {}


def test_an_estimators_fault_is_worse_than_a_rejected_measurement(made):
    faulty = said(made("ulg", "fault", Wrong(faults=4)))
    assert faulty["estimator"].level == "bad"
    assert made("ulg", "fault", Wrong(faults=4)).logs[0].estimator.faulty == 1.0


def sampled(log, topic, **columns):
    """A topic of a PX4 log at 5 Hz: floats, or of three axes, by time."""
    time = np.arange(0.0, END, 0.2)
    rows = {name: np.asarray(made(time), dtype=float) for name, made in columns.items()}
    fields = ";".join([STAMP, *(f"float{'[3]' if rows[name].ndim > 1 else ''} {name}" for name in rows)])
    log.topic(topic, fields, {"timestamp": micro(time)} | rows)


def test_a_compass_of_which_one_axis_is_rejected_is_said_and_one_that_is_not_used_is_not(made):
    """PX4's mag_field are ratios by axis, infinite where it is not fused; the flag is that of the field's strength."""

    def disturbed(log):
        def field(time):
            return np.where(flying(time)[:, None], [0.1, 0.2, 9.0], 0.0)

        sampled(log, "estimator_innovation_test_ratios", mag_field=field)
        sampled(log, "estimator_status_flags", cs_mag_field_disturbed=lambda time: time > 0.5 * (UP + DOWN))

    health = made("ulg", "compass", Wrong(more=disturbed))
    (ratio,) = [one for one in health.logs[0].estimator.ratios if one.of == "magnetometer"]
    assert (ratio.median, ratio.rejected) == (9.0, 1.0)
    assert said(health)["estimator"].level == "bad"
    assert "rejects its magnetometer 100 %" in said(health)["estimator"].words
    assert re.search(r"field is not the expected one (49|5\d) % of the time", said(health)["estimator"].words)

    def unused(log):
        sampled(log, "estimator_innovation_test_ratios", mag_field=lambda time: np.full((len(time), 3), np.inf))

    assert said(made("ulg", "unused", Wrong(more=unused))) == {}


def test_a_gps_without_a_fix_is_a_line_of_the_table_and_nothing_to_look_at(made):
    def indoors(log):
        sampled(log, "vehicle_gps_position", fix_type=lambda time: 0.0 * time)
        sampled(log, "estimator_status_flags", cs_ev_pos=lambda time: 0.0 * time + 1.0)

    health = made("ulg", "indoors", Wrong(more=indoors))
    assert said(health) == {}
    row = {head: cell for head, cell, _ in ROWS}["estimator"]
    assert row(health.logs[0]).endswith("; the GPS never had a fix: position from vision")
    fixed = made("ulg", "outdoors", Wrong(more=lambda log: sampled(log, "sensor_gps", fix_type=lambda t: 0 * t + 3)))
    assert "GPS" not in row(fixed.logs[0])


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize(("amperes", "about"), [(0.2, {"battery"}), (12.0, set()), (-1.0, set())])
def test_a_current_that_lifts_nothing_is_not_that_of_the_motors(made, kind, amperes, about):
    assert said(made(kind, "current", Wrong(current=amperes))).keys() == about


def test_what_the_autopilot_reported_in_flight_is_said_the_two_worst_of_it(made):
    def reported(log):
        for level, second, text in (
            (4, 12.0, "Failsafe activated"),
            (6, 12.5, "Info"),
            (3, 13.0, "Low \x1b[31mbattery"),
        ):
            log.said(level, int(micro(second)), text)
        log.said(3, int(micro(1.0)), "on the ground")
        log.said(4, int(micro(14.0)), "Failsafe activated")
        log.said(2, int(micro(15.0)), "third")

    health = made("ulg", "messages", Wrong(more=reported))
    told = said(health)["messages"].words
    assert '"third" (critical, 15.0 s), "Low \x1b[31mbattery" (error, 13.0 s) and 1 more' in told
    texts = {one.text: one for one in health.logs[0].messages}
    assert texts["Failsafe activated"].count == 2
    assert not texts["on the ground"].in_flight
    assert "Info" not in texts
    assert "\x1b" not in repr(health)  # names are data

    def failed(log):
        log.add("ERR", "QBB", "TimeUS,Subsys,ECode", micro([11.0, 12.0]), [6, 6], [1, 0])

    told = said(made("bin", "messages", Wrong(more=failed)))["messages"].words
    assert told == 'The autopilot reported in flight: "battery failsafe, error 1" (error, 11.0 s).'


def test_a_low_battery_is_said_by_which_parameter(made):
    low = Wrong(voltage=(14.6, 13.9, 13.5))
    assert "below 14.0 V (4 cells at BAT1_V_EMPTY)" in said(made("ulg", "low", low))["battery"].words
    assert "below 14.0 V (BATT_LOW_VOLT)" in said(made("bin", "low", low))["battery"].words


def test_of_a_log_without_a_flight_nothing_is_said_to_be_missing(made):
    health = made("ulg", "never", Wrong(thrust=(0.0, 0.0, 0.0, 0.0)))
    assert {head: cell for head, cell, _ in ROWS}["estimator"](health.logs[0]) == "not judged: no flight"
    assert "for want of data" not in answer(health)[0][0]


def test_a_motor_that_is_stopped_in_the_air_is_said_and_the_balance_is_of_the_time_before(made):
    health = made("ulg", "stopped", Wrong(stopped=15.0))
    motors, words = health.logs[0].motors, said(health)["motors"].words
    assert [(one.rotor.name, one.last) for one in motors.stopped] == [("M2", True)]
    assert motors.stopped[0].start == pytest.approx(15.0, abs=0.1)
    assert "(M2) was commanded nothing from 15.0 s to the end" in words
    assert max(abs(motor.deviation) for motor in motors.motors) < 0.01
    assert not made("ulg", "sound", Wrong()).logs[0].motors.stopped
    assert not made("ulg", "never", Wrong(stopped=0.0)).logs[0].motors.stopped  # no motor hangs on that output


def test_a_record_that_stops_while_others_go_on_is_no_loss_of_power(made):
    words = said(made("ulg", "ends", Wrong(ends=15.0)))["flight"].words
    assert "(actuators) stops in the air at 15.0 s, and others go on" in words
    assert "power" not in words


@pytest.mark.parametrize("wrong", [{"CA_ROTOR1_KM": -0.05}, {"CA_ROTOR0_PX": float("nan")}])
def test_places_of_rotors_that_no_vehicle_hovers_with_are_not_used(made, wrong):
    """Three rotors that turn one way, or a place that is no number."""
    uneven = (1.0, 1.0, 1.0, 1.2)
    found = made("ulg", f"places{next(iter(wrong))}", Wrong(uneven, parameters=wrong)).logs[0].motors
    assert found.shape == "places of the rotors unknown"
    assert found.hardest.deviation == pytest.approx(1.2 / 1.05 - 1.0, abs=0.01)


def test_motors_that_idle_on_the_ground_are_no_flight_and_no_loss_of_control(made):
    """As a log that was cut before the vehicle took off."""
    log = made("ulg", "idle", Wrong(thrust=(0.02, 0.04, 0.03, 0.04))).logs[0]
    assert log.phases.lack is NoPhases.POWER
    assert log.motors is None


def test_what_a_calm_flight_lacks_is_said_apart_from_what_no_setting_of_the_logger_gives(made):
    calm = made("ulg", "sound", Wrong())
    lines = [text for text, _ in answer(calm)]
    asked = next(line for line in lines if "(why: table)" in line)
    assert "too calm for small values of: " in asked
    assert "drag" in asked.partition("too calm for small values of: ")[2]
    assert "drag" not in asked.partition("too calm for small values of: ")[0]


def test_a_flight_that_is_too_short_is_to_be_flown_again_before_a_model_is_made(tmp_path, monkeypatch):
    monkeypatch.setattr(health_logs, "DOWN", UP + 7.0)
    lines = [text for text, _ in answer(wg.check(ulog(tmp_path / "short.ulg")))]
    assert "Fly at least 8 s: `explain` needs as much." in lines
    assert lines[-1] == "next: wrenchgap check ANOTHER_LOG"


def test_propellers_come_before_the_battery_where_either_may_be_it(made):
    words = said(made("ulg", "nose", Wrong(thrust=(1.2, 0.8, 1.2, 0.8))))["motors"].words
    assert "propellers there are weak. Inspect these; if they are sound, move the battery" in words


def test_the_curve_of_the_thrust_is_said(made):
    row = {head: cell for head, cell, _ in ROWS}["motor balance"]
    squares = made("bin").logs[0]  # MOT_THST_EXPO 1
    assert row(squares).endswith("; thrust taken as the command's square)")
    shared = replace(squares, motors=replace(squares.motors, curve=0.3))
    assert "; thrust taken as 0.30 u^2 + 0.70 u of a command u" in row(shared)
    linear = made("ulg", "", Wrong(parameters={"THR_MDL_FAC": 0.3})).logs[0]  # PX4 makes up for the curve afterwards
    assert row(linear).endswith("; thrust taken in proportion to the command)")


def test_a_scale_of_the_accelerometer_is_a_thing_to_look_at(made):
    log = made("ulg").logs[0]
    scaled = replace(log.inspection, checks=(Check("accelerometer-scale", "warn", "A scale of 0.97"),))
    assert [one.words for one in statements(replace(log, inspection=scaled))] == ["A scale of 0.97."]


def test_the_first_estimator_of_old_firmware_is_read(made):
    assert said(made("bin", "old", Wrong(ratio=1.4, first_estimator=True))).keys() == {"estimator"}
    assert made("bin", "old", Wrong(ratio=1.4, first_estimator=True)).logs[0].estimator.topic == "EKF4"


def test_a_rotors_peak_is_named_where_its_speed_is_measured(made):
    """3 m/s^2 rms at 60 Hz along x; the measured speed says that it is the rotor's own, the imbalance."""
    health = made("ulg", "shakes", Wrong(turns=60.0))
    peak = health.logs[0].vibration.peaks[0]
    assert (peak.hz, peak.multiple, peak.rotors) == (pytest.approx(60.0, abs=0.6), 1, ("M1",))
    assert peak.rms == pytest.approx(3.0, rel=0.05)
    assert said(health).keys() == {"vibration"}
    assert made("ulg").logs[0].vibration.peaks == ()


def test_slow_commands_are_what_it_cannot_answer_and_the_setting_keeps_its_other_bits(made):
    slow = made("ulg", "slow", Wrong(rate=10.0, parameters={"SDLOG_PROFILE": 1 | 128})).logs[0]
    lag = next(one for one in slow.answers if one.question == "motor lag")
    assert (lag.have, lag.need) == (pytest.approx(10.0), 20.0)
    assert [(one.name, one.now, one.to) for one in slow.settings] == [("SDLOG_PROFILE", 129, 129 | 8 | 16)]
    fast = made("ulg").logs[0]
    assert next(one for one in fast.answers if one.question == "weak rotor").lack is None
    assert fast.settings == ()
    (one,) = made("bin", "slow", Wrong(rate=10.0)).logs[0].settings
    assert (one.name, one.now, one.to) == ("LOG_BITMASK", 1024, 1024 | 1 | 1 << 18)


@pytest.mark.parametrize("kind", WRITERS)
def test_the_answer_has_eight_lines_at_most_and_ends_with_one_command(made, kind):
    everything = Wrong(
        (1.0, 1.0, 1.0, 1.45), 0.2, (0.1, 0.05, 0.05), 70.0, 5000, 1.4, 4, (900,), 2.0, crash=True, rate=10.0
    )
    lines = [text for text, _ in answer(made(kind, "everything", everything))]
    assert len(lines) == 8
    assert lines[1].startswith("Crash")
    assert sum(line.startswith("next: wrenchgap ") for line in lines) == 1
    assert lines[-1].startswith("next: ")
    assert repr(made(kind, "everything", everything)).count("\n") < 40


def test_parameters_that_differ_are_listed_and_counters_are_not(tmp_path, run, result_of):
    other = {"MC_ROLLRATE_P": 0.2, "COM_FLIGHT_UUID": 8, "LND_FLIGHT_T_LO": 2000}
    one = ulog(tmp_path / "one.ulg", Wrong(parameters={"MC_ROLLRATE_P": 0.15}))
    two = ulog(tmp_path / "two.ulg", Wrong(parameters=other))
    found = result_of("check", one, two)["autopilot_parameters"]
    assert [entry["name"] for entry in found["differ"]] == ["MC_ROLLRATE_P"]
    assert found["differ"][0]["values"] == pytest.approx([0.15, 0.2])
    assert {entry["name"] for entry in found["ignored"]} == {"COM_FLIGHT_UUID", "LND_FLIGHT_T_LO"}
    assert all(entry["reason"] for entry in found["ignored"])
    shown = run("check", one, two).stdout
    assert re.search(r"MC_ROLLRATE_P +0.15 +0.2", shown)
    same = result_of("check", one, ulog(tmp_path / "three.ulg", Wrong(parameters=other | {"MC_ROLLRATE_P": 0.15})))
    assert same["autopilot_parameters"]["differ"] == []


def test_without_an_impact_control_was_lost_and_no_more_is_known(made):
    health = made("bin", "crash")
    log = health.logs[0]
    (crash,) = log.phases.named("crash")
    falling = replace(crash, why="motion contradicts the commands until the end")
    phases = tuple(falling if phase is crash else phase for phase in log.phases.phases)
    lost = replace(log, phases=replace(log.phases, phases=phases))
    words = said(replace(health, logs=(lost,)))["crash"].words
    assert words.startswith("Loss of control at ")
    assert "a log alone does not tell why" in words


def test_the_document_of_a_crash_holds_its_numbers(tmp_path, result_of):
    """The schema is strict: `json_as_its_schema_says` refuses any other key."""
    found = result_of("check", ulog(tmp_path / "crash.ulg", FAULTS["crash"]))
    assert found["logs"][0]["statements"][0]["about"] == "crash"
    assert found["inputs"][0]["sha256"] == found["logs"][0]["sha256"]
    assert found["answer"][-1].startswith("next: wrenchgap model new --from")
    assert json.dumps(found)


def test_a_page_is_one_file_and_a_name_in_it_is_text(tmp_path, run):
    nasty = ulog(tmp_path / "<script>alert(1)</script>.ulg".replace("/", "_"), WEAK)
    done = run("check", nasty, "--page", tmp_path / "page.html", "--figure", tmp_path / "check.png")
    assert done.exit_code == 0, done.output
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<script" not in page
    assert html.escape("<script>alert(1)") in page
    assert not re.search(r"(src|href)=[\"'](?!data:|#)", page)
    assert (tmp_path / "check.png").stat().st_size > 10_000


def test_details_add_the_tables_and_the_first_screen_has_none(tmp_path, run):
    log = ulog(tmp_path / "log.ulg")
    short, long = run("check", log).stdout, run("check", log, "--details").stdout
    assert short.count("\n") < 40
    assert "test ratios in the air" in long
    assert "test ratios in the air" not in short


def test_a_model_says_where_the_rotors_are(tmp_path):
    """Rotor speeds in rad/s and no autopilot: without the model nobody knows the places, with it the shape is told."""
    model = wg.load_model("crazyflie")
    flown = wg.simulate(model, "hover", duration=12.0, seed=2, hide=["com_offset=x:0.004"])
    log = wg.save_log(flown, tmp_path / "offset.mcap")
    alone, known = wg.check(log), wg.check(log, model)
    assert alone.logs[0].motors.shape == "places of the rotors unknown"
    motors = known.logs[0].motors
    arm = float(np.max(np.hypot(*model.vehicle.geometry()[0].position_B[:, :2].T)))
    assert motors.shape == "centre of mass"
    assert motors.centre == pytest.approx((0.004 / arm, 0.0), abs=0.01)


def test_a_motor_at_full_command_is_saturated_whatever_the_battery_gives(tmp_path):
    """At 3.3 V full PWM turns no rotor of the model as fast as it could; of four seconds one is spent there."""
    time = np.arange(0.0, 12.0, 0.01)
    share = np.tile(0.8, (len(time), 4))
    share[np.mod(time, 4.0) < 1.0, 2] = 1.0
    columns = {"t": time, "acc.z": np.ones(len(time)), "pm.vbat": np.full(len(time), 3.3)}
    columns |= dict.fromkeys(("acc.x", "acc.y", "gyro.x", "gyro.y", "gyro.z"), np.zeros(len(time)))
    columns |= {f"motor.m{k + 1}": np.round(65535 * share[:, k]) for k in range(4)}
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    for model in (None, wg.load_model("crazyflie")):
        _, full = thrusts_of(flight.load(tmp_path / "log.csv"), model).limits
        np.testing.assert_allclose(full.mean(axis=0), [0.0, 0.0, 0.25, 0.0], atol=0.01)


def test_only_flights_of_a_sound_vehicle_are_offered_as_healthy(tmp_path):
    """Two with a weak motor, two without: the last of those is asked about, the others are no measure of health."""
    model = wg.load_model("crazyflie")
    logs = []
    for number, hidden in enumerate([[], ["rotor_thrust=rotor_0:-0.13"], [], ["rotor_thrust=rotor_0:-0.13"]]):
        flown = wg.simulate(model, "hover", duration=12.0, seed=number, hide=hidden)
        logs.append(str(wg.save_log(flown, tmp_path / f"flight{number}.mcap")))
    command = answer(wg.check(logs, model))[-1][0]
    assert command.split()[3:].index("-m") == 4, command
    assert command.startswith(f"next: wrenchgap changed {logs[3]} --healthy {logs[0]} {logs[2]} -m ")
    found = wg.check(logs, model)
    first, *others = found.logs
    doubted = replace(first.inspection, checks=(Check("left-out", "warn", "samples are missing"),))
    command = answer(replace(found, logs=(replace(first, inspection=doubted), *others)))[-1][0]
    assert command.startswith(f"next: wrenchgap changed {logs[3]} --healthy {logs[2]} -m ")
    command = answer(wg.check([logs[1], logs[3]], model))[-1][0]
    assert "--healthy HEALTHY_LOG " in command


@pytest.mark.parametrize(
    ("topics", "model"),
    [
        (("/model/variable_tilt_hexacopter/odometry", "/clock"), "variable_tilt_hexacopter"),
        (("/cf/imu", "/cf/motor_command"), "crazyflie"),
        (("/motors", "/ground_truth/pose", "/ground_truth/twist", "/imu"), "asymmetric_quadrotor"),
        (("/motors", "/ground_truth/pose"), ""),
    ],
)
def test_a_shipped_model_is_known_by_its_topics(hover, topics, model):
    health = wg.check(hover)
    inspection = health.logs[0].inspection
    reports = tuple(replace(inspection.topics[0], topic=topic) for topic in topics)
    renamed = replace(health, logs=(replace(health.logs[0], inspection=replace(inspection, topics=reports)),))
    after = f"check {hover} -m {model}" if model else "model new --interactive -o vehicle.toml"
    assert answer(renamed)[-1][0] == f"next: wrenchgap {after}"


def test_the_next_command_is_one_that_runs(hover, made):
    """Of a log without an autopilot questions are answered; of a PX4 with ratios, or of ArduPilot, the arm is said. A
    shipped model has the name that its user gave.
    """
    assert answer(wg.check(hover))[-1][0] == "next: wrenchgap model new --interactive -o vehicle.toml"
    sound = wg.check(hover, wg.load_model("crazyflie"))
    assert answer(sound)[-1][0] == f"next: wrenchgap compare {hover} -m crazyflie"
    log = sound.logs[0]
    odd = (Check("gaps", "warn", "1 gap"), *log.inspection.checks)
    told = replace(sound, logs=(replace(log, inspection=replace(log.inspection, checks=odd)),))
    assert answer(told)[-1][0] == f"next: wrenchgap inspect {hover} -m crazyflie"
    assert "--arm METRES" in answer(made("bin"))[-1][0]
    ratios = {f"CA_ROTOR{n}_P{axis}": 1.0 for n in range(4) for axis in "XY"}
    health = made("ulg", "", Wrong(parameters=ratios))
    assert "--arm METRES" in answer(health)[-1][0]
    assert all(m.rotor.x is not None for m in health.logs[0].motors.motors)


def test_no_output_takes_the_name_of_a_shipped_model(hover, run):
    """It would stand for that model from then on, in this folder."""
    found = run("add", "mass", "-m", "crazyflie", "--from", hover, "-o", "crazyflie")
    assert found.exit_code == 2
    assert "is what -m takes for a shipped model; write crazyflie.toml" in " ".join(found.output.split())


def test_inspect_ends_with_the_next_command(hover, run):
    """Of a sound log the next question; of a bad one what mends it."""
    assert f"next: wrenchgap check {hover}" in " ".join(run("inspect", hover).output.split())
    assert f"next: wrenchgap compare {hover} -m crazyflie" in " ".join(
        run("inspect", hover, "-m", "crazyflie").output.split()
    )
    seen = inspect(hover)
    bad = (Check("imu-unit", "bad", "g", "--topic imu=/imu:g"),)
    wrong = replace(seen, inspection=replace(seen.inspection, checks=bad))
    assert next_command(wrong) == f"wrenchgap inspect {hover} --topic imu=/imu:g"


@pytest.mark.parametrize(("share", "tolerance", "told"), [(1.25, 0.15, True), (1.25, 0.3, False), (1.02, None, False)])
def test_a_vehicle_that_weighs_more_than_the_model_is_said_first(hover, share, tolerance, told):
    """Beyond what the model knows its thrust to: thrust and weight are one number in a hover."""
    model = wg.load_model("crazyflie")
    body = replace(model.vehicle.body, mass=model.vehicle.body.mass / share)
    known = replace(model.vehicle.tolerances, thrust=tolerance)
    found = wg.check(hover, model=replace(model, vehicle=replace(model.vehicle, body=body, tolerances=known)))
    assert ("weight" in said(found)) == told
    if told:
        assert "(1.250): check the mass; the model knows its thrust to 15 %" in said(found)["weight"].words


def test_a_log_whose_name_is_an_option_is_none_in_the_next_command(hover, run, tmp_path):
    """pathlib takes the ./ off that a careful user typed: pasted, the command would have run the file own.py."""
    log = tmp_path / "--effects=own.py"
    log.write_bytes(hover.read_bytes())
    assert f"next: wrenchgap check {log}" in " ".join(run("inspect", f"./{log.name}").output.split())
    assert f"next: wrenchgap compare {log} -m" in " ".join(
        run("check", f"./{log.name}", "-m", "crazyflie").output.split()
    )


def test_the_only_log_of_the_working_folder_has_the_name_of_that(hover, run, tmp_path):
    (tmp_path / "hover.mcap").write_bytes(hover.read_bytes())
    assert run("check", ".").output.startswith(f"{tmp_path.name}: 12 s")


def test_without_a_model_nothing_is_promised_that_needs_one(hover):
    (alone,), (told,) = (wg.check(hover, *model).logs for model in ((), (wg.load_model("crazyflie"),)))
    can = tuple(replace(a, lack=None) for a in alone.answers)
    row = {head: cell for head, cell, _ in ROWS}["enough for"]
    said = row(replace(alone, answers=can))
    assert said.startswith(f"{Question.SPECTRUM}; with a model: {Question.ROTORS}, ")
    assert said.endswith("if the motion follows the commands, which `check -m MODEL` tells")
    assert row(replace(told, answers=can)) == ", ".join(Question)


def test_a_log_that_ends_in_the_air_is_told_so(tmp_path, monkeypatch):
    monkeypatch.setattr(health_logs, "END", DOWN - 3.0)
    health = wg.check(ulog(tmp_path / "part.ulg"))
    assert [one.short for one in statements(health.logs[0])] == ["ends in the air"]


def test_what_could_not_be_judged_is_not_called_ordinary(tmp_path):
    rows = ["stamp,/imu.angular_velocity.x,/imu.angular_velocity.y,/imu.angular_velocity.z"]
    rows += [f"{0.01 * k},{0.1 * np.sin(k)},0.02,0.01" for k in range(500)]
    log = tmp_path / "gyro.csv"
    log.write_text("\n".join(rows), encoding="utf-8")
    assert not any("nothing out of the ordinary" in line for line, _ in answer(wg.check(log)))


def test_a_log_in_other_units_has_no_phases(tmp_path, run):
    """An accelerometer in halves of g looks like a free fall: nothing may be said of a crash."""
    log = tmp_path / "in_halves_of_g.csv"
    header = "stamp,/imu.angular_velocity.x,/imu.angular_velocity.y,/imu.angular_velocity.z"
    header += ",/imu.linear_acceleration.x,/imu.linear_acceleration.y,/imu.linear_acceleration.z"
    random = np.random.default_rng(0)
    rows = [",".join(f"{v:.6f}" for v in (0.01 * k, *random.normal(0, 0.1, 3), *random.normal((0, 0, 2), 0.01)))
            for k in range(1500)]  # fmt: skip
    log.write_text("\n".join([header, *rows]), encoding="utf-8")
    health = wg.check(log)
    assert health.logs[0].phases.phases == ()
    assert [c.name for c in health.logs[0].bad] == ["accelerometer-unit"]
    assert "--topic" in answer(health)[-1][0]


def test_of_wings_nothing_is_said_that_is_true_of_rotors_alone(made):
    plane = made("ulg", "plane", Wrong(thrust=(1.0, 1.0, 1.0, 1.45), parameters={"CA_AIRFRAME": 1}))
    assert said(plane) == {}
    assert (plane.logs[0].phases.lack, plane.logs[0].motors) == ("no multirotor", None)
    assert plane.logs[0].battery.flight == pytest.approx(15.7, abs=0.8)


@pytest.mark.parametrize("content", [b"", b"ULog\x01\x12\x35\x01", b"\xa3\x95\x80", b"\x00" * 4000])
def test_what_is_no_log_is_one_line(tmp_path, refused, content):
    path = tmp_path / "broken.bin"
    path.write_bytes(content)
    assert "broken.bin" in refused("check", path)


def test_a_log_that_breaks_off_says_what_it_can(tmp_path, run):
    whole = ulog(tmp_path / "whole.ulg", WEAK).read_bytes()
    for share in (0.05, 0.5, 0.9):
        path = tmp_path / f"part{share}.ulg"
        path.write_bytes(whole[: int(share * len(whole))])
        done = run("check", path)
        assert done.exit_code in (0, 2), done.output
        assert "Traceback" not in done.output


def test_inspect_begins_with_its_checks_and_says_like_notes_once(tmp_path, run):
    done = run("inspect", ulog(tmp_path / "log.ulg"), "--details")
    lines = done.stdout.splitlines()
    first = next(k for k, line in enumerate(lines) if line.strip().startswith(("ok", "warn", "bad")))
    topics = next(k for k, line in enumerate(lines) if "vehicle_attitude" in line and "px4" not in line)
    assert first < topics


@pytest.mark.slow
@pytest.mark.parametrize(("case", "lack"), [({"gusts": 3.0}, Lack.FOLLOWING), ({"excited": 2.0}, None)])
def test_with_a_model_a_hover_in_gusts_is_not_enough_for_a_lag(tmp_path, case, lack):
    """As `explain` says of the same log: the commands answer the motion."""
    (flown,) = fly_quadrotors([Case("flown", seconds=20.0, seed=1, **case)])
    write(flown, tmp_path / "flown.mcap")
    (log,) = wg.check(tmp_path / "flown.mcap", QUADROTOR).logs
    assert {a.question: a.lack for a in log.answers}[Question.LAG] is lack


def test_a_kept_flight_keeps_its_autopilot(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    log = ulog(tmp_path / "log.ulg", Wrong(dropouts=(40,)))
    first, second = cache.load(log), cache.load(log)
    assert second.autopilot == first.autopilot
    assert second.autopilot.parameters["BAT1_N_CELLS"] == 4
    assert second.autopilot.dropouts == 1


@pytest.fixture(scope="module")
def trimmed(autopilot_flights):
    """Two flights between which somebody levelled the horizon, opened for their vehicle."""
    flights = [
        replace(flown, autopilot=Autopilot("ArduPilot", parameters={"AHRS_TRIM_Y": y, "STAT_BOOTCNT": k, "SAME": 1}))
        for k, (flown, y) in enumerate(zip(autopilot_flights, (0.011, -0.013), strict=True))
    ]
    model = true_vehicle()
    return wg.open_flights(flights, model), model


@pytest.mark.parametrize("command", ["trend", "changed"])
def test_trend_and_changed_list_the_parameters_of_their_flights(trimmed, command):
    (first, second), model = trimmed
    if command == "trend":
        found = wg.trend([first, second], model, ["thrust_scale"])
    else:
        found = wg.changed([second], [first], model, names=["thrust_scale"], jobs=1)
    (differs,) = found.to_json()["autopilot_parameters"]["differ"]
    assert (differs["name"], sorted(differs["values"])) == ("AHRS_TRIM_Y", [-0.013, 0.011])
    assert re.search(r"AHRS_TRIM_Y.*0\.011", str(found))
    assert "STAT_BOOTCNT" in str(found)
    assert "SAME" not in str(found)


@pytest.mark.parametrize("what", [{"hardware": "NANO"}, {"serial": "2"}, {"frame": "HEXA"}, {"name": "ArduPilot"}])
def test_changed_refuses_a_log_of_another_vehicle_unless_told(trimmed, what):
    """Of another autopilot, board, processor or frame; what a log does not say tells nothing."""
    flights, model = trimmed
    first = Autopilot("PX4", hardware="V6C", frame="QUAD", serial="1")

    def compared(autopilot, **more):
        both = zip(flights, (first, autopilot), strict=True)
        opened = [replace(f, flight=replace(f.flight, autopilot=one), **more) for f, one in both]
        return wg.changed(opened[1:], opened[:1], model, names=["thrust_scale"], jobs=1)

    silent = replace(first, **dict.fromkeys(what, ""))
    assert not other_recordings(compared(silent))
    with pytest.raises(LogError, match=f"another vehicle.* {next(iter(what.values()))}, not .*--accept vehicles"):
        compared(replace(first, **what))
    found = compared(replace(first, **what), accept=("vehicles",))
    (words,) = other_recordings(found)
    assert next(iter(what.values())) in words
    assert str(found).replace("\n", " ").startswith(f"warning: {words[:40]}")  # the doubt comes before the answer


def test_notes_that_differ_by_names_and_numbers_alone_are_one():
    damaged = [f"topic_{k}: {k} of 900 samples left out ({k} absurd)." for k in range(1, 41)]
    several = ["12 bytes of a.bin belong to no whole message: left out.", *damaged, "another note."]
    assert grouped(several) == [several[0], f"{damaged[0]} (39 more like it.)", "another note."]
    assert grouped(damaged[:3]) == damaged[:3]


@pytest.mark.parametrize(("role", "name", "word"), [("reference", "position_E", False), ("imu", "omega_B", True)])
def test_what_a_tenth_of_a_role_lacks_is_said_of_measurements_not_of_setpoints(logs, tmp_path, role, name, word):
    """A setpoint that is not a number is none: the pilot flew by hand."""
    flight = wg.flight.load(logs.train)
    series = getattr(flight, role)
    values = np.array(getattr(series, name))
    values[: len(values) // 2] = np.nan
    log = write(replace(flight, **{role: replace(series, **{name: values})}), tmp_path / "half.mcap")
    assert ("samples left out" in {one.short for one in statements(wg.check(log).logs[0])}) == word


def test_seconds_in_the_air_are_said_to_tenths_where_ten_are_needed(made):
    """ "10 s" beside "9.6 s, 10 needed" is a riddle."""
    (log,) = made("ulg").logs
    short = Mock(seconds=lambda *names: 9.58, lack=None)
    assert flown(replace(log, phases=short)).endswith(", 9.6 s in the air")
    assert flown(replace(log, phases=Mock(seconds=lambda *names: 24.6, lack=None))).endswith(", 25 s in the air")


def test_of_two_equal_files_the_second_is_left_out_and_said(run, logs, tmp_path):
    """`check FOLDER/*` where somebody copied a log."""
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(logs.train.read_bytes())
    done = run("check", logs.train, copy, logs.ideal, "--json", tmp_path / "found.json")
    assert done.exit_code == 0
    assert f"{copy} is the same file as {logs.train}, and is left out." in done.output.replace("\n", " ")
    found = json.loads((tmp_path / "found.json").read_text())
    assert [one["path"] for one in found["logs"]] == [str(logs.train), str(logs.ideal)]
    assert found["repeated"] == [{"log": str(copy), "same_as": str(logs.train)}]
    assert len(wg.check([logs.train, copy]).logs) == 1


def test_files_are_written_though_whoever_reads_the_output_has_seen_enough(logs, tmp_path):
    """`wrenchgap check LOG --page FILE | head -1`."""
    command = [sys.executable, "-m", "wrenchgap", "check", logs.train, "--page", "p.html", "--json", "p.json"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(120) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"p.html", "p.json"}


def test_a_sign_of_the_spin_is_no_smallest_command(tmp_path):
    """Rotor speeds as RotorS writes them: below zero where a rotor turns clockwise."""
    flown = wg.simulate(wg.load_model("asymmetric_quadrotor"), "hover", duration=15.0, seed=1)
    signed = replace(flown.actuators, rotor_speed=flown.actuators.rotor_speed * [1, -1, 1, -1])
    log = write(replace(flown, actuators=signed), tmp_path / "signed.mcap")
    assert wg.check(log, wg.load_model("asymmetric_quadrotor")).logs[0].motors.at_least == 0.0


def test_logs_of_different_autopilots_are_asked_about(made):
    """They stand side by side all the same."""
    words = "are they of one vehicle?"
    of_px4, other, of_ardupilot = (
        made(*which).logs[0].inspection.path for which in (("ulg",), ("ulg", "motors"), ("bin",))
    )
    assert words in answer(wg.check([of_px4, of_ardupilot]))[0][0]
    assert words not in answer(wg.check([of_px4, other]))[0][0]


def test_one_row_is_no_flight(run, tmp_path):
    (tmp_path / "one.csv").write_text("t_s,motor.m1,gyro.x\n0.0,1000,0.1\n")
    assert "one message of each topic; a flight has many" in run("check", tmp_path / "one.csv").output


def test_a_model_of_another_vehicle_is_contradicted_and_not_used(hover):
    """Its rotors would name other places, and its limits would call every command saturated."""
    found = wg.check(hover, wg.load_model("asymmetric_quadrotor"))
    assert [one.about for one in statements(found.logs[0]) if one.level == "bad"] == ["log"]
    assert "does not fit this log" in answer(found)[0][0] + answer(found)[1][0]
    assert {m.rotor.name for m in found.logs[0].motors.motors} == {"M1", "M2", "M3", "M4"}
    assert "-m" not in answer(found)[-1][0]


def test_where_the_rotors_stand_in_another_order_the_next_command_reads_them_in_theirs(tmp_path):
    model = wg.load_model("crazyflie")
    flown = wg.simulate(model, "multi_axis", duration=15.0, excitation=1.0, seed=3)
    order = [3, 1, 0, 2]  # the model's rotor k is the log's column order.index(k)
    mixed = replace(flown, actuators=replace(flown.actuators, rotor_speed=flown.actuators.rotor_speed[:, order]))
    log = write(replace(mixed, commanded=None), tmp_path / "mixed.mcap")
    words = shlex.split(answer(wg.check(log, model))[-1][0])
    assert words[words.index("check") + 1 : words.index("--topic")] == [str(log), "-m", "crazyflie"]
    assert words[words.index("--topic") + 1].endswith("[2,1,3,0]")


def test_of_many_logs_each_that_is_shown_can_be_read(run, tmp_path):
    """Of twenty a terminal's columns were three letters wide, of a hundred they had none."""
    rows = "".join(f"{0.01 * k:.2f},1000,0.1\n" for k in range(100))
    names = [tmp_path / f"log{k:02d}.csv" for k in range(20)]
    for k, name in enumerate(names):
        name.write_text(f"t_s,motor.m1,gyro.x\n{rows}{1 + 0.01 * k:.2f},{1000 + k},0.1\n")
    brief, whole = (run("check", *names, *more).output for more in ((), ("--details",)))
    table = brief.partition("next:")[2]
    assert [name.name in table for name in names] == [True] * 6 + [False] * 14
    assert "14 more logs: --details" in table
    assert all(name.name in whole.partition("next:")[2] for name in names)


def test_what_the_voltage_lacks_is_its_fall_during_the_flight_and_not_the_sag():
    """A small battery sags by 0.8 V at take-off, and stays there."""
    assert lack(Answer(Question.VOLTAGE, Lack.VOLTAGE, 0.0, 3.0)) == (
        "fall of the voltage during the flight 0 %, 3 typically needed"
    )
    assert lack(Answer(Question.VOLTAGE, Lack.VOLTAGE, None, 3.0)) == "the voltage not found"


def test_a_file_that_could_not_be_read_whole_is_something_to_look_at(hover, tmp_path):
    """Half of a flight is a whole one to whoever is not told."""
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(hover.read_bytes()[: hover.stat().st_size // 2])
    found = wg.check(cut)
    (one,) = [one for one in statements(found.logs[0]) if one.short == "damaged file"]
    assert "cut short (no end record)" in one.words
    assert "damaged" in {c.name for c in found.logs[0].inspection.checks if c.level == "warn"}
