"""Models in the terms of autopilots and simulators: their own formulas and engines, applied to what was written."""

import importlib.util
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight import so3
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant import model_file
from wrenchgap.plant.command_curve import Bench, CommandCurve, Polynomial
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.rigid_body import RigidBody, unpack
from wrenchgap.plant.state import Commands
from wrenchgap.plant.targets.autopilots import AUTOPILOTS
from wrenchgap.plant.targets.quantities import quantities
from wrenchgap.plant.targets.written import written
from wrenchgap.plant.vehicle import GRAVITY, Body
from wrenchgap.plant.wrench_model import about_com

FRD = np.array([1.0, -1.0, -1.0])
FULL = 6.0
"""[N], thrust of a rotor at full command."""


def fitted(vehicle, share=0.1, **effects):
    """Effects with these values, each known to a share of it."""
    made = []
    for name, values in effects.items():
        parameters = [p.name for p in find(name).parameters(vehicle)]
        one = make_effect(vehicle, name, {p: values.get(p, 0.0) for p in parameters})
        made.append(replace(one, std=share * np.abs(one.theta)))
    return made


@pytest.fixture
def quadrotor(quadrotor):
    """A quadrotor of 1.2 kg whose thrust goes with the square of the command."""
    vehicle = quadrotor
    rotors = replace(vehicle.rotors, speed_max=np.sqrt(FULL / vehicle.rotors.c_f))
    body = Body(1.2, np.diag([0.012, 0.013, 0.022]), np.array([0.0, 0.0, -0.01]))
    curve = CommandCurve("normalised", "thrust", Polynomial(np.array([0.0, 0.0, FULL])))
    return replace(
        wg.load_model("crazyflie"), path=None, vehicle=replace(vehicle, rotors=rotors, body=body), command=curve
    )


def values(made):
    return {row.name: row.value for row in made.parameters}


def test_quantities_are_what_the_effects_put_in(quadrotor):
    vehicle, count = quadrotor.vehicle, len(quadrotor.vehicle.geometry()[1])
    drag = {"linear_x": 0.1, "linear_z": 0.3, "quadratic_y": 0.02}
    effects = fitted(
        vehicle,
        mass={"added": 0.05},
        com_offset={"x": 0.004, "z": -0.01},
        rotor_thrust={"rotor_1": -0.2},
        drag_torque={"change": 0.25},
        asymmetric_motor_lag={"tau_up": 0.02, "tau_down": 0.05},
        command_delay={"delay": 0.006},
        body_drag=drag,
        imu_lever_arm={"y": 0.03},
        imu_misalignment={"x": 0.02, "y": -0.01},
        constant_wrench={"F_z": 0.4},
        wind={"x": 3.0},
    )
    found = quantities(quadrotor.with_effects(effects))
    expected = {
        "mass": vehicle.body.mass + 0.05,
        "com": np.add(vehicle.body.com_B, [0.004, 0.0, -0.01]),
        "imu": np.add(vehicle.imu_position_B, [0.0, 0.03, 0.0]),
        "misalignment": [0.02, -0.01, 0.0],
        "lag": [0.02, 0.05],
        "delay": 0.006,
        "linear": [0.1, 0.0, 0.3],
        "quadratic": [0.0, 0.02, 0.0],
        "level": vehicle.body.mass * GRAVITY / count * (1.0 - 0.2 / count),
        "yaw": -1.25 * vehicle.rotors.spin * vehicle.rotors.kappa,
        "curve": [0.0, 0.0, 1.0],
    }
    for name, value in expected.items():
        np.testing.assert_allclose(found[name].value, value, rtol=1e-6, atol=1e-9, err_msg=name)
    np.testing.assert_allclose(found["balance"].value / found["balance"].value[0], [1.0, 0.8, 1.0, 1.0], rtol=1e-9)
    np.testing.assert_allclose(found["com"].std, [0.0004, 0.0, 0.001], rtol=1e-6)
    assert found["level"].by == ("rotor_thrust",)
    assert not found["inertia"].identified


