"""The measured wrench, against closed forms."""

import numpy as np
import pytest

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Samples
from wrenchgap.learn.data.measurement import Evaluator, derivative, low_pass, predict, prepare
from wrenchgap.plant import model_file
from wrenchgap.plant.effects import find
from wrenchgap.plant.vehicle import Body, Vehicle
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel

DT = 0.005
BODY = Body(2.0, np.diag([0.1, 0.2, 0.3]), np.zeros(3))


def vehicle(imu=(0.0, 0.0, 0.0)):
    return Vehicle("w", BODY, None, None, np.array(imu))


def samples(omega, force, wrench, seconds=10.0, **rest):
    t = np.arange(round(seconds / DT)) * DT
    rows = {
        k: np.stack([np.broadcast_to(c, t.shape) for c in f(t)], axis=1)
        for k, f in {"omega_B": omega, "specific_force_B": force, "wrench_cmd_B": wrench}.items()
    }
    return Samples("f", t, DT, rows["omega_B"], rows["specific_force_B"], rows["wrench_cmd_B"], **rest)


def zero3(t):
    return (0 * t, 0 * t, 0 * t)


def zero6(t):
    return zero3(t) + zero3(t)


def test_torque_of_a_swinging_body():
    """omega_x = a sin wt gives M_x = J_xx a w cos wt, damped by the filter's gain at w, nothing on the other axes."""
    a, w = 0.8, 2 * np.pi * 1.5
    s = samples(lambda t: (a * np.sin(w * t), 0 * t, 0 * t), zero3, zero6)
    record = prepare(s, vehicle())
    gain = 1 / (1 + (np.tan(np.pi * 1.5 * DT) / np.tan(np.pi * 8.0 * DT)) ** 4)  # Butterworth, bilinear, twice
    expected = 0.1 * a * w * np.cos(w * record.time) * gain
    np.testing.assert_allclose(record.measured[:, 3], expected, atol=2e-3 * 0.1 * a * w)
    np.testing.assert_allclose(record.measured[:, [0, 1, 2, 4, 5]], 0, atol=1e-9)


def test_gyroscopic_torque_of_a_steady_spin():
    """Steady omega: M = omega x J omega."""
    w = np.array([0.5, 1.0, -0.7])
    record = prepare(samples(lambda t: tuple(v + 0 * t for v in w), zero3, zero6), vehicle())
    np.testing.assert_allclose(
        record.measured[:, 3:], np.tile(np.cross(w, BODY.inertia @ w), (len(record), 1)), atol=1e-9
    )


def test_force_is_mass_times_specific_force_without_gravity():
    record = prepare(samples(zero3, lambda t: (0 * t, 0 * t, 9.81 + 0 * t), zero6), vehicle())
    np.testing.assert_allclose(record.measured[:, 2], 2.0 * 9.81)


def test_lever_arm_of_the_imu_is_taken_out():
    """An IMU at +x on a body that spins about z feels -w^2 r; the force about the centre must be zero."""
    w, r = 3.0, 0.1
    s = samples(lambda t: (0 * t, 0 * t, w + 0 * t), lambda t: (-(w**2) * r + 0 * t, 0 * t, 0 * t), zero6)
    np.testing.assert_allclose(prepare(s, vehicle((r, 0, 0))).measured[:, :3], 0, atol=1e-9)


def test_same_filter_on_both_sides_leaves_no_lag():
    """A perfect vehicle (measured = commanded) has no residual, however fast the command."""
    rng = np.random.default_rng(0)
    phase = rng.uniform(0, 6, 8)

    def wave(t):
        return sum(np.sin(2 * np.pi * f * t + p) for f, p in zip(np.linspace(0.5, 6, 8), phase, strict=True))

    s = samples(
        zero3,
        lambda t: (0 * t, 0 * t, 9.81 + 0.5 * wave(t)),
        lambda t: (*(0 * t,) * 2, 2 * (9.81 + 0.5 * wave(t)), *(0 * t,) * 3),
    )
    record = prepare(s, vehicle())
    np.testing.assert_allclose(record.measured - predict(record, WrenchModel(vehicle())), 0, atol=1e-9)
    np.testing.assert_allclose(record.measured - record.commanded, 0, atol=1e-9)


def test_derivative_is_fourth_order():
    errors = []
    for n in (100, 200):
        t = np.linspace(0, 1, n + 1)
        errors.append(np.abs(derivative(np.sin(6 * t)[:, None], 1 / n)[5:-5, 0] - 6 * np.cos(6 * t[5:-5])).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1)


