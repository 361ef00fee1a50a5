"""What `explain` found, in words, in commands that work, in a table, and as the JSON of its schema."""

import io
import json
import re
import shlex
from dataclasses import replace
from itertools import pairwise
from unittest.mock import Mock

import numpy as np
import pytest
from rich.console import Console

import wrenchgap as wg
from scripts.json_documents import schema
from wrenchgap.flight.autopilot import Autopilot
from wrenchgap.flight.errors import ModelError
from wrenchgap.learn.data.measurement import window
from wrenchgap.learn.diagnose.relevance import GroupRelevance, Relevance
from wrenchgap.learn.diagnose.residual_patterns import OneRotor, Oscillation
from wrenchgap.learn.identify.bias_and_trim import FlightsApart, GrantedTrim
from wrenchgap.learn.posterior import single_effects
from wrenchgap.learn.posterior.discriminating_tests import Check
from wrenchgap.learn.posterior.settings import SearchSettings
from wrenchgap.learn.posterior.verdict import OpenBand, Verdict, decide
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.vehicle import Tolerances
from wrenchgap.replay.present import fitted_effects, posterior, what_to_inspect
from wrenchgap.replay.present.answer import (
    answer,
    answer_lines,
    evidence,
    in_full,
    short,
    summary,
    thrust_beyond,
    thrust_off,
)
from wrenchgap.replay.present.documents import VERSIONS, plain
from wrenchgap.replay.present.explanation import brief, members, to_json, what_next
from wrenchgap.replay.present.notes import not_tried
from wrenchgap.replay.present.numbers import share
from wrenchgap.replay.present.posterior import oscillation_in_words, with_values
from wrenchgap.replay.present.tables import Line

NAME = "tilt_hexarotor"
MODEL = wg.load_model(NAME)


def explained(path, *names):
    return wg.explain(wg.open_flights(path, MODEL), MODEL, names=names, jobs=1)


@pytest.fixture(scope="module")
def named(logs):
    """A centre-of-mass offset of (-4, 7, -5) mm."""
    return explained(logs.train, "com_offset", "mass", "battery_sag")


@pytest.fixture(scope="module")
def grouped(logs):
    """6 % less of everything: thin air, or lower rotors that lose 12 %."""
    (flight,) = wg.open_flights(logs.ideal, MODEL)
    less = replace(flight, records=tuple(replace(r, measured=0.94 * r.measured) for r in flight.records))
    return wg.explain(less, MODEL, names=("thrust_scale", "coaxial_loss", "com_offset"), jobs=1)


@pytest.fixture(scope="module")
def nothing(logs):
    return explained(logs.ideal, "com_offset", "mass")


def heading(explained):
    group = GroupRelevance("heading", "heading", ("sin", "cos"), 0.6, 0.5, np.zeros(6), np.zeros(6), 9.0, 1)
    other = replace(group, name="height", label="height", step=0)
    return Relevance((group, other), explained, np.zeros(6), explained, {})


def swinging(found):
    return replace(found, verdict=Verdict.UNKNOWN, oscillation=Oscillation(0.724, 0.012, "E", 0.75, 2.3))


def test_an_effect_is_told_with_its_values_and_how_sure(named):
    words = summary(named)
    assert named.verdict == "effect"
    told = {axis: float(value) for axis, value in re.findall(r"\b([xyz]) (-?[\d.]+) \+- [\d.]+ m\b", words)}
    assert told == pytest.approx({"x": -0.004, "y": 0.007, "z": -0.005}, abs=2e-4)
    assert f"confidence {100 * named.confidence(named.members[0]):.0f} %" in words


def test_of_many_parameters_the_ones_that_stand_out_are_told(named):
    """Twelve rotors, one of them weak and one a little."""
    rotors = [("rotor_thrust", p) for p in find("rotor_thrust").parameters(named.model.vehicle)]
    loss = np.full(12, 0.001)
    loss[[3, 8]] = -0.2, -0.1
    fitted = replace(named.fit, parameters=tuple(rotors), theta=loss, covariance=1e-6 * np.eye(12))
    member = replace(named.members[0], name="rotor_thrust")
    words = summary(replace(named, members=(member,), fit=fitted))
    assert "rotor_thrust (M4 -0.200 +- 0.0010, M9 -0.100 +- 0.0010)," in words


def in_hover(flight):
    """The same flight as if one wrench had been commanded throughout."""
    records = [replace(r, commanded=np.tile((0.0, 0.0, 40.0, 0.0, 0.0, 0.0), (len(r), 1))) for r in flight.records]
    return replace(flight, records=tuple(records))


