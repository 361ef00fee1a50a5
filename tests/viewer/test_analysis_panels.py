"""The panels of the analysis without a browser: their handles are pressed and moved as viser does for a client."""

import re
import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import psutil
import pytest

import wrenchgap as wg
from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.diagnose.where import Source
from wrenchgap.learn.posterior.verdict import Verdict
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.plant.effects import find
from wrenchgap.plant.model_file import loads
from wrenchgap.plant.wrench_model import ModelEffect, Provenance
from wrenchgap.replay.present import answer, design, explanation
from wrenchgap.replay.session import log_session
from wrenchgap.replay.session.log_session import LogSession
from wrenchgap.replay.session.panels.allocation import AllocationPanel
from wrenchgap.replay.session.panels.compensation import CompensationPanel
from wrenchgap.replay.session.panels.effects import NEXT, EffectsPanel
from wrenchgap.replay.session.panels.failure import VIEWS, FailurePanel
from wrenchgap.replay.session.panels.ready import ReadyPanel
from wrenchgap.replay.session.saving import SaveFolder
from wrenchgap.replay.session.working_model import Found, Revision
from wrenchgap.viewer import panel as panels
from wrenchgap.viewer.page import Page
from wrenchgap.viewer.scene_drawing import tidy

MODEL = wg.load_model("tilt_hexarotor")


def press(handle):
    """Click a button: an event as viser makes it when a client touched a control."""
    for callback in list(handle._impl.update_cb):
        callback(SimpleNamespace(client=None, client_id=1, target=handle))


def move(handle, value):
    """Move a slider, tick a box, choose or type something."""
    handle._impl.value = value
    press(handle)


def panel_of(page, kind):
    return next(p for p in page.panels if isinstance(p, kind))


def links(content):
    """(id of the button, title, letters) of every link in some HTML."""
    found = re.findall(r'<label for="([^"]+)" title="([^"]*)"[^>]*>(.*?)</label>', content, re.S)
    return [(uuid, title, re.sub("<[^>]+>", "", letters)) for uuid, title, letters in found]


def follow(panel, uuid):
    """Click a link: its label presses the button with that id."""
    press(next(b for b in panel.links._buttons if b._impl.uuid == uuid))


def follow_to(panel, content, words):
    """Click the first link that has these words in its title or its letters."""
    follow(panel, next(uuid for uuid, *said in links(content) if words in " ".join(said)))


@pytest.fixture
def work(eventually):
    """`work(job)` starts what is done beside the page, and waits for its end."""

    def worked(job):
        press(job.button)
        eventually(lambda: not job.running, seconds=60.0)

    return worked


def listening(page):
    """The page, with the errors that it tells kept in `told`."""
    page.told = []
    page.fail = lambda error, client=None: page.told.append(error)
    return page


@pytest.fixture
def page(page):
    """The page of the module, its model as it was opened, the first flight at its start; `told` keeps the errors."""
    while page.session.working.undoable:
        page.session.effects.undo()
    page.open("train")
    return listening(page)


@pytest.fixture
def failure(page):
    return panel_of(page, FailurePanel)


def test_a_click_on_a_cell_moves_cursor_scene_and_plots_to_its_worst_instant(page, failure):
    cells = re.findall(r'<label for="([^"]+)" title="[^"]*worst at ([\d.]+) s', failure.map.content)
    assert len(cells) > 40
    for uuid, at in cells[::17]:
        follow(failure, uuid)
        assert page.cursor.time == pytest.approx(float(at), abs=0.006)
        assert np.asarray(page.drawing.craft.frame.position) == pytest.approx(page.scene.position_E[page.cursor.index])


def test_the_page_says_whether_to_fly_and_not_of_another_flight(page, work):
    panel = panel_of(page, ReadyPanel)
    move(panel.payload, 0.4)
    work(panel.work)
    assert "on hover with 0.40 kg more" in panel.answer.content
    assert panel.answer.content.count("<tr>") == 1 + len(page.session.vehicle.rotors)
    page.open("test")
    assert panel.answer.content == ""