def test_the_command_in_hover_and_how_sure_it_is(quadrotor):
    scale, std = 0.08, 0.02
    one = replace(make_effect(quadrotor.vehicle, "thrust_scale", [scale]), std=np.array([std]))
    found = quantities(quadrotor.with_effects([one]))["signal"]
    hover = np.sqrt(1.2 * GRAVITY / (4 * FULL * (1.0 + scale)))  # 4 T_max (1 + s) u^2 = m g
    assert found.value == pytest.approx(hover, rel=1e-6)
    assert found.std == pytest.approx(0.5 * hover / (1.0 + scale) * std, rel=1e-3)


def test_px4_allocates_as_the_vehicle_acts(quadrotor):
    effects = fitted(
        quadrotor.vehicle,
        com_offset={"x": 0.01, "y": -0.006},
        rotor_thrust={"rotor_2": -0.15},
        drag_torque={"change": 0.3},
    )
    model = quadrotor.with_effects(effects)
    set_before = {f"CA_ROTOR{r}_{key}": 0.0 for r in range(4) for key in ("PZ", "AX", "AY")}
    hubs = quadrotor.vehicle.arms.position_B * FRD
    for r in range(4):
        set_before |= {f"CA_ROTOR{r}_PX": hubs[r, 0], f"CA_ROTOR{r}_PY": hubs[r, 1], f"CA_ROTOR{r}_AZ": -1.0}
    now = set_before | values(written(model, "px4", set_before))
    columns = []
    for r in range(4):  # PX4, "Control Allocation": thrust ct a, moment ct (p x a) - ct km a
        place, along = (np.array([now[f"CA_ROTOR{r}_{kind}{axis}"] for axis in "XYZ"]) for kind in "PA")
        ct, km = now[f"CA_ROTOR{r}_CT"], now[f"CA_ROTOR{r}_KM"]
        columns.append(np.concatenate((ct * along, ct * np.cross(place, along) - ct * km * along)))
    acting, (_, rotors) = model.wrench_model, model.vehicle.geometry()
    hover = np.sqrt(1.2 * GRAVITY / 4 / rotors.c_f)
    state = unpack(np.zeros(4), np.tile([0.0] * 3 + [1.0] + [0.0] * 9, (4, 1)))
    one_by_one = Commands(np.zeros((4, 6)), np.zeros((4, 4)), np.diag(hover))
    flown = about_com(acting.body, acting.wrench(one_by_one, state)) * np.tile(FRD, 2)
    np.testing.assert_allclose(np.array(columns) / np.abs(columns).max(), flown / np.abs(flown).max(), atol=1e-6)


@pytest.mark.parametrize("target", ["px4", "ardupilot"])
def test_a_board_that_is_turned_reads_gravity_level_again(quadrotor, target):
    turned = np.array([0.03, -0.02, 0.0])
    model = quadrotor.with_effects(fitted(quadrotor.vehicle, imu_misalignment=dict(zip("xyz", turned, strict=True))))
    level = np.array([0.0, 0.0, GRAVITY])  # felt at rest, in B
    board = (level - np.cross(turned, level)) * FRD
    found = values(written(model, target))
    if target == "px4":  # vectors are turned by Rz Ry Rx of SENS_BOARD_*_OFF, from the board to the body
        x, y = np.radians([found["SENS_BOARD_X_OFF"], found["SENS_BOARD_Y_OFF"]])
    else:  # likewise of AHRS_TRIM_X, _Y
        x, y = found["AHRS_TRIM_X"], found["AHRS_TRIM_Y"]
    about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    np.testing.assert_allclose(about_y @ about_x @ board, level * FRD, atol=2e-3 * GRAVITY)  # right to second order


