"""Whether to fly: intervals by closed forms, a fleet of another engine, what decides, and what the command says."""

from dataclasses import replace

import jsonschema
import numpy as np
import pytest

import wrenchgap as wg
from scripts.json_documents import schema
from tests.independent.flown_quadrotor import MODEL, Case, fly
from tests.independent.readiness_fleet import SIGMA, coverage, weak
from tests.replay import autopilot_logs
from tests.replay.autopilot_logs import (
    FACTOR,
    FULL,
    INERTIA,
    MASS,
    ardupilot_gains,
    gains,
    throttle,
    true_vehicle,
    write_dataflash,
    write_ulog,
)
from wrenchgap.flight.check import Check
from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.diagnose.disturbance_process import Left
from wrenchgap.learn.diagnose.flown_controller import flown_by_autopilot, flown_by_controller
from wrenchgap.learn.identify import contradiction
from wrenchgap.learn.identify.contradiction import as_flown
from wrenchgap.plant import model_file
from wrenchgap.plant.command_curve import CommandCurve, Polynomial
from wrenchgap.plant.model import make_effect
from wrenchgap.replay import readiness
from wrenchgap.replay.loop_margins import Gains, LoopMargins
from wrenchgap.replay.present.documents import document
from wrenchgap.replay.present.readiness import NOT_SAID, parts, to_json
from wrenchgap.replay.readiness import ROOM, Decision


@pytest.fixture(scope="module")
def still():
    """A hover in still air, at the rate of the loop, with a first rotor that has lost a fifth."""
    return wg.open_flights(fly([Case("still", seed=3, seconds=10.0, drag=0.0, blades=(0.8, 1.0, 1.0, 1.0))]), MODEL)


@pytest.fixture(scope="module")
def ready(still):
    return wg.ready(still, weak(loss=0.2), "hover")


def of(found, part):
    return next(a for a in found.authority if a.part == part)


def test_the_interval_is_that_of_the_values(ready):
    """A rotor that gives 1 - x of its thrust has to be asked for 1 / (1 - x), and for what is left of the flight."""
    one = of(ready, "M1")
    quantiles = one.nominal / (1.0 - 0.2 + SIGMA * np.array([1.645, 0.0, -1.645]))
    assert one.needs / one.needs[1] == pytest.approx(quantiles / quantiles[1], rel=0.03)
    assert 1.0 < one.needs[1] / quantiles[1] < 1.08
    assert ready.authority[0].part == "M1"
    assert ready.first[0].parameter == "rotor_0"
    assert ready.first[0].share > 0.8


def test_after_a_crash_it_is_no_go_whatever_the_rotors_have(still, ready):
    """The numbers stay those of a sound vehicle."""
    crash = Check("crash", "warn", "motion contradicts the commands")
    found = wg.ready([replace(one, checks=(*one.checks, crash)) for one in still], weak(loss=0.2), "hover")
    assert (found.decision, found.crashed) == (Decision.NO_GO, ("still",))
    assert found.authority[0].probability == ready.authority[0].probability
    first, second = to_json(found)["summary"][:2]
    assert first == "No go: still ended in a crash or a loss of control; inspect the whole vehicle first."
    assert second.startswith("Once it is sound: on hover ")
    assert not ready.crashed


def test_a_rotor_that_has_failed_in_part_is_no_plain_go(still, ready):
    """Hover leaves enough to a rotor that lost a fifth; why it did is for a bench. One of 5 % is as propellers are."""
    assert [(one.rotor, one.lost) for one in ready.weakened] == [("rotor_0", pytest.approx(0.2))]
    assert ready.decision is not Decision.GO
    assert any(text.startswith("By the model, M1 has lost 20 % of its thrust: ") for text in to_json(ready)["summary"])
    sound = wg.open_flights(fly([Case("sound", seed=4, seconds=10.0, drag=0.0, blades=(0.95, 1.0, 1.0, 1.0))]), MODEL)
    plain = wg.ready(sound, weak(loss=0.05), "hover")
    assert (plain.decision, plain.weakened) == (Decision.GO, ())


