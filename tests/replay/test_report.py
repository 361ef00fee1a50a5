"""The report: the whole story on one page that needs nothing else."""

import base64
import html.parser
import re
import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer

import wrenchgap as wg
from wrenchgap.flight.errors import FitError
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.diagnose import where
from wrenchgap.learn.identify.staircase import Basis, Kind
from wrenchgap.learn.posterior.verdict import Verdict
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.plant import model_file
from wrenchgap.plant.trajectory import file as trajectory_file
from wrenchgap.plant.trajectory.file import TrajectoryFile
from wrenchgap.plant.trajectory.maneuvers import Moves, Turn
from wrenchgap.replay import report as contents
from wrenchgap.replay.cli.main import app
from wrenchgap.replay.present import report as report_package
from wrenchgap.replay.present import staircase
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.figures import where as where_figures
from wrenchgap.replay.present.report import Repetition, page, sections
from wrenchgap.replay.present.report import summary as page_words
from wrenchgap.replay.present.report.sections import Image
from wrenchgap.replay.report import NextFlight

MODEL = "tilt_hexarotor"
TRIED = ("com_offset", "rotor_thrust", "ground_effect")
VOID = ("img", "meta", "br", "hr")
SECTIONS = ("timing", "error", "ranking", "parameters", "where", "ahead", "left", "fly", "not-tried", "repeat")


