"""The page without a browser: a server that starts and stops, and handles that stand where the log says."""

import socket
import urllib.request
from contextlib import ExitStack
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchgap.flight import so3
from wrenchgap.plant import model_file
from wrenchgap.plant.state import Actuation
from wrenchgap.plant.vehicle import Body, Vehicle
from wrenchgap.viewer.gate import exposed
from wrenchgap.viewer.page import Page
from wrenchgap.viewer.serving import serve
from wrenchgap.viewer.session import Capabilities, Scene, Stretch
from wrenchgap.viewer.vehicle_nodes import arm_pose

VEHICLE = model_file.load("tilt_hexarotor").vehicle
TIME = np.arange(0.0, 4.0, 0.02)


def scene(name="one"):
    """A circle with a turning body; torques that grow; arms that tilt against each other."""
    zero = np.zeros_like(TIME)
    return Scene(
        name=name,
        time=TIME,
        position_E=np.stack((np.cos(TIME), np.sin(TIME), 1.0 + 0.1 * TIME), axis=1),
        quat_EB=so3.exp(np.stack((zero, 0.3 * TIME, zero), axis=1)),
        reference_position_E=np.stack((np.cos(TIME), np.sin(TIME), 1.0 + zero), axis=1),
        quat_ED=so3.exp(np.stack((0.2 * TIME, zero, zero), axis=1)),
        tilt=np.outer(TIME, [0.1, -0.1, 0.2, -0.2, 0.3, -0.3]),
        wrenches={
            "commanded": np.outer(1.0 + TIME, [0.0, 0.0, 10.0, 0.1, 0.0, 0.0]),
            "measured": np.where(TIME[:, None] < 1.0, np.nan, np.outer(1.0 + TIME, [0.0, 0.0, 9.0, 0.0, 0.1, 0.0])),
        },
        worst=(Stretch(2.0, 3.0, "worst torque x"),),
        notes=("made for a test.",),
    )


def two(vehicle, **changes):
    """A session of two flights, of which the second lies 10 m away; `changes` are those of both scenes."""

    def made(flight):
        found = replace(scene(flight), **changes)
        return found if flight == "one" else replace(found, position_E=found.position_E + 10.0, tilt=None)

    return SimpleNamespace(vehicle=vehicle, flights=("one", "two"), capabilities=Capabilities(), scene=made)


@pytest.fixture
def show():
    """`show(session)` is a page on that session, stopped when the test ends."""
    with ExitStack() as pages:

        def shown(session, **more):
            made = Page(session, **({"port": 0} | more))
            pages.callback(made.stop)
            return made

        yield shown


@pytest.fixture
def page(show):
    return show(two(VEHICLE))


def test_body_and_reference_stand_where_the_log_says(page):
    for at in (0.0, 1.7, 3.98):
        page.cursor.go(at)
        k = int(np.argmin(np.abs(TIME - at)))
        assert np.asarray(page.drawing.craft.frame.position) == pytest.approx(scene().position_E[k])
        assert np.asarray(page.drawing.craft.frame.wxyz) == pytest.approx(scene().quat_EB[k])
        assert np.asarray(page.drawing.reference.position) == pytest.approx(scene().reference_position_E[k])
        assert np.asarray(page.drawing.reference.wxyz) == pytest.approx(scene().quat_ED[k])
        assert page.drawing.reference.visible


def test_arms_point_their_thrust_as_the_plant_does(page):
    page.cursor.go(3.0)
    k = int(np.argmin(np.abs(TIME - 3.0)))
    still = np.zeros((1, len(VEHICLE.rotors)))
    normals = Actuation(VEHICLE, scene().tilt[k : k + 1], still, still).arm_normal_B[0]
    for handle, normal in zip(page.drawing.craft.arms, normals, strict=True):
        assert so3.rotate(np.asarray(handle.wxyz), np.array([0.0, 0.0, 1.0])) == pytest.approx(normal, abs=1e-12)


def test_arm_frames_are_right_handed_for_any_thrust_direction():
    """A fixed arm may thrust along its own axis; the frame must still be a rotation with z along the thrust."""
    odd = replace(VEHICLE.arms, normal_B=VEHICLE.arms.axis_B.copy())
    for arm in range(6):
        R = so3.matrix(arm_pose(odd, arm, 0.0))
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert R[:, 2] == pytest.approx(odd.axis_B[arm])


def test_arrows_follow_the_wrenches_and_hide_what_is_unknown(page):
    arrows = page.drawing.arrows.handles

    def along(kind, name):
        return np.diff(arrows[kind, name].points[0], axis=0)[0]

    page.cursor.go(0.5)
    assert arrows["force", "commanded"].visible
    assert not arrows["force", "measured"].visible
    page.cursor.go(3.0)
    commanded, measured = (np.linalg.norm(along("force", name)) for name in ("commanded", "measured"))
    assert measured / commanded == pytest.approx(0.9, rel=1e-5)
    direction = along("torque", "measured")
    assert direction[1] > 0
    assert direction[[0, 2]] == pytest.approx([0.0, 0.0])
    page.scene_panel.torque.value = False
    assert not arrows["torque", "measured"].visible
    assert arrows["force", "measured"].visible


def test_another_flight_replaces_the_first(page):
    page.cursor.go(2.0)
    page.open("two")
    assert page.cursor.time == 0.0
    assert np.asarray(page.drawing.craft.frame.position) == pytest.approx([11.0, 10.0, 11.0])


