"""What a GP absorbs: the effect that it reproduces is named, and nothing where it has learnt nothing."""

import numpy as np
import pytest

from wrenchgap.learn.identify.absorption import absorbed
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.learn.process.train import fit
from wrenchgap.plant.mismatch import LinearMismatch
from wrenchgap.plant.model import make_effect

TORQUE = ("torque_x", "torque_y", "torque_z")
SOME = ("com_offset", "constant_wrench", "rotor_thrust", "servo_lag", "thrust_scale", "inertia", "tether")


def learnt(data, model, outputs=TORQUE):
    """A GP of what the model leaves of the torque."""
    rest = data.measured - data.predict(model.wrench_model)
    keep = slice(None, None, 3)
    return fit(data.commanded[keep], rest[keep, 3:], outputs, FitSettings(points=80, restarts=0))


def test_names_the_hidden_effect_with_its_size(fly, hexarotor):
    data, truth = fly("com_offset", None, "train", seed=21, seconds=25)
    found = absorbed(data, hexarotor, learnt(data, hexarotor), names=SOME)
    assert found.effects == ("com_offset",)
    assert found.first.share > 0.9
    assert found.first.cosine > 0.95
    values = {v.name: v.value for v in found.first.values}
    assert values == pytest.approx(truth.parameters["com_offset"], abs=3e-4)
    assert [a.share for a in found.tried] == sorted((a.share for a in found.tried), reverse=True)
    assert np.isnan(found.size[:3]).all()
    assert (found.size[3:] > 0.02).all()


def test_names_nothing_when_the_effect_is_in_the_model_already(fly, hexarotor):
    data, truth = fly("com_offset", None, "train", seed=21, seconds=25)
    values = {"com_offset": truth.parameters["com_offset"], "servo_lag": [0.0101], "arm_reaction": [0.0006]}
    model = hexarotor.with_effects([make_effect(hexarotor.vehicle, n, v) for n, v in values.items()])
    found = absorbed(data, model, learnt(data, model), names=SOME)
    assert found.effects == ()
    assert "com_offset" not in {a.name for a in found.tried}


def test_a_correction_that_no_effect_makes_is_nobodys(fly, hexarotor):
    """A torque along the commanded force's difference of x and y: no effect of the catalogue does that alone."""
    data, _ = fly("none", None, "train", seed=23, seconds=25)
    gain = np.zeros((1, 6))
    gain[0, 3] = -0.5
    found = absorbed(data, hexarotor, LinearMismatch(("torque_y",), np.zeros(1), gain, np.ones(1)), names=SOME)
    assert found.effects == ()


def test_share_and_cosine_of_a_known_correction(fly, hexarotor):
    """Against the effect's own change both are one; against its opposite the cosine is minus one, the share minus 3."""
    data, truth = fly("com_offset", None, "train", seed=21, seconds=25)
    gain = np.zeros((3, 6))
    # torque about O of a force at -r: M = -r x F, linear in the commanded force
    x, y, z = (truth.parameters["com_offset"][axis] for axis in "xyz")
    gain[:, :3] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    same, opposite = (LinearMismatch(TORQUE, np.zeros(3), s * gain, np.ones(3)) for s in (1.0, -1.0))
    first = absorbed(data, hexarotor, same, names=["com_offset"]).tried[0]
    second = absorbed(data, hexarotor, opposite, names=["com_offset"]).tried[0]
    assert first.cosine == pytest.approx(1.0, abs=0.01)
    assert first.share == pytest.approx(1.0, abs=0.02)
    assert second.cosine == pytest.approx(-1.0, abs=0.01)
    assert second.share == pytest.approx(-3.0, abs=0.1)
    assert not second.named
