"""Wind is found together with a drag, where the air moves and nowhere else; forces by other code than the catalogue's.

Wrench-only vehicle: a motion is prescribed, the forces follow from Newton and Euler in this file. Rotors: the
independent engine (MuJoCo), whose discs lean back in the velocity through the air.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import GRAVITY, Samples
from wrenchgap.learn.data.candidates import Candidates, Lack, candidates
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.measurement import prepare
from wrenchgap.learn.identify.add import add
from wrenchgap.learn.identify.fit import fit
from wrenchgap.learn.posterior.explain import search_dataset
from wrenchgap.plant import model_file
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Body, Vehicle

AIR = np.array([3.0, -2.0, 0.0])
TRIED = ("body_drag", "wind", "tether", "constant_wrench", "com_offset", "thrust_scale", "imu_misalignment", "mass")
ROTORS = ("rotor_drag", "body_drag", "wind", "axial_inflow", "tether", "constant_wrench", "servo_lag", "arm_reaction")
M, J = 2.0, np.array([0.02, 0.025, 0.04])
KITE = Model(Vehicle("kite", Body(M, np.diag(J), np.zeros(3)), None, None, np.zeros(3)))


def waves(t, sizes, rates, phases):
    """Sums of sines, their first and second derivatives, (N, 3) each."""
    s, c = (f(t[:, None, None] * rates + phases) for f in (np.sin, np.cos))
    return (sizes * s).sum(-1), (sizes * rates * c).sum(-1), -(sizes * rates**2 * s).sum(-1)


def flown(force_E, seed=0, seconds=20.0, dt=0.005):
    """A level vehicle that flies and yaws along a given path while `force_E(v)` acts at its centre of mass."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, dt)
    rates = rng.uniform(0.4, 1.6, (3, 3))
    p, v, a = waves(
        t, np.array([[1.0], [1.0], [0.3]]) * rng.uniform(0.5, 1.0, (3, 3)) / rates, rates, rng.uniform(0, 6, (3, 3))
    )
    (yaw, dyaw, d2yaw) = (x[:, 2] for x in waves(t, np.full((3, 1), 1.2), np.full((3, 1), 0.5), np.zeros((3, 1))))
    turn = np.zeros((len(t), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(yaw)
    turn[:, 1, 0] = np.sin(yaw)
    turn[:, 0, 1] = -np.sin(yaw)
    turn[:, 2, 2] = 1.0
    zero = np.zeros_like(yaw)
    omega, domega = np.stack((zero, zero, dyaw), 1), np.stack((zero, zero, d2yaw), 1)
    felt = np.einsum("nji,nj->ni", turn, a + np.array([0.0, 0.0, GRAVITY]))
    made = M * felt - np.einsum("nji,nj->ni", turn, force_E(v))
    quat = np.stack((np.cos(yaw / 2), zero, zero, np.sin(yaw / 2)), 1)
    samples = Samples(
        "kite",
        t,
        dt,
        omega + 2e-3 * rng.normal(size=omega.shape),
        felt + 3e-2 * rng.normal(size=felt.shape),
        np.hstack((made, domega * J)),
        position_E=p,
        velocity_E=v,
        quat_EB=quat,
    )
    return dataset([prepare(samples, KITE.vehicle)], KITE)


def linear(air):
    return lambda v: -0.25 * (v - air)


def plate(air):
    """|v| v, the same from every side: not the axis by axis square of the catalogue."""
    return lambda v: -0.06 * np.linalg.norm(v - air, axis=1, keepdims=True) * (v - air)


def named(data, model=KITE, tried=TRIED):
    return search_dataset(data, model, Candidates(tried, ()), limits_of=())


def test_wind_is_named_with_a_linear_drag_and_measured():
    found = named(flown(linear(AIR)))
    assert set(found.effects) == {"body_drag", "wind"}
    np.testing.assert_allclose(found.air.wind_E, AIR, atol=0.05)
    assert np.all(np.abs(found.air.wind_E - AIR) <= 3.0 * found.air.std)
    assert np.all(found.air.std[:2] < 0.2)


def test_the_form_that_fits_gives_the_wind_as_it_is():
    found = named(flown(plate(AIR)), tried=("body_drag_areas", *TRIED))
    assert set(found.effects) == {"body_drag_areas", "wind"}
    np.testing.assert_allclose(found.air.wind_E, AIR, atol=0.05)


def test_wind_is_named_with_a_drag_of_another_form_than_what_is_tried():
    """Its size then suffers from the form that is wrong, not its direction."""
    found = named(flown(plate(AIR)))
    assert set(found.effects) == {"body_drag", "wind"}
    wind = found.air.wind_E
    assert wind @ AIR > 0.99 * np.linalg.norm(wind) * np.linalg.norm(AIR)
    assert np.linalg.norm(wind - AIR) < 0.25 * np.linalg.norm(AIR)


@pytest.mark.slow
@pytest.mark.parametrize("drag", [linear, plate])
@pytest.mark.parametrize("seed", [1, 2])
def test_still_air_has_no_wind(drag, seed):
    found = named(flown(drag(np.zeros(3)), seed))
    assert found.effects == ("body_drag",)
    assert found.air is None


@pytest.mark.parametrize("force", [np.zeros(3), np.array([0.8, -0.5, 0.0])], ids=["nothing", "fan"])
def test_a_force_that_knows_no_velocity_is_no_wind(force):
    found = named(flown(lambda v: np.broadcast_to(force, v.shape), seed=4))
    assert "wind" not in found.effects
    assert bool(found.effects) == bool(force.any())


def test_a_fit_of_both_begins_where_the_wind_has_a_derivative():
    """Against the wind, drag alone would have to be negative and stays at its limit, zero."""
    data = flown(lambda v: 0.5 * AIR - 0.02 * v, seed=5)
    both = fit(data, KITE, ["body_drag", "wind"])
    assert np.all(np.abs(np.array([v.value for v in both.values("wind")])) > 3.0)
    alone = fit(data, KITE, ["body_drag"])
    assert np.sum(both.residual**2) < 0.5 * np.sum(alone.residual**2)


def test_wind_alone_is_not_tried_and_not_added():
    data = flown(linear(AIR), seconds=12.0)
    assert candidates(data.records, KITE, ["wind", "mass"]).tried == ("mass",)
    assert candidates(data.records, KITE, ["wind", "mass"]).untried[0].lack is Lack.AIR
    assert candidates(data.records, KITE, ["wind", "body_drag"]).tried == ("wind", "body_drag")
    with pytest.raises(ModelError, match=r"no force of its own; add it together with .*body_drag"):
        add(KITE, ["wind"], [])


@pytest.fixture
def leaning_discs():
    """Hidden effect of the engine: flapping, as the engine has it, in air that moves."""
    from benchmarks.hidden_effects import hidden

    @dataclass
    class LeaningDiscs(hidden.Hidden):
        answers = ("rotor_drag",)
        unit, size = "rad per unit advance ratio", 2.0
        slope: float = 2.0
        air_x: float = 0.0
        air_y: float = 0.0

        def push(self, world):
            v, n = world.hub_velocity_E - np.array((self.air_x, self.air_y, 0.0)), world.normals_E
            edge = v - (v * n).sum(1, keepdims=True) * n
            world.push(-(self.slope * hidden.C_F / hidden.RADIUS * world.speed)[:, None] * edge, world.hubs_E)

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(hidden.HIDDEN, "leaning_discs", LeaningDiscs)
        yield


@pytest.mark.slow
@pytest.mark.parametrize("air", [AIR, np.zeros(3)], ids=["wind", "still"])
def test_wind_is_named_with_the_drag_of_rotors(fly, hexarotor, leaning_discs, air):
    size = {"air_x": air[0], "air_y": air[1]}
    data, _ = fly("leaning_discs", size, "train", seconds=25, seed=61)
    found = named(data, hexarotor, ROTORS)
    assert "rotor_drag" in found.effects
    assert ("wind" in found.effects) == bool(air.any())
    if air.any():
        np.testing.assert_allclose(found.air.wind_E, air, atol=0.2)


def test_wind_of_the_model_is_seen_by_effects_that_are_tried():
    """A slow flight shows drag where the model knows that the air moves."""
    data = flown(linear(AIR), seconds=12.0)
    slow = [replace(r, state=replace(r.state, velocity_E=0.05 * r.state.velocity_E)) for r in data.records]
    windy = model_file.loads(WINDY)
    assert candidates(slow, KITE, ["body_drag"]).tried == ()
    assert candidates(slow, windy, ["body_drag"]).tried == ("body_drag",)


WINDY = """schema = 1
[vehicle]
name = "kite"
mass = 2.0
inertia = [0.02, 0.025, 0.04]
[[effects]]
name = "wind"
parameters = { velocity_x = 3.0, velocity_y = -2.0 }
"""