@pytest.mark.parametrize(("forward", "left"), [(0.3, 0.0), (0.0, 0.3), (-0.2, 0.1)])
def test_a_vehicle_that_is_pushed_stands_still_where_ardupilot_calls_it_level(quadrotor, forward, left):
    """At the attitude at which gravity, the push and a thrust along z are in balance the trimmed board feels level."""
    push = fitted(quadrotor.vehicle, constant_wrench={"force_x": forward, "force_y": left, "torque_x": 0.001})
    made = written(quadrotor.with_effects(push), "ardupilot")
    found = values(made)
    trim = (
        np.array([found.get("AHRS_TRIM_X", 0.0), found.get("AHRS_TRIM_Y", 0.0), 0.0]) * FRD
    )  # small rotations as vectors
    weight = 1.2 * GRAVITY
    up_B = np.array([forward, left, np.sqrt(weight**2 - forward**2 - left**2)]) / weight  # of all forces but gravity
    np.testing.assert_allclose(up_B + np.cross(trim, up_B), [0.0, 0.0, 1.0], atol=1e-3)
    assert np.abs(trim).max() > 0.015
    assert "constant_wrench: ArduPilot has no parameter for a constant torque" in made.lost
    with pytest.raises(ModelError, match="PX4 has no parameter for a constant force and a constant torque"):
        written(quadrotor.with_effects(push), "px4")


@pytest.mark.parametrize(
    ("azimuth", "towards"), [(0.0, (1.0, 0.0)), (90.0, (0.0, -1.0)), (225.0, (-(0.5**0.5), 0.5**0.5))]
)
def test_px4s_tilt_servos_end_where_the_arm_does(azimuth, towards):
    """An arm that leans by 3 deg towards the azimuth, to the right of ahead, and back, at no commanded tilt."""
    x, y = towards
    axis = f"[{-y}, {x}, 0.0]"  # right-handed, z turns towards (x, y)
    arms = "".join(
        f"[[vehicle.arms]]\nposition = [{a}, {b}, 0.0]\ntilt_axis = {axis}\nrotors = [{{ spin = 1, kappa = 0.02 }}]\n"
        for a, b in ((0.2, 0.2), (-0.2, 0.2), (0.2, -0.2), (-0.2, -0.2))
    )
    text = (
        "schema = 1\n[vehicle]\nname = 'tilts'\nmass = 1.2\ninertia = [0.02, 0.02, 0.03]\n[vehicle.arm]\n"
        f"tilts = true\n[vehicle.rotor]\nc_f = 9.0e-6\nradius = 0.1\nspeed_max = 1000.0\n{arms}"
    )
    model = model_file.loads(text)
    lean = np.radians(3.0)
    model = model.with_effects(fitted(model.vehicle, tilt_offset={"arm_1": lean, "arm_2": -lean}))
    servos = {"CA_SV_TL0_MINA": -40.0, "CA_SV_TL0_MAXA": 40.0, "CA_SV_TL1_MINA": -30.0, "CA_SV_TL1_MAXA": 80.0}
    before = servos | {"CA_SV_TL0_TD": azimuth, "CA_SV_TL1_TD": azimuth, "CA_ROTOR1_TILT": 1, "CA_ROTOR2_TILT": 2}
    found = values(written(model, "px4", before | {"CA_ROTOR_COUNT": 4, "THR_MDL_FAC": 0.0}))
    assert {name: found[name] for name in servos} == pytest.approx(
        dict(zip(servos, (-37.0, 43.0, -33.0, 77.0), strict=True)), abs=1e-3
    )
    assert any("zeros of servos need" in words for words in written(model, "px4").lost)


