"""From a dropped log to the error that falls, and to what changed, in a browser, where nobody types a command."""

import contextlib
import re

import pytest

from tests.replay import autopilot_logs, crazyflie_tables
from wrenchgap.replay.session.intake import Intake
from wrenchgap.replay.session.panels.logs import session_of
from wrenchgap.viewer.page import Page

pytestmark = pytest.mark.browser


class Pilot:
    """Somebody at the page that was started without anything: who sees its words, clicks, fills in and drops."""

    def __init__(self, browser, url, eventually):
        self.tab = browser.new_page(viewport={"width": 1366, "height": 768})
        self.eventually, self.errors = eventually, []
        self.tab.on("pageerror", lambda e: self.errors.append(str(e)))
        self.tab.goto(url)
        self.box = self.tab.locator('input[type="file"]:visible')
        self.box.wait_for(timeout=90_000)

    def sees(self, words, seconds=60.0):
        """Wait for words on the page."""
        self.eventually(lambda: words in self.text(), f"not on the page: {words}", seconds)

    def text(self):
        return str(self.tab.inner_text("body"))

    def click(self, button):
        self.tab.get_by_role("button", name=button, exact=True).locator("visible=true").first.click()

    def opens(self, name, seconds=120.0):
        """Go to a tab, once there is one."""
        found = self.tab.get_by_role("tab", name=name, exact=True)
        self.eventually(lambda: found.count() > 0, f"no tab {name}", seconds)
        found.last.click()

    def field(self, label):
        return self.tab.locator(f'xpath=//*[normalize-space(text())="{label}"]/following::input[1]').first

    def fills(self, label, value):
        self.field(label).fill(str(value))
        self.field(label).press("Enter")

    def chooses(self, label, option):
        """The form is made anew where a log arrives: a list that was open by then has not got it."""
        from playwright.sync_api import TimeoutError as PlaywrightTimeout  # here: without it these tests are skipped

        wanted = self.tab.get_by_role("option", name=option, exact=True)
        for _ in range(10):
            self.field(label).click()
            with contextlib.suppress(PlaywrightTimeout):
                return wanted.click(timeout=3000)
            self.tab.keyboard.press("Escape")
        raise AssertionError(f"{label} has no {option}")

    def drops(self, path):
        """Drag a file onto the box and let it go, by the events of the browser itself; no script has a part in it."""
        place = self.box.bounding_box()
        at = {"x": place["x"] + 0.5 * place["width"], "y": place["y"] + 0.5 * place["height"]}
        session = self.tab.context.new_cdp_session(self.tab)
        data = {"items": [], "files": [str(path)], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            session.send("Input.dispatchDragEvent", {"type": kind, **at, "data": data})
        self.sees(f"{path.name}: ", 120.0)

    def cancels(self, button):
        """Begin work, and end it when it says what it does."""
        self.click(button)
        self.sees("starting")
        self.eventually(lambda: "starting" not in self.text(), "the work never says what it does", 60.0)
        self.click("Cancel")
        again = self.tab.get_by_role("button", name=button, exact=True).locator("visible=true")
        self.eventually(lambda: again.count() > 0, "the work was not ended")

    def error(self):
        """The error of the model that the page shows [N]."""
        found = re.search(r"([\d.]+) m?N\s*rms of force and torque", self.text())
        return float(found[1]) if found else None


@pytest.fixture
def pilot(browser, eventually):
    page = Page(session_of(Intake(), lambda share, words: None), port=0)
    page.server.scene.configure_environment_map(hdri=None)
    found = Pilot(browser, page.url, eventually)
    yield found
    found.tab.close()
    page.stop()
    assert found.errors == []


def test_a_file_that_is_refused_is_not_called_uploaded(pilot, tmp_path):
    """viser's own notice said so once all bytes had come."""
    for name, refusal in (("odd<name.mcap", "whose name is no plain one"), ("no_log.mcap", "no_log.mcap: not a log")):
        path = tmp_path / name
        path.write_bytes(b"abc" * 1000)
        pilot.box.set_input_files(path)
        pilot.sees(refusal)
        assert "uploaded" not in pilot.text()
        pilot.box.wait_for()


@pytest.fixture
def written(once, tmp_path):
    """A log of a kind, with a hidden centre of mass."""

    def log(kind):
        if kind == "csv":
            flown = once("crazyflie flight 1", lambda: crazyflie_tables.flight(1))
            return crazyflie_tables.write_table(flown, tmp_path / "flight1.csv")
        write = {"ulg": autopilot_logs.write_ulog, "bin": autopilot_logs.write_dataflash}[kind]
        return write(once("autopilot flight 1", lambda: autopilot_logs.flight(1)), tmp_path / f"flight1.{kind}")

    return log


@pytest.mark.parametrize("kind", ["ulg", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("bin", "csv"))])
def test_from_a_dropped_log_to_the_error_that_falls(pilot, written, kind):
    make = "Make the model, open the flights"
    pilot.drops(written(kind))
    pilot.sees(make, 120.0)
    assert "in the air" in pilot.text()
    if kind == "csv":
        assert "with -m" not in pilot.text()  # the page has no options
        assert "mass [kg]" not in pilot.text()  # the shipped model, which has its own, is chosen
        pilot.click(make)
    else:
        pilot.click(make)
        pilot.sees("how many kilograms")
        pilot.fills("mass [kg]", autopilot_logs.MASS)
        pilot.click(make)
        if kind == "bin":
            pilot.sees('say "arm"')
            pilot.fills("arm [m]", 0.26)
            pilot.click(make)
    pilot.opens("Effects")
    before = pilot.eventually(pilot.error, "no error of the model", 60.0)
    pilot.chooses("by name", "com_offset")
    pilot.click("Add effect")
    pilot.eventually(lambda: pilot.error() < 0.6 * before, "the error did not fall", 60.0)
    pilot.opens("Logs")
    assert " -m" not in pilot.text()
    assert ("assumed: " in pilot.text()) == (kind != "csv")


