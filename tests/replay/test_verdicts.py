"""From flights to a verdict for each output, and a compensation that obeys it."""

import json
import re
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.compensate import Compensator, Settings
from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.identify.learning import TORQUE, learn_process
from wrenchgap.learn.process import store
from wrenchgap.learn.process.alternatives import Alternative
from wrenchgap.learn.process.gp import Caution, CautionKind, FitSettings
from wrenchgap.learn.process.held_out_time import Decision, Reason, Verdict
from wrenchgap.plant import model_file
from wrenchgap.plant.mismatch import conditioning
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.trajectory import named
from wrenchgap.replay.compensation import compensators as compensating
from wrenchgap.replay.present.learning import _why_not
from wrenchgap.replay.present.verdicts import verdict

NAME = "tilt_hexarotor"
MODEL = model_file.load(NAME)
SLOW = MODEL.with_effects([make_effect(MODEL.vehicle, "servo_lag", [0.06])])
SHIFTED = MODEL.with_effects([make_effect(MODEL.vehicle, "com_offset", [-0.004, 0.007, -0.005])])
QUICK = FitSettings(points=40, restarts=0)


def flown(truth, excitation, name, seconds=20.0, trajectory="multi_axis"):
    still = replace(MODEL, controller=replace(MODEL.controller, integral=0.0))
    path = named(trajectory, seconds, excitation=excitation, seed=1)
    return simulate(truth, still, path, seconds, rng=np.random.default_rng(5), name=name)


def learnt(log, settings=QUICK):
    return learn_process([opened(log, MODEL)], MODEL, TORQUE, settings)


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """A flight of a vehicle that hides a lag alone, as a file, and what is learnt from it."""
    path = tmp_path_factory.mktemp("slow") / "slow.mcap"
    flight.write(flown(SLOW, 1.0, "slow"), path)
    found = learnt(flight.load(path))
    store.save(found.gp, path.with_suffix(".gp"))
    return path, found


@pytest.fixture(scope="module")
def shifted(tmp_path_factory):
    """The same with a displaced centre of mass."""
    path = tmp_path_factory.mktemp("shifted") / "shifted.mcap"
    flight.write(flown(SHIFTED, 1.0, "shifted"), path)
    found = learnt(flight.load(path))
    store.save(found.gp, path.with_suffix(".gp"))
    return path, found


def test_lag_alone_is_not_learnt(slow):
    """The torque is there, late: no function of the command corrects it, so every gain is zero."""
    gp = slow[1].gp
    assert gp.gain.tolist() == [0.0, 0.0, 0.0]
    assert (gp.provenance.verdicts[2].decision, gp.provenance.verdicts[2].reason) == (Decision.DO_NOT, Reason.LAG)
    assert 0.02 <= max(gp.provenance.lags) <= 0.07  # tilts are late, the differences between thrusts are not
    command = np.array([[0.0, 0.0, 39.0, 0.5, -0.5, 0.5]])
    assert np.abs(gp.mean(command)).max() == np.abs(gp.jacobian(command)).max() == 0.0
    assert gp.refused == TORQUE


def test_as_fitted_it_is_learnt_as_the_paper_does(slow):
    gp = learnt(flight.load(slow[0]), replace(QUICK, guarded=False)).gp
    assert (gp.gain == 1.0).all()
    assert gp.provenance.verdicts == ()
    assert np.abs(gp.mean(gp.input_mean + gp.input_scale * gp.inputs)).max() > 0.02


def test_nothing_hidden_gets_nothing():
    gp = learnt(flown(MODEL, 1.0, "plain")).gp
    assert [(v.decision, v.reason) for v in gp.provenance.verdicts] == [(Decision.DO_NOT, Reason.NOTHING)] * 3


def test_offset_is_compensated_nearly_in_full(shifted):
    gp = shifted[1].gp
    assert gp.refused == ()
    assert (gp.gain[:2] > 0.95).all()
    for one in gp.provenance.verdicts[:2]:
        point, low, high = one.reduction
        assert 0.9 < low < point < high <= 1.0
    assert gp.provenance.margin > 1.0
    said = gp.provenance
    assert (said.lags, said.observer_lag, said.loop_lag) == ((0.0, 0.0, 0.0), 0.0, 0.01)  # held-out time rules out more
    assert said.observer_hz > 1.0
    assert 1.0 < said.observer_peak <= 2.0
    assert said.gains == "log"


