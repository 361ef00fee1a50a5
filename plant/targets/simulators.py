"""A vehicle for simulators, with what was identified in it: MJCF, SDF and URDF; parameters of RotorPy and drone-models.

Of robot descriptions mass, centre of mass and inertia are those of the whole vehicle. SDF and URDF need links for
rotors, and every format one for an arm that tilts: each takes the share `LINK` of the mass, and the base what makes the
sums right.

MJCF (MuJoCo): an actuator on a site makes (0, 0, g) u and (0, 0, q) u in the site's frame, z along the thrust; u is the
nominal thrust c_f Omega^2 [N], g the thrust over it and q the drag torque. A lag filters u.
SDF, URDF (Gazebo): the multicopter motor model makes motorConstant Omega^2 along the link's z, momentConstant times
that as a torque, and -|Omega| rotorDragCoefficient v across it; the speed follows with timeConstantUp and _Down.

The rotors of packages in Python thrust along z.

RotorPy (`quad_params`): from the centre of mass; a rotor makes k_eta Omega^2 + k_h |v_xy|^2 along z, rotor_directions
k_m Omega^2 about it, and at its hub -Omega (k_d, k_d, k_z) v; the hull -|v| c_D v. So linear drag is put at the hubs,
in proportion to their speeds, and quadratic drag is exact along one axis at a time.
drone-models (`first_principles`): thrust and torque are polynomials in revolutions a minute, mixing_matrix has the arms
over L and the signs of the torques, drag_matrix v is the force, speeds approach their commands at rates rotor_dyn_coef
[1/s]. prop_inertia is 0: about x its gyroscopic torque has the other sign there than in physics.

Sources: MuJoCo XML reference; sdformat.org; gz-sim, MulticopterMotorModel; rotorpy 3.0 (vehicles/multirotor.py),
drone-models 0.1 (first_principles/model.py).
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
import tomlkit
from scipy.spatial.transform import Rotation

from wrenchgap._escaping import printable
from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import RPM, Array
from wrenchgap.plant.drafts.package_tables import INSTANT
from wrenchgap.plant.drafts.robot_tree import unit_mass_inertia
from wrenchgap.plant.targets.quantities import Values
from wrenchgap.plant.vehicle import GRAVITY, Vehicle

LINK = 1e-4
"""Share of the mass: light enough to leave the motion alone, heavy enough for engines that divide by it."""
PLUGIN = ("gz-sim-multicopter-motor-model-system", "gz::sim::systems::MulticopterMotorModel")
ENDLESS = 1e3
"""[rad], the limit of an arm that tilts without one: it is no rotor, which turns without limits."""
Entry = str | float | Sequence[float] | Array
"""What an attribute or an element holds."""


@dataclass(frozen=True, eq=False)
class Link:
    """A body: its frame (`place` (3,), `turned` (3, 3)) and mass properties in B, its joint to its parent.

    `axis` (3,) in B, None of the base; `limits` [rad], None where it turns without end. `rotor` is its number.
    """

    name: str
    parent: str
    place: Array
    turned: Array
    mass: float
    com: Array
    inertia: Array
    axis: Array | None = None
    limits: tuple[float, float] | None = None
    rotor: int | None = None


def links_of(vehicle: Vehicle, values: Values, rotors: bool) -> list[Link]:
    """The base, an arm for each that tilts and, where asked for, the rotors; parents first."""
    arms, of_rotors = vehicle.geometry()
    mass, com, inertia = float(values["mass"]), values["com"], values["inertia"]
    light, size = LINK * mass, float(np.max(np.abs(values["hub"])) or 0.1)
    small = 0.01 * light * size**2 * np.diag([0.5, 0.5, 1.0])  # discs: what is left of a flat vehicle stays possible
    out = []
    for a in np.flatnonzero(arms.tilts):
        limits = (max(float(arms.tilt_min[a]), -ENDLESS), min(float(arms.tilt_max[a]), ENDLESS))
        at = arms.position_B[a]
        out.append(Link(f"arm_{a}", "base", at, np.eye(3), light, at, small, arms.axis_B[a], limits))
    for r in range(len(of_rotors) if rotors else 0):
        parent = f"arm_{of_rotors.arm[r]}" if arms.tilts[of_rotors.arm[r]] else "base"
        at, turned = values["hub"][r], upright(values["direction"][r])
        out.append(Link(f"rotor_{r}", parent, at, turned, light, at, turned @ small @ turned.T, turned[:, 2], None, r))
    left = mass - light * len(out)
    centre = (mass * com - sum((light * one.com for one in out), np.zeros(3))) / left
    own = inertia + mass * unit_mass_inertia(com) - left * unit_mass_inertia(centre)
    own = own - sum((one.inertia + one.mass * unit_mass_inertia(one.com) for one in out), np.zeros((3, 3)))
    lacking = 2.0 * np.linalg.eigvalsh(own)[-1] - np.trace(own)  # no moment of a body exceeds the sum of the others
    own += (max(lacking, 0.0) + 1e-9 * np.trace(own)) * np.eye(3)
    return [Link("base", "", np.zeros(3), np.eye(3), left, centre, own), *out]


def upright(direction: Array) -> Array:
    """The rotation (3, 3) by the smallest angle that turns z into a direction (3,)."""
    across = np.array([-direction[1], direction[0], 0.0])
    length = float(np.linalg.norm(across))
    if length < 1e-12:
        return np.eye(3) if direction[2] > 0.0 else np.diag([1.0, -1.0, -1.0])
    return np.asarray(Rotation.from_rotvec(across / length * np.arctan2(length, direction[2])).as_matrix())


def mjcf(vehicle: Vehicle, values: Values) -> str:
    """MuJoCo's XML."""
    _, rotors = vehicle.geometry()
    root = Element("mujoco", model=printable(vehicle.name))
    _child(root, "compiler", angle="radian", autolimits="true")
    _child(root, "option", gravity=(0.0, 0.0, -GRAVITY), integrator="RK4", timestep="0.001")
    base = _child(_child(root, "worldbody"), "body", name="base", pos="0 0 1")
    _child(base, "freejoint", name="free")
    links = {one.name: one for one in links_of(vehicle, values, rotors=False)}
    bodies = {"base": base}
    for name, one in links.items():
        if one.axis is not None and one.limits is not None:
            bodies[name] = _child(base, "body", name=name, pos=one.place)
            _child(bodies[name], "joint", name=name, type="hinge", axis=one.axis, range=one.limits)
        moments = one.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        _child(bodies[name], "inertial", pos=one.com - one.place, mass=one.mass, fullinertia=moments)
    _child(base, "site", name="imu", pos=values["imu"])
    sensor, actuator = _child(root, "sensor"), _child(root, "actuator")
    for kind in ("accelerometer", "gyro"):
        _child(sensor, kind, name=f"imu_{kind}", site="imu")
    nominal, full = vehicle.body.mass * GRAVITY / len(rotors), rotors.c_f * rotors.speed_max**2
    lag = float(values["lag"].mean())
    for r, (arm, at, along) in enumerate(zip(rotors.arm, values["hub"], values["direction"], strict=True)):
        name, holder = f"rotor_{r}", f"arm_{arm}" if f"arm_{arm}" in links else "base"
        quat = np.roll(Rotation.from_matrix(upright(along)).as_quat(), 1)  # the scalar first
        _child(bodies[holder], "site", name=name, pos=at - links[holder].place, quat=quat)
        gain = float(values["level"] * values["balance"][r]) / nominal
        gear, limits = (0.0, 0.0, gain, 0.0, 0.0, gain * values["yaw"][r]), (0.0, full[r])
        lagged: dict[str, Entry] = {"dyntype": "filterexact", "dynprm": lag} if lag else {}
        _child(actuator, "general", name=name, site=name, gear=gear, ctrlrange=limits, **lagged)
    for name, one in links.items():
        if one.axis is not None:
            _child(actuator, "position", name=name, joint=name, kp=1e4 * float(np.trace(one.inertia)), dampratio="1")
    return _text(root)