def test_a_constant_wrench_is_said_as_check_says_it_and_as_sure_as_it_is(named, monkeypatch):
    """The weight 12 mm behind the middle, a yaw torque, a tilt of two degrees; a force along z tells nothing."""
    weight = named.model.vehicle.body.mass * 9.80665
    parameters = tuple(("constant_wrench", p) for p in find("constant_wrench").parameters(named.model.vehicle))
    theta = weight * np.array([np.radians(2.0), 0.0, 0.0, 0.0, -0.012, 0.01])
    fitted = replace(named.fit, parameters=parameters, theta=theta, covariance=1e-12 * np.eye(6))
    member = replace(named.members[0], name="constant_wrench")
    (words,) = what_to_inspect.of_explanation(replace(named, members=(member,), fit=fitted))
    assert "a cable" in words  # the thrust turned to all sides, and the wrench with none of them
    assert "centre of mass 12 mm" not in words
    assert what_to_inspect.of_explanation(replace(named, members=(member,), fit=fitted, flights=()))
    named = replace(named, flights=tuple(map(in_hover, named.flights)))
    (words,) = what_to_inspect.of_explanation(replace(named, members=(member,), fit=fitted))
    assert "wrench, this does not tell: a centre of mass 12 mm towards the back (" in words
    assert "a yaw bias of" in words
    assert "2 deg off the rotors' plane" in words
    found = replace(named, members=(member,), fit=fitted)
    assert words in to_json(found)["summary"]  # as on the page and in the report
    assert words in in_full(found)
    monkeypatch.setattr(type(named), "confidence", lambda *_: 0.48)
    (words,) = what_to_inspect.of_explanation(replace(named, members=(member,), fit=fitted))
    assert words.startswith("What would make such a constant wrench: a centre of mass 12 mm")
    autopilot = Autopilot("ArduPilot", parameters={"AHRS_TRIM_X": np.radians(1.5), "AHRS_TRIM_Y": 0.0})
    logged = [replace(f, flight=replace(f.flight, autopilot=autopilot)) for f in named.flights]
    trimmed = replace(named, members=(member,), fit=fitted, flights=tuple(logged))
    (words,) = what_to_inspect.of_explanation(trimmed)
    assert "2 deg off the rotors' plane (to compare with the log's AHRS_TRIM_X 1.5 deg, AHRS_TRIM_Y 0 deg), or" in words
    still = replace(fitted, covariance=np.eye(6) * weight**2)
    assert not what_to_inspect.of_explanation(replace(named, members=(member,), fit=still))


def test_the_mounting_that_the_logs_have_is_said_where_all_have_it():
    """ArduPilot's in radians, of which its IMU's samples are without; PX4's in degrees, by which they are turned."""
    ardupilot = Autopilot("ArduPilot", parameters={"AHRS_TRIM_X": np.radians(-1.0), "AHRS_TRIM_Y": np.radians(0.5)})
    px4 = Autopilot("PX4", parameters={"SENS_BOARD_X_OFF": 0, "SENS_BOARD_Y_OFF": 1.25})
    assert (
        what_to_inspect.trim([ardupilot, ardupilot])
        == "to compare with the log's AHRS_TRIM_X -1.0 deg, AHRS_TRIM_Y 0.50 deg"
    )
    assert what_to_inspect.trim([px4]) == "on top of the log's SENS_BOARD_X_OFF 0 deg, SENS_BOARD_Y_OFF 1.2 deg"
    other = Autopilot("PX4", parameters={"SENS_BOARD_X_OFF": 0, "SENS_BOARD_Y_OFF": 2})
    for logs in ([], [None], [Autopilot("PX4")], [px4, None], [px4, other]):
        assert not what_to_inspect.trim(logs)


@pytest.mark.parametrize(
    ("stds", "said"), [((0.1, 0.1, 0.1), "xyz"), ((0.1, 0.75, 0.1), "xz"), ((1.0, 0.75, 2.0), "y")]
)
def test_of_a_named_effect_the_components_beyond_chance_are_said_or_the_clearest(named, stds, said):
    """Standard deviations as shares of the values: what may be nothing is left to the table."""
    values = np.array([-0.004, 0.007, -0.005])
    parameters = tuple(("com_offset", p) for p in find("com_offset").parameters(named.model.vehicle))
    covariance = np.diag((np.array(stds) * values) ** 2)
    words = with_values(
        replace(named.fit, parameters=parameters, theta=values, covariance=covariance), named.model, "com_offset"
    )
    assert [axis for axis in "xyz" if f"{axis} " in words.partition("(")[2].replace("+- ", "")] == list(said)


