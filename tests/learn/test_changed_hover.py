"""A hover says little, and a rotor that lost a fifth of its thrust shows in it all the same.

The flights are written down, not simulated: a quadrotor that hangs in the air, its specific force (0, 0, g), no rates,
noise of the sensors, and rotor speeds that balance weight and torques, solved from the geometry by hand.
"""

from pathlib import Path

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.flight import GRAVITY, ActuatorSeries, Flight, ImuSeries, OdometrySeries
from wrenchgap.plant import model_file

pytestmark = pytest.mark.usefixtures("without_limits")
MASS, ARM, C_F, KAPPA = 1.2, 0.25, 9.0e-6, 0.016
AZIMUTH = np.radians([0.0, 90.0, 180.0, 270.0])
SPIN = np.array([1, -1, 1, -1])
RATE, SECONDS = 100.0, 20.0
SOME = ("rotor_thrust", "com_offset", "mass", "thrust_scale", "drag_torque", "motor_lag")


def quadrotor():
    arms = "".join(
        f"[[vehicle.arms]]\nazimuth_deg = {np.degrees(a)}\nrotors = [{{ spin = {s} }}]\n"
        for a, s in zip(AZIMUTH, SPIN, strict=True)
    )
    return model_file.loads(
        f'schema = 1\n[vehicle]\nname = "quadrotor"\nmass = {MASS}\ninertia = [0.012, 0.016, 0.025]\n[vehicle.arm]\n'
        f"length = {ARM}\ntilts = false\n[vehicle.rotor]\nc_f = {C_F}\nkappa = {KAPPA}\nradius = 0.12\n"
        f"speed_max = 1000.0\n{arms}"
    )


def hover(name, seed, lost=None, size=0.003):
    """A hover in which the rotors' thrusts are those of their commands times 1 - `lost` of each.

    Commands wander by `size` of the thrust (rms), which the measured force does not show.
    """
    rng = np.random.default_rng(seed)
    share = 1.0 if lost is None else 1.0 - np.asarray(lost)
    made = np.array([np.ones(4), ARM * np.sin(AZIMUTH), -ARM * np.cos(AZIMUTH), -KAPPA * SPIN]) * share
    thrust = np.linalg.solve(made, [MASS * GRAVITY, 0.0, 0.0, 0.0])
    time = np.arange(0.0, SECONDS, 1.0 / RATE)
    wander = np.cumsum(rng.normal(size=(len(time), 4)), axis=0)  # the controller's answers to air and sensors
    wander = size * (wander - wander.mean(axis=0)) / wander.std(axis=0)
    speed = np.sqrt(thrust * (1.0 + wander) / C_F)
    still, noise = np.zeros((len(time), 3)), rng.normal(size=(2, len(time), 3))
    return Flight(
        name,
        Path(f"{name}.csv"),
        name,
        0,
        actuators=ActuatorSeries("/motors", time, np.zeros((len(time), 0)), speed),
        imu=ImuSeries("/imu", time, 0.003 * noise[0], np.array([0.0, 0.0, GRAVITY]) + 0.03 * noise[1]),
        odometry=OdometrySeries("/odometry", time, still, np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1)), still, still),
    )


def changed(suspect, healthy, names=()):
    model = quadrotor()
    good, odd = (wg.open_flights(flights, model) for flights in (healthy, [suspect]))
    return wg.changed(odd, good, model, names=names, jobs=1)


@pytest.mark.parametrize(
    ("count", "size", "names"),
    [
        (1, 3e-3, SOME),
        *(pytest.param(*case, (), marks=pytest.mark.slow) for case in ((1, 3e-3), (1, 3e-4), (3, 3e-4))),
    ],
)
def test_a_rotor_that_lost_a_fifth_of_its_thrust_is_found_in_a_hover(count, size, names):
    """However much its commands wander: the motion shows nothing of that, and means alone are compared."""
    healthy = [hover(f"healthy {k}", k, None, size) for k in range(count)]
    found = changed(hover("suspect", 9, (0.0, 0.2, 0.0, 0.0), size), healthy, names)
    assert found.by_means
    assert found.firm == ("rotor_thrust",)
    (lost,) = (p for p in found.parameters if p.effect == "rotor_thrust")
    assert lost.name == "rotor_1"
    assert abs(lost.change + 0.2) < 3.0 * np.hypot(lost.std, lost.scatter)
    assert lost.std < 0.02


def test_two_hovers_of_one_vehicle_show_no_change():
    found = changed(hover("suspect", 9), [hover("healthy", 1)])
    assert found.names == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lost", "verdict", "firm"), [(None, "nothing", ()), ((0, 0.2, 0, 0), "effect", ("rotor_thrust",))]
)
def test_explain_takes_no_gain_from_commands_that_the_motion_shows_nothing_of(lost, verdict, firm):
    """A thrust curve without slope would "explain" them; the mean thrusts still show a weak rotor."""
    model = quadrotor()
    found = wg.explain(wg.open_flights([hover("hover", 9, lost)], model), model, injections=0, jobs=1)
    assert (found.verdict, found.firm) == (verdict, firm)