@pytest.mark.parametrize("sent", [0.0, 0.4])
def test_px4_linearises_with_the_factor_that_is_written(quadrotor, sent):
    """The motor makes thrust with g s^2 + (1 - g) s of the signal; PX4 sent the s with sent s^2 + (1 - sent) s = u."""
    true, model = 0.7, quadrotor
    if sent:
        bench = np.linspace(0.0, 1.0, 400)
        signal = (np.sqrt((1 - sent) ** 2 + 4 * sent * bench) - (1 - sent)) / (2 * sent)
        nominal = np.polynomial.Polynomial.fit(bench, FULL * (true * signal**2 + (1 - true) * signal), 6).convert()
        model = replace(model, command=CommandCurve("normalised", "thrust", Polynomial(nominal.coef)))
    else:
        model = replace(model, command=replace(model.command, law=Polynomial(FULL * np.array([0.0, 1 - true, true]))))
    level = replace(make_effect(model.vehicle, "thrust_curve", [1e-9, 0.0]), std=np.array([0.05, 0.0]))
    found = values(written(model.with_effects([level]), "px4", {"THR_MDL_FAC": sent}))
    factor = found["THR_MDL_FAC"]
    assert factor == pytest.approx(true, abs=0.01)
    hover = found["MPC_THR_HOVER"]  # commands are shares of thrust now
    assert hover == pytest.approx(1.2 * GRAVITY / (4 * FULL), abs=0.005)


def test_crazyflie_gets_newtons_by_duty_mass_and_inertia(quadrotor):
    model = quadrotor.with_effects(fitted(quadrotor.vehicle, thrust_scale={"scale": 0.1}, mass={"added": 0.05}))
    found = values(written(model, "crazyflie"))
    assert found["quadSysId.pwmToThrustA"] == pytest.approx(1.1 * FULL, rel=1e-6)
    assert found["quadSysId.pwmToThrustB"] == pytest.approx(0.0, abs=1e-6)
    assert "ctrlLee.mass" not in found  # 1 kg is the most that is believed of one


def test_ardupilots_curve_is_over_the_range_of_its_spin(quadrotor):
    curve = CommandCurve("pwm", "thrust", Polynomial(FULL * np.array([0.0, 0.4, 0.6])), (1150.0, 1950.0))
    level = replace(make_effect(quadrotor.vehicle, "thrust_curve", [1e-9, 0.0]), std=np.array([0.05, 0.0]))
    model = replace(quadrotor, command=curve).with_effects([level])
    found = values(written(model, "ardupilot", {"MOT_THST_EXPO": 0.5, "MOT_THST_HOVER": 0.3}))
    assert found["MOT_THST_EXPO"] == pytest.approx(0.6, abs=1e-6)
    assert found["MOT_THST_HOVER"] == pytest.approx(1.2 * GRAVITY / (4 * FULL), rel=1e-6)


def test_what_was_not_identified_is_refused_and_what_no_parameter_says_is_listed(quadrotor):
    vehicle = quadrotor.vehicle
    with pytest.raises(ModelError, match="holds nothing identified that PX4 has a parameter for"):
        written(quadrotor, "px4")
    [com] = fitted(vehicle, com_offset={"x": 0.004})
    with pytest.raises(ModelError, match="com_offset: was not fitted"):
        written(quadrotor.with_effects([replace(com, std=None)]), "px4")
    at_limit = replace(make_effect(vehicle, "drag_torque", [-0.8]), std=np.array([0.1]))
    model = quadrotor.with_effects([com, at_limit, *fitted(vehicle, motor_lag={"tau": 0.02})])
    made = written(model, "px4")
    assert not [name for name in values(made) if name.endswith("KM")]
    assert any("drag_torque: is at a limit" in words for words in made.lost)
    assert any("drag_torque: is at a limit" in words for words in written(model, "sdf").lost)
    np.testing.assert_array_equal(quantities(model)["yaw"].value, quantities(model)["yaw"].nominal)
    assert any("motor_lag: PX4 has no parameter for the lag of the rotors" in words for words in made.lost)
    assert "EKF2_IMU_POS_X" in values(made)
    assert not {"EKF2_IMU_POS_Y", "MPC_THR_HOVER", "CA_ROTOR0_AX"} & values(made).keys()


