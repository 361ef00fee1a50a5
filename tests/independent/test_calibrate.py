"""A model trimmed on flights of an engine that shares nothing with the fit: what was wrong is found, nothing else."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from benchmarks.hidden_effects.engine import fly
from tests.independent.flown_quadrotor import C_F, SPEED_MAX, Case
from tests.independent.flown_quadrotor import MODEL as QUADROTOR
from tests.independent.flown_quadrotor import fly as fly_quadrotors
from wrenchgap.learn.data.candidates import Lack
from wrenchgap.learn.data.phases.phase import Phase
from wrenchgap.learn.identify import calibrate as calibrating
from wrenchgap.learn.identify.calibrate import Fate, scatter_of
from wrenchgap.learn.identify.stepwise import Stepwise
from wrenchgap.learn.posterior.hidden_rotor import refused_where_hidden
from wrenchgap.plant import model_file
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.vehicle import Tolerances
from wrenchgap.replay.present.calibration import brief, crashed

MODEL = wg.load_model("tilt_hexarotor")
MISSING, LOADING = 0.05, 3.0e-4
"""Density that is missing; how differently the battery goes in from flight to flight, one sigma [m]."""
MEAN = np.array((0.003, -0.004))
SECONDS = 8.0


def flown(seed, x, y, missing=MISSING):
    hidden = {"com_offset": {"x": x, "y": y}, "thin_air": {"missing": missing}}
    flight, _ = fly(list(hidden), list(hidden.values()), "train", SECONDS, seed=seed)
    return replace(flight, path=flight.path.with_name(f"flight{seed}{flight.path.suffix}"))


@pytest.fixture(scope="module")
def season(once):
    def made():
        rng = np.random.default_rng(3)
        places = MEAN + LOADING * rng.normal(size=(4, 2))
        return places, [flown(k, *xy) for k, xy in enumerate(places)]

    return once("calibration season", made)


@pytest.fixture(scope="module")
def calibrated(season):
    flights = wg.open_flights(season[1], MODEL)
    return wg.calibrate(flights[:3], MODEL, validate=flights[3])


def value(found, effect, name):
    return next(p for p in found.trimmed if (p.effect, p.name) == (effect, name))


def fate(found, effect):
    return next(t.fate for t in found.tried if t.effect == effect)


def test_thrust_and_centre_of_mass_are_found_and_what_is_right_stays(calibrated, season):
    assert {"thrust_scale", "com_offset"} <= set(calibrated.effects)
    assert {"drag_torque", "imu_misalignment", "imu_lever_arm"}.isdisjoint(calibrated.effects)
    assert value(calibrated, "thrust_scale", "scale").value == pytest.approx(-MISSING, abs=0.004)
    for k, axis in enumerate("xy"):
        one = value(calibrated, "com_offset", axis)
        assert one.value == pytest.approx(season[0][:3, k].mean(), abs=4e-4)


def test_intervals_have_the_scatter_between_flights(calibrated, season):
    """The next flight's centre of mass lies within three of them, and they are no narrower than what was loaded."""
    for k, axis in enumerate("xy"):
        one = value(calibrated, "com_offset", axis)
        spread = season[0][:3, k].std(ddof=1)
        assert one.scatter == pytest.approx(spread, rel=0.35)
        assert one.std > one.scatter
        assert abs(one.value - season[0][3, k]) < 3.0 * one.std
    written = calibrated.model.effect("com_offset")
    assert written.std[0] == pytest.approx(value(calibrated, "com_offset", "x").std)


def test_held_out_error_and_an_unseen_flight_improve(calibrated):
    assert calibrated.added.trial.change < -0.9
    assert calibrated.added.trial.t > 3.0
    ((name, before, after),) = calibrated.unseen
    assert name not in calibrated.names
    assert np.all(after[3:5] < 0.4 * before[3:5])
    assert after[2] < 0.2 * before[2]
    assert np.all(calibrated.after[:, 2] < 0.2 * calibrated.before[:, 2])


