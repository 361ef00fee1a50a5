"""What is written down of an effect must be what the effect does, with the derivatives that calculus gives."""

import math

import numpy as np
import pytest

from wrenchgap.compensate import PhysicsMismatch
from wrenchgap.compensate.fast import tape_of
from wrenchgap.compensate.physics import trace, untraceable
from wrenchgap.compensate.tables import rows_of
from wrenchgap.flight import so3
from wrenchgap.flight.flight import AXES
from wrenchgap.plant import model_file
from wrenchgap.plant.effects import catalogue
from wrenchgap.plant.effects.effect import SensorEffect
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.state import State
from wrenchgap.plant.trace.arrays import Node, Traced, Untraceable
from wrenchgap.plant.trace.operations import Op
from wrenchgap.plant.trace.tape import Tape, differentiate, evaluate, program

MODEL = model_file.load("voliro_x")
WEIGHT = MODEL.vehicle.body.mass * 9.80665
DT = 0.005
EXACT = sorted(n for n, e in catalogue().items() if not isinstance(e, SensorEffect))


def at(x, function):
    """Value and derivative, by a tape, of a function of one number."""
    tape = Tape()
    line = tape.input("x")
    found = function(Traced.of([Node(tape, line)]))
    lines = tape_of(program(tape, [line], [line], [found[0].line]), 1)
    lines.value[lines.inputs[0]] = x
    evaluate(lines, 0, lines.split)
    differentiate(lines)
    return lines.value[lines.results[0]], lines.tangent[lines.results[0], 0]


@pytest.mark.parametrize(
    ("function", "slope"),
    [
        (lambda x: x * x * x - 2.0 / x, lambda x: 3 * x * x + 2 / x**2),
        (np.exp, math.exp),
        (np.sqrt, lambda x: 0.5 / math.sqrt(x)),
        (np.sin, math.cos),
        (np.cos, lambda x: -math.sin(x)),
        (lambda x: np.arctan2(x, 2.0 - x), lambda x: 2.0 / (x * x + (2 - x) ** 2)),
        (lambda x: np.hypot(x, 3.0), lambda x: x / math.hypot(x, 3.0)),
        (lambda x: np.maximum(x, 0.5) * np.minimum(x, 0.5), lambda x: 0.5),
        (lambda x: np.where(x > 0.3, x**2, -x), lambda x: 2 * x if x > 0.3 else -1),
        (lambda x: x**1.5, lambda x: 1.5 * math.sqrt(x)),
        (lambda x: (x - 1.0) ** 5, lambda x: 5.0 * (x - 1.0) ** 4),
        (lambda x: (x - 1.0) ** -3, lambda x: -3.0 * (x - 1.0) ** -4),
        (lambda x: np.log(x), lambda x: 1.0 / x),
        (lambda x: np.sign(x) * np.abs(-x), lambda x: 1.0),
        (lambda x: np.clip(x, 0.0, 1.0) - np.floor(x), lambda x: 1.0),
    ],
)
@pytest.mark.parametrize("x", [0.2, 0.7])
def test_derivatives_are_those_of_calculus(function, slope, x):
    value, derivative = at(x, function)
    assert value == pytest.approx(float(np.asarray(function(np.array([x]))).item()), rel=1e-14)
    assert derivative == pytest.approx(slope(x), rel=1e-13)


def test_what_is_constant_or_there_already_is_not_written():
    tape = Tape()
    x = tape.input("x")
    two, zero = tape.constant(2.0), tape.constant(0.0)
    assert tape.write(Op.MUL, two, two) == tape.constant(4.0)
    assert tape.write(Op.ADD, x, zero) == x
    assert tape.write(Op.SUB, x, x) == zero
    assert tape.write(Op.ADD, x, two) == tape.write(Op.ADD, two, x)


def test_code_that_decides_by_a_value_is_refused():
    tape = Tape()
    x = Traced.of([Node(tape, tape.input("x"))])
    for decides in (lambda: bool(np.greater(x, 1.0)[0]), lambda: float(x[0]), lambda: np.arcsinh(x)):
        with pytest.raises(Untraceable):
            decides()


