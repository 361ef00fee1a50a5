"""The counterfactual engine on flights of which everything is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.compensate import Compensator, Settings
from wrenchgap.compensate.allocator import Allocator
from wrenchgap.flight import so3
from wrenchgap.flight.errors import LogError, ModelError, UsageError
from wrenchgap.flight.write import provenance
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.data.recording import read_recording
from wrenchgap.learn.identify.disturbance import infer
from wrenchgap.plant import model_file
from wrenchgap.plant.allocation_problem import allocation_problem
from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.mismatch import LinearMismatch
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.simulation.tracking import deviation
from wrenchgap.plant.trajectory import named
from wrenchgap.replay.counterfactual.change import Change, believed_vehicle, changed_gains
from wrenchgap.replay.counterfactual.change import change as asked_change
from wrenchgap.replay.counterfactual.counterfactual import (
    CHANGED,
    Counterfactual,
    WeakLaw,
    counterfactual,
    refly,
)
from wrenchgap.replay.present.counterfactual import _sentence, notes, to_json
from wrenchgap.replay.present.documents import plain

MODEL = model_file.load("tilt_hexarotor")
COM = make_effect(MODEL.vehicle, "com_offset", {"x": -0.004, "y": 0.007, "z": -0.005})
LAG = make_effect(MODEL.vehicle, "servo_lag", {"tau": 0.05})
KNOWN = MODEL.with_effects([COM, LAG])
SECONDS = 6.0


def fly(truth=MODEL, trajectory=None, **more):
    """A flight with sensor noise whose controller believes MODEL."""
    path = named("multi_axis", 13.4, excitation=1.0) if trajectory is None else trajectory
    return simulate(truth, more.pop("believed", MODEL), path, SECONDS, rng=np.random.default_rng(11), **more)


@pytest.fixture(scope="module")
def hidden():
    """Flown with a displaced centre of mass and slow servos."""
    return fly(KNOWN)


def test_a_null_run_that_is_lost_before_any_pose_is_said_in_one_line(hidden):
    """A desired wrench far beyond the vehicle throws it away in its first periods, between two poses."""
    state = SimpleNamespace(time=hidden.odometry.time[0] + np.array([1e-3, 2e-3]))
    with pytest.raises(LogError, match=r"no pose from .* all that was flown"):
        deviation(state, hidden.odometry, 1e-3)


def record(log, model=MODEL, **more):
    return read_recording(opened(log, model), model.vehicle, **more)


def apart(reflight, log):
    """Largest distance [m] and angle [deg] between a re-flight and another flight's odometry."""
    state, other = reflight.flown.state, log.odometry
    inside = (other.time >= state.time[0]) & (other.time <= state.time[-1])
    at = other.time[inside]
    position = np.stack([np.interp(at, state.time, c) for c in state.position_E.T], axis=-1)
    turn = so3.log(so3.multiply(so3.conjugate(other.quat_EB[inside]), so3.interpolate(at, state.time, state.quat_EB)))
    distance = np.linalg.norm(position - other.position_E[inside], axis=-1).max()
    return distance, np.degrees(np.linalg.norm(turn, axis=-1).max())


def test_more_seconds_than_there_are_is_to_the_end(hidden):
    """However many: 1e308 s were an overflow."""
    assert record(hidden, duration=1e308).count == record(hidden, duration=60.0).count == record(hidden).count


def test_changing_nothing_reproduces_the_recorded_flight(hidden):
    result = counterfactual(record(hidden), MODEL)
    null = result.null_run
    # The odometry's own noise is 0.2 mm and 0.017 deg per axis: of 600 samples the largest is 4 to 5 of them.
    assert null.attitude_deg_max < 0.12
    assert null.position_m_max < 2e-3
    assert null.duration_s == pytest.approx(SECONDS, abs=0.03)
    assert result.inference.explained.min() > 0.98  # these gains flew
    assert result.caveats == ()
    assert result.changed is result.null


def test_a_wrong_model_of_the_controller_does_not_spoil_the_null_run_but_is_told(hidden):
    wrong = replace(MODEL, controller=ControllerGains(omega_position=1.0, omega_attitude=(9.0, 9.0, 9.0)))
    result = counterfactual(record(hidden), wrong)
    assert result.null_run.attitude_deg_max < 0.12
    assert result.null_run.position_m_max < 2e-3
    (weak,) = result.caveats
    assert isinstance(weak, WeakLaw)
    assert "torque_x" in weak.axes
    assert any("torque_x" in note and "[controller]" in note for note in notes(result))