def test_smooth_training_is_corrected():
    """Nothing turns: the command cancels the offset and z = -W_cmd. I + dmu/dW is I (tests/learn/test_shown.py)."""
    log = flown(SHIFTED, 0.0, "smooth")
    gp = learnt(log).gp
    assert conditioning(gp, opened(log, MODEL).records[0].commanded).real_min.min() > 0.95
    assert "torque_x" in gp.settings.blind  # about y the feedback turns it a little
    # and what is learnt is the lever arm, c x F
    at = np.array([[3.0, -4.0, 38.0, 0.0, 0.0, 0.0]])
    lever = np.cross(SHIFTED.effects[0].theta, at[0, :3])
    assert gp.mean(at)[0, :2] == pytest.approx(-lever[:2], abs=0.25 * np.abs(lever).max())


def test_short_flight_needs_a_longer_one():
    gp = learnt(flown(SHIFTED, 1.0, "short", seconds=5.0)).gp
    assert {(v.decision, v.reason, v.gain) for v in gp.provenance.verdicts} == {(Decision.NEEDS, Reason.LONGER, 1.0)}
    assert gp.refused == ()


def test_compensator_refuses_what_learn_refuses_unless_told(slow):
    gp = slow[1].gp
    with pytest.raises(UsageError, match="not to compensate, and there is nothing else") as caught:
        Compensator(gp)
    assert "\n" not in str(caught.value)
    told = Compensator(gp, Settings(despite_verdict=True))
    wrench = np.array([0.0, 0.0, 39.0, 0.4, -0.3, 0.3])
    assert np.abs(told.step(wrench).correction).max() > 1e-3


def test_one_refused_output_is_left_alone_and_the_others_are_not(shifted):
    gp = shifted[1].gp
    kept, refused = gp.provenance.verdicts[:2], gp.provenance.verdicts[2]
    said = (*kept, replace(refused, decision=Decision.DO_NOT, reason=Reason.WORSE, gain=0.0))
    judged = replace(gp, gain=gp.gain * [1.0, 1.0, 0.0], provenance=replace(gp.provenance, verdicts=said))
    correction = Compensator(judged).step([2.0, 3.0, 39.0, 0.0, 0.0, 0.0]).correction
    assert correction[5] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(correction[3:5]).min() > 0.05


def test_physics_flies_on_where_the_process_is_refused():
    """The process on top of the true physics has nothing to say; the lever of the centre of mass is compensated."""
    log = opened(flown(SHIFTED, 1.0, "known"), SHIFTED)
    gp = learn_process([log], SHIFTED, TORQUE, replace(QUICK, mean="physics")).gp
    assert gp.refused == TORQUE
    loop = compensating.compensator(gp, SHIFTED)
    force = np.array([0.0, 0.0, 39.0])
    correction = loop.step([*force, 0.0, 0.0, 0.0], log.records[0].state.take(slice(0, 1))).correction
    assert correction[3:] == pytest.approx(np.cross(SHIFTED.effects[0].theta, force), abs=1e-6)


def test_combined_of_a_refused_process_is_the_observer_alone(slow):
    gp = slow[1].gp
    helper = compensating.combined(gp, MODEL, Settings(dt=0.005))
    assert helper.feedforward is None
    assert helper.bandwidth_hz == pytest.approx(gp.provenance.observer_hz)
    assert helper.lag.tolist() == [gp.provenance.observer_lag] * 3
    for more, why in (
        ({"observer_peak": 2.7, "observer_left": None}, "peak of the sensitivity of 2.7"),
        ({"observer_left": 0.84}, "would leave 84 %"),
        ({"loop_delay": 0.0}, "learn it again"),
    ):
        without = replace(gp.provenance, observer_hz=None, **more)
        with pytest.raises(FitError, match=f"no bandwidth for an observer.*{why}"):
            compensating.combined(replace(gp, provenance=without), MODEL)
        alone = compensating.combined(replace(gp, provenance=without), MODEL, Settings(despite_verdict=True))
        assert isinstance(alone, Compensator)
        assert re.search(why, alone.without_observer)


def test_verdicts_survive_the_file_and_older_files_have_none(slow, tmp_path):
    path, found = slow
    again = store.load(path.with_suffix(".gp"))
    assert again.provenance == found.gp.provenance
    assert again.settings == found.gp.settings
    assert np.array_equal(again.gain, found.gp.gain)
    older = tmp_path / "older.gp"
    with zipfile.ZipFile(path.with_suffix(".gp")) as new, zipfile.ZipFile(older, "w") as old:
        for name in new.namelist():
            if name == "gain.npy":
                continue
            content = new.read(name)
            if name == "gp.json":
                said = json.loads(content) | {"format_version": 2}
                later = ("observer_lag", "observer_peak", "loop_lag", "loop_delay", "gains")
                for key in ("verdicts", "lags", "margin", "observer_hz", *later):
                    del said["provenance"][key]
                for key in ("blind", "guarded"):
                    del said["settings"][key]
                content = json.dumps(said)
            old.writestr(name, content)
    loaded = store.load(older)
    assert loaded.gain.tolist() == [1.0, 1.0, 1.0]
    assert loaded.refused == ()