def states(count, seed=3):
    rng = np.random.default_rng(seed)
    return State(
        time=np.linspace(10.0, 20.0, count),
        position_E=rng.uniform(-1, 1, (count, 3)) + np.array([0.0, 0.0, 1.3]),
        quat_EB=so3.exp(rng.normal(size=(count, 3)) * 0.6),
        velocity_E=rng.normal(size=(count, 3)) * 2.0,
        omega_B=rng.normal(size=(count, 3)),
        voltage=np.linspace(16.0, 14.0, count),
    )


def commands(count, seed=4):
    spread = np.array([12.0, 12.0, 8.0, 0.6, 0.6, 0.4])
    return np.array([0, 0, WEIGHT, 0, 0, 0]) + spread * np.random.default_rng(seed).uniform(-1, 1, (count, 6))


def physics(name, lead):
    effect = make_effect(MODEL.vehicle, name, {})
    asked = effect.effect.parameters(MODEL.vehicle)
    values = [p.low + (0.35 + 0.02 * k) * (p.high - p.low) for k, p in enumerate(asked)]
    values = [0.4 * v if name in ("inertia", "rotor_thrust", "wind") else v for v in values]
    return PhysicsMismatch(MODEL.with_effects([make_effect(MODEL.vehicle, name, values)]).wrench_model, AXES, lead)


def stepped(mismatch, count=12):
    """The mismatch (K, 6) and its slope step by step: of plain arrays, and of the program with its tangents."""
    programs, follower = trace(mismatch, DT), mismatch.follow(DT)
    mean, sent = tape_of(programs.mismatch, 6), tape_of(programs.sent, 6)
    memory, fresh = np.zeros(programs.arms + programs.memory), 1.0
    every = states(count)
    rows, wrenches = rows_of(every), commands(count)
    plain, written, slopes = [], [], []
    for k, wrench in enumerate(wrenches):
        here = follower.model_at(every.take(slice(k, k + 1)))
        inputs = np.concatenate((wrench, rows[k], [fresh], memory))
        for lines in (mean, sent):
            lines.value[lines.inputs] = inputs
            evaluate(lines, 0, len(lines.code))
        differentiate(mean)
        plain.append(here.mean(wrench[None])[0])
        written.append(mean.value[mean.results].copy())
        slopes.append((mean.tangent[mean.results].copy(), here.jacobian(wrench[None])[0]))
        follower.record(wrench)
        memory, fresh = sent.value[sent.results].copy(), 0.0
    return np.array(plain), np.array(written), slopes


@pytest.mark.parametrize("lead", [None, 0.033])
@pytest.mark.parametrize("name", EXACT)
def test_program_of_every_effect_is_the_effect(name, lead):
    """Step by step, with what follows late, in arbitrary attitudes and motion. Newtons and newton metres."""
    mismatch = physics(name, lead)
    if name == "asymmetric_motor_lag" and lead is not None:
        assert list(untraceable(mismatch, DT)) == [name]
        return
    plain, written, slopes = stepped(mismatch)
    assert written == pytest.approx(plain, abs=1e-10)
    for tangent, difference in slopes:
        assert np.median(np.abs(tangent - difference)) < 2e-3  # forward differences, which kinks disturb


def test_lever_arm_has_the_slope_of_a_cross_product():
    """d(-c x F)/dF = -hat(c), to rounding."""
    offset = np.array([0.004, -0.007, 0.005])
    made = make_effect(MODEL.vehicle, "com_offset", offset)
    programs = trace(PhysicsMismatch(MODEL.with_effects([made]).wrench_model, AXES), DT)
    lines = tape_of(programs.mismatch, 6)
    lines.value[lines.inputs] = np.concatenate((commands(1)[0], rows_of(states(1))[0], np.zeros(7)))
    evaluate(lines, 0, lines.split)
    differentiate(lines)
    assert lines.tangent[lines.results][3:, :3] == pytest.approx(np.cross(np.eye(3), offset).T, abs=1e-12)
