import tracemalloc
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.learn.process.subsample import squared_distances, standardised, subsample, thin

METHODS = ("fasterpam", "pyclustering")


def wandering(length: int, seed: int = 0) -> np.ndarray:
    """A command that wanders like a flight's: forces of tens of newtons, torques of tenths of newton metres."""
    rng = np.random.default_rng(seed)
    steps = np.cumsum(rng.normal(size=(length, 6)), axis=0) / np.sqrt(length)
    return steps * [20, 20, 10, 0.5, 0.5, 0.3] + [0, 0, 39, 0, 0, 0]


def loss(points: np.ndarray, chosen: np.ndarray) -> float:
    return float(((points[:, None] - points[chosen]) ** 2).sum(axis=2).min(axis=1).sum())


def test_finds_the_medoid_of_every_cluster():
    """Clusters so far apart that the optimum is one medoid in each, found by trying all members."""
    labels = np.repeat(np.arange(6), 8)
    points = 100.0 * np.eye(6)[labels] + np.random.default_rng(5).normal(size=(48, 6))
    members = [np.flatnonzero(labels == label) for label in range(6)]
    expected = [min(m, key=lambda one, m=m: ((points[m] - points[one]) ** 2).sum()) for m in members]
    assert subsample(points, 6, scale="raw").tolist() == expected
    # pyclustering carries out one swap more than is good
    assert labels[subsample(points, 6, method="pyclustering", scale="raw")].tolist() == list(range(6))


def test_reaches_the_best_of_all_pairs():
    points = np.random.default_rng(2).normal(size=(25, 6))
    best = min(loss(points, np.array(pair)) for pair in combinations(range(25), 2))
    assert min(loss(points, subsample(points, 2, scale="raw", seed=seed)) for seed in range(5)) == pytest.approx(best)


@pytest.mark.timeout(60)
def test_ends_where_no_exchange_of_one_helps_also_among_equal_samples():
    """Half of the samples are the same, as on the ground: gains that were rounding went round for ever."""
    rng = np.random.default_rng(9)
    points = rng.normal(size=(rng.integers(200, 1500), rng.integers(2, 12)))
    points[: len(points) // 2] = 0.0
    chosen = subsample(points, rng.integers(10, 150), seed=9)
    apart = squared_distances(standardised(points)).astype(float)
    found = apart[chosen].min(axis=0).sum()
    for k in range(len(chosen)):
        others = apart[np.delete(chosen, k)].min(axis=0)
        assert np.minimum(others, apart).sum(axis=1).min() >= found * (1 - 1e-9)


def test_the_two_libraries_agree_on_what_is_good():
    points = wandering(150)
    fast, slow = (loss(standardised(points), subsample(points, 20, method=method)) for method in METHODS)
    drawn = loss(standardised(points), np.random.default_rng(0).choice(150, 20, replace=False))
    assert fast == pytest.approx(slow, rel=0.1)
    assert max(fast, slow) < 0.8 * drawn


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("on_ground", [0, 100])
def test_repeats_with_different_rows(method, on_ground):
    """On the ground many samples are the same."""
    points = np.vstack([np.zeros((on_ground, 6)), wandering(180)])
    first, again = subsample(points, 15, method=method), subsample(points, 15, method=method)
    assert first.tolist() == again.tolist()
    assert len(first) == 15
    assert (np.diff(first) > 0).all()


def test_standardised_does_not_depend_on_units_and_raw_lets_force_swamp_torque():
    points, millis = wandering(1000), np.array([1, 1, 1, 1e3, 1e3, 1e3])
    free, raw = subsample(points, 30), subsample(points, 30, scale="raw")
    assert free.tolist() == subsample(points * millis, 30).tolist()
    assert raw.tolist() != subsample(points * millis, 30, scale="raw").tolist()
    assert loss(points[:, 3:], free) < loss(points[:, 3:], raw)


@given(length=st.integers(1, 5000), count=st.integers(1, 300), seed=st.integers(0, 9))
def test_thinning_draws_one_of_every_stretch(length, count, seed):
    kept = thin(length, count, seed)
    assert len(kept) == min(length, count)
    stretch = kept * len(kept) // length
    assert stretch.tolist() == list(range(len(kept)))


def test_memory_does_not_grow_with_the_log():
    points = wandering(400_000)
    tracemalloc.start()
    subsample(points, 50, pre_thin=1000)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < points.nbytes


@settings(max_examples=20)
@given(offset=st.floats(-1e3, 1e3))
def test_distances_are_those_of_the_definition(offset):
    points = np.random.default_rng(1).normal(size=(30, 6)) + offset
    expected = ((points[:, None] - points) ** 2).sum(axis=2)
    assert squared_distances(points) == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize("length", [2, 33, 400])
def test_distances_are_scipys_and_none_to_oneself(length):
    points = standardised(wandering(length))
    found = squared_distances(points)
    np.testing.assert_allclose(found, cdist(points, points, "sqeuclidean"), atol=2e-5)
    assert not found.diagonal().any()
    assert found.dtype == np.float32
    assert squared_distances(np.repeat(points, 2, axis=0)).min() == 0.0  # never below, though rounding is on both sides


def test_short_log_is_kept_whole_and_a_constant_column_is_no_trouble():
    assert subsample(wandering(7), 10).tolist() == list(range(7))
    points = wandering(300)
    points[:, 0] = 4.0
    assert len(subsample(points, 10)) == 10


@pytest.mark.parametrize(
    ("points", "arguments", "error", "message"),
    [
        (np.zeros((0, 6)), {}, FitError, r"shape \(0, 6\)"),
        (np.full((9, 6), np.nan), {}, FitError, "9 inputs are not finite"),
        (np.zeros((9, 6)), {"method": "kmeans"}, UsageError, "available: fasterpam, pyclustering"),
        (np.zeros((9, 6)), {"scale": "log"}, UsageError, "available: standardised, raw"),
        (np.zeros((9, 6)), {"count": 0}, UsageError, "got 0 points"),
    ],
)
def test_bad_input_gets_one_line(points, arguments, error, message):
    with pytest.raises(error, match=message) as caught:
        subsample(points, **({"count": 5} | arguments))
    assert "\n" not in str(caught.value)
