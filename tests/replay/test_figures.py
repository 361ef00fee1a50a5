"""What pictures hold: panels, units, the residual itself, every peak, and legends that cover nothing."""

import io
from dataclasses import replace

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import wrenchgap as wg
from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.plant.effect_values import with_values
from wrenchgap.replay.present import save_figure
from wrenchgap.replay.present.figures import style

MODEL = wg.load_model("tilt_hexarotor")


@pytest.fixture(autouse=True)
def no_figures_left():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def compared(logs):
    """Two flights, the nominal vehicle and one with an offset of the centre of mass."""
    model = with_values(MODEL, ["com_offset=-0.004,0.007,-0.005"])
    return wg.compare(wg.open_flights([logs.test, logs.train], model), model)


@pytest.fixture(scope="module")
def added(logs):
    """The hidden offset of the centre of mass, fitted."""
    return wg.add(MODEL, "com_offset", wg.open_flights(logs.train, MODEL))


def one_flight(compared):
    """Only the first of the flights."""
    first = tuple(replace(e, predictions=e.predictions[:1], by_flight=e.by_flight[:1]) for e in compared.evaluations)
    return replace(compared, flights=compared.flights[:1], records=compared.records[:1], evaluations=first)


def check_panels(figure):
    """Every panel says what its axes are, and no legend lies on a panel."""
    figure.canvas.draw()
    panels = [a for a in figure.axes if a.axison]
    boxes = [a.get_window_extent() for a in panels]
    for panel in panels:
        assert panel.get_ylabel() or panel.get_yticklabels(), panel
        assert panel.yaxis.get_offset_text().get_text() == ""
        if found := panel.get_legend():
            legend = found.get_window_extent().padded(-1.0)
            assert not any(legend.overlaps(box) for box in boxes)


