"""What the plots hold and what their heads say, without a browser."""

import io

import numpy as np
import pytest
from PIL import Image

from wrenchgap.viewer.panels.export import png, table
from wrenchgap.viewer.plot_board import View, _head
from wrenchgap.viewer.plots import Line, Plot, limits, plots_of, ticks
from wrenchgap.viewer.session import Scene, Series

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
        series=(Series("beta", "", TIME, {"beta": TIME}, "Correction"),),
    )
    plots = {(p.group, p.title): p for p in plots_of(scene)}
    assert set(plots) == {
        ("Wrench", "torque x"),
        ("Residual", "torque: measured - commanded"),
        ("Correction", "beta"),
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


@pytest.mark.parametrize(
    ("low", "high"), [(0.0, 1.3e-3), (-2.1e-4, -2e-5), (-0.7, 0.7), (9.8, 9.8004), (47.397740, 47.397752), (0, 2e5)]
)
def test_ticks_are_different_texts_of_the_numbers_at_which_they_stand(low, high):
    places, words = ticks(low, high)
    assert 2 <= len(places) <= 6
    assert low - 1e-12 <= places[0] < places[-1] <= high + 1e-12
    assert len(set(words)) == len(words)
    assert max(map(len, words)) <= 9
    step = places[1] - places[0]
    first = float(words[0])
    for place, word in zip(places[1:], words[1:], strict=True):
        told = first + float(word) if word.startswith("+") else float(word)
        assert told == pytest.approx(place, abs=0.1 * step if not word.startswith("+") else 0.01)
    assert not any(float(word) == 0.0 and word != "0" for word in words), "a zero with a sign"


def test_rounding_noise_is_drawn_flat_and_a_signal_is_not():
    noise, signal = 1e-17 * np.sin(TIME), 0.01 * np.sin(TIME)
    low, high = limits(noise, 3e-4)
    assert (low, high) == pytest.approx((-1.5e-4, 1.5e-4))
    low, high = limits(9.81 + 1e-12 * np.sin(TIME))
    assert high - low > 1e5 * 1e-12
    low, high = limits(signal, 3e-4)
    assert 0.02 < high - low < 0.03


def test_plots_of_a_small_vehicle_are_in_prefixed_units_that_they_share():
    wrench = np.zeros((len(TIME), 6))
    wrench[:, 3], wrench[:, 4], wrench[:, 2] = 1e-3 * np.sin(TIME), 2e-5, 0.3
    still = np.zeros((len(TIME), 3))
    quat = np.tile([1.0, 0.0, 0.0, 0.0], (len(TIME), 1))
    scene = Scene("one", TIME, still, quat, wrenches={"measured": wrench}, floors={"N": 3e-4, "Nm": 3e-5})
    plots = {p.title: p for p in plots_of(scene)}
    assert [plots[f"torque {axis}"].shown_unit for axis in "xyz"] == ["mNm"] * 3
    assert plots["force z"].shown_unit == "N"
    assert "[mNm]" in _head(plots["torque x"], TIME[100], ())
    assert f"{1e3 * wrench[100, 3]:+.3f}" in _head(plots["torque x"], TIME[100], ())
    assert table([plots["torque x"]], 0.0, 1.0).startswith("time [s],torque x measured [Nm]"), "tables stay in SI"
    assert plots["torque z"].floor == 3e-5
    assert plots["force x"].shown_unit == "mN", "a thousandth of the weight"