def test_provenance_says_from_where(calibrated):
    source = calibrated.model.effect("com_offset").provenance
    assert source.method.startswith("wrenchgap calibrate: ")
    assert [sha for _, sha in source.logs] == [f.flight.content_hash for f in calibrated.flights]
    assert source.version == model_file.tool_version()
    assert source.fitted.endswith("Z")


@pytest.mark.slow
def test_a_second_calibration_starts_anew_and_ends_alike(calibrated, season):
    again = wg.calibrate(wg.open_flights(season[1][:3], calibrated.model), calibrated.model)
    assert set(again.effects) == set(calibrated.effects)
    first, second = (value(found, "thrust_scale", "scale").value for found in (calibrated, again))
    assert second == pytest.approx(first, abs=1e-3)
    assert abs(again.added.trial.change) < 0.2


@pytest.mark.slow
def test_a_loading_that_one_flight_alone_has_is_no_calibration():
    """Two flights with centres of mass on either side: each block shows its own, and the mean is no one's."""
    flights = wg.open_flights([flown(11, 0.004, 0.0, 0.0), flown(12, -0.004, 0.0, 0.0)], MODEL)
    found = wg.calibrate(flights, MODEL)
    if "com_offset" in found.effects:
        one = value(found, "com_offset", "x")
        assert abs(one.value) < one.std
        assert one.scatter > 3e-3


def test_flights_that_contradict_each_other_are_said_to(calibrated):
    """Centres of mass 40 mm to either side, where healthy flights differ by 6 mm (one standard deviation)."""
    flights = wg.open_flights([flown(11, -0.04, 0.0, 0.0), flown(12, 0.04, 0.0, 0.0)], MODEL)
    found = wg.calibrate(flights, MODEL)
    (apart,) = found.apart
    upward = [np.concatenate([r.measured[:, 2] for r in f.records]).mean() for f in flights]
    assert apart.axis == 4  # M_y = x F_z
    assert apart.means == pytest.approx([-0.04 * upward[0], 0.04 * upward[1]], rel=0.01)
    assert any("The flights do not agree: on torque_y" in getattr(part, "text", "") for part in brief(found))
    assert calibrated.apart == ()


def test_nothing_is_changed_where_nothing_is_wrong():
    """An engine whose servos and arms are too quick and too light to matter."""
    flight, _ = fly("none", None, "train", 12.0, seed=8, crisp=True)
    found = wg.calibrate(wg.open_flights(flight, MODEL), MODEL)
    material = [p for p in found.trimmed if p.unit != "s" and abs(p.value) > 3.0 * p.std]
    assert material == []


def test_a_crashed_flight_is_said_to_be_no_healthy_one(calibrated):
    ended = Phase("crash", 40.0, 50.0, "", event=42.0)
    told = replace(calibrated, flights=(replace(calibrated.flights[0], phases=(ended,)), *calibrated.flights[1:]))
    assert crashed(calibrated) == []
    (line,) = crashed(told)
    assert "crashed at 42.0 s: no healthy flight" in line
    assert any(line in str(part) for part in brief(told))


@pytest.mark.slow
def test_a_weighed_mass_sets_what_the_thrust_is_as_sure_as(season):
    told = replace(MODEL, vehicle=replace(MODEL.vehicle, tolerances=Tolerances(mass=0.04)))
    flights = wg.open_flights(season[1][:1], told)
    found = wg.calibrate(flights, told)
    assert value(found, "thrust_scale", "scale").std > 0.04 / told.vehicle.body.mass
    assert value(found, "thrust_scale", "scale").scatter is None


