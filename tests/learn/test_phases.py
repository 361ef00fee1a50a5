"""Phases of flights that an integrator of the test's own flew, from and to a ground of springs."""

from dataclasses import replace

import numpy as np
import pytest

from tests.learn.standing_craft import C_F, MASS, MODEL, SPEED_MAX, Plan, fly
from wrenchgap import load_model
from wrenchgap.flight.check import TimeLeftOut
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.data.phases import phase_checks
from wrenchgap.learn.data.phases.ground import contact, grounded
from wrenchgap.learn.data.phases.phase import NAMES, Phase, Signals, phase_names, used_samples


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("phases") / "standing.toml"
    path.write_text(MODEL, encoding="utf-8")
    return load_model(path)


@pytest.fixture(scope="module")
def usual():
    return fly(Plan())


def found(flight, model, **how):
    return {name: [p for p in opened(flight, model, **how).phases if p.name == name] for name in NAMES}


def test_the_ground_is_found_where_the_feet_touch_it(usual, model):
    phases = found(usual.flight, model)
    first, second = phases["ground"]
    assert first.start == pytest.approx(0.0, abs=0.01)
    assert first.stop == pytest.approx(usual.last_contact_before(5.0), abs=0.3)
    assert second.start == pytest.approx(usual.first_contact_after(5.0), abs=0.3)
    (up,), (down,) = phases["take-off"], phases["landing"]
    assert up.start == pytest.approx(first.stop, abs=0.01)
    assert down.stop == pytest.approx(second.start, abs=0.01)
    assert not phases["crash"] + phases["impact"] + phases["saturation"]
    height = dict(zip(usual.flight.odometry.time, usual.flight.odometry.position_E[:, 2], strict=True))
    assert height[up.stop] == pytest.approx(0.1 + 0.4, abs=0.05)  # feet of 0.1 m, four radii of 0.1 m
    assert height[down.start] == pytest.approx(0.1 + 0.4, abs=0.05)


def test_what_is_left_out_is_all_but_the_flight(usual, model):
    one = opened(usual.flight, model)
    (flown,) = one.flown
    up, down = (next(p for p in one.phases if p.name == name) for name in ("take-off", "landing"))
    assert up.stop < flown.time[0] < up.stop + 0.02
    assert down.start > flown.time[-1] > down.start - 0.02
    told = [note for note in one.notes if isinstance(note, TimeLeftOut)]
    assert [t.why.split(":")[0] for t in told] == ["ground", "take-off", "landing", "ground"]
    assert told[0].start == -np.inf
    assert told[-1].stop == np.inf


def test_rotors_that_spin_on_the_ground_without_odometry_are_no_flight(usual, model):
    phases = found(replace(usual.flight, odometry=None), model)
    assert phases["ground"][0].stop == pytest.approx(usual.last_contact_before(5.0), abs=0.3)
    assert phases["take-off"][0].stop - phases["take-off"][0].start == pytest.approx(1.0, abs=0.02)


def test_kept_phases_are_found_and_used(usual, model):
    one = opened(usual.flight, model, keep=["take-off", "landing"])
    assert [p.left_out for p in one.phases] == [True, False, False, True]
    plain = opened(usual.flight, model)
    assert len(one.flown[0]) > len(plain.flown[0]) + 400
    every = opened(usual.flight, model, keep=["all"])
    assert len(every.flown) == 1
    assert not every.left_out


@pytest.mark.parametrize("seed", [1, 2])
def test_turning_over_and_free_fall_are_flight(seed, model):
    flown = fly(Plan(seconds=9.0, on_ground=False, off=None, high=8.0, flip=2.5, cut=(6.0, 6.4), shaken=1.5, seed=seed))
    one = opened(flown.flight, model)
    assert not [p for p in one.phases if p.left_out]
    assert len(one.flown[0]) == len(one.samples[0])


def test_a_blow_is_left_out_and_the_flight_goes_on(model):
    one = opened(fly(Plan(seconds=8.0, on_ground=False, off=None, blow=4.0)).flight, model)
    (impact,) = one.phases
    assert impact.name == "impact"
    assert impact.start < 4.0 < impact.stop < 4.6
    assert impact.event == pytest.approx(4.0, abs=0.03)
    assert len(one.flown) == 2
    assert [c.name for c in one.checks if c.level == "warn"] == ["crash"]


def test_a_crash_begins_where_motion_contradicts_the_commands(model):
    flown = fly(Plan(seconds=14.0, on_ground=False, off=None, high=6.0, dead=6.0))
    (crash,) = found(flown.flight, model, gate=False)["crash"]
    assert 5.7 < crash.start < flown.first_contact_after(6.0) + 0.1
    assert crash.stop == pytest.approx(14.0, abs=0.02)
    assert crash.event == pytest.approx(flown.first_contact_after(6.0), abs=0.02)
    assert crash.why.startswith("an impact, 1.3 s after motion began to contradict the commands")
    with pytest.raises(LogError, match=r"no 2 s of flight \(.*crash 6\.\d s\); keep a phase with --keep crash"):
        opened(fly(Plan(dead=6.0, off=None)).flight, model)


