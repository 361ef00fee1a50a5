"""PX4's controller out of a log whose torques are made by hand, of motion in closed form, by known gains."""

import numpy as np
import pytest

from wrenchgap.flight.formats.px4_rate_loop import logged_loop

GAINS = {"K": 1.2, "P": 0.1, "I": 0.3, "D": 0.004}
ANGLE, TURN = (6.0, 5.0, 2.0), 0.4
TILT = np.radians([8.0, -5.0, 3.0])
MOTORS = np.array([[-0.7, 0.7, 0.9], [0.7, -0.7, 0.9], [0.7, 0.7, -0.9], [-0.7, -0.7, -0.9]])
STAMPS = "uint64_t timestamp;uint64_t timestamp_sample"


def parameters(**other):
    axes = ("ROLL", "PITCH", "YAW")
    rates = {f"MC_{axis}RATE_{key}": value for axis in axes for key, value in GAINS.items()}
    return rates | {f"MC_{a}_P": k for a, k in zip(axes, ANGLE, strict=True)} | {"IMU_GYRO_RATEMAX": 800} | other


def written(ulog, path, cutoff_hz=0.0, **other):
    """Level, heading north, the setpoint turned by `TILT` about one axis after the other and turning about down.

    The rates swing at 1.5, 2 and 2.5 Hz, the setpoint of rates stands still, so that the integral is known.
    """
    log = ulog(parameters(**({"MC_YAW_TQ_CUTOFF": cutoff_hz} if cutoff_hz else {}) | other))
    time = np.arange(0.0, 20.0, 0.02)
    w = 2.0 * np.pi * np.array([1.5, 2.0, 2.5])
    phase = np.outer(time, w)
    rates, turning = 0.3 * np.sin(phase), 0.3 * w * np.cos(phase)
    which = (time // 2.0).astype(int) % 3  # the setpoint is tilted about one axis at a time
    error = TILT * np.eye(3)[which]
    setpoint = np.array(ANGLE) * 2.0 * np.sin(error / 2.0) + [0.0, 0.0, TURN]
    steps = np.cumsum(setpoint, axis=0) * 0.02
    integral = GAINS["I"] * (steps - 0.3 * (1.0 - np.cos(phase)) / w)
    K = GAINS["K"]
    torque = K * (GAINS["P"] * (setpoint - rates) + integral - GAINS["D"] * turning)
    if cutoff_hz:
        for n in range(1, len(time)):  # a first-order low-pass of a value that is held over a period
            torque[n, 2] += (torque[n - 1, 2] - torque[n, 2]) * np.exp(-2.0 * np.pi * cutoff_hz * 0.02)
    read = np.round(1e6 * (3.0 + time)).astype(int)
    sampled, sent = {"timestamp": read + 40, "timestamp_sample": read}, {"timestamp": read - 40}
    log.topic(
        "vehicle_angular_velocity",
        f"{STAMPS};float[3] xyz;float[3] xyz_derivative",
        sampled | {"xyz": rates, "xyz_derivative": turning},
    )
    log.topic("vehicle_torque_setpoint", f"{STAMPS};float[3] xyz", sampled | {"xyz": torque})
    thrust = np.tile([0.0, 0.0, -0.5], (len(time), 1))
    log.topic("vehicle_thrust_setpoint", f"{STAMPS};float[3] xyz", sampled | {"xyz": thrust})
    control = 0.5 + 0.1 * torque @ MOTORS.T
    log.topic("actuator_motors", f"{STAMPS};float[4] control", sampled | {"control": control})
    rows = sent | dict(zip(("roll", "pitch", "yaw"), setpoint.T, strict=True)) | {"thrust_body": thrust}
    log.topic(
        "vehicle_rates_setpoint", "uint64_t timestamp;float roll;float pitch;float yaw;float[3] thrust_body", rows
    )
    names = ("rollspeed_integ", "pitchspeed_integ", "yawspeed_integ")
    fields = "uint64_t timestamp;" + ";".join(f"float {name}" for name in names)
    log.topic("rate_ctrl_status", fields, {"timestamp": read + 40} | dict(zip(names, K * integral.T, strict=True)))
    half = error / 2.0
    wanted = np.column_stack((np.cos(half.sum(axis=1)), np.sin(half)))
    level = np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1))
    log.topic("vehicle_attitude", "uint64_t timestamp;float[4] q", sent | {"q": level})
    turn = np.full(len(time), TURN)
    fields = "uint64_t timestamp;float yaw_sp_move_rate;float[4] q_d"
    log.topic("vehicle_attitude_setpoint", fields, sent | {"q_d": wanted, "yaw_sp_move_rate": turn})
    return log.save(path)


def test_the_gains_make_the_torques_and_the_rates_that_they_made(autopilots, tmp_path):
    found = logged_loop(written(autopilots.Ulog, tmp_path / "a.ulg"))
    for asked, law in (found.torques, found.rates):
        np.testing.assert_allclose(law, asked, atol=1e-5)
        assert (np.ptp(asked, axis=0) > 0.1).all()
    np.testing.assert_allclose(found.gains.derivative, GAINS["K"] * GAINS["D"])
    assert found.gains.period == pytest.approx(1.0 / 800.0)
    assert found.dt == pytest.approx(0.02)


def test_torque_about_yaw_is_behind_its_filter(autopilots, tmp_path):
    asked, law = logged_loop(written(autopilots.Ulog, tmp_path / "a.ulg", cutoff_hz=2.0)).torques
    np.testing.assert_allclose(law[100:], asked[100:], atol=1e-4)


def test_motors_are_those_of_a_torque_to_the_left_and_up(autopilots, tmp_path):
    """To the right and down are PX4's; a positive roll is the same in both."""
    found = logged_loop(written(autopilots.Ulog, tmp_path / "a.ulg"))
    np.testing.assert_allclose(found.motors, 0.1 * MOTORS * [1.0, -1.0, -1.0], atol=1e-5)
    np.testing.assert_allclose(found.hover, 0.5 + 0.1 * MOTORS @ found.torques[0].mean(axis=0), atol=1e-5)


def test_other_gains_make_other_torques(autopilots, tmp_path):
    asked, law = logged_loop(written(autopilots.Ulog, tmp_path / "a.ulg", MC_ROLLRATE_D=0.02, MC_PITCH_P=8.0)).torques
    assert np.abs(law - asked)[:, 0].max() > 0.01
    np.testing.assert_allclose(law[:, 1:], asked[:, 1:], atol=1e-5)


def test_of_other_files_and_parameters_nothing_is_said(autopilots, tmp_path):
    other = tmp_path / "a.csv"
    other.write_text("time,x\n0,1\n")
    assert logged_loop(other) is None
    assert logged_loop(tmp_path) is None
    assert (
        logged_loop(
            autopilots.Ulog({"MC_ROLL_P": 6.5})
            .topic("x", "uint64_t timestamp", {"timestamp": [1, 2]})
            .save(tmp_path / "b.ulg")
        )
        is None
    )