@pytest.mark.slow
def test_an_inertia_that_the_file_is_not_sure_of_is_fitted():
    """0.01 kg m^2 more about every axis than the model has, told to 30 %; the mass is weighed, the servos are quick."""
    flight, _ = fly("inertia", {"sx": 0.005, "sy": 0.005, "sz": 0.005}, "train", 12.0, seed=5, crisp=True)
    moments = np.diag(MODEL.vehicle.body.inertia)
    told = Tolerances(mass=0.005, inertia=0.3 * np.sqrt(np.outer(moments, moments)))
    model = replace(MODEL, vehicle=replace(MODEL.vehicle, tolerances=told))
    found = wg.calibrate(wg.open_flights(flight, model), model)
    assert fate(found, "inertia") is Fate.KEPT
    for axis in ("xx", "yy", "zz"):
        one = value(found, "inertia", axis)
        assert abs(one.value - 0.01) < 3.0 * one.std
        assert one.value == pytest.approx(0.01, abs=0.001)
    plain = wg.calibrate(wg.open_flights(flight, MODEL), MODEL)
    assert fate(plain, "inertia") is Fate.UNTRIED


FULL = 12.0
"""Thrust of one rotor at full throttle [N], as the engine's vehicle has it."""


def as_throttle(flight, factor):
    """What an ESC with the curve FULL (f u^2 + (1 - f) u) was sent, by the root of it."""
    sent = flight.actuators
    share = 7.2e-6 * sent.rotor_speed**2 / FULL
    u = (
        np.sqrt(share)
        if factor == 1.0
        else (factor - 1 + np.sqrt((1 - factor) ** 2 + 4 * factor * share)) / (2 * factor)
    )
    return replace(flight, commanded=None, desired=None, actuators=replace(sent, rotor_speed=u, unit="normalised"))


def with_curve(level, factor):
    text = f'{MODEL.text}\n[command]\nunit = "normalised"\nthrust_max = {level}\nfactor = {factor}\n'
    return model_file.loads(text)


@pytest.mark.slow
def test_a_wrong_curve_is_found_on_healthy_flights():
    """The model takes the ESC for a square with 8 % more thrust; the vehicle's curve has a factor of 0.6."""
    flight = as_throttle(fly("none", None, "train", 12.0, seed=2)[0], 0.6)
    wrong = with_curve(1.08 * FULL, 1.0)
    found = wg.calibrate(wg.open_flights(flight, wrong), wrong)
    assert {"thrust_scale", "thrust_curve"} & set(found.effects)
    assert found.added.trial.change < -0.9
    right = with_curve(FULL, 0.6)
    best = np.array(wg.compare(wg.open_flights(flight, right), right, ahead=False).to_json()["models"][0]["rms"])
    assert np.all(found.added.trial.after < 1.5 * best + 0.01)


def test_a_curve_that_ends_at_its_limit_takes_no_effects_place(monkeypatch):
    """Two hovers in gusts with 11 % less thrust: a curve at its limits does nearly as much, and is not the cause."""
    wrong = model_file.loads(
        f'{QUADROTOR.text}\n[command]\nunit = "normalised"\nthrust_max = {C_F * SPEED_MAX**2}\nfactor = 1.0\n'
    )
    weak = [Case(f"weak{k}", seed=k, seconds=15.0, blades=(0.89,) * 4, gusts=1.0) for k in (1, 2)]
    sent = [(f, f.actuators) for f in fly_quadrotors(weak)]
    flights = wg.open_flights(
        [replace(f, actuators=replace(a, rotor_speed=a.rotor_speed / SPEED_MAX, unit="normalised")) for f, a in sent],
        wrong,
    )
    order = iter(("thrust_scale", "thrust_curve", None))
    monkeypatch.setattr(Stepwise, "_best", lambda *_: next(order))
    found = calibrating.calibrate(flights, wrong)
    assert found.effects == ("thrust_scale",)
    assert fate(found, "thrust_curve") is Fate.AT_LIMIT
    assert value(found, "thrust_scale", "scale").value == pytest.approx(-0.11, abs=0.01)
    assert np.all(found.after[:, 2] < 0.5 * found.before[:, 2])


