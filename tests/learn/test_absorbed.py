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


def learnt(data, model):
    """A GP of what the model leaves of the torque."""
    rest = data.measured - data.predict(model.wrench_model)
    return fit(data.commanded[::3], rest[::3, 3:], TORQUE, FitSettings(points=80, restarts=0))


def test_names_the_hidden_effect_with_its_size(offset, hexarotor):
    found = absorbed(offset.data, hexarotor, learnt(offset.data, hexarotor), names=SOME)
    assert found.effects == ("com_offset",)
    assert found.first.share > 0.9
    assert found.first.cosine > 0.95
    assert [v.value for v in found.first.values] == pytest.approx(offset.values, abs=3e-4)
    assert [a.share for a in found.tried] == sorted((a.share for a in found.tried), reverse=True)
    assert np.isnan(found.size[:3]).all()
    assert (found.size[3:] > 0.02).all()


def test_names_nothing_when_the_effect_is_in_the_model_already(offset, hexarotor):
    values = {"com_offset": offset.values, "servo_lag": [0.0101], "arm_reaction": [0.0006]}
    model = hexarotor.with_effects([make_effect(hexarotor.vehicle, n, v) for n, v in values.items()])
    found = absorbed(offset.data, model, learnt(offset.data, model), names=SOME)
    assert found.effects == ()
    assert "com_offset" not in {a.name for a in found.tried}


def test_a_correction_that_no_effect_makes_is_nobodys(plain, hexarotor):
    """A torque along the commanded force's difference of x and y: no effect of the catalogue does that alone."""
    gain = np.zeros((1, 6))
    gain[0, 3] = -0.5
    made = LinearMismatch(("torque_y",), np.zeros(1), gain, np.ones(1))
    assert absorbed(plain, hexarotor, made, names=SOME).effects == ()


@pytest.mark.parametrize(("sign", "share"), [(1.0, 1.0), (-1.0, -3.0)])
def test_share_and_cosine_of_a_known_correction(offset, hexarotor, sign, share):
    """Against the effect's own change both are one; against its opposite the cosine is minus one, the share minus 3."""
    x, y, z = sign * offset.values
    gain = np.zeros((3, 6))
    # torque about O of a force at -r: M = -r x F, linear in the commanded force
    gain[:, :3] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    made = LinearMismatch(TORQUE, np.zeros(3), gain, np.ones(3))
    first = absorbed(offset.data, hexarotor, made, names=["com_offset"]).tried[0]
    assert first.cosine == pytest.approx(sign, abs=0.01)
    assert first.share == pytest.approx(share, rel=0.02)
    assert first.named == (sign > 0)
