"""Logs of actuators and IMU: units and orders against what the vehicle did, flown by an engine that shares nothing."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import wrenchgap as wg
from benchmarks.meaning.flying import HEX, QUAD, Manner, fly
from tests.independent import flown_quadrotor as independent
from wrenchgap.flight.errors import LogError
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.plant import model_file

CALM = Manner(excitation=0.0, reach=0.2)
DEGREES = 180.0 / np.pi


@pytest.fixture(scope="module", params=[(QUAD, Manner()), (QUAD, CALM), (HEX, Manner())], ids=["quad", "calm", "hex"])
def flown(request, tmp_path_factory):
    """Model, and a flight of it."""
    craft, manner = request.param
    path = tmp_path_factory.mktemp("models") / "craft.toml"
    path.write_text(craft.model())
    return model_file.load(path), fly(craft, 16.0, 31, manner)


def alone(flight, **changes):
    """Actuators and IMU."""
    return replace(flight, commanded=None, odometry=None, checks=None, **changes)


def found(flight, model, level="bad"):
    return {c.name: c for c in open_flight(flight, model, gate=False).checks if c.level == level}


def test_a_healthy_log_is_not_flagged(flown):
    model, flight = flown
    assert found(alone(flight), model) == {}
    assert set(found(alone(flight), model, "warn")) == {"roles"}


def test_rotors_in_another_order_are_put_back(flown):
    model, flight = flown
    count = flight.actuators.rotor_speed.shape[1]
    rolled = replace(flight.actuators, rotor_speed=np.roll(flight.actuators.rotor_speed, 1, axis=1))
    (check,) = found(alone(flight, actuators=rolled), model).values()
    order = ",".join(str((k + 1) % count) for k in range(count))
    assert check.name == "rotors"
    assert f"[{order}]" in check.mend


def test_every_spin_turned_over_is_seen_in_the_yaw(flown):
    model, flight = flown
    rotors = model.vehicle.rotors
    turned = replace(model, vehicle=replace(model.vehicle, rotors=replace(rotors, spin=-rotors.spin)))
    flags = found(alone(flight), turned) | found(alone(flight), turned, "warn")
    assert "spin" in flags["rotors"].words


@pytest.mark.parametrize("shake", [1e-4, 3e-3])
def test_motors_on_a_bench_are_no_flight(flown, shake):
    """The commands of a flight, and an IMU at rest, still or shaken by the motors."""
    model, flight = flown
    rng, count = np.random.default_rng(6), len(flight.imu.time)
    rest = rng.normal(0.0, shake, (count, 3)), rng.normal((0.0, 0.0, 9.81), 30.0 * shake, (count, 3))
    imu = replace(flight.imu, omega_B=rest[0], specific_force_B=rest[1])
    assert ("motion" in found(alone(flight, imu=imu), model)) == excited(flight)  # a calm hover commands no change
    assert "motion" not in found(alone(flight), model)


def test_a_model_whose_arms_are_one_place_on_is_seen_with_its_spins(flown):
    """The rotors keep their spins: of alternating ones every spin at its place is then the other."""
    model, flight = flown
    places = np.roll(model.vehicle.arms.position_B, 1, axis=0)
    turned = replace(model, vehicle=replace(model.vehicle, arms=replace(model.vehicle.arms, position_B=places)))
    flags = found(alone(flight), turned)
    assert ("rotors" in flags) == excited(flight)
    assert not excited(flight) or "every spin turned over" in flags["rotors"].words


def test_a_gyroscope_in_degrees_is_found_without_an_attitude(flown):
    model, flight = flown
    imu = replace(flight.imu, omega_B=DEGREES * flight.imu.omega_B)
    (check,) = found(alone(flight, imu=imu), model).values()
    assert check.name == "gyroscope"
    assert check.mend.endswith(":deg")


def wrench_alone(flight, **changes):
    """Commanded wrench and IMU."""
    return replace(flight, actuators=None, odometry=None, checks=None, **changes)


def test_a_gyroscope_in_degrees_is_found_from_the_commanded_wrench_alone(flown):
    model, flight = flown
    assert found(wrench_alone(flight), model) == {}
    imu = replace(flight.imu, omega_B=DEGREES * flight.imu.omega_B)
    (check,) = found(wrench_alone(flight, imu=imu), model).values()
    assert check.name == "gyroscope"
    assert check.mend.endswith(":deg")


def rocking(flight, rate):
    """The same with an IMU that turns about x by `rate` sin(2 pi t) [rad/s], and has noise about all axes."""
    turn = rate * np.sin(2.0 * np.pi * flight.imu.time)[:, None] * [1.0, 0.0, 0.0]
    turn = turn + np.random.default_rng(1).normal(0.0, 1e-4, turn.shape)  # exact zeros would be no reading
    return wrench_alone(flight, imu=replace(flight.imu, omega_B=turn))


@pytest.mark.parametrize(("times", "bad"), [(1.0, False), (10.0, True)])
def test_a_motion_that_needs_more_torque_than_the_rotors_have_is_none(flown, times, bad):
    """Rates A sin(2 pi t) about x need J_xx 2 pi A / sqrt(2) rms; n rotors on arms L make n c_f w^2 hypot(L, kappa)."""
    model, flight = flown
    arms, rotors = model.vehicle.geometry()
    lever = np.hypot(np.linalg.norm(arms.position_B[0]), rotors.kappa[0])
    most = len(rotors) * rotors.c_f[0] * rotors.speed_max[0] ** 2 * lever
    rate = times * most * np.sqrt(2.0) / (2.0 * np.pi * model.vehicle.body.inertia[0, 0])
    checks = found(rocking(flight, rate), model)
    assert ("gyroscope" in checks) == bad
    if bad:
        assert f"{most:.3g} Nm" in checks["gyroscope"].words
        assert checks["gyroscope"].mend is None  # nothing that was logged says which unit


def test_a_hover_without_commanded_torque_has_no_unit_to_doubt(flown):
    """In still air nothing is commanded, and the motion is the sensors' noise."""
    model, flight = flown
    still = np.random.default_rng(3).normal(0.0, 1e-3, flight.imu.omega_B.shape)
    sent = flight.commanded
    nothing = replace(sent, wrench_B=sent.wrench_B * [1, 1, 1, 1e-14, 1e-14, 1e-14])
    calm = replace(flight, imu=replace(flight.imu, omega_B=still))
    assert "torque-unit" not in found(wrench_alone(calm, commanded=nothing), model)


