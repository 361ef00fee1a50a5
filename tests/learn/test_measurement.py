"""The measured wrench, against closed forms."""

import numpy as np
import pytest

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Samples
from wrenchgap.learn.data.measurement import derivative, low_pass, prepare, window
from wrenchgap.learn.data.prediction import Evaluator, predict
from wrenchgap.plant import model_file
from wrenchgap.plant.effects import find
from wrenchgap.plant.vehicle import Body, Vehicle
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel

DT = 0.005
T = np.arange(2000) * DT
BODY = Body(2.0, np.diag([0.1, 0.2, 0.3]), np.zeros(3))
HEXAROTOR = model_file.load("tilt_hexarotor")
ZERO = (0.0, 0.0, 0.0)
WEIGHT = (0.0, 0.0, 9.81)


def vehicle(imu=ZERO):
    return Vehicle("w", BODY, None, None, np.array(imu))


def samples(omega=ZERO, force=ZERO, wrench=2 * ZERO, time=T, **rest):
    """Each column a number or its values at all times."""
    rows = (np.stack([np.broadcast_to(c, time.shape) for c in row], axis=1) for row in (omega, force, wrench))
    return Samples("f", time, DT, *rows, **rest)


def test_torque_of_a_swinging_body():
    """omega_x = a sin wt gives M_x = J_xx a w cos wt, damped by the filter's gain at w, nothing on the other axes."""
    a, w = 0.8, 2 * np.pi * 1.5
    record = prepare(samples(omega=(a * np.sin(w * T), 0, 0)), vehicle())
    gain = 1 / (1 + (np.tan(np.pi * 1.5 * DT) / np.tan(np.pi * 8.0 * DT)) ** 4)  # Butterworth, bilinear, twice
    expected = 0.1 * a * w * np.cos(w * record.time) * gain
    np.testing.assert_allclose(record.measured[:, 3], expected, atol=2e-3 * 0.1 * a * w)
    np.testing.assert_allclose(record.measured[:, [0, 1, 2, 4, 5]], 0, atol=1e-9)


SPIN = np.array([0.5, 1.0, -0.7])


@pytest.mark.parametrize(
    ("omega", "force", "imu", "wrench"),
    [
        (SPIN, ZERO, ZERO, [*ZERO, *np.cross(SPIN, BODY.inertia @ SPIN)]),
        (ZERO, WEIGHT, ZERO, [0.0, 0.0, 2.0 * 9.81, *ZERO]),
        ((0.0, 0.0, 3.0), (-(3.0**2) * 0.1, 0.0, 0.0), (0.1, 0.0, 0.0), 2 * ZERO),
    ],
    ids=["M = omega x J omega", "F = m f, without gravity", "an IMU at +x feels -w^2 r of a spin about z"],
)
def test_wrench_of_a_steady_motion(omega, force, imu, wrench):
    measured = prepare(samples(omega, force), vehicle(imu)).measured
    np.testing.assert_allclose(measured, np.broadcast_to(wrench, measured.shape), atol=1e-9)


def test_same_filter_on_both_sides_leaves_no_lag():
    """A perfect vehicle (measured = commanded) has no residual, however fast the command."""
    phase = np.random.default_rng(0).uniform(0, 6, 8)
    lift = 9.81 + 0.5 * np.sin(np.outer(T, 2 * np.pi * np.linspace(0.5, 6, 8)) + phase).sum(axis=1)
    record = prepare(samples(force=(0, 0, lift), wrench=(0, 0, 2 * lift, *ZERO)), vehicle())
    np.testing.assert_allclose(record.measured - predict(record, WrenchModel(vehicle())), 0, atol=1e-9)
    np.testing.assert_allclose(record.measured - record.commanded, 0, atol=1e-9)


def test_derivative_is_fourth_order():
    errors = []
    for n in (100, 200):
        t = np.linspace(0, 1, n + 1)
        errors.append(np.abs(derivative(np.sin(6 * t)[:, None], 1 / n)[5:-5, 0] - 6 * np.cos(6 * t[5:-5])).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1)


def test_low_pass_has_no_phase_and_the_known_gain():
    wave = np.sin(2 * np.pi * 8.0 * T)[:, None]
    out = low_pass(wave, DT, 8.0)
    np.testing.assert_allclose(out[500:1500], 0.5 * wave[500:1500], atol=1e-3)  # -6 dB at the cut-off, in phase


