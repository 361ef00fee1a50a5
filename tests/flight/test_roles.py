"""Roles from names and types; overrides with columns."""

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.formats import Table
from wrenchgap.flight.mapping_units import parse_source
from wrenchgap.flight.roles import propose

WRENCH = "geometry_msgs/msg/WrenchStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"
TWIST = "geometry_msgs/msg/TwistStamped"
ARRAY = "std_msgs/msg/Float64MultiArray"
ACTUATORS, MOTORS = "actuator_msgs/msg/Actuators", "mav_msgs/msg/MotorSpeed"
IMU, BATTERY = "sensor_msgs/msg/Imu", "sensor_msgs/msg/BatteryState"
PATH = "trajectory_msgs/msg/MultiDOFJointTrajectory"

FIELDS = {
    WRENCH: ("wrench.force.x",),
    "geometry_msgs/msg/Wrench": ("force.x",),
    ODOMETRY: ("pose.pose.position.x", "twist.twist.linear.x"),
    POSE: ("pose.position.x",),
    TWIST: ("twist.linear.x",),
    IMU: ("angular_velocity.x",),
    BATTERY: ("voltage",),
    PATH: (
        "points.0.transforms.0.translation.x",
        "points.0.velocities.0.linear.x",
        "points.0.accelerations.0.linear.x",
    ),
}


def tables(**kinds):
    """Tables of ten messages by topic; keyword a__b is topic /a/b."""
    wide = {ARRAY: {"data": 6}, ACTUATORS: {"position": 6, "velocity": 12}, MOTORS: {"motor_speed": 4}}
    found = {}
    for word, kind in kinds.items():
        topic = "/" + word.replace("__", "/")
        columns = {name: np.zeros(10) for name in FIELDS.get(kind, ())}
        columns |= {name: np.zeros((10, width)) for name, width in wide.get(kind, {}).items()}
        found[topic] = Table(topic, kind, np.arange(10), columns=columns)
    return found


def played(assignment):
    return {part: source.topic for part, source in assignment.sources.items()}


def test_the_topics_that_wrenchgap_writes():
    found = tables(
        command__wrench=WRENCH,
        desired__wrench=WRENCH,
        command__actuators=ACTUATORS,
        imu=IMU,
        odometry=ODOMETRY,
        reference=ODOMETRY,
        battery=BATTERY,
    )
    own = {"commanded": "/command/wrench", "desired": "/desired/wrench", "imu": "/imu", "battery": "/battery"}
    own |= dict.fromkeys(("tilt", "rotor_speed"), "/command/actuators")
    own |= dict.fromkeys(("pose", "twist"), "/odometry")
    own |= dict.fromkeys(("reference_pose", "reference_twist"), "/reference")
    assert played(propose(found)) == own


def test_a_payload_is_not_the_vehicle():
    found = played(
        propose(tables(payload__state_estimate=ODOMETRY, cf__state_estimate=ODOMETRY, cf__setpoint=ODOMETRY))
    )
    assert (found["pose"], found["reference_pose"]) == ("/cf/state_estimate", "/cf/setpoint")
    assert "pose" not in propose(tables(payload__state_estimate=ODOMETRY)).sources


@pytest.mark.parametrize("name", ["quad__collisions", "ft_sensor__wrench", "external_wrench", "predicted__wrench"])
def test_measured_wrenches_are_not_commands(name):
    assert propose(tables(**{name: WRENCH})).sources == {}


def test_one_wrench_is_the_command_whatever_its_name():
    assert played(propose(tables(wrench=WRENCH))) == {"commanded": "/wrench"}
    assignment = propose(tables(model__desired_wrench="geometry_msgs/msg/Wrench"))
    assert played(assignment) == {"commanded": "/model/desired_wrench", "desired": "/model/desired_wrench"}
    assert "used for both" in assignment.notes[0]


def test_odometry_actuators_and_reference_of_several_topics():
    parts = {
        "pose": ("truth__pose", POSE),
        "twist": ("truth__twist", TWIST),
        "reference_pose": ("tilt_hexa__desired_pose", POSE),
        "reference_twist": ("tilt_hexa__desired_velocity", TWIST),
        "tilt": ("tilt_hexa__plot__tilt_angle", ARRAY),
        "rotor_speed": ("tilt_hexa__plot__motor_speed", ARRAY),
    }
    expected = {part: "/" + word.replace("__", "/") for part, (word, _) in parts.items()}
    assert played(propose(tables(**dict(parts.values())))) == expected


def test_custom_type_with_rotor_speeds_and_a_trajectory():
    parts = ("reference_pose", "reference_twist", "reference_acceleration")
    found = played(propose(tables(motors=MOTORS, path=PATH)))
    assert found == {"rotor_speed": "/motors", **dict.fromkeys(parts, "/path")}