def test_playing_moves_on_and_starts_again_at_the_end(page, eventually):
    page.cursor.go(3.9)
    page.transport.speed.value = "5"
    page.transport.playing(True)
    eventually(lambda: page.cursor.time < 1.0, "it does not start again")
    page.transport.playing(False)


def test_page_is_served_on_this_machine_only_and_stops(eventually):
    made = Page(two(VEHICLE), port=0)
    host, port = made.server.get_host(), made.server.get_port()
    assert host == "127.0.0.1"
    with urllib.request.urlopen(made.url, timeout=5) as answer:
        assert answer.status == 200
    made.stop()

    def closed():
        with socket.socket() as probe:
            probe.settimeout(0.5)
            return probe.connect_ex((host, port)) != 0

    eventually(closed, "the port is still open")
    assert not made.cursor._player.is_alive()


def test_other_addresses_count_as_exposed():
    assert exposed("0.0.0.0")
    assert exposed("192.168.1.5")
    assert not exposed("127.0.0.1")


def test_vehicle_of_which_only_the_wrench_is_known_is_drawn(show):
    plain = Vehicle("plain", Body(0.04, np.diag([16e-6, 16e-6, 29e-6]), np.zeros(3)), None, None, np.zeros(3))
    made = show(two(plain))
    made.cursor.go(1.0)
    assert made.drawing.craft.arms == []
    assert 0.03 < made.drawing.size < 0.2
    assert np.asarray(made.drawing.craft.frame.position)[2] == pytest.approx(1.1)


@pytest.mark.parametrize("name", ["asymmetric_quadrotor", "crazyflie", "variable_tilt_hexacopter", "voliro_x"])
def test_vehicles_of_any_geometry_are_drawn_with_their_thrusts(name, show):
    """Fixed or tilting, coaxial or not: one arrow per rotor, from its hub along its thrust, in newtons."""
    vehicle = model_file.load(name).vehicle
    arms, rotors = len(vehicle.arms or ()), len(vehicle.rotors or ())
    thrust = np.outer(1.0 + TIME, np.arange(1.0, rotors + 1.0)) if rotors else None
    made = show(two(vehicle, tilt=np.zeros((len(TIME), arms)), thrust=thrust))
    made.cursor.go(1.0)
    assert len(made.drawing.craft.arms) == arms
    if rotors:
        points = made.drawing.arrows.thrusts.points
        lengths = np.linalg.norm(points[:, 1] - points[:, 0], axis=1) / made.drawing.scale.thrust
        assert lengths == pytest.approx(2.0 * np.arange(1.0, rotors + 1.0), rel=1e-5)


def test_ellipsoids_are_three_sigma_at_the_tips_and_ghosts_stand_where_they_flew(show):
    sigma = np.tile([np.nan, np.nan, np.nan, 0.02, 0.01, 0.03], (len(TIME), 1))
    made = show(two(VEHICLE, sigma={"commanded": sigma}))
    made.cursor.go(3.0)
    cloud, arrow = (made.drawing.arrows.clouds["torque", "commanded"], made.drawing.arrows.handles)
    scale = made.drawing.scale.torque
    assert cloud.visible
    assert np.asarray(cloud.scale) == pytest.approx(3.0 * scale * np.array([0.02, 0.01, 0.03]))
    tip = scene().wrenches["commanded"][made.cursor.index, 3:] * scale + VEHICLE.body.com_B
    assert np.asarray(cloud.position) == pytest.approx(tip)
    assert arrow["torque", "commanded"].visible
    assert not made.drawing.arrows.clouds["force", "commanded"].visible
    made.show_ghost("late", replace(scene().motion, time=TIME + 1.0))
    assert np.asarray(made.drawing.ghost.frame.position) == pytest.approx(scene().position_E[100])
    made.cursor.go(0.5)
    assert not made.drawing.ghost.frame.visible, "before it began"


def test_following_moves_the_world_and_staying_does_not(page):
    page.cursor.go(2.0)
    assert np.asarray(page.drawing.world.position) == pytest.approx(-scene().position_E[page.cursor.index])
    page.scene_panel.follow(False)
    assert np.asarray(page.drawing.world.position) == pytest.approx(np.zeros(3))


def test_playing_between_the_marks_stays_there(page):
    page.transport.set_marks({"A": 1.0, "B": 2.0}, True)
    page.cursor.go(1.9)
    page.cursor.advance(0.05)
    assert page.cursor.time == pytest.approx(1.95)
    page.cursor.advance(0.2)
    assert page.cursor.time == pytest.approx(1.0)
    page.transport.set_marks({}, False)
    page.cursor.go(3.95)
    page.cursor.advance(0.2)
    assert page.cursor.time == TIME[0]


def test_port_that_is_taken_gives_the_next_one(show):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert port < show(two(VEHICLE), port=port).server.get_port() <= port + 20


def test_what_is_no_get_is_refused_without_a_word_on_the_console(capfd, caplog):
    """`curl -I` asks for the head of the page alone."""
    server, _, _ = serve("127.0.0.1", 0)
    try:
        with socket.create_connection((server.get_host(), server.get_port()), timeout=10.0) as line:
            line.sendall(b"HEAD / HTTP/1.1\r\nHost: x\r\n\r\n")
            line.recv(100)
    finally:
        server.stop()
    assert "handshake" not in caplog.text
    assert "Traceback" not in capfd.readouterr().err