def sdf(vehicle: Vehicle, values: Values) -> str:
    """Gazebo's SDF, with a motor plugin for each rotor."""
    root = Element("sdf", version="1.9")
    model = _child(root, "model", name=printable(vehicle.name))
    links = links_of(vehicle, values, rotors=True)
    for one in links:
        link = _child(model, "link", name=one.name)
        _leaf(link, "pose", (*one.place, *_euler(one.turned)))
        inertial = _child(link, "inertial")
        _leaf(inertial, "pose", (*one.turned.T @ (one.com - one.place), 0.0, 0.0, 0.0))
        _leaf(inertial, "mass", one.mass)
        moments = _child(inertial, "inertia")
        for key, value in _moments(one).items():
            _leaf(moments, key, value)
        if one.axis is None:
            continue
        joint = _child(model, "joint", name=f"{one.name}_joint", type="revolute" if one.limits else "continuous")
        _leaf(joint, "parent", one.parent)
        _leaf(joint, "child", one.name)
        axis = _child(joint, "axis")
        _leaf(axis, "xyz", one.turned.T @ one.axis)
        if one.limits is not None:
            limit = _child(axis, "limit")
            for end, value in zip(("lower", "upper"), one.limits, strict=True):
                _leaf(limit, end, value)
    for one in links:
        if one.rotor is not None:
            _motor(model, vehicle, values, one.rotor)
    return _text(root)


