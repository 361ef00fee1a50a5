"""What changed between flights: changes of known size under absolute errors of the model that all flights share.

Flights of the independent engine (MuJoCo). The model that judges them is wrong in all of them: 5 % too much thrust, a
centre of mass 7 mm off, no servo lag. None of that is news; what is hidden in the suspect flight alone is.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.learn.changed import by_flight
from wrenchgap.learn.changed.changed import Baseline, Verdict, changed
from wrenchgap.learn.changed.changed import _verdict as verdict_of
from wrenchgap.learn.changed.places import towards, where_of
from wrenchgap.learn.changed.priors import MOST, change_prior, damaged, read
from wrenchgap.learn.changed.search import _late as late
from wrenchgap.learn.changed.search import changed_model, relinearised
from wrenchgap.learn.changed.sizes import louder
from wrenchgap.learn.changed.varying import Varying, renewed, seeming, typical_of
from wrenchgap.learn.data.errors import means_by
from wrenchgap.learn.data.opening import open_flights
from wrenchgap.learn.diagnose.quantities import Quantity
from wrenchgap.learn.diagnose.timing import unfollowed_axes
from wrenchgap.learn.identify.bias_and_trim import WORTH, means_of_flights, scatter_between, typical_trim
from wrenchgap.learn.identify.least_squares import left_by
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.injection import Injection
from wrenchgap.learn.posterior.settings import DEFAULT
from wrenchgap.replay.present.changed import summary, what_next
from wrenchgap.replay.present.what_to_inspect import sentences as inspect

pytestmark = pytest.mark.usefixtures("without_limits")
TRIED = (
    "rotor_thrust",
    "com_offset",
    "thrust_scale",
    "servo_lag",
    "coaxial_loss",
    "body_drag_areas",
    "constant_wrench",
)
SECONDS = 14.0
HEALTHY = (1, 2, 3)


@pytest.fixture(scope="module")
def wrong(hexarotor):
    """A model that is wrong in all flights alike."""
    vehicle = hexarotor.vehicle
    rotors = replace(vehicle.rotors, c_f=1.05 * vehicle.rotors.c_f)
    body = replace(vehicle.body, com_B=vehicle.body.com_B + np.array([0.006, -0.004, 0.0]))
    return replace(hexarotor, vehicle=replace(vehicle, rotors=rotors, body=body))


@pytest.fixture(scope="module")
def flown(once):
    """flown(effect, size, trajectory, seed) is a flight of the engine."""
    from benchmarks.hidden_effects import engine

    def fly(effect="none", size=None, trajectory="train", seed=9):
        name = f"changed {effect} {size} {trajectory} {seed} {SECONDS}"
        return once(name, lambda: engine.fly(effect, size, trajectory, SECONDS, seed=seed))

    return fly


@pytest.fixture(scope="module")
def against(flown, wrong):
    """against(suspect flights, healthy ones) is the answer with the wrong model."""

    def judge(suspects, healthy=None, names=TRIED, **options):
        good = [flown(seed=s)[0] for s in HEALTHY] if healthy is None else healthy
        opened = open_flights([*good, *suspects], wrong, **options)
        return changed(opened[len(good) :], opened[: len(good)], wrong, names=names, jobs=1)

    return judge


@pytest.fixture(scope="module")
def baseline(flown, wrong):
    """The healthy flights, learnt once for several suspects."""
    return Baseline(open_flights([flown(seed=s)[0] for s in HEALTHY], wrong), wrong, names=TRIED, jobs=1)


@pytest.fixture(scope="module")
def well(flown, wrong, baseline):
    """A healthy flight in the suspect's place."""
    return baseline.against(open_flights([flown(seed=7)[0]], wrong))


def change(found, effect, name):
    return next(p for p in found.parameters if (p.effect, p.name) == (effect, name))


@pytest.fixture(scope="module")
def weak(flown, against):
    """One rotor with 12 % less thrust on the suspect flight, and the truth."""
    flight, truth = flown("weak_rotor", {"rotor": 4, "loss": 0.12})
    return against([flight]), truth.parameters["weak_rotor"]


@pytest.mark.slow
def test_a_weak_rotor_is_found_under_a_wrong_model(weak):
    """The loss of the one rotor, not the thrust and the centre of mass that are wrong in all flights."""
    found, truth = weak
    assert found.verdict is Verdict.CHANGED
    assert found.names == found.firm == ("rotor_thrust",)
    assert found.differing() == ()
    one = change(found, "rotor_thrust", f"rotor_{truth['rotor']}")
    assert one.change == pytest.approx(-truth["loss"], abs=0.15 * truth["loss"])
    assert one.significance > 4
    assert found.nothing < 0.01
    assert found.places[0].parameter == f"rotor_{truth['rotor']}"
    assert found.places[0].probability > 0.9