def test_what_a_calibration_took_in_is_said_and_not_lost(named):
    """32 mm back, of arms of 0.3 m; 1 mm up and a turn of the IMU that may be none are no answer."""
    effects = (("com_offset", (-0.032, 0.0, 0.001), 0.0002), ("imu_misalignment", (0.03, 0.0, 0.0), 0.02))
    fitted = [replace(make_effect(MODEL.vehicle, n, theta), std=np.full(3, std)) for n, theta, std in effects]
    words = fitted_effects.already_in(MODEL.with_effects(fitted))
    assert words.endswith("the centre of mass 32 mm towards the back (arm_3) (com_offset x -0.0320 m).")
    assert "imu" not in words
    assert not fitted_effects.already_in(MODEL)
    weak = make_effect(MODEL.vehicle, "rotor_thrust", {"rotor_2": -0.2})
    heavy = make_effect(MODEL.vehicle, "com_offset", (0.001, 0.0, 0.0))
    model = MODEL.with_effects([replace(weak, std=np.full(12, 0.01)), replace(heavy, std=np.full(3, 1e-4))])
    assert "M3 20 % weaker (rotor_thrust M3 -0.200)" in fitted_effects.already_in(model)
    assert fitted_effects.largest_of(model, ["rotor_thrust", "com_offset"]).startswith("Largest: M3 is 20 % weaker (")
    assert fitted_effects.largest_of(model, ["com_offset"]).startswith("The centre of mass is 1.0 mm towards the front")
    quad = wg.load_model("crazyflie")
    behind = replace(make_effect(quad.vehicle, "com_offset", (-0.002, 0.0, 0.0)), std=np.full(3, 1e-4))
    said = fitted_effects.largest_of(quad.with_effects([behind]), ["com_offset"])
    assert said.startswith(
        "The centre of mass is 2.0 mm towards the back (M2 and M3), or propellers are weak there (com"
    )
    higher = replace(behind, theta=np.array([0.0, 0.0, 0.003]))
    assert "propellers" not in fitted_effects.largest_of(quad.with_effects([higher]), ["com_offset"])
    delayed = replace(make_effect(quad.vehicle, "command_delay", (0.05,)), std=np.array([0.005]))
    said = fitted_effects.largest_of(quad.with_effects([delayed]), ["command_delay"])
    assert said.startswith("What is commanded is 50 ms late, or the motors are slower by as much (command_delay")
    slow = replace(make_effect(MODEL.vehicle, "motor_lag", (0.06,)), std=np.array([0.005]))
    late = fitted_effects.largest_of(MODEL.with_effects([slow]), ["motor_lag"])
    assert late.startswith("The motors are 60 ms slower (")
    assert to_json(named)["already"] == ""  # what is named now was not in the model
    given = replace(named, model=MODEL.with_effects([*model.effects[1:], *named.model.effects]))
    assert any("The model already has" in part.text for part in brief(given) if isinstance(part, Line))
    assert to_json(given)["already"].endswith("again: M3 20 % weaker (rotor_thrust M3 -0.200).")


def test_what_takes_nothing_off_the_error_is_not_firm(named):
    """Commands that answer the motion leave it the evidence; the error as it is grows by 8 %."""
    worse = replace(named, members=(replace(named.members[0], share=-0.08),))
    on = Mock(data=Mock(answering=(4,)))
    rest = Mock(oscillation=None, one_rotor=None, open=np.zeros(6, dtype=bool), depends=None)
    assert named.firm == ("com_offset",)
    assert worse.firm == ()
    assert decide(on, named.members, rest) is Verdict.EFFECT
    assert decide(on, worse.members, rest) is Verdict.UNKNOWN
    words = answer(replace(worse, verdict=Verdict.UNKNOWN))
    assert words[0] == "Something is missing, but no effect of the catalogue explains it."


def test_groups_that_are_likelier_not_there_are_left_to_the_details():
    sets = (Mock(weight=0.7, names=("a",)), Mock(weight=0.3, names=("b", "c")))
    found = Mock(groups=(("a", "b"), ("c", "d + e")), posterior=Mock(sets=sets))
    assert fitted_effects.likely_groups(found) == [("a", "b")]
    found.groups = (("c", "d + e"),)
    assert fitted_effects.likely_groups(found) == [("c", "d + e")]


def test_of_what_is_partly_explained_a_group_has_one_confidence(grouped):
    """That of its line, not another in the sentence before."""
    partly = replace(grouped, verdict=Verdict.UNKNOWN)
    lines = answer_lines(partly)
    assert lines[0].text.startswith("Part of it has more than one explanation; more is missing than the catalogue")
    assert "confidence" not in lines[0].text


def test_of_an_effect_that_the_model_had_the_change_is_told(named):
    """The centre of mass is at (-4, 7, -5) mm; the model had it at y = 10 mm, 3 mm further to the left."""
    had = replace(named, given={"com_offset": np.array([-0.004, 0.010, -0.005])})
    first = answer(had)[0]
    assert re.match(
        r"Explained by com_offset \(y 0\.007\d* \+- [\d.e-]+ m; the model has 0\.0100 m\), confidence", first
    )
    (inspect,) = what_to_inspect.of_explanation(had)
    assert "the centre of mass has moved since the model was fitted by 3.0 mm towards the right (" in inspect
    assert had.changes("com_offset")["y"] == pytest.approx(-0.003, abs=2e-4)
    assert "model has" not in answer(named)[0]


def test_that_flights_do_not_agree_is_said_first(named):
    """On the farthest axis, with the mean of each flight; of flights that agree nothing is."""
    axes = FlightsApart(5, ("monday", "friday"), np.array([-0.02, 0.01])), FlightsApart(2, ("a", "b"), np.zeros(2))
    first = brief(replace(named, apart=axes))[0].text
    assert first.startswith(
        "The flights do not agree: on torque_z what is left on average is -0.0200 Nm in monday, 0.0100 Nm in friday; "
    )
    assert brief(named)[0].text.startswith("Explained by")
    half = replace(named, rms_after=np.maximum(0.5 * named.rms_before, 10.0 * named.noise))
    assert brief(half)[0].text.startswith("Partly explained by")


