"""The page as a user meets it: a real browser, a real server, logs on disk."""

import io
import json
from unittest.mock import patch

import numpy as np
import pytest
from PIL import Image

from wrenchgap import flight
from wrenchgap.flight import so3
from wrenchgap.viewer.view_state import parse

pytestmark = pytest.mark.browser

TIME_BOX = ".mantine-NumberInput-input >> nth=0"


@pytest.fixture(scope="module")
def logged(flown):
    """The odometry of both logs as they lie on disk, read past everything that the viewer uses."""
    return {path.stem: flight.load(path).odometry for path in flown}


def logged_pose(odometry, at):
    position = [np.interp(at, odometry.time, column) for column in odometry.position_E.T]
    return np.array(position), so3.interpolate(np.array([at]), odometry.time, odometry.quat_EB)[0]


@pytest.fixture
def as_logged(page, logged):
    """`as_logged(client)`: whether the body stands there as the log of the open flight says."""

    def check(client):
        at = page.scene.time[page.cursor.index]
        return client.stands("/world/body", *logged_pose(logged[page.scene.name], at))

    return check


@pytest.fixture(autouse=True)
def at_rest(page):
    """Every test begins with the first flight at its start, nothing playing."""
    page.open("train")
    yield
    page.transport.playing(False)


def test_page_loads_without_complaints(visitor):
    seen = visitor.text()
    for words in ("wrenchgap", "torque x", "commanded", "measured", "Legend", "Play"):
        assert words in seen
    assert visitor.errors == []


def test_playing_moves_the_frames_as_the_log_says(page, visitor, logged, as_logged, eventually):
    """Three times the play button is pressed and released; the poses in the browser are those of the log."""
    times = []
    for _ in range(3):
        visitor.tab.get_by_role("button", name="Play").click()
        begin = page.cursor.time
        eventually(lambda begin=begin: page.cursor.time > begin + 0.8, "it does not play")
        visitor.tab.get_by_role("button", name="Pause").click()
        eventually(lambda: not page.cursor.playing, "it does not pause")
        times.append(page.cursor.time)
        eventually(lambda: as_logged(visitor), f"wrong pose at {times[-1]:.2f} s")
    assert times[0] < times[1] < times[2]
    poses = [logged_pose(logged["train"], t)[0] for t in times]
    assert min(np.linalg.norm(poses[1] - poses[0]), np.linalg.norm(poses[2] - poses[1])) > 1e-3, "nothing moved"


def test_cursor_line_stands_where_the_axis_says(page, visitor, eventually):
    """The line drawn over a chart is at the pixel at which the chart itself would draw that time."""
    page.cursor.go(7.3)
    drawn = """() => [...document.querySelectorAll('.wg-cursor')].map(e => e.getBoundingClientRect().x).sort()"""
    charted = """t => Object.values(window.__viserTestpoints.uplots).map(({chart}) =>
        chart.over.getBoundingClientRect().x + chart.valToPos(t, 'x')).sort()"""

    def agree():
        lines, places = visitor.tab.evaluate(drawn), visitor.tab.evaluate(charted, 7.3)
        return len(lines) == len(places) > 3 and np.allclose(np.add(lines, 0.75), places, atol=1.0)

    eventually(agree, "the line is beside the chart's time")


def test_the_page_does_not_answer_for_the_user(page, visitor, eventually):
    """The box of the time must not send back what it was sent: the cursor would jump to where it was."""
    for at in np.random.default_rng(1).uniform(0.5, 11.0, 8):
        page.cursor.go(at)
        eventually(lambda at=at: abs(float(visitor.tab.input_value(TIME_BOX)) - at) < 2e-3, "the box lags")
        assert page.cursor.time == pytest.approx(at, abs=1e-9)
    visitor.tab.wait_for_timeout(300)
    assert page.cursor.time == pytest.approx(at, abs=1e-9)


def test_a_second_client_sees_the_same_and_leaves_without_harm(page, visitor, browser, as_logged, eventually):
    page.cursor.go(5.0)
    second = type(visitor)(browser, page.url, 1000, 400, smooth=False)
    eventually(lambda: as_logged(visitor) and as_logged(second), "not the same pose", 60.0)
    second.tab.get_by_role("button", name="+1 s").click()
    eventually(lambda: page.cursor.time == pytest.approx(6.0), "the click moved nothing")
    eventually(lambda: as_logged(visitor) and as_logged(second), "only one client moved", 60.0)
    page.transport.playing(True)
    second.close()
    eventually(lambda: len(page.server.get_clients()) == 1, "the client is still counted")
    begin = page.cursor.time
    eventually(lambda: page.cursor.time != begin, "playing stopped")
    assert visitor.errors == []