@pytest.mark.slow
def test_sides_that_were_exchanged_show_the_same_rotor_stronger(flown, against):
    """A rotor with 12 % less thrust on the healthy flights has 12 % more on the suspect ones, and no other has less."""
    flights = [flown("weak_rotor", {"rotor": 4, "loss": 0.12}, seed=s) for s in (9, 12)]
    found = against([flown(seed=s)[0] for s in (1, 2)], [flight for flight, _ in flights])
    truth = flights[0][1].parameters["weak_rotor"]
    assert found.verdict is Verdict.CHANGED
    assert found.firm == ()
    assert found.places[0].parameter == f"rotor_{truth['rotor']}"
    one = change(found, "rotor_thrust", f"rotor_{truth['rotor']}")
    assert one.change == pytest.approx(truth["loss"], abs=0.25 * truth["loss"])
    assert "lifts more than on the healthy flights" in inspect(found)[0]
    (line,) = what_next(found, ["healthy"], "model.toml")
    assert line.text.startswith("next, if the sides were exchanged: wrenchgap changed ")


@pytest.mark.slow
def test_values_by_flight_show_who_differs(weak):
    """On every flight by itself the healthy ones agree, the suspect one has less by the loss."""
    found, truth = weak
    key = ("rotor_thrust", f"rotor_{truth['rotor']}")
    values = {role: [r.values[key] for r in found.rows if r.role == role] for role in ("healthy", "suspect")}
    assert np.ptp(values["healthy"]) < 0.3 * truth["loss"]
    assert np.mean(values["healthy"]) - values["suspect"][0] == pytest.approx(truth["loss"], rel=0.3)


@pytest.mark.slow
def test_suspect_flights_of_which_one_has_a_weak_rotor_have_no_firm_change_together(flown, baseline, wrong):
    """The mean of a damaged flight and two sound ones is true of none of them."""
    suspects = [flown("weak_rotor", {"rotor": 4, "loss": 0.24})[0], flown(seed=7)[0], flown(seed=8)[0]]
    found = baseline.against(open_flights(suspects, wrong))
    assert found.names == ("rotor_thrust",)
    assert found.firm == ()
    assert found.differing() == ("rotor_thrust",)
    assert "Suspect flights differ in rotor_thrust" in summary(found)


@pytest.mark.slow
def test_nothing_changed_is_said(well):
    found = well
    assert found.verdict is Verdict.NOTHING
    assert found.names == found.firm == found.odd == ()
    assert found.nothing > 0.9


@pytest.mark.slow
def test_what_is_injected_is_not_refused_as_another_vehicle(baseline, flown, wrong, monkeypatch):
    """A thrust of 1.6 times as much is told as other commands, where a flight comes with it."""
    asked = []

    def inject(limits, firm, model, number, seed, search):
        asked.append(search(Injection("thrust_scale", np.array([0.6]))))
        return ()

    monkeypatch.setattr("wrenchgap.learn.changed.changed.recoveries", inject)
    baseline.against(open_flights([flown(seed=7)[0]], wrong), injections=1)
    assert len(asked) == 1


def test_one_healthy_flight_is_enough_for_a_large_change_and_the_answer_says_so(flown, against):
    found = against([flown("com_offset", {"x": 0.009, "y": 0.0, "z": 0.0})[0]], [flown(seed=1)[0]])
    assert not found.scatter_known
    assert found.firm == ("com_offset",)
    assert change(found, "com_offset", "x").change == pytest.approx(0.009, rel=0.1)


@pytest.fixture(scope="module")
def differing(once):
    """differing(seed) is a healthy flight that differs from others in battery, rotors, mounting and wind."""
    from benchmarks.changed.fleet import Case
    from benchmarks.changed.fleet import flown as fly

    return lambda seed: once(f"differing {seed}", lambda: fly(Case("hexa", "none", 0.0, seed, SECONDS)))[0]


@pytest.mark.slow
def test_healthy_flights_that_differ_as_vehicles_do_are_no_change(differing, against):
    """Another battery place, 0.5 % from rotor to rotor, 0.1 deg of mounting, some wind: no constant trims."""
    found = against([differing(20004)], [differing(k) for k in (20000, 20001, 20002)], (*TRIED, "imu_misalignment"))
    assert found.verdict is Verdict.NOTHING
    assert found.odd == ()