def test_that_nothing_is_missing_leaves_no_shared_constant_out(nothing):
    """A torque about y is the weight times a centre of mass to the front; a model that grants it does not hide it."""
    weight = MODEL.vehicle.body.mass * 9.80665
    assert answer(nothing)[0] == "Nothing is missing that these logs can show."
    known = replace(nothing.model, between_flights=(0.1,) * 6)
    shared = replace(nothing, granted=(GrantedTrim(4, 1e-3 * weight, 2.1),), model=known)
    assert answer(shared)[0].startswith(
        "Nothing is missing that these logs can show, but on torque_y these flights are off by "
    )
    assert (
        "on average, 2.1 times what flights of this vehicle differ by: a centre of mass 1.0 mm towards the front"
        in answer(shared)[0]
    )
    assert "; on torque_y these" in what_to_inspect.granted(shared, "; ")
    yaw = what_to_inspect.granted(replace(nothing, granted=(GrantedTrim(5, 0.6, 2.4),)), "; ")
    named_too = replace(nothing, granted=(GrantedTrim(5, 0.6, 2.4),), verdict=Verdict.UNKNOWN)
    assert "On torque_z these flights are off by 0.60 Nm on average" in " ".join(answer(named_too))
    assert "2.4 times what thrust axes as unsure as these make: a yaw bias of 0.60 Nm" in yaw


def test_the_largest_remaining_error_is_counted_in_noise(named):
    """0.5 N is little beside 0.1 Nm where the gyroscope is a hundred times better."""
    noise = np.array([0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-3])
    one = replace(named, noise=noise, rms_after=np.array([0.5, 0.1, 0.1, 1e-3, 0.1, 1e-3]))
    assert "torque_y, 0.1 Nm rms (sensor noise 0.001)" in summary(one)
    two = replace(one, rms_after=np.array([0.5, 0.1, 0.1, 1e-3, 1e-3, 1e-3]))
    assert "force_x, 0.5 N rms (sensor noise 0.1)" in summary(two)
    assert "rms (sensor noise 0.001), 100 times the noise: gusts," in summary(one)


def test_an_error_far_above_the_noise_that_commands_answered_is_no_plain_nothing(nothing):
    """Nobody can tell gusts from an inertia that is five times too small where the loop answers both."""
    noise = np.array([0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-3])
    loud = replace(nothing, noise=noise, rms_after=noise * [1, 1, 1, 1, 300, 1], answering=(4,), open=np.zeros(6, bool))
    said = " ".join(answer(loud))
    assert said.startswith("Nothing of the catalogue is missing that these logs can show.")
    assert "300 times the noise: gusts that the commands answered, slowly logged commands, or a number of the" in said
    quiet = " ".join(answer(replace(loud, rms_after=noise)))
    assert quiet.startswith("Nothing is missing")
    assert "times the noise" not in quiet


def test_a_group_is_told_with_all_its_members_and_their_weights(grouped):
    assert grouped.verdict == "group"
    assert set(grouped.groups[0]) == {"thrust_scale", "coaxial_loss"}
    said = summary(grouped)
    assert all(name in said for name in grouped.groups[0])
    assert said.startswith("Either all thrust is ")
    weights = [float(w) for w in re.findall(r", (\d+) %[;:]", said)]
    assert sum(weights) == pytest.approx(100.0, abs=2.0 + 0.5 * len(weights))  # less than 2 % is not said; rounding
    assert max(weights) < 98.0


def test_explanations_that_are_alike_are_said_by_what_a_pilot_can_look_for():
    """A rotor of 12 +- 3 % by its name, a centre of mass 5 mm off, (4, 3) mm; of three effects together the names."""
    rotor = replace(make_effect(MODEL.vehicle, "rotor_thrust", {"rotor_2": -0.12}), std=np.full(12, 0.03))
    mass = make_effect(MODEL.vehicle, "com_offset", (0.004, 0.003, 0.0))
    drag = make_effect(MODEL.vehicle, "body_drag", {"linear_x": 0.1})
    vehicle = MODEL.vehicle
    assert fitted_effects.together([rotor], vehicle) == "M3 is 12 +- 3.0 % weaker (rotor_thrust)"
    words = fitted_effects.together([mass], vehicle)
    assert words.startswith("the centre of mass is 5.0 mm towards the front left (")
    assert words.endswith("(com_offset)")
    both = fitted_effects.together([mass, rotor], vehicle)
    assert both.endswith(" and M3 is 12 +- 3.0 % weaker (com_offset + rotor_thrust)")
    two = replace(make_effect(vehicle, "rotor_thrust", {"rotor_2": -0.12, "rotor_0": -0.1}), std=np.full(12, 0.03))
    assert fitted_effects.together([two], vehicle).endswith("% weaker (rotor_thrust, also M1 -10 +- 3.0 %)")
    assert fitted_effects.together([drag], vehicle) == "body_drag linear_x 0.10 N s/m"
    assert fitted_effects.together([drag, mass], vehicle) == "body_drag + com_offset"
    assert fitted_effects.together([drag, mass, rotor], vehicle) == "body_drag + com_offset + rotor_thrust"


def test_what_cannot_be_told_apart_has_a_line_each(grouped):
    """Under a head, with the weight of each; what no line has is the weight of sets with none of them."""
    head, *rows = answer_lines(grouped)
    assert head.text == "One of these, this flight cannot tell which:"
    weights = [float(m[1]) for row in rows if (m := re.match(r" +(\d+) %  ", row.text))]
    assert sum(weights) == pytest.approx(100.0, abs=2.0 + 0.5 * len(weights))
    assert "thrust_scale" in rows[0].text + rows[1].text
    assert "coaxial_loss" in rows[0].text + rows[1].text
    mine = sum(s.weight for s in grouped.posterior.sets if grouped.members[0].name in s.names)
    assert weights[0] == pytest.approx(100.0 * mine, abs=0.51)


