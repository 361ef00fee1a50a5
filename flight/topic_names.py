"""What a topic's type and name say: what it offers, words for a role and words against it, and whose it is.

A namespace may be that of one of several vehicles in a log (`fleet`).
"""

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence

TYPES: dict[str, dict[str, str]] = {
    "geometry_msgs/msg/Wrench": {"wrench": ""},
    "geometry_msgs/msg/WrenchStamped": {"wrench": "wrench"},
    "sensor_msgs/msg/Imu": {"imu": ""},
    "nav_msgs/msg/Odometry": {"pose": "pose.pose", "twist": "twist.twist"},
    "geometry_msgs/msg/Pose": {"pose": ""},
    "geometry_msgs/msg/PoseStamped": {"pose": "pose"},
    "geometry_msgs/msg/PoseWithCovarianceStamped": {"pose": "pose.pose"},
    "geometry_msgs/msg/TransformStamped": {"pose": "transform"},
    "geometry_msgs/msg/Twist": {"twist": ""},
    "geometry_msgs/msg/TwistStamped": {"twist": "twist"},
    "geometry_msgs/msg/TwistWithCovarianceStamped": {"twist": "twist.twist"},
    "geometry_msgs/msg/AccelStamped": {"acceleration": "accel"},
    "geometry_msgs/msg/AccelWithCovarianceStamped": {"acceleration": "accel.accel"},
    "trajectory_msgs/msg/MultiDOFJointTrajectory": {
        "pose": "points.0.transforms.0",
        "twist": "points.0.velocities.0",
        "acceleration": "points.0.accelerations.0",
    },
    "actuator_msgs/msg/Actuators": {"tilt": "position", "rotor_speed": "velocity"},
    "mav_msgs/msg/Actuators": {"tilt": "angles", "rotor_speed": "angular_velocities"},
    "sensor_msgs/msg/JointState": {"tilt": "position", "rotor_speed": "velocity"},
    "sensor_msgs/msg/BatteryState": {"voltage": "voltage"},
    "std_msgs/msg/Float64MultiArray": {"tilt": "data", "rotor_speed": "data"},
    "std_msgs/msg/Float32MultiArray": {"tilt": "data", "rotor_speed": "data"},
    "std_msgs/msg/Float64": {"voltage": "data"},
    "std_msgs/msg/Float32": {"voltage": "data"},
    "foxglove.PoseInFrame": {"pose": "pose"},
    "foxglove.FrameTransform": {"pose": ""},
}
"""Quantities that a message type offers, and the field in which each lies."""

_TELLING = {
    "imu": ("angular_velocity.x", "linear_acceleration.x"),
    "wrench": ("force.x", "torque.x"),
    "pose": ("position.x", "orientation.w"),
    "twist": ("linear.x", "angular.x"),
}
"""Fields by which a type that is not ROS' is known to offer a quantity."""


def by_fields(fields: list[str]) -> dict[str, str]:
    """Quantities that messages offer by the names of their fields, and the field in which each lies."""
    found: dict[str, str] = {}
    for quantity, (first, *others) in _TELLING.items():
        for name in fields:
            prefix = name.removesuffix(first)
            if name.endswith(first) and prefix[-1:] in ("", ".") and all(prefix + other in fields for other in others):
                found.setdefault(quantity, prefix.removesuffix("."))
    return found


_COMMAND = frozenset({"command", "commands", "commanded", "cmd", "control", "controller", "ctrl", "actuation", "out"})
_DESIRED = frozenset(
    {"desired", "des", "setpoint", "sp", "ref", "reference", "target", "goal", "trajectory", "planned"}
)
_FOREIGN = frozenset(
    {"payload", "load", "slung", "gripper", "camera", "gimbal", "obstacle", "ball", "map", "gps", "bias", "replay"}
)
_NOT_COMMAND = frozenset(
    {"collision", "collisions", "contact", "contacts", "external", "ext", "sensor", "ft", "measured", "meas"}
    | {"estimated", "estimate", "disturbance", "wind", "residual", "predicted", "correction", "interaction", "error"}
)
_TRUTH = frozenset(
    {"odometry", "odom", "state", "truth", "gt", "mocap", "vicon", "optitrack", "vrpn", "estimate", "vehicle"}
)
_TILT = frozenset({"tilt", "tilts", "alpha", "servo", "servos", "angle", "angles", "arm", "arms"})
ROTOR = frozenset(
    {"motor", "motors", "rotor", "rotors", "speed", "speeds", "rpm", "omega", "esc", "propeller", "velocities"}
)
_BATTERY = frozenset({"battery", "voltage", "vbat", "power"})


def no_command(topic: str) -> bool:
    """Whether a topic's name says that its wrench is one of a contact, of a sensor, or an estimate."""
    return bool(name_words("/".join(topic.split("/")[-2:])) & _NOT_COMMAND)


