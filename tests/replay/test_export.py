"""The exported C: compiled as strictly as C99 can be, run under sanitisers over a simulated flight, beside Python."""

import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from tests.replay.exported_c import (
    COMPILER,
    DT,
    EFFECTS,
    MODEL,
    OFFSET,
    SANITISED,
    TORQUES,
    built,
    needs_compiler,
    process,
    selftest,
    stepped,
    with_effects,
)
from wrenchgap.compensate import Compensator, PhysicsMismatch, Settings
from wrenchgap.compensate.run import run as run_steps
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.learn.process.held_out_time import Decision, Reason, Verdict
from wrenchgap.learn.process.store import save
from wrenchgap.plant.effects import Parameter, Source, WrenchEffect, registered
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import named


@pytest.fixture(scope="module")
def flown():
    """Desired wrenches (K, 6) and states of four seconds of a simulated pitch flight with the effects hidden."""
    path, rng = named("pitch", 4.0), np.random.default_rng(3)
    log = simulate(with_effects(**EFFECTS), MODEL, path, rng=rng)
    time, pose = log.desired.time, log.odometry
    last = np.maximum(np.searchsorted(pose.time, time, side="right") - 1, 0)
    parts = (getattr(pose, n)[last] for n in ("position_E", "quat_EB", "velocity_E", "omega_B"))
    return log.desired.wrench_B, State(time, *parts)


CASES = {
    "process": ({}, ("zero", ()), None),
    "process with further inputs": ({}, ("zero", ("velocity", "rates", "position", "past")), None),
    "effects": (EFFECTS, None, None),
    "process on effects, lags led": (EFFECTS, ("physics", ()), 0.07),
}


@needs_compiler
@pytest.mark.parametrize("name", CASES)
def test_c_under_sanitisers_is_python_over_a_flight(name, flown, tmp_path):
    """Every step of 800: command, correction, optimum, sigma, beta to 1e-9; and what is expected of the command."""
    effects, fitted, lead = CASES[name]
    desired, states = flown
    model = with_effects(**effects)
    gp = None if fitted is None else process(desired, *fitted)
    settings = Settings(dt=DT, max_evaluations=12, solver="onboard")
    made = wg.export_compensator(gp, model, tmp_path / "c", settings, lead=lead)
    program = built(tmp_path / "c", *SANITISED)
    test = selftest(program)
    assert test.returncode == 0, test.stdout
    got = stepped(program, desired, states)
    physics = PhysicsMismatch(model.wrench_model, TORQUES, lead) if effects else None
    loop = Compensator(physics, settings) if gp is None else Compensator(gp, settings, physics=physics)
    python = run_steps(loop, desired, states)
    for k, field in enumerate(("wrench_cmd", "correction", "optimum")):
        assert got[:, 6 * k : 6 * k + 6] == pytest.approx(getattr(python, field), abs=1e-9), field
    expected = python.wrench_cmd.copy()
    expected[:, 3:] += python.after
    assert got[:, 18:24] == pytest.approx(expected, abs=1e-9)
    assert got[:, 25] == pytest.approx(python.beta, abs=1e-9)
    assert np.abs(got[:, 6:12]).max() > 0.005
    assert got[:, 27].max() <= made.cost.evaluations_worst + 1
    assert len(got) == len(desired) >= 700


@needs_compiler
def test_single_precision_is_near(flown, tmp_path):
    """A ten-thousandth of a newton metre beside forty newtons; the recorded steps likewise."""
    desired, states = flown
    model = with_effects(**EFFECTS)
    gp = process(desired, "physics")
    wg.export_compensator(gp, model, tmp_path / "c", Settings(dt=DT, max_evaluations=12), precision="float")
    single, double = built(tmp_path / "c"), built(tmp_path / "c", "-DWG_DOUBLE", name="double")
    assert selftest(single).returncode == selftest(double).returncode == 0
    apart = np.abs(stepped(single, desired, states) - stepped(double, desired, states))[:, :6]
    assert 0.0 < apart.max() < 2e-4