@pytest.mark.slow
def test_a_mass_is_no_inertia_where_healthy_flights_differ_and_the_model_is_wrong(once, differing, against):
    """4.32 kg in place of 4.0 under 5 % less thrust than the model has: what is lost in all flights multiplies it."""
    from benchmarks.changed.fleet import Case
    from benchmarks.changed.fleet import flown as fly

    heavy, truth = once("heavier", lambda: fly(Case("hexa", "mass", 0.08, 20111, SECONDS)))
    names = (*TRIED, "mass", "inertia", "imu_misalignment", "arm_reaction", "tilt_offset")
    found = against([heavy], [differing(k) for k in (20000, 20001, 20002)], names)
    assert found.names == ("mass",)
    assert set(found.firm) <= {"mass"}
    one = change(found, "mass", "added")
    assert truth.parameters == {"added": pytest.approx(0.32)}
    assert abs(one.change - 0.32) < 2.0 * np.hypot(one.std, one.scatter) < 0.1


@pytest.fixture(scope="module")
def pool(flown, wrong, baseline):
    """Healthy flights and a suspect one, as they are compared."""
    opened = open_flights([flown("weak_rotor", {"rotor": 4, "loss": 0.12})[0]], wrong)
    flights = (*baseline.healthy, *opened)
    return baseline._pooled(flights, unfollowed_axes(tuple(baseline._timed(f) for f in flights)), lambda f, w: None)[0]


@pytest.mark.slow
def test_what_healthy_flights_show_is_what_the_model_is_wrong_by(pool, wrong):
    """The model has 1.05 of the thrust, and its centre of mass at (6, -4) mm: at equal rotor speeds in hover, the
    forces that healthy flights show are 1 / 1.05 of its own, and pass through the origin.
    """
    healthy = pool.only([0, 1, 2])
    within = [x - means_by(healthy.data.flight, x)[healthy.data.flight] for x in (healthy.given, healthy.left)]
    before, after = (np.sqrt(np.mean(x**2, axis=0)) for x in within)
    assert np.all(after < (0.1, 0.1, 0.1, 0.5, 0.5, 0.5) * before)  # the arms' inertia is not among what is tried
    commanded = np.median(healthy.data.commanded[:, 2])
    shown, given = (healthy.data.predict(m.wrench_model).mean(axis=0) for m in (pool.model, wrong))
    assert shown[2] / given[2] == pytest.approx(1.0 / 1.05, abs=0.01)
    arm = (shown[3:5] - given[3:5]) / commanded  # of the force about the model's own centre of mass
    assert np.all(arm / (-0.004, -0.006) > 0.4)  # the rest is taken for what flights differ by
    assert np.all(arm / (-0.004, -0.006) < 1.2)


@pytest.mark.slow
def test_changes_are_exact_where_they_are_linearised(pool):
    """All of them together, and the larger one without the other, are what the model with them predicts."""
    changes = {"com_offset": np.array([0.012, 0.0, 0.0]), "thrust_scale": np.array([-0.01])}
    there = relinearised(pool, [3], changes, {})
    rows = there.rows([3])
    assert np.array_equal(there.laws[0].bent.jacobian[~rows], pool.laws[0].bent.jacobian[~rows])
    added = {o.name: o.bent.offset + o.bent.jacobian @ changes[o.name] for o in there.laws if o.name in changes}
    suspect = there.only([3])
    for names in (("com_offset", "thrust_scale"), ("com_offset",)):
        model = changed_model(pool, {n: changes[n] for n in names})
        straight = there.left - sum(added[n] for n in names)
        np.testing.assert_allclose(straight[rows], left_by(suspect.data, model), atol=1e-9)


@pytest.mark.slow
def test_other_effects_are_linearised_at_their_points_beside_what_changed(pool):
    """A lag of 30 ms of rotors that push a tenth less is exact, by itself, on top of that."""
    changes, points = {"thrust_scale": np.array([-0.1])}, {"servo_lag": np.array([0.03])}
    mine = relinearised(pool, [3], changes, points).only([3])
    lag = next(o for o in mine.laws if o.name == "servo_lag")
    healthy, late_too = ({**changes, "servo_lag": x} for x in (np.zeros(1), points["servo_lag"]))
    weak, both = (left_by(mine.data, changed_model(pool, c)) for c in (healthy, late_too))
    np.testing.assert_allclose(lag.bent.offset + lag.bent.jacobian @ points["servo_lag"], weak - both, atol=1e-9)


