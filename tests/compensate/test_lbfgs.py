"""Corrections against solutions found on paper."""

from dataclasses import dataclass
from unittest.mock import Mock

import nlopt
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import approx_fprime

from wrenchgap.compensate.lbfgs import Optimiser, _Search
from wrenchgap.flight.flight import AXES
from wrenchgap.plant.mismatch import LinearMismatch

TORQUES = ("torque_x", "torque_y", "torque_z")
HOVER = np.array([0.0, 0.0, 39.0, 0.1, -0.2, 0.3])
FREE = np.full(6, np.inf)


@dataclass(frozen=True)
class Formula:
    """A mismatch in the three torques, given as a function of the torques, with its derivative by hand."""

    function: object
    slope: object
    outputs: tuple[str, ...] = TORQUES

    def mean(self, wrench):
        return np.array([self.function(row[3:]) for row in wrench])

    def std(self, wrench):
        return np.full((len(wrench), 3), 0.1)

    def jacobian(self, wrench):
        jacobian = np.zeros((len(wrench), 3, 6))
        jacobian[:, :, 3:] = [self.slope(row[3:]) for row in wrench]
        return jacobian


def squash(scale):
    """mu = scale tanh(M), torque by torque: a contraction for |scale| < 1."""
    return Formula(lambda m: scale * np.tanh(m), lambda m: np.diag(scale / np.cosh(m) ** 2))


def line(gain, offset, outputs=TORQUES):
    return LinearMismatch(outputs, offset, gain, np.full(len(outputs), 0.1))


def solve(model, wrench=HOVER, bound=FREE, start=None, **options):
    return Optimiser(-bound, bound, **options).solve(model, wrench, np.zeros(6) if start is None else start)


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.sampled_from([TORQUES, AXES, ("torque_z", "torque_x")]))
def test_linear_mismatch_has_a_closed_form(seed, outputs):
    """W_des = (1 + G) W_cmd + b in the outputs; what is no output is left alone."""
    rng, rows = np.random.default_rng(seed), [AXES.index(axis) for axis in outputs]
    gain, offset, wrench = 0.2 * rng.normal(size=(len(rows), 6)), rng.normal(size=len(rows)), rng.normal(size=6)
    slope = np.eye(len(rows)) + gain[:, rows]
    found = solve(line(gain, offset, outputs), wrench)
    if np.linalg.cond(slope) < 30:
        assert found.accepted
        assert found.correction[rows] == pytest.approx(-np.linalg.solve(slope, offset + gain @ wrench), abs=1e-3)
    assert (np.delete(found.correction, rows) == 0).all()


@pytest.mark.parametrize("scale", [-0.9, 0.5, 0.9])
def test_contraction_ends_at_its_fixed_point(scale):
    expected = np.zeros(3)
    for _ in range(500):
        expected = -scale * np.tanh(HOVER[3:] + expected)
    found = solve(squash(scale))
    assert found.accepted
    assert found.correction[3:] == pytest.approx(expected, abs=1e-4)


def test_expansion_is_solved_where_iteration_diverges():
    """mu = 3 tanh(M): W_des = M + 3 tanh(M) has one root, but dW <- -mu(W_des + dW) does not find it."""
    found = solve(squash(3.0))
    command = HOVER[3:] + found.correction[3:]
    assert found.accepted
    assert command + 3 * np.tanh(command) == pytest.approx(HOVER[3:], abs=1e-4)


def test_no_solution_is_not_accepted():
    """Slope -1: the measured torque is c whatever is commanded, so no correction makes it W_des."""
    constant = np.array([0.5, 0.0, 0.0])
    model = line(np.hstack([np.zeros((3, 3)), -np.eye(3)]), constant)
    found = solve(model)
    assert not found.accepted
    assert found.cost == pytest.approx(np.sum((constant - HOVER[3:]) ** 2))
    assert found.correction == pytest.approx(np.zeros(6), abs=1e-9)


def test_saturating_plant_is_taken_as_far_as_it_goes():
    """A plant that gives tanh(M) < 1 cannot give 1.5; the correction is still better than none."""
    model = Formula(lambda m: np.tanh(m) - m, lambda m: np.diag(1 / np.cosh(m) ** 2 - 1))
    wrench = np.array([0, 0, 39, 1.5, 0, 0])
    found = solve(model, wrench, np.full(6, 4.0))
    assert not found.accepted
    assert 0.25 < found.cost < (np.tanh(1.5) - 1.5) ** 2
    assert found.correction[3] > 1


def test_bounds_hold():
    bound = np.array([0, 0, 0, 0.1, 1, 1])
    found = solve(line(np.zeros((3, 6)), np.array([0.4, 0.2, 0.0])), bound=bound)
    assert not found.accepted
    assert found.correction == pytest.approx([0, 0, 0, -0.1, -0.2, 0], abs=1e-9)
    assert found.cost == pytest.approx(0.3**2)


