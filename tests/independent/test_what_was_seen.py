"""What was once answered wrongly, flight by flight, on flights of a plant that shares nothing with the code that fits.

Each states what is so. Where a log cannot tell, `unknown`, no firm name or a class with the truth in it is right; a
firm name of what is not there never is.
"""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from tests.independent.flown_quadrotor import MODEL, Case, fly
from wrenchgap.learn.identify.calibrate import Fate
from wrenchgap.learn.posterior.verdict import Verdict
from wrenchgap.plant.effects import family

pytestmark = pytest.mark.usefixtures("without_limits")
LOW, OFF = (0.0, 0.0, -0.02), (-0.0005, 0.006, 0.0)
SLOW = {"gusts": 0.5, "motor_hz": 10.0, "imu_hz": 25.0}
"""Of a hover as an autopilot with a loop of 250 Hz logs it."""
CUT = (1.0, 0.8, 1.0, 1.0)
ROTOR_OR_NOT = ("rotor_thrust", "com_offset", "mass", "thrust_scale", "drag_torque")
ANYWAY = {"body_drag", "motor_lag"}
"""Drag and motors that follow in 20 ms, which all of these flights have and the model has not."""
LAGS = ("motor_lag", "asymmetric_motor_lag", "command_delay")


def twisted(*state):
    """A yaw torque, of motor mounts that are twisted alike."""
    return np.zeros(3), np.array([0.0, 0.0, 0.025])


SEEN = {
    "curves": (
        Case("curves", 1.0, seed=2, thrust_linear=0.15, torque_linear=0.1, torque=1.04),
        {"thrust_curve", "drag_torque"},
        ("thrust_curve", "drag_torque", "accelerometer_bias"),
    ),
    "squared spin": (Case("squared spin", 1.0, seed=3, squared=True, lag=(0.02, 0.04)), set(), (*LAGS, "thrust_curve")),
    "low centre": (
        Case("low centre", 1.0, seed=4, com=LOW, drag=0.0),
        {"com_offset"},
        ("com_offset", "imu_lever_arm"),
    ),
    "early IMU": (
        Case("early IMU", 1.0, seed=5, torque=1.15, imu_early=0.002),
        {"drag_torque"},
        ("drag_torque", "thrust_curve"),
    ),
    "slow motors": (Case("slow motors", 1.0, seed=6, lag=(0.04, 0.04), delay=0.004), {"command_delay"}, LAGS),
    "gusts": (Case("gusts", seed=7, gusts=2.0), set(), ("thrust_curve", "drag_torque", "rotor_thrust")),
    "heading": (Case("heading", 1.0, seed=8, heading=0.05), set(), ("drag_torque", "constant_wrench")),
    "off centre": (
        Case("off centre", seed=102, gusts=0.5, com=OFF, mass=1.04),
        {"com_offset", "mass", "thrust_scale", "payload"},
        ("rotor_thrust", "com_offset", "mass", "thrust_scale", "thrust_curve", "tether"),
    ),
    "yaw trim": (
        Case("yaw trim", seed=213, gusts=0.4, mass=1.13, lag=(0.06, 0.06), motor_hz=100.0, imu_hz=100.0, law=twisted),
        {"constant_wrench", "mass", "thrust_scale", "payload"},
        ("rotor_thrust", "constant_wrench", "mass", "thrust_scale", "thrust_curve", "com_offset"),
    ),
}
"""What is flown; the effects, beside `ANYWAY`, of which a firm name is no wrong one; those that are tried every day."""


@pytest.fixture(scope="module")
def flights(once):
    healthy = [Case(f"slow {k}", seed=20 + k, **SLOW) for k in range(3)]
    cases = [*(case for case, _, _ in SEEN.values()), *healthy, Case("cut", seed=30, blades=CUT, **SLOW)]
    return {flight.name: flight for flight in once("what was seen", lambda: fly(cases))}


@pytest.fixture(scope="module", params=["some", pytest.param("all", marks=pytest.mark.slow)])
def explained(request, flights):
    """`explain` of a flight by its name, once; of some effects every day, of all of them in the slow tests."""
    known = {}

    def found(name):
        if name not in known:
            names = (*ANYWAY, *SEEN[name][2]) if request.param == "some" else ()
            known[name] = wg.explain(wg.open_flights([flights[name]], MODEL, cutoff_hz=8.0), MODEL, names=names, jobs=1)
        return known[name]

    return found


def opened(flights, model, *names):
    return wg.open_flights([flights[n] for n in names], model, cutoff_hz=3.8, accept=("rate",))


def families(names):
    return {family(name) for name in names}


@pytest.mark.slow
@pytest.mark.parametrize("name", SEEN)
def test_no_firm_name_is_wrong(explained, name):
    assert families(explained(name).firm) <= ANYWAY | SEEN[name][1]


