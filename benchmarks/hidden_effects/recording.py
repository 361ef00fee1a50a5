"""What the engine recorded, as a `flight.flight.Flight` and as an MCAP log of ROS 2 messages.

Topics, frames and rates are those of the logs in `data/multibody`: commands and reference at 200 Hz, IMU at 200 Hz,
odometry at 100 Hz with its twist in the child frame, header stamps from t = 0, log time a fraction of a millisecond
later.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from wrenchgap.flight.flight import (
    ActuatorSeries,
    Array,
    BatterySeries,
    Flight,
    ImuSeries,
    OdometrySeries,
    ReferenceSeries,
    WrenchSeries,
)

START_NS = 1_700_000_000_000_000_000
ACTUATORS = """std_msgs/Header header
float64[] position
float64[] velocity
float64[] normalized
"""


@dataclass(frozen=True)
class Tracks:
    """Columns as recorded. Times [ns since START_NS] (N,) int64; poses are [x y z, w x y z, v (3), omega (3)].

    `desired`, `commanded` (N, 6); `tilt` (N, 6), `speed` (N, 12); `imu` (M, 6) [omega, specific force];
    `odometry`, `reference` (., 13) with the twist in the child frame; `voltage` (K,) or empty.
    """

    command_ns: NDArray[np.int64]
    desired: Array
    commanded: Array
    tilt: Array
    speed: Array
    imu_ns: NDArray[np.int64]
    imu: Array
    odometry_ns: NDArray[np.int64]
    odometry: Array
    reference: Array
    voltage_ns: NDArray[np.int64]
    voltage: Array


def to_flight(tracks: Tracks, name: str, notes: tuple[str, ...] = ()) -> Flight:
    """The flight as a reader of the log would return it; its hash is that of the recorded numbers."""
    digest = hashlib.sha256()
    for column in vars(tracks).values():
        digest.update(np.ascontiguousarray(column).tobytes())
    command, imu, odometry = (_seconds(ns) for ns in (tracks.command_ns, tracks.imu_ns, tracks.odometry_ns))
    pose, reference = tracks.odometry, tracks.reference
    return Flight(
        name=name,
        path=Path(f"{name}.mcap"),
        content_hash=digest.hexdigest(),
        start_ns=START_NS,
        commanded=WrenchSeries("/command/wrench", command, wrench_B=tracks.commanded),
        desired=WrenchSeries("/desired/wrench", command, wrench_B=tracks.desired),
        actuators=ActuatorSeries("/command/actuators", command, tilt=tracks.tilt, rotor_speed=tracks.speed),
        imu=ImuSeries("/imu", imu, omega_B=tracks.imu[:, :3], specific_force_B=tracks.imu[:, 3:]),
        odometry=OdometrySeries(
            "/odometry",
            odometry,
            position_E=pose[:, :3],
            quat_EB=pose[:, 3:7],
            velocity_E=_rotated(pose[:, 3:7], pose[:, 7:10]),
            omega_B=pose[:, 10:],
        ),
        reference=ReferenceSeries(
            "/reference",
            command,
            position_E=reference[:, :3],
            quat_ED=reference[:, 3:7],
            velocity_E=_rotated(reference[:, 3:7], reference[:, 7:10]),
            omega_D=reference[:, 10:],
        ),
        battery=BatterySeries("/battery", _seconds(tracks.voltage_ns), voltage=tracks.voltage)
        if len(tracks.voltage)
        else None,
        notes=notes,
    )


def write_mcap(tracks: Tracks, path: Path) -> None:
    """Write the log: MCAP, ROS 2 messages in CDR with their definitions, zstd."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(ACTUATORS, "actuator_msgs/msg/Actuators"))
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="wrenchgap hidden-effects engine")
        channels: dict[str, int] = {}
        for sequence, (log_ns, topic, message) in enumerate(sorted(_messages(store.types, tracks), key=itemgetter(0))):
            kind = message.__msgtype__
            if topic not in channels:
                text, _ = store.generate_msgdef(kind, ros_version=2)
                schema = writer.register_schema(kind, "ros2msg", text.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(store.serialize_cdr(message, kind))
            writer.add_message(channels[topic], log_ns, data, log_ns, sequence)
        writer.finish()  # type: ignore[no-untyped-call]


def _seconds(ns: NDArray[np.int64]) -> Array:
    return np.asarray(ns * 1e-9, dtype=np.float64)


def _rotated(quat_wxyz: Array, vector: Array) -> Array:
    return np.asarray(Rotation.from_quat(quat_wxyz, scalar_first=True).apply(vector))


def _messages(types: dict[str, Any], tracks: Tracks) -> Iterator[tuple[int, str, Any]]:
    Vector3, Point = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Point"]
    Quaternion, Wrench = types["geometry_msgs/msg/Quaternion"], types["geometry_msgs/msg/Wrench"]
    WrenchStamped, Imu = types["geometry_msgs/msg/WrenchStamped"], types["sensor_msgs/msg/Imu"]
    Odometry, Actuators = types["nav_msgs/msg/Odometry"], types["actuator_msgs/msg/Actuators"]
    Pose, Twist = types["geometry_msgs/msg/Pose"], types["geometry_msgs/msg/Twist"]
    PoseCov, TwistCov = types["geometry_msgs/msg/PoseWithCovariance"], types["geometry_msgs/msg/TwistWithCovariance"]
    Battery = types["sensor_msgs/msg/BatteryState"]

    def header(ns: int, frame: str) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](*map(int, divmod(START_NS + ns, 1_000_000_000)))
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)

    def wrench(ns: int, row: list[float]) -> Any:
        return WrenchStamped(header(ns, "base_link"), Wrench(Vector3(*row[:3]), Vector3(*row[3:])))

    def pose(ns: int, row: list[float]) -> Any:
        at = Pose(Point(*row[:3]), Quaternion(row[4], row[5], row[6], row[3]))
        moving = Twist(Vector3(*row[7:10]), Vector3(*row[10:]))
        return Odometry(header(ns, "world"), "base_link", PoseCov(at, np.zeros(36)), TwistCov(moving, np.zeros(36)))

    zero9, unknown9, empty = np.zeros(9), np.array([-1.0] + [0.0] * 8), np.zeros(0)
    command_ns = tracks.command_ns.tolist()
    rows = zip(
        command_ns,
        tracks.desired.tolist(),
        tracks.commanded.tolist(),
        tracks.tilt,
        tracks.speed,
        tracks.reference.tolist(),
        strict=True,
    )
    for ns, desired, commanded, tilt, speed, reference in rows:
        log = START_NS + ns + 700_000
        yield log, "/reference", pose(ns, reference)
        yield log + 100_000, "/desired/wrench", wrench(ns, desired)
        yield log + 200_000, "/command/wrench", wrench(ns, commanded)
        yield log + 300_000, "/command/actuators", Actuators(header(ns, "base_link"), tilt, speed, empty)
    level = Quaternion(0.0, 0.0, 0.0, 1.0)
    for ns, row in zip(tracks.imu_ns.tolist(), tracks.imu.tolist(), strict=True):
        message = Imu(header(ns, "base_link"), level, unknown9, Vector3(*row[:3]), zero9, Vector3(*row[3:]), zero9)
        yield START_NS + ns + 400_000, "/imu", message
    for ns, row in zip(tracks.odometry_ns.tolist(), tracks.odometry.tolist(), strict=True):
        yield START_NS + ns + 500_000, "/odometry", pose(ns, row)
    nan, none = float("nan"), np.zeros(0, dtype=np.float32)
    for ns, volt in zip(tracks.voltage_ns.tolist(), tracks.voltage.tolist(), strict=True):
        state = (volt, nan, nan, nan, nan, nan, nan, 0, 0, 0, True, none, none, "", "")
        yield START_NS + ns + 600_000, "/battery", Battery(header(ns, "base_link"), *state)