def test_the_disturbance_is_what_was_injected():
    constant, wave = np.array([0.8, -0.5, 1.0, 0.1, -0.06, 0.04]), np.array([0.4, 0.0, 0.0, 0.0, 0.05, 0.0])
    log = fly(disturbance=lambda t: constant + wave * np.sin(2 * np.pi * 3.0 * t))
    r = record(log)
    found = infer(r, MODEL).disturbance
    t = r.time[r.window] + 0.5 * r.dt  # a disturbance is held over its period
    columns = np.stack([np.ones_like(t), np.sin(2 * np.pi * 3.0 * t), np.cos(2 * np.pi * 3.0 * t)], axis=1)
    inner = slice(100, -100)
    mean, sine, cosine = np.linalg.lstsq(columns[inner], found[inner], rcond=None)[0]
    tolerance = [0.02, 0.02, 0.02, 2e-3, 2e-3, 2e-3]
    assert np.all(np.abs([mean - constant, sine - wave, cosine]) < tolerance)


def test_nothing_is_left_to_the_disturbance_when_the_model_is_right(hidden):
    with_model, without = (infer(record(hidden), m).size for m in (KNOWN, MODEL))
    assert np.all(with_model.rms < without.rms / 3)
    # Accelerometer 2.3e-3 m/s^2/sqrt(Hz) over 25 Hz times 4 kg: 0.05 N. Gyroscope 2.4e-4 rad/s/sqrt(Hz), differentiated
    # below 25 Hz, 2 pi 2.4e-4 sqrt(25^3 / 3) = 0.11 rad/s^2, times 0.1 to 0.19 kg m^2: 0.011 to 0.021 Nm.
    assert np.all(with_model.rms[:3] < 0.1)
    assert np.all(with_model.rms[3:] < 0.04)
    assert np.all(with_model.rms_pull < 0.2 * with_model.rms)


def test_taking_the_true_effects_out_gives_the_flight_without_them(hidden):
    r = record(hidden)
    result = counterfactual(r, KNOWN, Change(plant=KNOWN.without(["com_offset", "servo_lag"]), words=("without",)))
    repaired = fly(MODEL)
    (_, before), (distance, angle) = apart(result.null, repaired), apart(result.changed, repaired)
    assert before > 2.0  # deg: what the effects did
    # Left are the two flights' own sensor noises, fed back and read: 0.12 deg and 1 mm when this was written.
    assert angle < min(0.25, 0.02 * before)
    assert distance < 3e-3


def test_adding_the_true_effects_gives_the_flight_with_them(hidden):
    result = counterfactual(record(fly(MODEL)), MODEL, Change(plant=KNOWN, words=("with",)))
    assert apart(result.null, hidden)[1] > 2.0
    assert apart(result.changed, hidden)[1] < 0.25
    assert apart(result.changed, hidden)[0] < 3e-3


def test_other_gains_bear_a_constant_torque_as_the_closed_form_says():
    torque = np.array([0.08, -0.05, 0.04])
    still = replace(MODEL, controller=replace(MODEL.controller, integral=0.0))
    log = fly(still, named("hover"), believed=still, disturbance=lambda t: np.concatenate((np.zeros(3), torque)))
    stiff = replace(still.controller, omega_attitude=(6.0, 5.0, 4.0))
    result = counterfactual(record(log, start=2.0), still, Change(gains=stiff, words=("stiff",)))
    state = result.changed.flown.state
    error = so3.log(state.quat_EB[-200:]).mean(axis=0)
    # e_R at rest: J w^2 e_R = M
    expected = torque / (np.diag(MODEL.vehicle.body.inertia) * np.array([6.0, 5.0, 4.0]) ** 2)
    assert np.sin(error) == pytest.approx(expected, rel=0.04, abs=5e-4)