def test_flights_that_contradict_the_model_are_no_plain_go(ready):
    """A flight that answers 60 ms later than the model, or with a rotor that is weaker by 25 %, says so itself; the
    margins are those of the flight, and so is what the others carry. The engine shares nothing with the fit.
    """
    model = weak(loss=0.05)
    late = Case("late", excited=0.3, seed=5, seconds=12.0, drag=0.0, delay=0.06, blades=(0.95, 1.0, 1.0, 1.0))
    found = wg.ready(wg.open_flights(fly([late]), MODEL), model, "hover")
    (one,) = found.contradicted
    assert (one.effect, one.change) == ("command_delay", pytest.approx(0.06 + 0.02, abs=0.015))  # and the motors' lag
    assert found.decision is not Decision.GO
    assert any(f"commands take effect {1e3 * one.change:.0f} ms later" in text for text in to_json(found)["summary"])
    cut = Case("cut", excited=0.3, seed=6, seconds=12.0, drag=0.0, lag=(0.002, 0.002), blades=(0.95, 1.0, 0.75, 1.0))
    found = wg.ready(wg.open_flights(fly([cut]), MODEL), model, "hover")
    (one,) = found.contradicted
    assert (one.parameter, one.change) == ("rotor_2", pytest.approx(-0.25, abs=0.03))
    assert any("M3 gives 2" in text for text in to_json(found)["summary"])
    assert found.decision is not Decision.GO
    assert ready.contradicted == ()


def test_thrust_that_all_rotors_lack_is_no_plain_go():
    """T is 0.85 of c_f Omega^2, as in thin air; unless the model knows c_f no better than that."""
    model = wg.load_model("tilt_hexarotor")
    flown = wg.simulate(model, "multi_axis", duration=15, seed=4, excitation=1, hide=["thrust_scale=scale:-0.15"])
    flights = wg.open_flights(flown, model)
    found = wg.ready(flights, model, "hover")
    (one,) = found.contradicted
    assert (one.effect, one.change) == ("thrust_scale", pytest.approx(-0.15, abs=0.01))
    assert found.decision is not Decision.GO
    assert any("all thrust is 15 % less, or the vehicle heavier" in text for text in to_json(found)["summary"])
    unsure = replace(model.vehicle.tolerances, thrust=0.1)
    assert as_flown(flights, replace(model, vehicle=replace(model.vehicle, tolerances=unsure)))[1] == ()


def test_a_delay_is_not_said_where_commands_answer_the_motion(monkeypatch):
    """What is fitted there is the phase of the controller."""
    late = Case("late", excited=0.3, seed=5, seconds=12.0, drag=0.0, delay=0.06, blades=(0.95, 1.0, 1.0, 1.0))
    flights, model = wg.open_flights(fly([late]), MODEL), weak(loss=0.05)
    assert [one.effect for one in as_flown(flights, model)[1]] == ["command_delay"]
    monkeypatch.setattr(contradiction, "answering_axes", lambda timing: (3, 4, 5))
    assert as_flown(flights, model)[1] == ()


@pytest.mark.parametrize(
    ("probability", "half", "decision"), [(0.95, 0.98, "go"), (0.4, 0.98, "go with care"), (0.1, 0.4, "no go")]
)
def test_margins_that_are_a_little_short_are_flown_with_care(ready, probability, half, decision):
    """45 deg and 6 dB are what a loop should have; one that has flown with 44 and 5.9 has not failed."""
    margins = np.array([44.0, 5.9]), np.array([40.0, 44.0, 48.0]), np.array([5.0, 5.9, 7.0])
    loop = LoopMargins("torque_x", *margins, probability, half, 0.9)
    authority = [replace(one, probability=0.98) for one in ready.authority]
    assert readiness._decision(authority, [loop], plain_go=True) == decision


def test_an_inertia_that_is_guessed_is_drawn():
    """Of a loop gain that goes with 1 / J a tolerance of 30 % makes a tenth: a gain margin within +-3 dB or so."""
    model = weak(loss=0.05)
    flights = wg.open_flights(fly([Case("sound", excited=0.3, seed=5, seconds=12.0, blades=(0.95, 1, 1, 1))]), MODEL)
    inertia = model.vehicle.body.inertia
    guessed = replace(model.vehicle, tolerances=replace(model.vehicle.tolerances, inertia=0.3 * inertia))
    sure, unsure = (wg.ready(flights, one, "hover").loops for one in (model, replace(model, vehicle=guessed)))
    for known, wide in zip(sure, unsure, strict=True):
        assert known.gain[2] - known.gain[0] < 1.0
        assert 4.0 < wide.gain[2] - wide.gain[0] < 12.0  # 20 log10(1.5 / 0.5) is 9.5 dB


