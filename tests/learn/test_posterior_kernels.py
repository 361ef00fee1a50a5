"""What is compiled computes what numpy's and scipy's own solvers and densities do."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.signal import butter, sosfiltfilt
from scipy.stats import multivariate_normal

from wrenchgap.learn.data.measurement import low_pass
from wrenchgap.learn.identify.bias_and_trim import trim_of
from wrenchgap.learn.posterior import kernels, score
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.spectrum import Spectrum
from wrenchgap.learn.posterior.subset_search import SubsetSearch

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
    found = kernels.bounded(root.T @ root, root.T @ y, low, high, scale)
    stacked = np.vstack((root * scale, np.eye(len(scale))))
    best = lsq_linear(stacked, np.append(y, np.zeros(len(scale))), (low / scale, high / scale), method="bvls")
    np.testing.assert_allclose(found / scale, best.x, atol=1e-9)


def log_evidence(root, y, sizes):
    """Of y = root theta + noise of one, theta_p normal with standard deviation `sizes` (P,)."""
    return multivariate_normal.logpdf(y, cov=np.eye(len(y)) + (root * sizes**2) @ root.T)


@pytest.mark.parametrize("seed", range(6))
def test_sizes_of_sparse_parameters_are_those_that_raise_the_evidence(seed):
    """Expectation maximisation (Tipping 2001, eq. 17): never less likely, and a fixed point unless it was cut short."""
    root, y, _, _, typical, sparse = problem(seed)
    wide = np.full(len(typical), np.inf)
    A, b = root.T @ root, root.T @ y
    sizes = kernels.relevant(A, b, -wide, wide, typical, sparse, typical)
    np.testing.assert_array_equal(sizes[~sparse], typical[~sparse])
    assert log_evidence(root, y, sizes) > log_evidence(root, y, typical)
    covariance = np.linalg.inv(A + np.diag(sizes**-2.0))
    mean = covariance @ b
    fixed = np.maximum(np.sqrt(mean**2 + np.diag(covariance)), 1e-2 * typical)
    assert np.all(np.abs(np.log(fixed / sizes))[sparse] < 0.1)


@pytest.mark.parametrize("seed", range(6))
def test_an_occam_factor_is_what_the_integral_over_parameters_adds(seed):
    """At the optimum: the log of the data's Gaussian density over that of what the optimum leaves."""
    root, y, _, _, scale, _ = problem(seed, 4)
    A = root.T @ root
    theta = np.linalg.solve(A + np.diag(scale**-2.0), root.T @ y)
    whole = multivariate_normal.logpdf(y, cov=np.eye(len(y)) + (root * scale**2) @ root.T)
    left = multivariate_normal.logpdf(y - root @ theta, cov=np.eye(len(y)))
    assert kernels.occam(A, theta, scale) == pytest.approx(whole - left, rel=1e-8)


@pytest.fixture
def search(plain, hexarotor):
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
    return SubsetSearch(scorer, scorer.variance)


@pytest.mark.parametrize(
    "keys", [("mass",), ("com_offset", "mass"), ("inertia", "tether"), ("com_offset", "inertia", "mass", "tether")]
)
def test_the_score_of_a_set_is_its_gaussian_evidence_less_what_its_laws_may_be_off_by(search, keys):
    """Without bounds in reach, of signals whose products are those of the search; the empty set's evidence is zero."""
    space = search.space
    values, vectors = np.linalg.eigh(search.whole)
    signals = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    rows = [space.parameters[k] for k in keys]
    unknown, offsets = np.concatenate(rows), [space.offset[k] for k in keys]
    J, left = signals[:, unknown], signals[:, 0] - signals[:, offsets].sum(axis=1)
    usual, limits = space.scale[unknown], (space.low[unknown], space.high[unknown])
    size = kernels.relevant(J.T @ J, J.T @ left, *limits, usual, space.sparse[unknown], usual)
    theta = np.linalg.solve(J.T @ J + np.diag(size**-2.0), J.T @ left)
    assert np.all((limits[0] < theta) & (theta < limits[1]))
    one = np.eye(len(signals))
    evidence = multivariate_normal.logpdf(left, cov=one + (J * size**2) @ J.T)
    evidence -= multivariate_normal.logpdf(signals[:, 0], cov=one)
    made = [
        J[:, np.isin(unknown, r)] @ theta[np.isin(unknown, r)] + signals[:, o]
        for r, o in zip(rows, offsets, strict=True)
    ]
    doubt = sum(space.columns[k].accuracy * np.linalg.norm(m) for k, m in zip(keys, made, strict=True))
    places = np.sum((theta / size)[space.sparse[unknown]] ** 2)
    prior = search.scorer.prior_of(keys, max(places - 1.0, 0.0))
    assert search.score(keys) == pytest.approx(evidence - 0.5 * doubt**2 + prior, rel=1e-8)


def test_a_sparse_effect_is_at_as_many_places_as_it_has_parameters_far_beyond_their_noise():
    """Of data that show each parameter alone, with noise of one: two of four are large, and one more pays."""
    A, sizes, one = np.eye(4), np.array([4]), np.ones(4)
    sparse, wide, half = np.ones(4, dtype=bool), np.full(4, 1e9), np.full(4, 0.5)
    for theta, further in (([0, 50, 0, 0], 0.0), ([40, 50, 0, 0], 1.0), ([40, -50, 60, 30], 3.0)):
        b = np.array(theta, dtype=float)
        scale = kernels.relevant(A, b, -wide, wide, one, sparse, one)
        found = b / (1.0 + scale**-2.0)
        assert kernels.further_places(found, scale, np.ones(4), sizes) == pytest.approx(further, abs=0.01)
        of_pairs = max(0.5 * (further + 1.0) - 1.0, 0.0)  # two parameters of one place, as of a damaged rotor
        assert kernels.further_places(found, scale, half, sizes) == pytest.approx(of_pairs, abs=0.01)
        assert kernels.further_places(found, scale, ~sparse, sizes) == 0.0


def test_what_promises_most_is_what_raises_the_score_most(search):
    """Without bounds in reach: the order of gains beside a set is the order of the scores with each added."""
    for keys in ((), ("mass",), ("inertia", "mass")):
        beside = [n for n in search.space.columns if n not in keys]
        by_score = sorted(beside, key=lambda n: -search.score((*keys, n)))
        assert search.promising(keys)[0] == by_score[0]


@pytest.mark.parametrize("shape", [(400,), (3000, 3), (60, 6)])
def test_the_filter_is_scipys(shape):
    signal = np.cumsum(RNG(2).normal(size=shape), axis=0)
    padding = min(len(signal) - 1, int(3.0 / (8.0 * 0.005)))
    expected = sosfiltfilt(butter(2, 8.0, fs=200.0, output="sos"), signal, axis=0, padlen=padding)
    np.testing.assert_allclose(low_pass(signal, 0.005, 8.0), expected, rtol=0, atol=1e-12 * np.abs(signal).max())