@pytest.mark.parametrize(("size", "bad"), [(1.0, False), (1e-4, True)])
def test_a_torque_ten_thousand_times_too_small_is_bad_however_unlike_the_motion_it_is(flown, size, bad):
    """The torques of the flight backwards have its sizes, and nothing in common with the motion."""
    model, flight = flown
    sent = flight.commanded
    torque = size * sent.wrench_B[::-1, 3:]
    other = replace(sent, wrench_B=np.hstack((sent.wrench_B[:, :3], torque)))
    checks = found(wrench_alone(flight, commanded=other), model)
    assert ("torque-unit" in checks) == bad
    assert not bad or checks["torque-unit"].mend is None


def test_rotor_speeds_in_rpm_contradict_the_commanded_wrench(flown):
    model, flight = flown
    sent = replace(flight.actuators, rotor_speed=flight.actuators.rotor_speed * 30.0 / np.pi)
    check = found(replace(flight, actuators=sent, checks=None), model)["rotor-speed-unit"]
    assert check.mend.endswith(":rpm")


def test_an_odometry_in_millimetres_is_no_accelerometer_in_another_unit(flown):
    model, flight = flown
    lengths = {name: 1e3 * getattr(flight.odometry, name) for name in ("position_E", "velocity_E")}
    flags = found(replace(flight, odometry=replace(flight.odometry, **lengths), checks=None), model)
    assert set(flags) == {"odometry-scale"}
    assert flags["odometry-scale"].mend.endswith(":mm")


def test_one_order_among_twelve_rotors_is_exactly_the_commanded_wrench():
    model = wg.load_model("tilt_hexarotor")
    flight = wg.simulate(model, "multi_axis", duration=12.0, excitation=1.0, seed=5)
    assert found(flight, model) == {}
    rolled = replace(flight.actuators, rotor_speed=np.roll(flight.actuators.rotor_speed, 1, axis=1))
    (check,) = found(replace(flight, actuators=rolled, checks=None), model).values()
    assert check.name == "rotors"
    assert "[1,2,3,4,5,6,7,8,9,10,11,0]" in check.mend


def excited(flight):
    """Whether it rolls by more than a hover does."""
    return np.std(flight.imu.omega_B[:, 0]) > 0.1


def turned_imu(flight, degrees):
    turn = Rotation.from_euler("z", -degrees, degrees=True)
    imu = replace(
        flight.imu, omega_B=turn.apply(flight.imu.omega_B), specific_force_B=turn.apply(flight.imu.specific_force_B)
    )
    return replace(flight, imu=imu, checks=None)