def test_what_flights_end_with_is_what_flies_again():
    """A rotor that loses 16 % after two thirds is 5 % weaker on average, and 16 % at the end. Of two weak ones no name
    is said: the two of one side are a weight on the other, and what is said of them is their size.
    """
    model, sound = weak(loss=0.05), (0.95, 1.0, 1.0, 1.0)
    case = Case("before", excited=1.0, seed=7, seconds=24.0, drag=0.0, lag=(0.006, 0.006), blades=sound)
    after = replace(case, name="after", seed=8, seconds=15.0, blades=(0.95, 1.0, 0.84, 1.0))
    found = wg.ready(wg.open_flights(fly([case, after]), MODEL), model, "hover")
    (one,) = found.contradicted
    assert (one.parameter, one.change) == ("rotor_2", pytest.approx(-0.16, abs=0.03))
    assert wg.ready(wg.open_flights(fly([case]), MODEL), model, "hover").contradicted == ()
    both = replace(after, name="both", seed=9, blades=(0.95, 0.75, 0.75, 1.0))
    found = wg.ready(wg.open_flights(fly([both]), MODEL), model, "hover")
    assert len(found.contradicted) == 2
    assert any("model: one or several rotors give up to 2" in text for text in to_json(found)["summary"])


def test_a_centre_of_mass_is_no_weak_rotor():
    """On a tilting hexarotor, with the effects that its model lacks: 5 mm are as flights differ, and twelve rotors that
    would fit it nearly as well are sound. A torque that is more is said as what makes it.
    """
    model = wg.load_model("tilt_hexarotor")
    near, far = (
        wg.open_flights(wg.simulate(model, "multi_axis", duration=20, seed=4, excitation=1, hide=[hidden]), model)
        for hidden in ("com_offset=x:0.005", "com_offset=x:0.025")
    )
    assert as_flown(near, model)[1] == ()
    (one,) = as_flown(far, model)[1]
    assert (one.effect, one.parameter, one.change) == ("com_offset", "x", pytest.approx(0.025, abs=0.002))
    words = to_json(wg.ready(far, model, "hover"))["summary"]
    assert any(
        "there is a centre of mass 25 mm towards the front (arm_0), or weak propellers there" in text for text in words
    )


def test_a_payload_is_carried_by_all_rotors(still, ready):
    heavier = wg.ready(still, weak(loss=0.2), "hover", payload=0.3)
    for part in ("M1", "M2"):
        ratio = of(heavier, part).needs[1] / of(ready, part).needs[1]
        assert ratio == pytest.approx(1.0 + 0.3 / MODEL.vehicle.body.mass, rel=0.02)


def test_the_probability_falls_to_zero_and_so_does_the_decision(still, ready):
    whole = ROOM / of(ready, "M1").needs[1] - 1.0  # of the mass: with so much more, the weak rotor has no room left
    chances = []
    for part in (0.0, 0.8, 1.0, 1.25):
        found = wg.ready(still, weak(loss=0.2), "hover", payload=part * whole * MODEL.vehicle.body.mass)
        chances.append(of(found, "M1").probability)
    assert chances == sorted(chances, reverse=True)
    assert chances[0] == 0.98
    assert 0.3 < chances[2] < 0.7
    assert chances[3] < 0.1
    assert found.decision is Decision.NO_GO
    assert str(found).startswith("No go: on hover with")


def test_a_rotor_that_would_have_to_push_down_is_said(still, monkeypatch):
    """All thrust on one side makes the weight times the arm about x; beyond that the other would have to push down."""
    whole = MODEL.vehicle.body.mass * 9.81 * np.abs(MODEL.vehicle.arms.position_B[:, 1]).max()
    for part, share in ((0.9, 0.0), (1.1, 1.0)):
        left = np.tile([0.0, 0.0, 0.0, part * whole, 0.0, 0.0], (50, 1))
        monkeypatch.setattr(readiness, "_left", lambda *of, left=left: Left(left, 0.025, np.zeros(6)))
        found = wg.ready(still, weak(), "hover")
        assert found.below == share
        assert ("push less than it can" in " ".join(str(found).split())) == bool(share)


def test_a_flight_beyond_those_flown_is_no_plain_go(still):
    found = wg.ready(still, weak(), "circle")
    assert "speed" in [r.quantity for r in found.beyond]
    assert found.decision is Decision.CARE
    assert "What acts there only is not in these numbers" in " ".join(str(found).split())


def test_a_model_that_nobody_fitted_is_no_plain_go(still):
    found = wg.ready(still, MODEL, "hover")
    assert found.decision is Decision.CARE
    assert "how wrong it may be is not known" in " ".join(str(found).split())


