"""Models from what others say of a vehicle, against moments, weights and torques that are known."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.flight.flight import ActuatorSeries, BatterySeries, Flight, ImuSeries, OdometrySeries
from wrenchgap.plant import model_file
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.drafts import ardupilot, px4
from wrenchgap.plant.drafts.ardupilot import FRAMES, rotors_of
from wrenchgap.plant.drafts.draft import Draft, Sourced, completed, inertia_of_mass
from wrenchgap.plant.drafts.model_text import text_of
from wrenchgap.plant.drafts.sources import Given, draft_of_source, parameters_of
from wrenchgap.plant.drafts.thrust_curve_fit import with_fitted_thrust
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import GRAVITY

IRIS = {"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 4, "THR_MDL_FAC": 0.0, "MPC_THR_HOVER": 0.45, "EKF2_IMU_POS_X": 0.03}
IRIS |= {"EKF2_IMU_POS_Y": 0.01, "EKF2_IMU_POS_Z": -0.02}
PLACES = ((0.15, 0.25, 0.04), (-0.15, -0.19, 0.05), (0.15, -0.25, 0.04), (-0.15, 0.19, 0.05))
"""Forward, right, KM: PX4's first motor is front right and turns counter-clockwise."""
for number, (forward, right, km) in enumerate(PLACES):
    row = {"PX": forward, "PY": right, "PZ": -0.02, "AX": 0.0, "AY": 0.0, "AZ": -1.0, "CT": 6.5}
    row["KM"] = km if number < 2 else -km
    IRIS |= {f"CA_ROTOR{number}_{key}": value for key, value in row.items()}


def model_of(draft):
    return model_file.loads(text_of(completed(draft), ["a test"]))


def iris(**changed):
    parameters = IRIS | changed
    return Draft(
        "iris",
        "iris.ulg",
        px4.rotors_of(parameters, "iris.ulg"),
        mass=Sourced(1.5, "scales", tolerance=0.005),
        com=px4.com_of(parameters),
        imu_position=px4.imu_of(parameters),
        command=px4.command_of(parameters),
    )


def wrench(model, speeds):
    arms, rotors = model.vehicle.geometry()
    sent = Commands(np.zeros((1, 6)), np.zeros((1, len(arms))), np.broadcast_to(speeds, (1, len(rotors))))
    return nominal_wrench(model.vehicle, sent)[0]


def test_ratios_of_px4_are_scaled_to_the_arm_and_refused_without():
    """PX4 needs ratios alone: rotors at one metre each way are those of a vehicle that nobody measured."""
    ratios = {f"CA_ROTOR{n}_P{axis}": np.sign(IRIS[f"CA_ROTOR{n}_P{axis}"]) for n in range(4) for axis in "XY"}
    with pytest.raises(ModelError, match="--arm METRES"):
        px4.rotors_of(IRIS | ratios, "own.ulg")
    for parameters in (IRIS, IRIS | ratios):
        places = np.array([r.position_B.value for r in px4.rotors_of(parameters, "own.ulg", 0.25)])
        assert np.max(np.hypot(*places[:, :2].T)) == pytest.approx(0.25)
    assert np.hypot(*places[:, :2].T) == pytest.approx(0.25)


def test_px4_geometry_becomes_forward_left_up():
    arms, rotors = model_of(iris()).vehicle.geometry()
    assert arms.position_B == pytest.approx(
        np.array([[0.15, -0.25, 0.02], [-0.15, 0.19, 0.02], [0.15, 0.25, 0.02], [-0.15, -0.19, 0.02]])
    )
    assert rotors.spin.tolist() == [1, 1, -1, -1]
    assert rotors.kappa == pytest.approx([0.04, 0.05, 0.04, 0.05])
    assert model_of(iris()).vehicle.imu_position_B == pytest.approx([0.03, -0.01, 0.02])


