"""`wrenchgap design` and the flight that `simulate -t` makes of it."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.learn.design import designer as search
from wrenchgap.plant.trajectory.file import load


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """Only one azimuth and one sweep of exchanges are tried."""
    monkeypatch.setattr(search, "SEARCH", replace(search.SEARCH, azimuths=(0.0,), sweeps=1))


@pytest.mark.slow
def test_a_group_is_told_apart_by_the_flight_that_is_designed_for_it(run, tmp_path):
    """From a hover that cannot tell, to a flight, its log, and the one name."""
    tether = "tether=force_x:0.8,force_z:-0.4,point_x:0.1"
    hexa = ("-m", "tilt_hexarotor")
    pair = ("tether", "constant_wrench")
    hovering = ("-t", "hover", "--duration", "8", "--hide", tether, "-o", "hover.mcap")
    assert run("simulate", *hexa, *hovering).exit_code == 0
    outputs = ("-o", "fly.toml", "--json", "d.json", "--csv", "fly.csv", "--figure", "fly.png")
    done = run("design", *pair, *hexa, "--from", "hover.mcap", "--duration", "9", *outputs)
    assert done.exit_code == 0, done.output
    assert "separates tether and constant_wrench" in done.output
    assert "The given logs: " in " ".join(done.output.split())

    found = json.loads((tmp_path / "d.json").read_text(encoding="utf-8"))
    assert found["schema"] == "wrenchgap.design/1"
    assert found["separable"]
    assert found["before"]["separation"] < 2.5 < found["expected"]["separation"]
    assert {d["truth"] for d in found["expected"]["directions"]} == set(pair)
    assert [e["effect"] for e in found["effects"]] == list(pair)
    fitted = {p["name"]: p["value"] for p in found["effects"][0]["parameters"]}
    assert fitted["force_x"] == pytest.approx(0.8, abs=0.1)
    assert (tmp_path / "fly.png").read_bytes()[:4] == b"\x89PNG"
    document = tomllib.loads((tmp_path / "fly.toml").read_text(encoding="utf-8"))
    assert document["purpose"]["separates"] == list(pair)
    assert document["purpose"]["logs"] == ["hover.mcap"]

    done = run("simulate", *hexa, "-t", "fly.toml", "--hide", tether, "-o", "fly.mcap", "--json", "s.json")
    assert done.exit_code == 0, done.output
    log = flight.load(tmp_path / "fly.mcap")
    want = load(tmp_path / "fly.toml").trajectory.at(log.reference.time)
    np.testing.assert_allclose(log.reference.position_E, want.position_E, atol=1e-9)
    np.testing.assert_allclose(log.reference.omega_D, want.omega_D, atol=1e-9)
    assert log.reference.time[-1] == pytest.approx(9.0, abs=0.01)
    table = np.genfromtxt(tmp_path / "fly.csv", delimiter=",", skip_header=1)
    np.testing.assert_allclose(table[: len(want.time), 1:4], want.position_E, atol=1e-6)
    named = run("explain", "fly.mcap", *hexa, "--effects-only", "tether,constant_wrench")
    assert "Explained by tether" in named.output
    assert "cannot tell" not in named.output


@pytest.mark.slow
def test_an_axis_that_will_not_be_measured_separates_nothing(run, tmp_path):
    """An offset of the centre of mass makes no force, so that a tether's is telling, where it is measured."""
    asked = ("design", "com_offset", "tether", "-m", "tilt_hexarotor", "--duration", "8", "--anyway", "-o", "d.toml")
    done = run(*asked, "--unmeasured", "force_x,force_y,force_z", "--json", "d.json")
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "d.json").read_text(encoding="utf-8"))
    for key in ("expected", "before"):
        for direction in found[key]["directions"]:
            for size in ("added_rms", "left_rms", "noise"):
                assert direction[size][:3] == [None] * 3
                assert None not in direction[size][3:]


def test_where_no_flight_helps_that_is_said_and_nothing_is_written(run, tmp_path, monkeypatch):
    kept, whole = [], search.design
    monkeypatch.setattr(search, "design", lambda *a, **k: kept.append(whole(*a, **k)) or kept[-1])
    arguments = ("design", "mass", "thrust_scale", "-m", "tilt_hexarotor", "--duration", "8", "-o", "no.toml")
    done = run(*arguments, "--json", "no.json")
    assert done.exit_code == 0, done.output
    words = " ".join(done.output.split())
    assert "No reference trajectory within these limits separates mass from thrust_scale" in words
    assert "weigh the vehicle" in words
    assert not (tmp_path / "no.toml").exists()
    assert kept[0].expected.share < 0.03  # an exact alias
    assert '"trajectory": null' in (tmp_path / "no.json").read_text(encoding="utf-8")
    monkeypatch.setattr(search, "design", lambda *_, **__: kept[0])
    assert run(*arguments, "--anyway", "-q").exit_code == 0
    assert load(tmp_path / "no.toml").trajectory.duration == 8.0