def test_a_slow_gust_that_was_flown_once_is_not_known():
    """Gusts of 1.5 s on 6 s of flight: a fleet's needs scatter by 0.0055, and another flight is twice as far apart."""
    flights = wg.open_flights(fly([Case("gusts", seed=4, seconds=10.0, gusts=0.5)]), MODEL)
    found = wg.ready(flights, weak(std=0.0), "hover", duration=7.0)
    assert 0.008 < np.ptp(of(found, "M1").needs) < 0.06
    assert found.unseen > 0.2


def test_of_gains_that_did_not_fly_nothing_is_said(still, ready):
    """The other engine has a controller of its own."""
    assert ready.loops == ()
    assert NOT_SAID in " ".join(str(ready).split())


def test_a_lag_takes_margin_and_less_gain_gives_it_back(logs):
    model = wg.load_model("tilt_hexarotor")
    flights = wg.open_flights(logs.test, model)[:1]
    lag = replace(make_effect(model.vehicle, "motor_lag", {"tau": 0.09}), std=np.array([0.002]))
    for late in wg.ready(flights, model.with_effects([lag]), "hover").loops:
        crossing = 2.0 * model.controller.zeta_attitude[0] * 3.5  # [rad/s], about; of z less
        assert 5.0 < late.nominal[0] - late.phase[1] < np.degrees(np.arctan(0.09 * 1.3 * crossing))
    slow = make_effect(model.vehicle, "asymmetric_motor_lag", {"tau_up": 0.4, "tau_down": 0.3})
    found = wg.ready(flights, model.with_effects([slow]), "hover")
    assert found.loops[2].probability < 0.5
    assert found.loops[2].factor is None or found.loops[2].factor < 1.0
    assert found.decision is Decision.NO_GO
    assert str(found).startswith("No go: on hover the margins about")


@pytest.fixture(scope="module")
def px4(tmp_path_factory):
    """A flight that PX4's gains might have made, the same with another gain among its parameters, and the vehicle."""
    flown, folder = autopilot_logs.flight(5), tmp_path_factory.mktemp("px4")
    about = f"[command]\nunit = 'normalised'\nthrust_max = {FULL}\nfactor = {FACTOR}\n"
    model = model_file.loads(f"{model_file.dumps(true_vehicle())}\n{about}")
    return model, *(
        wg.open_flights([write_ulog(flown, folder / f"{p}.ulg", flown, gains(MC_PITCHRATE_P=p))], model)
        for p in (0.15, 0.2)
    )


def test_a_unit_of_px4s_torque_is_that_of_its_motors_at_hover(px4):
    """Roll by 0.7 of full throttle at 0.2 m from four rotors whose thrust is 9 N (0.6 u^2 + 0.4 u)."""
    model, flights, _ = px4
    found = flown_by_autopilot(model, flights, None)
    assert found.axes.all()
    share = throttle(np.sqrt((9.81 * MASS) / 4.0 / 9.0e-6))
    steep = FULL * (2.0 * FACTOR * share + 1.0 - FACTOR)
    roll, pitch = 4.0 * 0.7 * 0.2 * steep / INERTIA[0], 4.0 * 0.7 * 0.17 * steep / INERTIA[1]
    assert found.acceleration[:2] == pytest.approx([roll, pitch], rel=0.03)


def test_rotors_that_speed_up_turn_the_body_before_their_drag_does(px4):
    """A rotor whose thrust grows by 2 c_f Omega dOmega pulls with kappa times that, and with J dOmega/dt before."""
    model, flights, _ = px4
    inertia, hover = 4e-5, np.sqrt(9.81 * MASS / 4.0 / 9.0e-6)
    lead = flown_by_autopilot(model, flights, None).lead(inertia, model.vehicle.body.inertia)
    assert lead[2] == pytest.approx(inertia / (0.02 * 2.0 * 9.0e-6 * hover), rel=0.03)
    assert np.abs(lead[:2]).max() < 1e-3 * lead[2]


def test_the_loop_about_z_is_said_where_the_inertia_of_a_rotor_is_known(px4):
    model, flights, _ = px4
    lag = replace(make_effect(model.vehicle, "motor_lag", {"tau": 0.03}), std=np.array([0.003]))
    heavy = replace(make_effect(model.vehicle, "rotor_gyroscopic", {"inertia": 4e-5}), std=np.array([1e-5]))
    without, known = (wg.ready(flights, model.with_effects(e), "hover") for e in ([lag], [lag, heavy]))
    assert [one.axis for one in known.loops] == ["torque_x", "torque_y", "torque_z"]
    assert "Nothing is said about z" in " ".join(str(without).split())
    assert "Nothing is said about z" not in " ".join(str(known).split())
    assert known.loops[2].phase[0] < known.loops[2].phase[2]