def test_the_reaction_torque_opposes_the_turning():
    """A rotor that turns counter-clockwise, from above, drags the hull clockwise: about -z, KM thrust."""
    model = model_of(iris())
    _, rotors = model.vehicle.geometry()
    for number, km in enumerate((0.04, 0.05, -0.04, -0.05)):
        speeds = np.zeros(4)
        speeds[number] = np.sqrt(2.0 / rotors.c_f[number])  # 2 N
        assert wrench(model, speeds)[5] == pytest.approx(-km * 2.0, rel=1e-5)


def test_more_thrust_on_the_right_rolls_to_the_left():
    """PX4's motors 1 (front right) and 4 (rear right): a negative roll torque in B, x forward, y left, z up."""
    model = model_of(iris())
    speeds = np.full(4, 400.0)
    speeds[[0, 3]] *= 1.1
    assert wrench(model, speeds)[3] < -0.1


def test_hover_throttle_carries_the_weight():
    model = model_of(iris())
    speeds = model.command.speeds(np.full((1, 4), 0.45), None, model.vehicle)
    assert wrench(model, speeds)[:3] == pytest.approx([0.0, 0.0, 1.5 * GRAVITY], rel=1e-5)


def test_px4_with_a_model_factor_commands_shares_of_thrust():
    model = model_of(iris(THR_MDL_FAC=0.3))
    _, rotors = model.vehicle.geometry()
    half, full = (
        rotors.c_f[0] * model.command.speeds(np.full((1, 4), u), None, model.vehicle)[0, 0] ** 2 for u in (0.5, 1.0)
    )
    assert half / full == pytest.approx(0.5)


@pytest.mark.parametrize("hover", [0.0, -5.0, 40.0])
def test_a_throttle_at_which_nothing_hovers_says_nothing_of_the_thrust(tmp_path, hover):
    """Never learnt, or damaged: full thrust is then the typical multiple of the weight, and assumed."""
    text = "\n".join(x for x in ARDUPILOT.splitlines() if not x.startswith("MOT_THST_HOVER"))
    (tmp_path / "quad.param").write_text(f"{text}\nMOT_THST_HOVER,{hover:g}\n")
    draft = completed(draft_of_source(tmp_path / "quad.param", Given(mass=2.0, arm=0.2)))
    for rotor in draft.rotors:
        assert rotor.speed_max.assumed
        assert 1.2 < rotor.c_f.value * rotor.speed_max.value**2 * len(draft.rotors) / (2.0 * GRAVITY) < 4.0


def test_a_count_of_rotors_that_nobody_has_is_no_work():
    """Two thousand million rotors of a damaged log kept `check` busy for an hour."""
    assert not px4.placeholders({"CA_ROTOR_COUNT": 2.0**31 - 1.0, "CA_ROTOR0_PX": 1.0, "CA_ROTOR0_PY": 1.0})


def test_a_rotor_without_direction_is_refused():
    with pytest.raises(ModelError, match="CA_ROTOR2_AX, _AY, _AZ are all zero"):
        iris(CA_ROTOR2_AZ=0.0)


def test_tilted_rotors_keep_their_direction():
    """30 degrees out to the right (PX4's +y), which is -y in B."""
    model = model_of(iris(CA_ROTOR0_AY=0.5, CA_ROTOR0_AZ=-np.sqrt(0.75)))
    assert model.vehicle.geometry()[0].normal_B[0] == pytest.approx([0.0, -0.5, np.sqrt(0.75)], abs=1e-5)


def test_every_number_of_the_file_says_where_it_is_from():
    lines = text_of(completed(iris()), ["a test"]).splitlines()
    keys = [line for line in lines if " = " in line and not line.startswith(("#", "schema", "name", "tilts", "source"))]
    assert len(keys) > 12
    assert [line for line in keys if "  # " not in line] == []
    assert sum("ASSUMED" in line for line in keys) >= 4


