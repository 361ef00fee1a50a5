"""The page that takes logs, without a browser: what is kept of what was dropped, and what the server keeps of it."""

from dataclasses import dataclass

import pytest

from tests.replay.autopilot_logs import MASS, flight, write_ulog
from tests.viewer.test_analysis_panels import move, press
from wrenchgap.flight.errors import ModelError
from wrenchgap.learn import OpenFlight
from wrenchgap.replay.session.intake import Intake
from wrenchgap.replay.session.panels import logs
from wrenchgap.replay.session.panels.logs import of_page, session_of
from wrenchgap.replay.session.working_model import Found
from wrenchgap.viewer.file_drop import FileDrop
from wrenchgap.viewer.page import Page


def quiet(share, words):
    """Progress that nobody reads."""


@dataclass(frozen=True)
class Answer:
    """What a search found, as far as the page asks."""

    words: str
    flights: tuple[OpenFlight, ...] = ()


@pytest.fixture
def page():
    """A page that was started without anything."""
    made = Page(session_of(Intake(), quiet), port=0)
    yield made
    made.stop()


@pytest.fixture
def said(page, monkeypatch):
    """The errors that the page showed."""
    found: list[str] = []
    monkeypatch.setattr(page, "fail", lambda error, client=None: found.append(str(error)))
    return found


@pytest.fixture
def log(once, tmp_path):
    return write_ulog(once("autopilot flight 1", lambda: flight(1)), tmp_path / "flight.ulg").read_bytes()


def panel(page):
    """The tab that takes logs; the page makes a new one whenever it changes."""
    (found,) = (one for one in page.panels if isinstance(getattr(one, "drop", None), FileDrop))
    return found


def send(page, name, content, transfer="a"):
    drop = panel(page).drop
    drop.start(transfer, name, len(content))
    drop.part(transfer, content)


def kept(page):
    return list(panel(page).intake.dropped.iterdir())


def test_what_is_no_log_and_a_model_file_leave_nothing_on_the_disk(page, said, eventually):
    send(page, "notes.ulg", b"no log")
    eventually(lambda: said and not panel(page).work.running)
    assert "notes.ulg" in said[0]
    assert kept(page) == []
    before = panel(page)
    send(page, "mine.toml", b'schema = 1\n[vehicle]\nname = "x"\nmass = 1.0\ninertia = [0.01, 0.01, 0.02]\n')
    eventually(lambda: panel(page) is not before, "the model was not taken")
    assert panel(page).intake.model is not None
    assert kept(page) == []


def test_a_log_that_comes_during_work_is_refused_and_the_first_one_stays(page, said, log, eventually):
    before = panel(page)
    send(page, "first.ulg", log)
    eventually(lambda: before.work.running)
    send(page, "second.ulg", log + b"\0", "b")
    eventually(lambda: panel(page) is not before, "the first log was not opened", 60.0)
    assert ["drop second.ulg again" in words for words in said] == [True]
    assert page.session.flights == ("first.ulg",)
    assert [path.name for path in panel(page).intake.dropped.glob("*/*")] == ["first.ulg"]


def test_the_server_keeps_no_message_for_each_piece(page):
    """Thousands of pieces of one byte would otherwise stay in memory, and be sent to whoever opens the page later."""
    drop, buffer = panel(page).drop, page.server._websock_server.get_message_buffer()
    before = len(buffer.message_from_id)
    drop.start("a", "log.ulg", 10_000)
    for _ in range(3000):
        drop.part("a", b"x")
    assert len(buffer.message_from_id) < before + 100
    drop.end()


def test_a_file_that_comes_while_the_page_changes_is_not_begun(page):
    """It was left on the disk, or ended the connection: its controls had gone."""
    drop, kept_in = panel(page).drop, panel(page).intake.dropped
    page.replace(page.session)
    drop.start("a", "log.ulg", 10)
    drop.part("a", b"x")
    assert list(kept_in.iterdir()) == []


def test_a_log_whose_job_is_cancelled_when_its_work_is_done_leaves_nothing_on_the_disk(
    page, log, eventually, monkeypatch
):
    before, jobs = panel(page), []

    def cancelled_at_its_end(intake, report):
        made = session_of(intake, report)
        jobs.append(before.work._job)
        before.work.cancel()
        return made

    monkeypatch.setattr(logs, "session_of", cancelled_at_its_end)
    send(page, "first.ulg", log)
    eventually(lambda: jobs and not jobs[0].is_alive(), "the log was not opened", 60.0)
    assert page.session.flights != ("first.ulg",)
    assert kept(page) == []


def test_a_log_is_taken_however_many_clicks_wait(page, said, eventually):
    """It was left on the disk, and nothing was said."""
    while page._waiting.acquire(blocking=False):
        pass
    send(page, "notes.ulg", b"no log")
    eventually(lambda: said and not panel(page).work.running)
    assert "notes.ulg" in said[0]
    assert kept(page) == []


def test_until_the_page_has_taken_a_file_no_other_begins_and_none_is_left_of_a_page_that_went(page, said, eventually):
    before = panel(page)
    with page.lock:
        send(page, "first.ulg", b"x")
        send(page, "second.ulg", b"x", "b")
        assert ["second.ulg: the page has not taken the last file yet" in words for words in said] == [True]
        page.replace(page.session)
    before.drop._handing.join(10.0)
    assert "first.ulg: came while the page changed" in said[1]
    assert kept(page) == []


def test_what_the_form_lacks_is_said_in_the_words_of_the_form(page):
    form = panel(page)
    form.mass.value = 1.2
    with pytest.raises(ModelError, match="--frame") as caught:
        form._modelled(form.intake, quiet)
    assert 'say "frame" quad_x "arm", or' in of_page(str(caught.value))


def test_the_vehicle_of_the_form_is_drawn_before_there_is_a_model(page, said):
    """A frame with an arm's length; neither alone says where rotors are, nor what no vehicle has."""
    form = panel(page)
    move(form.frame, "hexa_x")
    assert form.preview.content == ""
    move(form.arm, 0.3)
    hexarotor = form.preview.content
    assert "the vehicle from above" in hexarotor
    move(form.frame, "quad_x")
    assert "the vehicle from above" in form.preview.content
    assert form.preview.content != hexarotor
    move(form.arm, 1e-9)
    assert form.preview.content == ""
    move(form.arm, 0.2)
    move(form.source, "crazyflie")
    assert form.preview.content == ""
    assert said == []


def test_what_was_found_on_a_log_stays_when_another_one_is_dropped(page, said, log, once, tmp_path, eventually):
    """It takes a minute to find, and a second log is dropped to compare with."""
    other = write_ulog(once("autopilot flight 2", lambda: flight(2)), tmp_path / "other.ulg").read_bytes()

    def after(act):
        before = panel(page)
        act()
        eventually(lambda: panel(page) is not before, str(said), 60.0)

    def modelled():
        form = panel(page)
        move(form.mass, MASS)
        move(form.arm, 0.26)
        after(lambda: press(form.make.button))

    after(lambda: send(page, "first.ulg", log))
    modelled()
    (name,), working = page.session.flights, page.session.working
    working.found["explain", name] = Found(Answer("what is missing"), working.model, working.name)
    working.found["explain", "gone"] = Found(Answer("of no flight here"), working.model, working.name)
    after(lambda: send(page, "second.ulg", other))
    assert len(page.session.flights) == 2
    ((key, one),) = page.session.working.found.items()
    assert (key, one.result.words) == (("explain", name), "what is missing")
    assert one.result.flights == (page.session.working.flight(name),)
    modelled()  # another model, though of the same numbers
    assert page.session.working.found == {}
