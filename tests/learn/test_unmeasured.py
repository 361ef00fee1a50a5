"""Axes that were not measured are out of everything: no result depends on what stands there."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from wrenchgap import add, compare, explain, load_model, open_flights, simulate
from wrenchgap.flight import AXES
from wrenchgap.flight.errors import FitError, LogError, UsageError
from wrenchgap.learn.data.blocks import contrast, cosine, evidence
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.errors import energy, force_and_torque, length, rms, whole
from wrenchgap.learn.data.measurement import measured_axes, names_of
from wrenchgap.learn.diagnose.failure_map import failure_map
from wrenchgap.learn.diagnose.relevance import relevance
from wrenchgap.learn.diagnose.where import Source, budget, held_out_process
from wrenchgap.learn.diagnose.whiteness import whiteness
from wrenchgap.learn.identify.fit import fit, held_out
from wrenchgap.learn.identify.learning import learnable_outputs
from wrenchgap.plant.vehicle import Body

LATERAL = ("force_x", "force_y")
MEASURED = np.array([False, False, True, True, True, True])


@pytest.fixture(scope="module")
def model():
    return load_model("asymmetric_quadrotor")


@pytest.fixture(scope="module")
def flown(model):
    """14 s of an excited quadrotor that weighs more than its model, its centre of mass elsewhere."""
    return simulate(
        model, "figure8", duration=14.0, excitation=1.0, seed=4, hide=("mass=added:0.12", "com_offset=x:0.006,y:-0.004")
    )


def filled(flown, value, axes=LATERAL):
    """The flight with `value` (a number, or one for each sample) where the IMU's readings of `axes` were."""
    force, omega = flown.imu.specific_force_B.copy(), flown.imu.omega_B.copy()
    for axis in axes:
        (force if axis.startswith("force") else omega)[:, "xyz".index(axis[-1])] = value
    return replace(flown, imu=replace(flown.imu, specific_force_B=force, omega_B=omega))


@pytest.fixture(scope="module")
def opened(flown, model):
    return open_flights(flown, model, unmeasured=LATERAL)


def test_an_accelerometer_axis_takes_out_its_force_and_nothing_else(model):
    for axis in ("force_x", "force_y", "force_z"):
        assert names_of(measured_axes(model.vehicle, [axis])) == (axis,)


def test_a_gyroscope_axis_takes_out_what_the_equations_say(model):
    vehicle = model.vehicle

    def lost(inertia, com, imu, axis):
        body = Body(1.0, np.diag(inertia), np.array(com))
        return names_of(measured_axes(replace(vehicle, body=body, imu_position_B=np.array(imu)), [axis]))

    centred = [0.0, 0.0, 0.0]
    # M_z has (J_y - J_x) omega_x omega_y: gone where these differ, there where they are the same.
    assert lost([1.0, 2.0, 3.0], centred, centred, "torque_x") == ("torque_x", "torque_y", "torque_z")
    assert lost([1.0, 1.0, 3.0], centred, centred, "torque_x") == ("torque_x", "torque_y")
    assert lost([1.0, 1.0, 3.0], centred, centred, "torque_z") == ("torque_x", "torque_y", "torque_z")
    assert lost([2.0, 2.0, 2.0], centred, centred, "torque_z") == ("torque_z",)
    # Over a lever arm d along x the forces are d (-omega_y^2 - omega_z^2, domega_z + omega_x omega_y, -domega_y + ...).
    ahead = lost([2.0, 2.0, 2.0], [0.1, 0.0, 0.0], centred, "torque_x")
    assert ahead == ("force_y", "force_z", "torque_x")
    # What counts is the difference between the two places.
    assert lost([2.0, 2.0, 2.0], [0.1, 0.0, 0.0], [0.1, 0.0, 0.0], "torque_x") == ("torque_x",)


def test_the_record_is_not_a_number_there(opened):
    (record,) = opened[0].records
    assert record.measured_axes.tolist() == MEASURED.tolist()
    assert np.isnan(record.measured).all(axis=0).tolist() == (~MEASURED).tolist()
    assert np.isfinite(record.measured[:, MEASURED]).all()
    assert np.isnan(record.noise).tolist() == (~MEASURED).tolist()


def test_zeros_throughout_are_no_reading(opened, flown, model):
    """Nor an exact one, whose weight is infinite: the fit is that of a log that says that it has no such axes."""
    zeros = open_flights(filled(flown, 0.0), model)
    assert "left out everywhere: force_x, force_y (zero throughout)" in zeros[0].notes[0]
    first, second = (add(model, ["mass", "com_offset"], flights).fit for flights in (zeros, opened))
    np.testing.assert_array_equal(first.theta, second.theta)
    assert zeros[0].records[0].measured_axes.tolist() == MEASURED.tolist()
    assert learnable_outputs(zeros, ("force_x", "torque_y")) == ("torque_y",)


