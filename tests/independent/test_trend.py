"""A season of short flights of an engine that shares nothing with the fit: what moved, when, by how much."""

import re
from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from benchmarks.hidden_effects.engine import fly
from tests.independent.flown_quadrotor import MODEL as QUADROTOR
from tests.independent.flown_quadrotor import Case
from tests.independent.flown_quadrotor import fly as fly_quadrotors
from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.learn.identify.moved_centre import all_alike, moved_centre
from wrenchgap.learn.identify.steps_and_drift import Verdict
from wrenchgap.learn.identify.trend import TRIMS, trend
from wrenchgap.replay.present.trend import summary

MODEL = wg.load_model("tilt_hexarotor")
SECONDS, COUNT, REPAIR = 6.0, 8, 5
SHIFT, LOADING = 2.0e-3, 2.0e-4
"""How far the repair moved the centre of mass along y; how differently the battery goes in, one sigma [m]."""


def flown(k, x, y, missing=0.0):
    """Flight k with the hull's centre of mass at (x, y) and thinner air."""
    hidden = {"com_offset": {"x": x, "y": y}, "thin_air": {"missing": missing}}
    names = ["com_offset", *(["thin_air"] if missing else [])]
    flight, _ = fly(names, [hidden[n] for n in names], "train", SECONDS, seed=k)
    return replace(flight, path=flight.path.with_name(f"flight{k}{flight.path.suffix}"))


@pytest.fixture(scope="module")
def season(once):
    """A centre of mass that moves at flight `REPAIR`, counted from 0, and scatters from flight to flight."""

    def made():
        rng = np.random.default_rng(7)
        offsets = LOADING * rng.normal(size=(COUNT, 2)) + np.outer(np.arange(COUNT) >= REPAIR, (0.0, SHIFT))
        return offsets, wg.open_flights([flown(k, *xy) for k, xy in enumerate(offsets)], MODEL)

    return once("season", made)


@pytest.fixture(scope="module")
def followed(season):
    return wg.trend(season[1], MODEL)


def parameter(found, effect, name):
    return next(p for p in found.parameters if (p.effect, p.name) == (effect, name))


def test_a_moved_centre_of_mass_is_found_at_its_flight(followed, season):
    """Size and interval against the positions that were really flown, means before and after."""
    assert followed.effects == TRIMS
    y = parameter(followed, "com_offset", "y")
    assert y.course.verdict is Verdict.STEPS
    (step,) = y.course.steps
    true = season[0][REPAIR:, 1].mean() - season[0][:REPAIR, 1].mean()
    assert step.flight == REPAIR
    assert step.size == pytest.approx(true, rel=0.1)
    assert step.low < SHIFT < step.high


def test_a_rotor_that_got_weak_is_no_moved_centre_of_mass():
    """On arms that tilt the two leave different errors; by default that is followed which leaves less."""
    sound = [flown(k, 0.0, 0.0) for k in range(3)]
    weak = [fly(["weak_rotor"], [{"rotor": 3, "loss": 0.15}], "train", SECONDS, seed=k)[0] for k in (3, 4, 5)]
    renamed = [replace(one, path=one.path.with_name(f"weak{k}{one.path.suffix}")) for k, one in enumerate(weak)]
    found = wg.trend(wg.open_flights([*sound, *renamed], MODEL), MODEL)
    assert found.effects == ("rotor_thrust",)
    assert [p.name for p in (*found.changed, *found.scattered)] == ["rotor_3"]
    values = parameter(found, "rotor_thrust", "rotor_3").values
    assert values[:3] == pytest.approx(0.0, abs=0.01)
    assert values[3:] == pytest.approx(-0.15, abs=0.03)


def test_rotors_that_change_together_are_a_moved_centre_of_mass():
    """A battery that goes in 4 mm further to the front right, of rotors that do not tilt; a weak rotor is none."""
    before = [Case(f"b{k}", excited=0.1, seed=k, seconds=12.0) for k in range(3)]
    moved = [Case(f"m{k}", excited=0.1, seed=k, seconds=12.0, com=(0.004, -0.003, 0.0)) for k in (3, 4)]
    found = wg.trend(wg.open_flights(fly_quadrotors([*before, *moved]), QUADROTOR), QUADROTOR)
    centre = found.moved_centre
    assert (centre.x, centre.y) == pytest.approx((0.004, -0.003), abs=5e-4)
    assert centre.first < 3 <= centre.last
    first, *_, last = summary(found)
    assert re.search(r" of the change in thrust .* moves (4\.9|5\.0|5\.1) mm towards the front right", first)
    assert last.startswith("Look at: the battery and what is mounted; then ")
    weak = [Case(f"w{k}", excited=0.1, seed=k, seconds=12.0, blades=(0.85, 1.0, 1.0, 1.0)) for k in (3, 4)]
    assert wg.trend(wg.open_flights(fly_quadrotors([*before, *weak]), QUADROTOR), QUADROTOR).moved_centre is None


def test_rotors_that_all_lose_alike_are_no_single_rotor():
    """Thinner air, a heavier vehicle or an accelerometer that reads less: all four by 4 %."""
    cases = [Case(f"c{k}", excited=0.1, seed=k, seconds=12.0, blades=(1.0 if k < 3 else 0.96,) * 4) for k in range(6)]
    found = wg.trend(wg.open_flights(fly_quadrotors(cases), QUADROTOR), QUADROTOR)
    assert found.all_rotors
    first, last = summary(found)
    assert re.match(r"All rotors alike, as rotor_thrust M\d steps: -(3\.[5-9]|4\.[0-5]) % from flight 4 ", first)
    assert last.startswith("Look at: the weight, the battery and its voltage, the air, and whether the accelerometer")
    assert all_alike(np.array([np.zeros(4), np.full(4, -0.1)]))
    assert not all_alike(np.array([np.zeros(4), [-0.1, 0.0, 0.0, 0.0]]))


