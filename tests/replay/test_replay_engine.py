"""The compensation of a recorded flight: what it computes, where it starts afresh, what it writes and refuses."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from wrenchgap import flight
from wrenchgap.compensate import Compensator, Settings
from wrenchgap.flight import Gap, WrenchSeries
from wrenchgap.flight.check import TimeLeftOut
from wrenchgap.flight.errors import FitError, LogError, UsageError
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.process import store
from wrenchgap.learn.process.gp import FitSettings, Provenance
from wrenchgap.learn.process.train import fit
from wrenchgap.plant import model_file
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.trajectory import named
from wrenchgap.replay.compensation.replay import replay_compensation as replay
from wrenchgap.replay.compensation.source import source_by_name
from wrenchgap.replay.present.documents import write_csv
from wrenchgap.replay.present.replay import notes, summarise, to_json, warnings, write_log

MODEL = model_file.load("tilt_hexarotor")
TORQUES = ("torque_x", "torque_y", "torque_z")


def replayed_on(log, *args, model=MODEL, **more):
    """The log as the command opens it, replayed."""
    return replay(opened(log, model, rate_hz=np.inf, incomplete=True), model, *args, **more)


@pytest.fixture(scope="module")
def flown():
    """Six seconds with a centre of mass that the controller does not know."""
    truth = MODEL.with_effects([make_effect(MODEL.vehicle, "com_offset", [0.004, -0.007, 0.005])])
    path = named("hover", 6.0, excitation=2.0, seed=1)
    return simulate(truth, MODEL, path, rng=np.random.default_rng(1), name="offset")


@pytest.fixture(scope="module")
def gp(flown):
    records = opened(flown, MODEL).records
    commanded = np.concatenate([r.commanded for r in records])
    mismatch = np.concatenate([r.measured - r.commanded for r in records])[:, 3:]
    source = Provenance(vehicle="tilt_hexarotor", cutoff_hz=8.0, model_hash=model_file.content_hash(MODEL.nominal))
    return fit(commanded, mismatch, TORQUES, FitSettings(points=60, restarts=0), provenance=source)


@pytest.fixture(scope="module")
def result(flown, gp):
    return replayed_on(flown, gp)


def test_correction_makes_the_predicted_wrench_the_desired_one(result, flown):
    assert result.source == "desired"
    assert np.array_equal(result.time, flown.desired.time)
    assert np.array_equal(result.wrench, flown.desired.wrench_B)
    assert result.steps.commanded == pytest.approx(result.wrench + result.steps.correction, abs=1e-12)
    assert np.abs(result.steps.mismatch_before).mean() > 0.1
    assert np.abs(result.steps.mismatch_after).mean() < 0.03 * np.abs(result.steps.mismatch_before).mean()
    assert (result.steps.correction[:, :3] == 0).all()


def test_correction_is_the_weight_about_the_true_centre_of_mass(result, flown):
    """The plant loses r x F; a correction that knows it commands r x F more (Newton-Euler, slow flight)."""
    inner = slice(200, -200)
    lever = np.cross([0.004, -0.007, 0.005], flown.desired.wrench_B[inner, :3])
    error = result.steps.correction[inner, 3:] - lever
    assert np.abs(error).mean(axis=0).max() < 0.1 * np.abs(lever).max()


def test_measured_and_predicted_agree_where_there_is_a_measurement(result):
    known = np.isfinite(result.measured).all(axis=1)
    assert 0.7 < known.mean() < 1.0, "the filter's edges are left out, the rest is not"
    nominal = np.abs(result.measured - result.logged)[known, 3:].mean(axis=0)
    learnt = np.abs(result.measured - result.predicted)[known, 3:].mean(axis=0)
    assert (learnt[:2] < 0.2 * nominal[:2]).all()
    asked = np.abs(result.predicted_new - result.wrench)[known, 3:].mean(axis=0)
    assert (asked < 0.1 * nominal.max()).all(), "the new command would give what the controller wanted"


def test_the_error_of_the_command_is_the_one_that_compare_prints(result, flown):
    """Filtered on both sides in both commands; compare looks at fewer of the same samples."""
    (record,) = opened(flown, MODEL).records
    printed = np.abs(record.measured - record.commanded).mean(axis=0)
    assert summarise(result)["measured_minus_logged"] == pytest.approx(printed, rel=0.02)


def test_two_runs_give_the_same_bytes(flown, gp, tmp_path):
    for name in ("a", "b"):
        again = replayed_on(flown, gp)
        write_log(again, tmp_path / f"{name}.mcap", force=False)
        write_csv(again.to_frame(), tmp_path / f"{name}.csv", digits=None)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_log_is_the_flown_flight_with_the_replay_beside_it(result, flown, tmp_path):
    path = write_log(result, tmp_path / "r.mcap", force=False)
    back = flight.load(path)
    assert {role: s.topic for role, s in back.series().items()} == {role: s.topic for role, s in flown.series().items()}
    assert np.array_equal(back.commanded.wrench_B, flown.commanded.wrench_B)
    replayed = flight.load(path, {"commanded": "/replay/command", "desired": "/replay/correction"})
    assert np.array_equal(replayed.commanded.wrench_B, result.steps.commanded)
    assert np.array_equal(replayed.desired.wrench_B, result.steps.correction)


def test_compensator_starts_afresh_after_a_gap(flown, gp):
    """With every step distrusted, what is left of the past is all there is to see."""
    settings = Settings(sigma_threshold=0.0, kappa=40.0)
    time, wrench = flown.desired.time, flown.desired.wrench_B
    keep = (time < 3.0) | (time >= 3.5)
    first = int(np.searchsorted(time[keep], 3.5))
    gap = Gap(float(time[keep][first - 1]), float(time[keep][first]))
    holed = replace(flown, desired=WrenchSeries("/d", time[keep], wrench[keep], gaps=(gap,)))
    replayed = replayed_on(holed, gp, settings)
    assert replayed.restarts == 1
    fresh = Compensator(gp, replace(settings, dt=replayed.dt))
    for k in range(first, first + 5):
        assert replayed.steps.correction[k] == pytest.approx(fresh.step(wrench[keep][k]).correction, abs=1e-12)
    through = replayed_on(replace(holed, desired=WrenchSeries("/d", time[keep], wrench[keep])), gp, settings)
    assert through.restarts == 0
    assert not np.array_equal(through.steps.correction[first], replayed.steps.correction[first])


def test_log_with_actuators_only_gives_the_same_commands(flown, gp):
    """The allocation inverts the actuation, so rotor speeds and tilts contain the commanded wrench."""
    wrench, bare = replayed_on(flown, gp, source="commanded"), replace(flown, commanded=None, desired=None)
    actuators = replayed_on(bare, gp)
    assert actuators.source == "commanded"
    assert actuators.wrench == pytest.approx(wrench.wrench, abs=1e-9)
    assert actuators.steps.commanded == pytest.approx(wrench.steps.commanded, abs=1e-6)
    assert any("computed from" in note for note in notes(actuators))
    # Some logs sign a speed by the direction in which the rotor turns; its thrust has one direction only.
    turned = flown.actuators.rotor_speed * MODEL.vehicle.rotors.spin
    signed = replace(bare, actuators=replace(flown.actuators, rotor_speed=turned))
    assert np.array_equal(replayed_on(signed, gp).wrench, actuators.wrench)
    wrong = replace(bare, actuators=replace(flown.actuators, rotor_speed=turned[:, :5]))
    with pytest.raises(FitError, match="5 rotor speeds"):
        replayed_on(wrong, gp)


def test_log_without_motion_is_replayed_without_measurement(flown, gp):
    blind = replayed_on(replace(flown, imu=None, odometry=None), gp)
    assert np.isnan(blind.measured).all()
    assert np.isfinite(blind.steps.commanded).all()
    assert any("neither an IMU nor an odometry" in note for note in blind.notes)


def test_gp_that_cancels_the_command_is_told(flown, gp):
    """mu = -M: the measured torque never moves, and no command can be computed."""
    slope = np.zeros((3, 7))
    slope[:, 4:] = -np.eye(3) * gp.input_scale[3:] / gp.output_scale
    trapped = replace(gp, mean_coefficients=slope, residuals=np.zeros_like(gp.residuals))
    summary = summarise(replayed_on(flown, trapped))
    assert summary["eigenvalue_min"] == pytest.approx(0.0, abs=1e-6)
    assert any("nearly singular" in words for words in warnings(summary))


def test_saturation_of_the_new_commands_is_counted(flown, gp, result):
    rotors = replace(MODEL.vehicle.rotors, speed_max=np.full(12, 675.0))  # hover needs 674 rad/s
    tight = replace(MODEL, vehicle=replace(MODEL.vehicle, rotors=rotors))
    assert replayed_on(flown, gp, model=tight).saturation.rotor_speed > 0
    assert result.saturation.rotor_speed == 0


def test_refusals(flown, gp):
    other = replace(gp, provenance=replace(gp.provenance, vehicle="another"))
    with pytest.raises(FitError, match="another vehicle"):
        replayed_on(flown, other)
    three = {name: getattr(gp, name)[..., :3] for name in ("input_mean", "input_scale", "inputs", "lengthscales")}
    with pytest.raises(FitError, match="3 inputs"):
        replayed_on(flown, replace(gp, mean_coefficients=gp.mean_coefficients[:, :4], **three))
    with pytest.raises(LogError, match="no topic plays the role 'desired'"):
        replayed_on(replace(flown, desired=None), gp, source="desired")
    with pytest.raises(LogError, match="no topic plays the role 'commanded' or 'actuators'"):
        replayed_on(replace(flown, desired=None, commanded=None, actuators=None), gp)
    with pytest.raises(UsageError, match="expected desired or commanded"):
        source_by_name("wanted")


def test_command_writes_everything(flown, gp, result, run, tmp_path):
    flight.write(flown, tmp_path / "f.mcap")
    store.save(gp, tmp_path / "t.gp")
    asked = ["-o", "r.mcap", "--csv", "r.csv", "--parquet", "r.parquet", "--figure", "r.png", "--json", "r.json"]
    done = run("replay", "f.mcap", "-m", "tilt_hexarotor", "--gp", "t.gp", *asked)
    assert done.exit_code == 0, done.output
    assert "accepted" in done.output
    assert all((tmp_path / name).stat().st_size > 0 for name in asked[1::2])
    table = pd.read_parquet(tmp_path / "r.parquet")
    assert len(table) == len(result)
    assert table["commanded.torque_y"].to_numpy() == pytest.approx(result.steps.commanded[:, 4], abs=1e-9)
    assert table["beta"].to_numpy() == pytest.approx(result.steps.beta, abs=1e-9)
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "r.csv"), table, rtol=1e-13)


def test_time_on_the_ground_is_left_out(flown, gp, result, grounded):
    kept = opened(grounded(flown, 2.5), MODEL, rate_hz=np.inf, incomplete=True, keep=["take-off"])
    late = replay(kept, MODEL, gp)
    assert [n.why.split()[0].strip(":,") for n in kept.notes if isinstance(n, TimeLeftOut)] == ["held"]
    assert late.time[0] == pytest.approx(2.5, abs=0.15)  # a low-pass of 1 Hz decides
    assert late.time[-1] == flown.desired.time[-1]
    assert not result.restarts
    # What is left is the flight as it was: in the air the same corrections, but for where the search begins.
    air = result.steps.correction[np.isin(result.time, late.time)]
    np.testing.assert_allclose(late.steps.correction[100:], air[100:], atol=1e-4)


def test_only_the_part_between_two_times_is_replayed(flown, gp):
    part = replay(opened(flown, MODEL, rate_hz=np.inf, between=(1.0, 4.0)), MODEL, gp)
    assert part.time[0] == pytest.approx(1.0)
    assert part.time[-1] == pytest.approx(4.0)
    assert np.isfinite(part.measured).all(axis=1).mean() > 0.5


@pytest.mark.slow
def test_a_compensation_that_cannot_be_compiled_is_told(flown, gp, result):
    """A lag that differs by direction decides by a value, which no program writes down once it is led."""
    lag = make_effect(MODEL.vehicle, "asymmetric_motor_lag", {"tau_up": 0.03, "tau_down": 0.06})
    model = MODEL.with_effects([lag])
    source = replace(gp.provenance, model_hash=model_file.content_hash(model), physics="asymmetric_motor_lag")
    above = replace(gp, settings=replace(gp.settings, mean="physics"), provenance=source)
    few = Settings(max_evaluations=2)
    told = {lead: replayed_on(flown, above, few, model=model, lead=lead) for lead in (None, 0.02)}
    said = {lead: [n for n in notes(one) if "not compiled" in n] for lead, one in told.items()}
    assert said[None] == []
    assert len(said[0.02]) == 1
    assert "asymmetric_motor_lag" in said[0.02][0]
    assert "\n" not in said[0.02][0]
    assert said[0.02][0] in to_json(told[0.02])["notes"]
    assert not any("not compiled" in note for note in notes(result))
