"""What the plots hold and what their heads say, without a browser."""

import io

import numpy as np
import pytest
from PIL import Image

from wrenchgap.viewer.export_formats import png, table
from wrenchgap.viewer.plot_board import View, _head
from wrenchgap.viewer.plots import Line, Plot, plots_of
from wrenchgap.viewer.scene import Scene, Series

TIME = np.arange(0.0, 10.0, 0.02)


def plot(title="torque x", **lines):
    return Plot("Wrench", title, "Nm", TIME, tuple(Line(n, (1, 2, 3), np.asarray(v)) for n, v in lines.items()))


def test_an_instant_lies_where_it_should_or_nowhere():
    view = View(2.0, 4.0)
    assert view.place(3.0) == pytest.approx(0.5)
    assert view.place(2.0) == 0.0
    assert view.place(4.1) is None


def test_heads_read_the_values_at_the_cursor_and_the_change_between_the_marks():
    line = plot(measured=2.0 * TIME)
    assert "+6.000" in _head(line, 3.0, ())
    assert "A&rarr;B +2" in _head(line, 3.0, (("A", 1.0), ("B", 2.0)))
    assert "A&rarr;B" not in _head(line, 3.0, (("A", 1.0),))
    assert "nan" not in _head(line, np.nan, ())


def test_names_from_a_log_cannot_become_markup():
    assert "<script>" not in _head(plot("<script>", **{"<script>": TIME}), 1.0, ())


def test_a_flight_gets_plots_of_what_is_known_and_of_nothing_else():
    wrench = np.full((len(TIME), 6), np.nan)
    wrench[:, 3] = np.sin(TIME)
    still = np.zeros((len(TIME), 3))
    scene = Scene(
        "one",
        TIME,
        still,
        np.tile([1.0, 0.0, 0.0, 0.0], (len(TIME), 1)),
        wrenches={"commanded": 0.0 * wrench, "measured": wrench},
        sigma={"commanded": np.where(np.isfinite(wrench), 0.1, np.nan)},
        residual_of="commanded",
        series=(Series("beta", "", TIME, {"beta": TIME}, "Compensation"),),
    )
    plots = {(p.group, p.title): p for p in plots_of(scene)}
    assert set(plots) == {
        ("Wrench", "torque x"),
        ("Residual", "torque: measured - commanded"),
        ("Compensation", "beta"),
    }
    commanded, measured = plots["Wrench", "torque x"].lines
    assert commanded.sigma == pytest.approx(np.full(len(TIME), 0.1))
    assert measured.sigma is None
    residual = plots["Residual", "torque: measured - commanded"].lines[0]
    assert residual.values == pytest.approx(np.sin(TIME))


def test_the_table_has_every_sample_of_the_range_and_leaves_open_what_is_not_known():
    slow = Plot("Log", "/battery.voltage", "", TIME[::10] + 0.001, (Line("/battery.voltage", (1, 2, 3), TIME[::10]),))
    fast = plot(commanded=TIME, measured=np.where(TIME < 5.0, np.nan, 2.0))
    lines = table([fast, slow], 4.0, 6.0).splitlines()
    assert lines[0] == "time [s],torque x commanded [Nm],torque x measured [Nm],/battery.voltage"
    cells = [line.split(",") for line in lines[1:]]
    times = np.array([float(row[0]) for row in cells])
    assert times == pytest.approx(np.unique(np.concatenate([t[(t >= 4.0) & (t <= 6.0)] for t in (TIME, slow.time)])))
    for row in cells:
        if row[1]:
            assert float(row[1]) == pytest.approx(float(row[0]), abs=1e-6)
            assert (row[2] == "") == (float(row[0]) < 5.0 - 1e-9)
            assert row[3] == ""


def test_a_picture_is_the_render_on_white_with_a_legend():
    render = np.zeros((200, 300, 4), dtype=np.uint8)
    render[150:, 200:] = (10, 20, 30, 255)
    picture = np.asarray(Image.open(io.BytesIO(png(render, [("measured", (200, 0, 0))], ["one, 1.00 s"]))))
    assert picture.shape == (200, 300, 3)
    assert tuple(picture[190, 290]) == (10, 20, 30)
    assert tuple(picture[190, 10]) == (255, 255, 255)
    assert (picture == (200, 0, 0)).all(axis=2).any()
