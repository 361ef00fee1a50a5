"""The observer in the exported C: beside Python over a flight, and alone against responses in closed form."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from tests.replay.exported_c import (
    DT,
    EFFECTS,
    MODEL,
    SANITISED,
    TORQUES,
    built,
    needs_compiler,
    process,
    selftest,
    stepped,
    with_effects,
)
from wrenchgap.compensate import Combined, Compensator, PhysicsMismatch, Settings
from wrenchgap.compensate.reach import reach_of
from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.identify.guard import loop_of
from wrenchgap.learn.process.held_out_time import Decision, Reason, Verdict
from wrenchgap.learn.process.store import save
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.stability import Observer, sensitivity_peak
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import named

HZ, DELAY = 3.0, 0.012
SETTINGS = Settings(dt=DT, max_evaluations=12, solver="onboard")
J = MODEL.vehicle.body.inertia


class Watched:
    """A helper that remembers what it was asked in which state, and what it answered."""

    def __init__(self, inner):
        self.inner, self.asked, self.states, self.answers, self.estimates, self.expected = inner, [], [], [], [], []

    def step(self, wrench, state):
        self.asked.append(np.array(wrench))
        self.states.append(state)
        made = self.inner.step(wrench, state)
        ahead, expected = self.inner.feedforward, made.wrench_cmd.copy()
        if ahead is not None:
            expected[3:] += ahead.expected(made.wrench_cmd)
        self.answers.append(made)
        self.estimates.append(self.inner.estimate)
        self.expected.append(expected)
        return made

    @property
    def state(self):
        fields = ("time", "position_E", "quat_EB", "velocity_E", "omega_B")
        return State(*(np.concatenate([getattr(s, name) for s in self.states]) for name in fields))


def refused(gp):
    """The same process, of which `learn` says that nothing is to be compensated."""
    verdicts = tuple(Verdict(axis, Decision.DO_NOT, Reason.NOTHING, 0.0, (0.0, 0.0, 0.0)) for axis in gp.outputs)
    return replace(gp, gain=np.zeros(3), provenance=replace(gp.provenance, verdicts=verdicts))


def known(hz=HZ, mean="physics", lag=0.0, effects=EFFECTS):
    """A process about hover whose file has a bandwidth."""
    rng = np.random.default_rng(2)
    hover = np.array([0.0, 0.0, 9.81 * MODEL.vehicle.body.mass, 0.0, 0.0, 0.0])
    gp = process(hover + rng.normal(size=(200, 6)) * [4.0, 4.0, 4.0, 0.2, 0.2, 0.2], mean, points=40, effects=effects)
    said = {"observer_lag": lag, "observer_peak": 1.5, "loop_lag": lag or 0.03, "loop_delay": 0.0075, "gains": "model"}
    return replace(gp, provenance=replace(gp.provenance, observer_hz=hz, **said))


LAG = 0.06
LATE = EFFECTS | {"command_delay": [DELAY]}
CASES = {
    "process that is told its lag": ({}, known(mean="zero", lag=LAG), "log", 0.4),
    "process on effects that is told lag and delay": (
        LATE,
        known(lag=LAG, effects=LATE),
        2.0,
        None,
    ),
    "process on effects": (EFFECTS, known(), "log", None),
    "process on effects with a delay": (LATE, known(effects=LATE), 2.0, None),
    "process": ({}, known(mean="zero"), "log", 0.4),
    "effects": (EFFECTS, None, HZ, 0.8),
    "nothing else": ({}, refused(known(mean="zero")), "log", None),
}


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("name", CASES)
def test_c_under_sanitisers_is_python_over_a_flight_in_closed_loop(name, tmp_path):
    """Feed-forward and observer fly; what they answered in 800 periods, and the estimate, the C gives to 1e-9."""
    effects, gp, hz, most = CASES[name]
    model = with_effects(**effects)
    alone = name == "nothing else"
    made = wg.export_compensator(gp, model, tmp_path / "c", SETTINGS, observer=hz, observer_max=most)
    ahead = None
    if not alone:
        physics = PhysicsMismatch(model.wrench_model, TORQUES) if effects else None
        ahead = Compensator(physics, SETTINGS) if gp is None else Compensator(gp, SETTINGS, physics=physics)
    bounds = np.full(3, most) if most else 3.0 * gp.mismatch_max
    delay, lag = DELAY if "delay" in name else 0.0, LAG if "told" in name or name == "effects" else 0.0
    hz_known = HZ if hz == "log" else hz
    loop = Watched(Combined(MODEL.vehicle, DT, hz_known, ahead, lag=lag, delay=delay, torque_max=bounds))
    simulate(with_effects(**EFFECTS), MODEL, named("pitch", 4.0), rng=np.random.default_rng(3), compensator=loop)
    program = built(tmp_path / "c", *SANITISED)
    test = selftest(program)
    assert test.returncode == 0, test.stdout
    got = stepped(program, np.array(loop.asked), loop.state)
    assert len(got) >= 700
    for k, field in enumerate(("wrench_cmd", "correction", "optimum")):
        expected = np.array([getattr(a, field) for a in loop.answers])
        assert got[:, 6 * k : 6 * k + 6] == pytest.approx(expected, abs=1e-9), field
    assert got[:, 18:24] == pytest.approx(np.array(loop.expected), abs=1e-9)
    assert got[:, 29:] == pytest.approx(np.array(loop.estimates), abs=1e-9)
    assert np.abs(got[:, 29:]).max() > 0.01
    assert made.observer_hz == pytest.approx(HZ if hz == "log" else hz)


def spun(torque, disturbance, hz, steps):
    """Rates (K, 3) about z of a body that makes what it is asked for and feels more, and the estimate (K,) that the
    observer then has: d (1 - (1 - k dt)^n), the first-order response in steps of dt.
    """
    k = 2.0 * np.pi * hz
    estimate = disturbance * (1.0 - (1.0 - k * DT) ** np.arange(steps))
    growth = DT * (torque - estimate + disturbance) / J[2, 2]
    omega = np.zeros((steps, 3))
    omega[1:, 2] = np.cumsum(growth[:-1])
    return omega, estimate


@pytest.fixture(scope="module")
def observer_alone(tmp_path_factory):
    folder = tmp_path_factory.mktemp("alone") / "c"
    wg.export_compensator(refused(known(mean="zero")), MODEL, folder, SETTINGS, observer=HZ, observer_max=0.2)
    return built(folder)


def held(steps):
    level = np.tile([1.0, 0.0, 0.0, 0.0], (steps, 1))
    still = np.zeros((steps, 3))
    return State(np.arange(steps) * DT, still, level, still, still)


@needs_compiler
def test_disturbance_is_found_as_a_first_order_low_pass(observer_alone):
    assert np.count_nonzero(J - np.diag(np.diag(J))) == 0
    torque, hidden = 0.05 * np.sin(0.1 * np.arange(150)), 0.11
    omega, estimate = spun(torque, hidden, HZ, 150)
    desired = np.zeros((150, 6))
    desired[:, 5] = torque
    got = stepped(observer_alone, desired, replace(held(150), omega_B=omega))
    assert got[:, 31] == pytest.approx(estimate, abs=1e-12)
    assert got[:, 5] == pytest.approx(torque - estimate, abs=1e-12)
    assert (got[:, :5] == 0).all()


@needs_compiler
def test_estimate_stops_at_its_bound_and_leaves_it_at_once(observer_alone):
    """A vehicle that is held: the estimate is -k times the integral of what is asked, bounded, without wind-up."""
    k = 2.0 * np.pi * HZ
    desired = np.zeros((400, 6))
    desired[:200, 3], desired[200:, 3] = 0.3, -0.3
    got = stepped(observer_alone, desired, held(400))[:, 29]
    time = np.arange(200) * DT
    assert got[:200] == pytest.approx(np.maximum(-0.2, -k * 0.3 * time), abs=1e-12)
    assert got[200:] == pytest.approx(np.minimum(0.2, -0.2 + k * 0.3 * time), abs=1e-12)


@needs_compiler
def test_bad_input_holds_the_estimate(observer_alone):
    """What happened in the period is not known: the estimate neither moves nor is lost, and no jump follows."""
    torque, hidden = np.zeros(150), 0.11
    omega, estimate = spun(torque, hidden, HZ, 150)
    rates = omega.copy()
    rates[100, 2] = np.nan
    got = stepped(observer_alone, np.zeros((150, 6)), replace(held(150), omega_B=rates))
    assert got[100, 28] == 1
    assert got[100, 5] == 0.0
    assert got[100, 31] == got[101, 31] == pytest.approx(estimate[99], abs=1e-12)
    assert np.isfinite(got).all()
    assert np.abs(np.diff(got[101:, 31])).max() < 2.0 * np.abs(np.diff(estimate)).max()


@needs_compiler
def test_single_precision_repeats_the_recorded_steps(tmp_path):
    model = with_effects(**EFFECTS)
    wg.export_compensator(known(), model, tmp_path / "c", SETTINGS, precision="float", observer="log")
    for flags in ((), ("-DWG_DOUBLE",)):
        done = selftest(built(tmp_path / "c", *flags))
        assert done.returncode == 0, done.stdout


@needs_compiler
@pytest.mark.parametrize("name", ["crazyflie", "asymmetric_quadrotor"])
def test_quadrotors_whose_yaw_is_out_of_reach_repeat_the_recorded_steps(name, tmp_path):
    """What is expected of a command that was limited is that of the whole command: its forces were moved too."""
    model = wg.load_model(name)
    model = model.with_effects([make_effect(model.vehicle, "com_offset", [0.0005, 0.0, 0.0])])
    torque = 0.5 * float(reach_of(model.vehicle).authority[3:].min())
    wg.export_compensator(None, model, tmp_path / "c", observer=2.0, observer_max=torque)
    done = selftest(built(tmp_path / "c"))
    assert done.returncode == 0, done.stdout


def test_observer_costs_and_is_told(tmp_path):
    model = with_effects(**EFFECTS)
    plain = wg.export_compensator(known(), model, tmp_path / "a", SETTINGS)
    both = wg.export_compensator(known(), model, tmp_path / "b", SETTINGS, observer="log")
    assert plain.observer_hz is None
    assert both.observer_hz == HZ
    assert both.observer_max == pytest.approx(3.0 * known().mismatch_max)
    assert all(both.cost.at_worst[k] >= plain.cost.at_worst[k] for k in plain.cost.at_worst)
    assert both.cost.at_worst["add"] - plain.cost.at_worst["add"] < 100
    assert both.cost.memory > plain.cost.memory
    assert "observer of 3 Hz (M_s " in str(both)
    assert "observer" not in str(plain)
    found = both.to_json()["observer"]
    assert (found["hz"], found["lag_s"], found["torque_max_nm"]) == (HZ, 0.0, list(both.observer_max))
    loop = replace(loop_of(model), lag=0.03)
    assert found["sensitivity_peak"] == pytest.approx(sensitivity_peak(loop, Observer(HZ)))
    assert found["sensitivity_peak"] > 2.0
    assert any("it rings; choose a lower --observer" in w for w in both.to_json()["warnings"])
    slow = wg.export_compensator(known(), model, tmp_path / "c", SETTINGS, observer=0.5)
    assert not any("rings" in w for w in slow.to_json()["warnings"])
    source = both.files["wrenchgap_compensator.c"]
    assert "malloc" not in source
    assert "while" not in source.replace("while wg_step", "")


@pytest.mark.parametrize(
    ("gp", "how", "said"),
    [
        (None, {"observer": "log"}, "there is no GP"),
        (known(hz=None), {"observer": "log"}, "peak of the sensitivity of 1.5"),
        (None, {"observer": 2.0}, "--observer-max NM"),
        (None, {"observer_max": 1.0}, "without --observer"),
        (None, {"observer": 2.0, "observer_max": -1.0}, "positive number of newton metres"),
        (known(), {"observer": 0.0}, "positive bandwidth"),
        (known(), {"observer": 99.0}, "at most 31.8 Hz"),
    ],
)
def test_impossible_observers_are_refused(gp, how, said, tmp_path):
    with pytest.raises(UsageError, match=said):
        wg.export_compensator(gp, with_effects(**EFFECTS), tmp_path / "c", SETTINGS, **how)
    assert not (tmp_path / "c").exists()


def test_command_takes_the_bandwidth_from_the_log_or_in_hertz(result_of, refused, tmp_path):
    save(known(mean="zero"), tmp_path / "torque.gp")
    found = result_of("export", "torque.gp", "-m", "voliro_x", "-o", "a", "--observer", "log")
    assert found["observer"]["hz"] == HZ
    found = result_of("export", "torque.gp", "-m", "voliro_x", "-o", "b", "--observer", "1.5", "--observer-max", "0.3")
    assert found["observer"]["hz"] == pytest.approx(1.5)
    assert found["observer"]["torque_max_nm"] == [0.3, 0.3, 0.3]
    assert "expected a bandwidth in Hz" in refused(
        "export", "torque.gp", "-m", "voliro_x", "-o", "c", "--observer", "fast"
    )