def test_of_most_rotors_one_cause_is_likelier_than_as_many():
    """A rotor that lost a tenth, and a battery elsewhere: the balance moves the thrusts of all."""
    before = [Case(f"b{k}", excited=0.1, seed=k, seconds=12.0) for k in range(3)]
    both = [
        Case(
            f"m{k}", excited=0.1, seed=k, seconds=12.0, com=(-0.006, 0.0, 0.0), torque=1.1, blades=(0.88, 1.0, 1.0, 1.0)
        )
        for k in (3, 4, 5)
    ]
    found = wg.trend(wg.open_flights(fly_quadrotors([*before, *both]), QUADROTOR), QUADROTOR)
    assert found.moved_centre is None
    last = summary(found)[-1]
    assert re.match(r"[34] rotors changed: likelier by one cause than each; .* Look at: M1 first\.", last)


def test_thrusts_that_are_a_plane_over_the_rotors_are_a_centre_of_mass():
    """By hand: on a square of side 2 a, rotors at +x that push 1 + d and at -x that push 1 - d are a centre at -d a."""
    arms, rotors = QUADROTOR.vehicle.geometry()
    place = arms.position_B[rotors.arm, :2]
    a = float(np.abs(place[:, 0]).mean())
    thrusts = np.array([np.zeros(4), 0.05 * np.sign(place[:, 0])])
    found = moved_centre(thrusts, QUADROTOR.vehicle)
    assert (found.x, found.y, found.share) == pytest.approx((-0.05 * a, 0.0, 1.0), abs=1e-9)
    assert moved_centre(np.array([np.zeros(4), [-0.1, 0.0, 0.0, 0.0]]), QUADROTOR.vehicle) is None
    assert moved_centre(np.array([np.zeros(4), np.full(4, -0.1)]), QUADROTOR.vehicle) is None  # thinner air


def test_what_did_not_move_is_steady(followed):
    assert [(p.effect, p.name) for p in followed.changed] == [("com_offset", "y")]


def test_values_follow_the_flights_one_by_one(followed, season):
    """What the engine flew, flight by flight, and not only on average."""
    for k, name in enumerate("xy"):
        values = parameter(followed, "com_offset", name).values
        assert np.corrcoef(values, season[0][:, k])[0, 1] > 0.95


def test_the_scatter_is_that_of_loading(followed, season):
    x = parameter(followed, "com_offset", "x")
    assert x.course.scatter == pytest.approx(season[0][:, 0].std(ddof=1), rel=0.3)


def test_trims_that_the_model_grants_between_flights_do_not_hide_the_step(season, followed):
    granting = replace(MODEL, between_flights=(0.1, 0.1, 0.1, 0.1, 0.1, 0.01))
    (step,) = parameter(trend(season[1], granting), "com_offset", "y").course.steps
    assert step.size == pytest.approx(parameter(followed, "com_offset", "y").course.steps[0].size, rel=1e-6)


def test_before_the_repair_nothing_changed(season):
    assert wg.trend(season[1][:REPAIR], MODEL).changed == ()


def test_three_flights_are_too_few(season):
    found = wg.trend(season[1][REPAIR - 2 : REPAIR + 1], MODEL, ["com_offset"])
    assert {p.course.verdict for p in found.parameters} <= {Verdict.FEW, Verdict.OPEN}
    assert "nothing can be said about steps and drifts" in str(found)


def test_effects_of_the_model_are_followed_by_default(season):
    model = MODEL.with_effects(wg.add(MODEL, "com_offset", season[1][:1]).model.effects)
    assert wg.trend(season[1][:4], model).effects == ("com_offset",)


def test_what_a_flight_lacks_is_said(season):
    with pytest.raises(FitError, match=r"battery_sag: needs the battery voltage.*--fit") as caught:
        wg.trend(season[1][:2], MODEL, ["battery_sag"])
    assert "\n" not in str(caught.value)
    with pytest.raises(UsageError, match="got 1 flight, expected two or more"):
        wg.trend(season[1][0], MODEL)


def test_propellers_that_wear_drift():
    """Air that thins, or propellers that wear, by 0.5 % a flight."""
    flights = wg.open_flights([flown(k, 0.0, 0.0, 0.001 + 0.005 * k) for k in range(6)], MODEL)
    scale = parameter(wg.trend(flights, MODEL), "thrust_scale", "scale")
    assert scale.course.verdict is Verdict.DRIFT
    assert scale.course.drift.slope == pytest.approx(-0.005, rel=0.1)


def test_of_rotors_that_do_not_tilt_each_is_followed():
    """A blade that lost 8 % of its thrust and drag before the sixth of ten hovers in gusts; no effect is named."""
    cut = [(1.0, 1.0, 1.0 if k < 5 else 0.92, 1.0) for k in range(10)]
    flown = fly_quadrotors([Case(f"hover{k}", seed=k, seconds=12.0, gusts=1.0, blades=b) for k, b in enumerate(cut)])
    found = wg.trend(wg.open_flights(flown, QUADROTOR), QUADROTOR)
    assert [(p.effect, p.name) for p in found.changed] == [("rotor_thrust", "rotor_2")]
    (step,) = found.changed[0].course.steps
    assert step.flight == 5
    assert step.low < -0.08 < step.high
