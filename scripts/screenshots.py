"""Real screenshots of the viewer for README and docs: flies, learns, opens the page in a headless Chromium, looks.

python scripts/screenshots.py [FOLDER]          default docs/images; needs Chromium (apt-get install chromium)
"""

from __future__ import annotations

import io
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image

from wrenchgap import flight
from wrenchgap.learn.data.opening import open_flights
from wrenchgap.learn.identify import learning
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.plant import model_file
from wrenchgap.plant.simulation.flight_plan import Plan, fly
from wrenchgap.replay.session.log_session import LogSession
from wrenchgap.viewer.page import Page

MODEL = "tilt_hexarotor"
HIDDEN = ("com_offset=x:-0.004,y:0.007,z:-0.005",)
TORQUES = ("torque_x", "torque_y", "torque_z")
SIZE = (1600, 960)
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
PATIENCE = 120_000
"""Milliseconds: shaders are compiled and drawn on the CPU."""


def main() -> None:
    """Take all of them."""
    from playwright.sync_api import sync_playwright

    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/images")
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        sys.exit("screenshots: no Chromium on this machine; apt-get install chromium")
    with tempfile.TemporaryDirectory() as logs:
        page = Page(session(Path(logs)), port=0)
        try:
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=chromium, args=list(FLAGS))
                tab = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
                tab.goto(page.url)
                tab.wait_for_selector("text=torque x", timeout=PATIENCE)
                tab.wait_for_timeout(6000)
                tab.locator(".mantine-Notification-closeButton").first.click()
                for name, arrange in VIEWS.items():
                    arrange(page, tab)
                    tab.wait_for_timeout(4000)  # until the browser has drawn what it was sent
                    saved(tab.screenshot(), folder / f"{name}.png")
                browser.close()
        finally:
            page.stop()


def session(folder: Path) -> LogSession:
    """Two flights of a vehicle whose centre of mass is not where its model says, and a GP learnt on the first."""
    model = model_file.load(MODEL)
    paths = []
    for name, trajectory, seconds, excitation in (("train", "multi_axis", 40.0, 1.0), ("test", "figure8", 24.0, 0.0)):
        plan = Plan(model, trajectory, seconds, excitation, 1, None, HIDDEN)
        paths.append(folder / f"{name}.mcap")
        flight.write(fly(plan, name=name), paths[-1])
    learnt = learning.learn_process(open_flights(paths[:1], model), model, TORQUES, FitSettings(points=120))
    return LogSession(open_flights(paths, model), model, learnt.gp, gp_name="torque.gp")


def overview(page: Page, tab: Any) -> None:
    """The first thing that a user sees, at a moment at which the model is wrong."""
    shown("Scene", tab)
    page.scene_panel.shadows.value = True
    page.scene_panel.look("oblique")
    page.transport.zoom.value = "10 s"
    page.cursor.go(12.4)


def compared(page: Page, tab: Any) -> None:
    """Two marks, tracking errors, frames along the path."""
    overview(page, tab)
    page.open("test")
    page.scene_panel.ghost.value = "train"
    page.scene_panel.along.value = "frames"
    page.scene_panel.spacing.value = 1.0
    page.cursor.go(9.0)
    page.transport.set_marks({"A": 7.0, "B": 11.0}, True)
    page.scene_panel.look("all")
    tab.get_by_text("Tracking", exact=True).click()


def failing(page: Page, tab: Any) -> None:
    """Where the model fails."""
    overview(page, tab)
    shown("Failure", tab)


def explained(page: Page, tab: Any) -> None:
    """The missing effect in the model: what is left of the error."""
    page.open("train")
    page.session.effects.add(("com_offset",), "train")
    page.refresh()
    overview(page, tab)
    shown("Effects", tab)
    tab.get_by_text("Residual", exact=True).click()


def compensated(page: Page, tab: Any) -> None:
    """What the compensation would do: correction, sigma and beta over the flight."""
    page.session.effects.undo()
    page.session.compensations.replay("train", lambda share, words: None)
    page.refresh()
    overview(page, tab)
    shown("Compensation", tab)
    tab.get_by_role("tab", name="Compensation", exact=True).first.click()


def shown(name: str, tab: Any) -> None:
    """Open a tab of the control panel."""
    tab.get_by_role("tab", name=name, exact=True).last.click()


VIEWS: dict[str, Callable[[Page, Any], None]] = {
    "viewer": overview,
    "viewer_failure": failing,
    "viewer_effects": explained,
    "viewer_compensation": compensated,
    "viewer_compared": compared,
}


def saved(png: bytes, path: Path) -> None:
    """Write a screenshot, as small as it gets without losing a colour."""
    Image.open(io.BytesIO(png)).convert("RGB").save(path, optimize=True)
    print(f"wrote {path} ({path.stat().st_size / 1e3:.0f} kB)")


if __name__ == "__main__":
    main()
