"""A null run reproduces a flight that MuJoCo integrated and another autopilot flew, hidden effect and all."""

import pytest

pytest.importorskip("mujoco", reason="the independent engine needs MuJoCo (a development dependency)")

from benchmarks.hidden_effects.engine import fly
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.data.recording import read_recording
from wrenchgap.plant import model_file
from wrenchgap.replay.counterfactual.counterfactual import counterfactual


@pytest.mark.parametrize("effect", ["servo_lag", "weak_rotor"])
def test_an_independent_simulation_is_reproduced(effect):
    model = model_file.load("tilt_hexarotor")
    log, _ = fly(effect, None, "train", 8.0, seed=1)
    null = counterfactual(read_recording(opened(log, model), model.vehicle, duration=6.0), model).null_run
    assert null.duration_s == pytest.approx(6.0)
    assert null.attitude_deg_max < 0.2
    assert null.position_m_max < 2e-3