def test_no_lag_is_fitted_where_commands_answer_the_motion():
    """Two hovers in gusts, the centre of mass 4 mm forward: that is found, and motors that lag by 60 ms are not."""
    hovers = [
        Case(f"hover{k}", seed=k, seconds=15.0, lag=(0.06, 0.06), com=(0.004, 0.0, 0.0), gusts=1.0) for k in (1, 2)
    ]
    found = calibrating.calibrate(wg.open_flights(fly_quadrotors(hovers), QUADROTOR), QUADROTOR)
    assert found.effects == ("com_offset",)
    assert value(found, "com_offset", "x").value == pytest.approx(0.004, abs=0.001)
    reasons = {t.effect: t.reason for t in found.tried if t.effect in ("motor_lag", "command_delay")}
    assert [one.lack for one in reasons.values()] == [Lack.FOLLOWING] * 2


def test_scatter_is_what_goes_beyond_the_errors():
    rng = np.random.default_rng(0)
    values = 0.3 * rng.normal(size=4000) + 0.4 * rng.normal(size=4000)
    assert scatter_of(values, np.full(4000, 0.3)) == pytest.approx(0.4, rel=0.05)
    assert scatter_of(np.array([1.0, 1.1, 0.9]), np.full(3, 1.0)) == 0.0


@pytest.fixture(scope="module")
def quadrotors():
    """Two flights of a quadrotor whose motors follow in 20 ms, excited until all axes follow; and a wrong model."""
    flights = wg.open_flights(
        fly_quadrotors([Case(f"flight{k}", 2.5, seed=k, seconds=16.0) for k in range(2)]), QUADROTOR
    )
    slow = (("motor_lag", {"tau": 0.12}), ("drag_torque", {"change": -0.6}))
    wrong = [make_effect(QUADROTOR.vehicle, name, values) for name, values in slow]
    return flights, wg.calibrate(flights, QUADROTOR), QUADROTOR.with_effects(wrong)


@pytest.mark.slow
def test_a_calibration_that_is_right_shows_a_weak_rotor_as_before(quadrotors):
    _, found, _ = quadrotors
    assert found.effects == ("motor_lag",)
    assert found.hidden is None


@pytest.mark.slow
def test_a_model_is_refused_with_which_a_weak_rotor_would_not_be_found(quadrotors):
    _, found, wrong = quadrotors
    tame = fly_quadrotors([Case(f"flight{k}", 1.0, seed=k, seconds=16.0) for k in range(2)])  # commands answer here
    flights = tuple(wg.open_flights(tame, QUADROTOR))
    refused = refused_where_hidden(replace(found, flights=flights, added=replace(found.added, model=wrong)))
    assert -0.2 < refused.hidden.change < -0.005
    assert refused.model is QUADROTOR
    assert refused.effects == ()
    assert fate(refused, "motor_lag") is Fate.HIDES
    told, todo = (part.text for part in brief(refused)[:2])
    assert told.startswith(
        f"Not calibrated: put into these flights, {QUADROTOR.vehicle.called(refused.hidden.parameter)} with "
    )
    assert todo.startswith("These flights do not carry")
    assert refused.to_json()["hidden_rotor"]["change"] == refused.hidden.change


def test_drag_is_taken_for_drag_and_not_for_a_place_of_the_imu():
    """A force of -0.2 N s/m times the velocity is so much for each unit of the sum of rotor speeds."""
    cases = [Case(f"fast{k}", excited=0.4, fast=2.0, seed=k, seconds=20.0, drag=0.2) for k in (1, 2, 3)]
    flights = wg.open_flights(fly_quadrotors(cases), QUADROTOR)
    found = wg.calibrate(flights, QUADROTOR)
    assert {t.effect: t.fate for t in found.tried}["imu_lever_arm"] is not Fate.KEPT
    (drag,) = [one for one in found.trimmed if one.effect == "rotor_drag"]
    speeds = float(np.median(flights[0].flight.actuators.rotor_speed.sum(axis=1)))
    assert drag.value == pytest.approx(0.2 / speeds, rel=0.15)