def test_of_several_groups_each_is_a_sentence(grouped, monkeypatch):
    """A list for each would leave no room on a screen for what to do."""
    monkeypatch.setattr(fitted_effects, "likely_groups", lambda found: [*found.groups[:1]] * 2)
    one, other, *rest = (line.text for line in answer_lines(grouped))
    assert one == other
    assert one.startswith("Either ")
    assert one.endswith("this flight cannot tell which.")
    assert not any("of these" in text for text in rest)


def test_a_motion_that_an_estimator_smoothed_has_no_noise_to_be_held_against(nothing):
    """What is left is said with the sensor's noise where there was a sensor."""
    (flown,) = nothing.flights
    smoothed = replace(flown, records=tuple(replace(r, has_imu=False) for r in flown.records))
    assert "noise" in posterior.largest_residual(nothing)
    assert "noise" not in posterior.largest_residual(replace(nothing, flights=(smoothed,)))


def test_where_nothing_is_missing_there_is_nothing_to_do(nothing):
    assert nothing.verdict == "nothing"
    assert what_next(nothing, NAME, ["a.mcap"]) == []


def test_where_nothing_is_established_a_healthy_flight_is_to_be_compared_with(nothing):
    open_one = replace(nothing, open=np.ones(6, dtype=bool))
    (line,) = what_next(open_one, NAME, ["a.mcap"], " --cutoff 7")
    assert line.text.startswith("next, with an earlier flight")
    assert line.text.endswith(f": wrenchgap changed a.mcap --cutoff 7 --healthy HEALTHY_LOG -m {NAME}")


def test_where_nothing_is_established_what_takes_off_much_is_told_as_such(nothing, named):
    """Half of the error in two of ten blocks, t 2, is no finding; but not nothing either. Turbulence fits much."""
    (offset,) = (c for c in named.ranking if c.name == "com_offset")
    (mass,) = (c for c in nothing.ranking if c.name == "mass")
    near = replace(nothing, ranking=(replace(offset, score=0.5, significance=2.0), mass))
    assert "Nearest, and not established: com_offset (" in summary(near)
    assert "50 % of the error energy" in summary(near)
    alike = replace(mass, score=0.48, significance=2.0)
    assert ") or mass, which" in summary(replace(near, ranking=(*near.ranking[:1], alike)))
    for less in (replace(offset, score=0.05), replace(offset, score=0.5, significance=1.0)):
        assert "Nearest" not in summary(replace(near, ranking=(less, mass)))
    assert "Nearest" not in summary(replace(near, open=np.ones(6, dtype=bool)))


def test_settings_reach_the_search(logs, named):
    """Where every effect costs more than any fit is worth, none is named, and something is missing all the same."""
    flights = wg.open_flights(logs.train, MODEL)
    dear = wg.explain(flights, MODEL, names=("com_offset", "mass"), settings=SearchSettings(price=1e9), jobs=1)
    assert (dear.effects, dear.verdict) == ((), Verdict.UNKNOWN)
    assert "com_offset" in named.effects


def test_a_flight_too_short_is_no_gap_in_the_catalogue(logs):
    (flight,) = wg.open_flights(logs.train, MODEL, between=(5.0, 7.0))
    found = wg.explain(flight, MODEL, names=("com_offset", "mass"), jobs=1)
    loud = replace(found, verdict=Verdict.UNKNOWN, members=())
    assert summary(loud).startswith("Too short to tell what is missing. Nearest, and not established: com_offset (")
    assert "catalogue" not in summary(loud)
    assert what_next(loud, NAME, ["a.mcap"])[-1].text == "next: give a longer flight"
    assert "catalogue" in summary(replace(loud, flights=()))


def test_what_turbulence_does_not_leave_is_told_by_the_weight(nothing):
    """3.8 N of a vehicle of 39 N is 9.7 %; 0.4 N is what a calm day leaves."""
    weight = nothing.model.vehicle.body.mass * 9.80665
    for part, said in ((0.097, True), (0.01, False)):
        left = replace(nothing, open=np.ones(6, dtype=bool), rms_after=np.array([0.0, 0.0, part * weight, 0, 0, 0]))
        assert ("10 % of the weight" in summary(left)) is said


def test_where_most_of_the_weight_names_something_it_is_not_said_that_nothing_is_missing(nothing, named):
    """40 % for nothing, 60 % for a mass too small for a name: neither is established."""
    none = replace(named.posterior.best, names=(), weight=0.4)
    some = replace(named.posterior.best, names=("mass",), weight=0.6)
    torn = replace(nothing, posterior=replace(nothing.posterior, sets=(some, none)))
    assert summary(nothing).startswith("Nothing is missing")
    assert summary(torn).startswith("Nothing is established")
    assert all(words in summary(torn) for words in ("40 %", "mass (60 %)"))


