"""Gains of the attitude controller from a log: those that flew, whatever the model says."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.diagnose.flown_controller import attitude_gains, gains_source
from wrenchgap.plant import model_file
from wrenchgap.plant.controller import default_gains
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.trajectory import named

MODEL = model_file.load("tilt_hexarotor")
HIDDEN = MODEL.with_effects([make_effect(MODEL.vehicle, "com_offset", [-0.01, 0.02, -0.01])])


def flown(truth, zeta, omega, integral=0.3, excitation=1.0):
    gains = replace(MODEL.controller, zeta_attitude=zeta, omega_attitude=omega, integral=integral)
    path = named("multi_axis", 16.0, excitation=excitation, seed=1)
    log = simulate(truth, replace(MODEL, controller=gains), path, 16.0, rng=np.random.default_rng(5))
    return opened(log, MODEL)


@pytest.mark.parametrize("integral", [0.0, 0.3])
@pytest.mark.parametrize(("zeta", "omega"), [((1.3, 1.3, 0.74), (3.5, 3.5, 3.5)), ((0.7, 0.9, 1.0), (6.0, 5.0, 4.0))])
def test_gains_that_flew_are_found(zeta, omega, integral):
    """The log's, not the model's: `MODEL` says 3.5 rad/s in both cases."""
    found = attitude_gains([flown(HIDDEN, zeta, omega, integral)], MODEL)
    assert found.zeta == pytest.approx(zeta, rel=0.1)
    assert found.omega == pytest.approx(omega, rel=0.1)
    assert found.explained > 0.97
    taken = found.into(MODEL.controller)
    assert (taken.omega_attitude, taken.zeta_attitude) == (tuple(found.omega), tuple(found.zeta))
    assert taken.rate_hz == MODEL.controller.rate_hz


def test_vehicle_that_follows_without_error_shows_none():
    assert attitude_gains([flown(MODEL, (1.3, 1.3, 0.74), (3.5, 3.5, 3.5))], MODEL) is None


def test_log_without_reference_or_command_shows_none():
    log = flown(HIDDEN, (1.3, 1.3, 0.74), (3.5, 3.5, 3.5))
    assert attitude_gains([replace(log, flight=replace(log.flight, reference=None))], MODEL) is None
    silent = tuple(replace(s, wrench_des_B=None, wrench_cmd_B=None) for s in log.flown)
    assert attitude_gains([replace(log, flown=silent)], MODEL) is None


def test_usual_gains_of_a_model_that_gives_none_are_told():
    assert gains_source(MODEL) == "model"
    assert gains_source(replace(MODEL, controller=default_gains(MODEL.vehicle))) == "typical"