@needs_compiler
def test_c_knows_the_lever_of_the_force(flown, tmp_path):
    """Physics, not parity: against a centre of mass at c the torque c x F is added, and then the wrench is right."""
    desired, states = flown
    wg.export_compensator(None, with_effects(com_offset=OFFSET), tmp_path / "c")
    got = stepped(built(tmp_path / "c"), desired, states)
    assert got[:, 9:12] == pytest.approx(np.cross(OFFSET, desired[:, :3]), abs=1e-8)
    assert (got[:, 6:9] == 0).all()
    assert got[:, 18:24] == pytest.approx(desired, abs=1e-8)


class Powers(WrenchEffect):
    """A torque of powers and a logarithm of the pitch rate. Source: none."""

    name = "powers"
    excited_by = "pitch rate"
    needs_pose = True

    def parameters(self, vehicle):
        """Its size."""
        return (Parameter("size", "Nm", -1.0, 1.0, 0.1),)

    def apply(self, actuation, wrench_B, theta, context):
        """About z."""
        v = 20.0 * context.state.omega_B[:, 1]
        torque = theta[0] * (v**5 + (1.0 + v * v) ** -2 + np.log(2.0 + v * v))
        return np.stack((*[0.0 * torque] * 5, torque), axis=-1)


@needs_compiler
def test_powers_and_logarithms_of_an_own_effect_are_exported(flown, tmp_path):
    desired, states = flown
    with registered([(Powers(), Source("powers.py", "0" * 64))]):
        wg.export_compensator(None, with_effects(powers=[0.02]), tmp_path / "c")
        got = stepped(built(tmp_path / "c", *SANITISED), desired, states)
    v = 20.0 * states.omega_B[:, 1]
    assert v.min() < -0.5 < 0.5 < v.max()
    assert got[:, 11] == pytest.approx(-0.02 * (v**5 + 1.0 / (1.0 + v**2) ** 2 + np.log(2.0 + v**2)), abs=1e-9)


def test_what_is_refused_is_not_called_corrected(flown):
    """The verdict of `learn` takes the process off an output; effects and observer stay on it."""
    fitted = process(flown[0])
    said = tuple(
        Verdict(name, Decision.DO_NOT if name != "torque_y" else Decision.COMPENSATE, Reason.NOTHING, gain, ())
        for name, gain in (("torque_x", 0.0), ("torque_y", 1.0), ("torque_z", 0.0))
    )
    judged = replace(fitted, gain=np.array([0.0, 1.0, 0.0]), provenance=replace(fitted.provenance, verdicts=said))
    made = wg.export_compensator(judged, MODEL)
    assert made.corrected == "torque_y; torque_x, torque_z not corrected (verdict of learn)"
    assert f"Corrected: {made.corrected}, every" in made.files["README.md"]
    assert wg.export_compensator(fitted, MODEL).corrected == "torque_x, torque_y, torque_z"
    assert wg.export_compensator(
        judged, MODEL, settings=Settings(despite_verdict=True, max_evaluations=12)
    ).corrected.endswith("torque_z")
    watched = wg.export_compensator(judged, MODEL, observer=1.0, observer_max=0.1)
    assert watched.corrected == "torque_y; torque_x, torque_z by the observer alone"


@needs_compiler
def test_observer_enters_where_the_header_says(flown, tmp_path):
    """Feedback moves the wrench that is wanted; what is not finite is told, and what follows is a fresh start."""
    desired, states = (flown[0][:50], flown[1].take(slice(0, 50)))
    wg.export_compensator(process(flown[0]), MODEL, tmp_path / "c", Settings(dt=DT))
    program = built(tmp_path / "c")
    told = np.tile([0, 0, 0, 0.02, -0.03, 0.01], (50, 1))
    with_feedback, moved = stepped(program, desired, states, told), stepped(program, desired + told, states)
    assert np.array_equal(with_feedback, moved)
    broken = desired.copy()
    broken[10, 4] = np.nan
    got = stepped(program, broken, states)
    before, fresh = (stepped(program, desired[part], states.take(part)) for part in (slice(0, 10), slice(11, 50)))
    assert got[10, 28] == 1
    assert np.array_equal(got[10, :4], desired[10, :4])
    assert got[10, 4] == 0
    assert np.array_equal(np.delete(got, 10, axis=0), np.vstack((before, fresh)))