class Reader(html.parser.HTMLParser):
    """Elements with their attributes, text by section, and whether every element is closed."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.open, self.section, self.texts = [], [], "", {}
        self.feed(text)

    def downloaded(self, name=None):
        """The text of the file that a link of the page saves."""
        (link,) = [a for _, a in self.elements if a.get("download") and name in (None, a["download"])]
        return base64.b64decode(link["href"].partition(",")[2]).decode()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "section":
            self.section = dict(attrs)["id"] or ""

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts[self.section] = self.texts.get(self.section, "") + data


@pytest.fixture(scope="module")
def made(logs):
    model = wg.load_model(MODEL)
    train, test = wg.open_flights([logs.train, logs.test], model)
    with pytest.MonkeyPatch.context() as patch:  # the budget's processes are tested with `where`, and take long
        patch.setattr(where, "held_out_process", lambda *args, **kwargs: None)
        return wg.report(train, model, names=TRIED, validate=test)


@pytest.fixture(scope="module")
def repetition(made):
    said = "wrenchgap report train.mcap -m tilt_hexarotor -o report.html"
    return Repetition.of(made, MODEL, said, " --cutoff 8")


@pytest.fixture(scope="module")
def written(made, repetition):
    return page(made, repetition)


@pytest.fixture(scope="module")
def read(written):
    return Reader(written)


@pytest.fixture
def without_charts(monkeypatch):
    monkeypatch.setattr(Image, "of", lambda figure, alt, caption, form="png": Image("data:", alt, caption))


def test_has_all_its_parts(read, made, repetition):
    assert read.open == []
    assert [a["id"] for tag, a in read.elements if tag == "section"] == list(SECTIONS)
    assert "com_offset" in read.texts[""]
    assert all(staircase.label(stair) in read.texts["error"] for case in made.staircases for stair in case.stairs)
    assert "rotor_thrust" in read.texts["ranking"]
    position = {one.name: one.rmse[1, 0] for one in made.ahead.models}
    assert position["fitted"] < 0.1 * position["nominal"]
    assert "fitted is off by" in read.texts["ahead"]
    assert read.texts["parameters"].count(" to ") >= 2 * 3  # an interval and a plausible range each
    assert all(sha256 in read.texts["repeat"] for _, _, sha256 in repetition.inputs)
    assert {role for role, _, _ in repetition.inputs} == {"log", "unseen log", "model"}
    assert dict(repetition.versions)["numpy"] == np.__version__


def test_needs_nothing_else_and_is_small(written, read):
    assert len(written) < 5e6
    for tag, attributes in read.elements:
        assert tag not in ("script", "link", "iframe", "object")
        for key in ("src", "href", "srcset", "poster", "data", "action"):
            value = attributes.get(key)
            assert value is None or value.startswith(("#", "data:"))
    assert not re.search(r"https?://|url\(|@import", written)


def test_every_image_says_what_it_shows(read):
    images = [a for tag, a in read.elements if tag == "img"]
    assert len(images) >= 6
    for image in images:
        assert len(image["alt"] or "") > 20
        kind, _, data = (image["src"] or "").partition(";base64,")
        start = {"data:image/png": b"\x89PNG", "data:image/svg+xml": b"<?xml"}[kind]
        assert base64.b64decode(data).startswith(start)


def test_error_goes_down_to_the_noise_on_both_kinds_of_data(made):
    held_out, unseen = made.staircases
    assert (held_out.basis, unseen.basis) == (Basis.HELD_OUT, Basis.UNSEEN)
    for case in (held_out, unseen):
        assert [(s.kind, s.name) for s in case.falling][:2] == [(Kind.NOMINAL, ""), (Kind.EFFECT, "com_offset")]
        nominal, fitted = case.stairs[:2]
        assert fitted.in_all < 0.2 * nominal.in_all
        np.testing.assert_array_less(fitted.rms[3:], 0.1 * nominal.rms[3:])
        np.testing.assert_allclose(fitted.rms, case.noise.rms, rtol=0.5)
    # what the nominal model misses is the torque of the force about the displaced centre of mass, -r x F
    force = np.concatenate([r.commanded[:, :3] for r in made.comparison.records])
    torque = np.cross([-0.004, 0.007, -0.005], force)
    np.testing.assert_allclose(unseen.stairs[0].rms[3:], np.sqrt(np.mean(torque**2, axis=0)), rtol=0.05)


def test_the_model_inside_is_the_fitted_one(read):
    model = model_file.loads(read.downloaded())
    assert [e.name for e in model.effects] == ["com_offset"]
    np.testing.assert_allclose(model.effects[0].theta, [-0.004, 0.007, -0.005], atol=2e-4)
    assert [v.number for v in model.history] == [1, 2]
    assert not model_file.changed_since(model)


def test_commands_are_commands(repetition):
    known = typer.main.get_command(app).commands
    lines = [shlex.split(line) for line in repetition.commands]
    assert [words[1] for words in lines] == ["report", "explain", "add", "compare", "where", "learn"]
    for words in lines[1:]:
        known[words[1]].make_context(words[1], words[2:])
        assert words[-2:] == ["--cutoff", "8"]


def test_what_is_unknown_gets_the_command_that_looks_for_its_law(made, repetition, without_charts):
    unknown = replace(made, explanation=replace(made.explanation, verdict=Verdict.UNKNOWN))
    again = Repetition.of(unknown, MODEL, "", " --cutoff 8")
    (said,) = (shlex.split(line) for line in again.commands if "discover" in line)
    typer.main.get_command(app).commands["discover"].make_context("discover", said[2:])
    assert "--validate" in said
    assert "discover looks for its law" in page(unknown, again)
    assert "discover" not in page(made, repetition)


def test_nothing_from_a_log_becomes_markup(made, repetition, without_charts, monkeypatch):
    evil = '<script>alert("x")</script>'
    timing = tuple(replace(t, flight=evil) for t in made.explanation.timing)
    flights = tuple(replace(f, records=tuple(replace(r, flight=evil) for r in f.records)) for f in made.flights)
    spoilt = replace(
        made,
        model=replace(made.model, path=Path(f"{evil}.toml")),
        explanation=replace(made.explanation, timing=timing, flights=flights),
        staircases=tuple(replace(s, flights=(evil,), basis=Basis.UNSEEN) for s in made.staircases),
        rest=replace(made.rest, notes=(evil,)),
        next_flights=(NextFlight((evil, "com_offset"), None, evil),),
        comparison=None,
    )
    inputs, options = (("log", evil, "0"),), ((evil, evil),)
    again = replace(repetition, inputs=inputs, commands=(evil,), options=options, fitted_model=evil, date=evil)
    monkeypatch.setattr(sections, "find", lambda name: SimpleNamespace(excited_by=evil))
    text = page(spoilt, again)
    assert "<script" not in text
    assert text.count("&lt;script&gt;alert(") > 12
    assert Reader(text).open == []


def test_no_template_switches_escaping_off():
    folder = Path(report_package.__file__).parent / "templates"
    sources = [path.read_text(encoding="utf-8") for path in folder.rglob("*.jinja")]
    assert len(sources) > 9
    assert not re.search(r"\|\s*safe|autoescape|Markup", "\n".join(sources))


def test_held_out_part_of_the_last_step_is_that_of_the_search(made, logs):
    """What the search found on held-out time is what the last step shows: it is the same fit."""
    last = made.staircases[0].falling[-1]
    assert last.name == made.explanation.effects[-1]
    np.testing.assert_allclose(last.rms, made.explanation.rms_after, rtol=1e-9)
    assert made.addition.model.effects[0].theta.tolist() == made.explanation.model.effects[0].theta.tolist()
    weights = dataset(wg.open_flights(logs.train, made.model)[0].records, made.model).weights
    assert last.in_all == pytest.approx(float(np.linalg.norm(weights * last.rms)))


def test_what_is_at_the_noise_is_not_said_to_lie_below_it(made):
    """The last step is at the sensor noise, whose own estimate may be a little larger: no share of it is stated."""
    case = made.staircases[0]
    first, second = case.stairs[:2]
    below = replace(case, stairs=(first, replace(second, in_all=0.8 * case.noise.in_all)))
    above = replace(case, stairs=(first, replace(second, in_all=2.0 * case.noise.in_all)))
    assert staircase.AT_THE_NOISE in staircase.sentence(below)
    assert "remains" not in staircase.sentence(below)
    assert not staircase.remains(below, below.stairs[1]).endswith("%")
    assert staircase.AT_THE_NOISE not in staircase.sentence(above)
    assert staircase.remains(above, above.stairs[1]).endswith("%")


def test_prints_tabulates_and_draws_itself(made):
    assert "com_offset" in str(made)
    frame = made.to_frame()
    assert len(frame) == sum(len(case.stairs) + 1 for case in made.staircases)
    np.testing.assert_allclose(frame["in_all"][0], made.staircases[0].stairs[0].in_all)
    assert len(made.plot()[0].patches) == sum(len(case.falling) + 1 for case in made.staircases)
    body = made.to_json()
    assert model_file.loads(body["fitted_model"]).effects[0].name == "com_offset"
    assert body["staircases"][0]["stairs"][0]["name"] == "nominal"


def test_a_given_process_is_told_what_it_was_learnt_on(logs, made):
    """On the model: what it absorbs. On the nominal vehicle below a model with effects it would count them twice."""
    model = made.model
    flights = wg.open_flights(logs.train, model)
    gp = wg.learn_gp(flights, model, settings=FitSettings(points=60, restarts=0), guard=False).gp
    same = contents._given(flights, model, gp)
    assert same.process.known
    assert same.absorption.effects == ("com_offset",)
    with pytest.raises(FitError, match=r"learnt on top of the nominal vehicle, and the effects of .* are com_offset"):
        contents.report(flights, made.addition.model, gp=gp)


def test_cells_that_are_empty_are_not_called_unmeasured(made):
    """A short flight has too few samples in every cell: one sentence takes the place of an empty picture."""
    grid = made.after.failure_map.grid
    void = np.full(grid.force.shape, np.nan)
    bare = replace(made.after.failure_map, grid=replace(grid, force=void, torque=void))
    shown = sections._maps(replace(made.after, failure_map=bare))
    assert not shown["grid"]
    assert "independent samples" in shown["no_grid"]
    half = replace(made.after, failure_map=replace(bare, grid=replace(grid, torque=void)))
    texts = [
        text.get_text() for panel in style.figure_of(where_figures.grid_picture(half)).axes for text in panel.texts
    ]
    assert texts == ["torque: too few samples in every cell"]
    noise = np.array([*made.after.noise[:3], *[np.nan] * 3])
    texts = [
        t.get_text()
        for panel in style.figure_of(where_figures.grid_picture(replace(half, noise=noise))).axes
        for t in panel.texts
    ]
    assert texts == ["torque: not measured"]


def test_only_effects_are_fitted_in_sample(made):
    seen = replace(made, unseen=())
    assert "in-sample" in page_words.where_on(seen)
    bare = SimpleNamespace(unseen=(), addition=SimpleNamespace(model=SimpleNamespace(effects=())))
    assert page_words.where_on(bare) == "the given logs"


def test_a_group_gets_the_flight_that_separates_it(made, repetition, without_charts):
    """A designed flight is described, and its file can be saved and read; where there is none, the page says why."""
    turn = Turn(0.5, 7.0, 6.28)
    found = SimpleNamespace(
        file=TrajectoryFile("next", Moves(8.0, (0.0, 0.0, 1.5), (turn,))),
        segments=("turn",),
        before=SimpleNamespace(separation=0.3),
        expected=SimpleNamespace(separation=5.7, names=("com_offset", "rotor_thrust")),
        flown=(),
        separable=True,
    )
    flights = (NextFlight(("com_offset", "rotor_thrust"), found), NextFlight(("mass", "payload"), None, "no <room>"))
    read = Reader(page(replace(made, next_flights=flights), repetition))
    assert "com_offset from rotor_thrust" in read.texts["fly"]
    assert "no <room>" in read.texts["fly"]
    assert trajectory_file.loads(read.downloaded("next-flight-1.toml")).trajectory.duration == pytest.approx(8.0)