def test_what_is_missing_is_asked_for():
    with pytest.raises(ModelError, match="weigh it and say --mass KG"):
        completed(Draft("x", "x.ulg", px4.rotors_of(IRIS, "x.ulg")))
    with pytest.raises(ModelError, match="--frame quad_x --arm METRES"):
        completed(Draft("x", "x.ulg", mass=Sourced(1.0, "scales")))


@pytest.mark.parametrize("frame", FRAMES)
def test_every_frame_can_hover_and_yaw(frame):
    """Equal rotors make no torque, half of them turn each way, and all four axes can be commanded."""
    model = model_of(Draft(frame, frame, rotors_of(frame, 0.3, "x"), mass=Sourced(2.0, "scales")))
    _, rotors = model.vehicle.geometry()
    assert wrench(model, 500.0)[[0, 1, 3, 4, 5]] == pytest.approx(np.zeros(5), abs=1e-4)
    assert rotors.spin.sum() == 0
    columns = np.array([wrench(model, 500.0 * np.eye(len(rotors))[r]) for r in range(len(rotors))])
    assert np.linalg.matrix_rank(columns[:, 2:], tol=1e-3) == 4


@pytest.mark.parametrize("frame", FRAMES)
def test_neighbours_turn_against_each_other(frame):
    """All of these frames alternate around the vehicle."""
    around = sorted(FRAMES[frame])
    turns = [turn for _, turn in around]
    assert all(a == -b for a, b in itertools.pairwise(turns))


def test_the_estimated_inertia_is_that_of_masses_at_the_rotors():
    """Half of 2 kg on a ring of 0.3 m: a quarter kilogram at each of four corners."""
    angles = np.radians([45, 135, 225, 315])
    hubs = 0.3 * np.stack((np.cos(angles), np.sin(angles), 0 * angles), axis=1)
    moments = inertia_of_mass(2.0, hubs + np.array([0.1, 0.0, 0.2]))
    assert moments == pytest.approx([0.5 * 0.09, 0.5 * 0.09, 0.09])


@pytest.mark.parametrize(
    ("mass", "arm", "published"),
    [
        (0.027, 0.046, (16.6e-6, 16.7e-6, 29.3e-6)),  # Crazyflie 2
        (0.716, 0.17, (0.007, 0.007, 0.012)),  # AscTec Hummingbird
        (2.0, 0.246, (0.0217, 0.0217, 0.04)),  # Holybro X500
    ],
)
def test_published_inertias_lie_within_twice_the_tolerance(mass, arm, published):
    draft = completed(Draft("x", "x", rotors_of("quad_x", arm, "x"), mass=Sourced(mass, "scales")))
    away = (np.array(published) - draft.inertia.value) / draft.inertia.tolerance
    assert np.all(np.abs(away) < 2.0)


def flown(u, force, unit="normalised", rate=50.0, voltage=None):
    """A flight in which commands u (N,), the same for all rotors, felt `force` (N,) [m/s^2] along z."""
    time = np.arange(len(u)) / rate
    sent = ActuatorSeries("/motors", time, np.zeros((len(u), 0)), np.tile(u[:, None], (1, 4)), unit=unit)
    felt = np.stack((0 * force, 0 * force, force), axis=1)
    imu = ImuSeries("/imu", time, np.zeros_like(felt), felt)
    battery = None if voltage is None else BatterySeries("/battery", time, voltage)
    return Flight("test", Path("test.ulg"), "0" * 64, 0, actuators=sent, imu=imu, battery=battery)