def score(part: str, topic: str, kind: str) -> float:
    """How well a topic's name and type suit a part; not above zero means: not without being asked."""
    if name_words(topic) & _FOREIGN:
        return -10.0
    words = name_words("/".join(topic.split("/")[-2:]))
    asked, stamped = bool(words & (_COMMAND | _DESIRED)), 0.2 * ("Stamped" in kind)
    if part == "commanded":
        return -5.0 if words & (_NOT_COMMAND | _DESIRED) else (3.0 if words & _COMMAND else 1.0) + stamped
    if part == "desired":
        return -5.0 if words & _NOT_COMMAND or not words & _DESIRED else 3.0 + stamped
    if part == "imu":
        truth, other = bool(words & {"truth", "gt", "ground"}), bool(words & {"mag", "temp"})
        return 2.0 + ("raw" not in words) * 0.2 - 0.5 * truth - other
    if part == "battery":
        return 3.0 if "Battery" in kind else 1.0 if words & _BATTERY and "Float" in kind else -5.0
    if part in ("tilt", "rotor_speed"):
        return _score_actuators(part, words, kind, asked)
    if part in ("pose", "twist"):
        if asked or "vel" in words or "Trajectory" in kind:
            return -5.0
        truth = bool(words & {"truth", "gt", "mocap", "vicon"})
        own = 2.0 * ("Odometry" in kind) + bool(words & _TRUTH) + 0.5 * truth
        return own + (0.5 if "Stamped" in kind else 0.1 if "Pose" in kind else 0.0)
    if "Trajectory" in kind:  # the others are parts of a reference
        return 3.0
    if not asked or "vel" in words:
        return -5.0
    return 2.0 + bool(words & _DESIRED) + ("Odometry" in kind) + stamped


def _score_actuators(part: str, words: frozenset[str], kind: str, asked: bool) -> float:
    if "Actuators" in kind:
        return 3.0 + bool(words & _COMMAND) - 2.0 * bool(words & _NOT_COMMAND)
    if part == "rotor_speed" and kind not in TYPES:
        return 2.0 + asked  # a custom type with a field of that name
    own, other = (_TILT, ROTOR - {"speed"}) if part == "tilt" else (ROTOR, _TILT)
    return 2.0 * bool(words & own) + asked - 3.0 * bool(words & other) - (2.0 if "JointState" in kind else 0.5)


def says_command(topic: str, kind: str) -> bool:
    """Whether a topic tells that its values are commands and not measurements."""
    return "Actuators" in kind or bool(name_words(topic) & (_COMMAND | _DESIRED))


def name_words(topic: str) -> frozenset[str]:
    """Lower-case words of a topic's name, split at punctuation, digits and capitals."""
    spaced = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", topic)
    return frozenset(word.lower() for word in re.split(r"[^A-Za-z]+", spaced) if word)


OTHER_SOURCES = (
    _TRUTH
    | _COMMAND
    | _DESIRED
    | _NOT_COMMAND
    | {"ground", "sim", "simulation", "simulator", "raw", "filtered", "fused"}
) - {"vehicle"}
"""Words by which a namespace is not another vehicle's, but another source of the same one."""


def apart(topic: str, other: str) -> tuple[str, str] | None:
    """The namespaces in which two topics are called alike, the longest name in common; None where they are not.

    Either may be the root, "". Namespaces that say another source (`/sim/imu`) are no vehicles'.
    """
    own, their = topic.strip("/").split("/"), other.strip("/").split("/")
    count = 0
    while count < min(len(own), len(their)) and own[-1 - count] == their[-1 - count]:
        count += 1
    if count == 0 or len(own) == len(their) == count:
        return None
    found = "/".join(own[: len(own) - count]), "/".join(their[: len(their) - count])
    return None if any(name_words(space) & OTHER_SOURCES for space in found) else found


def within(topic: str, spaces: Iterable[str]) -> str | None:
    """The innermost of the namespaces that a topic is in; None where it is in none."""
    name = topic.strip("/")
    return max((s for s in spaces if not s or name.startswith(f"{s}/")), key=len, default=None)


def namespace(topic: str) -> str:
    """The first component of a topic's name, where there is more than one."""
    parts = topic.strip("/").split("/")
    return parts[0] if len(parts) > 1 else ""


def twins(topic: str, other: str) -> bool:
    """Whether two topics are called alike in different namespaces (or are the same)."""
    own, their = namespace(topic), namespace(other)
    return bool(own and their) and topic.strip("/")[len(own) :] == other.strip("/")[len(their) :]


def fleet(likely: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Namespaces of several vehicles, of the topics that suit each role; empty where there is one vehicle.

    In two of them topics of at least two roles are called alike, commands among them.
    """
    shared: dict[tuple[str, str], set[str]] = {}
    for role, topics in likely.items():
        for one, other in itertools.combinations(sorted(set(topics)), 2):
            spaces = apart(one, other)
            if spaces is not None:
                shared.setdefault((min(spaces), max(spaces)), set()).add(role)
    pairs = [pair for pair, roles in shared.items() if len(roles) > 1 and roles & {"commanded", "actuators"}]
    return tuple(sorted({space for pair in pairs for space in pair}))