def test_a_crash_of_which_no_impact_was_logged_is_a_loss_of_control():
    """As where a log ends in the fall."""
    lost = Phase("crash", 3.0, 5.0, "motion contradicts the commands until the end", event=3.1)
    (check,) = phase_checks([lost])
    assert check.words.startswith("Loss of control at 3.10 s: motion contradicts the commands until the end; 3.00 to")
    (check,) = phase_checks([replace(lost, why="an impact, and motion contradicts the commands until the end")])
    assert check.words.startswith("Crash at 3.10 s: an impact")


def test_what_is_within_the_filters_of_an_impact_is_said_to_precede_no_crash(model):
    """0.6 s of fall from 2 m; a flip that was commanded and struck the ground looks the same."""
    flown = fly(Plan(seconds=14.0, on_ground=False, off=None, high=2.0, dead=6.0))
    (crash,) = found(flown.flight, model, gate=False)["crash"]
    assert crash.event == pytest.approx(flown.first_contact_after(6.0), abs=0.02)
    assert crash.why.startswith("an impact, and ")


def test_a_log_on_the_ground_alone_says_so_in_one_line(model):
    flown = fly(Plan(seconds=5.0, start=1.0, spool=20.0, off=4.0))  # never more than 15 % of the weight
    with pytest.raises(LogError, match=r"no 2 s of flight \(ground 5\.0 s\): the rotors never carry standing's weight"):
        opened(flown.flight, model)


def test_a_command_beyond_the_rotors_is_left_out_and_one_at_their_limit_is_not(model):
    flight = fly(Plan(seconds=8.0, on_ground=False, off=None)).flight
    time, wrench = flight.commanded.time, flight.commanded.wrench_B.copy()
    most = 4 * C_F * SPEED_MAX**2
    wrench[(time > 4.0) & (time < 4.5), 2] = 1.5 * most
    asked = replace(flight, actuators=None, commanded=replace(flight.commanded, wrench_B=wrench))
    (beyond,) = [p for p in opened(asked, model).phases if p.name == "saturation" and p.left_out]
    assert 3.8 < beyond.start < 4.05
    assert 4.45 < beyond.stop < 4.75
    speed = flight.actuators.rotor_speed.copy()
    speed[(time > 4.0) & (time < 4.1)] = SPEED_MAX
    at = replace(flight, commanded=None, actuators=replace(flight.actuators, rotor_speed=speed))
    (limit,) = opened(at, model).phases
    assert (limit.name, limit.left_out) == ("saturation", False)
    assert limit.stop - limit.start == pytest.approx(0.1, abs=0.02)


def test_a_limit_that_the_flight_is_beyond_throughout_is_doubted(model):
    flight = fly(Plan(seconds=6.0, on_ground=False, off=None)).flight
    rotors = replace(model.vehicle.rotors, speed_max=np.full(4, 480.0))  # it hovers at 517 rad/s
    weak = replace(model, vehicle=replace(model.vehicle, rotors=rotors))
    assert np.sqrt(MASS * 9.81 / 4 / C_F) > 500.0
    one = opened(flight, weak)
    assert not [p for p in one.phases if p.left_out]
    assert next(c for c in one.checks if c.name == "saturation").words.endswith("speed_max too low?; kept.")


@pytest.mark.parametrize(("pushed", "speed", "touches"), [(0.5, 0.3, True), (0.5, 1.2, False), (0.0, 1.2, True)])
def test_what_moves_with_turning_rotors_is_not_held(pushed, speed, touches):
    """Half of the weight is carried by something else; a vehicle is carried away once its rotors stand."""
    time = np.arange(0.0, 4.0, 0.02)
    up = np.tile([0.0, 0.0, 1.0], (len(time), 1))
    still = np.zeros(len(time))
    part = Signals(time, 0.02, pushed * up, up, pushed * up, up, still, still, np.full(len(time), speed), vertical=True)
    assert contact(part, 1.0).all() == touches
    assert contact(part, 1.0).any() == touches


@pytest.mark.parametrize("cut", [[], [230], [230, 400]])
def test_a_crash_goes_on_behind_a_gap(cut):
    """From 4 s on it hangs upside down in a tree, and the rotors push on; the log has gaps at 4.6 and 8 s."""
    time = np.arange(0.0, 12.0, 0.02)
    up = np.tile([0.0, 0.0, 1.0], (len(time), 1))
    felt = np.where(time[:, None] < 4.0, up, -up)
    still, turning = np.zeros(len(time)), np.full(len(time), 3.0)
    parts = [
        Signals(t, 0.02, u, f, u, f, r, s, s + 5.0, vertical=True)
        for t, u, f, r, s in zip(*(np.split(v, cut) for v in (time, up, felt, turning, still)), strict=True)
    ]
    (crash,) = [p for p in grounded(parts, 1.0) if p.name == "crash"]
    assert crash.start == pytest.approx(4.0, abs=0.3)
    assert crash.stop == pytest.approx(time[-1])


def test_names_of_phases():
    assert phase_names(["Take off", "takeoff", "crash"]) == ("take-off", "crash")
    assert phase_names(["all"]) == tuple(NAMES)
    with pytest.raises(UsageError, match="--keep flight: no phase is called so; phases: ground, held, take-off"):
        phase_names(["flight"])


def test_only_what_is_left_out_is_not_used():
    time = np.arange(5.0)
    phases = [Phase("ground", 0.0, 1.0, ""), Phase("saturation", 3.0, 3.5, "", left_out=False)]
    assert used_samples(time, phases).tolist() == [False, False, True, True, True]