def test_lags_alone_are_linearised_anew_where_they_are_by_themselves(hexarotor):
    """Alternate tilts of 0.12 rad hardly push, and are far from straight: what they do is no lag, and a point for them
    by themselves is one without the lag that they stand for.
    """
    far = {"tilt_offset": np.full(6, 0.12), "command_delay": np.array([0.03]), "servo_lag": np.array([0.048])}
    columns = {n: SimpleNamespace(theta=np.zeros_like(v), scale=np.full_like(v, 0.006)) for n, v in far.items()}

    class Found:
        def __init__(self):
            self.spectrum = SimpleNamespace(columns=columns)
            best = SimpleNamespace(log_probability=9.0, theta={"servo_lag": far["servo_lag"]})
            self.known = {("servo_lag",): best}

        def __call__(self, keys):
            return SimpleNamespace(log_probability=float(len(keys)), theta={k: far[k] for k in keys})

    assert list(late(Found(), hexarotor.vehicle)) == ["command_delay"]


@pytest.mark.slow
def test_a_servo_lag_grows_by_what_was_added_to_the_one_that_all_flights_have(flown, hexarotor):
    """Servos lag by 15 ms in all flights, 45 ms more on the suspect one; the model has neither."""
    flights = [flown(seed=1)[0], flown(seed=2)[0], flown("servo_lag")[0]]
    truth = flown("servo_lag")[1].parameters["servo_lag"]["added"]
    opened = open_flights(flights, hexarotor)
    names = ("servo_lag", "command_delay", "backlash", "tilt_offset", "thrust_scale")
    found = changed(opened[2:], opened[:2], hexarotor, names=names, jobs=1)
    assert found.firm == ("servo_lag",)
    lag = change(found, "servo_lag", "tau")
    assert lag.change == pytest.approx(truth, abs=2.0 * lag.std)
    assert lag.std < 0.1 * truth


def test_what_leaves_far_more_than_any_healthy_flight_has_no_name():
    found = SimpleNamespace(nothing=0.0)
    assert verdict_of(found, ("body_drag",), ()) is Verdict.CHANGED
    assert verdict_of(found, ("body_drag",), (2,)) is Verdict.UNKNOWN
    assert verdict_of(SimpleNamespace(nothing=0.9), (), ()) is Verdict.NOTHING


@pytest.mark.slow
@pytest.mark.usefixtures("well")
def test_a_baseline_says_of_the_second_suspect_what_a_new_comparison_does(flown, wrong, baseline, weak):
    """Nothing of the first suspect stays in it; the answer is that of the function."""
    again = baseline.against(open_flights([flown("weak_rotor", {"rotor": 4, "loss": 0.12})[0]], wrong))
    assert again.firm == weak[0].firm
    np.testing.assert_allclose(
        [p.change for p in again.parameters], [p.change for p in weak[0].parameters], rtol=1e-6, atol=1e-9
    )
    np.testing.assert_allclose(again.scatter, weak[0].scatter, rtol=1e-9)


@pytest.mark.slow
def test_an_odd_healthy_flight_is_found_named_and_left_out(flown, against):
    """One of the healthy flights has the weak rotor; the suspect is well."""
    odd = flown("weak_rotor", {"rotor": 4, "loss": 0.12})[0]
    found = against([flown(seed=7)[0]], [flown(seed=1)[0], odd, flown(seed=2)[0], flown(seed=3)[0]])
    assert [o.effect for o in found.odd] == ["rotor_thrust"]
    assert [r.flight for r in found.rows if r.role == "odd"] == [found.odd[0].flight]
    assert found.odd[0].flight not in found.healthy
    assert found.verdict is Verdict.NOTHING


@pytest.mark.slow
def test_other_trajectories_are_compared_and_what_does_not_overlap_is_said(flown, against):
    """Healthy in hover, which shows means only, suspect tumbling: nothing wrong is firm, and tilt is not compared."""
    healthy = [flown(trajectory="hover", seed=s)[0] for s in (1, 2)]
    found = against([flown("weak_rotor", {"rotor": 4, "loss": 0.15})[0]], healthy)
    assert "tilt" in {n.quantity for n in found.not_compared}
    assert all("healthy" in n.reason for n in found.not_compared)
    assert set(found.firm) <= {"rotor_thrust"}