def test_low_pass_has_no_phase_and_the_known_gain():
    t = np.arange(4000) * DT
    wave = np.sin(2 * np.pi * 8.0 * t)[:, None]
    out = low_pass(wave, DT, 8.0)
    np.testing.assert_allclose(out[1000:3000], 0.5 * wave[1000:3000], atol=1e-3)  # -6 dB at the cut-off, in phase


def test_noise_level_is_that_of_the_white_noise_put_in():
    """Against the spread of many filtered noise-only samples."""
    rng = np.random.default_rng(1)
    t = np.arange(40000) * DT
    quiet = Samples(
        "n", t, DT, 3e-3 * rng.normal(size=(len(t), 3)), 0.03 * rng.normal(size=(len(t), 3)), np.zeros((len(t), 6))
    )
    record = prepare(quiet, vehicle())
    np.testing.assert_allclose(record.noise, record.measured.std(axis=0), rtol=0.1)


def test_refuses_a_stretch_shorter_than_the_filter():
    with pytest.raises(FitError, match="too short"):
        prepare(samples(zero3, zero3, zero6, seconds=0.5), vehicle())


def test_refuses_a_cut_off_above_the_rate():
    with pytest.raises(FitError, match="cut-off"):
        prepare(samples(zero3, zero3, zero6), vehicle(), cutoff_hz=150.0)


def test_refuses_actuators_of_another_vehicle():
    s = samples(zero3, zero3, zero6, tilt_cmd=np.zeros((2000, 4)), rotor_speed_cmd=np.zeros((2000, 4)))
    with pytest.raises(FitError, match="4 rotor speeds"):
        prepare(s, model_file.load("tilt_hexarotor").vehicle)


def test_allocates_where_the_log_has_no_actuators():
    m = model_file.load("tilt_hexarotor")
    s = samples(
        zero3, lambda t: (0 * t, 0 * t, 9.81 + 0 * t), lambda t: (0 * t, 0 * t, 39.24 + np.sin(t), *(0 * t,) * 3)
    )
    record = prepare(s, m.vehicle)
    assert record.source == "allocated"
    np.testing.assert_allclose(predict(record, m.wrench_model), record.commanded, atol=1e-9)


def test_window_of_a_record_predicts_what_the_record_does():
    """Away from the ends, a piece cut out of a flight says the same as the whole flight there."""
    from wrenchgap.learn.data.measurement import window

    m = model_file.load("tilt_hexarotor")
    s = samples(
        zero3,
        lambda t: (0 * t, 0 * t, 9.81 + 0 * t),
        lambda t: (3 * np.sin(t), 2 * np.cos(3 * t), 39.24 + np.sin(2 * t), 0.3 * np.sin(5 * t), *(0 * t,) * 2),
    )
    record = prepare(s, m.vehicle)
    part = window(record, 60, 160)
    np.testing.assert_array_equal(part.time, record.time[60:160])
    np.testing.assert_allclose(part.state.time[part.keep], part.time)
    np.testing.assert_allclose(predict(part, m.wrench_model), predict(record, m.wrench_model)[60:160], atol=2e-3)
    np.testing.assert_allclose(part.measured, record.measured[60:160])


# ---------------------------------------------------------------- models that have much in common

EVERYWHERE = {
    "servo_lag": 0.03,
    "motor_lag": 0.02,
    "rotor_thrust": 0.05,
    "coaxial_loss": 0.1,
    "constant_wrench": 0.4,
    "arm_reaction": 1e-3,
    "thrust_scale": 0.05,
    "com_offset": 0.005,
    "inertia": 0.002,
    "imu_misalignment": 0.02,
}
"""Effects at all five places, one with rates, with sizes."""


@pytest.fixture(scope="module")
def record(fly):
    (found,) = fly("none", None, "train", seed=23, seconds=25)[0].records
    return found


@pytest.fixture(scope="module")
def start(hexarotor):
    """Values of every parameter, by effect."""
    rng = np.random.default_rng(0)
    count = {name: len(find(name).parameters(hexarotor.vehicle)) for name in EVERYWHERE}
    return {name: size * rng.uniform(0.2, 1, count[name]) for name, size in EVERYWHERE.items()}


def model_of(vehicle, values):
    return WrenchModel(vehicle, tuple(ModelEffect(find(name), theta) for name, theta in values.items()))


def changed(values, name, by):
    """All values the same but one of this effect."""
    theta = values[name].copy()
    theta[-1] += by
    return {**values, name: theta}


