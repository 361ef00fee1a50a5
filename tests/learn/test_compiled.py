"""What is compiled computes what its plain form does: numpy's and scipy's own solvers are the measure."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.signal import butter, sosfiltfilt

from wrenchgap.learn.data.measurement import low_pass
from wrenchgap.learn.identify.trim import trim_of
from wrenchgap.learn.posterior import compiled, score
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.hunt import Hunt
from wrenchgap.learn.posterior.spectrum import Spectrum

RNG = np.random.default_rng


def problem(seed, size=9):
    """Curvature, gradient, bounds, sizes and sparsity of a quadratic whose optimum lies partly outside its bounds."""
    rng = RNG(seed)
    scale = 10.0 ** rng.uniform(-4, 1, size)
    root = rng.normal(size=(3 * size, size)) / scale
    truth = scale * rng.normal(size=size)
    return root, root @ truth + rng.normal(size=3 * size), -0.5 * scale, 0.5 * scale, scale, rng.random(size) < 0.4


@pytest.mark.parametrize("seed", range(6))
def test_bounded_least_squares_is_scipys(seed):
    """|R x - y|^2 + |x / scale|^2 within bounds: against lsq_linear's stacked problem in units of the sizes."""
    root, y, low, high, scale, _ = problem(seed)
    found = compiled.bounded(root.T @ root, root.T @ y, low, high, scale)
    stacked = np.vstack((root * scale, np.eye(len(scale))))
    best = lsq_linear(stacked, np.append(y, np.zeros(len(scale))), (low / scale, high / scale), method="bvls")
    np.testing.assert_allclose(found / scale, best.x, atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_sizes_and_widths_are_those_of_the_plain_form(seed):
    root, y, low, high, scale, sparse = problem(seed)
    A, b = root.T @ root, root.T @ y
    sizes = compiled.relevant(A, b, low, high, scale, sparse, scale)
    np.testing.assert_allclose(sizes, score.relevant(A, b, low, high, scale, sparse, scale), rtol=1e-9)
    theta = compiled.bounded(A, b, low, high, sizes)
    np.testing.assert_allclose(theta, score.bounded(A, b, low, high, sizes), atol=1e-9 * scale.max())
    assert compiled.occam(A, theta, sizes) == pytest.approx(score.occam(A, theta, sizes), rel=1e-10)


@pytest.fixture
def hunt(plain, hexarotor):
    """On a flight's grid, four effects of two to three parameters each, two of them the same but for a little."""
    rng = RNG(5)
    smooth = np.cumsum(rng.normal(size=(len(plain.measured), 12)), axis=0)
    smooth = (smooth - smooth.mean(axis=0)) / smooth.std(axis=0)
    columns = []
    for k, (name, axis) in enumerate((("mass", 2), ("com_offset", 2), ("inertia", 3), ("tether", 4))):
        jacobian = np.zeros((len(smooth), 6, 3))
        jacobian[:, axis] = smooth[:, 3 * k : 3 * k + 3]
        one = np.ones(3)
        offset = 0.1 * jacobian[:, :, 0] ** 2
        limits = (-one, one, one, np.array([name == "tether"] * 3))
        columns.append(Column((name,), 0 * one, 0 * one, offset, jacobian, *limits, 0.05))
    left = sum(c.jacobian @ [0.4, -0.8, 0.1] for c in columns[:3]) + plain.noise * rng.normal(size=(len(smooth), 6))
    space = Spectrum(plain, left, columns, trim_of(hexarotor))
    scorer = score.Scorer(space, space.sensor)
    return Hunt(scorer, scorer.variance)


@pytest.mark.parametrize(
    "keys", [("mass",), ("com_offset", "mass"), ("inertia", "tether"), ("com_offset", "inertia", "mass", "tether")]
)
def test_the_score_of_a_set_is_that_of_its_plain_form(hunt, keys):
    assert hunt.score(keys) == pytest.approx(hunt.plainly(keys), rel=1e-9)


def test_what_promises_most_is_what_lowers_the_plain_score_most(hunt):
    """Without bounds in reach: the order of gains beside a set is the order of the scores with each added."""
    for keys in ((), ("mass",), ("inertia", "mass")):
        beside = [n for n in hunt.space.columns if n not in keys]
        by_score = sorted(beside, key=lambda n: -hunt.plainly(tuple(sorted((*keys, n)))))
        assert hunt._promising(keys)[0] == by_score[0]


@pytest.mark.parametrize("shape", [(400,), (3000, 3), (60, 6)])
def test_the_filter_is_scipys(shape):
    signal = np.cumsum(RNG(2).normal(size=shape), axis=0)
    padding = min(len(signal) - 1, int(3.0 / (8.0 * 0.005)))
    expected = sosfiltfilt(butter(2, 8.0, fs=200.0, output="sos"), signal, axis=0, padlen=padding)
    np.testing.assert_allclose(low_pass(signal, 0.005, 8.0), expected, rtol=0, atol=1e-12 * np.abs(signal).max())
