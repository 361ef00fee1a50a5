"""Designed flights: what they contain, the limits that they keep on the plant, and what no flight can do."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.learn.design import designer as search
from wrenchgap.learn.design.designer import design
from wrenchgap.learn.design.manoeuvres import Limits, Task, available, extent, space, usual, violations
from wrenchgap.learn.design.screening import lost_after, rehearse
from wrenchgap.learn.design.separability import separability, typical
from wrenchgap.plant import model_file
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.state import Commands
from wrenchgap.plant.trajectory.file import dumps, loads
from wrenchgap.plant.trajectory.maneuvers import Moves, Swing, Tilt, Turn

LIMITS = Limits((3.0, 3.5, 2.6), float(np.radians(50.0)), 1.5)


@pytest.fixture(scope="module")
def few():
    """Only one azimuth and one sweep of exchanges are tried: a quarter of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "SEARCH", replace(search.SEARCH, azimuths=(0.0,), sweeps=1))
        yield


@pytest.fixture(scope="module")
def steps():
    """What was told of the progress of `designed`."""
    return []


@pytest.fixture(scope="module")
def designed(hexarotor, few, steps):
    names = ["tether", "constant_wrench"]
    return design(names, hexarotor, limits=LIMITS, duration=12.0, progress=lambda *news: steps.append(news))


def test_a_force_in_E_is_told_from_one_in_B_by_yaw_or_tilt(designed):
    assert not designed.before.separable
    assert designed.expected.separable
    assert designed.separable
    assert any(isinstance(move, Turn | Tilt) for move in designed.trajectory.moves)
    assert designed.trajectory.duration == 12.0
    assert loads(dumps(designed.file)).trajectory == designed.trajectory  # to the last bit


def test_the_plant_and_the_rehearsal_agree_with_what_is_expected(hexarotor, designed):
    for direction in designed.expected.counting:
        found = designed.simulated(direction.truth, direction.imitator)
        assert max(0.3 * direction.separation, 2.5) < found
    again = separability(rehearse(designed.trajectory, hexarotor, LIMITS)[0], hexarotor, *designed.effects)
    assert again.separation == pytest.approx(designed.expected.separation, rel=1e-6)


def test_pairs_that_the_plant_does_not_confirm_are_named(designed):
    assert designed.alike == ()
    alike = replace(
        designed, flown=tuple(replace(f, separation=dict.fromkeys(f.separation, 0.0)) for f in designed.flown)
    )
    assert alike.alike == (("tether", "constant_wrench"),)
    assert not alike.separable


def test_a_simulated_flight_has_as_much_noise_as_is_left_on_the_logs(hexarotor, designed):
    """Sensors make a part of it; the rest is added, and nothing where the sensors make more."""
    record, _ = rehearse(designed.trajectory, hexarotor, LIMITS)
    floor = record.noise * np.array([2.0, 3.0, 0.5, 1.0, 2.0, 10.0])
    asked = SimpleNamespace(floor=floor, rng=np.random.default_rng(0))
    added = search._Search._as_on_the_logs(asked, record).measured - record.measured
    expected = np.sqrt(np.maximum(floor**2 - record.noise**2, 0.0))
    np.testing.assert_allclose(added.std(axis=0), expected, rtol=0.15)
    assert search._Search._as_on_the_logs(SimpleNamespace(floor=None), record) is record


def test_limits_hold_on_the_plant(hexarotor, designed):
    flown = simulate(hexarotor, hexarotor, designed.trajectory, rng=np.random.default_rng(5)).odometry
    reach = np.column_stack((np.abs(flown.position_E[:, :2]), flown.position_E[:, 2])).max(axis=0) + 0.30 + 0.115
    assert (reach < [1.5, 1.75, 2.6]).all()
    up = Rotation.from_quat(flown.quat_EB, scalar_first=True).apply([0.0, 0.0, 1.0])
    assert np.degrees(np.arccos(up[:, 2].min())) < 50.0
    assert np.linalg.norm(flown.velocity_E, axis=1).max() < 1.5


def test_progress_never_goes_back_and_says_what_it_does(designed, steps):
    fractions, words = zip(*steps, strict=True)
    assert len(fractions) > 20
    assert list(fractions) == sorted(fractions)
    assert 0.0 <= fractions[0] <= fractions[-1] <= 1.0
    assert all(words)


@pytest.mark.slow
def test_a_vehicle_that_pushes_along_z_gets_a_flight_that_it_can_fly(few):
    made = design(["body_drag", "constant_wrench"], model_file.load("crazyflie"), duration=8.0)
    assert made.trajectory.follows_thrust
    assert made.expected.separable
    assert np.linalg.norm(made.trajectory.at(np.linspace(0, 8, 400)).velocity_E, axis=1).max() > 0.2