def test_noise_level_is_that_of_the_white_noise_put_in():
    """Against the spread of many filtered noise-only samples."""
    gyro, force = np.random.default_rng(1).normal(size=(2, 3, 40000)) * np.reshape([3e-3, 0.03], (2, 1, 1))
    record = prepare(samples(gyro, force, time=np.arange(40000) * DT), vehicle())
    np.testing.assert_allclose(record.noise, record.measured.std(axis=0), rtol=0.1)


FOUR = samples(tilt_cmd=np.zeros((2000, 4)), rotor_speed_cmd=np.zeros((2000, 4)))


@pytest.mark.parametrize(
    ("made", "flown_by", "options", "words"),
    [
        (samples(time=T[:100]), vehicle(), {}, "too short"),
        (samples(), vehicle(), {"cutoff_hz": 150.0}, "cut-off"),
        (FOUR, HEXAROTOR.vehicle, {}, "4 rotor speeds"),
    ],
)
def test_refuses_what_cannot_be_filtered_or_is_of_another_vehicle(made, flown_by, options, words):
    with pytest.raises(FitError, match=words):
        prepare(made, flown_by, **options)


def test_allocates_where_the_log_has_no_actuators():
    record = prepare(samples(force=WEIGHT, wrench=(0, 0, 39.24 + np.sin(T), *ZERO)), HEXAROTOR.vehicle)
    assert record.source == "allocated"
    np.testing.assert_allclose(predict(record, HEXAROTOR.wrench_model), record.commanded, atol=1e-9)


def test_window_of_a_record_predicts_what_the_record_does():
    """Away from the ends, a piece cut out of a flight says the same as the whole flight there."""
    wrench = (3 * np.sin(T), 2 * np.cos(3 * T), 39.24 + np.sin(2 * T), 0.3 * np.sin(5 * T), 0, 0)
    record = prepare(samples(force=WEIGHT, wrench=wrench), HEXAROTOR.vehicle)
    part, model = window(record, 60, 160), HEXAROTOR.wrench_model
    np.testing.assert_array_equal(part.time, record.time[60:160])
    np.testing.assert_allclose(part.state.time[part.keep], part.time)
    np.testing.assert_allclose(predict(part, model), predict(record, model)[60:160], atol=2e-3)
    np.testing.assert_allclose(part.measured, record.measured[60:160])


EVERYWHERE = {
    "servo_lag": 0.03,
    "motor_lag": 0.02,
    "rotor_thrust": 0.05,
    "coaxial_loss": 0.1,
    "constant_wrench": 0.4,
    "axial_inflow": 2e-4,
    "rotor_drag": 1e-4,
    "wind": 2.0,
    "arm_reaction": 1e-3,
    "thrust_scale": 0.05,
    "com_offset": 0.005,
    "inertia": 0.002,
    "imu_misalignment": 0.02,
}
"""Effects at all five places and the air, one with rates, with sizes."""


@pytest.fixture(scope="module")
def record(plain):
    return plain.records[0]


@pytest.fixture(scope="module")
def start():
    """Values of every parameter, by effect."""
    rng = np.random.default_rng(0)
    count = {name: len(find(name).parameters(HEXAROTOR.vehicle)) for name in EVERYWHERE}
    return {name: size * rng.uniform(0.2, 1, count[name]) for name, size in EVERYWHERE.items()}


def model_of(values, of=HEXAROTOR.vehicle):
    return WrenchModel(of, tuple(ModelEffect(find(name), theta) for name, theta in values.items()))


def changed(values, name, by):
    """All values the same but one of this effect."""
    theta = values[name].copy()
    theta[-1] += by
    return {**values, name: theta}


def assert_as_predict(evaluate, record, model):
    expected = predict(record, model)
    np.testing.assert_allclose(evaluate(model), expected, atol=1e-10 * np.abs(expected).max())


def test_effects_of_the_test_stand_at_all_five_places_and_in_the_air():
    assert {find(name).place for name in EVERYWHERE} == {"commands", "thrusts", "wrench", "body", "sensor", "air"}
    assert any(find(name).needs_rates for name in EVERYWHERE)


@pytest.mark.parametrize("name", EVERYWHERE)
def test_evaluator_notices_a_change_of_one_parameter(record, start, name):
    """There and back again: what is remembered of one model is not taken for the other."""
    evaluate = Evaluator(record)
    first, second = model_of(start), model_of(changed(start, name, 0.003))
    assert np.abs(predict(record, first) - predict(record, second)).max() > 1e-6
    for model in (first, second, first):
        assert_as_predict(evaluate, record, model)