def urdf(vehicle: Vehicle, values: Values) -> str:
    """URDF, with Gazebo's motor plugins."""
    root = Element("robot", name=printable(vehicle.name))
    links = {one.name: one for one in links_of(vehicle, values, rotors=True)}
    for one in links.values():
        inertial = _child(_child(root, "link", name=one.name), "inertial")
        _child(inertial, "origin", xyz=one.turned.T @ (one.com - one.place), rpy=(0.0, 0.0, 0.0))
        _child(inertial, "mass", value=one.mass)
        _child(inertial, "inertia", **_moments(one))
        if one.axis is None:
            continue
        joint = _child(root, "joint", name=f"{one.name}_joint", type="revolute" if one.limits else "continuous")
        to_parent = links[one.parent].turned.T
        place = to_parent @ (one.place - links[one.parent].place)
        _child(joint, "origin", xyz=place, rpy=_euler(to_parent @ one.turned))
        _child(joint, "parent", link=one.parent)
        _child(joint, "child", link=one.name)
        _child(joint, "axis", xyz=one.turned.T @ one.axis)
        if one.limits is not None:
            _child(joint, "limit", lower=one.limits[0], upper=one.limits[1], effort="100", velocity="10")
    gazebo = _child(root, "gazebo")
    for one in links.values():
        if one.rotor is not None:
            _motor(gazebo, vehicle, values, one.rotor)
    return _text(root)


def _motor(parent: Element, vehicle: Vehicle, values: Values, r: int) -> None:
    """The motor plugin of a rotor."""
    _, rotors = vehicle.geometry()
    up, down = (float(x) if x > 0.0 else INSTANT for x in values["lag"])
    settings: dict[str, Entry] = {
        "robotNamespace": printable(vehicle.name),
        "jointName": f"rotor_{r}_joint",
        "linkName": f"rotor_{r}",
        "turningDirection": "cw" if values["yaw"][r] > 0.0 else "ccw",
        "timeConstantUp": up,
        "timeConstantDown": down,
        "maxRotVelocity": rotors.speed_max[r],
        "motorConstant": values["level"] * values["balance"][r] / values["hover"][r] ** 2,
        "momentConstant": abs(values["yaw"][r]),
        "commandSubTopic": "command/motor_speed",
        "motorNumber": str(r),
        "rotorDragCoefficient": values["linear"][:2].mean() / values["hover"].sum(),
        "rollingMomentCoefficient": 0.0,
        "motorSpeedPubTopic": f"motor_speed/{r}",
        "rotorVelocitySlowdownSim": "10",
        "motorType": "velocity",
    }
    plugin = _child(parent, "plugin", filename=PLUGIN[0], name=PLUGIN[1])
    for name, value in settings.items():
        _leaf(plugin, name, value)


def _moments(one: Link) -> dict[str, Entry]:
    """The six entries of a link's inertia, in its frame."""
    own = one.turned.T @ one.inertia @ one.turned
    return {f"i{'xyz'[i]}{'xyz'[k]}": own[i, k] for i in range(3) for k in range(i, 3)}


def _euler(turned: Array) -> Array:
    """Roll, pitch and yaw (3,) [rad]."""
    return np.asarray(Rotation.from_matrix(turned).as_euler("xyz"))


def _child(parent: Element, tag: str, **attributes: Entry) -> Element:
    return ElementTree.SubElement(parent, tag, {name: _entry(value) for name, value in attributes.items()})


def _leaf(parent: Element, name: str, value: Entry) -> None:
    _child(parent, name).text = _entry(value)