def test_the_page_looks_for_a_law_of_what_no_name_explains(page, work):
    panel = panel_of(page, EffectsPanel)
    assert panel.law.last() is None  # nothing was searched for on top of this model
    work(panel.law.work)
    assert "Nothing is left for a law" in panel.law.answer.content
    assert not panel.law.save.visible
    page.open("test")
    assert panel.law.answer.content == ""


def test_allocation_is_that_of_the_model_as_it_stands_and_can_be_downloaded(page, work):
    panel = panel_of(page, AllocationPanel)
    assert not panel.get.visible
    work(panel.work)
    rotors = len(page.session.vehicle.rotors)
    assert panel.answer.content.count("<tr>") == 1 + rotors
    assert "Null space of 6" in panel.answer.content
    assert panel.get.visible
    assert "wrenchgap_allocation.c" in panel.file.options
    sent = []
    panel.file.value = "wrenchgap_allocation.h"
    client = SimpleNamespace(send_file_download=lambda name, content, **_: sent.append((name, content)))
    for callback in list(panel.get._impl.update_cb):
        callback(SimpleNamespace(client=client, client_id=1, target=panel.get))
    [(name, content)] = sent
    assert name == "wrenchgap_allocation.h"
    assert b"WRENCHGAP_ALLOCATION_H" in content
    page.open("test")
    assert panel.answer.content == ""
    assert not panel.get.visible


def test_a_click_on_a_worst_stretch_goes_there(page, failure):
    stretches = [(uuid, letters) for uuid, title, letters in links(failure.map.content) if title == "go there"]
    assert len(stretches) == len(page.session.failures.of("train").worst)
    uuid, letters = stretches[2]
    follow(failure, uuid)
    start = float(letters.split(" s")[0])
    assert start - 0.1 <= page.cursor.time <= start + 1.1


def test_the_view_chooses_axis_and_kind_and_stays_for_the_next_log(page, failure):
    move(failure.view, "torque_y")
    found = page.session.failures.of("train").cells[0][0]
    milli = 1e3 if "[mNm]" in failure.map.content else 1.0
    for kind in ("mean", "rms"):
        move(failure.shown, kind)
        first = next(letters for _, title, letters in links(failure.map.content) if "worst at" in title)
        assert float(first) == pytest.approx(milli * getattr(found, kind)[VIEWS.index("torque_y")], rel=0.06)
    page.open("test")
    assert "Nm]" in failure.map.content
    move(failure.view, VIEWS[0])


def test_the_map_turns_white_when_the_effect_is_in(page, failure):
    def whiteness():
        colours = re.findall(r"background:rgb\((\d+),(\d+),(\d+)\)", failure.map.content)
        return np.mean(np.array(colours, dtype=float)) / 255.0

    before = whiteness()
    panel_of(page, EffectsPanel).add("com_offset")
    assert before < 0.6
    assert whiteness() > 0.95
    shares = re.findall(r"explained by the model&#39;s effects: (\d+)", failure.parts.content)
    assert int(shares[0]) > 90
    press(panel_of(page, EffectsPanel).back)
    assert whiteness() == before


def test_a_long_flight_is_looked_at_beside_the_page(page, failure, eventually, monkeypatch):
    monkeypatch.setattr(panels, "LONG", 5.0)
    found, asked = threading.Event(), failure.failures.of
    monkeypatch.setattr(failure.failures, "of", lambda flight: found.wait(20.0) and asked(flight))
    page.open("test")
    assert failure.failure is None
    assert "looking at test" in failure.map.content
    found.set()
    eventually(lambda: "worst at" in failure.map.content)
    assert failure.failure.flight == "test"
    panel_of(page, EffectsPanel).add("com_offset")  # meanwhile the old map stays, and then the new one comes
    eventually(lambda: "com_offset" in failure.failure.model)