def test_evaluator_works_out_rates_when_an_effect_needs_them(record, start):
    """The arms' reaction, added to a model that did without rates so far."""
    evaluate = Evaluator(record)
    without = {name: theta for name, theta in start.items() if not find(name).needs_rates}
    assert len(without) < len(start)
    for values in (without, start, without):
        assert_as_predict(evaluate, record, model_of(values))


def test_evaluator_gives_the_prediction_in_any_order(record, start):
    """A walk through parameters, one effect or another taken out at times; far more than it can remember."""
    rng = np.random.default_rng(1)
    evaluate, values = Evaluator(record), start
    for _ in range(60):
        values = changed(values, rng.choice(list(EVERYWHERE)), rng.choice([-0.002, 0.002]))
        out = rng.choice(list(EVERYWHERE))
        model = model_of({n: v for n, v in values.items() if n != out or rng.random() < 0.5})
        assert_as_predict(evaluate, record, model)
    assert_as_predict(evaluate, record, model_of(start))


def test_evaluator_stays_right_after_its_memory_has_overflowed(record, start):
    evaluate = Evaluator(record)
    tried = [changed(start, name, k * 0.001) for name in ("servo_lag", "coaxial_loss") for k in range(6)]
    tried += [changed(start, "constant_wrench", k * 0.01) for k in range(40)]
    for values in tried:
        evaluate(model_of(values))
    for values in tried[::-4]:
        assert_as_predict(evaluate, record, model_of(values))


def test_evaluator_does_not_give_away_what_it_remembers(record, start):
    """Whoever changes a prediction in place, as the fit does with the bias, changes nothing for the next."""
    evaluate = Evaluator(record)
    for values in (start, {}):
        model = model_of(values)
        before = evaluate(model).copy()
        evaluate(model)[:] = 7.0
        np.testing.assert_array_equal(evaluate(model), before)


def test_evaluator_computes_what_is_shared_once(record, start, monkeypatch):
    """Nine models with the same lags: the tilt angles are lagged once."""
    calls, lag = [], type(find("servo_lag"))
    apply = lag.apply
    monkeypatch.setattr(lag, "apply", lambda self, *rest: calls.append(1) or apply(self, *rest))
    evaluate = Evaluator(record)
    for name in ("com_offset", "inertia", "constant_wrench"):
        for k in range(3):
            evaluate(model_of(changed(start, name, 0.001 * k)))
    assert len(calls) == 1
    for k in range(1, 9):
        evaluate(model_of(changed(start, "motor_lag", 0.001 * k)))
    assert len(calls) == 9
    evaluate(model_of(changed(start, "motor_lag", 0.008)))  # the last is still known
    assert len(calls) == 9


def test_evaluator_holds_the_directions_of_one_set_of_tilt_angles(record, start):
    """Back and forth between two lags: arrays of angles that were not asked for last are free."""
    evaluate = Evaluator(record)
    models = [model_of(changed(start, "servo_lag", by)) for by in (0.0, 0.005)]
    for model in (*models, *models):
        evaluate(model)
        acts = [act for act, _, _ in evaluate._rotors.values()] + [act for _, act in evaluate._nominal]
        assert len({id(act.posture) for act in acts if act.posture._held}) == 1


def test_evaluator_of_a_vehicle_without_rotors():
    record = prepare(samples(force=WEIGHT, wrench=(np.sin(T), 0, 0, 0, 0, np.cos(3 * T))), vehicle())
    evaluate = Evaluator(record)
    for values in ({}, {"com_offset": np.array([0.01, 0, 0])}, {"command_delay": np.array([0.03])}, {}):
        assert_as_predict(evaluate, record, model_of(values, vehicle()))


@pytest.mark.parametrize("offset", [(0.0, 0.01, 0.0), (0.01, 0.0, 0.0)])
def test_a_torque_that_something_balances_accelerates_nothing(offset):
    """0.3 Nm are commanded and the vehicle does not turn: with its centre of mass at r the thrust F makes -r x F more,
    and its accelerometer, which no angular acceleration reaches, reads what it read.
    """
    thrust = np.array([0.0, 0.0, 2.0 * 9.81])
    record = prepare(samples(force=WEIGHT, wrench=(*thrust, 0.3, 0.3, 0.0)), vehicle())
    evaluate = Evaluator(record, balanced=True)
    moved = evaluate(model_of({"com_offset": np.array(offset)}, vehicle())) - evaluate(model_of({}, vehicle()))
    np.testing.assert_allclose(moved[:, :3], 0.0, atol=1e-4)  # 0.06 N if it turned by M over J
    np.testing.assert_allclose(moved[:, 3:], np.broadcast_to(-np.cross(offset, thrust), (len(record), 3)), atol=1e-3)