def test_candidates_are_listed_and_two_vehicles_not_mixed():
    assignment = propose(tables(imu__raw=IMU, imu__data=IMU))
    assert played(assignment)["imu"] == "/imu/data"
    assert assignment.candidates["imu"] == ("/imu/raw",)
    two = {"drone2__command__wrench": WRENCH, "drone2__odometry": ODOMETRY, "drone1__odometry": ODOMETRY}
    assert played(propose(tables(**two, drone1__imu=IMU)))["pose"] == "/drone2/odometry"


def test_overrides_by_role_and_part():
    found = tables(a=WRENCH, b=WRENCH, d=ARRAY)
    assignment = propose(found, {"commanded": "/b", "rotor_speed": "/d[3,2,1,0]", "desired": "none"})
    assert played(assignment) == {"commanded": "/b", "rotor_speed": "/d"}
    assert assignment.sources["rotor_speed"].columns == (3, 2, 1, 0)
    again = propose(found, assignment.as_topics())
    assert again.sources == assignment.sources


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("/a/b", ("/a/b", None, None)),
        ("/a[0:3]", ("/a", None, (0, 1, 2))),
        ("/a.velocity[6:8,1]", ("/a", "velocity", (6, 7, 1))),
        ("/a.points.0.x", ("/a", "points.0.x", None)),
    ],
)
def test_syntax(value, expected):
    said = parse_source(value)
    assert (said.topic, said.field, said.columns) == expected


@pytest.mark.parametrize("value", ["/a[", "/a[x]", "/a[1:2:3]", "", "/a[2:2]"])
def test_bad_syntax(value):
    with pytest.raises(UsageError):
        parse_source(value)


@pytest.mark.parametrize(
    ("topics", "error", "words"),
    [
        ({"gyro": "/a"}, UsageError, "no role is called 'gyro'; roles: commanded"),
        ({"imu": "/nope"}, LogError, "no topic '/nope'; topics: /a, /d"),
        ({"imu": "/a"}, LogError, "cannot play 'imu'"),
        ({"rotor_speed": "/d[0:9]"}, LogError, "asks for column 8, but /d field 'data' has 6 columns"),
        ({"rotor_speed": "/d.speeds"}, LogError, "no field 'speeds'; fields: data"),
    ],
)
def test_wrong_overrides(topics, error, words):
    with pytest.raises(error) as caught:
        propose(tables(a=WRENCH, d=ARRAY), topics)
    assert words in str(caught.value)


def test_a_role_from_the_columns_of_an_array(logs, tmp_path):
    time = np.arange(0, 3, 0.01)
    data = np.stack([np.sin((i + 1) * time) for i in range(8)], axis=1)
    recording = logs.Recording().series("/debug", "std_msgs/msg/Float64MultiArray", time, {"data": data})
    path = recording.save(tmp_path / "log.mcap")
    found = flight.load(path, topics={"imu": "/debug[0:6]", "battery": "/debug[7]"})
    np.testing.assert_array_equal(found.imu.specific_force_B, data[:, 3:6])
    np.testing.assert_array_equal(found.battery.voltage, data[:, 7])
    with pytest.raises(LogError, match="gives 5 columns, but a imu has 6"):
        flight.load(path, topics={"imu": "/debug[0:5]"})


def test_a_topic_of_the_model_file_that_a_log_lacks_is_not_replaced_in_silence(logs, tmp_path):
    path = logs.plain_flight(1.0).save(tmp_path / "log.mcap")
    saved = {"battery": "/not/in/this/log", "imu": "/cf/imu", "commanded": "/command/wrench"}
    (note,) = (text for text in flight.load(path, preferred=saved).notes if "model file" in text)
    assert note == "This log lacks topics that the model file names; read are imu from /imu, not /cf/imu."
    assert not [n for n in flight.load(path, topics={"imu": "/imu"}, preferred=saved).notes if "model file" in n]


def test_a_saved_mapping_is_followed_as_far_as_the_log_can(logs, tmp_path):
    path = logs.plain_flight(1.0).save(tmp_path / "log.mcap")
    saved = {"battery": "/not/in/this/log", "odometry": "none", "imu": "/imu"}
    found = flight.load(path, preferred=saved)
    assert found.odometry is None
    assert found.imu is not None
    assert flight.load(path, topics={"imu": "none"}, preferred=saved).imu is None
    assert flight.inspect(path, preferred=saved).mapping == {"commanded": "/command/wrench", "imu": "/imu"}
    with pytest.raises(LogError, match="no topic '/not/in/this/log'"):
        flight.load(path, topics={"battery": "/not/in/this/log"})


def test_a_wrench_of_a_contact_or_a_sensor_is_never_offered_as_a_command():
    """A world of a simulator logs contact wrenches beside the actuators."""
    names = ("quad__collisions", "arm__contact", "ft_sensor__wrench")
    assignment = propose(tables(**dict.fromkeys(names, WRENCH), motors=MOTORS))
    assert played(assignment) == {"rotor_speed": "/motors"}
    assert not {"commanded", "desired"} & set(assignment.candidates)
    assert propose(tables(plain__wrench=WRENCH)).sources["commanded"].topic == "/plain/wrench"