def test_a_compensator_flies_against_the_inferred_disturbance_not_against_itself():
    torque = np.array([0.15, -0.1, 0.06])
    log = fly(disturbance=lambda t: np.concatenate((np.zeros(3), torque)))
    names = ("torque_x", "torque_y", "torque_z")
    no_integral = replace(MODEL.controller, integral=0.0)

    def reduced(believed_torque):
        mismatch = LinearMismatch(names, believed_torque, np.zeros((3, 6)), np.full(3, 1e-3))
        compensator = Compensator(mismatch, Settings(dt=0.005, filter_uncertain=False))
        change = Change(gains=no_integral, compensator=compensator, words=("compensated",))
        result = counterfactual(record(log, duration=4.0), MODEL, change)
        errors = [result.tracking[k].attitude_mean for k in ("uncompensated", "counterfactual")]
        return np.array(errors[1]) / np.array(errors[0]), result

    right, result = reduced(torque)
    assert np.all(right < 0.2)
    assert len(result.changed.steps) == len(result.changed.commanded)
    assert np.allclose((result.changed.commanded - result.changed.desired)[50:, 3:], -torque, atol=1e-3)
    wrong, _ = reduced(-torque)  # believes the opposite: the plant must not believe it with it
    assert np.all(wrong[:2] > 1.6)


def test_a_recorded_correction_flies_again():
    mismatch = LinearMismatch(("torque_x",), np.array([0.1]), np.zeros((1, 6)), np.array([1e-3]))
    log = fly(KNOWN, compensator=Compensator(mismatch, Settings(dt=0.005, filter_uncertain=False)))
    result = counterfactual(record(log), MODEL)
    assert result.null_run.attitude_deg_max < 0.12
    inner = slice(10, -10)
    assert np.allclose(result.null.commanded[inner, 3] - result.null.desired[inner, 3], -0.1, atol=2e-3)
    assert result.inference.explained.min() > 0.98  # the law makes the desired wrench, not the corrected one


def test_recorded_actuators_that_our_allocation_would_not_send_are_sent_again(hidden):
    recorded = hidden.actuators
    wrapped = np.where(np.arange(len(recorded.time)) > 600, 2 * np.pi, 0.0)[:, None]
    other = replace(recorded, tilt=recorded.tilt + 0.03 + wrapped, rotor_speed=recorded.rotor_speed + 10.0)
    r = record(replace(hidden, actuators=other))
    null = refly(infer(r, MODEL))
    turn = np.exp(1j * null.flown.commands.tilt) / np.exp(1j * r.commands.tilt[r.window])
    assert np.allclose(turn, 1.0, atol=1e-9)
    assert np.allclose(null.flown.commands.rotor_speed, r.commands.rotor_speed[r.window], atol=1e-6)
    assert np.abs(np.diff(null.flown.commands.tilt, axis=0)).max() < 1.0  # the wrap is no motion


def test_starting_later_knows_the_integral_and_the_lag_of_before(hidden):
    result = counterfactual(record(hidden, KNOWN, start=3.0, duration=2.0), KNOWN)
    assert result.null_run.duration_s == pytest.approx(2.0)
    assert to_json(result)["start_s"] == pytest.approx(3.0, abs=0.01)
    frame = result.to_frame().set_index("run")
    assert list(frame.index) == list(result.tracking)
    assert frame.loc["null_run", "position_rms"] == result.tracking["null_run"].position_rms
    assert result.null_run.attitude_deg_max < 0.12
    # Were the integral forgotten, the residual torque would be off by k_i w^2 J q, here up to 0.02 Nm.
    assert np.abs(result.inference.pilot.offset[:, 3:].mean(axis=0)).max() < 2e-3
    assert np.abs(result.inference.pilot.integral).max() > 5e-3
    whole = infer(record(hidden, KNOWN), KNOWN)
    first = len(whole.disturbance) - (len(record(hidden).time) - result.inference.recording.first)
    same = whole.disturbance[first : first + len(result.inference.disturbance)]
    assert np.abs(same - result.inference.disturbance)[20:].max() < 0.02


def shifting(torque=0.1):
    mismatch = LinearMismatch(("torque_x",), np.array([torque]), np.zeros((1, 6)), np.array([1e-3]))
    return Compensator(mismatch, Settings(dt=0.005))