def test_places_are_written_together_since_px4_may_have_had_ratios(quadrotor):
    model = quadrotor.with_effects(fitted(quadrotor.vehicle, com_offset={"x": 0.004}))
    ratios = {f"CA_ROTOR{r}_P{axis}": np.sign(place) for r, hub in enumerate(quadrotor.vehicle.arms.position_B * FRD)
              for axis, place in zip("XY", hub, strict=False)}  # fmt: skip
    found = values(written(model, "px4", ratios))
    places = np.array([[found[f"CA_ROTOR{r}_P{axis}"] for axis in "XYZ"] for r in range(4)])
    np.testing.assert_allclose(places, (quadrotor.vehicle.arms.position_B - [0.004, 0.0, -0.01]) * FRD, atol=1e-9)


@pytest.mark.parametrize("rotors", [(0, 1, 2, 3), (2,)])
def test_propellers_the_other_way_round_are_refused_since_yaw_would_feed_back_on_itself(rotors, quadrotor):
    model = quadrotor.with_effects(fitted(quadrotor.vehicle, drag_torque={"change": 0.1}))
    places = quadrotor.vehicle.arms.position_B * FRD
    same = {f"CA_ROTOR{r}_P{axis}": places[r, k] for r in range(4) for k, axis in enumerate("XYZ")}
    same |= {f"CA_ROTOR{r}_KM": 0.05 * spin for r, spin in enumerate(quadrotor.vehicle.rotors.spin)}
    assert written(model, "px4", same)
    other = same | {f"CA_ROTOR{r}_KM": -same[f"CA_ROTOR{r}_KM"] for r in rotors}
    with pytest.raises(ModelError, match=f"rotor {rotors[0]} turns .*clockwise from above, CA_ROTOR{rotors[0]}_KM"):
        written(model, "px4", other)
    with pytest.raises(ModelError, match="rotor 2 pulls along"):
        written(model, "px4", same | {"CA_ROTOR2_AX": 1.0, "CA_ROTOR2_AZ": 0.0})
    del other[f"CA_ROTOR{rotors[0]}_KM"]  # of a damaged log
    with pytest.raises(ModelError, match=f"CA_ROTOR{rotors[0]}_KM 0 says otherwise"):
        written(model, "px4", other)


def test_parameters_that_are_not_written_are_not_judged(quadrotor):
    model = quadrotor.with_effects(fitted(quadrotor.vehicle, com_offset={"x": 0.004}))
    assert written(model, "px4", {"CAL_BARO1_OFF": -51.8, "EKF2_IMU_POS_X": 0.0})


def test_parameters_of_another_vehicle_are_refused(quadrotor):
    model = quadrotor.with_effects(fitted(quadrotor.vehicle, com_offset={"x": 0.004}))
    places = quadrotor.vehicle.arms.position_B * FRD
    other = {f"CA_ROTOR{r}_P{axis}": places[r - 1, k] for r in range(4) for k, axis in enumerate("XYZ")}
    with pytest.raises(ModelError, match="put the rotors of the model in the autopilot's order"):
        written(model, "px4", other)
    for wrong in ({"THR_MDL_FAC": 1e300}, {"THR_MDL_FAC": np.nan}, {"SENS_BOARD_X_OFF": 1e9}, {"CA_ROTOR1_CT": 0.0}):
        with pytest.raises(ModelError, match="the parameters that were set: "):
            written(model, "px4", wrong)
    with np.errstate(over="raise"), pytest.raises(ModelError, match="put the rotors of the model"):
        written(model, "px4", {"CA_ROTOR0_PX": 1e308, "CA_ROTOR0_PY": 1e308})
    with pytest.raises(ModelError, match="has 4 rotors, CA_ROTOR_COUNT is 6"):
        written(model, "px4", {"CA_ROTOR_COUNT": 6, "THR_MDL_FAC": 0.0})
    with pytest.raises(ModelError, match="none of PX4's"):
        written(model, "px4", {"FRAME_CLASS": 1.0})
    with pytest.raises(UsageError, match="expected one of px4, "):
        written(model, "betaflight")


