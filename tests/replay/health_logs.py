"""Logs of a quadrotor that stands, hovers and lands, as PX4 and ArduPilot write them, with one thing wrong or none."""

from dataclasses import dataclass, field

import numpy as np

from tests.replay.autopilot_logs import autopilots
from wrenchgap.flight.flight import GRAVITY

STAMP = "uint64_t timestamp"
UP, DOWN, END = 4.0, 26.0, 30.0
"""When it takes off, lands, and when the log ends [s]."""
HOVER = 0.5
"""Share of full thrust of each motor in hover, without trims; thrust goes with the square of the command."""
KNOWN = {"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 4, "THR_MDL_FAC": 0.0, "SDLOG_PROFILE": 1, "BAT1_N_CELLS": 4}
KNOWN |= {"BAT1_V_EMPTY": 3.5, "COM_FLIGHT_UUID": 7, "LND_FLIGHT_T_LO": 1000}
PLACES = ((0.2, 0.2, 0.05), (-0.2, -0.2, 0.05), (0.2, -0.2, -0.05), (-0.2, 0.2, -0.05))
"""Forward, right, KM, in PX4's order: front right, back left, front left, back right."""


@dataclass
class Wrong:
    """What a log shows; as it stands, nothing is wrong."""

    thrust: tuple = (1.0, 1.0, 1.0, 1.0)
    """Commanded thrust of each motor, of that in hover."""
    full: float = 0.0
    """Share of the hover in which motor 1 is at full throttle."""
    voltage: tuple = (16.4, 15.8, 15.5)
    """At rest, at the beginning and at the end of the flight [V]."""
    metric: float = 2.0
    clips: int = 0
    ratio: float = 0.1
    faults: int = 0
    dropouts: tuple = ()
    """[ms]"""
    pause: float = 0.0
    """Of the IMU in hover [s]."""
    crash: bool = False
    acro: float | None = None
    """When it is switched to the flight mode Acro [s]."""
    stopped: float | None = None
    """When motor 2 is not commanded any more [s]; the others carry more."""
    ends: float | None = None
    """When the motor commands stop to be logged [s]; all else goes on."""
    rate: float = 100.0
    """Of the motor commands [Hz]."""
    turns: float = 0.0
    """Speed of the rotors [Hz], which shake the vehicle by 3 m/s^2."""
    first_estimator: bool = False
    """Whether the estimator is that of ArduPilot's firmware 3.2."""
    parameters: dict = field(default_factory=dict)
    current: float = -1.0
    """Of the battery [A]; PX4 logs -1 where none is measured."""
    more: object = None
    """What else is logged: called with the log that is written."""


def flying(time):
    return (time > UP) & (time < DOWN)


def micro(time):
    return np.round(1e6 * (5.0 + np.asarray(time))).astype(int)


def imu(wrong, rate=250.0):
    """Times, rates and specific forces in FRD."""
    random = np.random.default_rng(3)
    time = np.arange(0.0, END, 1.0 / rate)
    force = random.normal((0.0, 0.0, -GRAVITY), 0.05, (len(time), 3))
    force[:, 0] += 3.0 * np.sqrt(2.0) * np.sin(2.0 * np.pi * wrong.turns * time) * flying(time)
    if wrong.crash:
        force[(time > 20.0) & (time < 20.04)] += [60.0, 30.0, -70.0]
        force[time > 20.04] += [-GRAVITY, 0.0, GRAVITY]  # on its tail, the motors still running
    keep = (time < 15.0) | (time > 15.0 + wrong.pause)
    return time[keep], random.normal(0.0, 0.01, (keep.sum(), 3)), force[keep]


def commands(wrong):
    """Times and shares of full throttle; while motor 1 is at its end the others carry less."""
    time = np.arange(0.0, END, 1.0 / wrong.rate)
    share = np.where(flying(time)[:, None], HOVER * np.array(wrong.thrust), 0.0)
    share[(time > 10.0) & (time < 10.0 + wrong.full * (DOWN - UP))] = [1.0, *np.full(3, (4.0 * HOVER - 1.0) / 3.0)]
    if wrong.stopped is not None:
        share[(time > wrong.stopped) & flying(time)] = HOVER * np.array([4.0 / 3.0, 0.0, 4.0 / 3.0, 4.0 / 3.0])
    keep = time < (wrong.ends or np.inf)
    return time[keep], np.sqrt(share[keep])


def voltages(wrong, rate=5.0):
    time = np.arange(0.0, END, 1.0 / rate)
    rest, start, end = wrong.voltage
    return time, np.where(flying(time), np.interp(time, (UP, DOWN), (start, end)), rest)


def ulog(path, wrong=None):
    """The flight as PX4 logs it."""
    wrong = wrong or Wrong()
    places = {
        f"CA_ROTOR{k}_{key}": float(value)
        for k, (x, y, km) in enumerate(PLACES)
        for key, value in {"PX": x, "PY": y, "PZ": 0.0, "AX": 0.0, "AY": 0.0, "AZ": -1.0, "KM": km, "CT": 6.5}.items()
    }
    log = autopilots().Ulog({**KNOWN, **places, **wrong.parameters})
    time, rates, force = imu(wrong)
    columns = {"timestamp": micro(time), "gyro_rad": rates, "accelerometer_m_s2": force}
    log.topic("sensor_combined", f"{STAMP};float[3] gyro_rad;float[3] accelerometer_m_s2", columns)
    sent, control = commands(wrong)
    log.topic("actuator_motors", f"{STAMP};float[4] control", {"timestamp": micro(sent), "control": control})
    slow = np.arange(0.0, END, 0.05)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (len(slow), 1))
    log.topic("vehicle_attitude", f"{STAMP};float[4] q", {"timestamp": micro(slow), "q": level})
    height = np.clip(np.minimum(slow - UP, DOWN - slow), 0.0, 1.0)
    rows = dict.fromkeys(("x", "y", "vx", "vy", "vz"), np.zeros(len(slow))) | {"z": -height}
    rows |= {"timestamp": micro(slow)} | dict.fromkeys(("xy_valid", "z_valid"), np.ones(len(slow), bool))
    fields = ";".join([STAMP, *(f"float {name}" for name in ("x", "y", "z", "vx", "vy", "vz"))])
    log.topic("vehicle_local_position", f"{fields};bool xy_valid;bool z_valid", rows)
    at, volt = voltages(wrong)
    rows = {"timestamp": micro(at), "voltage_v": volt, "current_a": np.full(len(at), wrong.current)}
    log.topic("battery_status", f"{STAMP};float voltage_v;float current_a", rows)
    second = np.arange(0.0, END, 1.0)
    clipped = np.column_stack([np.where(second > 12.0, wrong.clips, 0), np.zeros((len(second), 2))])
    rows = {"timestamp": micro(second), "accel_clipping": clipped}
    rows["accel_vibration_metric"] = np.where(flying(second), wrong.metric, 0.1)
    log.topic("vehicle_imu_status", f"{STAMP};uint32_t[3] accel_clipping;float accel_vibration_metric", rows)
    rows = {"timestamp": micro(at), "pos_test_ratio": np.where(flying(at), wrong.ratio, 0.0)}
    rows |= {"hgt_test_ratio": np.full(len(at), 0.05), "filter_fault_flags": np.where(flying(at), wrong.faults, 0)}
    fields = f"{STAMP};float pos_test_ratio;float hgt_test_ratio;uint32_t filter_fault_flags"
    log.topic("estimator_status", fields, rows)
    if wrong.turns:
        speeds = [[int(t), 60.0 * wrong.turns] for t in micro(at)]
        log.nested("esc_status", f"{STAMP};esc_report[1] esc", {"esc_report": "float esc_rpm"}, "Qf", speeds)
    if wrong.acro is not None:
        rows = {"timestamp": micro([0.0, 10.0, wrong.acro]), "nav_state": np.array([2, 2, 10], np.uint8)}
        log.topic("vehicle_status", f"{STAMP};uint8_t nav_state", rows)
    for milliseconds in wrong.dropouts:
        log.dropout(milliseconds)
    if wrong.more is not None:
        wrong.more(log)
    return log.save(path)