@pytest.mark.slow
@pytest.mark.parametrize("name", SEEN)
def test_no_value_at_its_limit_is_firm_or_named_as_the_answer(explained, name):
    found = explained(name)
    assert not set(found.fit.stuck) & set(found.effects)


def test_affine_curves_are_a_curve_and_no_bias_of_the_accelerometer(explained):
    assert "thrust_curve" in explained("curves").firm
    assert "accelerometer_bias" not in explained("curves").effects


def test_a_gyroscope_whose_axes_are_two_per_cent_off_square_is_no_inertia(flights):
    """As datasheets allow: torques seem to make rates across, as products of inertia of 2 % would."""
    flight = flights["slow motors"]
    askew = flight.imu.omega_B @ np.array([[1.0, 0.02, 0.0], [0.02, 1.0, 0.0], [0.0, 0.0, 1.0]])
    log = replace(flight, imu=replace(flight.imu, omega_B=askew))
    names = (*ANYWAY, "command_delay", "inertia", "imu_misalignment")
    found = wg.explain(wg.open_flights([log], MODEL, cutoff_hz=8.0), MODEL, names=names, jobs=1)
    assert "inertia" not in found.firm
    assert any("gyroscope_calibration" in s.names for s in found.posterior.sets)


@pytest.mark.slow
def test_motors_that_follow_by_squared_speed_lag_and_have_no_curve(explained):
    effects = families(explained("squared spin").effects)
    assert "motor_lag" in effects
    assert "thrust_curve" not in effects


@pytest.mark.slow
def test_a_low_centre_of_mass_and_an_imu_that_is_high_are_one_class(explained):
    """With thrust along z alone, torques of -c x F are none; what c shows is where the IMU is."""
    named = {name for s in explained("low centre").classes[0].sets for name in s.names}
    assert {"com_offset", "imu_lever_arm"} <= named


@pytest.mark.slow
def test_an_imu_stamped_early_does_not_hide_a_drag_torque(explained):
    assert "drag_torque" in families(explained("early IMU").firm)


def test_a_lag_of_40_ms_behind_a_delay_of_4_is_no_delay(explained):
    found = explained("slow motors")
    assert "motor_lag" in families(found.firm)
    values = {e.effect.name: e.theta for e in found.fit.effects}
    np.testing.assert_allclose(values.get("motor_lag", values.get("asymmetric_motor_lag")), 0.04, atol=3e-3)
    assert values.get("command_delay", 0.0) < 8e-3


def test_less_thrust_and_a_yaw_trim_are_no_two_weak_rotors(explained):
    """Two rotors that turn the same way and lose as much make the same constant force and torque."""
    found = explained("yaw trim")
    assert found.firm == ()
    named = {name for s in found.classes[0].sets for name in s.names}
    assert {"rotor_thrust", "constant_wrench"} <= named


def test_a_hover_in_gusts_lacks_nothing(explained):
    assert explained("gusts").effects == ()


def test_a_torque_that_goes_with_the_heading_is_unknown(explained):
    found = explained("heading")
    assert found.verdict is Verdict.UNKNOWN
    assert "drag_torque" not in families(found.effects)


@pytest.mark.slow
def test_an_uncalibrated_hover_is_many_things_of_which_the_truth_is_one(explained):
    """A centre of mass 6 mm off and 4 % more mass, or four rotors that are off by as much."""
    sets = [set(s.names) for s in explained("off centre").classes[0].sets]
    assert any({"com_offset"} < s <= {"com_offset", "mass", "thrust_scale", "thrust_curve"} for s in sets)


@pytest.fixture(scope="module")
def calibrated(flights):
    return wg.calibrate(opened(flights, MODEL, "slow 0", "slow 1", "slow 2"), MODEL)


def test_healthy_hovers_logged_at_10_hz_calibrate_nothing(calibrated):
    assert calibrated.effects == ()
    assert {t.effect for t in calibrated.tried if t.fate is Fate.KEPT} == set()


def test_after_that_a_cut_propeller_is_still_found(calibrated, flights):
    model = calibrated.model
    healthy, suspect = opened(flights, model, "slow 0", "slow 1", "slow 2"), opened(flights, model, "cut")
    found = wg.changed(suspect, healthy, model, names=ROTOR_OR_NOT, jobs=1)
    assert found.firm == ("rotor_thrust",)
    worst = min((p for p in found.parameters if p.effect == "rotor_thrust"), key=lambda p: p.change)
    assert worst.name == "rotor_1"
    alone = wg.explain(suspect, model, names=ROTOR_OR_NOT, jobs=1)
    assert "rotor_thrust" in alone.effects