def test_a_bench_table_is_over_the_same_commands(quadrotor):
    command = np.linspace(0.2, 0.9, 200)
    bench = CommandCurve("normalised", "thrust", Bench(command, FULL * command**2))
    effects = fitted(quadrotor.vehicle, thrust_scale={"scale": 0.1})
    expected = np.sqrt(1.2 * GRAVITY / (4 * FULL * 1.1))  # 4 T_max (1 + s) u^2 = m g
    found = values(written(replace(quadrotor, command=bench).with_effects(effects), "px4"))["MPC_THR_HOVER"]
    assert found == pytest.approx(expected, abs=1e-4)
    pulses = replace(bench, unit="pwm", law=Bench(1000.0 + 1000.0 * command, FULL * command**2))
    with pytest.raises(ModelError, match="thrust_scale: ArduPilot has no parameter for the thrust at a speed"):
        written(replace(quadrotor, command=pulses).with_effects(effects), "ardupilot")  # of which range?


def test_a_value_that_the_firmware_does_not_take_is_not_written(quadrotor):
    curve = replace(quadrotor.command, law=Polynomial(np.array([0.0, 0.0, 3.1])))  # hovers at 97 % of its command
    weak = replace(quadrotor, command=curve)
    weaker = replace(quadrotor, command=replace(quadrotor.command, law=Polynomial(np.array([0.0, 0.0, 2.0]))))
    scaled = weaker.with_effects(fitted(weaker.vehicle, thrust_scale={"scale": 0.1}, com_offset={"x": 0.002}))
    assert any("thrust_scale: PX4 has no parameter" in words for words in written(scaled, "px4").lost)  # never hovers
    made = written(weak.with_effects(fitted(weak.vehicle, mass={"added": 0.01}, com_offset={"x": 0.002})), "px4")
    assert any("MPC_THR_HOVER 0.9" in words and "takes 0.1 to 0.8" in words for words in made.lost)
    assert "MPC_THR_HOVER" not in values(made)


@pytest.mark.parametrize("target", ["mjcf", "sdf", "urdf"])
@pytest.mark.parametrize("name", ["tilt_hexarotor", "asymmetric_quadrotor"])
def test_descriptions_read_back_as_the_same_vehicle(tmp_path, target, name):
    model = wg.load_model(name)
    effects = fitted(
        model.vehicle, com_offset={"x": 0.004, "y": -0.002}, mass={"added": 0.07}, drag_torque={"change": 0.2}
    )
    lag = (
        {"asymmetric_motor_lag": {"tau_up": 0.02, "tau_down": 0.05}}
        if target != "mjcf"
        else {"motor_lag": {"tau": 0.03}}
    )
    more = fitted(model.vehicle, rotor_thrust={"rotor_1": -0.1}, imu_lever_arm={"x": 0.01, "y": 0.02}, **lag)
    model = model.with_effects([*effects, *more])
    path = tmp_path / f"vehicle.{'xml' if target == 'mjcf' else target}"
    path.write_text(written(model, target).text)
    drafted = wg.draft_model(path).model
    [lagging], read = drafted.effects, drafted.vehicle
    np.testing.assert_allclose(lagging.theta, model.effect(*lag).theta, rtol=1e-6)
    body, (arms, rotors), (arms_read, rotors_read) = (
        model.wrench_model.body,
        model.vehicle.geometry(),
        read.geometry(),
    )
    if target == "mjcf":
        np.testing.assert_allclose(
            read.imu_position_B, np.add(model.vehicle.imu_position_B, [0.01, 0.02, 0.0]), atol=1e-8
        )
    np.testing.assert_allclose(read.body.mass, body.mass, rtol=1e-6)
    np.testing.assert_allclose(read.body.com_B, body.com_B, atol=1e-7)
    # a flat vehicle, less its light links, would have moments that no body has: to the share of the links
    np.testing.assert_allclose(read.body.inertia, body.inertia, rtol=1e-4, atol=1e-8)
    hubs, hubs_read = (
        (a.position_B[r.arm] + r.offset[:, None] * a.normal_B[r.arm])
        for a, r in (model.vehicle.geometry(), read.geometry())
    )
    np.testing.assert_allclose(hubs_read, hubs, atol=1e-6)
    np.testing.assert_array_equal(arms_read.tilts, arms.tilts)
    if arms.tilts.any():
        np.testing.assert_allclose(arms_read.axis_B, arms.axis_B, atol=1e-6)
    np.testing.assert_array_equal(rotors_read.spin, rotors.spin)
    np.testing.assert_allclose(rotors_read.kappa, 1.2 * rotors.kappa, rtol=1e-6)
    gains = 1.0 - 0.1 * (np.arange(len(rotors)) == 1)
    most = rotors_read.c_f * rotors_read.speed_max**2
    np.testing.assert_allclose(most, gains * rotors.c_f * rotors.speed_max**2, rtol=1e-5)


