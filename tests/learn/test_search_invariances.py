"""What the search finds is of the vehicle: not of the order of flights, of names, of frames, or of where a log is cut.

Flights of a quadrotor whose centre of mass is off, in gusts' absence; a flight is rewritten as another engineer would
have logged it, with his model of the same vehicle.
"""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.flight import ActuatorSeries, ImuSeries, OdometrySeries
from wrenchgap.plant import model_file

pytestmark = pytest.mark.usefixtures("without_limits")
NAMES = ("com_offset", "mass", "rotor_thrust", "drag_torque", "motor_lag", "inertia")
OFFSET = {"x": 0.012, "y": -0.004, "z": 0.0}
ARMS = ((0.0, 1), (90.0, -1), (180.0, 1), (270.0, -1))
"""Azimuth [deg] and spin of each rotor."""


def quadrotor(*, turn_deg=0.0, order=(0, 1, 2, 3), inertia=(0.012, 0.016, 0.025), scale=1.0):
    """The vehicle in a body frame turned by -`turn_deg` about z, rotors in another order, `scale` times as heavy."""
    arms = "".join(
        f"[[vehicle.arms]]\nazimuth_deg = {(ARMS[k][0] + turn_deg) % 360.0}\nrotors = [{{ spin = {ARMS[k][1]} }}]\n"
        for k in order
    )
    return model_file.loads(
        f'schema = 1\n[vehicle]\nname = "quadrotor"\nmass = {1.2 * scale}\n'
        f"inertia = {[scale * value for value in inertia]}\n[vehicle.arm]\nlength = 0.25\ntilts = false\n"
        f"[vehicle.rotor]\nc_f = {9.0e-6 * scale}\nkappa = 0.016\nradius = 0.12\nspeed_max = 1000.0\n{arms}"
    )


def turned(flight, turn_deg):
    """The flight as logged in a body frame that is turned by -`turn_deg` about z: components turn by +`turn_deg`."""
    angle = np.radians(turn_deg)
    R = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    half = np.array([np.cos(-angle / 2), 0.0, 0.0, np.sin(-angle / 2)])  # B' to B
    w, x, y, z = flight.odometry.quat_EB.T
    quat = np.stack(
        [
            w * half[0] - z * half[3],
            x * half[0] + y * half[3],
            y * half[0] - x * half[3],
            z * half[0] + w * half[3],
        ],
        axis=1,
    )
    imu, odometry = flight.imu, flight.odometry
    assert isinstance(imu, ImuSeries)
    assert isinstance(odometry, OdometrySeries)
    rates = None if odometry.omega_B is None else odometry.omega_B @ R.T
    return replace(
        flight,
        commanded=None,
        desired=None,
        reference=None,
        imu=replace(imu, omega_B=imu.omega_B @ R.T, specific_force_B=imu.specific_force_B @ R.T),
        odometry=replace(odometry, quat_EB=quat, omega_B=rates),
    )


def reordered(flight, order):
    """The flight with the columns of its rotors in another order."""
    actuators = flight.actuators
    assert isinstance(actuators, ActuatorSeries)
    return replace(flight, actuators=replace(actuators, rotor_speed=actuators.rotor_speed[:, list(order)]))


def cut(flight, start, stop):
    """The part of a flight between two times [s]."""

    def part(series):
        if series is None:
            return None
        inside = (series.time >= start) & (series.time < stop)
        arrays = {k: v[inside] for k, v in vars(series).items() if isinstance(v, np.ndarray) and len(v) == len(inside)}
        return replace(series, **arrays)

    roles = ("commanded", "desired", "actuators", "imu", "odometry", "reference", "battery")
    changes = {role: part(getattr(flight, role)) for role in roles}
    return replace(flight, name=f"{flight.name} {start:g} s", content_hash=f"{flight.content_hash}{start}", **changes)


@pytest.fixture(scope="module")
def flights(once):
    """Two excited flights of the vehicle with the hidden offset, without what a wrench was commanded."""

    def fly(seed):
        hidden = "com_offset=" + ",".join(f"{axis}:{value}" for axis, value in OFFSET.items())
        flown = wg.simulate(quadrotor(), "multi_axis", seed=seed, duration=12.0, excitation=0.5, hide=[hidden])
        return replace(flown, name=f"flight {seed}", commanded=None, desired=None, reference=None)

    return [once(f"invariances {seed}", lambda seed=seed: fly(seed)) for seed in (1, 2)]


def found(flights, model):
    """Verdict, and of each member its probability, values and deviations."""
    explanation = wg.explain(wg.open_flights(flights, model), model, names=NAMES, jobs=1)
    values = {effect.effect.name: effect.theta for effect in explanation.fit.effects}
    return explanation.verdict, {m.name: (m.probability, values[m.name]) for m in explanation.members}


@pytest.fixture(scope="module")
def alone(flights):
    return found(flights[:1], quadrotor())


def same(one, other, share=1e-3):
    """The verdict, the names, their probability, and to a `share` their values."""
    assert one[0] is other[0]
    assert one[1].keys() == other[1].keys()
    for name, (probability, values) in one[1].items():
        assert other[1][name][0] == pytest.approx(probability, abs=0.01), name
        np.testing.assert_allclose(other[1][name][1], values, rtol=share, atol=share * 0.01, err_msg=name)


def test_the_offset_is_found(alone):
    _, members = alone
    assert list(members) == ["com_offset"]
    np.testing.assert_allclose(members["com_offset"][1], list(OFFSET.values()), atol=1.5e-3)


def test_the_order_of_flights_does_not_matter(flights):
    same(found(flights, quadrotor()), found(flights[::-1], quadrotor()))


def test_the_order_of_rotors_does_not_matter(flights, alone):
    order = (2, 0, 3, 1)
    same(alone, found([reordered(flights[0], order)], quadrotor(order=order)))


def test_a_body_frame_turned_by_a_right_angle_turns_the_offset(flights, alone):
    verdict, members = found([turned(flights[0], 90.0)], quadrotor(turn_deg=90.0, inertia=(0.016, 0.012, 0.025)))
    assert (verdict, list(members)) == (alone[0], ["com_offset"])
    x, y, z = alone[1]["com_offset"][1]
    np.testing.assert_allclose(members["com_offset"][1], [-y, x, z], rtol=0.02, atol=2e-4)


def test_a_vehicle_of_twice_the_mass_inertia_and_thrust_moves_the_same_and_lacks_the_same(flights, alone):
    same(alone, found(flights[:1], quadrotor(scale=2.0)))


def test_a_flight_cut_in_two_says_what_the_whole_says(flights, alone):
    middle = 6.0
    verdict, members = found([cut(flights[0], 0.0, middle), cut(flights[0], middle, 100.0)], quadrotor())
    assert (verdict, list(members)) == (alone[0], ["com_offset"])
    np.testing.assert_allclose(members["com_offset"][1], alone[1]["com_offset"][1], atol=1e-3)


def test_where_the_world_has_its_origin_and_its_north_does_not_matter(flights, alone):
    """The vehicle's place and heading enter no wrench of these effects."""
    flight, angle = flights[0], np.radians(70.0)
    R = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    w, x, y, z = flight.odometry.quat_EB.T
    c, s = np.cos(angle / 2), np.sin(angle / 2)
    quat = np.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=1)
    odometry = flight.odometry
    moved = replace(
        odometry,
        position_E=odometry.position_E @ R.T + [200.0, -50.0, 30.0],
        quat_EB=quat,
        velocity_E=None if odometry.velocity_E is None else odometry.velocity_E @ R.T,
    )
    same(alone, found([replace(flight, odometry=moved)], quadrotor()))