@pytest.mark.parametrize("factor", [0.0, 0.4, 1.0])
def test_level_and_shape_of_the_curve_come_from_a_flight(factor):
    """On the ground the accelerometer reads g whatever the throttle: that part must not count."""
    rng = np.random.default_rng(0)
    u = np.concatenate((np.linspace(0.0, 0.25, 300), 0.5 + 0.12 * np.sin(0.02 * np.arange(1500))))
    made = 4 * 7.0 * (factor * u**2 + (1 - factor) * u) / 1.5
    force = np.where(np.arange(len(u)) < 300, GRAVITY, made) + 0.05 * rng.normal(size=len(u))
    command = with_fitted_thrust(iris(), flown(u, force)).command
    assert command.thrust_max.value == pytest.approx(7.0, rel=0.02)
    assert command.keys["factor"].value == pytest.approx(factor, abs=0.1)
    assert command.thrust_max.source.startswith("fitted: ")
    assert not command.thrust_max.assumed


def test_a_steady_hover_shows_the_level_and_not_the_shape():
    rng = np.random.default_rng(1)
    u = 0.5 + 0.002 * rng.normal(size=1000)
    force = np.full(1000, GRAVITY) + 0.1 * rng.normal(size=1000)
    command = with_fitted_thrust(iris(), flown(u, force)).command
    assert command.keys["factor"].assumed
    assert command.thrust_max.value * 0.25 * 4 == pytest.approx(1.5 * GRAVITY, rel=0.01)


@pytest.mark.parametrize(("exponent", "drop", "assumed"), [(2.0, 2.0, False), (0.0, 2.0, False), (1.0, 0.05, True)])
def test_thrust_goes_with_the_square_of_the_voltage_unless_the_flight_shows_another_power(exponent, drop, assumed):
    """Speed controllers that hold a speed: 0. A battery that hardly sags shows nothing."""
    rng = np.random.default_rng(2)
    voltage = np.linspace(16.6, 16.6 - drop, 2000)
    u = 0.5 + 0.05 * np.sin(0.02 * np.arange(2000))
    force = 4 * 7.0 * u**2 * (voltage / voltage.mean()) ** exponent / 1.5 + 0.05 * rng.normal(size=2000)
    command = with_fitted_thrust(iris(), flown(u, force, voltage=voltage)).command
    charge = command.keys["voltage"]
    assert charge.assumed == assumed
    assert charge.value["exponent"] == pytest.approx(2.0 if assumed else exponent, abs=0.3)
    nominal = charge.value["nominal"]
    assert voltage.min() < nominal < voltage.max()
    assert command.thrust_max.value == pytest.approx(7.0 * (nominal / voltage.mean()) ** exponent, rel=0.02)


def test_what_reads_no_battery_is_none():
    """PX4 without a power module logs millivolts."""
    u = 0.5 + 0.05 * np.sin(0.02 * np.arange(2000))
    found = with_fitted_thrust(iris(), flown(u, 4 * 7.0 * u**2 / 1.5, voltage=np.full(2000, 0.05) + 0.01 * u))
    assert "voltage" not in found.command.keys


def test_idling_on_the_ground_is_no_flight():
    """Rotors at 2 %, or at 30 % of a vehicle that never leaves the ground: the accelerometer reads g all the same."""
    still = np.full(1000, GRAVITY)
    assert with_fitted_thrust(iris(), flown(np.full(1000, 0.02), still)).command.thrust_max is None
    grounded = flown(np.full(1000, 0.3), still)
    at = np.zeros((1000, 3)) + np.array([0.0, 0.0, 0.05])
    odometry = OdometrySeries("/odometry", grounded.imu.time, at, np.tile([1.0, 0.0, 0.0, 0.0], (1000, 1)))
    assert with_fitted_thrust(iris(), replace(grounded, odometry=odometry)).command.thrust_max is None


def test_a_thrust_that_no_multirotor_has_is_not_believed():
    found = with_fitted_thrust(iris(), flown(np.full(1000, 0.15), np.full(1000, GRAVITY)))
    assert found.command.thrust_max is None
    assert "is this a flight?" in found.notes[-1]