def test_one_line_says_which_and_why(opened, flown, model):
    lines = [note for note in opened[0].notes if isinstance(note, str) and "not measured" in note]
    assert lines == ["simulation: not measured, and left out everywhere: force_x, force_y (declared)."]
    (nan,) = open_flights(filled(flown, np.nan), model)
    assert "force_x, force_y (not a number throughout)" in nan.notes[0]


def test_sums_leave_out_what_was_not_measured():
    residual = np.array([[np.nan, 3.0, 4.0, np.nan, np.nan, np.nan], [np.nan, -3.0, -4.0, np.nan, np.nan, np.nan]])
    weights = np.array([0.0, 1.0, 2.0, 0.0, 0.0, 0.0])
    assert energy(residual, weights) == 2 * (9.0 + 64.0)
    assert whole(rms(residual), weights) == pytest.approx(np.sqrt(9.0 + 64.0))
    force, torque = force_and_torque(rms(residual))
    assert force == pytest.approx(5.0)
    assert np.isnan(torque)
    assert length(np.array([[3.0, np.nan, 4.0], [np.nan] * 3]))[0] == 5.0
    assert evidence(2.0 * residual, residual) == pytest.approx(2 * np.log(2.0))


def test_comparisons_of_blocks_are_those_of_the_measured_axes(opened, model):
    data = dataset(opened[0].records, model)
    rng = np.random.default_rng(0)
    one, other, start = (rng.standard_normal(data.measured.shape) * size for size in (1.0, 1.2, 2.0))
    blank = np.where(MEASURED, 1.0, np.nan)
    loud = np.where(MEASURED, 1.0, 1e9)
    assert contrast(data, other * blank, one * blank) == contrast(data, other * loud, one)
    assert cosine(data, start * blank, one * blank, other * blank) == cosine(data, start, loud * one, other)


@pytest.mark.parametrize("filler", [0.0, 1e9, np.nan])
def test_no_result_depends_on_what_stands_there(filler, opened, flown, model):
    changed = open_flights(filled(flown, filler), model, unmeasured=LATERAL)
    np.testing.assert_equal(compare(changed, model).to_json(), compare(opened, model).to_json())
    first, second = (add(model, ["mass", "com_offset"], flights) for flights in (changed, opened))
    np.testing.assert_array_equal(first.fit.theta, second.fit.theta)
    np.testing.assert_array_equal(first.fit.covariance, second.fit.covariance)
    np.testing.assert_equal(vars(first.trial), vars(second.trial))


def test_the_search_does_not_depend_on_it_either(opened, flown, model):
    names = ["mass", "com_offset", "thrust_scale"]
    plain, changed = (
        explain(flights, model, names=names, jobs=1).to_json()
        for flights in (opened, open_flights(filled(flown, 1e9), model, unmeasured=LATERAL))
    )
    plain.pop("timing"), changed.pop("timing")  # of wall clocks it has none; of the accelerometer one axis
    np.testing.assert_equal(changed, plain)
    assert plain["unmeasured"] == ["force_x", "force_y"]
    assert plain["rms_before"][:2] == [None, None]
    assert set(plain["effects"]) == {"mass", "com_offset"}


def test_where_does_not_depend_on_it(opened, flown, model):
    def parts(flights):
        data = dataset(flights[0].records, model)
        left = data.measured - data.predict(model.wrench_model)
        process = held_out_process(data, left, points=20)
        made = budget(data, left, left, process, Source.FITTED)
        return made, failure_map(data, left, permutations=30), whiteness(data, left), relevance(data, left)

    plain, changed = (
        parts(flights) for flights in (opened, open_flights(filled(flown, 1e9), model, unmeasured=LATERAL))
    )
    for one, other in zip(plain, changed, strict=True):
        assert repr(one) == repr(other)
    made, mapped, white, relevant = plain
    assert sum(made.whole().values()) == pytest.approx(1.0)
    assert [a.axis for a in white.autocorrelation] == [a for a, known in zip(AXES, MEASURED, strict=True) if known]
    assert np.isfinite(mapped.dependences[0].axes_mean).tolist() == MEASURED.tolist()
    assert np.isfinite(relevant.explained_axes).tolist() == MEASURED.tolist()


