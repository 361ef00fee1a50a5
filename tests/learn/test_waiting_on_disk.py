"""What a search asks for now and then waits on disk where it is large: the same digits, and not resident."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight import memory
from wrenchgap.learn.data.candidates import Candidates
from wrenchgap.learn.identify import fit
from wrenchgap.learn.posterior import columns, spectrum
from wrenchgap.learn.posterior import single_effects as tables
from wrenchgap.learn.posterior.explain import search_dataset
from wrenchgap.learn.posterior.relinearisation import joint_columns, spectrum_of
from wrenchgap.learn.posterior.single_effects import model_residual, single_effects
from wrenchgap.plant.wrench_model import WrenchModel

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="madvise is Linux's")

NAMES = ("mass", "com_offset", "servo_lag", "rotor_thrust")


@pytest.fixture
def large(monkeypatch):
    """From here on everything counts as large."""

    def call():
        for module in (fit, columns, tables):
            monkeypatch.setattr(module, "MANY", 1)
        monkeypatch.setattr(spectrum, "LARGE", 0)
        monkeypatch.setattr(memory, "SMALL", 1)

    return call


def numbers(space):
    """Products, coefficients and a sum of them, after some blocks were calmed."""
    weights = space.saturated()[1]
    space.down_weight(np.linspace(0.5, 1.0, space.blocks))
    return space.products, np.array(space.coefficients), space.combined(weights)


@pytest.mark.parametrize("answering", [(), (3, 4)])
def test_spectra_and_columns_on_disk_have_the_same_digits(plain, hexarotor, large, answering):
    def made():
        on = model_residual(replace(plain, answering=answering), hexarotor)
        found = single_effects(on, NAMES, twice=True)
        starts = {names: derivative for names, (_, _, derivative) in on.data.starts.items()}
        return found, starts, spectrum_of(on, found.columns)

    found, starts, space = made()
    large()
    again, others, other = made()
    kept = [again.columns[0].jacobian, again.columns[-1].offset, again.candidates[0].residual]
    assert all(memory._is_mapped(values) for values in (*kept, *others.values(), other.coefficients))
    assert not any(memory._is_mapped(c.jacobian) for c in found.columns)
    for one, two in zip(found.columns, again.columns, strict=True):
        np.testing.assert_array_equal(one.jacobian, two.jacobian)
        np.testing.assert_array_equal(one.offset, two.offset)
    for one, two in zip(found.candidates, again.candidates, strict=True):
        np.testing.assert_array_equal(one.residual, two.residual)
    for names, derivative in starts.items():
        np.testing.assert_array_equal(derivative, others[names])
    for one, two in zip(numbers(space), numbers(other), strict=True):
        np.testing.assert_array_equal(one, two)


def test_a_search_on_disk_gives_the_same_answer(plain, hexarotor, large):
    def made():
        return search_dataset(replace(plain, answering=(3, 4)), hexarotor, Candidates(NAMES, ()))

    one = made()
    large()
    two = made()
    assert one.effects == two.effects
    np.testing.assert_array_equal(one.fit.theta, two.fit.theta)
    assert [s.weight for s in one.posterior.sets] == [s.weight for s in two.posterior.sets]


def test_a_set_is_linearised_anew_from_columns_without_samples(plain, hexarotor):
    """Which of them bends most is all that is asked of their offsets."""
    on = model_residual(replace(plain), hexarotor)
    members = single_effects(on, ("mass", "servo_lag")).columns
    theta = [c.theta for c in members]
    bare = [c.without_samples() for c in members]
    assert all(c.jacobian.size == 0 and c.offset.shape == (1, 6) for c in bare)
    for one, two in zip(joint_columns(on, members, theta), joint_columns(on, bare, theta), strict=True):
        np.testing.assert_array_equal(one.jacobian, two.jacobian)
        np.testing.assert_array_equal(one.offset, two.offset)


def test_what_evaluators_forget_is_worked_out_again(plain, hexarotor):
    data, model = replace(plain), WrenchModel(hexarotor.vehicle, ())
    before = data.predict(model)
    evaluator = data.evaluators[0]
    assert evaluator._rotors
    data.forget()
    assert not any((evaluator._commands, evaluator._rotors, evaluator._added, evaluator._postures, evaluator._nominal))
    np.testing.assert_array_equal(data.predict(model), before)
