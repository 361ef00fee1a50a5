"""Rotations of many rows: what turns back and forth, and the same in blocks as at once."""

import numpy as np
import pytest

from wrenchgap.flight import so3
from wrenchgap.flight.so3 import BLOCK


@pytest.fixture
def rows():
    """Attitudes, others, and vectors: more than a block."""
    rng = np.random.default_rng(0)
    quats = [so3.normalise(rng.normal(size=(BLOCK + 5, 4))) for _ in range(2)]
    quats[1][3] = quats[0][3]
    return *quats, rng.normal(size=(BLOCK + 5, 3))


def in_pieces(function, *arrays):
    """The function in pieces that are less than a block."""
    return np.concatenate([function(*(a[k : k + 1000] for a in arrays)) for k in range(0, len(arrays[0]), 1000)])


def test_a_quarter_turn_about_z_takes_x_to_y_and_back():
    """Right-handed, from B to E; of two turns the right one is first: x to y about z, then y to z about x."""
    about_z, about_x = (so3.exp(0.5 * np.pi * axis) for axis in (np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])))
    x, y, z = np.eye(3)
    np.testing.assert_allclose(so3.rotate(about_z, x), y, atol=1e-15)
    np.testing.assert_allclose(so3.rotate_inverse(about_z, y), x, atol=1e-15)
    np.testing.assert_allclose(so3.matrix(about_z) @ x, y, atol=1e-15)
    np.testing.assert_allclose(so3.rotate(so3.multiply(about_x, about_z), x), z, atol=1e-15)
    np.testing.assert_allclose(so3.log(about_z), 0.5 * np.pi * z, atol=1e-15)


def test_vectors_are_turned_to_the_same_bits(rows):
    p, _, v = rows
    np.testing.assert_array_equal(so3.rotate(p, v), in_pieces(so3.rotate, p, v))
    np.testing.assert_array_equal(so3.rotate_inverse(p, v), in_pieces(so3.rotate_inverse, p, v))
    np.testing.assert_allclose(so3.rotate_inverse(p, so3.rotate(p, v)), v, atol=1e-14)


def test_logarithms_of_many_rows_are_those_of_few(rows):
    p, q, _ = rows
    np.testing.assert_allclose(so3.log(p), in_pieces(so3.log, p), rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(
        so3.rotation_between(p, q), in_pieces(so3.rotation_between, p, q), rtol=1e-13, atol=1e-15
    )
    np.testing.assert_allclose(so3.rotation_between(p, q)[3], 0.0, atol=1e-15)
    turned = so3.multiply(p, so3.exp(so3.rotation_between(p, q)))
    np.testing.assert_allclose(np.abs(np.sum(turned * q, axis=1)), 1.0, atol=1e-14)  # p exp(log(p^-1 q)) is q


def test_signs_are_made_continuous_over_all_rows(rows):
    smooth = so3.exp(np.linspace(0.0, 9.0, BLOCK + 5)[:, None] * np.array([0.6, 0.0, 0.8]))
    flipped = smooth * np.where(np.random.default_rng(1).random(len(smooth)) < 0.5, -1.0, 1.0)[:, None]
    found = so3.continuous(flipped)
    np.testing.assert_array_equal(found, so3.continuous(smooth) * np.sign(np.sum(found[0] * smooth[0])))
    assert np.sum(found[1:] * found[:-1], axis=1).min() > 0.0


def test_attitudes_between_knots_are_the_same_in_any_order(rows):
    p, _, _ = rows
    knots = np.arange(len(p)) * 0.01
    time = np.random.default_rng(2).uniform(-0.1, knots[-1] + 0.1, len(p))
    time[:2] = knots[[0, -1]]
    expected = np.concatenate([so3.interpolate(time[k : k + 999], knots, p) for k in range(0, len(time), 999)])
    for order in (slice(None), np.argsort(time)):
        np.testing.assert_allclose(so3.interpolate(time[order], knots, p), expected[order], atol=1e-14)


def test_one_attitude_is_everywhere_without_a_warning():
    one = so3.exp(np.array([[0.3, -0.2, 0.9]]))
    with np.errstate(all="raise"):
        np.testing.assert_array_equal(so3.interpolate(np.array([-1.0, 0.5, 2.0]), np.array([0.5]), one), one[[0, 0, 0]])
