"""From learning to compensating with physics as the mean, with more inputs, and with what `learn` warned of."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import wrenchgap as wg
from wrenchgap import flight
from wrenchgap.flight.errors import FitError, LogError
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.identify.learning import TORQUE, learn_process
from wrenchgap.learn.process import store
from wrenchgap.learn.process.gp import CautionKind, FitSettings
from wrenchgap.learn.process.predictors import OtherPhysics, predictors
from wrenchgap.plant import model_file
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.trajectory import named
from wrenchgap.replay.compensation import compensators as compensating
from wrenchgap.replay.compensation.compensators import OtherVersion
from wrenchgap.replay.compensation.replay import replay_compensation as replay
from wrenchgap.replay.present.learning import caution

NAME = "tilt_hexarotor"
MODEL = model_file.load(NAME)
OFFSET = np.array([-0.004, 0.007, -0.005])
KNOWN = MODEL.with_effects([make_effect(MODEL.vehicle, "com_offset", OFFSET)])
SLOW = MODEL.with_effects([make_effect(MODEL.vehicle, "servo_lag", [0.06])])
QUICK = FitSettings(points=40, restarts=0)
FAST = ("--points", 40, "--restarts", 0, "--no-guard")
LINES = ("constant offset", "linear in the command")


def flown(truth, trajectory, seconds, name, excitation=0.0, **more):
    path = named(trajectory, 12.0, excitation=excitation, seed=1)
    return simulate(truth, MODEL, path, seconds, rng=np.random.default_rng(5), name=name, **more)


@pytest.fixture(scope="module")
def files(logs, tmp_path_factory):
    """A folder with a model that knows the displaced centre of mass, and a short flight of that vehicle."""
    folder = tmp_path_factory.mktemp("known")
    model_file.save(KNOWN, folder / "good.toml")
    flight.write(flown(KNOWN, "figure8", 2.4, "short"), folder / "short.mcap")
    return folder


@pytest.fixture(scope="module")
def on_physics(logs, files):
    """A process on what the known centre of mass leaves: nothing but noise."""
    model = model_file.load(str(files / "good.toml"))
    flights = [opened(flight.load(path), model) for path in (logs.train, logs.test)]
    learnt = learn_process(flights[:1], model, TORQUE, replace(QUICK, mean="physics"), validation=flights[1:])
    store.save(learnt.gp, files / "rest.gp")
    return learnt


def test_learn_takes_the_effects_of_the_model_for_its_mean(logs, files, result_of):
    asked = ("learn", logs.train, "-m", files / "good.toml", "-o", "rest.gp", *FAST)
    result = result_of(*asked)
    assert (result["settings"]["mean"], result["physics"], result["absorbs"]) == ("physics", "com_offset", None)
    training = {m["name"]: m["rms"][3:] for m in result["training"]["models"]}
    assert list(training) == ["nominal", *LINES, "good", "good+GP"]
    assert all(left < 0.05 * before for left, before in zip(training["good+GP"], training["nominal"], strict=True))
    assert max(store.load("rest.gp").mismatch_max) < 0.05  # of 0.3 Nm
    plain = result_of(*asked[:-1], "--mean", "zero", "--no-guard", "--force")
    assert plain["physics"] == "nominal"
    assert plain["training"]["models"][-1]["name"] == "nominal+GP"
    assert max(store.load("rest.gp").mismatch_max) > 0.2


def test_replay_commands_the_lever_of_the_known_centre_of_mass(files, on_physics, result_of):
    """And repeats what learn said: the offset was all there was, so the process on top is not worth it."""
    asked = ("replay", files / "short.mcap", "-m", files / "good.toml", "--gp", files / "rest.gp", "--csv", "steps.csv")
    result = result_of(*asked)
    assert result["accepted"] == 1.0
    assert max(result["error_after_mean_abs"]) < 1e-5 < 0.05 < max(result["error_before_mean_abs"])
    table = pd.read_csv("steps.csv")
    wanted = flight.load(files / "short.mcap").desired
    correction = table[[f"correction.torque_{k}" for k in "xyz"]].to_numpy()
    lever = np.cross(OFFSET, wanted.wrench_B[:, :3])
    assert np.abs(correction - lever).max() < 0.02 * np.abs(lever).max()
    (said,) = on_physics.gp.provenance.warnings
    assert (said.kind, said.axes) == (CautionKind.NOT_WORTH_IT, TORQUE)
    assert any(caution(said) in note for note in result["notes"])


def test_counterfactual_flies_with_the_physics_in_the_compensation(files, on_physics, result_of):
    """Of the lean that the offset makes without an integral nearly nothing is left.

    Effects alone are all there is here: they do as well as with the process, and an observer does not have to.
    """
    asked = ("counterfactual", files / "short.mcap", "-m", files / "good.toml", "--gp", files / "rest.gp")
    result = result_of(
        *asked, "--gains", "integral=0", "--start", 0.5, "--duration", 1, "--baselines", "--feedback", "l1=2"
    )
    tracking = result["tracking"]
    before, after = (np.array(tracking[k]["attitude_error"]["mean_abs"]) for k in ("uncompensated", "counterfactual"))
    assert (after < 0.6 * before)[:2].all()
    names = ["disturbance observer, 1 Hz", "INDI, 8 Hz, told no lag", "L1, 1 Hz", "the effects of the model alone"]
    names.append("L1, 2 Hz")
    assert list(result["baselines"]) == names  # nothing but noise is left, and so no observer beside them
    assert result["baselines"][names[3]]["attitude_error"]["mean_abs"] == pytest.approx(after, abs=1e-3)
    assert any(caution(on_physics.gp.provenance.warnings[0]) in note for note in result["notes"])


def test_a_wrench_that_the_model_itself_made_is_told(logs, on_physics):
    """Without a commanded wrench, what the autopilot allocates with is not known."""
    assert CautionKind.ALLOCATED not in {c.kind for c in on_physics.cautions}
    alone = replace(flight.load(logs.train), commanded=None, desired=None)
    learnt = learn_process([opened(alone, MODEL)], MODEL, TORQUE, QUICK)
    (one,) = (c for c in learnt.cautions if c.kind is CautionKind.ALLOCATED)
    assert one in learnt.gp.provenance.warnings
    assert caution(one).startswith("No commanded wrench is logged")


def test_another_version_of_the_physics_is_told(on_physics):
    other = KNOWN.with_effects([make_effect(MODEL.vehicle, "com_offset", 2 * OFFSET)])
    assert OtherVersion(other.name, on_physics.gp.provenance.physics) in compensating.caveats(on_physics.gp, other)
    assert on_physics.gp.provenance.physics == "com_offset"
    assert not any(isinstance(c, OtherVersion) for c in compensating.caveats(on_physics.gp, KNOWN))


def test_physics_that_is_not_there_is_refused(files, on_physics, refused):
    asked = ("replay", files / "short.mcap", "--gp", files / "rest.gp", "-m")
    assert f"learnt on top of the effects com_offset, and the effects of {NAME} are none" in refused(*asked, NAME)
    assert "lead is 0.0 s" in refused(*asked, files / "good.toml", "--lead", 0)


def test_a_process_is_used_on_the_effects_that_it_was_learnt_on_and_on_no_others(files, on_physics, refused):
    """Other values of the same effects are another version, and told; other effects are another vehicle to it."""
    gp = on_physics.gp
    twice = KNOWN.with_effects([make_effect(MODEL.vehicle, "com_offset", 2 * OFFSET)])
    heavier = MODEL.with_effects([make_effect(MODEL.vehicle, "mass", {"added": 0.1})])
    more = heavier.with_effects([*heavier.effects, *KNOWN.effects])
    assert predictors(twice, (), gp)[1] == [OtherPhysics("com_offset")]
    assert wg.export_compensator(gp, twice, without=["com_offset"]).left_out == {"com_offset": "left out as asked"}
    for other, have in ((heavier, "mass"), (more, "com_offset, mass|mass, com_offset"), (MODEL, "none")):
        for use in (
            lambda m: predictors(m, (), gp),
            lambda m: wg.export_compensator(gp, m),
            lambda m: compensating.compensator(gp, m),
        ):
            with pytest.raises(FitError, match=f"learnt on top of the effects com_offset, .* are ({have}); give the"):
                use(other)
    assert predictors(heavier, [KNOWN], gp)[0][-1].model.effects == KNOWN.effects
    model_file.save(heavier, files / "heavier.toml", force=True)
    on = ("-m", files / "heavier.toml", "--gp", files / "rest.gp")
    assert "give the model that it was learnt on" in refused("compare", files / "short.mcap", *on)
    assert "give the model that it was learnt on" in refused("where", files / "short.mcap", *on)


def test_voltage_reaches_the_physics_and_is_asked_for_where_it_lacks():
    """Thrust that follows the battery, W (1 + q V - k): the correction is the falling share of the weight."""
    sag = MODEL.with_effects([make_effect(MODEL.vehicle, "battery_sag", {"sensitivity": 2.0, "per_volt": 0.08})])

    def learnt(log):
        return learn_process([opened(log, sag)], sag, ("force_z",), replace(QUICK, mean="physics")).gp

    log = flown(sag, "hover", 2.5, "battery", excitation=1.0, voltage=lambda time: 25.0 - time)
    gp = learnt(log)
    steps = replay(opened(log, sag), sag, gp).steps
    share = 2.0 - 0.08 * (25.0 - log.desired.time)
    expected = log.desired.wrench_B[:, 2] * share / (1.0 - share)
    assert np.abs(expected).max() > 2.0
    assert steps.correction[:-20, 2] == pytest.approx(expected[:-20], abs=0.1)
    blind = replace(log, battery=None)
    for attempt in (lambda: replay(opened(blind, sag), sag, gp), lambda: learnt(blind)):
        with pytest.raises(FitError, match="battery_sag: needs the battery voltage; map it with --topic battery="):
            attempt()


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """A folder with flights of a vehicle whose servos lag by 60 ms."""
    folder = tmp_path_factory.mktemp("slow")
    for name, path, seconds, excitation in (("train", "multi_axis", 12.0, 1.5), ("test", "figure8", 4.0, 1.0)):
        flight.write(flown(SLOW, path, seconds, name, excitation), folder / f"{name}.mcap")
    return folder


def test_past_of_the_command_sees_a_lag_from_learn_to_counterfactual(slow, result_of):
    """What slow servos leave of a command is a function of its past, not of its value."""
    asked = ("learn", slow / "train.mcap", "-m", NAME, "--validate", slow / "test.mcap", *FAST)
    rms = {}
    for name, more in (("plain", ()), ("past", ("--inputs", "past"))):
        result = result_of(*asked, *more, "-o", f"{name}.gp")
        rms[name] = {m["name"]: m["rms"][5] for m in result["validation"]["models"]}
    assert result["settings"]["inputs"] == ["past"]
    assert rms["past"]["nominal+GP"] < 0.6 * min(rms["plain"].values())
    assert not any("torque_z" in w and "no advantage" in w for w in result["warnings"])

    common = (slow / "test.mcap", "-m", NAME, "--gp", "past.gp")
    compared = result_of("compare", *common)
    assert compared["models"][-1]["rms"][5] == pytest.approx(rms["past"]["nominal+GP"])
    replayed = result_of("replay", *common)
    assert replayed["accepted"] > 0.9
    assert replayed["error_after_mean_abs"][2] < 0.2 * replayed["error_before_mean_abs"][2]
    reflown = result_of("counterfactual", *common, "--duration", 2)
    before, after = (reflown["tracking"][k]["attitude_error"]["rms"][2] for k in ("null_run", "counterfactual"))
    assert reflown["baselines"] == {}
    assert after < 0.9 * before


def test_log_without_pose_has_no_velocity_to_offer(slow):
    log = flight.load(slow / "train.mcap")
    gp = learn_process([opened(log, MODEL)], MODEL, TORQUE, replace(QUICK, inputs=("velocity",))).gp
    with pytest.raises(FitError, match="input velocity needs odometry"):
        replay(opened(replace(log, odometry=None), MODEL), MODEL, gp)
    with pytest.raises(LogError, match="depends on the motion, and the log has neither IMU nor odometry"):
        replay(opened(replace(log, imu=None, odometry=None), MODEL, incomplete=True), MODEL, gp)