def test_a_mass_in_grams_is_refused_and_a_heavy_one_doubted():
    with pytest.raises(ModelError, match=r"with 1500 kg the rotors would carry .* say the mass in kilograms"):
        completed(Draft("x", "x", rotors_of("quad_x", 0.25, "x"), mass=Sourced(1500.0, "scales")))
    draft = completed(Draft("x", "x", rotors_of("quad_x", 0.25, "x"), mass=Sourced(40.0, "scales")))
    assert "is the mass in kilograms" in draft.notes[-1]
    assert completed(Draft("x", "x", rotors_of("quad_x", 0.25, "x"), mass=Sourced(1.5, "scales"))).notes == ()


def test_a_log_on_the_ground_or_in_another_unit_shows_nothing():
    short = flown(np.full(60, 0.5), np.full(60, GRAVITY))
    assert with_fitted_thrust(iris(), short).command.thrust_max is None
    pulses = flown(np.full(1000, 1500.0), np.full(1000, GRAVITY), unit="pwm")
    assert with_fitted_thrust(iris(), pulses).command.thrust_max is None


ARDUPILOT = """# from Mission Planner
FRAME_CLASS,1
FRAME_TYPE 1
MOT_PWM_MIN,1000
MOT_PWM_MAX,2000
MOT_SPIN_MIN,0.15
MOT_SPIN_MAX,0.95
MOT_THST_EXPO,0.65
MOT_THST_HOVER,0.3   # learned
INS_POS1_X,0.02
INS_POS1_Y,0.0
INS_POS1_Z,-0.05
"""


def test_a_parameter_that_comes_twice_with_two_values_is_refused(tmp_path):
    file = tmp_path / "two.params"
    file.write_text("1\t1\tCA_ROTOR_COUNT\t4\t6\n1\t1\tCA_ROTOR_COUNT\t4\t6\n2\t1\tCA_ROTOR_COUNT\t6\t6\n")
    with pytest.raises(ModelError, match="line 3: CA_ROTOR_COUNT 6 was 4 before"):
        parameters_of(file)


def test_ardupilot_parameters_hover_at_the_learned_throttle(tmp_path):
    (tmp_path / "quad.param").write_text(ARDUPILOT)
    model = model_of(draft_of_source(tmp_path / "quad.param", Given(mass=2.2, arm=0.3)))
    assert model.vehicle.imu_position_B == pytest.approx([0.02, 0.0, 0.05])
    # share 0.3 of full thrust is the root u of 0.65 u^2 + 0.35 u, between spin min and spin max
    u = (-0.35 + np.sqrt(0.35**2 + 4 * 0.65 * 0.3)) / (2 * 0.65)
    pulse = 1150.0 + u * 800.0
    speeds = model.command.speeds(np.full((1, 4), pulse), None, model.vehicle)
    assert wrench(model, speeds)[2] == pytest.approx(2.2 * GRAVITY, rel=1e-4)
    first = model.vehicle.geometry()[0].position_B[0]
    assert first == pytest.approx([0.3 * np.sqrt(0.5), -0.3 * np.sqrt(0.5), 0.0], abs=1e-6)  # front right


def test_ardupilot_without_a_range_of_its_own_takes_that_of_the_throttle(tmp_path):
    text = ARDUPILOT.replace("MOT_PWM_MIN,1000", "MOT_PWM_MIN,0").replace("MOT_PWM_MAX,2000", "MOT_PWM_MAX,0")
    (tmp_path / "old.param").write_text(text + "RC3_MIN,1100\nRC3_MAX,1900\n")
    found = draft_of_source(tmp_path / "old.param", Given(mass=2.2, arm=0.3)).command.keys["range"].value
    assert found == pytest.approx((1100.0 + 0.15 * 800.0, 1100.0 + 0.95 * 800.0))
    (tmp_path / "less.param").write_text(text)
    said = draft_of_source(tmp_path / "less.param", Given(mass=2.2, arm=0.3)).command.keys["range"]
    assert said.value == pytest.approx((1150.0, 1950.0))
    assert said.assumed


