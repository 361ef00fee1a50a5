"""Flights of MuJoCo and another autopilot: a designed one separates effects, a null run reproduces one."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco", reason="the independent engine needs MuJoCo (a development dependency)")

from benchmarks.hidden_effects import engine, trajectories
from wrenchgap.flight import uniform
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.measurement import prepare
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.data.recording import read_recording
from wrenchgap.learn.design.separability import measured_separation
from wrenchgap.plant import model_file
from wrenchgap.plant.trajectory.maneuvers import Moves, Tilt, Turn
from wrenchgap.replay.counterfactual.counterfactual import counterfactual

HEXAROTOR = model_file.load("tilt_hexarotor")
LEAN_AND_TURN = Moves(
    16.0,
    (0.0, 0.0, 1.6),
    (Tilt(0.5, 9.0, np.radians(50.0), 0.0, 1.8, np.pi), Tilt(9.5, 6.0, np.radians(40.0)), Turn(10.0, 5.0, np.pi)),
)


@pytest.fixture
def separation(monkeypatch):
    """separation("tether", "constant_wrench", trajectory): of a flight with the first hidden, by both fits."""

    def followed(time, rng):
        r = LEAN_AND_TURN.at(np.clip(time, 0.0, LEAN_AND_TURN.duration))
        return r.position_E, Rotation.from_quat(r.quat_ED, scalar_first=True).as_rotvec()

    monkeypatch.setitem(trajectories.TRAJECTORIES, "designed", (followed, LEAN_AND_TURN.duration))

    def of(hidden, truth, other, name):
        found, _ = engine.fly(hidden, None, name, 16.0, seed=3)
        data = dataset([prepare(s, HEXAROTOR.vehicle) for s in uniform(found)], HEXAROTOR)
        return measured_separation(data, HEXAROTOR, truth, other, ("servo_lag",))

    return of


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "truth", "other"), [("tether", "tether", "constant_wrench"), ("jet", "constant_wrench", "tether")]
)
def test_tilt_and_yaw_tell_a_force_in_E_from_one_in_B(separation, hidden, truth, other):
    assert separation(hidden, truth, other, "hover") < 2.5 < separation(hidden, truth, other, "designed")


@pytest.mark.parametrize("effect", ["servo_lag", "weak_rotor"])
def test_a_null_run_reproduces_a_flight_with_a_hidden_effect(effect):
    log, _ = engine.fly(effect, None, "train", 8.0, seed=1)
    recording = read_recording(opened(log, HEXAROTOR), HEXAROTOR.vehicle, duration=6.0)
    null = counterfactual(recording, HEXAROTOR).null_run
    assert null.duration_s == pytest.approx(6.0)
    assert null.attitude_deg_max < 0.2
    assert null.position_m_max < 2e-3