def dataflash(path, wrong=None):
    """The same as ArduPilot logs it."""
    wrong = wrong or Wrong()
    known = {"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0, "MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0}
    known |= {"MOT_SPIN_MIN": 0.0, "MOT_SPIN_MAX": 1.0, "MOT_THST_EXPO": 1.0, "LOG_BITMASK": 1024.0}
    known |= {f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 5)} | {"BATT_LOW_VOLT": 14.0}
    log = autopilots().Dataflash({**known, **wrong.parameters})
    log.add("MSG", "QZ", "TimeUS,Message", [0], [b"ArduCopter V4.5.7 (2a3dc4b7)"])
    time, rates, force = imu(wrong)
    names = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
    log.add("IMU", "QBffffff", names, micro(time), np.zeros(len(time)), *rates.T, *force.T, instance="I")
    sent, control = commands(wrong)
    log.add("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4", micro(sent), *(1000.0 + 1000.0 * control).T)
    at, volt = voltages(wrong)
    current = np.full(len(at), wrong.current)
    log.add("BAT", "QBff", "TimeUS,Inst,Volt,Curr", micro(at), np.zeros(len(at)), volt, current, instance="Inst")
    second = np.arange(0.0, END, 1.0)
    shaken, none = np.where(flying(second), wrong.metric, 0.1), np.zeros(len(second))
    clipped = np.where(second > 12.0, wrong.clips, 0)
    names = "TimeUS,IMU,VibeX,VibeY,VibeZ,Clip"
    log.add("VIBE", "QBfffI", names, micro(second), none, shaken, 0.5 * shaken, shaken, clipped, instance="IMU")
    if wrong.acro is not None:
        log.add("MODE", "QBB", "TimeUS,Mode,ModeNum", micro([0.0, 10.0, wrong.acro]), [5, 5, 1], [5, 5, 1])
    ratio, faults = np.where(flying(at), wrong.ratio, 0.0), np.where(flying(at), wrong.faults, 0)
    names = "TimeUS,C,SV,SP,SH,SM,FS,PI"
    small = np.full(len(at), 0.05)
    if wrong.first_estimator:
        names = "TimeUS,SV,SP,SH,SMX,SMY,SMZ,FS"
        log.add("EKF4", "QffffffB", names, micro(at), ratio, *5 * [small], faults)
    else:
        log.add("XKF4", "QBffffHb", names, micro(at), 0 * at, ratio, small, small, small, faults, 0 * at, instance="C")
    if wrong.more is not None:
        wrong.more(log)
    return log.save(path)
