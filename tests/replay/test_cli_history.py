"""Versions of a model on the command line: add, remove, history; own effects; what the GP absorbs."""

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest

from wrenchgap.plant import effects, model_file

MODEL = "tilt_hexarotor"
ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "effects" / "your-own.md").read_text(encoding="utf-8")


@pytest.fixture
def own(tmp_path):
    """The effect of the page docs/effects/your-own.md, as a file."""
    path = tmp_path / "field_torque.py"
    path.write_text(re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1], encoding="utf-8")
    yield path
    effects.forget()


def test_history_tells_what_add_and_remove_did(logs, run, result_of, tmp_path):
    """An effect is fitted, another besides, and both are taken out again; comments are kept."""
    added = result_of("add", "com_offset", "-m", MODEL, "--from", logs.train, "-o", "a.toml")
    assert added["schema"] == "wrenchgap.add/1"
    (effect,) = added["effects"]
    values = {p["name"]: p["value"] for p in effect["parameters"]}
    assert values == pytest.approx({"x": -0.004, "y": 0.007, "z": -0.005}, abs=2e-4)
    assert np.all(np.array(added["rms_after"][3:]) < 0.1 * np.array(added["rms_before"][3:]))
    (log,) = model_file.load("a.toml").effects[0].provenance.logs
    assert log == (logs.train.name, hashlib.sha256(logs.train.read_bytes()).hexdigest())
    original = (ROOT / "models" / f"{MODEL}.toml").read_text(encoding="utf-8")
    assert (tmp_path / "a.toml").read_text(encoding="utf-8").startswith(original.rstrip("\n"))
    assert added["model_version"] == 2
    assert added["held_out"]["outcome"] == "better"
    assert min(added["held_out"]["fall"][3:]) > 0.9
    again = result_of("add", "com_offset", "servo_lag", "-m", "a.toml", "--from", logs.train, "-o", "b.toml")
    assert again["refitted"] == ["com_offset"]
    assert [e["effect"] for e in again["effects"]] == ["com_offset", "servo_lag"]
    assert abs(again["effects"][1]["parameters"][0]["value"]) < 0.002  # there is no lag in these flights
    both = result_of("remove", "servo_lag", "com_offset", "-m", "b.toml", "-o", "d.toml")
    assert (both["removed"], both["effects"]) == (["servo_lag", "com_offset"], [])
    assert (tmp_path / "d.toml").read_text(encoding="utf-8").partition("\n[[history]]")[0] == original
    assert run("remove", "com_offset", "-m", "b.toml", "-o", "c.toml").exit_code == 0
    for name in ("a.toml", "b.toml"):
        (tmp_path / name).unlink()
    result = result_of("history", "c.toml")
    assert result["schema"] == "wrenchgap.history/1"
    versions = result["versions"]
    assert [v["version"] for v in versions] == [1, 2, 3, 4]
    assert [v["added"] for v in versions] == [[], ["com_offset"], ["servo_lag"], []]
    assert [v["removed"] for v in versions] == [[], [], [], ["com_offset"]]
    assert {c["effect"] for c in versions[2]["changed"]} == {"com_offset"}
    assert all(c["after_std"] > 0 for c in versions[2]["changed"])
    assert versions[1]["flights"][0]["file"] == "train.mcap"
    assert versions[1]["command"].startswith("wrenchgap add com_offset --model tilt_hexarotor")
    assert versions[2]["held_out"]["outcome"] == "unclear"
    assert versions[3]["held_out"] is None
    assert not result["changed_by_hand_since"]
    shown = run("history", "c.toml").stdout
    for word in ("+ com_offset", "+ servo_lag, ~ com_offset", "- com_offset", "as given: no effects"):
        assert word in shown


def test_history_notices_a_hand_on_the_file(run, result_of, tmp_path):
    assert run("add", "-m", MODEL, "--value", "mass=0.1", "-o", "a.toml").exit_code == 0
    path = tmp_path / "a.toml"
    path.write_text(path.read_text().replace("mass = 4.0", "mass = 4.1", 1))
    result = result_of("history", "a.toml")
    assert result["changed_by_hand_since"]
    assert "changed by hand after version 2" in result["notes"][0]


def test_a_model_without_history_says_so(run, result_of):
    assert "no history" in run("history", MODEL).stdout
    assert result_of("history", MODEL)["versions"] == []


def test_an_own_effect_flies_is_found_and_is_asked_for(run, result_of, refused, own):
    fly = ("simulate", "-m", MODEL, "-t", "multi_axis", "--excitation", 1, "--duration", 14)
    assert run(*fly, "--effects", own, "--hide", "field_torque=x:0.03,y:0.05", "-o", "f.mcap").exit_code == 0
    found = result_of(
        *("explain", "f.mcap", "-m", MODEL, "--effects", own),
        *("--effects-only", "field_torque,com_offset,constant_wrench,rotor_thrust"),
    )
    assert found["effects"] == ["field_torque"]
    values = {p["name"]: p["value"] for p in found["fitted"][0]["parameters"]}
    assert values == pytest.approx({"x": 0.03, "y": 0.05, "z": 0.0}, abs=1e-3)
    assert run("add", "field_torque", "-m", MODEL, "--from", "f.mcap", "--effects", own, "-o", "m.toml").exit_code == 0
    assert "--effects field_torque.py" in refused("compare", "f.mcap", "-m", "m.toml")
    result = result_of("compare", "f.mcap", "-m", "m.toml", "--effects", own)
    assert result["models"][1]["fall_of_rms"][3] > 0.9
    line = refused("add", "field_torque", "-m", MODEL, "--from", "f.mcap", "-o", "n.toml")
    assert "--effects FILE.py" in line  # the file of the last command is not remembered


def test_an_own_effect_that_fails_is_one_line(refused, own, logs):
    own.write_text(own.read_text().replace("np.cross(theta,", "np.cros(theta,"))
    line = refused("compare", logs.test, "-m", MODEL, "--effects", own)
    assert re.search(r"field_torque\.py:\d+: AttributeError", line)


def test_an_own_effect_that_fails_later_is_one_line(refused, own, logs, tmp_path):
    head = "    def apply(self, actuation, wrench_B, theta, context):\n"
    own.write_text(own.read_text().replace(head, head + "        assert len(wrench_B) < 100\n", 1))
    line = refused("add", "field_torque", "-m", MODEL, "--from", logs.train, "--effects", own, "-o", "m.toml")
    assert re.search(r"field_torque\.py:\d+: AssertionError", line)
    assert not (tmp_path / "m.toml").exists()


def test_history_of_a_simulation_s_truth_is_not_that_of_its_model(run):
    assert run("add", "-m", MODEL, "--value", "mass=0.1", "-o", "a.toml").exit_code == 0
    fly = ("simulate", "-m", "a.toml", "-t", "hover", "--duration", 2, "--hide", "mass=added:0.2", "-o", "h.mcap")
    assert run(*fly, "--truth", "t.toml").exit_code == 0
    assert model_file.load("t.toml").history == ()