def test_margins_of_px4_are_said_about_the_axes_on_which_its_gains_flew(px4):
    model, flights, other = px4
    found, doubtful = (wg.ready(f, model, "hover") for f in (flights, other))
    assert (found.gains, [one.axis for one in found.loops]) == (Gains.PX4_NO_LAG, ["torque_x", "torque_y"])
    assert [one.axis for one in doubtful.loops] == ["torque_x"]
    assert "the margins are upper bounds" in " ".join(str(found).split())
    lag = replace(make_effect(model.vehicle, "motor_lag", {"tau": 0.03}), std=np.array([0.003]))
    late = wg.ready(flights, model.with_effects([lag]), "hover")
    assert late.gains is Gains.PX4
    for one in late.loops:
        assert one.phase[1] < one.nominal[0] - 10.0
        assert one.phase[0] < one.phase[1] < one.phase[2]
    jsonschema.validate(document("ready", to_json(late)), schema("ready", strict=True))


@pytest.fixture(scope="module")
def ardupilot(tmp_path_factory):
    """A flight that ArduPilot's gains might have made, the same with another gain, and the vehicle."""
    flown, folder = autopilot_logs.flight(5), tmp_path_factory.mktemp("ardupilot")
    about = f"[command]\nunit = 'pwm'\nrange = [1000.0, 2000.0]\nthrust_max = {FULL}\nfactor = {FACTOR}\n"
    model = model_file.loads(f"{model_file.dumps(true_vehicle())}\n{about}")
    parameters = (
        {},
        {"ATC_RAT_PIT_P": 0.2},
        {"INS_HNTCH_ENABLE": 1, "INS_HNTCH_FREQ": 60.0, "INS_HNTCH_BW": 30.0, "INS_HNTCH_HMNCS": 1},
    )
    logs = [write_dataflash(flown, folder / f"{k}.bin", ardupilot_gains(**p)) for k, p in enumerate(parameters)]
    return model, *(wg.open_flights([log], model) for log in logs)


def test_a_unit_of_ardupilots_torque_is_half_of_full_thrust(ardupilot):
    """Of four rotors of 9 N at 0.2 m from the axis of roll and 0.17 m from that of pitch, with 0.02 m of torque."""
    model, flights, *_ = ardupilot
    found = flown_by_autopilot(model, flights, None)
    assert (found.name, found.axes.tolist()) == ("ArduPilot", [True] * 3)
    whole = 4.0 * 0.5 * FULL * np.array([0.2, 0.17, 0.02]) / INERTIA
    assert found.acceleration == pytest.approx(whole, rel=1e-3)
    hover = np.sqrt(9.81 * MASS / 4.0 / 9.0e-6)
    assert found.lead(4e-5, model.vehicle.body.inertia)[2] == pytest.approx(
        4e-5 / (0.02 * 2.0 * 9.0e-6 * hover), rel=1e-3
    )


def test_margins_of_ardupilot_are_said_with_its_notches(ardupilot):
    model, flights, other, notched = ardupilot
    plain, doubtful, late = (wg.ready(f, model, "hover") for f in (flights, other, notched))
    assert (plain.gains, [one.axis for one in plain.loops]) == (Gains.ARDUPILOT_NO_LAG, ["torque_x", "torque_y"])
    assert [one.axis for one in doubtful.loops] == ["torque_x"]
    assert "margins with the gains of ArduPilot's parameters" in [
        str(getattr(part, "title", "")) for part in parts(plain)
    ]
    crossing = 0.15 * 4.0 * 0.5 * FULL * 0.2 / INERTIA[0]  # [rad/s], about
    lost = np.degrees(np.arctan(crossing / (2.0 * np.pi * 60.0) * (4.0 / 3.0 - 3.0 / 4.0)))
    assert plain.loops[0].nominal[0] - late.loops[0].nominal[0] == pytest.approx(lost, rel=0.2)
    jsonschema.validate(document("ready", to_json(plain)), schema("ready", strict=True))


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"payload": -1.0}, "--payload -1: expected 0 to"),
        ({"wind": np.nan}, "--wind nan: expected 0 to 50"),
        ({"voltage": 1e9}, "--voltage 1e[+]09: expected 1 to"),
        ({"trajectory": "nowhere"}, "no trajectory is called 'nowhere'"),
    ],
)
def test_conditions_that_nobody_flies_in_are_refused(still, how, words):
    with pytest.raises(UsageError, match=words):
        wg.ready(still, MODEL, **{"trajectory": "hover", **how})