@pytest.mark.parametrize(("name", "value"), [("MOT_THST_EXPO", 2.0), ("MOT_SPIN_MIN", -1.0), ("MOT_SPIN_MAX", np.inf)])
def test_a_parameter_that_cannot_be_is_named(name, value):
    """And no key of a model file that nobody has written yet."""
    with pytest.raises(ModelError, match=f"parameter {name} is {value:g}, expected 0 to 1"):
        ardupilot.command_of({name: value})
    with pytest.raises(ModelError, match="parameter INS_POS1_Y is 1e"):
        px4.imu_of({"INS_POS1_X": 0.1, "INS_POS1_Y": 1e38}, "INS_POS1", "ArduPilot")


BEFORE_3_5 = {"RC3_MIN": 1100, "RC3_MAX": 1900, "THR_MIN": 100, "MOT_THST_MAX": 0.9, "MOT_THST_EXPO": 0.5, "FRAME": 1}


def test_firmware_before_3_5_has_the_range_of_the_throttle_and_its_own_ends():
    """100 thousandths of 800 us above 1100 us; and of the 720 us above that 90 %."""
    found = ardupilot.command_of(BEFORE_3_5).keys["range"]
    assert found.value == pytest.approx([1180.0, 1180.0 + 0.9 * 720.0])
    assert not found.assumed
    assert found.source == "RC3_MIN, RC3_MAX, THR_MIN, MOT_THST_MAX"
    less = ardupilot.command_of({k: v for k, v in BEFORE_3_5.items() if k != "MOT_THST_MAX"}).keys["range"]
    assert less.value == pytest.approx([1180.0, 1180.0 + 0.95 * 720.0])
    assert less.assumed
    assert less.source == "RC3_MIN, RC3_MAX, THR_MIN; ArduPilot's default of MOT_THST_MAX"


@pytest.mark.parametrize(("shape", "name"), [(0, "quad_plus"), (1, "quad_x"), (3, "quad_h")])
def test_firmware_before_3_5_says_its_frame_by_parameter_and_text(shape, name):
    parameters = {**BEFORE_3_5, "FRAME": shape}
    found = ardupilot.rotors_from(parameters, 0.25, "log.bin", "QUAD")
    expected = rotors_of(name, 0.25, "")
    assert [(r.position_B.value, r.spin.value) for r in found] == [(r.position_B.value, r.spin.value) for r in expected]
    assert ardupilot.rotors_from(parameters, 0.25, "old.param") == ()  # a class that nothing says
    with pytest.raises(ModelError, match="FRAME 2 with the log's text Frame: QUAD is not known here"):
        ardupilot.rotors_from({**BEFORE_3_5, "FRAME": 2}, 0.25, "log.bin", "QUAD")


def test_a_typed_frame_that_contradicts_the_parameters_is_used_and_told(tmp_path):
    (tmp_path / "quad.param").write_text(ARDUPILOT)
    (note,) = draft_of_source(tmp_path / "quad.param", Given(mass=2.0, frame="quad_plus", arm=0.2)).notes
    assert "the frame is quad_x (FRAME_CLASS 1 with FRAME_TYPE 1), and --frame quad_plus is used" in note
    assert draft_of_source(tmp_path / "quad.param", Given(mass=2.0, frame="quad_x", arm=0.2)).notes == ()


