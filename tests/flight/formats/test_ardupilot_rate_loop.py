"""ArduPilot's controller out of a log whose torques are made sample by sample, in the order of its firmware."""

import numpy as np
import pytest

from wrenchgap.flight.formats.ardupilot_rate_loop import gains_of, logged_loop
from wrenchgap.plant.stability import FREQUENCIES, rate_loop

GAINS = {"P": 0.135, "I": 0.2, "D": 0.0036, "FF": 0.01, "FLTT": 20.0, "FLTD": 15.0}
YAW = {"P": 0.4, "I": 0.05, "D": 0.0, "FF": 0.0, "FLTT": 20.0, "FLTE": 2.5, "FLTD": 0.0}
RATE = 400.0
AXES = ("RLL", "PIT", "YAW")


def parameters(**other):
    found = {f"ATC_RAT_{a}_{k}": x for a in AXES for k, x in (YAW if a == "YAW" else GAINS).items()}
    return found | {f"ATC_ANG_{a}_P": 4.5 for a in AXES} | {"SCHED_LOOP_RATE": RATE, "INS_GYRO_FILTER": 40.0} | other


def flown(time, gains):
    """Rates asked for and measured [rad/s] of one axis, and the torque that AC_PID makes of them, step by step."""
    asked = 0.5 * np.sin(2.0 * np.pi * 0.7 * time) + 0.2 * np.sign(np.sin(time))
    measured = 0.4 * np.sin(2.0 * np.pi * 0.7 * time - 0.3) + 0.05 * np.sin(2.0 * np.pi * 6.0 * time)
    target, error, derivative, integral, torque, dt = asked[0], asked[0] - measured[0], 0.0, 0.0, [], 1.0 / RATE

    def towards(value, wanted, name):
        cutoff = gains.get(name, 0.0)
        return wanted if cutoff <= 0.0 else value + (wanted - value) * dt / (dt + 1.0 / (2.0 * np.pi * cutoff))

    for want, is_ in zip(asked, measured, strict=True):
        before, target = error, towards(target, want, "FLTT")
        error = towards(error, target - is_, "FLTE")
        derivative = towards(derivative, (error - before) / dt, "FLTD")
        integral += gains["I"] * error * dt
        torque.append(gains["P"] * error + integral + gains["D"] * derivative + gains["FF"] * target)
    return asked, measured, np.array(torque)


def written(dataflash, path, every=1, **other):
    """Level, heading north, on the ground for a second; the setpoint of attitude swings in roll by 3 deg at 0.5 Hz."""
    log = dataflash(parameters(**other))
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    axes = [flown(time, YAW if axis == "YAW" else GAINS) for axis in AXES]
    stamps = np.round(1e6 * (30.0 + time))
    thrust = np.full(len(time), 0.4)
    columns = [np.degrees(x) if k < 2 else x for one in axes for k, x in enumerate(one)]
    rows = [stamps, *columns, 0.0 * time, 0.0 * time, thrust]
    names = "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut"
    log.add("RATE", "Qffffffffffff", names, *(row[::every] for row in rows))
    ground = stamps[:RATE_ROWS] - 1e6
    log.add("RATE", "Qffffffffffff", names, ground, *(0.0 * ground for _ in range(12)))
    roll = 3.0 * np.sin(np.pi * time)
    names = "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"
    log.add("ATT", "Qffffff", names, stamps, roll, *(0.0 * time for _ in range(5)))
    return log.save(path)


RATE_ROWS = int(RATE)


def test_the_gains_make_the_torques_that_they_made(autopilots, tmp_path):
    """But for the first step, of which the filters remember nothing."""
    found = logged_loop(written(autopilots.Dataflash, tmp_path / "a.bin"))
    asked, law = found.torques
    np.testing.assert_allclose(law[5:], asked[5:], atol=2e-4)
    assert (np.ptp(asked, axis=0) > 0.1).all()
    assert len(asked) == 20 * RATE
    assert (found.autopilot, found.gains.period, found.gains.gyro) == ("ArduPilot", 1.0 / RATE, 40.0)


def test_rates_are_those_of_the_setpoint_and_of_the_error(autopilots, tmp_path):
    """4.5 / s times 3 deg sin(pi t), and 3 deg pi cos(pi t) besides."""
    _, law = logged_loop(written(autopilots.Dataflash, tmp_path / "a.bin")).rates
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    own = np.radians(3.0) * (4.5 * np.sin(np.pi * time) + np.pi * np.cos(np.pi * time))
    inner = slice(200, -200)
    np.testing.assert_allclose(law[inner, 0], own[inner], atol=2e-3)
    np.testing.assert_allclose(law[inner, 1:], 0.0, atol=1e-6)


def test_snapshots_of_the_loop_and_other_gains_do_not_make_them(autopilots, tmp_path):
    for k, (every, other) in enumerate(((40, {}), (1, {"ATC_RAT_RLL_P": 0.2}))):
        asked, law = logged_loop(written(autopilots.Dataflash, tmp_path / f"{k}.bin", every, **other)).torques
        assert np.abs(law - asked)[:, 0].max() > 0.02


def test_a_notch_is_as_wide_as_its_parameter_says_and_so_are_its_harmonics():
    """-3 dB at f - B / 2, and of the second harmonic at twice that, where the attenuation is large."""
    notch = {"INS_HNTCH_ENABLE": 1, "INS_HNTCH_FREQ": 60.0, "INS_HNTCH_BW": 30.0, "INS_HNTCH_ATT": 120.0}
    plain, hertz = gains_of(parameters()), FREQUENCIES / (2.0 * np.pi)
    for harmonics, edge in ((1, 45.0), (2, 90.0)):
        with_one = gains_of(parameters(**notch, INS_HNTCH_HMNCS=harmonics))
        L, L_0 = (rate_loop(one, np.ones(3), 0.0, 0.0)[0] for one in (with_one, plain))
        rates_alone = abs(np.interp(edge, hertz, L / L_0))  # at these frequencies all comes through the gyroscope
        assert rates_alone == pytest.approx(np.sqrt(0.5), abs=0.02)
    every = gains_of(parameters(**notch, INS_HNTCH_HMNCS=3, INS_HNTCH_OPTS=2, SERVO1_FUNCTION=33, SERVO2_FUNCTION=34))
    assert len(every.notches) == 4
    assert len(gains_of(parameters(INS_HNTCH_ENABLE=0, INS_HNTCH_FREQ=60.0)).notches) == 0


def test_parameters_of_other_firmware():
    old = {k: v for k, v in parameters().items() if "_FLT" not in k} | {f"ATC_RAT_{a}_FILT": 20.0 for a in AXES}
    assert gains_of(old).error.tolist() == [20.0] * 3
    assert np.isinf(gains_of(old).target).all()
    assert gains_of({"RATE_RLL_P": 0.15, "STB_RLL_P": 4.5}) is None


def test_of_other_files_nothing_is_said(autopilots, tmp_path):
    text = tmp_path / "a.csv"
    text.write_text("time,x\n0,1\n")
    still = autopilots.Dataflash(parameters()).add("ATT", "Qf", "TimeUS,Roll", [1, 2], [0.0, 0.0])
    for path in (text, tmp_path, still.save(tmp_path / "a.bin")):
        assert logged_loop(path) is None