@pytest.mark.slow
@pytest.mark.parametrize("start", [{}, {"start": 3.0}])
@pytest.mark.parametrize("changed", [{}, {"compensator": True}, {"gains": True}, {"plant": True}])
def test_compiled_code_flies_again_what_plain_numpy_flies(hidden, start, changed):
    other = replace(hidden, actuators=replace(hidden.actuators, tilt=hidden.actuators.tilt + 0.03))
    inference = infer(record(other, KNOWN, duration=2.0, **start), KNOWN)
    lag = make_effect(MODEL.vehicle, "motor_lag", {"tau": 0.02})
    possible = {"gains": replace(MODEL.controller, integral=0.1), "plant": KNOWN.with_effects([COM, lag])}
    options = {name: possible[name] for name in changed if name in possible}
    each = [Change(**options, compensator=shifting() if "compensator" in changed else None) for _ in range(2)]
    one, plain_one = (refly(inference, change, compiled=c) for change, c in zip(each, (True, False), strict=True))
    for name in ("position_E", "quat_EB", "velocity_E", "omega_B"):
        assert getattr(one.flown.state, name) == pytest.approx(getattr(plain_one.flown.state, name), abs=1e-10)
    assert one.desired == pytest.approx(plain_one.desired, abs=1e-9)
    for name in ("wrench_B", "tilt", "rotor_speed"):
        assert getattr(one.flown.commands, name) == pytest.approx(getattr(plain_one.flown.commands, name), abs=1e-8)
    assert [s.sigma for s in one.steps] == pytest.approx([s.sigma for s in plain_one.steps], rel=1e-9)


def test_compiled_code_forgives_losing_control_where_the_recording_had_lost_it(hidden):
    inference = infer(record(hidden, KNOWN, duration=2.0), KNOWN)
    r = inference.recording
    far = replace(r, reference=replace(r.reference, position_E=r.reference.position_E + 50.0))
    far = replace(inference, recording=far)  # lost from the first period on, as the recording then is
    same, pushed = (refly(far, compiled=c).flown for c in (True, False))
    assert same.lost is pushed.lost is None
    astray = replace(inference, disturbance=inference.disturbance + np.array([0, 0, -200.0, 0, 0, 0]))
    same, pushed = (refly(astray, compiled=c).flown for c in (True, False))
    assert same.lost is not None
    assert str(same.lost) == str(pushed.lost)


def test_time_on_the_ground_is_left_out(hidden, grounded):
    late = grounded(hidden, 2.5)
    r = read_recording(opened(late, MODEL, keep=["take-off"]), MODEL.vehicle)
    assert r.time[0] == pytest.approx(2.5, abs=0.15)  # a low-pass of 1 Hz decides
    disturbance = infer(r, KNOWN).disturbance[:, 2]
    # Were the ground flown, the weight would be a disturbance for 2.5 s.
    assert np.abs(disturbance[50:]).max() < 0.05 * MODEL.vehicle.body.mass * 9.81
    with pytest.raises(UsageError, match="can be re-simulated within"):
        read_recording(opened(late, MODEL, keep=["take-off"]), MODEL.vehicle, start=1.0)


def test_two_runs_give_identical_numbers(hidden):
    one, two = (counterfactual(record(hidden, duration=2.0), KNOWN) for _ in range(2))
    assert np.array_equal(one.null.flown.state.quat_EB, two.null.flown.state.quat_EB)
    assert plain(to_json(one)) == plain(to_json(two))


def test_a_controller_that_knows_the_centre_of_mass_tracks_better():
    pd = replace(MODEL, controller=replace(MODEL.controller, integral=0.0))
    known = pd.with_effects([COM])
    log = fly(known, believed=pd)
    change = Change(believed=believed_vehicle(known, known), words=("believes",))
    result = counterfactual(record(log), known, change)
    before, after = (np.array(result.tracking[k].attitude_mean) for k in ("null_run", "counterfactual"))
    assert np.all(after[:2] < 0.1 * before[:2])
    with pytest.raises(ModelError, match="voliro_x: is a model of"):
        believed_vehicle(MODEL, model_file.load("voliro_x"))


def test_the_corrected_allocation_takes_the_attitude_error_of_the_rotors_away():
    """And the pseudo-inverse of the nominal vehicle, by its way, makes the flight that was flown."""
    pd = replace(MODEL, controller=replace(MODEL.controller, integral=0.0))
    weak = make_effect(pd.vehicle, "rotor_thrust", {f"rotor_{r}": -0.2 * (r == 3) for r in range(12)})
    zero = make_effect(pd.vehicle, "tilt_offset", {f"arm_{a}": 0.04 * (a == 1) for a in range(6)})
    flown = pd.with_effects([weak, zero, COM])
    r = record(fly(flown, believed=pd))
    made = counterfactual(r, flown, asked_change(flown, period=r.dt, allocation=flown))
    before, after = (np.array(made.tracking[k].attitude_mean) for k in ("null_run", "counterfactual"))
    assert np.all(after < 0.1 * before)
    assert made.tracking["counterfactual"].position_rms < 0.2 * made.tracking["null_run"].position_rms
    same = counterfactual(r, flown, Change(allocating=Allocator(allocation_problem(pd), rounds=0)))
    np.testing.assert_allclose(same.tracking["counterfactual"].attitude_mean / before, 1.0, atol=0.01)
    with pytest.raises(ModelError, match="its allocation asks other rotors"):
        asked_change(flown, period=r.dt, allocation=model_file.load("voliro_x"))