def test_bandwidth_of_a_version_that_did_not_look_at_the_loop_is_forgotten(slow, tmp_path):
    path, older = slow[0], tmp_path / "older.gp"
    with zipfile.ZipFile(path.with_suffix(".gp")) as new, zipfile.ZipFile(older, "w") as old:
        for name in new.namelist():
            content = new.read(name)
            if name == "gp.json":
                said = json.loads(content) | {"format_version": 3}
                for key in ("observer_lag", "observer_peak", "loop_lag", "loop_delay", "gains"):
                    del said["provenance"][key]
                content = json.dumps(said)
            old.writestr(name, content)
    loaded = store.load(older)
    assert slow[1].gp.provenance.observer_hz
    assert loaded.provenance.observer_hz is None
    assert loaded.provenance.verdicts == slow[1].gp.provenance.verdicts


def test_commands_obey(slow, refused, result_of):
    path, gp = slow[0], slow[0].with_suffix(".gp")
    for asked in (("replay", path), ("counterfactual", path), ("export",)):
        more = (gp, "-o", "out") if asked[0] == "export" else ("--gp", gp)
        assert "--despite-verdict" in refused(*asked, "-m", NAME, *more)
    result = result_of("replay", path, "-m", NAME, "--gp", gp, "--between", "2:4", "--despite-verdict")
    assert any("do not compensate: what is missing is a lag" in note for note in result["notes"])


def test_learn_ends_with_a_verdict_for_each_output(shifted, result_of):
    result = result_of("learn", shifted[0], "-m", NAME, "-o", "x.gp", "--points", 40, "--restarts", 0, "--no-guard")
    assert [v["output"] for v in result["verdicts"]] == list(TORQUE)
    assert result["verdicts"][0]["decision"] == "compensate"
    assert "held-out time supports it (gain" in result["verdicts"][0]["summary"]
    assert result["stability_margin"]["percentile_1"] > 1.0
    watched, said = result["observer"], shifted[1].gp.provenance
    assert (watched["hz"], watched["sensitivity_peak"]) == pytest.approx((said.observer_hz, said.observer_peak))
    assert (watched["lag_s"], watched["loop"]["lag_s"], watched["loop"]["gains"]) == (0.0, 0.01, "log")
    assert watched["summary"].startswith(
        f"observer of what the GP leaves: {said.observer_hz:.2g} Hz, told no lag; M_s is"
    )


def test_counterfactual_prints_the_margin_and_flies_gp_and_observer_together(shifted, result_of):
    path, gp = shifted[0], shifted[0].with_suffix(".gp")
    asked = ("counterfactual", path, "-m", NAME, "--gp", gp, "--start", 4, "--duration", 3, "--baselines")
    result = result_of(*asked)
    assert result["stability_margin"] > 1.0
    assert result["observer"]["hz"] == pytest.approx(shifted[1].gp.provenance.observer_hz)
    (together,) = [name for name in result["baselines"] if name.startswith("combined: GP and observer")]
    before = np.array(result["tracking"]["uncompensated"]["attitude_error"]["mean_abs"])
    after = np.array(result["baselines"][together]["attitude_error"]["mean_abs"])
    assert np.linalg.norm(after) < 0.4 * np.linalg.norm(before)  # most is the lean that the flight begins with


def test_a_verdict_and_a_warning_on_one_output_do_not_contradict_each_other():
    helps = Verdict("torque_x", Decision.COMPENSATE, Reason.HELPS, 0.9, (0.6, 0.5, 0.7))
    said = (Caution(CautionKind.NOT_WORTH_IT, ("torque_x",), (0.2,), (0.19,)),)
    assert "on unseen flights something simpler does as well" in verdict(helps, said)
    assert "simpler" not in verdict(replace(helps, output="torque_y"), said)
    assert "simpler" not in verdict(helps)


def test_alternatives_that_reduce_more_and_are_not_chosen_say_why():
    one = Alternative(FitSettings(), np.ones(3), 0.08, 1.0)
    assert _why_not(one) == "less than 10 %"
    assert _why_not(replace(one, gain=0.3)) == "within chance"
    assert _why_not(replace(one, gain=0.3, t=99.0)) == "another is better"