def test_another_log_opens_with_the_same_layout(page, visitor, as_logged, eventually):
    page.scene_panel.frames.value = True
    page.transport.zoom.value = "5 s"
    visitor.tab.get_by_text("Tracking", exact=True).click()
    page.open("test")
    eventually(lambda: as_logged(visitor), "old flight")
    visitor.tab.wait_for_selector("text=attitude error")
    assert page.scene_panel.frames.value
    assert page.board.view.stop - page.board.view.start == pytest.approx(5.0)
    assert "torque x" not in visitor.text(), "the tab of the plots changed"
    visitor.tab.get_by_text("Wrench", exact=True).click()
    page.scene_panel.frames.value = False
    page.transport.zoom.value = "whole flight"


def test_a_bad_value_in_a_field_does_not_kill_the_page(page, visitor, as_logged, eventually):
    """Letters in the box of the time, a number beyond the flight, and nonsense where a saved view belongs."""
    box = visitor.tab.locator(TIME_BOX)
    for typed in ("abc", "1e99", "-7", ""):
        box.fill(typed)
        box.press("Enter")
    visitor.tab.get_by_text("Export", exact=True).click()
    field = visitor.tab.locator(".mantine-TextInput-input:visible").last
    field.fill('{"schema": 5}')
    visitor.tab.wait_for_selector("text=expected 'wrenchgap.view/1'")
    visitor.tab.get_by_text("Scene", exact=True).click()
    page.cursor.go(3.0)
    eventually(lambda: as_logged(visitor), "the page died")
    visitor.tab.get_by_role("button", name="+1 s").click()
    eventually(lambda: abs(page.cursor.time - 4.0) < 1e-6, "buttons no longer work")


def test_keys_play_and_step(page, visitor, eventually):
    visitor.tab.locator("canvas[data-engine]").click(position={"x": 100, "y": 500})
    begin = page.cursor.time
    visitor.tab.keyboard.press("l")
    eventually(lambda: page.cursor.time > begin, "L does not step")
    visitor.tab.keyboard.press("Space")
    eventually(lambda: page.cursor.playing, "space does not play")
    visitor.tab.keyboard.press("Space")
    eventually(lambda: not page.cursor.playing, "space does not pause")


def test_picture_table_and_view_come_out_of_the_page(page, visitor, tmp_path):
    page.cursor.go(6.0)
    visitor.tab.get_by_text("Export", exact=True).click()

    def downloaded(button):
        with visitor.tab.expect_download() as waiting:
            visitor.tab.get_by_role("button", name=button).click()
        return waiting.value.suggested_filename, waiting.value.path().read_bytes()

    name, content = downloaded("PNG of the view")
    picture = np.asarray(Image.open(io.BytesIO(content)))
    assert name.endswith(".png")
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 500, "an empty picture"
    centre = picture[:, picture.shape[1] // 3 : -(picture.shape[1] // 3)]
    assert (centre.max(axis=2) < 110).sum() > 500, "no hull to be seen"
    name, content = downloaded("CSV of what is plotted")
    lines = content.decode().splitlines()
    columns = lines[0].split(",")
    rows = np.genfromtxt(lines[1:], delimiter=",")
    shown = page.scene.wrenches["measured"][:, 3]
    assert "torque x measured [Nm]" in columns
    assert rows[:, columns.index("torque x measured [Nm]")] == pytest.approx(shown, nan_ok=True, rel=1e-6)
    name, content = downloaded("Save view")
    view = parse(content.decode())
    assert (view.flight, view.time) == ("train", pytest.approx(6.0))
    assert json.loads(content)["camera"] is not None
    page.cursor.go(1.0)
    page.restore(view)
    assert page.cursor.time == pytest.approx(6.0)
    visitor.tab.get_by_text("Scene", exact=True).click()


def test_only_the_cursor_is_sent_while_playing(page, visitor, eventually):
    buffer = page.server._websock_server.get_message_buffer()
    with patch.object(buffer, "push", wraps=buffer.push) as sent:
        page.transport.playing(True)
        begin = page.cursor.time
        eventually(lambda: page.cursor.time > begin + 1.0)
        page.transport.playing(False)
    assert sent.call_count > 0
    assert not any("data" in getattr(call.args[0], "updates", {}) for call in sent.call_args_list)
