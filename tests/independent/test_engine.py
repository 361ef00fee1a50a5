"""The independent engine is physics of the stated vehicle, and what it hides is what it says it hides."""

from __future__ import annotations

import ast
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

pytest.importorskip("mujoco", reason="the independent engine needs MuJoCo (a development dependency)")

import mujoco

from benchmarks.hidden_effects import engine as engine_module
from benchmarks.hidden_effects import hidden
from benchmarks.hidden_effects.airframe import AZIMUTH, C_F, GRAVITY, HUB, INERTIA, KAPPA, MASS, SPEED_MAX
from benchmarks.hidden_effects.autopilot import Autopilot
from benchmarks.hidden_effects.engine import Engine, choose, fly, main
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.flight.load import load
from wrenchgap.plant.effects import catalogue

Array = NDArray[np.float64]
HOVER = np.sqrt(MASS * GRAVITY / 12 / C_F)


def placed(*effects: hidden.Hidden, tilt: Array = np.zeros(6), omega: Array = np.zeros(3)) -> Engine:
    """An engine 1.6 m up, at rest unless told otherwise."""
    engine = Engine(effects)
    engine.reset(np.array((0.0, 0.0, 1.6)), np.zeros(3), np.eye(3), omega, tilt)
    return engine


def started(engine: Engine, tilt: Array, speed: Array) -> Array:
    """Acceleration (6,) from rest: of O in E at once; angular in B from 8 to 12 ms, when the servos hold the arms."""
    engine.advance(tilt, speed, steps=1)
    linear = np.array(engine.data.qacc[:3])
    engine.advance(tilt, speed, steps=6)
    before, since = engine.omega_B.copy(), engine.time
    engine.advance(tilt, speed, steps=3)
    return np.concatenate((linear, (engine.omega_B - before) / (engine.time - since)))


def spatial_inertia(engine: Engine) -> Array:
    """(6, 6) inertia of everything about O, level, joints held."""
    full = np.zeros((engine.model.nv, engine.model.nv))
    mujoco.mj_fullM(engine.model, engine.data, full)
    return full[:6, :6]


def com(engine: Engine) -> Array:
    """Centre of mass of the whole vehicle from O."""
    return np.asarray(engine.data.subtree_com[1] - engine.data.qpos[:3])