def assert_as_predict(evaluate, record, model):
    expected = predict(record, model)
    np.testing.assert_allclose(evaluate(model), expected, atol=1e-10 * np.abs(expected).max())


def test_effects_of_the_test_stand_at_all_five_places():
    assert {find(name).place for name in EVERYWHERE} == {"commands", "thrusts", "wrench", "body", "sensor"}
    assert any(find(name).needs_rates for name in EVERYWHERE)


@pytest.mark.parametrize("name", EVERYWHERE)
def test_evaluator_notices_a_change_of_one_parameter(record, hexarotor, start, name):
    """There and back again: what is remembered of one model is not taken for the other."""
    evaluate = Evaluator(record)
    first, second = model_of(hexarotor.vehicle, start), model_of(hexarotor.vehicle, changed(start, name, 0.003))
    assert np.abs(predict(record, first) - predict(record, second)).max() > 1e-6
    for model in (first, second, first):
        assert_as_predict(evaluate, record, model)


def test_evaluator_works_out_rates_when_an_effect_needs_them(record, hexarotor, start):
    """The arms' reaction, added to a model that did without rates so far."""
    evaluate = Evaluator(record)
    without = {name: theta for name, theta in start.items() if not find(name).needs_rates}
    assert len(without) < len(start)
    for values in (without, start, without):
        assert_as_predict(evaluate, record, model_of(hexarotor.vehicle, values))


def test_evaluator_gives_the_prediction_in_any_order(record, hexarotor, start):
    """A walk through parameters, one effect or another taken out at times; far more than it can remember."""
    rng = np.random.default_rng(1)
    evaluate, values = Evaluator(record), start
    for _ in range(60):
        values = changed(values, rng.choice(list(EVERYWHERE)), rng.choice([-0.002, 0.002]))
        out = rng.choice(list(EVERYWHERE))
        model = model_of(hexarotor.vehicle, {n: v for n, v in values.items() if n != out or rng.random() < 0.5})
        assert_as_predict(evaluate, record, model)
    assert_as_predict(evaluate, record, model_of(hexarotor.vehicle, start))


def test_evaluator_stays_right_after_its_memory_has_overflowed(record, hexarotor, start):
    evaluate = Evaluator(record)
    tried = [changed(start, name, k * 0.001) for name in ("servo_lag", "coaxial_loss") for k in range(6)]
    tried += [changed(start, "constant_wrench", k * 0.01) for k in range(40)]
    for values in tried:
        evaluate(model_of(hexarotor.vehicle, values))
    for values in tried[::-4]:
        assert_as_predict(evaluate, record, model_of(hexarotor.vehicle, values))


def test_evaluator_does_not_give_away_what_it_remembers(record, hexarotor, start):
    """Whoever changes a prediction in place, as the fit does with the bias, changes nothing for the next."""
    evaluate = Evaluator(record)
    for values in (start, {}):
        model = model_of(hexarotor.vehicle, values)
        before = evaluate(model).copy()
        evaluate(model)[:] = 7.0
        np.testing.assert_array_equal(evaluate(model), before)


def test_evaluator_computes_what_is_shared_once(record, hexarotor, start, monkeypatch):
    """Nine models with the same lags: the tilt angles are lagged once."""
    calls = []
    lag = type(find("servo_lag"))
    apply = lag.apply
    monkeypatch.setattr(lag, "apply", lambda self, *rest: calls.append(1) or apply(self, *rest))
    evaluate = Evaluator(record)
    for name in ("com_offset", "inertia", "constant_wrench"):
        for k in range(3):
            evaluate(model_of(hexarotor.vehicle, changed(start, name, 0.001 * k)))
    assert len(calls) == 1
    for k in range(1, 9):
        evaluate(model_of(hexarotor.vehicle, changed(start, "motor_lag", 0.001 * k)))
    assert len(calls) == 9
    evaluate(model_of(hexarotor.vehicle, changed(start, "motor_lag", 0.008)))  # the last is still known
    assert len(calls) == 9


def test_evaluator_of_a_vehicle_without_rotors():
    s = samples(zero3, lambda t: (0 * t, 0 * t, 9.81 + 0 * t), lambda t: (np.sin(t), *(0 * t,) * 4, np.cos(3 * t)))
    plain = vehicle()
    record = prepare(s, plain)
    evaluate = Evaluator(record)
    for values in ({}, {"com_offset": np.array([0.01, 0, 0])}, {"command_delay": np.array([0.03])}, {}):
        assert_as_predict(evaluate, record, model_of(plain, values))
