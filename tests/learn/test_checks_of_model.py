"""Checks of a vehicle against itself and of rates against the filter: limits that physics sets."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.flight import ActuatorSeries, Flight, ImuSeries, WrenchSeries
from wrenchgap.learn.data.checks import rates
from wrenchgap.learn.data.checks.impossible_commands import without_impossible_commands
from wrenchgap.learn.data.checks.vehicle import vehicle_checks

SHIPPED = ("crazyflie", "tilt_hexarotor", "voliro_x", "asymmetric_quadrotor", "variable_tilt_hexacopter")


def levels(model):
    return {check.name: check.level for check in vehicle_checks(model)}


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_vehicles_are_plausible(name):
    assert set(levels(wg.load_model(name)).values()) <= {"ok"}


@pytest.mark.parametrize("name", SHIPPED[:3])
@pytest.mark.parametrize("factor", [1e-3, 0.04, 10.0, 1e3])
def test_inertia_off_by_decades_is_bad(name, factor):
    model = wg.load_model(name)
    body = replace(model.vehicle.body, inertia=factor * model.vehicle.body.inertia)
    assert levels(replace(model, vehicle=replace(model.vehicle, body=body)))["inertia"] == "bad"


@pytest.mark.parametrize("name", SHIPPED[:3])
def test_a_mass_in_grams_is_asked_about(name):
    model = wg.load_model(name)
    for times, asked in ((1e3, True), (30.0, False)):
        body = replace(model.vehicle.body, mass=times * model.vehicle.body.mass)
        checks = vehicle_checks(replace(model, vehicle=replace(model.vehicle, body=body)))
        found = next(check for check in checks if check.name == "inertia")
        assert ("mass in grams" in found.words) is asked, (times, found.words)


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
    (found,) = [c for c in vehicle_checks(replace(model, vehicle=wrong)) if c.name == "kappa"]
    assert found.level == "bad"
    assert f"{rotors.kappa[0]:.3g} m" in found.words


def with_rotors(model, **changes):
    return replace(model, vehicle=replace(model.vehicle, rotors=replace(model.vehicle.rotors, **changes)))


def test_the_sign_of_kappa_belongs_into_spin():
    model = wg.load_model("crazyflie")
    assert levels(with_rotors(model, kappa=-model.vehicle.rotors.kappa))["kappa"] == "warn"


@pytest.mark.parametrize("name", SHIPPED[:3])
@pytest.mark.parametrize(("unit", "square"), [("rpm^2", (np.pi / 30.0) ** 2), ("revolutions", (2.0 * np.pi) ** 2)])
def test_a_c_f_per_another_speed_is_no_thrust_coefficient_and_the_right_one_is_said(name, unit, square):
    """T = c_f Omega^2: with Omega in another unit c_f is its square as large; C_T = c_f / (rho pi R^4) has no unit."""
    model = replace(wg.load_model(name), command=None)  # with one, c_f is a name for its thrust
    c_f = model.vehicle.rotors.c_f
    (check,) = [c for c in vehicle_checks(with_rotors(model, c_f=c_f * square)) if c.name == "thrust-coefficient"]
    assert check.level == "warn"
    assert unit in check.words
    assert f"it is {c_f[0]:.3g};" in check.words


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


def test_an_imu_below_one_hertz_is_asked_for_the_unit_of_its_times():
    """No cut-off mends it: milliseconds that are read as seconds make 0.25 Hz of 250."""
    (found,) = rates(flight_of(0.25, 0.25), 8.0)
    assert (found.level, found.mend) == ("bad", None)
    assert found.words.endswith("or are its times in another unit, ms or us?")


def test_actuators_that_are_slower_than_the_wrench_are_asked_too():
    log = flight_of(250.0, 250.0, lambda count: np.full((count, 4), 1500.0))
    slow = replace(
        log,
        actuators=replace(
            log.actuators, **{name: getattr(log.actuators, name)[::25] for name in ("time", "tilt", "rotor_speed")}
        ),
    )
    (found,) = rates(slow, 8.0)
    assert found.level == "bad"
    assert "/a (actuators)" in found.words
    assert rates(slow, 8.0, rotors=False)[0].level == "ok"  # a model without rotors does not use them
    assert rates(log, 8.0)[0].level == "ok"


def test_many_commands_far_beyond_all_others_are_no_unit():
    model = wg.load_model("crazyflie")

    def speeds(count):
        out = np.full((count, 4), 1500.0) + np.arange(count)[:, None] % 7
        out[::10] = 9000.0
        return out

    log, (found,) = without_impossible_commands(flight_of(250.0, 250.0, speeds), model)
    assert found.name == "spikes"
    assert log.actuators.rotor_speed.max() < 2000.0
    everywhere, none = without_impossible_commands(
        flight_of(250.0, 250.0, lambda n: 9.55 * (speeds(n) % 4000.0)), model
    )
    assert none == ()
    assert len(everywhere.actuators.time) == 2000


def test_single_commands_beyond_speed_max_are_left_out_and_counted():
    model = wg.load_model("crazyflie")

    def spiked(count):
        speeds = np.full((count, 4), 2000.0)
        speeds[[100, 700], [1, 3]] = 28000.0
        return speeds

    found, (check,) = without_impossible_commands(flight_of(250.0, speeds=spiked), model)
    assert check.level == "warn"
    assert "2 sample(s)" in check.words
    assert found.actuators.rotor_speed.max() == 2000.0
    assert found.actuators.dropped == {"impossible command": 2}
    assert not found.actuators.gaps  # one sample is bridged
    every, none = without_impossible_commands(flight_of(250.0, speeds=lambda n: np.full((n, 4), 9000.0)), model)
    assert none == ()  # a unit, which another check names
    assert len(every.actuators.time) == 2000


def test_a_stretch_of_one_rotor_in_another_unit_is_left_out_of_all_and_not_bridged():
    model = wg.load_model("crazyflie")

    def percent(count):
        speeds = np.full((count, 4), 2000.0)
        speeds[1000:1500, 1] *= 100.0
        return speeds

    found, (check,) = without_impossible_commands(flight_of(250.0, speeds=percent), model)
    assert "500 sample(s) beyond 1.2 times vehicle.rotor.speed_max: left out" in check.words
    (gap,) = found.actuators.gaps
    assert (gap.start, gap.stop) == pytest.approx((999 / 250.0, 1500 / 250.0))


@pytest.mark.parametrize("rows", [[100, 700], [100, 101], [300, 304]])
def test_a_zero_for_a_moment_of_a_rotor_that_turns_is_a_lost_value(rows):
    """One at 250 Hz, or two on end: in 4 ms no rotor stops and starts."""
    model = wg.load_model("crazyflie")

    def speeds(count):
        out = np.full((count, 4), 2000.0)
        out[rows, [1, 1 if rows[1] == 101 else 3]] = 0.0
        return out

    found, (check,) = without_impossible_commands(flight_of(250.0, speeds=speeds), model)
    assert check.level == "warn"
    assert "2 sample(s) where a turning rotor's speed is lost" in check.words
    assert found.actuators.rotor_speed.min() == 2000.0


def test_a_zero_that_the_mixer_commands_stays():
    """What it takes from one rotor it gives to another, or takes from all but those."""
    model = wg.load_model("crazyflie")

    def speeds(count):
        out = np.full((count, 4), 2000.0)
        out[300, :2] = 0.0, 2400.0
        out[500:502] = 2300.0, 0.0, 1700.0, 2000.0
        return out

    found, checks = without_impossible_commands(flight_of(250.0, speeds=speeds), model)
    assert checks == ()
    assert len(found.actuators.time) == 2000


@pytest.mark.parametrize(
    ("rows", "below"),
    [
        (slice(100, 110), 0.0),  # a command that is zero for a while
        (slice(100, 101), 300.0),  # a small command
        (slice(100, 400, 2), 0.0),  # often: nothing is lost so often, this is how the log tells it
    ],
)
def test_zeros_that_a_command_may_have_stay(rows, below):
    model = wg.load_model("crazyflie")

    def speeds(count):
        out = np.full((count, 4), 2000.0)
        out[rows, 2] = below
        return out

    found, checks = without_impossible_commands(flight_of(250.0, speeds=speeds), model)
    assert checks == ()
    assert len(found.actuators.time) == 2000