# -- the simulators themselves fly what was written --

DT, STEPS = 0.002, 400


def commands(model):
    """Rotor speeds (N, R) about hover [rad/s], different for each."""
    _, rotors = model.vehicle.geometry()
    hover = np.sqrt(model.vehicle.body.mass * GRAVITY / len(rotors) / rotors.c_f)
    phase = np.arange(STEPS)[:, None] * DT * np.array([7.0, 9.0, 11.0, 13.0]) + np.arange(4)
    return hover * (1.0 + 0.04 * np.sin(phase))


def flown(model, speeds):
    """States (N, 13) of our rigid body, from rest at 1 m."""
    acting, count = model.wrench_model, len(speeds)
    y = np.tile([0.0, 0.0, 1.0, 1.0] + [0.0] * 9, (count + 1, 1))
    sent = Commands(np.zeros((count, 6)), np.zeros((count, 4)), speeds)
    lagged, _ = acting.command(sent, unpack(np.arange(count) * DT, y[:-1]), DT)
    body = RigidBody(acting.body)
    for k in range(count):
        state = unpack(np.array([k * DT]), y[k : k + 1])
        y[k + 1] = body.step(y[k], acting.wrench(lagged.take(slice(k, k + 1)), state)[0], DT)
    return y[1:]


def check_same(y, other, moved=0.05):
    """Two flights, to 2 mm and 0.3 deg, that end more than 5 cm and 5 deg from where they began."""
    turn = so3.log(so3.multiply(so3.conjugate(y[:, 3:7]), other[:, 3:7]))
    assert np.abs(y[-1, :3] - [0.0, 0.0, 1.0]).max() > moved
    assert np.linalg.norm(so3.log(y[-1:, 3:7])) > np.radians(5.0)
    assert np.abs(y[:, :3] - other[:, :3]).max() < 0.002
    assert np.abs(turn).max() < np.radians(0.3)


@pytest.fixture
def identified(quadrotor):
    effects = fitted(
        quadrotor.vehicle,
        com_offset={"x": 0.001, "y": -0.0005},
        drag_torque={"change": 0.3},
        thrust_scale={"scale": 0.03},
        mass={"added": 0.05},
    )
    return quadrotor.with_effects(effects)


def test_mujoco_flies_as_the_plant(identified):
    import mujoco

    uneven = identified.with_effects(
        [*identified.effects, *fitted(identified.vehicle, rotor_thrust={"rotor_3": -0.01})]
    )
    speeds, compiled = commands(uneven), mujoco.MjModel.from_xml_string(written(uneven, "mjcf").text)
    data, out = mujoco.MjData(compiled), []
    compiled.opt.timestep = DT
    mujoco.mj_resetData(compiled, data)
    for speed in speeds:
        data.ctrl[:] = uneven.vehicle.rotors.c_f * speed**2
        mujoco.mj_step(compiled, data)
        out.append(np.concatenate((data.qpos, data.qvel)))
    check_same(flown(uneven, speeds), np.array(out))


