"""Health of parts over a season: what wears, slips or lags is told of its rotor or arm, in order of date."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.identify.steps_and_drift import Verdict
from wrenchgap.replay.present import season
from wrenchgap.replay.present import trend as present
from wrenchgap.replay.present.report.page import trend_page

MODEL = wg.load_model("tilt_hexarotor")
COUNT, SLIPPED = 12, 7
DAY = 86_400_000_000_000


def flight(k):
    """Of day k: rotor 3 wears, arm 1 slips before the eighth; scatter of both between flights."""
    scatter = np.random.default_rng([k, 5]).normal(size=2)
    loss = -0.015 * k + 0.001 * scatter[0]
    zero = 0.06 * (k >= SLIPPED) + 0.001 * scatter[1]
    hide = [f"rotor_thrust=rotor_3:{loss}", f"tilt_offset=arm_1:{zero}"]
    made = wg.simulate(MODEL, "multi_axis", duration=5, excitation=1, seed=k, hide=hide, name=f"day{k + 1}")
    return replace(made, start_ns=made.start_ns + k * DAY)


@pytest.fixture(scope="module")
def flights():
    return wg.open_flights([flight(k) for k in (2, 0, 1, 5, 4, 3, *range(11, 5, -1))], MODEL)


@pytest.fixture(scope="module")
def found(flights):
    return wg.trend(flights, MODEL, parts=True)


def parameter(found, effect, name):
    return next(p for p in found.parameters if (p.effect, p.name) == (effect, name))


def test_flights_are_in_order_of_date(found):
    assert found.names == tuple(f"day{k + 1}" for k in range(COUNT))
    assert found.dates == tuple(f"2023-11-{14 + k}" for k in range(COUNT))


def test_each_rotor_and_arm_has_its_numbers(found):
    parts = season.parts_of(found)
    assert list(parts) == [f"rotor_{r}" for r in range(12)] + [f"arm_{a}" for a in range(6)]
    assert [len(own) for own in parts.values()] == [3] * 18
    slipped = parameter(found, "tilt_offset", "arm_1")
    (step,) = slipped.course.steps
    assert (slipped.course.verdict, step.flight) == (Verdict.STEPS, SLIPPED)
    assert step.low < 0.06 < step.high
    above, worn = (parameter(found, "rotor_thrust", f"rotor_{r}") for r in (2, 3))
    lost = -0.015 * np.arange(COUNT)
    assert np.median(np.abs(worn.values - lost)) < 0.01
    np.testing.assert_allclose(above.values + worn.values, lost, atol=0.03)  # of a coaxial pair the sum is told best
    assert {(p.effect, p.name) for p in found.changed} <= {("tilt_offset", "arm_1"), ("rotor_thrust", "rotor_3")}


def test_the_present_level_is_of_the_flights_since_the_step(found):
    level, error = season.latest(parameter(found, "tilt_offset", "arm_1"))
    assert level == pytest.approx(0.06, abs=3.0 * error)
    assert 0.0 < error < 0.02


def test_it_is_printed_drawn_and_on_the_page(found):
    text = str(found)
    assert "health of parts over 12 flights" in text
    assert "> 3.4" in next(line for line in text.splitlines() if line.strip().startswith("arm_1"))  # deg
    assert np.shape(found.plot()) == (18, 3)
    page = trend_page(found)
    assert "Health of parts." in page
    assert present.to_json(found)["dates"][0] == "2023-11-14"


def test_rotors_that_do_not_tilt_have_no_arms():
    model = wg.load_model("asymmetric_quadrotor")
    logs = [wg.simulate(model, "hover", duration=6, seed=k, name=f"f{k}") for k in range(2)]
    undated = [replace(log, start_ns=5) for log in logs]
    found = wg.trend(wg.open_flights(undated[::-1], model), model, parts=True)
    assert found.names == ("f1", "f0")  # in the order given
    assert found.dates == ("", "")
    assert found.left_out == ()
    assert set(season.parts_of(found)) == {f"rotor_{r}" for r in range(4)}
    assert np.shape(found.plot()) == (4, 3)


def test_parts_say_themselves_what_is_fitted(flights):
    with pytest.raises(UsageError, match="leave out --fit"):
        wg.trend(flights, MODEL, ["mass"], parts=True)


def test_a_rotor_that_is_weak_on_some_flights_is_told_with_these_flights():
    """All at the same time, so that their stamps are no dates: numbered as they are given."""
    model = wg.load_model("asymmetric_quadrotor")
    flown = []
    for k, loss in enumerate((0.0, 0.0, 0.1, 0.0, 0.0, 0.1, 0.0)):
        hide = [f"rotor_thrust=rotor_2:{-loss}"] if loss else []
        flown.append(
            wg.simulate(model, "multi_axis", duration=6, excitation=1, seed=40 + k, hide=hide, name=f"f{k + 1}")
        )
    found = wg.trend(wg.open_flights(flown[::-1], model), model, parts=True)
    assert found.names == tuple(f"f{k}" for k in range(7, 0, -1))
    (weak,) = found.scattered
    assert (weak.effect, weak.name, weak.course.apart) == ("rotor_thrust", "rotor_2", (1, 4))
    first, second, last = present.summary(found)
    assert "outside the scatter of the others: flights 2, 5." in first
    assert second == "Whether by a step or a drift, 7 flights do not tell."
    assert last == f"Look at: {model.vehicle.called('rotor_2')}."
    body = present.to_json(found)
    assert (body["verdict"], body["inspect"]) == ("scattered", [model.vehicle.called("rotor_2")])
    assert next(p for p in body["parameters"] if p["verdict"] == "scattered")["apart"] == ["f6", "f3"]