def test_parameters_are_those_of_a_fit_of_the_measured_axes_alone(opened, model):
    """Weighted least squares of another library on the four columns, with the weights that the fit ended with."""
    data = dataset(opened[0].records, model)
    found = fit(data, model, ["mass", "com_offset"], iterations=20)
    problem_scale, mass = found.scale, model.vehicle.body.mass
    weights = found.axis_weights[MEASURED]
    from wrenchgap.plant.effects import find
    from wrenchgap.plant.wrench_model import ModelEffect

    def leaves(x):
        effects = [ModelEffect(find("mass"), x[:1]), ModelEffect(find("com_offset"), x[1:4])]
        left = (data.measured - data.predict(model.with_effects(effects).wrench_model))[:, MEASURED]
        left[:, 0] -= mass * x[4]  # the bias of the one accelerometer axis that was measured
        rows = np.sqrt(data.independence) * (left * weights).ravel()
        return np.concatenate((rows, x / problem_scale[[0, 1, 2, 3, 6]]))

    best = least_squares(leaves, np.zeros(5), x_scale=problem_scale[[0, 1, 2, 3, 6]], xtol=1e-12, ftol=1e-12)
    np.testing.assert_allclose(found.theta, best.x[:4], rtol=1e-3, atol=1e-3 * problem_scale[:4].min())
    np.testing.assert_allclose(found.bias[0, :2], 0.0, atol=1e-12)
    np.testing.assert_allclose(found.theta[:3] / [0.12, 0.006, -0.004], 1.0, atol=0.1)


def test_held_out_residuals_are_not_a_number_there(opened, model):
    data = dataset(opened[0].records, model)
    left = held_out(data, model, ["mass"], fit(data, model, ["mass"]))
    assert np.isnan(left).all(axis=0).tolist() == (~MEASURED).tolist()


def test_an_axis_counts_where_all_flights_measured_it(opened, flown, model):
    (other,) = open_flights(flown, model)
    both = dataset([*opened[0].records, *other.records], model)
    assert both.measured_axes.tolist() == MEASURED.tolist()
    assert np.isnan(both.measured[:, :2]).all()
    assert np.isnan(both.noise[:2]).all()


def test_the_model_file_declares_it_once(flown, model):
    declaring = replace(model, unmeasured=LATERAL)
    (by_model,), (by_option,) = open_flights(flown, declaring), open_flights(flown, model, unmeasured=LATERAL)
    np.testing.assert_array_equal(by_model.records[0].measured, by_option.records[0].measured)
    (more,) = open_flights(flown, declaring, unmeasured=["force_z"])
    assert names_of(more.records[0].measured_axes) == ("force_x", "force_y", "force_z")


def test_nothing_left_is_one_clear_line(flown, model):
    with pytest.raises(UsageError, match="all six axes"):
        open_flights(
            flown, replace(model, unmeasured=LATERAL), unmeasured=["force_z", "torque_x", "torque_y", "torque_z"]
        )
    with pytest.raises(LogError, match=r"No axis of the wrench is left .* --topic imu=none"):
        open_flights(flown, model, unmeasured=["force_x", "force_y", "force_z", "torque_x", "torque_z"])
    with pytest.raises(UsageError, match="'force_q' is no axis"):
        open_flights(flown, model, unmeasured=["force_q"])


def test_what_is_learnt_is_what_was_measured(opened):
    assert learnable_outputs(opened, ("force_x", "force_z", "torque_x")) == ("force_z", "torque_x")
    with pytest.raises(FitError, match="force_x was not measured, and there is nothing to learn; choose --outputs"):
        learnable_outputs(opened, ("force_x",))


def test_a_gyroscope_axis(flown, model):
    """A symmetric vehicle keeps what it can; the odometry tells the rate to what else needs it."""
    vehicle = model.vehicle
    round_one = replace(
        model,
        vehicle=replace(
            vehicle,
            body=Body(vehicle.body.mass, np.diag([0.02, 0.02, 0.03]), np.zeros(3)),
            imu_position_B=np.zeros(3),
        ),
    )
    opened, filled_up = (
        open_flights(f, round_one, unmeasured=["torque_x"]) for f in (flown, filled(flown, 1e6, ["torque_x"]))
    )
    assert names_of(opened[0].records[0].measured_axes) == ("torque_x", "torque_y")
    np.testing.assert_equal(compare(filled_up, round_one).to_json(), compare(opened, round_one).to_json())


def test_with_no_force_at_all_nothing_divides_by_what_is_not_there(flown, model):
    opened = open_flights(flown, model, unmeasured=AXES[:3])
    data = dataset(opened[0].records, model)
    left = data.measured - data.predict(model.wrench_model)
    mapped = failure_map(data, left, permutations=30)
    assert np.isnan(mapped.grid.force).all()
    assert np.isfinite(mapped.grid.torque).any()
    found = add(model, ["com_offset"], opened)
    assert found.trial.outcome == "better"
    assert "nan" not in str(found)