@pytest.mark.parametrize(("suspect", "said"), [(15.9, []), (14.8, ["voltage"])])
def test_batteries_of_another_charge_are_not_compared(suspect, said, monkeypatch):
    """Thrust goes with the square: 0.1 V of 16 V are 1 %, 1.2 V are 14 %."""
    rows = np.arange(200) >= 100
    volts = np.where(rows, suspect, 16.0) + np.linspace(0.01, -0.01, 200)
    known = Quantity("voltage", "battery voltage", "V", volts)
    monkeypatch.setattr(by_flight, "quantities", lambda data: ((known,), {}))
    pool = SimpleNamespace(data=None, rows=lambda suspects: rows)
    assert [one.quantity for one in by_flight.not_compared(pool, {1})] == said


@pytest.mark.slow
def test_a_change_is_found_on_another_trajectory(flown, wrong, baseline):
    """Healthy flights excite all axes, the suspect one flies steps."""
    found = baseline.against(
        open_flights([flown("weak_rotor", {"rotor": 4, "loss": 0.1}, trajectory="steps")[0]], wrong)
    )
    assert found.firm == ("rotor_thrust",)
    assert found.places[0].parameter in ("rotor_4", "rotor_5")


def test_the_same_flight_on_both_sides_is_an_error(flown, wrong):
    one = open_flights([flown(seed=1)[0]], wrong)
    with pytest.raises(LogError, match="same flight"):
        changed(one, one, wrong, jobs=1)


def test_a_side_without_flights_is_an_error(flown, wrong):
    one = open_flights([flown(seed=1)[0]], wrong)
    with pytest.raises(UsageError, match="no healthy flight"):
        changed(one, [], wrong, jobs=1)


def test_a_flight_of_another_vehicle_is_an_error(flown, wrong):
    """The other one is flown with twice the thrust."""
    good, bad = open_flights([flown(seed=1)[0], flown(seed=2)[0]], wrong)
    heavy = replace(bad, records=tuple(replace(r, commanded=2.0 * r.commanded) for r in bad.records))
    with pytest.raises(LogError, match="one vehicle"):
        changed([heavy], [good], wrong, jobs=1)


# ------------------------------------------------------------ closed forms


def test_scatter_is_pooled_with_the_typical_one(hexarotor):
    """Flights that agree leave the typical scatter's share; many that differ leave their own standard deviation."""
    usual = typical_trim(hexarotor)
    np.testing.assert_allclose(scatter_between(np.zeros((3, 6)), usual), np.sqrt(WORTH / (2 + WORTH)) * usual)
    np.testing.assert_allclose(scatter_between(np.zeros((1, 6)), usual), usual)
    means = 50.0 * usual * np.random.default_rng(0).normal(size=(400, 1))
    np.testing.assert_allclose(scatter_between(means, usual), means.std(axis=0, ddof=1), rtol=0.01)


def test_scatter_is_what_the_noise_of_the_means_leaves(hexarotor):
    """Variances of what differs and of noise add up; of many flights the noise's is taken out again."""
    usual, rng = typical_trim(hexarotor), np.random.default_rng(1)
    means = 3.0 * usual * rng.normal(size=(4000, 1)) + 4.0 * usual * rng.normal(size=(4000, 1))
    np.testing.assert_allclose(scatter_between(means, usual, (4.0 * usual) ** 2), 3.0 * usual, rtol=0.05)


def test_noise_of_a_mean_is_that_of_its_blocks(plain):
    """White noise of variance v leaves means of n samples with v / n, however it is cut into blocks."""
    left = np.random.default_rng(2).normal(size=(len(plain.measured), 6))
    count = len(plain.measured) / len(np.unique(plain.flight))
    np.testing.assert_allclose(np.mean(means_of_flights(plain, left)[1]) * count, 1.0, rtol=0.5)


def test_a_cut_propeller_loses_drag_torque_too(hexarotor):
    """The second kind of loss: thrust by a share, drag torque by `MOST` times that; what is read of both is thrust."""
    lift, drag = np.array([0.0, 0.0, -1.0, 0.2, 0.1, 0.0]), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.03])
    one = np.ones(1)
    line = Column(
        ("rotor_thrust",), one, one, np.zeros((1, 6)), (lift + drag)[None, :, None], -one, one, one, one > 0, 0
    )
    both = damaged(line, drag[None, :, None]).jacobian[0]
    np.testing.assert_allclose(both[:5, 0], both[:5, 1])
    np.testing.assert_allclose(both[5], (0.03, MOST * 0.03))
    rotors = len(hexarotor.vehicle.rotors)
    lost = read(hexarotor.vehicle, "rotor_thrust", 2 * rotors) @ np.arange(2.0 * rotors)
    np.testing.assert_allclose(lost, 2.0 * np.arange(rotors) + rotors)