@settings(max_examples=40)
@given(st.integers(0, 10_000), st.floats(-3, 3))
def test_never_worse_than_no_correction(seed, scale):
    rng = np.random.default_rng(seed)
    model, wrench, bound = squash(scale), 2 * rng.normal(size=6), rng.uniform(0, 1, 6)
    found = solve(model, wrench, bound, start=rng.uniform(-1, 1, 6) * bound)
    without = np.sum(model.mean(wrench[None])[0] ** 2)
    rounding = np.sum((4 * np.finfo(float).eps * wrench) ** 2)  # of a mismatch that is hardly there
    assert found.cost <= without * (1 + 1e-12) + rounding
    assert (np.abs(found.correction) <= bound + 1e-12).all()
    with_correction = model.mean((wrench + found.correction)[None])[0] + found.correction[3:]
    assert found.cost == pytest.approx(np.sum(with_correction**2))


@pytest.mark.parametrize("regulariser", [0.0, 0.3])
def test_gradient_is_the_derivative_of_the_cost(regulariser):
    search = _Search(squash(-1.7), HOVER, np.array([3, 4, 5]), regulariser)
    point, gradient, nothing = np.array([0.3, -0.6, 0.2]), np.zeros(3), np.zeros(0)
    search.objective(point, gradient)
    assert gradient == pytest.approx(approx_fprime(point, search.objective, 1e-7, nothing), rel=1e-5)


def test_regulariser_shrinks_torque_but_no_force_and_is_left_out_of_the_cost():
    """min (b + d)^2 + w d^2 is at d = -b / (1 + w), where J = (b w / (1 + w))^2."""
    offset, weight = np.array([0.4, 0.0, 0.0]), 0.25
    found = solve(line(np.zeros((3, 6)), offset), regulariser=weight)
    assert found.correction[3] == pytest.approx(-0.4 / (1 + weight), abs=1e-6)
    assert found.cost == pytest.approx((0.4 * weight / (1 + weight)) ** 2, rel=1e-5)
    found = solve(line(np.zeros((1, 6)), np.array([3.0]), ("force_z",)), regulariser=0.25)
    assert found.correction[2] == pytest.approx(-3.0, abs=1e-5)


def test_warm_start_saves_evaluations():
    model, cold, warm, start = squash(2.0), 0, 0, np.zeros(6)
    for time in np.linspace(0, 1, 50):
        wrench = HOVER + np.array([0, 0, 0, *np.sin([time, 2 * time, 3 * time])])
        first, again = solve(model, wrench), solve(model, wrench, start=start)
        assert first.accepted
        assert again.accepted
        cold, warm, start = cold + first.iterations, warm + again.iterations, again.correction
    assert warm < 0.8 * cold


def test_bad_start_is_rescued_from_zero():
    """A plateau away from zero (a saturated command) has no slope to follow; the search starts again from zero."""
    model = Formula(lambda m: np.where(m > 1.0, 0.5 - m, 0.3), lambda m: np.diag(np.where(m > 1.0, -1.0, 0.0)))
    found = solve(model, start=np.array([0, 0, 0, 3.0, 0, 0]))
    assert found.accepted
    assert found.correction[3:] == pytest.approx(np.full(3, -0.3), abs=1e-4)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_model_that_gives_nonsense_gives_no_correction(value):
    found = solve(Formula(lambda m: m * value, lambda m: np.eye(3)))
    assert (found.correction == 0).all()
    assert not found.accepted
    assert "not finite" in found.trouble
    assert "\n" not in found.trouble


def test_solver_that_fails_is_not_the_loops_problem(monkeypatch):
    monkeypatch.setattr("nlopt.opt.optimize", Mock(side_effect=RuntimeError("nlopt failure")))
    found = solve(squash(0.5))
    assert (found.correction == 0).all()
    assert "nlopt failure" in found.trouble


def test_errors_of_nlopts_own_classes_are_caught_too():
    """A Jacobian of the wrong sign: the search steps uphill and nlopt raises what is no RuntimeError of Python."""
    found = solve(Formula(lambda m: 0.1 * np.tanh(m) + 0.3, lambda m: -4.0 * np.eye(3)), bound=np.full(6, 5.0))
    assert "stopped early" in found.trouble
    assert not found.accepted
    assert np.isfinite(found.cost)


def test_search_that_gives_up_late_keeps_its_best_point(monkeypatch):
    finish = nlopt.opt.optimize

    def give_up(self, start):
        finish(self, start)
        raise nlopt.RoundoffLimited("roundoff")

    monkeypatch.setattr("nlopt.opt.optimize", give_up)
    found = solve(squash(0.5))
    assert found.accepted
    assert "stopped early" in found.trouble


def test_an_interrupt_is_not_taken_for_a_failed_search():
    """Ctrl-C inside nlopt's callback stops the program; it does not become a correction."""
    interrupt = Mock(side_effect=KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt):
        solve(Formula(interrupt, interrupt), bound=np.ones(6))