def test_a_page_stands_before_a_long_flight_is_looked_at(page, failure, eventually, monkeypatch):
    monkeypatch.setattr(panels, "LONG", 5.0)
    begun, asked = threading.Event(), failure.failures.of
    monkeypatch.setattr(failure.failures, "of", lambda flight: begun.set() or asked(flight))
    with page.lock:
        page.open("test")
        assert not begun.wait(0.3)  # it would keep the session from the other parts of the page
    eventually(lambda: "worst at" in failure.map.content)
    assert begun.is_set()


def test_budget_asks_a_process_beside_the_page(page, failure, work, monkeypatch):
    def asked(flight, report):
        report(0.5, f"asking about {flight}")
        made, quarter = failure.budget, 0.25 * failure.budget.nominal
        return replace(made, process=quarter, unexplained=made.unexplained - quarter, source=Source.FITTED)

    monkeypatch.setattr(failure.failures, "full_budget", asked)
    assert "Gaussian process" not in failure.parts.content
    work(failure.work)
    assert "a Gaussian process would explain: 25\u00a0%" in failure.parts.content
    assert failure.work.button.visible
    assert page.told == []


@pytest.fixture
def effects(page):
    return panel_of(page, EffectsPanel)


def number(effects):
    """The large numbers of the panel: error on the flight shown, on the held-out flight [N]."""
    return [float(n) for n in re.findall(r'class="wg-large[^>]*>([\d.e+-]+) N', effects.stairs.content)]


def test_adding_lowers_both_numbers_and_undo_restores_the_page(page, effects):
    before, numbers = effects.stairs.content, number(effects)
    assert not effects.back.visible
    page.cursor.go(5.0)
    move(effects.choice, "com_offset")
    press(effects.put)
    assert page.cursor.time == pytest.approx(5.0)
    assert all(after < 0.2 * b for after, b in zip(number(effects), numbers, strict=True))
    assert "held out" in effects.stairs.content
    assert "predicted" in page.scene.wrenches
    assert effects.back.label == "Undo: add com_offset"
    added = effects.stairs.content
    press(effects.back)
    assert effects.stairs.content == before
    assert "predicted" not in page.scene.wrenches
    press(effects.again)
    assert effects.stairs.content == added


def test_the_errors_on_a_long_flight_come_beside_the_page_and_after_a_change_at_once(
    page, effects, eventually, monkeypatch
):
    monkeypatch.setattr(panels, "LONG", 5.0)
    found, asked = threading.Event(), effects.effects.staircases
    monkeypatch.setattr(effects.effects, "staircases", lambda flight: found.wait(20.0) and asked(flight))
    page.open("test")
    assert "looking at test" in effects.stairs.content
    assert number(effects) == []
    assert "com_offset" in effects.choice.options
    found.set()
    eventually(lambda: len(number(effects)) == 2)
    assert "looking at" not in effects.stairs.content
    before = number(effects)
    effects.add("com_offset")
    assert all(after < 0.2 * b for after, b in zip(number(effects), before, strict=True))


def test_a_slider_moves_the_error_live_and_undo_moves_the_slider(page, effects):
    effects.add("com_offset")
    handle, factor = effects.sliders.handles["com_offset", "y"]
    assert factor == 1e3  # millimetres
    fitted, best = handle.value, number(effects)
    assert fitted == pytest.approx(7.0, abs=0.3)
    move(handle, 3.0)
    assert all(after > 2.0 * b for after, b in zip(number(effects), best, strict=True))
    assert effects.sliders.handles["com_offset", "y"][0] is handle  # else a drag would end here
    assert page.session.model.effect("com_offset").theta[1] == pytest.approx(0.003)
    assert "by hand" in effects.inside.content
    press(effects.back)
    assert number(effects) == best
    assert handle.value == pytest.approx(fitted, abs=handle.step)
    assert effects.back.label == "Undo: add com_offset"  # moving it back was no change of its own


