"""Checks of a vehicle against itself and of rates against the filter: limits that physics sets."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.flight import ActuatorSeries, Flight, ImuSeries, WrenchSeries
from wrenchgap.learn.data.checks import rates
from wrenchgap.learn.data.checks.limits import possible
from wrenchgap.learn.data.checks.vehicle import of_vehicle

SHIPPED = ("crazyflie", "tilt_hexarotor", "voliro_x", "asymmetric_quadrotor", "variable_tilt_hexacopter")


def levels(model):
    return {check.name: check.level for check in of_vehicle(model)}


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_vehicles_are_plausible(name):
    assert set(levels(wg.load_model(name)).values()) <= {"ok"}


@pytest.mark.parametrize("name", SHIPPED[:3])
@pytest.mark.parametrize("factor", [1e-3, 0.04, 10.0, 1e3])
def test_inertia_off_by_decades_is_bad(name, factor):
    model = wg.load_model(name)
    body = replace(model.vehicle.body, inertia=factor * model.vehicle.body.inertia)
    assert levels(replace(model, vehicle=replace(model.vehicle, body=body)))["inertia"] == "bad"


def test_all_of_the_mass_at_the_tips_is_still_a_vehicle():
    """A ring of mass m at the arms' radius: J_zz = m L^2, the most there can be, J_xx half of it."""
    model = wg.load_model("tilt_hexarotor")
    ring = model.vehicle.body.mass * 0.3**2
    body = replace(model.vehicle.body, inertia=np.diag([0.5 * ring, 0.5 * ring, ring]))
    assert levels(replace(model, vehicle=replace(model.vehicle, body=body)))["inertia"] == "ok"


def test_a_torque_coefficient_is_no_kappa_and_the_right_one_is_said():
    model = wg.load_model("crazyflie")
    rotors = model.vehicle.rotors
    wrong = replace(model.vehicle, rotors=replace(rotors, kappa=rotors.kappa * rotors.c_f))
    (found,) = [c for c in of_vehicle(replace(model, vehicle=wrong)) if c.name == "kappa"]
    assert found.level == "bad"
    assert f"{rotors.kappa[0]:.3g} m" in found.words


def flight_of(rate, sent=250.0, speeds=None):
    time, command = np.arange(0, 8, 1 / rate), np.arange(0, 8, 1 / sent)
    imu = ImuSeries("/imu", time, np.zeros((len(time), 3)), np.zeros((len(time), 3)))
    wrench = WrenchSeries("/w", command, np.tile([0, 0, 0.4, 0, 0, 0], (len(command), 1)))
    out = Flight("f", "f.mcap", "0" * 64, 0, commanded=wrench, imu=imu)
    if speeds is None:
        return out
    return replace(out, actuators=ActuatorSeries("/a", command, np.zeros((len(command), 0)), speeds(len(command))))


@pytest.mark.parametrize(("rate", "sent", "cutoff", "level"), [
    (100.0, 250.0, 8.0, "ok"), (10.0, 250.0, 8.0, "bad"), (10.0, 250.0, 3.8, "ok"), (250.0, 10.0, 8.0, "bad"),
    (21.0, 21.0, 8.0, "ok"), (19.0, 50.0, 8.0, "bad"),
])  # fmt: skip
def test_what_is_too_slow_for_the_filter(rate, sent, cutoff, level):
    (found,) = rates(flight_of(rate, sent), cutoff)
    assert found.level == level
    if level == "bad":
        assert ("/imu" if rate < sent else "/w") in found.words
        assert rates(flight_of(rate, sent), float(found.mend.split()[1]))[0].level == "ok"


def test_single_commands_beyond_speed_max_are_left_out_and_counted():
    model = wg.load_model("crazyflie")

    def spiked(count):
        speeds = np.full((count, 4), 2000.0)
        speeds[[100, 700], [1, 3]] = 28000.0
        return speeds

    found, (check,) = possible(flight_of(250.0, speeds=spiked), model)
    assert check.level == "warn"
    assert "2 sample(s)" in check.words
    assert found.actuators.rotor_speed.max() == 2000.0
    assert found.actuators.dropped == {"beyond speed_max": 2}
    every, none = possible(flight_of(250.0, speeds=lambda n: np.full((n, 4), 9000.0)), model)
    assert none == ()  # a unit, which another check names
    assert len(every.actuators.time) == 2000