def test_rotorpy_flies_as_the_plant(identified):
    vehicles = pytest.importorskip("rotorpy.vehicles.multirotor")
    lagging = identified.with_effects(
        [
            *identified.effects,
            *fitted(identified.vehicle, motor_lag={"tau": 0.03}, rotor_drag={"coefficient": 5e-5}),
        ]
    )
    speeds, said = commands(lagging), {}
    exec(written(lagging, "rotorpy").text, said)  # a module of Python, for RotorPy to import
    com = lagging.wrench_model.body.com_B
    rest = {
        "x": np.array([0.0, 0.0, 1.0]) + com,
        "v": np.zeros(3),
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3),
    }
    state = rest | {"wind": np.zeros(3), "rotor_speeds": speeds[0]}
    vehicle, out = vehicles.Multirotor(said["quad_params"], state), []
    vehicle.weight = np.array([0.0, 0.0, -vehicle.mass * GRAVITY])  # it has 9.81
    for speed in speeds:
        state = vehicle.step(state, {"cmd_motor_speeds": speed}, DT)
        x, y, z, w = state["q"]
        out.append(np.concatenate((state["x"], [w, x, y, z], state["v"], state["w"])))
    check_same(flown(lagging, speeds), about_origin_of(np.array(out), com))


IN_DRONE_MODELS = """
import sys, tomllib
from drone_models.first_principles import dynamics
import numpy as np
from scipy.spatial.transform import Rotation
told = {k: np.array(v) if isinstance(v, list) else v for k, v in tomllib.load(open("vehicle.toml", "rb")).items()}
speeds, dt = np.repeat(np.load("speeds.npy"), 2, axis=0), float(sys.argv[1]) / 2
pos, turn, vel, rate, out = np.load("start.npy"), Rotation.identity(), np.zeros(3), np.zeros(3), []
for speed in speeds:
    _, _, acc, rate_dot, _ = dynamics(pos, turn.as_quat(), vel, rate, speed * 30.0 / np.pi, **told)
    pos, vel = pos + dt * vel + 0.5 * dt**2 * acc, vel + dt * acc
    turn, rate = turn * Rotation.from_rotvec(dt * (rate + 0.5 * dt * rate_dot)), rate + dt * rate_dot
    out.append(np.concatenate((pos, turn.as_quat()[[3, 0, 1, 2]], vel, rate)))
np.save("flown.npy", out[1::2])
"""
"""A process of its own: the package wants to be imported before scipy."""


def test_drone_models_flies_as_the_plant(identified, tmp_path):
    if importlib.util.find_spec("drone_models") is None:
        pytest.skip("drone-models is not installed")
    more = fitted(identified.vehicle, thrust_curve={"slope": -0.1}, body_drag={"linear_y": 0.1})
    curved = identified.with_effects([*identified.effects, *more])
    speeds, com = commands(curved), curved.wrench_model.body.com_B
    (tmp_path / "vehicle.toml").write_text(written(curved, "drone-models").text)
    np.save(tmp_path / "speeds.npy", speeds)
    np.save(tmp_path / "start.npy", np.add(com, [0.0, 0.0, 1.0]))
    subprocess.run([sys.executable, "-c", IN_DRONE_MODELS, str(DT)], cwd=tmp_path, check=True)
    check_same(flown(curved, speeds), about_origin_of(np.load(tmp_path / "flown.npy"), com))


def about_origin_of(y, com):
    """The states of a body whose place is that of its centre of mass, with that of its origin."""
    return np.concatenate((y[:, :3] - so3.rotate(y[:, 3:7], np.tile(com, (len(y), 1))), y[:, 3:]), axis=1)


def test_a_value_beyond_a_limit_by_less_than_it_is_known_is_the_limit():
    """A quadratic curve is estimated just above 1 as often as below."""
    px4 = AUTOPILOTS["px4"]
    assert px4.nearest("THR_MDL_FAC", 1.0005, 0.001) == 1.0
    assert px4.nearest("THR_MDL_FAC", 0.9995, 0.001) == 0.9995
    assert px4.nearest("THR_MDL_FAC", 1.01, 0.001) == 1.01
    assert px4.refused("THR_MDL_FAC", 1.01)