@pytest.mark.parametrize(
    ("names", "vehicle", "options", "error", "words"),
    [
        (["mass"], "tilt_hexarotor", {}, UsageError, "at least two different effects"),
        (["mass", "mass"], "tilt_hexarotor", {}, UsageError, "at least two different effects"),
        (["mass", "com_offset"], "tilt_hexarotor", {"duration": 3.0}, UsageError, "--duration 3: expected 8 to 120 s"),
        (["mass", "com_offset"], "tilt_hexarotor", {"limits": Limits((0.9, 3.0, 3.0))}, UsageError, "no place to tilt"),
        (["battery_sag", "mass"], "tilt_hexarotor", {}, FitError, "no trajectory brings about"),
        (["servo_lag", "command_delay"], "crazyflie", {}, FitError, "needs arms that tilt"),
    ],
)
def test_what_cannot_be_designed_is_said_at_once(names, vehicle, options, error, words):
    with pytest.raises(error, match=words):
        design(names, model_file.load(vehicle), **options)


@pytest.mark.parametrize("values", [((0.0, 3.0, 3.0),), ((3.0, 3.0, 3.0), 0.0), ((3.0, 3.0, 3.0), 1.0, -1.0)])
def test_limits_must_make_sense(values):
    with pytest.raises(UsageError, match="got"):
        Limits(*values)


@pytest.mark.parametrize("azimuth", [0.0, 1.0])
def test_every_manoeuvre_stays_in_the_space_it_is_given(hexarotor, azimuth):
    room = space(hexarotor.vehicle, LIMITS)
    for name, made in available(room).items():
        if moves := made(Task(10.0, room, 0.8, azimuth)):
            r = Moves(10.0, room.home, tuple(moves)).at(np.linspace(0.0, 10.0, 1001))
            away = np.abs(r.position_E - np.array(room.home)).max(axis=0)
            assert (away[:2] <= np.array([room.x, room.y]) + 0.05).all(), name
            assert np.linalg.norm(r.velocity_E[[0, -1]]) < 1e-9, name


def test_violations_are_named(hexarotor):
    vehicle, n = hexarotor.vehicle, 50
    level, still, at = (np.tile(row, (n, 1)) for row in ([1.0, 0, 0, 0], np.zeros(3), [0.0, 0, 1.5]))
    calm = Commands(np.zeros((n, 6)), np.zeros((n, 6)), np.full((n, 12), 600.0))

    def found(position=at, quat=level, velocity=still, commands=calm):
        return " ".join(violations(vehicle, LIMITS, position, quat, velocity, commands, 0.01))

    assert found() == ""
    assert "along x" in found(position=np.add(at, [1.5 - extent(vehicle) + 0.01, 0, 0]))
    assert "of the floor" in found(position=np.add(at, [0, 0, -1.46]))
    assert "height" in found(position=np.add(at, [0, 0, 1.2]))
    tilted = Rotation.from_euler("x", 51, degrees=True).as_quat(scalar_first=True)
    assert "tilts by 51 deg" in found(quat=np.tile(tilted, (n, 1)))
    assert "2.00 m/s" in found(velocity=np.add(still, [2.0, 0, 0]))
    fast = Commands(calm.wrench_B, calm.tilt, np.full((n, 12), 1250.0))
    assert "largest speed in 100.0 %" in found(commands=fast)


def test_open_loop_and_closed_loop_command_the_same(hexarotor):
    flight = Moves(10.0, (0.0, 0.0, 1.5), (Swing(0.0, 10.0, (0.4, 0.2, 0.0), 3.0), Tilt(2.0, 6.0, 0.6, 1.0)))
    open_loop = rehearse(flight, hexarotor, usual(hexarotor.vehicle))[0]
    closed = simulate(hexarotor, hexarotor, flight, rng=np.random.default_rng(0))
    want = np.stack([np.interp(open_loop.state.time, closed.commanded.time, w) for w in closed.commanded.wrench_B.T], 1)
    error = (open_loop.commands.wrench_B - want)[20:-20]
    assert np.sqrt(np.mean(error[:, :3] ** 2)) < 0.6
    assert np.sqrt(np.mean(error[:, 3:] ** 2)) < 0.05


def test_a_size_with_which_nothing_can_hover_is_halved(few):
    """A small fixed-rotor vehicle cannot hold the typical constant wrench; half of it or less it can."""
    quadrotor, names = model_file.load("asymmetric_quadrotor"), ("com_offset", "constant_wrench")
    made = search._Search(names, quadrotor, (), None, 8.0, (), 0, lambda fraction, words: None)
    assert 0.0 < np.abs(made.effects[1].theta).max() < np.abs(typical("constant_wrench", quadrotor).theta).max()


def test_the_moment_at_which_control_is_lost_is_read_off_the_flight(hexarotor):
    """9 Nm are more than the arms hold; an unhindered hover ends where its trajectory does."""
    trajectory = Moves(3.0, (0.0, 0.0, 1.5))
    pushed = hexarotor.with_effects([make_effect(hexarotor.vehicle, "constant_wrench", {"torque_x": 9.0})])
    flights = [simulate(m, hexarotor, trajectory, rng=np.random.default_rng(1)) for m in (hexarotor, pushed)]
    held, lost = (lost_after(flight, trajectory) for flight in flights)
    assert held is None
    assert 0.05 < lost < 2.0