def _entry(value: Entry) -> str:
    """A text as it is, a number or several in 12 digits."""
    return value if isinstance(value, str) else " ".join(f"{float(one) + 0.0:.12g}" for one in np.atleast_1d(value))


def _text(root: Element) -> str:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def rotorpy(vehicle: Vehicle, values: Values) -> str:
    """A Python module with `quad_params`. Raises ModelError for rotors that RotorPy cannot have."""
    _, rotors = vehicle.geometry()
    _check_upward(vehicle, values, "RotorPy")
    if len(rotors) != 4:
        raise ModelError(f"{vehicle.name}: has {len(rotors)} rotors; RotorPy inverts the allocation of four")
    arms, J = values["hub"] - values["com"], values["inertia"]
    k_eta, speeds = values["level"] / np.mean(values["hover"] ** 2), values["hover"].sum()
    quad = {
        "mass": values["mass"],
        **{f"I{'xyz'[i]}{'xyz'[k]}": J[i, k] for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))},
        "num_rotors": 4,
        "rotor_radius": rotors.radius.mean(),
        "rotor_pos": {f"r{r + 1}": arm for r, arm in enumerate(arms)},
        "rotor_directions": np.sign(values["yaw"]),
        "rI": values["imu"] - values["com"],
        **{f"c_D{axis}": values["quadratic"][k] for k, axis in enumerate("xyz")},
        "k_eta": k_eta,
        "k_m": k_eta * np.abs(values["yaw"]).mean(),
        "k_d": values["linear"][:2].mean() / speeds,
        "k_z": values["linear"][2] / speeds,
        "k_h": max(float(values["lift"]), 0.0),
        "k_flap": 0.0,
        "tau_m": values["lag"].mean() or INSTANT,
        "rotor_speed_min": rotors.speed_min.max(),
        "rotor_speed_max": rotors.speed_max.min(),
        "motor_noise_std": 0.0,
    }
    lines = [f"    {key!r}: {_python(value)}," for key, value in quad.items()]
    return "\n".join(["import numpy as np", "", "quad_params = {", *lines, "}"]) + "\n"


def _python(value: object) -> str:
    """Python that makes a number, an array or a dict of them."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key!r}: {_python(one)}' for key, one in value.items())}}}"
    plain = np.asarray(value).tolist()
    return f"np.array({plain!r})" if isinstance(plain, list) else repr(plain)


def drone_models(vehicle: Vehicle, values: Values) -> str:
    """TOML with the keyword arguments of `drone_models.first_principles.dynamics`. Raises ModelError likewise."""
    _check_upward(vehicle, values, "drone-models")
    arms = values["hub"] - values["com"]
    length = float(np.linalg.norm(arms[:, :2], axis=1).mean())
    powers = (RPM / values["hover"].mean()) ** np.arange(3)
    thrust = float(values["level"]) * values["curve"] * powers
    torque = float(values["level"]) * float(np.abs(values["yaw"]).mean()) * values["twist"] * powers
    up, down = (1.0 / (float(x) or INSTANT) for x in values["lag"])
    drone = {
        "gravity_vec": [0.0, 0.0, -GRAVITY],
        "mass": float(values["mass"]),
        "L": length,
        "J": values["inertia"].tolist(),
        "J_inv": np.linalg.inv(values["inertia"]).tolist(),
        "rpm2thrust": thrust.tolist(),
        "rpm2torque": torque.tolist(),
        "rotor_dyn_coef": [up, 0.0, down, 0.0],
        "mixing_matrix": [*(arms[:, [1, 0]] * [1.0, -1.0] / length).T.tolist(), np.sign(values["yaw"]).tolist()],
        "drag_matrix": np.diag(-values["linear"]).tolist(),
        "prop_inertia": 0.0,
    }
    return tomlkit.dumps(drone)


def _check_upward(vehicle: Vehicle, values: Values, package: str, tolerance: float = 0.02) -> None:
    """Raise ModelError where a thrust is off z by more than a `tolerance` [rad], 0.02 % of thrust along z."""
    arms, _ = vehicle.geometry()
    if arms.tilts.any() or np.abs(values["direction"] - [0.0, 0.0, 1.0]).max() > tolerance:
        raise ModelError(f"{vehicle.name}: has rotors that do not point up; those of {package} do")