def test_removing_takes_the_sliders_along(page, effects):
    effects.add("com_offset")
    effects.add("inertia")
    assert {name for name, _ in effects.sliders.handles} == {"com_offset", "inertia"}
    effects.sliders.on_remove("inertia")
    assert {name for name, _ in effects.sliders.handles} == {"com_offset"}
    press(effects.refit)
    assert page.told == []
    assert effects.back.label == "Undo: fit on train"


def test_what_cannot_be_done_is_said_and_changes_nothing(page, effects):
    before = effects.stairs.content
    move(effects.choice, "-")
    press(effects.put)
    move(effects.pair, "servo_lag")
    press(effects.design.button)
    move(effects.path, "../model.toml")
    press(effects.save)
    move(effects.path, "")
    press(effects.save)
    for error, words in zip(page.told, ("cannot be added", "at least two", ".toml", ""), strict=True):
        assert words in str(error)
    assert effects.stairs.content == before


def test_the_model_is_saved_and_no_file_but_its_own_is_replaced(page, effects, tmp_path, monkeypatch):
    monkeypatch.setattr(page.session.effects, "folder", SaveFolder(tmp_path))
    (tmp_path / "mine.toml").write_text("")
    effects.add("com_offset")
    assert "not saved" in effects.stairs.content
    move(effects.path, "fitted.toml")
    press(effects.save)
    assert "not saved" not in effects.stairs.content
    effects.add("inertia")
    move(effects.path, "mine.toml")
    press(effects.save)
    assert "exists already" in str(page.told[-1])
    move(effects.path, "fitted.toml")
    press(effects.save)
    assert [e.name for e in wg.load_model(tmp_path / "fitted.toml").effects] == ["com_offset", "inertia"]
    assert (tmp_path / "mine.toml").read_text() == ""


def test_without_a_folder_the_model_goes_to_the_client_that_asks(page, effects):
    effects.add("com_offset")
    sent = []
    client = SimpleNamespace(send_file_download=lambda name, content, **how: sent.append((name, content)))
    effects.path.value = "fitted.toml"
    for callback in effects.save._impl.update_cb:
        callback(SimpleNamespace(client=client, client_id=1, target=effects.save))
    ((name, content),) = sent
    assert name == "fitted.toml"
    assert [e.name for e in loads(content.decode()).effects] == ["com_offset"]
    assert effects.save.label == "Download model"
    assert page.session.working.saved
    effects.add("inertia")
    assert not page.session.working.saved


def test_the_model_is_downloaded_for_an_autopilot_or_a_simulator(page, effects):
    effects.add("com_offset")
    sent = []
    client = SimpleNamespace(send_file_download=lambda name, content, **how: sent.append((name, content)))
    for target in ("mjcf", "px4"):
        effects.target.value = target
        for callback in effects.export._impl.update_cb:
            callback(SimpleNamespace(client=client, client_id=1, target=effects.export))
    assert [name for name, _ in sent] == ["mjcf.xml", "px4.params"]
    assert b"<mujoco" in sent[0][1]
    assert b"CA_ROTOR0_PX" in sent[1][1]


@pytest.mark.slow
def test_a_search_names_the_effect_and_its_link_adds_it(page, effects, work):
    work(effects.work)
    assert page.told == []
    assert ">MISSING<" in effects.found.content
    before = number(effects)
    follow_to(effects, effects.found.content, "com_offset")
    assert number(effects)[1] < 0.2 * before[1]
    assert "searched on top of" in effects.found.content


def test_a_cancelled_search_leaves_nothing_behind(page, effects, eventually):
    effects.effects.working.found.clear()
    press(effects.work.button)
    press(effects.work.stop)
    assert not effects.work.running
    assert effects.work.button.visible
    eventually(lambda: not any(job.is_alive() for job in page._jobs))
    assert effects.effects.working.found == {}
    assert page.told == []