def test_with_a_compensator_and_another_allocation_each_is_flown_alone_too():
    mismatch = LinearMismatch(("torque_x",), np.array([0.1]), np.zeros((1, 6)), np.array([1e-3]))
    r = record(fly(), duration=2.0)
    asked = Change(allocating=Allocator(allocation_problem(MODEL)))
    result = counterfactual(r, MODEL, replace(asked, compensator=Compensator(mismatch, Settings(dt=r.dt))))
    assert list(result.baselines) == ["compensated, allocated nominally"]
    errors = [*result.tracking.values(), *result.baselines.values()]
    x = {
        name: float(one.attitude_mean[0])
        for name, one in zip(("log", "null", "alone", "both", "gp"), errors, strict=True)
    }
    assert x["alone"] == pytest.approx(x["null"], rel=0.1)  # nothing is wrong with these rotors
    assert x["both"] == pytest.approx(x["gp"], rel=0.1)
    assert x["both"] > 3.0 * x["alone"]  # a compensator that is wrong by 0.1 Nm


@pytest.mark.parametrize("text", ["foo=1", "integral", "integral=a", "integral=1,2", "omega_attitude=1,2"])
def test_gains_that_make_no_sense_are_refused(text):
    with pytest.raises(UsageError, match=r"--gains "):
        changed_gains(MODEL.controller, [text])


def test_gains_are_read():
    gains = changed_gains(MODEL.controller, ["integral=0", "omega_attitude=5", "zeta_attitude=1,2,3"])
    assert (gains.integral, gains.omega_attitude, gains.zeta_attitude) == (0.0, (5.0, 5.0, 5.0), (1.0, 2.0, 3.0))


def test_options_become_a_change():
    change = asked_change(KNOWN, period=0.005, without=["servo_lag"], with_=["com_offset=x:0.01"], gains=["integral=0"])
    assert [e.name for e in change.plant.effects] == ["com_offset"]
    assert change.plant.effect("com_offset").theta == pytest.approx([0.01, 0.0, 0.0])
    assert change.words == ("without servo_lag", "with com_offset=x:0.01", "gains integral=0")
    assert asked_change(KNOWN, period=0.005) == Change()


def test_the_command_writes_a_log_that_says_where_it_comes_from(hidden, result_of, tmp_path):
    target = tmp_path / "again.mcap"
    flight.write(hidden, tmp_path / "flown.mcap")
    options = ("-m", "tilt_hexarotor", "--duration", "3", "-o", target)
    found = result_of("counterfactual", "flown.mcap", *options, "--with", "servo_lag=0.1")
    assert found["schema"] == "wrenchgap.counterfactual/1"
    assert found["changes"] == ["with servo_lag=0.1"]
    assert found["null_run"]["position_m_max"] < 2e-3
    assert set(found["tracking"]) == {"recorded", "null_run", "counterfactual"}
    log = flight.load(target)
    assert log.start_ns - hidden.start_ns == 5_000_000  # begins where its first period does, on the recorded clock
    # The written log is a flight like any other: flown again with the changed plant in the model, nothing is left.
    model = MODEL.with_effects([make_effect(MODEL.vehicle, "servo_lag", [0.1])])
    again = counterfactual(record(log), model)
    assert again.null_run.position_m_max < 2e-4
    assert again.null_run.attitude_deg_max < 0.02
    assert provenance(target)["changes"] == "with servo_lag=0.1"


@pytest.mark.parametrize(
    ("before", "after", "harms"),
    [
        ((0.005, 2.3, 0.01), (0.109, 0.15, 0.01), False),  # hundreds of per cent of nothing, and the error is gone
        ((0.5, 0.5, 0.0), (1.0, 0.5, 0.0), True),
        ((0.001, 0.001, 0.0), (0.01, 0.01, 0.0), False),  # below what counts
    ],
)
def test_a_compensation_is_judged_by_the_whole_attitude_error(before, after, harms):
    def run(degrees):
        return SimpleNamespace(attitude_mean=np.sin(np.radians(degrees)))

    tracking = {"uncompensated": run(before), CHANGED: run(after)}
    found = Counterfactual._harmed(SimpleNamespace(uncompensated=True, tracking=tracking))
    assert (found is not None) == harms
    if found is not None:
        assert (found.before, found.after) == pytest.approx((np.linalg.norm(before), np.linalg.norm(after)))
        assert f"from {found.before:.3f} to {found.after:.3f} deg" in _sentence(found, "flight", "model")