@pytest.mark.parametrize("degrees", [-30.0, 45.0])
@pytest.mark.parametrize("wrench", [False, True])
def test_an_imu_turned_about_z_is_told_without_an_attitude_and_by_its_angle(flown, degrees, wrench):
    model, flight = flown
    sent = flight.commanded if wrench else None
    log = replace(alone(turned_imu(flight, degrees)), commanded=sent)
    check = (found(log, model) | found(log, model, "warn"))["body-frame"]
    assert check.mend == f"--topic imu=/imu:yaw={degrees:g}"


def test_an_angle_that_the_flight_does_not_tell_is_not_said(flown):
    """Ten degrees are a mounting error, an effect; and a gyroscope of nothing but noise turns with nothing."""
    model, flight = flown
    assert "body-frame" not in found(alone(turned_imu(flight, 10.0)), model, "warn")
    rng = np.random.default_rng(5)
    noise = replace(flight.imu, omega_B=0.5 * rng.standard_normal(flight.imu.omega_B.shape))
    log = alone(flight, imu=noise)
    assert "body-frame" not in found(log, model) | found(log, model, "warn")


@pytest.mark.parametrize("factor", [1.0 / 3.0, 1.0, 3.0])
def test_an_inertia_by_which_the_vehicle_turns_otherwise_is_asked_about(flown, factor):
    """Torques turn it by J^-1 M: a third of J would turn it three times as fast. In a hover commands are larger than
    what moves it, since they answer disturbances, and too small an inertia does not show."""
    model, flight = flown
    shows = factor == 3.0 or (factor < 1.0 and excited(flight))
    body = replace(model.vehicle.body, inertia=factor * model.vehicle.body.inertia)
    wrong = replace(model, vehicle=replace(model.vehicle, body=body))
    flags = found(alone(flight), wrong)
    assert ("inertia" in flags) == shows
    if shows and excited(flight):
        assert f"{1.0 / factor:.2g} about x" in flags["inertia"].words
        by_log = re.search(r"moments of inertia are ([0-9.e-]+), ([0-9.e-]+), ", flags["inertia"].words)
        np.testing.assert_allclose(
            [float(by_log[1]), float(by_log[2])], np.diag(model.vehicle.body.inertia)[:2], rtol=0.1
        )
    if factor < 1.0:  # known to a factor of two, the effect `inertia` reaches it
        unsure = replace(model.vehicle.tolerances, inertia=wrong.vehicle.body.inertia)
        guessed = replace(wrong, vehicle=replace(wrong.vehicle, tolerances=unsure))
        assert "inertia" not in found(alone(flight), guessed)
        assert ("inertia" in found(alone(flight), guessed, "warn")) == shows


def test_kappa_off_by_a_factor_is_told_from_the_turning_about_z(flown):
    model, flight = flown
    rotors = model.vehicle.rotors
    wrong = replace(model, vehicle=replace(model.vehicle, rotors=replace(rotors, kappa=4.0 * rotors.kappa)))
    flags = found(alone(flight), wrong, "warn")
    assert ("kappa" in flags) == excited(flight)
    assert not excited(flight) or "4 about z" in flags["kappa"].words


def test_two_rotors_of_six_that_are_swapped_are_put_back_by_the_motion_alone(flown):
    model, flight = flown
    count = flight.actuators.rotor_speed.shape[1]
    order = [1, 0, *range(2, count)]
    swapped = replace(flight.actuators, rotor_speed=flight.actuators.rotor_speed[:, order])
    check = found(alone(flight, actuators=swapped), model)["rotors"]
    assert f"[{','.join(map(str, order))}]" in check.mend


@pytest.mark.parametrize("order", [[1, 0, 2, 3], [0, 2, 1, 3], [0, 3, 2, 1]])
def test_columns_that_are_exchanged_show_in_a_still_hover_by_how_they_answer_the_turning(order):
    """Its torques move hardly anything, and each of them is commanded against the rate about its own axis."""
    sound = independent.fly([independent.Case("still", seed=3, seconds=20.0)])[0]
    assert wg.open_flights([sound], independent.MODEL)
    speed = sound.actuators.rotor_speed[:, order]
    other = replace(sound, actuators=replace(sound.actuators, rotor_speed=speed))
    with pytest.raises(
        LogError,
        match=f"rotors: Torques are commanded against the body rate.* in the order {', '.join(map(str, order))}",
    ):
        wg.open_flights([other], independent.MODEL)