def test_the_voltage_of_a_cell_is_none_of_the_battery(still):
    curve = CommandCurve("normalised", "thrust", Polynomial(np.array([0.0, 0.0, 9.0])), voltage=(15.2, 2.0))
    with pytest.raises(
        UsageError, match=r"for a battery of 15\.2 V; expected that of the whole battery, 7\.6 to 30\.4"
    ):
        wg.ready(still, replace(MODEL, command=curve), "hover", voltage=3.8)


def test_wind_without_drag_and_a_voltage_that_no_log_has_are_said(still):
    windy = wg.ready(still, MODEL, "hover", wind=5.0)
    first, second, *_ = to_json(windy)["summary"]
    assert "wind" not in first
    assert second.startswith("The wind of 5.0 m/s is not in these numbers, as the model has no drag: fit ")
    assert windy.decision is not Decision.GO
    sag = make_effect(MODEL.vehicle, "battery_sag", {"per_volt": 0.05})
    with pytest.raises(UsageError, match="no log has it; give one with --voltage"):
        wg.ready(still, MODEL.with_effects([sag]), "hover")


def test_a_trajectory_of_another_vehicle_is_said(still, tmp_path):
    file = tmp_path / "other.toml"
    for vehicle, said in (("somebody_else", 1), (MODEL.vehicle.name, 0)):
        head = f'schema = 1\n[trajectory]\nname = "x"\nvehicle = "{vehicle}"\nduration = 3.0\nhome = [0, 0, 1]\n'
        file.write_text(head + 'attitude = "thrust"\n')
        found = wg.ready(still, weak(loss=0.2), str(file))
        assert str(found).count("It was designed for somebody_else") == said


def test_an_empty_battery_leaves_less_thrust():
    """A command curve whose thrust goes with the voltage squared: at 0.9 of the voltage each rotor has 0.81 of it."""
    model = wg.load_model("crazyflie")
    nominal, exponent = model.command.voltage
    assert exponent == 2.0
    flights = [opened(wg.simulate(model, "hover", duration=8.0), model)]
    full, low = (wg.ready(flights, model, "hover", voltage=v).authority[0].needs for v in (nominal, 0.9 * nominal))
    assert low / full == pytest.approx(1.0 / 0.81)
    with pytest.raises(UsageError, match="thrust depends on the battery's voltage, and no log has it"):
        wg.ready(flights, model, "hover")


def test_json_says_the_same(ready):
    made = document("ready", to_json(ready))
    jsonschema.validate(made, schema("ready", strict=True))
    assert made["decision"] == "go with care"
    assert made["weakened"] == [{"rotor": "rotor_0", "lost": pytest.approx(0.2)}]
    assert made["authority"][0]["part"] == "M1"


def test_most_vehicles_need_what_is_said():
    """Of the fleets of another engine nine in ten are within the stated 90 % (docs/ready.md), after one flight of ten
    seconds too; three standard deviations of forty vehicles less.
    """
    assert coverage(7)[0] >= 0.75
    assert coverage(8, flown=1)[0] >= 0.75


def test_the_controller_that_flew_is_known_by_its_torques(logs, still):
    """A paper's controller, whose gains are in the model file; with other gains it did not fly; nor did another law."""
    model = wg.load_model("tilt_hexarotor")
    flights = wg.open_flights(logs.test, model)[:1]
    assert flown_by_controller(model, flights)
    faster = replace(model.controller, omega_attitude=(4.5, 4.5, 4.5))
    assert not flown_by_controller(replace(model, controller=faster), flights)
    assert not flown_by_controller(MODEL, still)


def test_the_controller_is_known_of_a_vehicle_whose_centre_of_mass_is_not_the_origin():
    """Its law is about the centre of mass, as the wrenches of logs are: 20 mm aside the weight makes 0.8 Nm of O."""
    given = wg.load_model("tilt_hexarotor")
    body = replace(given.vehicle.body, com_B=np.array([0.02, 0.0, 0.01]))
    model = replace(given, vehicle=replace(given.vehicle, body=body))
    assert flown_by_controller(model, [opened(wg.simulate(model, "pitch", duration=8.0), model)])