def test_the_scatter_of_parameters_is_the_typical_one_until_flights_say_otherwise(hexarotor):
    """Deviations of thousands of flights with a scatter of their own give that; none leave the prior's share."""
    part = Varying("com_offset", np.zeros((1, 6, 3)), np.ones(3))
    true, rng = np.array([1e-3, 2e-3, 4e-3]), np.random.default_rng(3)
    many = true * rng.normal(size=(5000, 3))
    found = renewed((part,), many.ravel(), np.zeros(many.size), len(many), hexarotor)["com_offset"]
    np.testing.assert_allclose(found, true, rtol=0.05)
    few = renewed((part,), np.zeros(9), np.zeros(9), 3, hexarotor)["com_offset"]
    np.testing.assert_allclose(few, np.sqrt(WORTH / (3 + WORTH)) * typical_of(hexarotor.vehicle, "com_offset"))


def test_a_law_seems_to_change_by_its_slack_on_suspect_flights():
    """Slack in units of the law: its share of the typical change, which is a share of the typical size."""
    line, scale = np.ones((4, 6, 3)), np.array([1.0, 2.0, 3.0])
    law, mass = seeming("rotor_gyroscopic", line, scale), seeming("mass", line, scale)
    assert law.scale == pytest.approx(0.3 * 0.2 * scale)
    assert mass.scale == pytest.approx(0.1 * scale)
    on_suspects = law.column(np.array([False, True, True, False]))
    assert not on_suspects.jacobian[[0, 3]].any()
    assert on_suspects.jacobian[[1, 2]].all()


def test_means_by_flight_are_signed(plain):
    left = np.full((len(plain.measured), 6), -2.0)
    np.testing.assert_allclose(means_by(plain.flight, left), [[-2.0] * 6])


@pytest.mark.parametrize(("x", "y", "side"), [(1, 0, "front"), (-1, 0, "back"), (0, 1, "left"), (1, 1, "front left")])
def test_directions_have_names(hexarotor, x, y, side):
    assert f"{side} (" in towards(hexarotor.vehicle, x, y)


def test_places_are_the_users(hexarotor):
    vehicle = replace(hexarotor.vehicle, rotor_names=("M1", "M2"), arm_names=("nose",))
    assert where_of(vehicle, "rotor_thrust", "rotor_1") == "M2"
    assert where_of(vehicle, "rotor_thrust", "rotor_5") == "rotor_5"
    assert where_of(vehicle, "tilt_offset", "arm_0") == "nose"
    assert where_of(vehicle, "accelerometer_bias", "x") == "accelerometer"


def test_a_propeller_only_loses_and_laws_hardly_change():
    assert change_prior("rotor_thrust").loses
    assert change_prior("drag_torque").share < 0.5
    assert change_prior("an effect of a user's own") == change_prior("ground_effect")


def test_of_an_axis_that_commands_answer_it_is_not_said_that_a_flight_is_louder():
    """What is left there is what the air was like: it made `unknown` of a weak rotor that explained the rest."""
    flight = np.repeat([0, 1, 2], 40)
    left = np.random.default_rng(1).normal(size=(120, 6))
    left[80:, [0, 5]] *= 6.0

    def axes(answering):
        data = SimpleNamespace(flight=flight, measured_axes=np.ones(6, dtype=bool), answering=answering)
        space = SimpleNamespace(
            combined=lambda weights: left, starts=np.arange(0, 120, 10), block=np.repeat(np.arange(12), 10),
            within=np.arange(120) % 10 > 0, axes=np.arange(6), settings=DEFAULT,
        )  # fmt: skip
        best = SimpleNamespace(keys=("x",), weights=np.ones(1))
        named = SimpleNamespace(sets=[SimpleNamespace(scored_set=SimpleNamespace(scored=best))])
        scorer = SimpleNamespace(spectrum=space, known={("x",): best})
        pool = SimpleNamespace(data=data)
        return louder(SimpleNamespace(scorer=scorer, posterior=SimpleNamespace(classes=[named]), pool=pool), [2])

    assert axes(()) == (0, 5)
    assert axes((5,)) == (0,)
