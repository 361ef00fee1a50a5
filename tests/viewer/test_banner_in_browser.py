"""Warnings of the checks over the page, in a real browser; and that a healthy flight has none."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from tests.viewer.conftest import Visitor
from wrenchgap import flight
from wrenchgap.learn.data.opening import open_flights
from wrenchgap.plant import model_file
from wrenchgap.replay.session.log_session import LogSession
from wrenchgap.viewer import markup
from wrenchgap.viewer.page import Page

BOX = """() => { const r = document.querySelector('.wg-banner')?.getBoundingClientRect();
    return r && [r.x, r.y, r.width, r.height]; }"""
ROOT = "() => document.querySelector('#root').getBoundingClientRect().y"


@pytest.fixture(scope="module")
def spiked(logs, tmp_path_factory):
    """The train flight with three readings of the accelerometer that cannot be true."""
    found = flight.load(logs.train)
    force = found.imu.specific_force_B.copy()
    force[[500, 1200, 2000], [0, 1, 2]] = [1e5, -1e5, 3e4]
    changed = replace(found, imu=replace(found.imu, specific_force_B=force))
    return wg.save_log(changed, tmp_path_factory.mktemp("spiked") / "spiked.mcap")


def test_warnings_are_escaped_and_counted():
    html = markup.banner(["crash: <b> 14 s", "spikes: 3"])
    assert "2 warnings of the checks:" in html
    assert "crash: &lt;b&gt; 14 s" in html
    assert markup.banner([]) == ""


@pytest.mark.browser
def test_a_warning_stands_over_the_page(browser, logs, spiked, eventually):
    model = model_file.load("tilt_hexarotor")
    page = Page(LogSession(open_flights([spiked, logs.test], model), model), port=0)
    page.server.scene.configure_environment_map(hdri=None)  # what surfaces mirror takes long without a GPU
    try:
        client = Visitor(browser, page.url, smooth=False)
        x, y, width, height = eventually(lambda: client.tab.evaluate(BOX), "no banner")
        assert (x, y, width) == (0.0, 0.0, 1120.0)
        assert client.tab.evaluate(ROOT) == pytest.approx(height, abs=1.0), "the page begins below"
        assert "1 warning of the checks: spikes: spiked: imu: 3 sample(s)" in " ".join(client.text().split())
        page.open("test")
        eventually(lambda: client.tab.evaluate(BOX) is None, "the banner of another flight")
        assert np.isclose(client.tab.evaluate(ROOT), 0.0)
        client.close()
    finally:
        page.stop()