def test_a_log_that_was_dropped_by_mistake_is_left_out_again(pilot, written, tmp_path):
    pilot.drops(written("ulg"))
    pilot.sees("mass [kg]", 120.0)
    mistake = tmp_path / "other.csv"
    written("csv").rename(mistake)
    pilot.drops(mistake)
    pilot.eventually(lambda: "other.csv" in pilot.text() and "flight1.ulg" in pilot.text(), "both are judged", 120.0)
    pilot.chooses("leave out", "2: other.csv")
    pilot.click("Leave it out")
    pilot.eventually(lambda: "other.csv" not in pilot.text(), "it is still there", 120.0)
    pilot.sees("flight1.ulg")


@pytest.fixture
def two_crazyflies(pilot, written, once, tmp_path):
    """A pilot with two logs and their model; the second one has a weak rotor, and is shown."""
    pilot.drops(written("csv"))
    pilot.sees("Make the model, open the flights", 120.0)
    pilot.click("Make the model, open the flights")
    pilot.opens("Effects")
    pilot.opens("Logs")
    weak = once("crazyflie with a weak rotor", lambda: crazyflie_tables.flight(2, "rotor_thrust=rotor_0:-0.13"))
    pilot.drops(crazyflie_tables.write_table(weak, tmp_path / "flight2.csv"))
    pilot.opens("Changed")
    pilot.chooses("flight", "flight2")
    pilot.sees("suspect: flight2")
    return pilot


@pytest.mark.slow
def test_the_search_and_the_comparison_with_a_second_log_can_be_cancelled(two_crazyflies):
    two_crazyflies.cancels("What changed?")
    two_crazyflies.opens("Effects")
    two_crazyflies.cancels("Search")


@pytest.mark.slow
def test_the_comparison_with_a_second_log_names_the_rotor(two_crazyflies):
    two_crazyflies.click("What changed?")
    two_crazyflies.sees("Inspect M1", 280.0)