def test_where_commands_answer_what_takes_most_off_an_axis_is_said_and_not_established(nothing, named):
    """A rate loop that answers gusts looks like a late command: 70 % of the rms of a torque is 91 % of its energy."""
    (offset,) = (c for c in named.ranking if c.name == "com_offset")
    off = np.array([0.0, 0.0, 0.0, 0.7, 0.1, 0.0])
    late = replace(offset, reduction=off, significance=16.0)
    loud = replace(nothing, ranking=(late,), answering=(3, 4, 5), open=np.arange(6) > 2)
    assert summary(loud).startswith("Nothing is established.")
    assert "Not established: com_offset (" in summary(loud)
    assert "alone reduces the error of torque_x by 70 %; the controller's answer to a disturbance" in summary(loud)
    assert "nothing that was logged predicts it" not in summary(loud)
    assert "Not established: com_offset (" in summary(replace(loud, verdict=Verdict.UNKNOWN))
    for other in (
        replace(loud, answering=()),
        replace(loud, ranking=(replace(late, significance=2.0),)),
        replace(loud, ranking=(replace(late, reduction=0.4 * off),)),
    ):
        assert "Not established" not in summary(other)
        assert summary(other).startswith("Nothing is established. ")
        assert "Open: on torque_x" in summary(other)
        shut = replace(other, open=np.zeros(6, dtype=bool))
        assert summary(shut).startswith("Nothing is missing that these logs can show.")


def test_a_few_seconds_of_flight_are_called_too_short(nothing):
    (flown,) = nothing.flights
    some = replace(flown, records=(window(flown.records[0], 0, 200),))
    assert "too short" in " ".join(short(replace(nothing, flights=(some,))))
    assert short(nothing) == []


def test_what_would_settle_it_reads_what_the_answer_says(grouped):
    """Thin air by the final fit, in the sets as in the answer."""
    best = grouped.posterior.best
    ((name, values),) = best.values(MODEL.vehicle).items()
    assert values == pytest.approx({v.name: v.value for v in grouped.fit.values(name)})


def test_no_check_is_offered_of_what_the_answer_does_not_name(grouped):
    """A place of the IMU that no line gives is not what is open."""
    place, weigh = (
        Mock(kind="bench", what=what)
        for what in ("Measure the IMU: -12 mm if imu_lever_arm; 0 if not.", "Weigh it: 1.1 kg if mass or thrust_scale.")
    )
    asked = replace(grouped, posterior=replace(grouped.posterior, settle=(place, weigh)))
    assert posterior.checks_of(asked) == [weigh]


def test_the_check_that_settles_most_stands_in_the_answer():
    """Not the cheapest: of what is likely it may tell nothing."""
    swing, weigh, hang = (
        Check("bench", f"{what} it: 1 if mass; 0 if not.", (), what, settles)
        for what, settles in (("Swing", 0.1), ("Weigh", 0.6), ("Hang", 0.6))
    )
    assert posterior.first_check([swing, weigh, hang]) == [f"To settle what is open, on the bench: {weigh.what}"]
    assert posterior.first_check([]) == []


def test_what_is_unknown_is_told_with_the_number_of_every_clue(named, nothing):
    found = replace(swinging(named), depends=heading(0.62), concentrated=0.81)
    words = summary(found)
    assert all(clue in words for clue in ("com_offset", "0.72 Hz", "0.012", "75 %", "heading", "62 %", "81 %"))
    assert "height" not in words  # looked at, and not chosen
    assert not re.search("Hz|heading", summary(replace(nothing, verdict=Verdict.UNKNOWN)))


def test_open_bands_are_told_by_axis(named):
    bands = (OpenBand(4, 2.0, 3.0, 6.6), OpenBand(0, 0.7, 1.2, 4.14), OpenBand(0, 0.3, 0.7, 3.0))
    found = replace(named, verdict=Verdict.UNKNOWN, bands=bands)
    assert "torque_y at 2 to 3 Hz (6.6 times the noise), force_x at 0.3 to 1.2 Hz (4.1 times the noise)" in summary(
        found
    )
    told = to_json(found)["left"]["bands"]
    assert told[1] == {"axis": "force_x", "low_hz": 0.7, "high_hz": 1.2, "over_noise": 4.14}
    assert to_json(named)["left"]["bands"] == []


def test_firm_is_nothing_that_another_stands_in_the_place_of(named, grouped):
    assert named.firm == ("com_offset",)
    assert named.members[0].alike == ()
    assert not set(grouped.firm) & set(grouped.groups[0])
    rival = replace(grouped.members[0].alike[0], names=("mass",))
    assert replace(named, members=(replace(named.members[0], rivals=(rival,)),)).firm == ()


def test_firm_is_nothing_that_a_rotor_makes_which_comes_and_goes(named):
    assert replace(named, named_there=True).firm == ()


def test_nothing_is_firm_beside_what_explains_most_at_the_limit_of_what_is_plausible(named):
    """The lead's law is another one, and the others were fitted beside it: that is said, and the others are perhaps."""
    (member,) = named.members
    lead = replace(member, name="thrust_curve", share=2.0 * member.share)
    limit = tuple(f"thrust_curve.{p.name}" for p in find("thrust_curve").parameters(named.model.vehicle))
    found = replace(named, members=(lead, member), fit=replace(named.fit, at_bound=limit), verdict=Verdict.UNKNOWN)
    assert found.firm == ()
    words = answer(found)
    assert words[0].startswith("Perhaps partly explained by")
    assert any(text.startswith("Thrust_curve explains most, at the limit of what is plausible:") for text in words)
    assert replace(found, members=(member, lead)).firm == ("com_offset",)