def test_the_residual_is_drawn_with_its_noise_floor(compared):
    one = one_flight(compared)
    axes = one.plot()
    assert axes.shape == (6, 2)
    record = one.records[0]
    for axis, (name, unit) in enumerate(style.QUANTITIES):
        wrench, residual = axes[2 * (axis % 3), axis // 3], axes[2 * (axis % 3) + 1, axis // 3]
        assert wrench.get_ylabel() == f"{name} [{unit}]"
        assert residual.get_ylabel().startswith("residual [")
        drawn = {line.get_color(): line for line in residual.lines}
        expected = record.measured[:, axis] - one.evaluations[-1].predictions[0][:, axis]
        np.testing.assert_allclose(drawn[style.MODELS[0]].get_ydata(), expected)
        (floor,) = [c for c in residual.collections if c.get_label().endswith("sensor noise")]
        assert floor.get_paths()[0].vertices[:, 1].max() == pytest.approx(2.0 * record.noise[axis])
    check_panels(axes[0, 0].get_figure())


def test_several_flights_follow_one_another_with_their_names_and_their_rms(compared):
    axes = compared.plot()
    assert axes.shape == (7, 2)
    assert [text.get_text() for text in axes[0, 0].texts] == list(compared.flights)
    times = [line.get_xdata() for line in axes[0, 0].lines if line.get_color() == style.MEASURED]
    assert times[0][-1] < times[1][0]
    bars = [bar.get_height() for bar in axes[6, 1].patches]
    expected = [np.linalg.norm(e.rms[3:]) for one in compared.evaluations for e in one.by_flight]
    np.testing.assert_allclose(bars, expected)
    check_panels(axes[0, 0].get_figure())


def test_ten_minutes_keep_every_peak_and_stay_light():
    time = np.arange(0.0, 600.0, 0.005)
    values = np.sin(40.0 * time)
    values[54321], values[98765] = 7.0, -5.0
    panel = Figure().subplots()
    assert style.curve(panel, time, values, "black")
    (band,) = panel.collections
    corners = band.get_paths()[0].vertices
    assert len(corners) < 5 * 900
    assert (corners[:, 1].min(), corners[:, 1].max()) == (-5.0, 7.0)
    assert corners[corners[:, 1].argmax(), 0] == pytest.approx(time[54321], abs=600.0 / 900)


def test_a_slow_curve_stays_a_line_however_long():
    time = np.arange(0.0, 600.0, 0.005)
    panel = Figure().subplots()
    assert not style.curve(panel, time, np.sin(0.02 * time), "black")
    assert len(panel.lines[0].get_xdata()) <= 2 * 900 + 2


def test_small_numbers_get_a_prefix_and_data_stay_in_si():
    panel = Figure().subplots()
    panel.plot([0.0, 1.0], [0.0, 4e-4])
    style.labelled(panel, "torque x", "Nm")
    assert panel.get_ylabel() == "torque x [mNm]"
    assert panel.yaxis.get_major_formatter()(2e-4) == "0.2"
    assert panel.lines[0].get_ydata()[1] == 4e-4


def test_ticks_of_a_narrow_range_are_written_in_full():
    panel = Figure().subplots()
    panel.plot([1.6001, 1.6002], [0.0, 1.0])
    style.labelled(panel, "height", "m", "x")
    panel.get_figure().canvas.draw()
    assert panel.xaxis.get_offset_text().get_text() == ""
    ticks = [t.get_text() for t in panel.get_xticklabels() if t.get_text()]
    assert len(ticks) == len(set(ticks)) > 2
    assert all(t.startswith("1.6") for t in ticks)


def test_axes_of_the_user_are_drawn_into_and_others_refused(added):
    axes = Figure().subplots(1, 2)
    assert added.plot(axes) is axes
    assert axes[1].get_ylabel() == "torque error, rms [Nm]"
    assert not plt.get_fignums(), "no figure of pyplot where axes are given"
    with pytest.raises(UsageError, match=r"subplots\(1, 2\)"):
        added.plot(Figure().subplots(2, 3))


def test_an_addition_shows_the_error_before_and_after(added):
    axes = added.plot()
    heights = [bar.get_height() for bar in axes[0, 1].patches]
    np.testing.assert_allclose(heights, [*added.trial.before[3:], *added.trial.after[3:]])
    check_panels(axes[0, 0].get_figure())


def test_a_process_and_its_replay(logs):
    """Sigma has the unit of the outputs, beta is a share, the band around the correction is that sigma."""
    train, test = wg.open_flights([logs.train, logs.test], MODEL)
    few = {"outputs": ("torque_x", "torque_y"), "settings": FitSettings(points=40), "guard": False}
    learnt = wg.learn_gp(train, MODEL, validate=test, **few)
    axes = learnt.plot()
    assert axes.shape == (2, 3)
    assert axes[1, 2].get_ylabel() == "measured within the interval [%]"
    check_panels(axes[0, 0].get_figure())
    replayed = wg.replay_compensation(test, MODEL, learnt)
    axes = replayed.plot()
    assert axes.shape == (3, 2)
    assert not any(panel.get_title(side) for panel in axes.ravel() for side in ("left", "center", "right"))
    assert "*: filtered" in axes[0, 0].get_figure().get_suptitle(), "beside the legend there is no room"
    assert axes[2, 0].get_ylabel().startswith("sigma [")
    assert axes[2, 0].get_ylabel().endswith("Nm]")
    assert axes[2, 1].get_ylabel() == "beta: share of the\noptimum that is withheld [%]"
    halves, count = [], len(replayed)
    for panel in axes[:2, 1]:
        (band,) = [c for c in panel.collections if "sigma" in c.get_label()]
        edges = band.get_paths()[0].vertices[:, 1]
        halves.append(0.5 * np.abs(edges[1 : count + 1] - edges[count + 2 : 2 * count + 2][::-1]))
    np.testing.assert_allclose(np.max(halves, axis=0), replayed.steps.sigma, rtol=1e-6)
    check_panels(axes[0, 0].get_figure())


def test_a_log_shows_the_rate_of_every_role(logs):
    seen = wg.inspect(logs.test)
    axes = seen.plot()
    roles = list(seen.inspection.flight.series())
    assert [a.get_title("left").split(":")[0] for a in axes[:, 0]] == roles
    imu = axes[roles.index("imu"), 0].patches[0].get_data().values
    assert np.median(imu) == pytest.approx(200.0, rel=0.02)
    check_panels(axes[0, 0].get_figure())


def test_files_are_written_without_pyplot_and_never_over_another(added, tmp_path):
    path = tmp_path / "added.png"
    save_figure(added, path)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert not plt.get_fignums()
    with pytest.raises(UsageError, match="exists already"):
        save_figure(added, path)


def test_a_figure_looks_the_same_whatever_a_matplotlibrc_says():
    """That of the working folder is read when matplotlib is imported, and belongs to the data."""
    picture = style.Picture((), (3.0, 2.0), lambda panel: panel.plot([0.0, 1.0]), title="one")

    def saved():
        stream = io.BytesIO()
        style.save(picture, stream)
        return stream.getvalue()

    usual = saved()
    with plt.rc_context({"savefig.facecolor": "red", "text.usetex": True, "font.size": 30.0}):
        assert saved() == usual
