"""Designed flights: what they contain, the limits that they keep on the plant, and what no flight can do."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.learn.design import designer as search
from wrenchgap.learn.design.designer import design
from wrenchgap.learn.design.manoeuvres import Limits, Task, available, extent, space, usual, violations
from wrenchgap.learn.design.rehearsal import lost_after, rehearse
from wrenchgap.learn.design.separability import separability
from wrenchgap.plant import model_file
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.moves import Moves, Swing, Tilt, Turn
from wrenchgap.plant.simulate import simulate
from wrenchgap.plant.state import Commands
from wrenchgap.plant.trajectory_file import dumps, loads

LIMITS = Limits((3.0, 3.5, 2.6), float(np.radians(50.0)), 1.5)


@pytest.fixture(scope="module")
def few():
    """Only one azimuth and one sweep of exchanges are tried: a quarter of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "AZIMUTHS", (0.0,))
        patch.setattr(search, "SWEEPS", 1)
        yield


@pytest.fixture(scope="module")
def designed(hexarotor, few):
    steps = []
    made = design(
        ["tether", "constant_wrench"],
        hexarotor,
        limits=LIMITS,
        duration=12.0,
        progress=lambda fraction, words: steps.append((fraction, words)),
    )
    return made, steps


def test_a_force_in_E_is_told_from_one_in_B_by_yaw_or_tilt(designed):
    made, _ = designed
    assert not made.before.separable
    assert made.expected.separable
    assert made.separable
    assert any(isinstance(move, Turn | Tilt) for move in made.trajectory.moves)


def test_the_plant_agrees_with_what_is_expected(designed):
    made, _ = designed
    for direction in made.expected.counting:
        found = made.simulated(direction.truth, direction.imitator)
        assert 0.3 * direction.separation < found
        assert found > 2.5


def test_limits_hold_on_the_plant(hexarotor, designed):
    made, _ = designed
    flown = simulate(hexarotor, hexarotor, made.trajectory, rng=np.random.default_rng(5)).odometry
    arm = np.hypot(0.30, 0.0) + 0.115
    assert np.abs(flown.position_E[:, 0]).max() + arm < 1.5
    assert np.abs(flown.position_E[:, 1]).max() + arm < 1.75
    assert flown.position_E[:, 2].max() + arm < 2.6
    up = Rotation.from_quat(flown.quat_EB, scalar_first=True).apply([0.0, 0.0, 1.0])
    assert np.degrees(np.arccos(up[:, 2].min())) < 50.0
    assert np.linalg.norm(flown.velocity_E, axis=1).max() < 1.5


def test_the_flight_is_that_of_its_file_to_the_last_bit(designed):
    made, _ = designed
    assert loads(dumps(made.file)).trajectory == made.trajectory
    assert made.trajectory.duration == 12.0


def test_progress_never_goes_back_and_says_what_it_does(designed):
    _, steps = designed
    fractions = [f for f, _ in steps]
    assert len(fractions) > 20
    assert fractions == sorted(fractions)
    assert 0.0 <= fractions[0] <= fractions[-1] <= 1.0
    assert all(words for _, words in steps)


def test_a_vehicle_that_pushes_along_z_gets_a_flight_that_it_can_fly(few):
    crazyflie = model_file.load("crazyflie")
    made = design(["body_drag", "constant_wrench"], crazyflie, duration=8.0)
    assert made.trajectory.follows_thrust
    assert made.expected.separable
    speed = np.linalg.norm(made.trajectory.at(np.linspace(0, 8, 400)).velocity_E, axis=1)
    assert speed.max() > 0.2


@pytest.mark.parametrize(
    ("names", "options", "error", "words"),
    [
        (["mass"], {}, UsageError, "at least two different effects"),
        (["mass", "mass"], {}, UsageError, "at least two different effects"),
        (["mass", "com_offset"], {"duration": 3.0}, UsageError, "--duration 3: expected 8 to 120 s"),
        (["mass", "com_offset"], {"limits": Limits((0.9, 3.0, 3.0))}, UsageError, "leaves no place to tilt"),
        (["battery_sag", "mass"], {}, FitError, "no trajectory brings about"),
    ],
)
def test_what_cannot_be_designed_is_said_at_once(hexarotor, names, options, error, words):
    with pytest.raises(error, match=words):
        design(names, hexarotor, **options)


def test_an_effect_that_the_vehicle_cannot_have_is_said_at_once():
    with pytest.raises(FitError, match="needs arms that tilt"):
        design(["servo_lag", "command_delay"], model_file.load("crazyflie"))


def test_limits_must_make_sense():
    for values in (((0.0, 3.0, 3.0),), ((3.0, 3.0, 3.0), 0.0), ((3.0, 3.0, 3.0), 1.0, -1.0)):
        with pytest.raises(UsageError, match="got"):
            Limits(*values)