def test_a_delay_is_looked_for_at_the_stamps_too(named, monkeypatch):
    """Commands that come late and an IMU that is stamped late predict the same of one log."""
    parameters = tuple(("command_delay", p) for p in find("command_delay").parameters(named.model.vehicle))
    fitted = replace(named.fit, parameters=parameters, theta=np.array([0.05]), covariance=1e-6 * np.eye(1))
    found = replace(named, members=(replace(named.members[0], name="command_delay"),), fit=fitted)
    monkeypatch.setattr(type(named), "firm", ("command_delay",))
    (words,) = what_to_inspect.of_explanation(found)
    assert "the stamps of the IMU" in words


def test_firm_is_nothing_whose_evidence_is_on_open_axes_alone(named):
    """The evidence of each axis adds up to all; where it is in torques only, open torques may have made it."""
    (member,) = named.members
    assert member.by_axis.sum() == pytest.approx(member.evidence)
    forces = np.arange(6) < 3
    turning = replace(member, by_axis=np.where(forces, 0.0, member.by_axis))
    unsure = replace(named, verdict=Verdict.UNKNOWN, members=(turning,))
    assert replace(unsure, open=forces).firm == ("com_offset",)
    assert replace(unsure, open=~forces).firm == ()


def commands(lines):
    """The commands in these lines, as arguments."""
    return [shlex.split(re.sub(r".*?\bwrenchgap ", "", line.text, count=1)) for line in lines]


def test_the_command_that_is_told_adds_what_was_found(named, logs, run, result_of):
    healthy, command = commands(what_next(named, NAME, [str(logs.train)]))
    assert healthy[0] == "changed"
    assert run(*command).exit_code == 0
    (effect,) = wg.load_model("fitted.toml").effects
    assert effect.name == "com_offset"
    np.testing.assert_allclose(effect.theta, [-0.004, 0.007, -0.005], atol=2e-4)
    after = result_of("compare", logs.test, "-m", "fitted.toml")["models"][-1]
    assert min(after["fall_of_rms"][3:]) > 0.9


def test_a_group_is_told_the_healthy_flight_and_the_flight_that_separates_it_first(grouped):
    healthy, design, add = commands(what_next(grouped, NAME, ["a.mcap", "day 2.mcap"]))
    assert healthy == ["changed", "a.mcap", "day 2.mcap", "--healthy", "HEALTHY_LOG", "-m", NAME]
    assert design[0] == "design"
    assert set(design[1:3]) == {"thrust_scale", "coaxial_loss"}
    assert design[3:] == ["-m", NAME, "--from", "a.mcap", "day 2.mcap", "-o", "separate.toml"]
    assert add[:2] == ["add", grouped.effects[0]]


READ = ["--topic", "imu=/imu", "--shift", "odometry=0.001", "--cutoff", "7.5", "--between", ":11"]
READ += ["--unmeasured", "force_x,force_y"]
"""Options that say how a log is to be read."""


def pairs(words):
    """Options of a command with their values."""
    return {(a, b) for a, b in pairwise(words) if a.startswith("--")}


def test_a_command_that_is_told_reads_the_logs_as_they_were_read(logs, run, tmp_path):
    """As it is printed, word by word, it runs, and by what it says it comes to the same flight."""
    (tmp_path / "a b.mcap").write_bytes(logs.train.read_bytes())
    told = {}
    for words in (("explain", "--effects-only", "com_offset,mass"), ("compare",)):
        done = run(words[0], "a b.mcap", "-m", NAME, *words[1:], *READ)
        assert done.exit_code == 0, done.output
        (text,) = re.findall(r"next: wrenchgap (.*?)(?: note:|$)", " ".join(done.stdout.split()))
        told[words[0]] = shlex.split(text)
    add, ask = told["explain"], told["compare"]
    assert add[:2] == ["add", "com_offset"]
    assert ask[:4] == ["explain", "a b.mcap", "-m", NAME]
    for words in (add, ask):
        assert pairs(READ) <= pairs(words)
    done = run(*add)
    assert done.exit_code == 0, done.output
    (trial,) = (version.trial for version in wg.load_model("fitted.toml").history[-1:])
    assert np.isnan(trial.after[:2]).all()


def test_the_flight_that_separates_is_designed_for_the_logs_as_they_were_read(grouped):
    read = " --cutoff 7 --shift imu=0.1", " --shift imu=0.1"
    _, design, add = commands(what_next(grouped, NAME, ["a.mcap"], *read))
    assert design[-6:] == ["--from", "a.mcap", "--shift", "imu=0.1", "-o", "separate.toml"]
    assert add[-8:] == ["--from", "a.mcap", "--cutoff", "7", "--shift", "imu=0.1", "-o", "fitted.toml"]


def test_what_is_unknown_is_compared_with_a_healthy_flight_before_anything_is_added(named, nothing):
    lines = what_next(swinging(named), NAME, ["a.mcap"])
    healthy, look, add = commands(lines)
    assert healthy[0] == "changed"
    assert look[:2] == ["discover", "a.mcap"]
    assert add[:2] == ["add", "com_offset"]
    assert [line.text.startswith("next") for line in lines] == [True, False, False]
    healthy, only = commands(what_next(replace(nothing, verdict=Verdict.UNKNOWN), NAME, ["a.mcap"]))
    assert healthy[0] == "changed"
    assert only[0] == "discover"


