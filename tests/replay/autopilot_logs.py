"""A vehicle with PX4's and ArduPilot's parameters, and its flights as these autopilots log them."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np

import wrenchgap as wg
from wrenchgap.flight import so3
from wrenchgap.plant import model_file

ROOT = Path(__file__).resolve().parents[2]
FULL, FACTOR = 9.0, 0.6
"""Thrust of one rotor at full throttle [N] and the shape of its curve, as the vehicle has them."""
PLACES = ((0.17, 0.2, 0.02), (-0.17, -0.2, 0.02), (0.17, -0.2, -0.02), (-0.17, 0.2, -0.02))
"""Forward, right, KM of the rotors, in PX4's order."""
MASS, INERTIA = 1.52, (0.02, 0.016, 0.032)
STAMP = "uint64_t timestamp"
HIDDEN = {"x": 0.006, "y": 0.004}
"""Where the centre of mass is, ahead and to the left [m], of which no file knows."""


def autopilots():
    """The tests' writer of ULog files."""
    path = ROOT / "tests" / "flight" / "formats" / "conftest.py"
    spec = importlib.util.spec_from_file_location("autopilots_conftest", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def true_vehicle():
    """The vehicle that flies, as a model file: PX4's numbers with left for right and up for down."""
    arms = "".join(
        f"[[vehicle.arms]]\nposition = [{x}, {-y}, 0.0]\nrotors = [{{ spin = {turn}, kappa = 0.02 }}]\n"
        for (x, y, _), turn in zip(PLACES, (1, 1, -1, -1), strict=True)
    )
    return model_file.loads(
        f'schema = 1\n[vehicle]\nname = "true"\nmass = {MASS}\ninertia = {list(INERTIA)}\n[vehicle.arm]\n'
        f"tilts = false\n[vehicle.rotor]\nc_f = 9.0e-6\nradius = 0.12\nspeed_max = 1000.0\n{arms}"
    )


def flight(seed):
    """A flight of it with the hidden centre of mass."""
    hidden = "com_offset=" + ",".join(f"{axis}:{value}" for axis, value in HIDDEN.items())
    return wg.simulate(true_vehicle(), "multi_axis", seed=seed, duration=12.0, excitation=0.5, hide=[hidden])


def parameters():
    found = {"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 4, "THR_MDL_FAC": 0.0, "MPC_THR_HOVER": 0.5}
    for number, (x, y, km) in enumerate(PLACES):
        row = {"PX": x, "PY": y, "PZ": 0.0, "AX": 0.0, "AY": 0.0, "AZ": -1.0, "KM": km, "CT": 6.5}
        found |= {f"CA_ROTOR{number}_{key}": float(value) for key, value in row.items()}
    return found


def flipped(vectors):
    """Forward, left, up to forward, right, down, and back."""
    return vectors * [1.0, -1.0, -1.0]


def every(flown, rate):
    """The same flight with rotor commands at `rate` [Hz], as a logger keeps them."""
    sent = flown.actuators
    few = slice(None, None, round(1.0 / (rate * np.median(np.diff(sent.time)))))
    return replace(
        flown, actuators=replace(sent, time=sent.time[few], rotor_speed=sent.rotor_speed[few], tilt=sent.tilt[few])
    )


def throttle(speed):
    """The share of full throttle (N, 4) that makes these rotor speeds."""
    share = 9.0e-6 * speed**2 / FULL
    return (FACTOR - 1 + np.sqrt((1 - FACTOR) ** 2 + 4 * FACTOR * share)) / (2 * FACTOR)


ALLOCATION = np.array(
    [[-0.7, 0.7, 1.0, -1.0], [0.7, -0.7, 1.0, -1.0], [0.7, 0.7, -1.0, -1.0], [-0.7, -0.7, -1.0, -1.0]]
)
"""PX4's motor commands by setpoints of roll, pitch, yaw and thrust."""


GAINS = {"P": 0.15, "I": 0.0, "D": 0.003, "K": 1.0}
ANGLE = 6.5


def gains(**other):
    """PX4's parameters of the rate loop: `GAINS` and `ANGLE` about every axis, but for others."""
    axes = ("ROLL", "PITCH", "YAW")
    return {f"MC_{a}RATE_{k}": x for a in axes for k, x in GAINS.items()} | {f"MC_{a}_P": ANGLE for a in axes} | other


def rate_loop(log, commanded, flown, torque):
    """What PX4 would have logged, had `GAINS` made these torques (N, 3), by the inverse of the law."""
    time, step = flown.actuators.time, np.median(np.diff(flown.actuators.time))
    omega = flipped(np.stack([np.interp(time, flown.imu.time, w) for w in flown.imu.omega_B.T], axis=1))
    turning = np.gradient(omega, step, axis=0)
    asked = (torque + GAINS["D"] * turning) / GAINS["P"] + omega
    field = "float[3] xyz;float[3] xyz_derivative"
    commanded("vehicle_angular_velocity", field, time, {"xyz": omega, "xyz_derivative": turning})
    rates = dict(zip(("roll", "pitch", "yaw"), asked.T, strict=True))
    down = np.tile([0.0, 0.0, -0.5], (len(time), 1))
    commanded(
        "vehicle_rates_setpoint",
        "float roll;float pitch;float yaw;float[3] thrust_body",
        time,
        rates | {"thrust_body": down},
    )
    names = ("rollspeed_integ", "pitchspeed_integ", "yawspeed_integ")
    commanded(
        "rate_ctrl_status", ";".join(f"float {n}" for n in names), time, dict.fromkeys(names, np.zeros(len(time)))
    )
    quat = so3.interpolate(time, flown.odometry.time, flown.odometry.quat_EB)
    small = flipped(asked) / ANGLE / 2.0
    error = np.column_stack((np.sqrt(np.maximum(1.0 - (small**2).sum(axis=1), 0.0)), small))
    commanded("vehicle_attitude_setpoint", "float[4] q_d", time, {"q_d": to_ned(so3.multiply(quat, error))})


def to_ned(quat_EB):
    """From FLU to ENU to FRD to NED: its own inverse."""
    w, x, y, z = quat_EB.T
    return np.stack((w + z, x + y, x - y, w - z), axis=1) / np.sqrt(2.0)


def write_ulog(flown, path, setpoints_of=None, controller=None):
    """The flight as PX4 logs it: FRD and NED, microseconds, throttles; with the setpoints of another form of it.

    With the `controller`'s parameters (`gains`) as flown by `GAINS`.
    """
    log = autopilots().Ulog(parameters() | (controller or {}))
    imu, sent, odometry = flown.imu, flown.actuators, flown.odometry
    u = throttle(sent.rotor_speed)

    def micro(time):
        return np.round(1e6 * (5.0 + time)).astype(int)

    middle = np.full(len(imu.time), round(1e6 * float(np.median(np.diff(imu.time)))))
    columns = {"timestamp": micro(imu.time) + middle // 2, "gyro_rad": flipped(imu.omega_B)}
    columns |= {"accelerometer_m_s2": flipped(imu.specific_force_B), "gyro_integral_dt": middle}
    columns |= {"accelerometer_timestamp_relative": np.zeros(len(imu.time), int)}
    fields = f"{STAMP};float[3] gyro_rad;uint32_t gyro_integral_dt;int32_t accelerometer_timestamp_relative"
    log.topic("sensor_combined", f"{fields};float[3] accelerometer_m_s2", columns)
    stamps = f"{STAMP};uint64_t timestamp_sample"

    def commanded(name, field, time, values):
        log.topic(name, f"{stamps};{field}", {"timestamp": micro(time), "timestamp_sample": micro(time)} | values)

    commanded("actuator_motors", "float[4] control", sent.time, {"control": u})
    if setpoints_of is not None:
        asked = setpoints_of.actuators
        setpoint = throttle(asked.rotor_speed) @ np.linalg.inv(ALLOCATION).T
        thrust = setpoint[:, [3]] * [0.0, 0.0, 1.0]
        commanded("vehicle_torque_setpoint", "float[3] xyz", asked.time, {"xyz": setpoint[:, :3]})
        commanded("vehicle_thrust_setpoint", "float[3] xyz", asked.time, {"xyz": thrust})
        if controller is not None:
            rate_loop(log, commanded, setpoints_of, setpoint[:, :3])
    q = to_ned(odometry.quat_EB)
    log.topic("vehicle_attitude", f"{STAMP};float[4] q", {"timestamp": micro(odometry.time), "q": q})
    ned, velocity = (v[:, [1, 0, 2]] * [1.0, 1.0, -1.0] for v in (odometry.position_E, odometry.velocity_E))
    rows = dict(zip(("x", "y", "z", "vx", "vy", "vz"), np.hstack((ned, velocity)).T, strict=True))
    rows |= {"timestamp": micro(odometry.time)} | dict.fromkeys(("xy_valid", "z_valid"), np.ones(len(ned), bool))
    fields = f"{STAMP};float x;float y;float z;float vx;float vy;float vz;bool xy_valid;bool z_valid"
    log.topic("vehicle_local_position", fields, rows)
    return log.save(path)


MIXER = 0.5 * np.array([[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, -1.0, -1.0]])
"""ArduPilot's shares of full thrust by roll, pitch and yaw, in the order of `PLACES`."""


def ardupilot_gains(**other):
    """Its parameters of a proportional loop, about every axis, but for others."""
    axes = ("RLL", "PIT", "YAW")
    found = {f"ATC_RAT_{a}_{k}": x for a in axes for k, x in (("P", 0.15), ("I", 0.0), ("D", 0.0))}
    return found | {f"ATC_ANG_{a}_P": ANGLE for a in axes} | other


def ardupilot_loop(log, flown):
    """What ArduPilot would have logged, had `ardupilot_gains` made these torques, by the inverse of its law: setpoints
    of the attitude whose rates and error are what was asked for.
    """
    time, dt = flown.actuators.time, float(np.median(np.diff(flown.actuators.time)))
    torque = (9.0e-6 * flown.actuators.rotor_speed**2 / FULL) @ np.linalg.pinv(MIXER.T)
    omega = flipped(np.stack([np.interp(time, flown.imu.time, w) for w in flown.imu.omega_B.T], axis=1))
    asked = torque / 0.15 + omega
    quat = to_ned(so3.interpolate(time, flown.odometry.time, flown.odometry.quat_EB))
    wanted = [quat[0]]
    for q, rates in zip(quat[:-1], asked[:-1], strict=True):
        error = so3.multiply(so3.conjugate(q), wanted[-1])
        own = so3.rotate_inverse(error, rates - ANGLE * 2.0 * np.sign(error[0]) * error[1:])
        wanted.append(so3.multiply(wanted[-1], so3.exp(dt * own)))
    stamps = np.round(1e6 * (30.0 + time))
    columns = [
        np.degrees(x) if k < 2 else x for j in range(3) for k, x in enumerate((asked[:, j], omega[:, j], torque[:, j]))
    ]
    names = "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut"
    log.add("RATE", "Qffffffffffff", names, stamps, *columns, 0.0 * time, 0.0 * time, 0.0 * time + 0.4)
    angles = [np.degrees(x) for pair in zip(euler(np.array(wanted)), euler(quat), strict=True) for x in pair]
    log.add("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw", stamps, *angles)


def euler(quat):
    """Roll, pitch and yaw [rad], turned in the order yaw, pitch, roll."""
    w, x, y, z = quat.T
    roll, yaw = (
        np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )
    return roll, np.arcsin(2 * (w * y - z * x)), yaw


def write_dataflash(flown, path, controller=None):
    """The flight as ArduPilot logs it: FRD, pulses in the order of the frame, and a hover throttle that is wrong.

    With the `controller`'s parameters (`ardupilot_gains`) as flown by them.
    """
    known = {"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0, "MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0}
    known |= {"MOT_SPIN_MIN": 0.0, "MOT_SPIN_MAX": 1.0, "MOT_THST_EXPO": FACTOR, "MOT_THST_HOVER": 0.2}
    known |= {f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 5)}
    log, imu, sent = autopilots().Dataflash(known | (controller or {})), flown.imu, flown.actuators
    columns = (*flipped(imu.omega_B).T, *flipped(imu.specific_force_B).T)
    stamps = np.round(1e6 * (30.0 + imu.time))
    names = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
    log.add("IMU", "QBffffff", names, stamps, np.zeros(len(stamps)), *columns, instance="I")
    pulses = np.round(1000.0 + 1000.0 * throttle(sent.rotor_speed))
    log.add("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4", np.round(1e6 * (30.0 + sent.time)), *pulses.T)
    if controller is not None:
        ardupilot_loop(log, flown)
    return log.save(path)