def test_source_allocates_nothing_and_needs_nothing(flown, tmp_path):
    made = wg.export_compensator(process(flown[0], "physics"), with_effects(**EFFECTS), tmp_path / "c")
    source = made.files["wrenchgap_compensator.c"] + made.files["wrenchgap_tables.h"]
    assert re.findall(r"#include\s+(\S+)", source) == ['"wrenchgap_compensator.h"', "<math.h>", '"wrenchgap_tables.h"']
    assert not re.search(r"\b(malloc|calloc|realloc|free|while|goto|printf)\b", source)
    assert not re.search(r"^static (?!const|void|int|wg_real wg_\w+\()", source, re.MULTILINE)
    again = wg.export_compensator(process(flown[0], "physics"), with_effects(**EFFECTS), tmp_path / "again")
    assert made.files == again.files
    assert sorted(p.name for p in tmp_path.iterdir()) == ["again", "c"]


def test_what_cannot_be_exported_is_refused_by_name(tmp_path, flown):
    slow = with_effects(asymmetric_motor_lag=[0.02, 0.05], com_offset=OFFSET)
    with pytest.raises(UsageError, match="export: asymmetric_motor_lag cannot be exported") as caught:
        wg.export_compensator(None, slow, tmp_path / "c", lead=0.05)
    assert "--without asymmetric_motor_lag" in str(caught.value)
    assert "com_offset" not in str(caught.value)
    assert not (tmp_path / "c").exists()
    left = wg.export_compensator(None, slow, tmp_path / "c", lead=0.05, without=["asymmetric_motor_lag"])
    assert left.effects == ("com_offset",)
    assert "asymmetric_motor_lag is not in it: left out as asked" in str(left)
    for words, how in (
        ("no such effect", {"without": ["wind"]}),
        ("precision: got str 'half'", {"precision": "half"}),
        ("regulariser", {"settings": Settings(regulariser=1.0)}),
    ):
        with pytest.raises(UsageError, match=words):
            wg.export_compensator(
                process(flown[0], "physics", effects=["asymmetric_motor_lag", "com_offset"]),
                slow,
                tmp_path / "d",
                **how,
            )
    with pytest.raises(UsageError, match="nothing to export"):
        wg.export_compensator(None, MODEL, tmp_path / "d")


def test_an_axis_that_is_made_only_with_others_is_not_corrected(tmp_path):
    quadrotor = wg.load_model("asymmetric_quadrotor")
    rotors = replace(quadrotor.vehicle.rotors, spin=np.ones(4))
    one_way = replace(quadrotor, vehicle=replace(quadrotor.vehicle, rotors=rotors))
    leaning = one_way.with_effects([make_effect(one_way.vehicle, "com_offset", OFFSET)])
    with pytest.raises(ModelError, match=r"only together with one another: a correction of .*torque_z"):
        wg.export_compensator(None, leaning, tmp_path / "c")


@needs_compiler
@pytest.mark.parametrize("how", [{}, {"observer": 2.0, "observer_max": 0.5}])
def test_no_compiler_needs_more_stack_or_state_than_is_stated(how, flown, tmp_path):
    """Without optimisation: every function's frame at once, of the physics the longest; gcc says how large they are."""
    made = wg.export_compensator(process(flown[0], "physics"), with_effects(**EFFECTS), tmp_path / "c", **how)
    words = [COMPILER, "-std=c99", "-O0", "-fstack-usage", "-c", "-o", "c.o", "wrenchgap_compensator.c"]
    if subprocess.run(words, cwd=tmp_path / "c", capture_output=True, check=False).returncode:
        pytest.skip("this compiler does not tell its stack")
    lines = next((tmp_path / "c").glob("*.su")).read_text().splitlines()
    frames = {where.rsplit(":", 1)[1]: int(size) for where, size, _ in (line.split("\t") for line in lines)}
    physics = [frames.pop(name) for name in [n for n in frames if "physics" in n]]
    assert len(physics) == 3
    assert sum(frames.values()) + max(physics) <= made.cost.stack < 2 * (sum(frames.values()) + max(physics))
    main = 'int main(void) { return !printf("%zu", sizeof(wg_memory)); }'
    (tmp_path / "c" / "size.c").write_text(f'#include "wrenchgap_compensator.h"\n#include <stdio.h>\n{main}')
    subprocess.run([COMPILER, "size.c", "-o", "size"], cwd=tmp_path / "c", check=True)
    size = subprocess.run(["./size"], cwd=tmp_path / "c", capture_output=True, text=True, check=True).stdout
    assert made.cost.memory - 24 <= int(size) <= made.cost.memory