def test_what_is_not_established_is_no_next_step(grouped):
    lines = what_next(grouped, NAME, ["a.mcap"])
    assert grouped.firm == ()
    assert [line.text.startswith("next") for line in lines] == [True, False, False]
    assert lines[-1].text.startswith("what is not established can be added all the same")


def test_what_could_not_be_tried_is_listed_by_reason(named):
    ((reason, names),) = not_tried(named.untried).items()
    assert names == ["battery_sag"]
    assert "--topic battery=" in reason
    assert "effect battery_sag" not in reason


def test_what_could_not_be_fitted_says_so_once(logs, monkeypatch):
    refuse = Mock(side_effect=ModelError("effect mass: the change is too large"))
    monkeypatch.setattr(single_effects, "_candidate", refuse)
    untried = explained(logs.ideal, "mass").untried
    assert not_tried(untried) == {"could not be fitted (the change is too large)": ["mass"]}


@pytest.mark.parametrize("which", ["named", "grouped"])
def test_table_of_members_fits_a_terminal(which, request):
    found = request.getfixturevalue(which)
    out = io.StringIO()
    Console(file=out, width=100, color_system=None).print(members(found))
    text = out.getvalue()
    assert max(map(len, text.splitlines())) <= 100
    for member in found.members:
        (line,) = [line for line in text.splitlines() if line.split()[:1] == [member.name]]
        assert f"{100 * found.confidence(member):.0f} %" in line
        assert share(member.share) in line


def test_a_name_that_is_not_firm_has_no_confidence_in_answer_or_table(named):
    """In most sets, but all that speaks for it is on axes that are open: it has a size, and is not established."""
    forces = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], dtype=bool)
    member = replace(named.members[0], by_axis=np.where(forces, 0.0, 10.0))
    found = replace(named, members=(member,), verdict=Verdict.UNKNOWN, open=~forces)
    assert found.firm == ()
    assert answer(found)[0].startswith("Perhaps partly explained by com_offset")
    out = io.StringIO()
    Console(file=out, width=100, color_system=None).print(members(found))
    for text in (answer(found)[0], out.getvalue()):
        assert "not established" in text
        assert "98 %" not in text


def test_json_has_no_keys_but_those_of_its_schema(named):
    assert VERSIONS["explain"] == 2
    assert set(to_json(named)) <= set(schema("explain")["properties"])


def test_json_tells_what_the_explanation_holds(grouped):
    body = written(grouped)
    assert [m["effect"] for m in body["members"]] == body["effects"] == list(grouped.effects)
    shares = [m["share"] for m in body["members"]]
    assert shares == sorted(shares, reverse=True)
    for member, listed in zip(grouped.members, body["members"], strict=True):
        assert listed["group"] == [member.name, *(r["effect"] for r in listed["rivals"] if r["alike"])]
        assert 0 < listed["probability"] < 1
    assert body["groups"] == [m["group"] for m in body["members"] if len(m["group"]) > 1]
    assert body["summary"] == summary(grouped)
    assert body["left"]["over_noise"] == grouped.left


def test_json_of_what_is_unknown_holds_the_swing_and_the_inputs(named):
    found = replace(swinging(named), depends=heading(0.62))
    left = written(found)["left"]
    assert left["swing"]["frequency_hz"] == 0.724
    assert left["swing"]["words"] == oscillation_in_words(found.oscillation)
    assert [g["name"] for g in left["depends_on"]["groups"] if g["chosen"]] == ["heading"]
    assert to_json(named)["left"]["swing"] is None


def test_what_one_rotor_leaves_is_said_by_the_users_name(named):
    vehicle = replace(named.model.vehicle, rotor_names=("M1", "M2", "M3", *([""] * 9)))
    model = replace(named.model, vehicle=vehicle)
    found = replace(named, verdict=Verdict.UNKNOWN, model=model, one_rotor=OneRotor((2,), 0.97))
    assert "97 % of the residual pushes where rotor M3 pushes" in summary(found)
    assert written(found)["left"]["one_rotor"] == {"rotors": ["M3"], "share": 0.97}
    assert written(named)["left"]["one_rotor"] is None


def written(found):
    return json.loads(json.dumps(plain(to_json(found))))


def test_thrust_beyond_what_the_model_knows_stands_in_the_answer(logs):
    """All of it 6 % less than the commands ask for: or a vehicle that is 1 / 0.94 as heavy; either is one to weigh."""
    known = replace(MODEL, vehicle=replace(MODEL.vehicle, tolerances=Tolerances(thrust=0.02)))
    (flight,) = wg.open_flights(logs.ideal, known)
    less = replace(flight, records=tuple(replace(r, measured=0.94 * r.measured) for r in flight.records))
    found = wg.explain(less, known, names=("com_offset",), injections=0, jobs=1)
    assert thrust_off(found) == pytest.approx(-0.06, abs=0.003)
    said = thrust_beyond(found)
    assert re.match(r"All thrust is (5\.\d|6\.\d|6) % less than the model has it, or the vehicle 6\.\d % heavier", said)
    assert said in answer(found)
    assert not any("no effect is named for that" in text for text in evidence(found))
