"""The commands of docs/start/px4.md and docs/start/ardupilot.md, run as written on logs that are made here.

The logs have motor commands at 10 Hz, as both autopilots log them by default, PX4's beside setpoints at 50 Hz, and a
centre of mass that no file knows.
"""

import re
import shlex
import urllib.request

import pytest

import wrenchgap as wg
from tests.replay.autopilot_logs import HIDDEN, ROOT, every, flight, write_dataflash, write_ulog
from wrenchgap.viewer import page
from wrenchgap.viewer.page import Page

NAMES = ("healthy1", "healthy2", "suspect")
STEPS = ["check", "model", "inspect", "compare", "calibrate", "explain", "report", "view"]


def commands(page):
    """The page's commands, as lists of words, in the order of the page."""
    text = (ROOT / "docs" / "start" / page).read_text(encoding="utf-8")
    return [shlex.split(line, comments=True) for line in re.findall(r"^wrenchgap (.*)$", text, re.M)]


@pytest.mark.parametrize("page", ["px4.md", "ardupilot.md"])
def test_a_page_explains_no_flight_that_it_calibrates_on(page):
    """What a calibration takes in is not named any more: the answer would be gone."""
    logs = {words[0]: {w for w in words if re.search(r"\.(ulg|bin)$", w)} for words in commands(page)}
    assert len(logs["calibrate"]) > 1
    assert logs["explain"]
    assert not logs["calibrate"] & logs["explain"]


@pytest.fixture(scope="module")
def flights(autopilot_flights):
    """What the pages' commands are run on: two flights to calibrate on and a later one; with setpoints for PX4."""
    return [(every(flown, 10.0), every(flown, 50.0)) for flown in (*autopilot_flights, flight(3))]


@pytest.fixture
def looked(monkeypatch):
    """What `view` serves to the first who asks, by flights; the command ends as by Ctrl-C."""
    seen = {}

    class Looked(Page):
        @property
        def url(self):
            address = super().url
            with urllib.request.urlopen(address, timeout=60) as answer:
                seen[tuple(self.session.flights)] = answer.read(2000)
            self.stop()
            raise KeyboardInterrupt

    monkeypatch.setattr(page, "Page", Looked)
    return seen


def ran(run, words, folder):
    """What a command of a page prints; it succeeds, and writes what it was told to write."""
    done = run(*words, *(("--port", 0) if words[0] == "view" else ()))
    assert done.exit_code == (130 if words[0] == "view" else 0), f"{shlex.join(words)}: {done.output}"
    for option in ("-o", "--figure"):
        if option in words:
            assert (folder / words[words.index(option) + 1]).stat().st_size > 0
    return done.output


def judged(folder, later):
    """The calibrated model has the hidden offset, and predicts a later flight better than the drafted one."""
    drafted, calibrated = (wg.load_model(folder / name) for name in ("vehicle.toml", "calibrated.toml"))
    found = {v.name: v for effect in calibrated.snapshot if effect.effect == "com_offset" for v in effect.values}
    for axis, true in HIDDEN.items():
        assert found[axis].value == pytest.approx(true, abs=1.5e-3)
        assert abs(found[axis].value - true) < 3.0 * found[axis].std
    before, after = (
        wg.compare(wg.open_flights(later, model, cutoff_hz=3.0), model, ahead=False).evaluations[-1].pooled.rms[3:5]
        for model in (drafted, calibrated)
    )
    assert (after < 0.5 * before).all()


@pytest.mark.slow
def test_commands_of_the_page_on_px4(run, flights, looked, small_processes, tmp_path):
    """From a log with CA_ROTOR* to model, checks, comparison, calibration, explanation, report and page."""
    for name, flown in zip(NAMES, flights, strict=True):
        write_ulog(flown[0], tmp_path / f"{name}.ulg", flown[1])
    asked = commands("px4.md")
    assert [words[0] for words in asked if words[0] != "convert"] == STEPS
    said = {shlex.join(words): ran(run, words, tmp_path) for words in asked}
    (converted,) = wg.open_flights(tmp_path / "suspect.mcap", wg.load_model(tmp_path / "vehicle.toml"), cutoff_hz=3.0)
    assert converted.records
    assert any(text.startswith("model new") and "fitted" in out for text, out in said.items())
    assert "com_offset" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert b"<html" in looked["suspect",].lower()
    answer = " ".join(next(out for text, out in said.items() if text.startswith("explain")).split())
    assert re.search(r"The model already has, .* the centre of mass [\d.]+ mm towards the front left", answer)
    judged(tmp_path, tmp_path / "suspect.ulg")


@pytest.mark.slow
def test_commands_of_the_page_on_ardupilot(run, flights, tmp_path):
    """The same in short: frame, order of motors and curve are of the log's parameters."""
    for name, flown in zip(NAMES, flights, strict=True):
        write_dataflash(flown[0], tmp_path / f"{name}.bin")
    asked = commands("ardupilot.md")
    assert [words[0] for words in asked] == ["check", "model", "check", "compare", "calibrate", "explain"]
    for words in asked:
        ran(run, words, tmp_path)
    assert wg.load_model(tmp_path / "vehicle.toml").cutoff_hz == pytest.approx(3.8, abs=0.11)  # commands at 10 Hz
    judged(tmp_path, tmp_path / "suspect.bin")
