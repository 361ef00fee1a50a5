"""The report: the whole story on one page that needs nothing else."""

from __future__ import annotations

import base64
import html.parser
import re
import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.opening import open_flights
from wrenchgap.learn.diagnose import where
from wrenchgap.learn.identify.explain import explain
from wrenchgap.plant import model_file, trajectory_file
from wrenchgap.plant.moves import Moves, Turn
from wrenchgap.plant.trajectory_file import TrajectoryFile
from wrenchgap.replay.cli.main import app
from wrenchgap.replay.present.report import charts, markup
from wrenchgap.replay.present.report.page import page
from wrenchgap.replay.report import contents as gathering
from wrenchgap.replay.report.contents import Contents, gather

MODEL = "tilt_hexarotor"
TRIED = ("com_offset", "rotor_thrust", "constant_wrench", "thrust_scale", "ground_effect")
SECTIONS = ("timing", "error", "ranking", "parameters", "where", "left", "fly", "not-tried", "repeat")


class Reader(html.parser.HTMLParser):
    """Elements with their attributes, text by section, and whether every element is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.section = ""
        self.texts: dict[str, str] = {}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in markup.VOID:
            self.open.append(tag)
        if tag == "section":
            self.section = dict(attrs)["id"] or ""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts[self.section] = self.texts.get(self.section, "") + data


@pytest.fixture(scope="module")
def contents(logs: Any) -> Contents:
    model = model_file.load(MODEL)
    flights = open_flights([logs.train, logs.test], model)
    said = "wrenchgap report train.mcap -m tilt_hexarotor -o report.html"
    with pytest.MonkeyPatch.context() as patch:  # the budget's processes are tested with replay.where, and take long
        patch.setattr(where, "held_out_process", lambda *args, **kwargs: None)
        patch.setattr(gathering, "explain", partial(explain, names=TRIED))
        return gather(flights[:1], flights[1:], model, model_name=MODEL, command=said, common=" --cutoff 8")


@pytest.fixture(scope="module")
def written(contents: Contents) -> str:
    return page(contents)


def test_has_all_its_parts(written: str, contents: Contents) -> None:
    read = Reader(written)
    assert read.open == []
    assert [a["id"] for tag, a in read.elements if tag == "section"] == list(SECTIONS)
    assert "Explained by com_offset" in read.texts[""]
    for word in ("nominal", "+ com_offset", "sensor noise", "unseen flights (test)"):
        assert word in read.texts["error"]
    assert "rotor_thrust" in read.texts["ranking"]
    assert "95 % interval" in read.texts["parameters"]
    assert "With all effects" in read.texts["where"]
    assert "Is the rest white?" in read.texts["left"]
    for item in contents.inputs:
        assert item.sha256 in read.texts["repeat"]
    assert {i.role for i in contents.inputs} == {"log", "unseen log", "model"}
    assert "numpy" in read.texts["repeat"]


def test_needs_nothing_else_and_is_small(written: str) -> None:
    assert len(written) < 5e6
    for tag, attributes in Reader(written).elements:
        assert tag not in ("script", "link", "iframe", "object")
        for key in ("src", "href", "srcset", "poster", "data", "action"):
            value = attributes.get(key)
            assert value is None or value.startswith(("#", "data:"))
    assert not re.search(r"https?://|url\(|@import", written)


def test_every_image_says_what_it_shows(written: str) -> None:
    images = [a for tag, a in Reader(written).elements if tag == "img"]
    assert len(images) >= 6
    for image in images:
        assert len(image["alt"] or "") > 20
        kind, _, data = (image["src"] or "").partition(";base64,")
        start = {"data:image/png": b"\x89PNG", "data:image/svg+xml": b"<?xml"}[kind]
        assert base64.b64decode(data).startswith(start)


def test_staircase_falls_to_the_noise_on_both_kinds_of_data(contents: Contents) -> None:
    held_out, unseen = contents.staircases
    for case in (held_out, unseen):
        assert [s.name for s in case.falling][:2] == ["nominal", "+ com_offset"]
        nominal, fitted = case.stairs[:2]
        assert fitted.in_all < 0.2 * nominal.in_all
        np.testing.assert_array_less(fitted.rms[3:], 0.1 * nominal.rms[3:])
        np.testing.assert_allclose(fitted.rms, case.noise.rms, rtol=0.5)
    # what the nominal model misses is the torque of the force about the displaced centre of mass, -r x F
    force = np.concatenate([r.commanded[:, :3] for r in contents.unseen.records])
    torque = np.cross([-0.004, 0.007, -0.005], force)
    np.testing.assert_allclose(unseen.stairs[0].rms[3:], np.sqrt(np.mean(torque**2, axis=0)), rtol=0.05)


def test_the_model_inside_is_the_fitted_one(contents: Contents, written: str) -> None:
    (link,) = [a for tag, a in Reader(written).elements if tag == "a" and a.get("download")]
    text = base64.b64decode((link["href"] or "").partition(",")[2]).decode()
    model = model_file.loads(text)
    assert [e.name for e in model.effects] == ["com_offset"]
    np.testing.assert_allclose(model.effects[0].theta, [-0.004, 0.007, -0.005], atol=2e-4)
    assert [v.number for v in model.history] == [1, 2]
    assert not model_file.changed_since(model)


def test_commands_are_commands(contents: Contents) -> None:
    import typer

    known = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    lines = [shlex.split(line) for line in contents.commands]
    assert [words[1] for words in lines] == ["report", "explain", "add", "compare", "where", "learn"]
    for words in lines[1:]:
        known[words[1]].make_context(words[1], words[2:])
        assert words[-2:] == ["--cutoff", "8"]


def test_nothing_from_a_log_becomes_markup(contents: Contents, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(charts, "inline", lambda *args, **kwargs: "data:")
    evil = '<script>alert("x")</script>'
    model = replace(contents.model, path=Path(f"{evil}.toml"))
    cases = tuple(replace(s, title=evil) for s in contents.staircases)
    inputs = (replace(contents.inputs[0], file=evil),)
    texts = {"title": evil, "notes": (evil,), "fitted_text": evil, "commands": (evil,), "options": ((evil, evil),)}
    text = page(replace(contents, model=model, staircases=cases, inputs=inputs, **texts))
    assert "<script" not in text
    assert text.count("&lt;script&gt;alert(&quot;x&quot;)") > 8
    assert Reader(text).open == []


def test_markup_escapes_text_and_attributes_but_not_itself() -> None:
    made = markup.element("a", "<b>", markup.code("1 < 2"), None, ["&"], title='"q"', class_="x")
    assert made == '<a title="&quot;q&quot;" class="x">&lt;b&gt;<code>1 &lt; 2</code>&amp;</a>'


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "there.html"), "exists already"),
        (("-o", "report.pdf"), "expected a name that ends in .html"),
        (("-o", "gone/report.html"), "does not exist"),
        (("-o", "new.html", "--gp", "gone.gp"), "gone.gp"),
        (("-o", "new.html", "--validate", "gone.mcap"), "gone.mcap"),
    ],
)
def test_bad_use_is_one_line(logs: Any, run: Any, tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:
    (tmp_path / "there.html").write_text("mine")
    done = run("report", logs.test, "-m", MODEL, *arguments)
    assert done.exit_code == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert (tmp_path / "there.html").read_text() == "mine"
    assert [p.name for p in tmp_path.iterdir()] == ["there.html"]


def test_held_out_part_of_the_last_step_is_that_of_the_search(contents: Contents, logs: Any) -> None:
    """Two ways to the same number: the search's own, and the staircase's from the nominal vehicle upwards."""
    last = next(s for s in contents.staircases[0].falling if s.name == f"+ {contents.found.effects[-1]}")
    np.testing.assert_allclose(last.rms, contents.found.rms_after, rtol=0.02)
    records = open_flights([logs.train], contents.model)[0].records
    weights = dataset(records, contents.model).weights
    assert last.in_all == pytest.approx(float(np.linalg.norm(weights * last.rms)))


def test_a_group_gets_the_flight_that_separates_it(contents: Contents) -> None:
    """A designed flight is described, and its file can be saved and read; where there is none, the page says why."""
    turn = Turn(0.5, 7.0, 6.28)
    found = SimpleNamespace(
        file=TrajectoryFile("next", Moves(8.0, (0.0, 0.0, 1.5), (turn,))),
        segments=("turn",),
        before=SimpleNamespace(separation=0.3),
        expected=SimpleNamespace(separation=5.7),
        flown=(),
        separable=True,
        advice=("fly in <still> air",),
    )
    apart: Any = gathering.Apart(("com_offset", "rotor_thrust"), found)  # type: ignore[arg-type]
    groups = (apart, gathering.Apart(("mass", "payload"), None, "no <room>"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(charts, "inline", lambda *args, **kwargs: "data:")
        read = Reader(page(replace(contents, together=groups)))
    assert "To tell apart: com_offset or rotor_thrust" in read.texts["fly"]
    assert "No flight was designed: no <room>" in read.texts["fly"]
    (link,) = [a for _, a in read.elements if a.get("download") == "next-flight-1.toml"]
    text = base64.b64decode((link["href"] or "").partition(",")[2]).decode()
    assert trajectory_file.loads(text).trajectory.duration == pytest.approx(8.0)
