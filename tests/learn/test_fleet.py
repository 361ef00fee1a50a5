"""Evidence that merges: the ranking of a fleet is that of the joint spectrum, and flights are held out exactly."""

import io
import zipfile
from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.errors import FitError
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.input_errors import EDGES
from wrenchgap.learn.posterior.fleet_ranking import FittedSet, by_flight, common_candidates, ranking
from wrenchgap.learn.posterior.fleet_spectrum import FleetSpectrum
from wrenchgap.learn.posterior.flight_evidence import declared, evidence, evidence_of, packed, unpacked
from wrenchgap.learn.posterior.relinearisation import spectrum_of
from wrenchgap.learn.posterior.single_effects import model_residual
from wrenchgap.learn.posterior.subset_search import ordered, searched

NAMES = ("com_offset", "mass", "thrust_scale", "motor_lag", "rotor_thrust", "body_drag", "wind", "accelerometer_bias")
COUNT = 4


@pytest.fixture(scope="module")
def model():
    """With trims of the torque as well: flights that differ are the harder case for a merge. Its thrust is known."""
    found = wg.load_model("crazyflie").without_tolerances
    return replace(found, between_flights=(2e-4, 2e-4, 5e-4, 2e-6, 2e-6, 1e-6))


@pytest.fixture(scope="module")
def flights(model):
    """Of different lengths, centres of mass about 1.5 mm off, and a weak rotor that is on no list of the model."""
    made = []
    for k in range(COUNT):
        hide = [f"com_offset=x:{0.0015 + 1e-5 * k}", "thrust_scale=scale:-0.04"]
        flight = wg.simulate(model, "multi_axis", duration=4 + k, excitation=1, seed=k, hide=hide, name=f"flight{k}")
        made.append(flight)
    error = np.full((len(EDGES) + 1, 6), 0.02)
    error[5:, 3] = error[0, 5] = 1.0  # bands that say nothing; an axis that keeps its mean
    opened = wg.open_flights(made, model)
    return [replace(o, records=tuple(replace(r, input_error=error) for r in o.records)) for o in opened]


@pytest.fixture(scope="module")
def parts(flights, model):
    return [evidence(one, model, NAMES) for one in flights]


@pytest.fixture(scope="module")
def joint(flights, model, parts):
    """The spectrum of all flights at once, with the same columns."""
    assert all(not one.answering and not one.calmed for one in parts)
    data = dataset([r for one in flights for r in one.records], model)
    keys, _, _ = common_candidates(parts)
    columns = [c for c in declared(data, model, NAMES) if c.key in keys]
    return searched(spectrum_of(model_residual(data, model), columns))


@pytest.fixture(scope="module")
def merged(parts):
    keys, axes, _ = common_candidates(parts)
    return searched(FleetSpectrum(parts, keys, axes))


def test_merged_evidence_ranks_sets_as_the_joint_fit_does(joint, merged):
    """Log probabilities of every set that both have scored, and their order."""
    together, apart = ordered(joint), ordered(merged)
    assert [s.keys for s in together[:10]] == [s.keys for s in apart[:10]]
    both = joint.known.keys() & merged.known.keys()
    assert len(both) > 20
    for keys in both:
        assert merged.known[keys].log_probability == pytest.approx(joint.known[keys].log_probability, rel=1e-10)
        for key, theta in merged.known[keys].theta.items():
            np.testing.assert_allclose(theta, joint.known[keys].theta[key], rtol=1e-5, atol=1e-9)


def test_noise_counts_and_what_leaks_add_up(joint, merged):
    for name in ("sensor", "leak", "count"):
        np.testing.assert_allclose(getattr(merged.spectrum, name), getattr(joint.spectrum, name), rtol=1e-12)
    assert merged.spectrum.blocks == joint.spectrum.blocks


def test_the_order_of_merging_changes_digits_only(parts, merged):
    keys, axes, _ = common_candidates(parts)
    backwards = searched(FleetSpectrum(parts[::-1], keys, axes))
    for a, b in zip(ordered(merged)[:10], ordered(backwards)[:10], strict=True):
        assert a.keys == b.keys
        assert a.log_probability == pytest.approx(b.log_probability, rel=1e-11)


def test_evidence_survives_being_stored(parts):
    again = unpacked(packed(parts[0]))
    for name, value in vars(parts[0]).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(getattr(again, name), value)
    assert again.keys == parts[0].keys
    assert again.unexcited == parts[0].unexcited


def test_what_is_no_evidence_is_said_in_one_line():
    with pytest.raises(FitError, match="stored evidence"):
        unpacked(b"PK no archive")


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("axes", lambda v: v + 100),
        ("axes", lambda v: v[::-1].copy()),
        ("trim_axes", lambda v: v + 100),
        ("rows", lambda v: -v),
        ("rows", lambda v: v.astype(float)),
        ("roots", lambda v: v * np.nan),
        ("roots", lambda v: v[:0]),
        ("power", lambda v: v + np.inf),
        ("count", lambda v: 0 * v),
        ("columns", lambda v: ()),
        ("columns", lambda v: (v[0], *v)),
        ("seconds", lambda v: float("nan")),
    ],
)
def test_evidence_of_no_flight_is_refused(parts, name, change):
    """Axes 100 to 106, rows below zero and no columns were ranked all the same."""
    with pytest.raises(FitError, match="stored evidence"):
        unpacked(packed(replace(parts[0], **{name: change(getattr(parts[0], name))})))