def test_a_typed_frame_with_motors_elsewhere_than_px4_has_them_is_told():
    """PX4's frame is forward, right, down: motor 1 of a quad_x is at the front right."""
    x, y = (1.0, -1.0, 1.0, -1.0), (1.0, -1.0, -1.0, 1.0)
    parameters = {"CA_ROTOR_COUNT": 4.0} | {
        f"CA_ROTOR{k}_P{a}": v[k] for k in range(4) for a, v in (("X", x), ("Y", y))
    }
    parameters |= {
        f"CA_ROTOR{k}_{n}": v for k in range(4) for n, v in (("KM", (0.05, 0.05, -0.05, -0.05)[k]), ("AZ", -1.0))
    }
    assert px4.frame_notes(parameters, "quad_x", "a.ulg") == px4.frame_notes(parameters, None, "a.ulg") == ()
    (note,) = px4.frame_notes(parameters, "quad_plus", "a.ulg")
    assert "CA_ROTOR* have the motors elsewhere than --frame quad_plus" in note
    with pytest.raises(ModelError, match=r"has 6 rotors, and a\.ulg has CA_ROTOR_COUNT 4"):
        px4.frame_notes(parameters, "hexa_x", "a.ulg")
    assert px4.arm_notes(parameters, 0.25, "a.ulg") == ()  # 1 m and 1 m are ratios
    measured = {key: 0.2 * value if "_P" in key else value for key, value in parameters.items()}
    assert px4.arm_notes(measured, 0.28, "a.ulg") == px4.arm_notes(measured, None, "a.ulg") == ()
    (note,) = px4.arm_notes(measured, 0.25, "a.ulg")
    assert "0.283 m from the middle, --arm 0.25 is used" in note


@pytest.mark.parametrize("frame", ["quad-x", "X", "hexa"])
def test_a_misspelt_frame_is_answered_with_those_there_are(tmp_path, frame):
    (tmp_path / "quad.param").write_text(ARDUPILOT)
    with pytest.raises(UsageError, match=f"--frame {frame}: expected one of quad_plus, quad_x"):
        draft_of_source(tmp_path / "quad.param", Given(mass=2.0, frame=frame, arm=0.2))


@pytest.mark.parametrize(
    ("text", "given", "message"),
    [
        (ARDUPILOT, Given(mass=2.0), "the frame is quad_x .* say --arm METRES"),
        (
            ARDUPILOT.replace("FRAME_CLASS,1", "FRAME_CLASS,7"),
            Given(mass=2.0, arm=0.2),
            "FRAME_CLASS 7 .* not known here",
        ),
        (
            ARDUPILOT.replace("FRAME_CLASS,1", "FRAME_CLASS,nan"),
            Given(mass=2.0),
            "'FRAME_CLASS,nan', .* a finite number",
        ),
        (
            ARDUPILOT,
            Given(mass=2.0, frame="hexa_x", arm=0.2),
            "--frame hexa_x: has 6 rotors, .* quad_x .*, which has 4; leave --frame out",
        ),
        (f"{ARDUPILOT}\nMOT_THST_EXPO,0,65\n", Given(mass=2.0), "got 'MOT_THST_EXPO,0,65', expected NAME,VALUE"),
        (f"{ARDUPILOT}\nMOT_THST_EXPO,1_0\n", Given(mass=2.0), "got 'MOT_THST_EXPO,1_0', expected NAME,VALUE"),
        ("FRAME_CLASS,one\n", Given(mass=2.0), r"quad.param, line 1: got 'FRAME_CLASS,one', expected NAME,VALUE"),
        ("1\t1\tFRAME_CLASS\t1\n", Given(mass=2.0), r"line 1: got '1\\t1\\tFRAME_CLASS\\t1', expected NAME,VALUE"),
        ("RCMAP_THROTTLE,inf\n", Given(mass=2.0), r"quad.param, line 1: got 'RCMAP_THROTTLE,inf', .* a finite number"),
    ],
)
def test_ardupilot_says_what_is_missing(tmp_path, text, given, message):
    (tmp_path / "quad.param").write_text(text)
    with pytest.raises(ModelError, match=message) as caught:
        draft_of_source(tmp_path / "quad.param", given)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (Given(mass=-1.0), "--mass -1: expected a positive number"),
        (Given(frame="quad_x"), "say its size too, --arm"),
        (Given(frame="cube", arm=0.2), "--frame cube: expected one of quad_plus"),
    ],
)
def test_wrong_answers_are_refused(given, message):
    with pytest.raises(UsageError, match=message):
        draft_of_source(None, given)
