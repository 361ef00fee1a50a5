"""What holds for every effect: zero is nothing, one step at a time is all at once, order is nothing."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.plant.effects import catalogue, find, part_effects
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.state import Motion
from wrenchgap.plant.wrench_model import WrenchModel

MOVING = {"velocity": (1, -2, 0.5), "omega": (0.3, -0.2, 0.5)}
every = pytest.mark.parametrize("name", list(catalogue()))


def typical(bench, name):
    """Values of about a typical size, inside the plausible range."""
    parameters = find(name).parameters(bench.vehicle)
    factors = np.random.default_rng(1).uniform(0.5, 1.0, len(parameters))
    return np.array([np.clip(p.scale * f, p.low, p.high) for p, f in zip(parameters, factors, strict=True)])


@every
def test_zero_is_no_effect_and_typical_values_are_one(bench, name):
    """Air that moves is one together with a drag: it has no force of its own."""
    u, x, values = bench.wandering(60), bench.state(60, **MOVING), typical(bench, name)
    beside = (make_effect(bench.vehicle, "rotor_drag", [1e-4]),) if find(name).place == "air" else ()
    models = [WrenchModel(bench.vehicle, beside)]
    models += [WrenchModel(bench.vehicle, (*beside, make_effect(bench.vehicle, name, v))) for v in (0 * values, values)]
    nominal, zero, changed = (m.predict(u, x, bench.dt) for m in models)
    np.testing.assert_allclose(zero, nominal, atol=1e-9)
    assert np.abs(changed - nominal).max() > (0.0 if name == "rotor_interference" else 1e-3)


@every
def test_step_by_step_is_all_at_once(bench, name):
    """Simulation (N = 1, memory carried) and identification (N samples) are one function."""
    u, x = bench.wandering(80), bench.state(80, **MOVING)
    m = bench.model(name, typical(bench, name))
    memory, rows = None, []
    for k in range(80):
        one = slice(k, k + 1)
        wrench, memory = m.actuate(u.take(one), x.take(one), bench.dt, memory)
        rows.append(wrench[0])
    np.testing.assert_allclose(np.array(rows), m.actuate(u, x, bench.dt)[0], atol=1e-9)


@every
def test_names_its_source_and_units(bench, name):
    """What else an effect says of itself is checked in tests/plant/test_own_effects.py."""
    assert "Source:" in (type(find(name)).__doc__ or "")
    assert all(p.unit for p in find(name).parameters(bench.vehicle))


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize(
    ("name", "theta"),
    [("axial_inflow", [2e-4]), ("rotor_drag", [2e-4]), ("rotational_drag", [0.02, 0.03, 0.04, 0.03])],
)
def test_drag_damps_any_motion(bench, seed, name, theta):
    x, u = bench.moving(seed)
    assert bench.power(bench.added(name, theta, u, x), x) < 0


def test_order_of_adding_does_not_matter(bench):
    names = ["tilt_offset", "servo_lag", "command_delay", "com_offset", "rotor_thrust", "coaxial_loss", "body_drag"]
    u, x = bench.wandering(60), bench.state(60, **MOVING)
    made = [make_effect(bench.vehicle, n, typical(bench, n)) for n in names]
    forward, backward = (WrenchModel(bench.vehicle, tuple(e)).predict(u, x, bench.dt) for e in (made, made[::-1]))
    np.testing.assert_array_equal(forward, backward)


def test_without_effects_the_command_is_what_is_measured(bench):
    """Whatever the body rate."""
    u, x = bench.wandering(30), bench.state(30, omega=(0.5, -1.0, 0.7))
    np.testing.assert_allclose(bench.model().predict(u, x, bench.dt), bench.model().wrench(u, x), atol=1e-9)


def test_without_sensor_effects_the_imu_reads_the_motion(bench):
    motion = Motion(np.ones((2, 3)), np.ones((2, 3)), np.ones((2, 3)))
    assert bench.model().read_imu(motion, bench.state(2)) is motion


ADDED = sorted(n for n, e in {**catalogue(), **part_effects()}.items() if e.place == "wrench")


def evaluated(bench, name, theta, seed, *, thrust=1.0, speed=1.0, tilt=0.0):
    """The wrench that an effect adds in a random state, at so many times the thrusts or speeds, arms tilted further."""
    state, commands = bench.moving(seed)
    model = bench.model(name, {})
    act, rotors = model.rotors(commands, state, model.rates(commands, bench.dt)[0])
    act = replace(act, tilt=act.tilt + tilt, rotor_speed=speed * act.rotor_speed, thrust=thrust * act.thrust)
    return model.addition(replace(model.effects[0], theta=theta), act, thrust * rotors, state)


@pytest.mark.parametrize("name", ADDED)
def test_a_linear_effect_adds_the_sum_of_what_its_parameters_add(bench, name):
    own = find(name)
    size = len(own.parameters(bench.vehicle))
    theta = np.random.default_rng(3).normal(size=size)
    each = [t * evaluated(bench, name, unit, 1) for t, unit in zip(theta, np.eye(size), strict=True)]
    whole = evaluated(bench, name, theta, 1)
    assert own.linear == np.allclose(whole, sum(each), rtol=1e-9, atol=1e-12 * np.abs(whole).max())


@pytest.mark.parametrize("name", ADDED)
def test_an_effect_depends_on_no_more_than_it_says(bench, name):
    """A search does not evaluate it again where only thrusts, or what actuators do, are others."""
    own = find(name)
    theta = np.random.default_rng(4).normal(size=len(own.parameters(bench.vehicle)))
    usual = evaluated(bench, name, theta, 2)
    if own.depends_on != "thrusts":
        assert np.array_equal(evaluated(bench, name, theta, 2, thrust=1.3), usual)
    if own.depends_on == "state":
        assert np.array_equal(evaluated(bench, name, theta, 2, speed=0.7, tilt=0.2), usual)