def test_a_page_that_stops_leaves_no_search_running(flown, eventually):
    page = Page(LogSession(wg.open_flights(flown[0], MODEL), MODEL), port=0)
    before = set(psutil.Process().children(recursive=True))
    press(panel_of(page, EffectsPanel).work.button)
    started = eventually(lambda: set(psutil.Process().children(recursive=True)) - before)
    page.stop()
    eventually(lambda: not any(child.is_running() for child in started), "the search goes on without its page")


SENTENCE = "Something is missing, but no effect of the catalogue explains it. <b>It swings</b>."
GROUPS = (("servo_lag", "command_delay"),)
UNKNOWN = SimpleNamespace(
    verdict=Verdict.UNKNOWN,
    effects=(),
    firm=(),
    members=(),
    ranking=(),
    untried=(),
    limits=(),
    recoveries=(),
    model=SimpleNamespace(vehicle=None),
    separable=GROUPS,
    fit=SimpleNamespace(parameters=(), theta=(), std=()),
)


def designed_flight(names):
    """What the panel takes of a `Design`: a climb of 49 s at 1 cm/s."""

    def at(time):
        climb = 0.01 * time[:, None] * np.array([0.0, 0.0, 1.0])
        return SimpleNamespace(position_E=climb, quat_ED=np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1)))

    effects = tuple(SimpleNamespace(name=name) for name in names)
    trajectory = SimpleNamespace(duration=49.0, at=at)
    return SimpleNamespace(effects=effects, separable=True, segments=("shake",), trajectory=trajectory)


def test_unknown_is_said_plainly_and_leads_to_the_next_flight(page, effects, eventually, monkeypatch, tmp_path):
    asked = []

    def designed(names, flight, report):
        asked.append((names, flight))
        report(0.5, "flying")
        return designed_flight(names)

    monkeypatch.setattr(page.session.effects, "next_flight", designed)
    monkeypatch.setattr(page.session.effects, "trajectory_text", lambda found: "x = 1\n")
    monkeypatch.setattr(design, "sentence", lambda found: "This flight separates them.")
    monkeypatch.setattr(answer, "answer", lambda found: [SENTENCE, "Or one other (--details)."])
    monkeypatch.setattr(answer, "evidence", lambda found: ["It comes and goes."])
    monkeypatch.setattr(explanation, "open_in_words", lambda found: ("no further effect stands out",))
    effects.effects.working.found["explain", "train"] = Found(UNKNOWN, effects.effects.working.model, "tilt_hexarotor")
    effects.opened(page.scene)
    assert "NOT IN THE CATALOGUE" in effects.found.content
    assert "no effect of the catalogue explains" in effects.found.content
    assert "Or one other (below)." in effects.found.content, "the page has no options"
    assert "&lt;b&gt;It swings" in effects.found.content, "text from outside is no HTML"
    follow_to(effects, effects.found.content, "separate servo_lag")
    eventually(lambda: not effects.design.running)
    assert asked == [(("servo_lag", "command_delay"), "train")]
    assert "separates them" in effects.plan.content
    assert NEXT in page.drawing._curves
    monkeypatch.setattr(page.session.effects, "folder", SaveFolder(tmp_path))
    move(effects.plan_path, "next.toml")
    press(effects.plan_save)
    assert (tmp_path / "next.toml").read_text() == "x = 1\n"
    (tmp_path / "next.toml").write_text("changed by hand\n")
    press(effects.plan_save)
    assert "exists already" in str(page.told[-1])
    press(effects.plan_clear)
    assert NEXT not in page.drawing._curves
    effects.effects.working.found.clear()


def test_slider_steps_are_round_numbers():
    assert [tidy(x) for x in (0.0123, 0.7, 2.0, 49.0)] == pytest.approx([0.01, 0.5, 2.0, 20.0])


