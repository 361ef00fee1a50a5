"""The ROS 2 nodes of examples/, as far as they can be checked without ROS."""

import runpy
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.learn.process.gp import GaussianProcess, Provenance
from wrenchgap.learn.process.store import save
from wrenchgap.plant.model import make_effect

HERE = Path(__file__).parent
NODE = HERE.parent / "examples" / "ros2_compensator"
COMPILER = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
OFFSET = np.array([0.004, -0.007, 0.005])
MODEL = wg.load_model("tilt_hexarotor")
MODEL = MODEL.with_effects([make_effect(MODEL.vehicle, "com_offset", OFFSET)])


@pytest.mark.skipif(COMPILER is None, reason="no C++ compiler: sudo apt-get install g++")
def test_the_cpp_node_compiles_against_stubs_and_the_exported_header(tmp_path):
    wg.export_compensator(None, MODEL, tmp_path / "compensator")
    words = [COMPILER, "-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    words += ["-I", HERE / "ros2_stubs", "-I", tmp_path / "compensator", NODE / "compensator_node.cpp"]
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def silent_process():
    """A process that knows of nothing but the effects."""
    return GaussianProcess(
        outputs=("torque_x", "torque_y", "torque_z"),
        input_mean=np.zeros(6),
        input_scale=np.ones(6),
        output_scale=np.ones(3),
        mean_coefficients=np.zeros((3, 7)),
        inputs=np.zeros((1, 6)),
        residuals=np.zeros((1, 3)),
        lengthscales=np.ones((3, 6)),
        signal_variance=np.ones(3),
        noise_variance=np.ones(3),
        sigma_training=np.ones(3),
        mismatch_max=np.ones(3),
        provenance=Provenance(vehicle=MODEL.vehicle.name, physics="com_offset"),
    )


class Node:
    """A stand-in of rclpy's: parameters by name, and what was subscribed, published and warned of."""

    parameters: dict = {}  # noqa: RUF012

    def __init__(self, name):
        self.name, self.subscribed, self.published, self.warned = name, {}, [], []

    def declare_parameter(self, name, usual):
        return SimpleNamespace(value=self.parameters.get(name, usual))

    def create_publisher(self, kind, topic, qos):
        return SimpleNamespace(publish=lambda message: self.published.append((topic, message)))

    def create_subscription(self, kind, topic, function, qos):
        self.subscribed[topic] = function

    def get_logger(self):
        return SimpleNamespace(warning=lambda text, **_: self.warned.append(text))


@pytest.fixture(params=[False, True], ids=["compensator", "with observer"])
def node(tmp_path, monkeypatch, request):
    """The Python node, on stand-ins."""
    stand_ins = {
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": None},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"WrenchStamped": object},
        "nav_msgs": {},
        "nav_msgs.msg": {"Odometry": object},
    }
    for name, content in stand_ins.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    gp = silent_process()
    gp = replace(gp, provenance=replace(gp.provenance, observer_hz=2.0))
    save(replace(gp, settings=replace(gp.settings, mean="physics")), tmp_path / "torque.gp")
    wg.save_model(MODEL, tmp_path / "fitted.toml")
    files = {"gp": str(tmp_path / "torque.gp"), "model": str(tmp_path / "fitted.toml")}
    monkeypatch.setattr(Node, "parameters", files | {"dt": 0.005, "observer": request.param})
    return runpy.run_path(str(NODE / "compensator_node.py"))["CompensatorNode"]()


def vector(*values):
    return SimpleNamespace(**dict(zip("xyzw", values, strict=False)))


def wrench(time, *values):
    stamp = SimpleNamespace(stamp=SimpleNamespace(sec=int(time), nanosec=round(1e9 * (time % 1))))
    return SimpleNamespace(header=stamp, wrench=SimpleNamespace(force=vector(*values[:3]), torque=vector(*values[3:])))


def odometry(time):
    pose = SimpleNamespace(position=vector(0.0, 0.0, 1.0), orientation=vector(0.0, 0.0, 0.0, 1.0))
    twist = SimpleNamespace(linear=vector(0.0, 0.0, 0.0), angular=vector(0.0, 0.0, 0.0))
    return SimpleNamespace(
        header=wrench(time, *np.zeros(6)).header, pose=SimpleNamespace(pose=pose), twist=SimpleNamespace(twist=twist)
    )


def torque(message):
    t = message.wrench.torque
    return np.array([t.x, t.y, t.z])


def test_the_python_node_adds_the_lever_of_the_force(node):
    node.subscribed["odometry"](odometry(10.0))
    node.subscribed["desired"](wrench(10.01, 1.0, -2.0, 30.0, 0.0, 0.0, 0.0))
    topic, sent = node.published[-1]
    assert topic == "commanded"
    assert torque(sent) == pytest.approx(np.cross(OFFSET, [1.0, -2.0, 30.0]), abs=1e-6)
    node.subscribed["feedback"](wrench(10.01, 0, 0, 0, 0.0, 0.0, 0.1))
    node.subscribed["desired"](wrench(10.02, 1.0, -2.0, 30.0, 0.0, 0.0, 0.0))
    expected = np.cross(OFFSET, [1.0, -2.0, 30.0]) + np.array([0, 0, 0.1])
    assert torque(node.published[-1][1]) == pytest.approx(expected, abs=1e-6)
    assert node.warned == []


def test_the_python_node_starts_afresh_on_the_ground(node):
    """With an observer: it finds a torque nobody knows of, and forgets it below the force that says airborne."""
    node.airborne = 5.0
    seen = []
    for k in range(20):
        node.subscribed["odometry"](odometry(10.0 + 0.005 * k))
        node.subscribed["desired"](wrench(10.0 + 0.005 * k, 0.0, 0.0, 4.0 if k == 10 else 30.0, 0.0, 0.0, 0.01))
        seen.append(torque(node.published[-1][1]))
    assert seen[10] == pytest.approx([0.0, 0.0, 0.01])
    assert seen[11:] == [pytest.approx(value) for value in seen[:9]]
    assert (np.abs(seen[9] - seen[0]).max() > 1e-4) == hasattr(node.compensator, "estimate")
    assert node.warned == []


def test_the_python_node_never_stops_the_loop(node):
    """Without odometry, with an old one, and with input that is no number, the desired wrench passes."""
    node.subscribed["desired"](wrench(9.0, 0.0, 0.0, 30.0, 0.0, 0.0, 0.01))
    node.subscribed["odometry"](odometry(10.0))
    node.subscribed["desired"](wrench(11.0, 0.0, 0.0, 30.0, 0.0, 0.0, 0.01))
    node.subscribed["desired"](wrench(10.0, 0.0, 0.0, np.nan, 0.0, 0.0, 0.01))
    assert [torque(m)[2] for _, m in node.published] == [0.01, 0.01, 0.01]
    assert len(node.warned) == 3
