"""A real browser for the tests marked `browser`, and pages on two short logs.

Without Chromium or Playwright these tests are skipped, except in CI (CI=true), where that is a failure. One browser
serves the whole run; each module has its own page on its own session.
"""

import math
import os
import shutil

import numpy as np
import pytest

import wrenchgap as wg
from tests.conftest import PATIENCE, eventually
from wrenchgap.replay.session.log_session import LogSession
from wrenchgap.viewer.page import Page

CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
WEBGL_WITHOUT_GPU = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
TEXT_BY_CPU = ("--disable-gpu-rasterization", "--disable-gpu-compositing")
"""What is not WebGL is drawn without it: a GPU that a CPU plays is slower than the CPU."""
FIVE_FRAMES = """() => new Promise(done => { const start = performance.now(); let left = 5;
    const frame = () => --left ? requestAnimationFrame(frame) : done((performance.now() - start) / 1000);
    requestAnimationFrame(frame); })"""
"""Seconds that five frames take: many while the shaders are compiled, which a CPU does slowly."""
FEW_FRAMES = """window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 400);
    window.cancelAnimationFrame = clearTimeout;"""
"""A display of two or three frames a second: the page draws all it can, and without a GPU a frame takes 0.2 s."""
LOADING = 90.0
"""Seconds that a page may take to appear: WebGL without a GPU, on cores that others use too."""


def lacking(what):
    """Skip, or in CI fail, because the browser cannot be driven."""
    text = f"{what}; tests in a browser need: apt-get install chromium, and playwright from requirements.lock"
    (pytest.fail if os.environ.get("CI", "").lower() == "true" else pytest.skip)(text)


LATE = "Tried to update non-existent component"
"""Harmless. Viser's client applies what comes within a frame in another order: first what is removed, then what is
updated, so that a value just before the end of its control finds nothing. With `FEW_FRAMES` that is 0.4 s.
"""


class Visitor:
    """One client: a tab of the browser on a page. `errors` are what its console complained about."""

    def __init__(self, browser, url, width=1120, height=620, *, smooth=True):
        self.tab = browser.new_page(viewport={"width": width, "height": height})
        self.errors: list[str] = []
        self.tab.add_init_script(FEW_FRAMES)
        self.tab.on("console", lambda m: m.type == "error" and LATE not in m.text and self.errors.append(m.text))
        self.tab.on("pageerror", lambda e: self.errors.append(str(e)))
        self.tab.goto(url)
        self.tab.wait_for_selector("canvas", timeout=1000 * LOADING)
        self.tab.wait_for_function("window.__viserSceneTree?.getState()['/world/body']", timeout=1000 * LOADING)
        self.tab.wait_for_selector("text=torque x", timeout=1000 * LOADING)
        if smooth:
            eventually(lambda: self.tab.evaluate(FIVE_FRAMES) < 3.0, "the page never runs smoothly", 4 * PATIENCE)
            self.tab.locator(".mantine-Notification-closeButton").first.click()  # that WebGL runs without a GPU

    def node(self, name):
        """Pose of a scene node in its parent, and whether it is drawn: those of the three.js object itself."""
        return self.tab.evaluate(
            """n => { const o = window.__viserMutable.nodeRefFromName[n], p = o.position, q = o.quaternion;
                return {position: [p.x, p.y, p.z], wxyz: [q.w, q.x, q.y, q.z], visible: o.visible}; }""",
            name,
        )

    def stands(self, name, position, wxyz):
        """Whether a node has this pose, to 2 mm and 3 mrad: the log's noise is in both, but at other stamps."""
        node = self.node(name)
        near = np.allclose(node["position"], position, atol=2e-3)
        return bool(near and math.isclose(abs(float(np.dot(node["wxyz"], wxyz))), 1.0, abs_tol=1e-6))

    def text(self):
        """All text on the page."""
        return str(self.tab.inner_text("body"))

    def close(self):
        """Leave the page."""
        self.tab.close()


@pytest.fixture(scope="session")
def browser():
    """A headless Chromium."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        lacking("Playwright is not installed")
    path = next((found for name in CHROMIUM if (found := shutil.which(name))), None)
    if path is None:
        lacking("no Chromium on this machine")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path, args=[*WEBGL_WITHOUT_GPU, *TEXT_BY_CPU])
        yield chromium
        chromium.close()


@pytest.fixture(scope="session")
def flown(logs):
    """Logs of two flights with a hidden offset of the centre of mass: train and test."""
    return logs.train, logs.test


@pytest.fixture(scope="module")
def page(flown):
    """A page on both flights, as `wrenchgap view` makes it."""
    model = wg.load_model("tilt_hexarotor")
    made = Page(LogSession(wg.open_flights(flown, model), model), port=0)
    yield made
    made.stop()


@pytest.fixture(scope="module")
def visitor(browser, page):
    """A client on that page."""
    found = Visitor(browser, page.url)
    yield found
    found.close()
