"""The analysis as a user meets it: clicks in the failure map, effects added and undone, seen by every client."""

import io
import re
import time

import numpy as np
import pytest
from PIL import Image

from wrenchgap.replay.session.panels.effects import EffectsPanel

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module", autouse=True)
def _nothing_to_reflect(page):
    """Surroundings that surfaces mirror take a CPU half of a page's time; test_page_in_browser has them."""
    page.server.scene.configure_environment_map(hdri=None)


@pytest.fixture(autouse=True)
def as_opened(page):
    """Every test begins with the model as it was opened, the first flight at its start."""
    while page.session.working.undoable:
        page.session.effects.undo()
    page.open("train")
    yield
    assert not [p for p in page.panels if isinstance(p, EffectsPanel) and p.work.running]


@pytest.fixture
def second(visitor, browser, page):
    """Another client on the same page."""
    found = type(visitor)(browser, page.url, 1000, 600, smooth=False)
    yield found
    found.close()


@pytest.fixture
def effects(page):
    return next(p for p in page.panels if isinstance(p, EffectsPanel))


def tab(visitor, name):
    """Open a tab of the control panel (the plots have tabs of their own, to the left)."""
    visitor.tab.get_by_role("tab", name=name, exact=True).last.click()


def numbers(visitor):
    """The large numbers [N] as a user reads them: error on the flight shown, on the held-out one."""
    return [float(n) for n in re.findall(r"([\d.]+) N\s*rms of force and torque", visitor.text())]


def test_a_click_in_the_failure_map_moves_cursor_scene_and_line(page, visitor, eventually):
    tab(visitor, "Failure")
    cells = visitor.tab.locator("label[for][title*='worst at']")
    eventually(lambda: cells.count() > 40, "no failure map")
    assert visitor.tab.get_by_role("button", name=re.compile(r"^link \d+$")).count() == 0, "a hidden button is seen"
    for k in (3, 20, 41):
        at = float(re.search(r"worst at ([\d.]+) s", cells.nth(k).get_attribute("title"))[1])
        cells.nth(k).click()
        eventually(lambda at=at: abs(page.cursor.time - at) < 0.006, f"the cursor did not go to {at} s")
        index = page.cursor.index
        pose = page.scene.position_E[index], page.scene.quat_EB[index]
        eventually(lambda pose=pose: visitor.stands("/world/body", *pose), "the scene did not follow")
    assert visitor.errors == []


def test_adding_lowers_the_number_on_the_page_and_undo_restores_it(page, visitor, second, eventually, effects):
    for client in (visitor, second):
        tab(client, "Effects")
    before = eventually(lambda: numbers(visitor), "no number on the page")
    assert len(before) == 2
    effects.choice.value = "com_offset"
    visitor.tab.get_by_role("button", name="Add effect").click()
    eventually(lambda: numbers(visitor)[0] < 0.2 * before[0], "the error did not fall")
    eventually(lambda: numbers(second) == numbers(visitor), "the second client does not see it")
    assert numbers(visitor)[1] < 0.2 * before[1]
    assert "predicted" in visitor.text()
    visitor.tab.get_by_role("button", name="Undo: add com_offset").click()
    eventually(lambda: numbers(visitor) == before, "undo did not restore the number")
    eventually(lambda: numbers(second) == before)
    second.tab.get_by_role("button", name="Redo: add com_offset").click()
    eventually(lambda: numbers(visitor)[0] < 0.2 * before[0], "redo of another client did nothing")
    assert visitor.errors == second.errors == []


def test_a_slider_dragged_on_the_page_moves_the_error(page, visitor, eventually, effects):
    tab(visitor, "Effects")
    effects.add("com_offset")
    best = eventually(lambda: numbers(visitor))
    handle = effects.sliders.handles["com_offset", "x"][0]
    slider = visitor.tab.locator(f"[id='{handle._impl.uuid}']")
    slider.scroll_into_view_if_needed()
    place, mouse = slider.bounding_box(), visitor.tab.mouse
    middle = place["y"] + 0.5 * place["height"]
    mouse.move(place["x"] + 0.3 * place["width"], middle)
    mouse.down()
    for share in np.linspace(0.5, 0.9, 6):
        mouse.move(place["x"] + share * place["width"], middle)
    mouse.up()
    eventually(lambda: numbers(visitor)[0] > 2.0 * best[0], "the error did not follow")
    eventually(lambda: page.session.model.effect("com_offset").theta[0] * 1e3 == pytest.approx(handle.value))
    assert visitor.tab.get_by_role("button", name="Undo: set com_offset by hand").is_visible()


@pytest.mark.slow
def test_the_page_stays_usable_while_a_search_runs(page, visitor, eventually, effects):
    tab(visitor, "Effects")
    visitor.tab.get_by_role("button", name="Search", exact=True).click()
    eventually(lambda: effects.work.running, "no search")
    for _ in range(3):
        at = page.cursor.time
        visitor.tab.get_by_role("button", name="+1 s").click()
        eventually(lambda at=at: page.cursor.time > at, "the page is stuck")
    assert effects.work.running, "the page answered only when the search had ended"
    eventually(lambda: not effects.work.running, "the search does not end", 90.0)
    assert "each by itself" in effects.found.content, "the search failed, or what came of it is not told"
    visitor.tab.wait_for_selector("text=each by itself")


@pytest.mark.parametrize("name", ["Failure", "Effects", "Changed", "Ready", "Allocation", "Compensation"])
def test_every_panel_can_be_looked_at(visitor, name):
    tab(visitor, name)
    time.sleep(0.3)
    picture = np.asarray(Image.open(io.BytesIO(visitor.tab.screenshot())).convert("RGB"))
    tabs = "() => Math.max(...[...document.querySelectorAll('[role=tab]')].map(t => t.getBoundingClientRect().bottom))"
    panel = picture[int(visitor.tab.evaluate(tabs)) + 5 :, -330:]
    drawn = (panel.min(axis=2) < 200).mean()  # letters, buttons and figures; of a panel without any there are none
    assert drawn > 0.005, "an empty panel"
    overflow = visitor.tab.evaluate(
        "() => [...document.querySelectorAll('table')].filter(t => t.offsetParent && "
        "t.getBoundingClientRect().right > window.innerWidth + 1).length"
    )
    assert overflow == 0, "a table is wider than its panel"
