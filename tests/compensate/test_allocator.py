"""The corrected allocation: closed forms of its largest margin, a linear programme, limits, demands that are none."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

import wrenchgap as wg
from tests.plant.conftest import star
from wrenchgap.compensate.allocation_kernels import BAD_DEMAND, MADE, REDUCED
from wrenchgap.compensate.allocator import Allocator, margins
from wrenchgap.flight.errors import ModelError
from wrenchgap.plant.allocation_problem import allocation_problem, demands, made_by_model
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.vehicle import GRAVITY

FULL = 7.2e-6 * 1250.0**2
"""Thrust [N] of a rotor of `star` at its largest speed."""
ARM, KAPPA = 0.3, 0.0165


def model_of(vehicle, **effects):
    made = [make_effect(vehicle, name, values) for name, values in effects.items()]
    return replace(wg.load_model("crazyflie"), path=None, vehicle=vehicle, effects=()).with_effects(made)


def fixed(arms, mass=4.0, **effects):
    """Of a star of rotors that do not tilt, between its axes."""
    vehicle = star(arms, coaxial=False, tilts=False, phase=np.pi / arms)
    return model_of(replace(vehicle, body=replace(vehicle.body, mass=mass)), **effects)


def weak(arms, rotor, gain):
    return fixed(arms, rotor_thrust={f"rotor_{r}": (gain - 1.0) * (r == rotor) for r in range(arms)})


def wrench_by_hand(vehicle, thrust, tilt, gain=1.0, servo_zero=0.0, com=(0.0, 0.0, 0.0)):
    """Force and torque (6,) about `com` of rotors of strength `gain` (R,), arms off by `servo_zero` (A,)."""
    total = np.zeros(6)
    for r, arm in enumerate(vehicle.rotors.arm):
        angle = (tilt + servo_zero)[arm]
        outward, up = vehicle.arms.axis_B[arm], vehicle.arms.normal_B[arm]
        along = np.cos(angle) * up + np.sin(angle) * np.cross(outward, up)
        force = thrust[r] * np.broadcast_to(gain, len(thrust))[r] * along
        hub = vehicle.arms.position_B[arm] + vehicle.rotors.offset[r] * along
        drag = -vehicle.rotors.spin[r] * vehicle.rotors.kappa[r] * force
        total += np.concatenate((force, np.cross(hub - np.asarray(com), force) + drag))
    return total


def test_octorotor_in_roll_spreads_over_all_rotors():
    """In the middle of its range, rotors on one side go up alike: M = L a sum |sin g|; by least squares the outermost
    needs M max |sin g| / (L sum sin^2 g).
    """
    model = fixed(8, mass=8 * 0.5 * FULL / GRAVITY)
    azimuth = np.pi / 8 + np.pi / 4 * np.arange(8)
    wanted = np.array([0.0, 0.0, 4 * FULL, 2.0, 0.0, 0.0])
    best = 2.0 / (ARM * np.abs(np.sin(azimuth)).sum()) / (0.5 * FULL)
    plain = 2.0 * np.abs(np.sin(azimuth)).max() / (ARM * 4.0) / (0.5 * FULL)
    exact, usual, none = (
        Allocator(allocation_problem(model), rounds, calm=0.0).step(wanted) for rounds in (200, 10, 0)
    )
    assert exact.margin == pytest.approx(1.0 - best, abs=2e-3 * best)
    assert 1.0 - usual.margin <= 1.04 * best
    assert none.margin == pytest.approx(1.0 - plain, abs=1e-9)
    for one in (exact, usual, none):
        np.testing.assert_allclose(wrench_by_hand(model.vehicle, one.thrust, one.tilt), wanted, atol=1e-9)


def test_with_little_asked_for_the_pseudo_inverse_is_taken_and_near_the_limits_the_largest_margin():
    model = fixed(8, mass=8 * 0.5 * FULL / GRAVITY)
    problem, hover = allocation_problem(model), np.array([0.0, 0.0, 4 * FULL, 0.0, 0.0, 0.0])
    usual, plain, largest = Allocator(problem), Allocator(problem, rounds=0), Allocator(problem, calm=0.0)
    for roll, like, other in ((2.0, plain, largest), (6.0, largest, plain)):
        wanted = hover + np.array([0.0, 0.0, 0.0, roll, 0.0, 0.0])
        thrust = usual.step(wanted).thrust
        np.testing.assert_allclose(thrust, like.step(wanted).thrust, atol=1e-9)
        assert np.abs(thrust - other.step(wanted).thrust).max() > 0.1


def test_the_law_of_wakes_is_that_of_flight():
    """Of arms that tilt by 20 deg rms the straight line leaves less than a third of what nominal thrusts leave."""
    model = model_of(star(), rotor_interference=[0.2, 1.2])
    effects = list(model.effects)
    nominal, flown = allocation_problem(model, nominal=True), allocation_problem(model)
    wanted = demands(nominal, 60, np.random.default_rng(8))
    left = []
    for allocator in (Allocator(nominal), Allocator(flown)):
        out = [allocator.step(one) for one in wanted]
        made = made_by_model(nominal, effects, np.array([o.thrust for o in out]), np.array([o.tilt for o in out]))
        left.append(np.sqrt(np.mean((made - wanted) ** 2, axis=0)))
    assert (left[1] < 0.6 * left[0]).all()
    assert (left[1][2:5] < 0.33 * left[0][2:5]).all()


def test_octorotor_in_yaw_is_the_pseudo_inverse():
    """All rotors change by M / (R kappa): no other set is nearer to the middle."""
    model = fixed(8, mass=8 * 0.5 * FULL / GRAVITY)
    out = Allocator(allocation_problem(model)).step([0.0, 0.0, 4 * FULL, 0.0, 0.0, 0.3])
    change = 0.3 / (8 * KAPPA)
    np.testing.assert_allclose(out.thrust, 0.5 * FULL - model.vehicle.rotors.spin * change, rtol=1e-9)
    assert out.margin == pytest.approx(1.0 - change / (0.5 * FULL))


def test_a_hexarotor_with_a_weak_rotor_makes_the_wrench_with_nearly_the_largest_margin():
    """Against a linear programme: least m with |T - middle| <= m half and B T = W."""
    model, gain = weak(6, 2, 0.8), np.where(np.arange(6) == 2, 0.8, 1.0)
    azimuth = np.pi / 6 + np.pi / 3 * np.arange(6)
    B = gain * np.array([np.ones(6), ARM * np.sin(azimuth), -ARM * np.cos(azimuth), -KAPPA * model.vehicle.rotors.spin])
    allocator, rng = Allocator(allocation_problem(model), calm=0.0), np.random.default_rng(1)
    half, box = 0.5 * FULL, np.vstack((np.eye(6), -np.eye(6)))
    for _ in range(30):
        wanted = np.array([0.0, 0.0, 4.0 * GRAVITY, *(rng.uniform(-1.0, 1.0, 3) * [1.5, 1.5, 0.2])])
        cost = np.append(np.zeros(6), 1.0)
        limits = np.hstack((box, -half * np.ones((12, 1)))), np.concatenate((np.full(6, half), np.full(6, -half)))
        found = linprog(cost, *limits, np.hstack((B, np.zeros((4, 1)))), wanted[2:], bounds=(None, None))
        out = allocator.step(wanted)
        np.testing.assert_allclose(wrench_by_hand(model.vehicle, out.thrust, out.tilt, gain), wanted, atol=1e-9)
        assert out.status == MADE
        assert found.fun * (1.0 - 1e-9) <= 1.0 - out.margin <= 1.04 * found.fun


def test_margins_of_the_null_space():
    """A vehicle without one gains nothing; with one it keeps more, and makes what the pseudo-inverse cannot."""
    none, some = margins(allocation_problem(fixed(4))), margins(allocation_problem(weak(8, 0, 0.7)))
    assert none.spare == 0
    np.testing.assert_allclose(none.best, none.plain, atol=1e-9)
    assert some.spare == 4
    assert (some.best >= np.minimum(some.plain, 0.2) - 1e-3).all()  # with more the pseudo-inverse is taken
    assert (some.plain < 0.0).any()
    assert (some.best > -1e-9).all()
    assert some.best.mean() > some.plain.mean() + 0.02


def test_arms_that_tilt_with_a_weak_rotor_a_servo_zero_and_a_moved_centre():
    gain, zero, com = np.where(np.arange(12) == 3, 0.9, 1.0), 0.05 * (np.arange(6) == 1), (0.004, -0.006, 0.01)
    effects = {
        "rotor_thrust": {f"rotor_{r}": -0.1 * (r == 3) for r in range(12)},
        "tilt_offset": {f"arm_{a}": 0.05 * (a == 1) for a in range(6)},
        "com_offset": dict(zip("xyz", com, strict=True)),
    }
    model = model_of(star(), **effects)
    allocator, rng = Allocator(allocation_problem(model)), np.random.default_rng(2)
    for _ in range(30):
        wanted = rng.uniform(-1.0, 1.0, 6) * [15.0, 15.0, 8.0, 2.0, 2.0, 1.5] + [0, 0, 4.0 * GRAVITY, 0, 0, 0]
        out = allocator.step(wanted)
        assert out.status == MADE
        made = wrench_by_hand(model.vehicle, out.thrust, out.tilt, gain, zero, com)
        np.testing.assert_allclose(made, wanted, atol=1e-6)
        np.testing.assert_allclose(out.made, wanted, atol=1e-6)


def test_a_curved_thrust_law_is_asked_for_about_hover():
    """T = T_h (s^2 + 2 p (s - 1)): hover takes T_h as ever, a newton more takes 1 / (1 + p)."""
    model = fixed(4, thrust_curve={"slope": -0.3, "curvature": 0.0})
    allocator, weight = Allocator(allocation_problem(model)), 4.0 * GRAVITY
    hover, more = (allocator.step([0.0, 0.0, force, 0.0, 0.0, 0.0]).thrust for force in (weight, weight + 1.0))
    np.testing.assert_allclose(hover, weight / 4.0, rtol=5e-3)  # of a straight line through 30 % about it
    np.testing.assert_allclose(more - hover, 1.0 / 4.0 / 0.7, rtol=0.02)


def test_a_direction_that_is_only_an_error_is_not_asked_for():
    """A rotor that leans by a milliradian makes a force along x: a demand along x must not be paid for with it."""
    problem = allocation_problem(fixed(6))
    leaning = problem.wrench.copy()
    leaning[0, 0, 0] = 1e-3
    allocator = Allocator(replace(problem, wrench=leaning))
    thrusts = [allocator.step([x, 0.0, 4.0 * GRAVITY, 0.1, 0.0, 0.0]).thrust for x in (0.0, 5.0)]
    np.testing.assert_allclose(*thrusts, atol=1e-9)


def test_out_of_reach_yaw_is_given_up_first_then_all_of_it_towards_hover():
    model = fixed(8)
    allocator, hover = Allocator(allocation_problem(model)), np.array([0, 0, 4.0 * GRAVITY, 0, 0, 0])
    turned = allocator.step(hover + np.array([0, 0, 0, 1.0, -0.5, 3.0]))
    made = wrench_by_hand(model.vehicle, turned.thrust, turned.tilt)
    np.testing.assert_allclose(made[:5], (hover + np.array([0, 0, 0, 1.0, -0.5, 0.0]))[:5], atol=1e-9)
    assert 0.3 < made[5] < 8 * KAPPA * FULL / 2
    assert turned.status == REDUCED
    rolled = allocator.step(hover + np.array([0, 0, 5.0, 40.0, -20.0, 0.4]))
    made = wrench_by_hand(model.vehicle, rolled.thrust, rolled.tilt) - hover
    np.testing.assert_allclose(made[:5] / made[3], np.array([0, 0, 5.0, 40.0, -20.0]) / 40.0, atol=1e-9)
    assert 3.0 < made[3] < 40.0
    assert 0.0 <= made[5] < 0.4
    for one in (turned, rolled):
        assert one.margin == pytest.approx(0.0, abs=1e-9)
        assert (one.thrust >= 0.0).all()
        assert (one.thrust <= FULL).all()


@pytest.mark.parametrize("way", [(150.0, 20.0, 50.0, 15.0, -12.0, 10.0), (0.0, 0.0, 0.0, 30.0, 10.0, -2.0)])
def test_what_is_made_and_commanded_has_no_jump_at_the_end_of_reach(way):
    allocator = Allocator(allocation_problem(star_model()))
    ways = np.array([0, 0, 4.0 * GRAVITY, 0, 0, 0]) + np.linspace(0.0, 1.0, 8001)[:, None] * way
    out = [allocator.step(one) for one in ways]
    assert {one.status for one in out} == {MADE, REDUCED}
    assert np.abs(np.diff([one.thrust for one in out], axis=0)).max() < 0.02 * FULL
    assert np.abs(np.diff([one.made for one in out], axis=0)).max() < 0.5  # arms of 0.2 N that begin to turn


def star_model():
    return model_of(star())


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_demand_that_is_no_number_repeats_the_command_of_before(bad):
    allocator = Allocator(allocation_problem(star_model()))
    hover = allocator.step([0.0, 0.0, bad, 0.0, 0.0, 0.0])
    assert hover.status == BAD_DEMAND
    np.testing.assert_allclose(hover.thrust, 4.0 * GRAVITY / 12)
    before = allocator.step([3.0, -2.0, 45.0, 0.5, 0.2, 0.3])
    again = allocator.step([bad, 0.0, 40.0, 0.0, 0.0, 0.0])
    assert (again.status, again.margin) == (BAD_DEMAND, 0.0)
    for name in ("thrust", "tilt", "made"):
        np.testing.assert_array_equal(getattr(again, name), getattr(before, name))


def test_tilts_stay_within_their_range_and_beside_the_one_before():
    vehicle = star()
    few = replace(vehicle.arms, tilt_min=np.full(6, -0.5), tilt_max=np.full(6, 0.5))
    short = Allocator(allocation_problem(model_of(replace(vehicle, arms=few))))
    out = short.step([40.0, 0.0, 20.0, 0.0, 0.0, 0.0])
    assert out.status == REDUCED
    assert np.abs(out.tilt).max() == 0.5
    np.testing.assert_allclose(wrench_by_hand(vehicle, out.thrust, out.tilt), out.made, atol=1e-9)
    wide = replace(vehicle.arms, tilt_min=np.full(6, -1e7), tilt_max=np.full(6, 1e7))
    free = Allocator(allocation_problem(model_of(replace(vehicle, arms=wide))))
    way = [free.step([0.0, 30.0 * np.sin(a), 30.0 * np.cos(a), 0.0, 0.0, 0.0]).tilt for a in np.linspace(0, 13, 900)]
    assert np.abs(np.diff(way, axis=0)).max() < 0.5  # over two turns without a jump


def test_a_vehicle_that_cannot_hover_as_flown_is_refused():
    with pytest.raises(ModelError, match="cannot hover within its own limits as flown: a rotor would need"):
        Allocator(allocation_problem(fixed(4, mass=5.0)))


@pytest.mark.parametrize("upset", [1e5, -1e12, 1e300, np.inf, np.nan])
def test_an_arm_that_no_arm_can_have_wound_to_is_forgotten(upset):
    vehicle = star()
    free = replace(vehicle.arms, tilt_min=np.full(6, -np.inf), tilt_max=np.full(6, np.inf))
    allocator = Allocator(allocation_problem(model_of(replace(vehicle, arms=free))))
    demand = [3.0, -2.0, 45.0, 0.5, 0.2, 0.3]
    fresh = allocator.step(demand)
    allocator.reset(np.full(6, upset))
    allocator.step(demand)
    again = allocator.step(demand)
    np.testing.assert_allclose(again.tilt, fresh.tilt, atol=1e-6)
    np.testing.assert_allclose(again.thrust, fresh.thrust, atol=1e-6)
    allocator.reset(np.full(6, 20.0 * np.pi))  # ten turns are ten turns
    assert np.abs(allocator.step(demand).tilt - 20.0 * np.pi - fresh.tilt).max() < 1e-6