def test_every_manoeuvre_stays_in_the_space_it_is_given(hexarotor):
    room = space(hexarotor.vehicle, LIMITS)
    time = np.linspace(0.0, 10.0, 1001)
    for name, made in available(room).items():
        for azimuth in (0.0, 1.0):
            moves = made(Task(10.0, room, 0.8, azimuth))
            if moves is None:
                continue
            r = Moves(10.0, room.home, tuple(moves)).at(time)
            away = np.abs(r.position_E - np.array(room.home)).max(axis=0)
            assert away[0] <= room.x + 0.05, name
            assert away[1] <= room.y + 0.05, name
            assert np.linalg.norm(r.velocity_E[[0, -1]]) < 1e-9, name


def test_violations_are_named(hexarotor):
    vehicle, n = hexarotor.vehicle, 50
    reach = extent(vehicle)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    still, at = np.zeros((n, 3)), np.tile([0.0, 0.0, 1.5], (n, 1))
    arms, rotors = vehicle.geometry()
    calm = Commands(np.zeros((n, 6)), np.zeros((n, len(arms))), np.full((n, len(rotors)), 600.0))

    def found(position=at, quat=level, velocity=still, commands=calm):
        return violations(vehicle, LIMITS, position, quat, velocity, commands, 0.01)

    assert found() == []
    assert "along x" in found(position=at + np.array([1.5 - reach + 0.01, 0, 0]))[0]
    assert "of the floor" in found(position=at - np.array([0, 0, 1.46]))[0]
    assert "height" in found(position=at + np.array([0, 0, 1.2]))[0]
    tilted = np.tile(Rotation.from_euler("x", 51, degrees=True).as_quat(scalar_first=True), (n, 1))
    assert "tilts by 51 deg" in found(quat=tilted)[0]
    assert "2.00 m/s" in found(velocity=still + np.array([2.0, 0, 0]))[0]
    fast = Commands(calm.wrench_B, calm.tilt, np.full((n, len(rotors)), 1250.0))
    assert "largest speed in 100.0 %" in found(commands=fast)[0]


def test_open_loop_and_closed_loop_command_the_same(hexarotor):
    flight = Moves(10.0, (0.0, 0.0, 1.5), (Swing(0.0, 10.0, (0.4, 0.2, 0.0), 3.0), Tilt(2.0, 6.0, 0.6, 1.0)))
    open_loop = rehearse(flight, hexarotor, usual(hexarotor.vehicle)).record
    closed = simulate(hexarotor, hexarotor, flight, rng=np.random.default_rng(0))
    want = np.stack([np.interp(open_loop.state.time, closed.commanded.time, w) for w in closed.commanded.wrench_B.T], 1)
    inside = slice(20, -20)
    error = (open_loop.commands.wrench_B - want)[inside]
    assert np.sqrt(np.mean(error[:, :3] ** 2)) < 0.6
    assert np.sqrt(np.mean(error[:, 3:] ** 2)) < 0.05


def test_separation_on_the_rehearsal_is_that_of_the_design(hexarotor, designed):
    made, _ = designed
    again = separability(rehearse(made.trajectory, hexarotor, LIMITS).record, hexarotor, *made.effects)
    assert again.separation == pytest.approx(made.expected.separation, rel=1e-6)


def test_a_size_with_which_nothing_can_hover_is_halved(few):
    """A small fixed-rotor vehicle cannot hold the typical constant wrench; half of it or less it can."""
    quadrotor = model_file.load("asymmetric_quadrotor")
    made = search._Search(
        ("com_offset", "constant_wrench"), quadrotor, (), None, 8.0, (), 0, lambda fraction, words: None
    )
    usual_size = make_effect(quadrotor.vehicle, "constant_wrench", [p.scale for p in _parameters(quadrotor)]).theta
    assert 0.0 < np.abs(made.effects[1].theta).max() < np.abs(usual_size).max()


def _parameters(model):
    from wrenchgap.plant.effects import find

    return find("constant_wrench").parameters(model.vehicle)


def test_the_moment_at_which_control_is_lost_is_read_off_the_flight(hexarotor):
    """9 Nm are more than the arms hold; an unhindered hover ends where its trajectory does."""
    trajectory = Moves(3.0, (0.0, 0.0, 1.5))
    pushed = hexarotor.with_effects([make_effect(hexarotor.vehicle, "constant_wrench", {"torque_x": 9.0})])
    flights = [simulate(m, hexarotor, trajectory, rng=np.random.default_rng(1)) for m in (hexarotor, pushed)]
    held, lost = (lost_after(flight, trajectory) for flight in flights)
    assert held is None
    assert lost is not None
    assert 0.05 < lost < 2.0