@pytest.mark.parametrize("name", ["engine", "airframe", "autopilot", "hidden", "recording", "trajectories"])
def test_engine_shares_no_code_with_what_it_judges(name: str) -> None:
    tree = ast.parse(Path(engine_module.__file__).with_name(f"{name}.py").read_text(encoding="utf-8"))
    imported = {n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    imported |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    ours = {name for name in imported if name.startswith("wrenchgap")}
    assert ours <= {"wrenchgap.flight.errors", "wrenchgap.flight.flight"}


def test_totals_at_zero_tilt_are_as_stated_and_tilting_hardly_changes_them() -> None:
    M = spatial_inertia(placed())
    np.testing.assert_allclose(M[:3, :3], MASS * np.eye(3), atol=1e-12)
    np.testing.assert_allclose(M[3:, 3:], np.diag(INERTIA), atol=1e-9)
    np.testing.assert_allclose(M[:3, 3:], 0.0, atol=1e-12)
    tilted = spatial_inertia(placed(tilt=np.full(6, 1.2)))
    np.testing.assert_allclose(np.diag(tilted[3:, 3:]), INERTIA, rtol=0.01)


def test_hover_thrust_balances_weight() -> None:
    engine = placed()
    np.testing.assert_allclose(started(engine, np.zeros(6), np.full(12, HOVER)), 0.0, atol=1e-9)
    np.testing.assert_allclose(engine.specific_force, (0.0, 0.0, GRAVITY), atol=1e-9)


def hovering(axis: int, extra: float) -> tuple[Array, Array, Array]:
    """Wrench that carries the weight with something more on one axis, and the tilt and speed that make it."""
    wrench = MASS * GRAVITY * np.eye(6)[2] + extra * np.eye(6)[axis]
    return wrench, *Autopilot(0.0, 0.005).allocate(wrench)


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_allocated_wrench_is_the_wrench_that_acts(axis: int, sign: float) -> None:
    wrench, tilt, speed = hovering(axis, sign * (3.0 if axis < 3 else 0.8))
    acceleration = started(placed(tilt=tilt), tilt, speed)
    np.testing.assert_allclose(acceleration[:3], wrench[:3] / MASS - (0, 0, GRAVITY), atol=1e-6)
    np.testing.assert_allclose(acceleration[3:] * INERTIA, wrench[3:], atol=3e-3)


@pytest.mark.parametrize(("axis", "entry", "sign"), [(4, (2, 0), -1), (5, (1, 0), 1), (3, (2, 1), 1)])
def test_positive_pitch_torque_puts_the_nose_down_and_positive_yaw_turns_left(axis, entry, sign) -> None:
    _, tilt, speed = hovering(axis, 0.5)
    engine = placed(tilt=tilt)
    engine.advance(tilt, speed, steps=100)
    assert sign * engine.R_EB[entry] > 0.005


@pytest.mark.parametrize(("rotor", "sign"), [(0, 1), (1, -1), (2, -1), (3, 1), (8, 1)])
def test_upper_rotor_of_an_even_arm_twists_the_hull_to_the_left(rotor: int, sign: int) -> None:
    yaw = started(placed(), np.zeros(6), HOVER * np.eye(12)[rotor])[5]
    assert yaw == pytest.approx(sign * KAPPA * C_F * HOVER**2 / INERTIA[2], rel=1e-3)


def test_hubs_lie_where_the_vehicle_has_them() -> None:
    tilt = np.array((0.3, -0.4, 1.2, 0.0, -1.5, 0.7))
    engine = placed(tilt=tilt)
    a, g = np.repeat(tilt, 2), np.repeat(AZIMUTH, 2)
    n = np.stack((np.sin(g) * np.sin(a), -np.cos(g) * np.sin(a), np.cos(a)), 1)
    np.testing.assert_allclose(engine.normals_E, n, atol=1e-12)
    arm = 0.30 * np.stack((np.cos(g), np.sin(g), 0 * g), 1)
    hubs = arm + np.tile((HUB, -HUB), 6)[:, None] * n
    np.testing.assert_allclose(engine.hubs_E - engine.position_E, hubs, atol=1e-12)


def test_falling_with_moving_arms_keeps_momentum() -> None:
    engine = placed(omega=np.array((0.5, -0.3, 0.8)))
    drift = []
    for target in (0.8, -0.5, 0.0):
        engine.advance(np.full(6, target) * (1, -1, 0.5, 1, 0.3, -1), np.zeros(12), steps=100)
        mujoco.mj_forward(engine.model, engine.data)
        mujoco.mj_subtreeVel(engine.model, engine.data)
        drift.append(np.array(engine.data.subtree_angmom[1]))
        assert engine.data.subtree_linvel[1][2] == pytest.approx(-GRAVITY * engine.time, rel=1e-9)
    np.testing.assert_allclose(drift, np.tile(drift[0], (3, 1)), atol=2e-4)


def time_to(engine: Engine, target: float, share: float) -> float:
    """Seconds until arm 0 has gone `share` of the way to `target` from zero."""
    while engine.tilt[0] < share * target:
        engine.advance(np.full(6, target), np.zeros(12), steps=1)
    return engine.time


def test_servo_lags_by_about_15_ms_and_more_when_it_is_softer() -> None:
    assert time_to(placed(), 0.02, 1 - np.exp(-1)) == pytest.approx(0.015, abs=0.0025)
    assert time_to(placed(hidden.ServoLag(0.045)), 0.02, 1 - np.exp(-1)) == pytest.approx(0.060, abs=0.003)


def test_servo_has_a_rate_limit() -> None:
    engine = placed()
    early, late = (time_to(engine, 3.0, share) for share in (0.2, 0.8))
    assert 0.6 * 3.0 / (late - early) == pytest.approx(8.0, rel=0.02)


def test_delay_is_a_pure_delay() -> None:
    def heights(engine: Engine) -> list[float]:
        engine.advance(np.zeros(6), np.full(12, HOVER))
        seen = []
        for _ in range(40):
            engine.advance(np.zeros(6), np.full(12, 1.1 * HOVER), steps=1)
            seen.append(float(engine.specific_force[2]))
        return seen

    now, late = heights(placed()), heights(placed(hidden.CommandDelay(0.02)))
    assert now[0] > GRAVITY + 1
    np.testing.assert_allclose(late[:16], GRAVITY, atol=1e-6)
    np.testing.assert_allclose(late[16:], now[:-16], rtol=1e-9)


def test_motor_lag_at_hover_is_the_stated_time_constant() -> None:
    engine = placed(hidden.MotorLag(0.04))
    engine.advance(np.zeros(6), np.full(12, 1.01 * HOVER), steps=32)  # 40 ms
    assert (engine.speed[0] / HOVER - 1) / 0.01 == pytest.approx(1 - np.exp(-1), abs=0.02)


def test_arm_with_play_follows_only_where_the_gap_closes() -> None:
    gap = 0.05
    engine = placed(hidden.Backlash(gap))
    still, pattern = np.full(12, HOVER), np.array((1.0, -1, 1, -1, 1, -1))  # no net force or yaw torque

    def go(angle: float) -> float:
        start = float(engine.data.qpos[engine._servo_q[0]])
        for target in np.linspace(start, angle, 80):
            engine.advance(pattern * target, still)
        engine.advance(pattern * angle, still, steps=80)
        return float(engine.tilt[0])

    assert go(0.3) == pytest.approx(0.3 - gap / 2, abs=0.004)
    up = go(0.5)
    assert up == pytest.approx(0.5 - gap / 2, abs=0.004)
    assert go(0.5 - 0.6 * gap) == pytest.approx(up, abs=0.002)  # inside the gap: stays
    assert go(0.2) == pytest.approx(0.2 + gap / 2, abs=0.004)


@pytest.mark.parametrize("tilt", [0.0, 0.6])
def test_com_offset_gives_the_static_torque(tilt: float) -> None:
    c = np.array((-0.004, 0.007, -0.005))
    engine = placed(hidden.ComOffset(*c), tilt=np.full(6, tilt) * (0, 1, 1, 0, -1, -1))
    np.testing.assert_allclose(com(engine), c, atol=1e-12)
    assert spatial_inertia(engine)[0, 0] == pytest.approx(MASS)
    F = C_F * HOVER**2 * engine.normals_E.sum(0)
    J_c = spatial_inertia(engine)[3:, 3:] - MASS * (c @ c * np.eye(3) - np.outer(c, c))
    pull = np.cross(engine.hubs_E - engine.position_E, C_F * HOVER**2 * engine.normals_E).sum(0)
    acceleration = started(engine, engine.tilt, np.full(12, HOVER))
    np.testing.assert_allclose(J_c @ acceleration[3:], pull - np.cross(c, F), atol=1e-3)
    assert np.linalg.norm(np.cross(c, F)) > 0.2


def test_added_pairs_change_the_moments_and_nothing_else() -> None:
    engine = placed(hidden.Inertia(0.004, 0.002, 0.006))
    M = spatial_inertia(engine)
    np.testing.assert_allclose(np.diag(M)[3:] - INERTIA, (0.008, 0.010, 0.006), atol=1e-5)
    np.testing.assert_allclose(np.diag(M)[:3], MASS, rtol=1e-9)
    np.testing.assert_allclose(com(engine), 0.0, atol=1e-12)


@pytest.mark.parametrize("name", ["resonance", "slosh", "heavy_arms"])
def test_moving_masses_leave_the_totals(name: str) -> None:
    engine = placed(*choose(name, None, 0).values())
    M = spatial_inertia(engine)
    np.testing.assert_allclose(np.diag(M)[:3], MASS, rtol=1e-6)
    np.testing.assert_allclose(np.diag(M)[3:], INERTIA, rtol=0.01)
    np.testing.assert_allclose(com(engine), 0.0, atol=1e-9)


def test_weak_rotor_costs_its_share() -> None:
    _, truth = fly("weak_rotor", {"rotor": 3, "loss": 0.15}, "hover", 0.1)
    healthy = np.delete(truth.thrust[1], 3)
    assert truth.thrust[1, 3] == pytest.approx(0.85 * healthy[0], rel=1e-9)
    # Lost lift at arm 1 (60 deg) lets the vehicle fall over to that side: about (sin, -cos) of its azimuth.
    assert truth.omega_B[-1] @ (np.sin(np.pi / 3), -np.cos(np.pi / 3), 0) < -1e-4


def test_turned_rotor_pairs_push_sideways() -> None:
    angle = 0.02
    acceleration = started(placed(hidden.TiltOffset((angle,) * 6)), np.zeros(6), np.full(12, HOVER))
    lateral = MASS * GRAVITY * np.sin(angle)  # all tangential, clockwise seen from above
    assert acceleration[5] == pytest.approx(-0.30 * lateral / INERTIA[2], rel=0.01)


def test_wake_takes_nothing_upstream_and_most_in_the_middle() -> None:
    wake, even = hidden.Wake(0.2), np.full(12, 3.0)

    def kept(*tilt: float) -> Array:
        """Share of thrust of each rotor."""
        return wake.thrust(placed(wake, tilt=np.array(tilt)), even) / even

    assert np.all(kept(0, 0, 0, 0, 0, 0) > 0.99)
    # Arms 1 and 5 turned sideways blow along -y and +y of the hull; arms between are hit, arms behind are not.
    assert 0.75 < kept(0, 0, 0, 0, 0, -1.5).reshape(6, 2).mean(1).min() < 0.99
    loss = [1 - kept(0, t, t, 0, -t, -t).mean() for t in np.linspace(0, 1.5, 16)]
    assert loss[-1] > 3 * loss[4]  # sets in at high tilt


def test_tether_pulls_with_its_force_towards_its_anchor() -> None:
    rope = hidden.Tether(pull=1.5, anchor=(0.0, -12.0, 1.6), at=(0.0, 0.0, 0.0))
    force = MASS * started(placed(rope), np.zeros(6), np.full(12, HOVER))[:3]
    np.testing.assert_allclose(force, (0.0, -1.5, 0.0), atol=1e-3)


def test_slung_load_hangs_and_is_carried() -> None:
    _, truth = fly("slung_load", {"mass": 0.2, "length": 0.5}, "hover", 8.0, integral=0.3)
    assert truth.thrust[-400:].sum(1).mean() == pytest.approx((MASS + 0.2) * GRAVITY, rel=0.01)
    assert Engine((hidden.SlungLoad(0.2),)).model.nv == Engine().model.nv + 3


def test_weight_of_a_heavier_vehicle_shows_in_the_command_and_not_in_the_accelerometer() -> None:
    flight, truth = fly("mass", 0.05, "hover", 10.0)
    assert flight.commanded.wrench_B[-200:, 2].mean() == pytest.approx(1.05 * MASS * GRAVITY, rel=0.005)
    assert truth.specific_force_B[-200:, 2].mean() == pytest.approx(GRAVITY, rel=0.002)


def mismatch(name: str | list[str], trajectory: str, seconds: float, split: float = 0.0, crisp: bool = False) -> Array:
    """Noise-free (N, 6) difference of the wrench felt at O and the wrench commanded over the same interval."""
    flight, truth = fly(name, None, trajectory, seconds, seed=2, noise=0.0, pair_split=split, crisp=crisp)
    dt = truth.time[1] - truth.time[0]
    J = np.array(INERTIA)
    omega = 0.5 * (truth.omega_B[1:] + truth.omega_B[:-1])
    torque = J * np.diff(truth.omega_B, axis=0) / dt + np.cross(omega, J * omega)
    felt = np.hstack((MASS * truth.specific_force_B[1:], torque))
    return felt - flight.commanded.wrench_B[:-1]


@cache
def ideal(trajectory: str, seconds: float, split: float) -> Array:
    return mismatch("none", trajectory, seconds, split)


def rms(z: Array) -> Array:
    return np.asarray(np.sqrt((z**2).mean(0)))


def test_nothing_hidden_leaves_only_the_servo_lag_and_a_crisp_vehicle_hardly_that() -> None:
    usual, crisp = (rms(mismatch("none", "train", 12.0, crisp=c)) for c in (False, True))
    assert np.all(usual < np.repeat([0.5, 0.06], 3))
    assert np.all(crisp < 0.3 * usual)
    assert np.all(rms(mismatch("none", "hover", 2.0)) < 1e-6)


def test_two_effects_add() -> None:
    names = (["com_offset", "thin_air"], "com_offset", "thin_air")
    both, one, other = (mismatch(name, "hover", 1.0)[20:60].mean(0) for name in names)
    np.testing.assert_allclose(both[2], other[2] + one[2], rtol=0.05)
    np.testing.assert_allclose(both[3:5], one[3:5], rtol=0.15, atol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("trajectory", ["train", "pitch", "figure8", "steps", "fast", "low", "turn"])
def test_every_trajectory_is_flown_within_the_limits(trajectory: str) -> None:
    flight, truth = fly("none", trajectory=trajectory, noise=0.0)
    assert np.abs(truth.position_E - flight.reference.position_E).max() < 0.05
    assert flight.actuators.rotor_speed.max() < SPEED_MAX
    assert np.abs(np.diff(flight.actuators.tilt, axis=0)).max() * 200 < 8.0
    assert truth.position_E[:, 2].min() > 0.1
    tilt = np.degrees(np.arccos(1 - 2 * (truth.quat_EB[:, 1] ** 2 + truth.quat_EB[:, 2] ** 2)))
    reached = {"train": (60, 72), "pitch": (59.5, 60.5), "figure8": (62, 64.5), "turn": (28, 38)}
    low, high = reached.get(trajectory, (0, 60))
    assert low < tilt.max() < high


@pytest.mark.slow
@pytest.mark.parametrize("name", hidden.HIDDEN)
def test_every_effect_flies_and_leaves_a_trace(name: str) -> None:
    cls = hidden.HIDDEN[name]
    assert cls.unit
    assert set() < set(cls.answers) <= {*catalogue(), "unknown"}
    split = 0.3 if cls.needs_split else 0.0
    changed = mismatch(name, cls.shows_on, 6.0, split) - ideal(cls.shows_on, 6.0, split)
    assert np.any(rms(changed) > np.repeat([0.04, 0.004], 3))


def test_centre_of_mass_can_be_read_off_a_noisy_flight() -> None:
    c = np.array((-0.004, 0.007, -0.005))
    flight, _ = fly("com_offset", dict(zip("xyz", c, strict=True)), "train", 30.0, seed=3)
    low = butter(2, 8.0, fs=200.0, output="sos")
    omega, a = (sosfiltfilt(low, s, axis=0) for s in (flight.imu.omega_B, flight.imu.specific_force_B))
    held = flight.commanded.wrench_B
    wanted = sosfiltfilt(low, 0.5 * (held[:-1] + held[1:]), axis=0)  # on average around each IMU stamp
    J = np.array(INERTIA)
    torque = J * np.gradient(omega, 0.005, axis=0) + np.cross(omega, J * omega)
    z, F = (torque - wanted[:, 3:])[100:-100], MASS * a[100:-100]
    columns = [-np.cross(axis, F) for axis in np.eye(3)]  # torque about O of F acting at O, as seen from c
    A = np.stack([column.ravel() for column in columns], 1)
    found = np.linalg.lstsq(A, z.ravel(), rcond=None)[0]
    np.testing.assert_allclose(found, c, atol=2e-4)


def test_flights_repeat_and_seeds_differ() -> None:
    (a, _), (b, _), (c, _) = (fly("wake", 0.2, "train", 1.0, seed=s) for s in (1, 1, 2))
    assert a.content_hash == b.content_hash != c.content_hash


def test_a_compensator_sits_between_desired_and_commanded() -> None:
    shift = np.array((0.0, 0.0, 0.0, 0.05, -0.02, 0.01))
    flight, _ = fly("none", None, "hover", 1.0, compensate=lambda desired, state: desired + shift)
    added = flight.commanded.wrench_B - flight.desired.wrench_B
    np.testing.assert_allclose(added, np.tile(shift, (200, 1)), atol=1e-12)


def test_a_compensator_that_knows_the_truth_removes_the_error() -> None:
    c = {"x": 0.0, "y": 0.008, "z": 0.0}

    def knows(desired: Array, state: Array) -> Array:
        return np.concatenate((desired[:3], desired[3:] + np.cross((0.0, 0.008, 0.0), desired[:3])))

    flights = (fly("com_offset", c, "pitch", 12.0, integral=0.0, compensate=k)[1] for k in (None, knows))
    plain, helped = (np.abs(truth.quat_EB[:, 1]).max() for truth in flights)
    assert plain > 0.05
    assert helped < 0.1 * plain


def test_sensor_noise_has_the_stated_level() -> None:
    flight, truth = fly("none", None, "hover", 10.0, seed=4)
    np.testing.assert_allclose((flight.imu.omega_B - truth.omega_B[1:]).std(0), 3.4e-3, rtol=0.06)
    np.testing.assert_allclose((flight.imu.specific_force_B - truth.specific_force_B[1:]).std(0), 3.17e-2, rtol=0.06)
    np.testing.assert_allclose((flight.odometry.position_E - truth.position_E[::2]).std(0), 3e-4, rtol=0.08)


def test_log_reads_back_as_the_flight(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "hidden.mcap"
    main(["--effect", "battery", "--trajectory", "train", "--seconds", "3", "--seed", "5", "-o", str(log)])
    assert json.loads(capsys.readouterr().out)["effects"] == ["battery"]
    made, _ = fly("battery", None, "train", 3.0, seed=5)
    mine, theirs = made.series(), load(log).series()
    assert set(mine) == set(theirs)
    for role, columns in {
        "commanded": ("wrench_B",),
        "actuators": ("rotor_speed", "tilt"),
        "imu": ("specific_force_B",),
        "odometry": ("velocity_E",),
        "reference": ("velocity_E",),
    }.items():
        np.testing.assert_allclose(np.diff(theirs[role].time), np.diff(mine[role].time), atol=1e-9)
        for column in columns:
            np.testing.assert_allclose(getattr(theirs[role], column), getattr(mine[role], column), atol=1e-9)
    assert theirs["battery"].voltage[-1] < 25.2


@pytest.mark.parametrize(
    ("asked", "error", "words"),
    [
        (("com_ofset",), UsageError, "com_offset"),
        (("none", None, "figure9"), UsageError, "figure8"),
        ((["wake", "mass"], [0.1]), UsageError, "2 effects"),
        (("heavy_arms", 0.02), ModelError, "smaller size"),
    ],
)
def test_wrong_names_are_answered_with_the_right_ones(asked, error, words) -> None:
    with pytest.raises(error, match=words):
        fly(*asked)
