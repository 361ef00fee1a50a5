"""From a dropped log to the error that falls, in a browser: check, the model by a form, an effect added."""

import re

import pytest

from tests.replay.autopilot_logs import MASS, flight, write_ulog
from wrenchgap.replay.session.intake import Intake
from wrenchgap.replay.session.panels.effects import EffectsPanel
from wrenchgap.replay.session.panels.logs import session_of
from wrenchgap.viewer.page import Page

pytestmark = pytest.mark.browser


@pytest.fixture
def page():
    """A page that was started without anything."""
    made = Page(session_of(Intake(), lambda share, words: None), port=0)
    made.server.scene.configure_environment_map(hdri=None)
    yield made
    made.stop()


def dropped(tab, box, path):
    """Drag a file onto an element and let it go, by the events of the browser itself; no script has a part in it."""
    place = box.bounding_box()
    at = {"x": place["x"] + 0.5 * place["width"], "y": place["y"] + 0.5 * place["height"]}
    browser = tab.context.new_cdp_session(tab)
    data = {"items": [], "files": [str(path)], "dragOperationsMask": 1}
    for kind in ("dragEnter", "dragOver", "drop"):
        browser.send("Input.dispatchDragEvent", {"type": kind, **at, "data": data})


def test_from_a_dropped_log_to_the_error_that_falls(page, browser, once, tmp_path, eventually):
    path = write_ulog(once("autopilot flight 1", lambda: flight(1)), tmp_path / "flight1.ulg")
    errors: list[str] = []
    tab = browser.new_page(viewport={"width": 1366, "height": 768})
    tab.on("pageerror", lambda e: errors.append(str(e)))
    tab.goto(page.url)
    drop = tab.locator('input[type="file"]:visible')
    drop.wait_for(timeout=90_000)
    dropped(tab, drop, path)

    def text():
        return str(tab.inner_text("body"))

    eventually(lambda: "mass [kg]" in text(), "no form after the check", 120.0)
    assert "flight1.ulg" in text()
    assert "in the air" in text()
    mass = tab.locator('xpath=//*[normalize-space(text())="mass [kg]"]/following::input[1]').first
    make = tab.get_by_role("button", name="Make the model, open the flights")
    make.click()
    eventually(lambda: "how many kilograms" in text(), "nothing says that the mass is missing")
    mass.fill(str(MASS))
    mass.press("Enter")
    make.click()
    effects = tab.get_by_role("tab", name="Effects", exact=True)
    eventually(lambda: effects.count() > 0, "the flight was not opened", 120.0)
    assert "assumed" in text()
    effects.last.click()

    def error():
        found = re.search(r"([\d.]+) N\s*rms in all", text())
        return float(found[1]) if found else None

    before = eventually(error, "no error of the model", 60.0)
    next(p for p in page.panels if isinstance(p, EffectsPanel)).choice.value = "com_offset"
    tab.get_by_role("button", name="Add effect").click()
    eventually(lambda: error() < 0.6 * before, "the error did not fall", 60.0)
    assert errors == []
    tab.close()
