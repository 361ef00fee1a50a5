"""Named effects in the compensation: what Newton, Euler and the step response of a lag say that it must be."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.compensate import Compensator, PhysicsMismatch, Settings
from wrenchgap.flight import so3
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant import model_file
from wrenchgap.plant.mismatch import LinearMismatch
from wrenchgap.plant.mismatch_inputs import extra_inputs
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import Step

TORQUES = ("torque_x", "torque_y", "torque_z")
MODEL = model_file.load("tilt_hexarotor")
WEIGHT = MODEL.vehicle.body.mass * 9.80665
HOVER = np.array([0.0, 0.0, WEIGHT, 0.0, 0.0, 0.0])
OFFSET = np.array([0.004, -0.007, 0.005])
TAU = 0.06


def state(omega=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), quat=(1.0, 0.0, 0.0, 0.0)):
    return State(np.zeros(1), np.zeros((1, 3)), np.array([quat]), np.array([velocity]), np.array([omega]))


REST = state()


def hover(**more):
    """The wrench of hovering, and some more of the named components [N, Nm]."""
    return HOVER + np.array([more.get(axis, 0.0) for axis in AXES])


def physics(effects, outputs=TORQUES, lead=None, model=MODEL):
    """The mismatch of the model with these effects, {name: values}."""
    made = [make_effect(model.vehicle, name, values) for name, values in effects.items()]
    return PhysicsMismatch(model.with_effects(made).wrench_model, outputs, lead)


def alone(mismatch, dt=0.005):
    """A compensator of the physics alone, accurate enough for closed forms."""
    return Compensator(mismatch, Settings(dt=dt, accept=1e-10))


def wrenches(count, seed=0):
    spread = np.array([6.0, 6.0, 5.0, 0.4, 0.4, 0.3])
    return HOVER + spread * np.random.default_rng(seed).uniform(-1, 1, (count, 6))


@pytest.mark.parametrize("omega", [(0.0, 0.0, 0.0), (0.7, -1.2, 2.0)])
def test_displaced_centre_of_mass_makes_the_torque_of_its_lever(omega):
    """Euler about the true centre of mass: -c x F is added, however the body turns."""
    here = physics({"com_offset": OFFSET}).follow(0.005).model_at(state(omega))
    commands = wrenches(20)
    assert here.mean(commands) == pytest.approx(-np.cross(OFFSET, commands[:, :3]), abs=1e-9)


def test_correction_is_the_lever_of_the_force():
    compensator = alone(physics({"com_offset": OFFSET}))
    for wrench in wrenches(5):
        result = compensator.step(wrench, REST)
        assert result.accepted
        assert result.correction[3:] == pytest.approx(np.cross(OFFSET, wrench[:3]), abs=1e-5)
        assert (result.correction[:3] == 0).all()


def test_centrifugal_force_on_the_lever():
    """Spun about z without torque, the accelerometer's place goes round the centre of mass: F_meas = F - m w x (w x c).

    (The nominal processing believes that this place is the centre of mass.)
    """
    omega = np.array([0.0, 0.0, 3.0])
    here = physics({"com_offset": OFFSET}, outputs=AXES).follow(0.005).model_at(state(omega))
    command = HOVER.copy()
    command[3:] = np.cross(OFFSET, HOVER[:3])  # no torque about the centre of mass
    expected = -MODEL.vehicle.body.mass * np.cross(omega, np.cross(omega, OFFSET))
    assert here.mean(command[None])[0, :3] == pytest.approx(expected, abs=1e-9)


def test_jacobian_of_the_lever():
    """d(-c x F)/dF = -hat(c); where forces are not corrected, their columns are left out."""
    full = physics({"com_offset": OFFSET}, outputs=AXES).follow(0.005).model_at(REST)
    lever = np.cross(np.eye(3), OFFSET)  # rows e_j x c; columns of -c x e_j are the same
    assert full.jacobian(HOVER[None])[0, 3:, :3] == pytest.approx(lever.T, abs=1e-7)
    torques = physics({"com_offset": OFFSET}).follow(0.005).model_at(REST)
    assert torques.jacobian(HOVER[None])[0] == pytest.approx(np.zeros((3, 6)), abs=1e-7)


@pytest.mark.parametrize("name", ["rotor_thrust", "servo_lag", "coaxial_loss"])
def test_jacobian_is_the_derivative_of_the_mean(name):
    count = len(make_effect(MODEL.vehicle, name, {}).theta)
    values = 0.06 + 0.02 * np.arange(count)
    follower = physics({name: values}, AXES, 0.04).follow(0.005)
    follower.model_at(REST)
    follower.record(wrenches(1, seed=3)[0])
    here, command = follower.model_at(REST), wrenches(1, seed=4)
    slope = here.jacobian(command)[0]
    for axis in range(6):
        step = np.zeros(6)
        step[axis] = 2e-3 * WEIGHT
        difference = (here.mean(command + step) - here.mean(command - step))[0] / (2 * step[axis])
        assert slope[:, axis] == pytest.approx(difference, abs=2e-3)


def test_many_commands_are_single_commands():
    """Also where their tilt angles lie on both sides of the half turn that an arm may wrap at."""
    follower = physics({"servo_lag": [TAU]}, AXES, 0.04).follow(0.005)
    follower.model_at(REST)
    follower.record(HOVER)
    here = follower.model_at(REST)
    commands = np.vstack((wrenches(4), [[3.0, 1.0, -WEIGHT, 0, 0, 0.2], [-3.0, -1.0, -WEIGHT, 0, 0, -0.2]]))
    for function in (here.mean, here.jacobian):
        singles = np.concatenate([function(row[None]) for row in commands])
        assert function(commands) == pytest.approx(singles, abs=1e-12)


@pytest.mark.parametrize("name", ["imu_misalignment", "imu_lever_arm"])
def test_what_the_sensors_do_is_not_corrected(name):
    """A skewed IMU reads another wrench; the vehicle makes the commanded one."""
    skewed = physics({name: [0.03, -0.02, 0.04]}, AXES)
    assert skewed.follow(0.005).model_at(state(omega=(1.0, 0.5, -2.0))).mean(wrenches(5)) == pytest.approx(
        0.0, abs=1e-9
    )
    assert alone(skewed).step(wrenches(1)[0], REST).correction == pytest.approx(np.zeros(6), abs=1e-9)


def test_drag_depends_on_the_state():
    """Drag -D v on the hull at 5 m/s along body x, whatever the heading."""
    drag = physics({"body_drag": {"linear_x": 0.3}}, AXES)
    for quat in (so3.exp(np.zeros(3)), so3.exp(np.array([0.0, 0.0, 1.2]))):
        moving = state(velocity=so3.rotate(quat, np.array([5.0, 0.0, 0.0])), quat=quat)
        correction = alone(drag).step(HOVER, moving).correction
        assert correction == pytest.approx([1.5, 0, 0, 0, 0, 0], abs=1e-4)
    assert alone(drag).step(HOVER, REST).correction == pytest.approx(np.zeros(6), abs=1e-9)


def test_vehicle_without_rotors():
    """Where nobody knows the rotors, the wrench itself is what the nominal vehicle makes."""
    hull = replace(MODEL, vehicle=replace(MODEL.vehicle, arms=None, rotors=None))
    offset = physics({"com_offset": OFFSET}, model=hull)
    wrench = wrenches(1, seed=8)[0]
    assert alone(offset).step(wrench, REST).correction[3:] == pytest.approx(np.cross(OFFSET, wrench[:3]), abs=1e-5)
    late = physics({"command_delay": [0.02]}, lead=0.05, model=hull)
    assert alone(late).step(wrench, REST).correction == pytest.approx(np.zeros(6), abs=1e-9)


def after_hover(mismatch, wrench, dt):
    """The step that asks for `wrench` after a while of hovering."""
    compensator = alone(mismatch, dt)
    for _ in range(40):
        compensator.step(HOVER, REST)
    return compensator.step(wrench, REST)


def test_without_lead_a_lag_is_no_mismatch():
    """A command that is held is reached in the end."""
    lagging = physics({"servo_lag": [TAU], "motor_lag": [0.02], "command_delay": [0.03]}, AXES)
    for wrench in wrenches(3):
        assert after_hover(lagging, wrench, 0.005).correction == pytest.approx(np.zeros(6), abs=1e-6)


@pytest.mark.parametrize("dt", [0.002, 0.005, 0.01])
@pytest.mark.parametrize("lead", [0.01, 0.03, 0.08])
def test_lead_pushes_ahead_of_a_servo_lag(lead, dt):
    """Torque about z is made by tilting the arms; a step of u gets to u (1 - exp(-h / tau)) within h."""
    yaw = hover(torque_z=0.01)
    result = after_hover(physics({"servo_lag": [TAU]}, TORQUES, lead), yaw, dt)
    assert result.accepted
    assert result.wrench_cmd[5] / 0.01 == pytest.approx(1.0 / (1.0 - np.exp(-lead / TAU)), rel=0.03)


def test_lead_pushes_ahead_of_a_motor_lag():
    """Thrust goes with the square of speed; for a small step that is a factor of two on both sides."""
    lift = hover(force_z=0.05)
    result = after_hover(physics({"motor_lag": [0.03]}, ("force_z",), 0.02), lift, 0.005)
    gain = (result.wrench_cmd[2] - WEIGHT) / 0.05
    assert gain == pytest.approx(1.0 / (1.0 - np.exp(-0.02 / 0.03)), rel=0.02)


def test_lead_must_outlast_the_delay():
    """Of a lead h, a delay d leaves h - d for the lag; a lead shorter than d is too short for any command to matter."""
    yaw = hover(torque_z=0.01)
    effects = {"command_delay": [0.03], "servo_lag": [TAU]}
    led = after_hover(physics(effects, TORQUES, 0.07), yaw, 0.005)
    assert led.wrench_cmd[5] / 0.01 == pytest.approx(1.0 / (1.0 - np.exp(-(0.07 - 0.03) / TAU)), rel=0.03)
    pure = after_hover(physics({"command_delay": [0.03]}, TORQUES, 0.05), yaw, 0.005)
    assert pure.correction == pytest.approx(np.zeros(6), abs=1e-6)
    late = after_hover(physics({"command_delay": [0.03]}, TORQUES, 0.01), hover(torque_z=0.2), 0.005)
    assert not late.accepted
    assert late.correction == pytest.approx(np.zeros(6), abs=1e-6)


def test_led_command_arrives_when_it_should():
    """Flown by the plant for the lead h, the corrected command has brought the torque that was asked for."""
    lead, dt, fine = 0.04, 0.005, 0.0005
    model = MODEL.with_effects([make_effect(MODEL.vehicle, "servo_lag", [TAU])]).wrench_model
    mismatch = PhysicsMismatch(model, TORQUES, lead)
    yaw = hover(torque_x=0.2, torque_z=0.15)
    command = after_hover(mismatch, yaw, dt).wrench_cmd
    here = mismatch.follow(dt).model_at(REST)
    _, memory = model.command(here.allocated(HOVER[None]), REST, fine)
    held = here.allocated(command[None]).take(np.zeros(round(lead / fine), dtype=np.intp))
    made = model.wrench(model.command(held, REST, fine, memory)[0], REST)
    assert made[-1, 3:] == pytest.approx(yaw[3:], abs=2e-3)
    assert abs(made[len(made) // 3, 5] - yaw[5]) > 0.03  # not earlier


def test_reset_forgets_where_the_actuators_are():
    compensator = alone(physics({"servo_lag": [TAU]}, TORQUES, 0.03))
    first = [compensator.step(wrench, REST).wrench_cmd for wrench in wrenches(4)]
    compensator.reset()
    again = [compensator.step(wrench, REST).wrench_cmd for wrench in wrenches(4)]
    assert np.array_equal(first, again)


def test_lead_takes_the_lag_out_of_the_loop():
    """How far, in mrad rms, a 15 deg yaw step on the slow vehicle is from that of one without lag."""
    control = replace(MODEL.controller, integral=0.0, rate_hz=100.0)
    nominal = replace(MODEL, controller=control, sensors=MODEL.sensors.silent)
    slow = nominal.with_effects([make_effect(MODEL.vehicle, "servo_lag", [TAU])])
    lead = alone(physics({"servo_lag": [TAU]}, TORQUES, 0.03), 0.01)

    def yaw(truth, compensator=None):
        path, rng = Step(1.5, np.radians(15.0), (0.0, 0.0, 1.0), 0.1), np.random.default_rng(0)
        return so3.log(simulate(truth, nominal, path, rng=rng, compensator=compensator).odometry.quat_EB)[:, 2]

    late = np.array([yaw(slow), yaw(slow, lead)]) - yaw(nominal)
    plain, led = 1e3 * np.sqrt(np.mean(late**2, axis=1))
    assert plain > 5.0
    assert led < 0.5 * plain


def process(size=0.1, inputs=6):
    """A process that has seen a constant mismatch of `size` [Nm] about hover, and knows how far that is."""
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, (120, inputs))
    made = GaussianProcess(
        outputs=TORQUES,
        input_mean=np.concatenate((HOVER, np.zeros(inputs - 6))),
        input_scale=np.concatenate(([8.0, 8.0, 5.0, 0.5, 0.5, 0.5], np.ones(inputs - 6))),
        output_scale=np.full(3, size),
        mean_coefficients=np.zeros((3, 1 + inputs)),
        inputs=seen,
        residuals=np.ones((120, 3)),
        lengthscales=np.full((3, inputs), 3.0),
        signal_variance=np.ones(3),
        noise_variance=np.full(3, 1e-4),
        sigma_training=np.ones(3),
        mismatch_max=np.full(3, size),
    )
    return replace(made, sigma_training=np.percentile(made.std(made.input_mean + seen * made.input_scale), 99, axis=0))


def test_physics_and_process_add_up():
    compensator = Compensator(process(), Settings(accept=1e-10), physics=physics({"com_offset": OFFSET}))
    result = compensator.step(HOVER, REST)
    assert result.correction[3:] == pytest.approx(np.cross(OFFSET, HOVER[:3]) - 0.1, abs=2e-3)
    left = compensator.expected(result.wrench_cmd) + result.correction[3:]
    assert left == pytest.approx(np.zeros(3), abs=1e-3)


def test_far_from_the_data_the_physics_stays():
    """The filter lets go of the guess alone, at its own rate; the lever arm is no guess."""
    compensator = Compensator(process(), Settings(dt=0.01, kappa=1e4), physics=physics({"com_offset": OFFSET}))
    compensator.step(HOVER, REST)
    far = hover(force_z=25.0)
    lever = np.cross(OFFSET, far[:3])
    learnt = -0.1 * np.exp(-0.01 * np.arange(1, 61) / 0.15)
    for expected in learnt:
        result = compensator.step(far, REST)
        assert result.beta > 0.99
        assert result.correction[3:] == pytest.approx(lever + expected, abs=3e-3)
    without = Compensator(process(), Settings(dt=0.01, kappa=1e4))
    assert np.abs(without.step(far).correction).max() < 1e-3 < 0.05 < np.abs(lever).max()


def test_bounds_lie_around_the_physics():
    """A process that saw little may correct little; a large lever arm is corrected all the same."""
    small = process(0.003)
    compensator = Compensator(small, Settings(filter_uncertain=False), physics=physics({"com_offset": 4 * OFFSET}))
    lever = np.cross(4 * OFFSET, HOVER[:3])
    assert np.abs(lever).max() > 100 * 3 * 0.003
    assert compensator.step(HOVER, REST).correction[3:] == pytest.approx(lever - 0.003, abs=1e-3)
    loud = replace(small, output_scale=np.full(3, 0.5))  # claims 0.5 Nm, having seen 0.003
    claimed = Compensator(loud, Settings(filter_uncertain=False), physics=physics({"com_offset": 4 * OFFSET}))
    assert claimed.step(HOVER, REST).optimum[3:] == pytest.approx(lever - 3 * 0.003, abs=1e-4)


def test_process_with_the_past_as_input_is_told_the_past():
    """Step by step the compensator gives the process what `extra_inputs` gives for the whole flight."""
    seeing = replace(
        process(inputs=12),
        residuals=np.sin(np.arange(360.0)).reshape(120, 3),
        settings=replace(process().settings, inputs=("past",)),
    )
    dt, sent = 0.01, HOVER + np.cumsum(np.random.default_rng(2).normal(size=(8, 6)), axis=0) * 0.1
    follower, found = seeing.follow(dt), []
    for command in sent:
        found.append(follower.model_at(REST).mean(HOVER[None])[0])
        follower.record(command)
    before = np.vstack((sent[:1], sent[:-1]))
    past, _ = extra_inputs(("past",), before, REST.take(np.zeros(8, dtype=np.intp)), dt)
    expected = seeing.mean(np.hstack((np.tile(HOVER, (8, 1)), past)))
    assert np.array(found) == pytest.approx(expected, abs=1e-12)
    assert np.ptp(expected, axis=0).min() > 1e-3


@pytest.mark.parametrize(
    "compensator",
    [
        lambda: Compensator(physics({"com_offset": OFFSET})),
        lambda: Compensator(process(), physics=physics({"com_offset": OFFSET})),
        lambda: Compensator(replace(process(inputs=9), settings=replace(process().settings, inputs=("rates",)))),
    ],
    ids=["physics", "process on physics", "process with inputs"],
)
def test_missing_state_gets_one_line(compensator):
    with pytest.raises(UsageError, match=r"step\(wrench_des, state\)") as caught:
        compensator().step(HOVER)
    assert "\n" not in str(caught.value)
    assert compensator().needs_state


def test_models_of_the_command_alone_need_no_state():
    line = LinearMismatch(TORQUES, np.zeros(3), np.zeros((3, 6)), np.ones(3))
    assert not Compensator(line).needs_state
    assert not Compensator(process()).needs_state


def test_misuse_gets_one_line():
    moved = {"com_offset": OFFSET}
    for words, attempt in (
        ("they must agree", lambda: Compensator(process(), physics=physics(moved, AXES))),
        ("unknown output 'lift'", lambda: physics(moved, ("lift",))),
        ("before the first step", lambda: Compensator(physics(moved)).expected(HOVER)),
        *[
            ("a positive number", lambda h=h: physics({"servo_lag": [TAU]}, lead=h))
            for h in (0.0, -0.1, np.nan, np.inf)
        ],
    ):
        with pytest.raises((UsageError, ModelError), match=words):
            attempt()


@pytest.mark.parametrize(
    "effects", [{"thrust_scale": [-1.5]}, {"thrust_scale": [-0.9]}, {"rotor_thrust": [-0.95] * 12}]
)
def test_effects_with_which_nothing_flies_are_no_compensation(effects):
    """A hover command that lifts (1 + s) of the weight: nothing, less than nothing, or a twentieth."""
    with pytest.raises(UsageError, match="could not fly"):
        physics(effects)


def test_one_dead_rotor_of_twelve_is_a_compensation_still():
    assert np.isfinite(alone(physics({"rotor_thrust": [-1.0] + [0.0] * 11})).step(HOVER, REST).wrench_cmd).all()
