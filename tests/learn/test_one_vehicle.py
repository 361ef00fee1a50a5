"""Flights that are compared: of one vehicle, and with commands in one form."""

import re
from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from tests.independent.flown_quadrotor import MODEL, Case, fly
from wrenchgap.flight.errors import LogError
from wrenchgap.learn.data.one_vehicle import SAME, refuse_other_vehicle, thrust_gain


def flown(name, seed, **how):
    (flight,) = fly([Case(name, seed=seed, seconds=12.0, excited=0.5, **how)])
    return flight


def logged_as(flight, power):
    """The speeds to another power, scaled to the same level."""
    speed, name = flight.actuators.rotor_speed, f"power{power:g}"
    usual = np.median(speed)
    actuators = replace(flight.actuators, rotor_speed=usual * (speed / usual) ** power)
    return replace(flight, actuators=actuators, path=flight.path.with_name(f"{name}{flight.path.suffix}"))


@pytest.fixture(scope="module")
def healthy():
    return wg.open_flights([flown("a", 1), flown("b", 2)], MODEL)


@pytest.mark.parametrize("power", [0.5, 2.0])
def test_commands_of_another_power_are_refused(healthy, power):
    """Thrust goes with the speed's square: of speeds that were raised to a power it varies by that much more."""
    with pytest.raises(LogError, match="how thrust goes with the commands"):
        wg.open_flights([logged_as(flown("c", 3), power)], MODEL)
    (lied,) = wg.open_flights([logged_as(flown("c", 3), power)], MODEL, accept=["inertia"])
    said = f"varies {power:.1g}[0-9.]* times as much next to the measured one as that of the healthy flights"
    with pytest.raises(LogError, match=said):
        wg.changed([lied], healthy, MODEL, names=("com_offset",), jobs=1)
    with pytest.raises(
        LogError, match=f"^{re.escape(lied.flight.path.name)}: its commanded thrust .* the first of them"
    ):
        wg.trend([*healthy, lied], MODEL)
    refuse_other_vehicle(replace(lied, accept=("vehicles",)), healthy, "the healthy flights", MODEL)
    assert thrust_gain(lied) / thrust_gain(healthy[0]) == pytest.approx(
        power, rel=0.25
    )  # beside, the squares of what varies


def test_a_damaged_vehicle_is_the_same_one(healthy):
    """A rotor without a fifth of its thrust makes the others work harder, and all of them follow as before."""
    (weak,) = wg.open_flights([flown("weak", 4, blades=(0.8, 1.0, 1.0, 1.0))], MODEL)
    assert 1.0 / SAME.form < thrust_gain(weak) / thrust_gain(healthy[0]) < SAME.form
    assert wg.changed([weak], healthy, MODEL, names=("com_offset", "rotor_thrust"), jobs=1).names == ("rotor_thrust",)


def test_a_thrust_that_follows_nothing_says_nothing(healthy):
    """Where the accelerometer shows its noise alone, or was not measured, no gain is made up."""
    (one, *_) = healthy
    rng = np.random.default_rng(0)
    blind = tuple(replace(r, measured=r.measured + rng.normal(0.0, 50.0, r.measured.shape)) for r in one.records)
    assert thrust_gain(replace(one, records=blind)) is None
    unmeasured = tuple(replace(r, noise=np.full(6, np.nan)) for r in one.records)
    assert thrust_gain(replace(one, records=unmeasured)) is None
