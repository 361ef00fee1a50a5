"""The top view of a vehicle: what is drawn sits where the geometry says, turns as the rotors do, and is named."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle

import wrenchgap as wg
from wrenchgap.flight.errors import UsageError
from wrenchgap.replay.present.figures import style, vehicle


@pytest.fixture(scope="module")
def crazyflie():
    found = wg.load_model("crazyflie").vehicle
    return replace(found, rotor_names=("M1", "M2", "M$3", "M4"), arm_names=("", "", "back_left$", ""))


def drawn(of, *marked, **more):
    figure = Figure()
    FigureCanvasAgg(figure)
    panel = figure.subplots()
    vehicle.draw(panel, of, *marked, **more)
    return panel


def discs(panel):
    return {p.get_gid(): p for p in panel.patches if isinstance(p, Circle)}


def texts(panel):
    return {t.get_text(): t for t in panel.texts}


def test_rotors_are_drawn_where_they_are_and_as_large(crazyflie):
    """92 mm from motor to motor: 32.5 mm to the front and to the side; M1 is front right, so right on the picture."""
    panel = drawn(crazyflie)
    found, side = discs(panel), 0.046 * np.sqrt(0.5)
    np.testing.assert_allclose(found["rotor_0"].center, (-side, side))  # (y, x): right, front
    np.testing.assert_allclose(found["rotor_2"].center, (side, -side))  # left, back
    assert {disc.radius for disc in found.values()} == {0.0231}
    panel.figure.canvas.draw()
    pixels = {name: panel.transData.transform(disc.center) for name, disc in found.items()}
    assert pixels["rotor_0"][0] > pixels["rotor_3"][0]  # M1 is to the right of M4
    assert pixels["rotor_0"][1] > pixels["rotor_1"][1]  # and in front of M2
    metre = panel.transData.transform((0.0, 0.1)) - panel.transData.transform((0.0, 0.0))
    across = panel.transData.transform((0.1, 0.0)) - panel.transData.transform((0.0, 0.0))
    assert abs(metre[1]) == pytest.approx(abs(across[0]))  # circles are circles


def test_arrows_turn_as_rotors_do(crazyflie):
    """Twice the area that the arc sweeps about its hub, in pixels, is positive when it turns counter-clockwise."""
    panel = drawn(crazyflie)
    panel.figure.canvas.draw()
    for r, spin in enumerate(crazyflie.rotors.spin):
        hub = discs(panel)[f"rotor_{r}"].center
        (arc,) = [
            line
            for line in panel.lines
            if len(line.get_xdata()) > 10 and np.hypot(*(line.get_xydata() - hub).T).max() < 0.0231
        ]
        x, y = panel.transData.transform(arc.get_xydata()).T
        hx, hy = panel.transData.transform(hub)
        swept = np.sum((x[:-1] - hx) * (y[1:] - hy) - (x[1:] - hx) * (y[:-1] - hy))
        assert np.sign(swept) == spin


def test_a_rotor_whose_thrust_points_down_turns_the_other_way_as_seen_from_above(crazyflie):
    over = replace(crazyflie, arms=replace(crazyflie.arms, normal_B=-crazyflie.arms.normal_B))
    np.testing.assert_allclose(vehicle.turns(over), -vehicle.turns(crazyflie))


def test_parts_have_their_names_without_markup(crazyflie):
    (panel,) = style.figure_of(vehicle.picture(crazyflie)).axes
    found = texts(panel)
    assert {"M1", "M2", "M$3", "M4", "back_left$", "forward"} <= set(found)
    assert not any(found[name].get_parse_math() for name in ("M$3", "back_left$"))


def test_marked_parts_stand_out_and_say_why(crazyflie):
    panel = drawn(crazyflie, {"rotor_2": "thrust -8 %", "com": "5 mm"}, moved_B=np.array([-0.004, 0.003, 0.0]))
    found = discs(panel)
    red, grey = (found[name].get_facecolor()[:3] for name in ("rotor_2", "rotor_1"))
    assert red[0] > red[1] + 0.3
    assert np.ptp(grey) < 1e-9
    words = texts(panel)
    assert {"M$3: thrust -8 %", "centre of mass: 5 mm"} <= set(words)
    np.testing.assert_allclose(words["M$3: thrust -8 %"].xy, found["rotor_2"].center)
    arrows = [t for t in panel.texts if getattr(t, "arrow_patch", None) is not None]
    (arrow,) = [t for t in arrows if t.arrow_patch.get_linewidth() == 2.0]
    to, start = np.array(arrow.xy), np.array(arrow.xyann)
    np.testing.assert_allclose((to - start) / np.linalg.norm(to - start), (0.6, -0.8))  # left and back


def test_of_two_rotors_on_one_arm_the_lower_is_said_to_be_below():
    hexarotor = wg.load_model("tilt_hexarotor").vehicle
    panel = drawn(hexarotor)
    found, (_, rotors) = discs(panel), hexarotor.geometry()
    upper, lower = sorted(range(2), key=lambda r: -rotors.offset[r])
    assert found[f"rotor_{upper}"].center == pytest.approx(found[f"rotor_{lower}"].center)
    assert found[f"rotor_{lower}"].get_linestyle() == "--"
    assert {f"M{upper + 1}", f"M{lower + 1} (below)"} <= set(texts(panel))


def test_every_shipped_vehicle_can_be_drawn():
    for name in ("voliro_x", "tilt_hexarotor", "crazyflie", "asymmetric_quadrotor", "variable_tilt_hexacopter"):
        of = wg.load_model(name).vehicle
        style.figure_of(vehicle.picture(of, {"com": "moved"})).canvas.draw()
    assert "the model file has no arms and rotors" in texts(drawn(of))


def test_a_part_that_is_not_there_is_refused_in_one_line(crazyflie):
    with pytest.raises(UsageError, match="got the part 'rotor_7', expected one of com, imu, arm_0") as caught:
        drawn(crazyflie, {"rotor_7": ""})
    assert "\n" not in str(caught.value)


def test_words_stay_on_the_picture_and_off_its_axes(crazyflie):
    """Long ones too, and those on a centre of mass that is a little beside O."""
    beside = replace(crazyflie, body=replace(crazyflie.body, com_B=np.array([0.0, 1e-3, 0.0])))
    words = {"com": "moved by 4.1 mm towards the back and to the left", "imu": "turned by 1.2 deg about body x"}
    words |= {f"rotor_{r}": "relative thrust -0.081 of what it was" for r in range(4)}
    figure = style.figure_of(vehicle.picture(beside, words))
    figure.canvas.draw()
    (panel,) = figure.axes
    box = panel.get_window_extent()
    for text in panel.texts:
        if ":" in text.get_text():
            extent = text.get_window_extent()
            assert box.x0 <= extent.x0
            assert extent.x1 <= box.x1


def test_words_stay_off_the_axes_of_a_small_panel_as_well(crazyflie):
    """As beside two other panels in the picture of `changed`."""
    figure = Figure(figsize=(15.0, 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    panel = figure.subplots(1, 3)[2]
    vehicle.draw(panel, crazyflie, {f"rotor_{r}": "rotor_thrust -18 %, 97 %" for r in range(4)})
    figure.canvas.draw()
    box = panel.get_window_extent()
    extents = [text.get_window_extent() for text in panel.texts if ":" in text.get_text()]
    assert len(extents) == 4
    assert all(box.x0 <= e.x0 and e.x1 <= box.x1 for e in extents)