def test_a_compensator_that_is_not_compiled_is_told(hidden):
    """Plain models step tens of times as slowly; compiled ones and none at all say nothing."""

    class ByValue(LinearMismatch):
        """A model that is not given as arrays."""

        expansion = None

    names = ("torque_x", "torque_y", "torque_z")
    parts = names, np.full(3, 0.02), np.zeros((3, 6)), np.full(3, 1e-3)
    settings, recording, said = Settings(dt=0.005), record(hidden, duration=0.5), []
    for kind in (LinearMismatch, ByValue):
        change = Change(compensator=Compensator(kind(*parts), settings), words=("compensated",))
        result = counterfactual(recording, MODEL, change)
        said.append([note for note in notes(result) if "not compiled" in note])
        assert [note for note in to_json(result)["notes"] if "not compiled" in note] == said[-1]
    assert said[0] == []
    assert len(said[1]) == 1
    assert "ByValue is neither a process nor physics" in said[1][0]


def test_a_re_simulation_that_is_not_compiled_is_told(hidden):
    """A lag that decides by a value flies in plain numpy."""
    recording = record(hidden, duration=0.5)
    said = {}
    for name, values in (("motor_lag", (0.03,)), ("asymmetric_motor_lag", (0.02, 0.05))):
        lag = make_effect(MODEL.vehicle, name, values)
        change = Change(plant=MODEL.with_effects([lag]), words=(name,))
        said[name] = [note for note in notes(counterfactual(recording, MODEL, change)) if "plain numpy" in note]
    assert said["motor_lag"] == []
    assert len(said["asymmetric_motor_lag"]) == 1
    assert "asymmetric_motor_lag" in said["asymmetric_motor_lag"][0]


def test_feedback_is_asked_for_by_name_and_cut_off():
    model = MODEL.with_effects([LAG])
    change = asked_change(model, period=0.005, feedback=["observer=2", "INDI", "L1 = 4", "indi=8"])
    assert [name for name, _ in change.beside] == [
        "disturbance observer, 2 Hz",
        "INDI, 8 Hz, told 50 ms of lag",
        "L1, 4 Hz",
    ]
    every = asked_change(MODEL, period=0.005, feedback=["l1"], baselines=True).beside
    assert [name for name, _ in every] == ["disturbance observer, 1 Hz", "INDI, 8 Hz, told no lag", "L1, 1 Hz"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("pid", "--feedback pid: expected LAW or LAW=HZ with a law out of observer, indi, l1"),
        ("indi=fast", "--feedback indi=fast: 'fast' is no cut-off in Hz; for example indi=2"),
        ("indi=90", "INDI: got dt 0.005 s and a cut-off of 90.0 Hz, expected positive numbers and at most 31.8 Hz"),
        ("l1=-1", "L1: got dt 0.005 s and a cut-off of -1.0 Hz, expected positive numbers"),
        ("observer=nan", "bandwidth nan Hz must be positive"),
    ],
)
def test_feedback_that_makes_no_sense_gets_one_line(hidden, refused, tmp_path, text, said):
    flight.write(hidden, tmp_path / "flown.mcap")
    line = refused("counterfactual", "flown.mcap", "-m", "tilt_hexarotor", "--feedback", text)
    assert said in line


def test_feedback_takes_a_constant_wrench_off_attitude_and_position():
    """INDI and L1 see the force, the observer of torques does not."""
    pushed = np.array([1.5, -1.0, 0.5, 0.15, -0.1, 0.06])
    pd = replace(MODEL, controller=replace(MODEL.controller, integral=0.0))
    log = fly(pd, named("hover"), believed=pd, disturbance=lambda t: pushed)
    change = asked_change(pd, period=0.005, feedback=["observer=2", "indi=8", "l1=2"])
    result = counterfactual(record(log, pd, start=1.0), pd, change)
    before = result.tracking[CHANGED]
    for name, after in result.baselines.items():
        assert (after.attitude_median < 0.1 * before.attitude_median).all()
        moved = after.position_median / before.position_median
        assert moved > 0.9 if name.startswith("disturbance observer") else moved < 0.1