@pytest.fixture(scope="module")
def compensated(flown):
    """A page with a process."""
    train, test = flown
    settings = FitSettings(points=60, restarts=0, seed=0, pre_thin=300)
    gp = wg.learn_gp(wg.open_flights(train, MODEL), MODEL, settings=settings, guard=False).gp
    made = Page(LogSession(wg.open_flights(test, MODEL), MODEL, gp, gp_name="torque.gp"), port=0)
    yield listening(made)
    made.stop()


def plotted(page):
    """Titles of the plots that a replay brings."""
    return [s.title for s in page.scene.series if s.group == "Correction" and not s.title.startswith("sigma of pred")]


def test_without_a_process_the_panel_says_how_to_get_one(page):
    assert not panel_of(page, CompensationPanel).ready
    page.open("test")  # and does no harm


def test_without_a_process_feedback_flies_alone(page, work):
    panel = panel_of(page, CompensationPanel)
    assert panel.feedback is None
    move(panel.law, "L1 adaptive")
    assert panel.feedback == "l1"
    move(panel.cutoff, 2.0)
    assert panel.feedback == "l1=2"
    move(panel.start, 1.0)
    move(panel.seconds, 2.0)
    work(panel.again)
    assert page.told == []
    assert "corrected by L1, 2 Hz" in panel.flown.content


def test_a_replay_brings_correction_and_gate_and_the_switch_takes_them_away(compensated, work, eventually):
    panel = panel_of(compensated, CompensationPanel)
    assert plotted(compensated) == []
    work(panel.work)
    titles = [re.split(r",| \(", title)[0] for title in plotted(compensated)]
    assert titles == ["correction", "sigma of the correction", "beta"]
    before, after = (float(v) for v in re.findall(r">([\d.e-]+)</td>", panel.done.content)[:2])
    assert after < 0.3 * before
    move(panel.on, False)
    assert plotted(compensated) == []
    move(panel.on, True)
    eventually(lambda: not panel.work.running)
    assert len(plotted(compensated)) == 3
    assert compensated.told == []


def test_a_slider_replays_anew_and_the_last_one_wins(compensated, eventually):
    panel = panel_of(compensated, CompensationPanel)
    if not panel.done.content:
        panel.replay()
    for threshold in (0.05, 0.04, panel.threshold.step):
        move(panel.threshold, threshold)
    eventually(lambda: not panel.work.running)
    assert compensated.session.compensations.setting.gate.sigma_threshold == panel.threshold.step
    beta = next(s for s in compensated.scene.series if s.title.startswith("beta")).values["beta"]
    assert beta.mean() > 0.4
    assert compensated.told == []


def test_the_flight_is_re_simulated_as_a_ghost(compensated, work):
    panel = panel_of(compensated, CompensationPanel)
    desk = compensated.session.compensations
    desk.set(replace(desk.setting.gate, filter_uncertain=False))
    move(panel.start, 1.0)
    move(panel.seconds, 3.0)
    work(panel.again)
    assert compensated.told == []
    assert "tracking error" in panel.flown.content
    ghost = compensated.scene_panel.ghost_of("re-simulated")
    assert ghost.time[-1] - ghost.time[0] == pytest.approx(3.0, abs=0.1)
    assert "re-simulated" in compensated.scene_panel.ghost.options


def test_a_report_tests_on_flights_that_the_model_was_not_fitted_to(page, monkeypatch):
    """A flight that an effect had been fitted to was called unseen."""
    session, tested = page.session, []

    def reported(one, model, *, validate, gp, progress):
        tested.append([o.records[0].flight for o in validate])
        raise UsageError("enough")

    monkeypatch.setattr(log_session.wg, "report", reported)
    model, working = session.model, session.working
    logs = (("train.mcap", working.flight("train").flight.content_hash),)
    effect = ModelEffect(find("mass"), np.array([0.1]), provenance=Provenance(logs))
    for now in (model, model.with_replaced([effect])):
        working.change(Revision(now, "a change", ()))
        with pytest.raises(UsageError, match="enough"):
            session.report("test", lambda *_: None)
        working.undo()
    assert tested == [["train"], []]