def test_damaged_evidence_is_refused_and_not_unfolded_without_end(parts):
    good = packed(parts[0])
    with zipfile.ZipFile(io.BytesIO(good)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}

    def made(**changed):
        with io.BytesIO() as stream:
            with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
                for name, content in {**members, **changed}.items():
                    archive.writestr(name, content)
            return stream.getvalue()

    unpacked(made())
    with io.BytesIO() as stream:
        np.save(stream, np.array("[" * 50_000))
        deep = stream.getvalue()
    for content in (good[:-30], good[:3000] + b"\xff" * 50 + good[3050:], made(**{"roots.npy": bytes(2**28 + 1)}),
                    made(**{"head.npy": deep}), made(**{"axes.npy": b""})):  # fmt: skip
        with pytest.raises(FitError, match="stored evidence"):
            unpacked(content)


def test_a_held_out_flight_is_predicted_by_the_fit_of_the_others(parts, merged):
    """theta without a flight: its subtraction against merging all others, at the same noise and prior's sizes."""
    best = next(s for s in ordered(merged) if s.keys)
    whole = by_flight(merged, merged.spectrum, [best], parts, held_out=True)[1][0]
    fitted = FittedSet(merged, best)
    keys, axes, _ = common_candidates(parts)
    for f in range(COUNT):
        rest = [p for k, p in enumerate(parts) if k != f]
        others = FleetSpectrum(rest, keys, axes)
        g, rows = fitted.g, fitted.rows.every
        products = others.products[:, :, rows[:, None], rows] * others.count[:, :, None, None]
        trims = others.trims.of(rows)
        A = np.tensordot(g, products, axes=([0, 1], [0, 1]))
        A = trims.eliminated_from(A, g[0, trims.axes])
        n = len(fitted.sizes)
        theta = np.linalg.solve(A[:n, :n] + np.diag(fitted.sizes**-2.0), A[:n, n:] @ fitted.weights[n:])
        moved = np.concatenate((-theta, fitted.weights[n:]))
        own = FleetSpectrum([parts[f]], keys, axes)
        sums = own.products[:, :, rows[:, None], rows] * own.count[:, :, None, None]
        left = fitted.left(sums, f, moved)
        assert whole[f] == pytest.approx(fitted.log_likelihood(left, own.count), rel=1e-6)


def test_a_trim_is_what_least_squares_gives(merged):
    """Trims are eliminated in closed form: no other trim leaves less, its prior included."""
    space = merged.spectrum
    best = ordered(merged)[0]
    weights, trims = best.weights, space.trims
    g = (merged.share / best.variance)[0, trims.axes]
    likeliest = trims.likeliest(g, weights)

    def cost(t):
        return np.sum(g * trims.squares_left(t, weights) + (t / trims.scale) ** 2)

    rng = np.random.default_rng(0)
    least = cost(likeliest)
    for _ in range(20):
        assert cost(likeliest + 0.3 * trims.scale * rng.normal(size=likeliest.shape)) > least


def test_another_pass_goes_to_where_candidates_fit(flights, model, parts):
    """A centre of mass is not linear (it turns forces into torques twice): a second pass ends nearer to the truth."""
    first = ranking(lambda: iter(parts))
    second = ranking(lambda: iter([evidence(one, model, NAMES, first.points) for one in flights]))
    third = ranking(lambda: iter([evidence(one, model, NAMES, second.points) for one in flights]))

    def moved(a, b):
        return abs(a.points["com_offset"][0] - b.points["com_offset"][0])

    assert moved(second, third) < 0.2 * moved(first, second) + 1e-9
    assert second.probability("com_offset") > 0.99


def test_the_same_in_other_words_is_one_group_and_the_plainest_comes_first(model, parts, flights):
    """4 % of thrust missing is a gain of 0.96, or four gains of 0.96: words that no number of flights tells apart."""
    first = ranking(lambda: iter(parts))
    found = ranking(lambda: iter([evidence(one, model, NAMES, first.points) for one in flights]))
    heaviest = [set(s.names) for s in found.groups[0]]
    assert {"com_offset", "thrust_scale"} == heaviest[0]
    assert {"com_offset", "rotor_thrust"} in heaviest
    assert found.probability("rotor_thrust") == found.probability("thrust_scale") > 0.99
    assert sum(s.weight for s in found.sets) == pytest.approx(1.0)


def test_one_weak_rotor_is_no_group_with_a_common_gain(model):
    hide = ["rotor_thrust=rotor_1:-0.08"]
    made = [
        wg.simulate(model, "multi_axis", duration=4, excitation=1, seed=k, hide=hide, name=f"weak{k}") for k in range(3)
    ]
    weak = [evidence(one, model, NAMES) for one in wg.open_flights(made, model)]
    found = ranking(lambda: iter(weak))
    assert set(found.groups[0][0].names) == {"rotor_thrust"}
    assert not any("thrust_scale" in s.names and "rotor_thrust" not in s.names for s in found.groups[0])


def test_flights_lacking_a_candidate_leave_it_out_of_the_ranking(flights, model, parts):
    few = evidence_of(
        dataset(flights[0].records, model), model, declared(dataset(flights[0].records, model), model, NAMES[:3])
    )
    keys, _, left_out = common_candidates([few, *parts[1:]])
    assert set(keys) == set(NAMES[:3])
    assert "motor_lag" in left_out


def test_a_fleet_of_no_flights_is_refused():
    with pytest.raises(FitError, match="no flight"):
        ranking(lambda: iter(()))