def test_command_prints_what_a_step_costs_and_overwrites_only_when_told(run, refused, result_of, flown, tmp_path):
    save(process(flown[0]), tmp_path / "torque.gp")
    found = result_of("export", "torque.gp", "-m", "voliro_x", "-o", "made")
    assert found["schema"] == "wrenchgap.export/1"
    assert found["dt"] == pytest.approx(0.005)
    assert found["operations"]["at_worst"]["exp"] > found["operations"]["usual"]["exp"] > 3 * 60
    assert found["evaluations"]["at_worst"] == 25
    assert sorted(found["files"]) == sorted(p.name for p in (tmp_path / "made").iterdir())
    assert {i["role"] for i in found["inputs"]} == {"model", "gp"}
    assert 0.5 < found["solved"] <= 1.0
    assert "exists already" in refused("export", "torque.gp", "-m", "voliro_x", "-o", "made")
    again = run("export", "torque.gp", "-m", "voliro_x", "-o", "made", "--force")
    assert again.exit_code == 0
    assert "at worst" in again.stdout
    (tmp_path / "made" / "mine.txt").write_text("keep")
    assert "mine.txt" in refused("export", "torque.gp", "-m", "voliro_x", "-o", "made", "--force")
    assert (tmp_path / "made" / "mine.txt").read_text() == "keep"
    assert "does not exist" in refused("export", "torque.gp", "-m", "voliro_x", "-o", "no/made")
    assert "is no folder" in refused("export", "torque.gp", "-m", "voliro_x", "-o", "torque.gp")
    assert "another vehicle" in refused("export", "torque.gp", "-m", "tilt_hexarotor", "-o", "other")
    assert "positive" in refused("export", "torque.gp", "-m", "voliro_x", "-o", "other", "--dt", "0")
    assert json.loads(json.dumps(found)) == found


@needs_compiler
def test_make_and_readme_of_the_folder(flown, tmp_path):
    wg.export_compensator(process(flown[0]), MODEL, tmp_path / "c", names=("voliro_x.toml", "torque.gp"))
    if shutil.which("make") is None:
        pytest.skip("no make: sudo apt-get install make")
    done = subprocess.run(["make", "-C", str(tmp_path / "c"), "test"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(r"ok: \d+ steps", done.stdout)
    readme = (tmp_path / "c" / "README.md").read_text()
    assert "torque.gp" in readme
    assert "| at worst |" in readme


def test_what_a_user_has_in_the_folder_stays(tmp_path):
    model, folder = with_effects(com_offset=[0.01, 0.0, 0.0]), tmp_path / "comp"
    (folder / "selftest").mkdir(parents=True)
    with pytest.raises(UsageError, match="holds selftest, which this command did not write"):
        wg.export_compensator(None, model, folder, force=True)
    (folder / "selftest").rmdir()
    folder.rmdir()
    wg.export_compensator(None, model, folder)
    wg.save_model(model, tmp_path / "own.toml").path.replace(folder / "README.md")
    with pytest.raises(UsageError, match=r"the model .*README\.md is in it"):
        wg.export_compensator(None, wg.load_model(folder / "README.md"), folder, force=True)


def test_a_build_that_notices_no_number_is_refused(tmp_path):
    wg.export_compensator(None, with_effects(com_offset=[0.01, 0.0, 0.0]), tmp_path / "comp")
    words = [
        COMPILER,
        "-std=c99",
        "-ffast-math",
        "-c",
        "-o",
        tmp_path / "a.o",
        tmp_path / "comp/wrenchgap_compensator.c",
    ]
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "-ffast-math" in done.stderr
