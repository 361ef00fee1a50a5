"""Hours of log: how much memory opening one takes.

    python -m benchmarks.faults.long_log --hours 10 --folder /tmp                 # makes it, opens it, deletes it
    python -m benchmarks.faults.long_log --hours 10 --picture 5500 --folder /tmp --page        # and docs/performance.md

A hover that sways, at 100 Hz (odometry at 50 Hz), as MCAP without compression: 3 GB in ten hours; `--hours`
and `--picture` (bytes of a picture that comes 5 times a second and that nobody reads) make it longer and larger. Each
command runs in a process of its own, whose largest resident memory is reported.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from benchmarks import pages
from wrenchgap.flight.flight import GRAVITY

MAGIC = b"\x89MCAP0\r\n"
START = 1_700_000_000_000_000_000
KINDS = {
    "/command/wrench": ("geometry_msgs/msg/WrenchStamped", 100),
    "/imu": ("sensor_msgs/msg/Imu", 100),
    "/odometry": ("nav_msgs/msg/Odometry", 50),
    "/camera": ("sensor_msgs/msg/Image", 5),
}
HEADER = 4 + 8 + 4 + 10
"""Bytes of a CDR message's beginning: its own header, the stamp, the length and text of "base_link"."""
MASS, INERTIA = 0.033, 16.6e-6  # those of the model crazyflie
SWAY, SWAY_RATE = 0.1, 2.0
"""Tangent of the largest roll, and how fast it comes and goes [rad/s]."""


def _text(text: str) -> bytes:
    return len(text.encode()).to_bytes(4, "little") + text.encode()


def _record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def _numbers(topic: str, time: NDArray[Any]) -> NDArray[Any]:
    """What a message carries behind its header, float64, (N, K): a vehicle that sways to the sides.

    With tan(roll) = A sin(w t) and thrust along body z that carries the weight, y = (g A / w^2) sin(w t).
    """
    n, zero = len(time), np.zeros_like(time)
    rng = np.random.default_rng([len(topic), int(time[0])])
    s, c = np.sin(SWAY_RATE * time), np.cos(SWAY_RATE * time)
    roll, rate = np.arctan(SWAY * s), SWAY * SWAY_RATE * c / (1.0 + (SWAY * s) ** 2)
    force, reach = GRAVITY / np.cos(roll), GRAVITY * SWAY / SWAY_RATE**2
    quat = np.column_stack((np.sin(roll / 2), zero, zero, np.cos(roll / 2)))
    noise = 1e-3 * rng.standard_normal((n, 6))
    if topic == "/imu":
        gyro = np.column_stack((rate, zero, zero)) + noise[:, :3]
        felt = np.column_stack((zero, zero, force)) + 10.0 * noise[:, 3:]
        return np.column_stack((quat, np.zeros((n, 9)), gyro, np.zeros((n, 9)), felt, np.zeros((n, 9))))
    if topic == "/odometry":
        speed = reach * SWAY_RATE * c
        place = np.column_stack((zero, reach * s, zero + 1.0)) + 0.1 * noise[:, :3]
        linear = np.column_stack((zero, speed * np.cos(roll), -speed * np.sin(roll)))
        twist = np.column_stack((linear, rate, zero, zero)) + noise
        return np.column_stack((place, quat, np.zeros((n, 36)), twist, np.zeros((n, 36))))
    torque = INERTIA * -SWAY * SWAY_RATE**2 * s
    return np.column_stack((zero, zero, MASS * force, torque, zero, zero)) + noise * [0, 0, 1, 1e-3, 1e-3, 1e-3]


def _rows(topic: str, channel: int, time: NDArray[Any], picture: int) -> NDArray[np.uint8]:
    """Message records of one topic, all of one length (N, length)."""
    kind = KINDS[topic][0]
    stamps = START + np.round(time * 1e9).astype(np.int64)
    head = b"\x00\x01\x00\x00" + bytes(8) + _text("base_link\0")
    if kind.endswith("Image"):
        load = (
            head
            + bytes(2)
            + struct.pack("<II", 480, 640)
            + _text("mono8\0")
            + bytes(3)
            + struct.pack("<II", 640, picture)
        )
        numbers = np.zeros((len(time), 0))
        load += bytes(picture)
    else:
        if kind.endswith("Odometry"):
            head += bytes(2) + _text("base_link\0")
        head += bytes(-(len(head) - 4) % 8)
        numbers = _numbers(topic, time)
        load = head + bytes(8 * numbers.shape[1])
    template = _record(5, struct.pack("<HIQQ", channel, 0, 0, 0) + load)
    rows = np.tile(np.frombuffer(template, dtype=np.uint8), (len(time), 1))
    body = 9 + 22
    rows[:, 15:23] = rows[:, 23:31] = stamps[:, None].view(np.uint8)
    seconds, rest = np.divmod(stamps, 10**9)
    rows[:, body + 4 : body + 8] = seconds.astype("<i4")[:, None].view(np.uint8)
    rows[:, body + 8 : body + 12] = rest.astype("<u4")[:, None].view(np.uint8)
    if numbers.shape[1]:
        rows[:, len(template) - 8 * numbers.shape[1] :] = np.ascontiguousarray(numbers, dtype="<f8").view(np.uint8)
    return rows


def write(path: Path, hours: float, picture: int) -> int:
    """Write a log second by second, each a chunk; returns its size."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("wb") as file:
        head = b""
        for number, (topic, (kind, _)) in enumerate(KINDS.items(), 1):
            definition = store.generate_msgdef(kind, ros_version=2)[0]
            head += _record(3, struct.pack("<H", number) + _text(kind) + _text("ros2msg") + _text(definition))
            head += _record(4, struct.pack("<HH", number, number) + _text(topic) + _text("cdr") + bytes(4))
        file.write(MAGIC + _record(1, _text("ros2") + _text("long_log")) + head)
        for second in range(round(3600 * hours)):
            parts = []
            for number, (topic, (_, rate)) in enumerate(KINDS.items(), 1):
                if picture or topic != "/camera":
                    parts.append(_rows(topic, number, second + np.arange(rate) / rate, picture).tobytes())
            inner = b"".join(parts)
            chunk = struct.pack("<QQQIIIQ", 0, 0, len(inner), 0, 0, 0, 0)[:32] + struct.pack("<Q", len(inner))
            file.write(_record(6, chunk + inner))
        file.write(_record(15, bytes(4)) + MAGIC)
    return path.stat().st_size


def peak(words: list[str]) -> dict[str, Any]:
    """Largest memory [MB] and processor time [s] of a command, and its last line."""
    code = "import resource, subprocess, sys; run = subprocess.run(sys.argv[1:], capture_output=True, text=True); "
    code += "use = resource.getrusage(resource.RUSAGE_CHILDREN); "
    code += "print(use.ru_maxrss, use.ru_utime + use.ru_stime, run.returncode, (run.stdout + run.stderr)[-400:])"
    run = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
    memory, processor, code, *said = run.stdout.split(maxsplit=3)
    return {
        "peak_MB": int(memory) // 1024,
        "processor_s": float(processor),
        "exit_code": int(code),
        "said": " ".join(said),
    }


def table(size: int, hours: float, rows: list[dict[str, Any]], load: str) -> str:
    """The table of docs/performance.md."""
    log = f"{hours:g} hours, {size / 1e9:.2f} GB"
    lines = [(f"`{row['command']} -m`", log, f"{row['peak_MB']:,} MiB", f"{row['processor_s']:.0f} s") for row in rows]
    return pages.markdown(("command", "log", "largest resident memory", "processor time"), lines, load, left=2)


def main() -> None:
    """Make, measure, delete."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--picture", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path(), help="where the log is made")
    parser.add_argument("--command", action="append", help="of wrenchgap, by default inspect and compare")
    parser.add_argument("--log", type=Path, help="of this benchmark, made before: it is neither made nor deleted")
    parser.add_argument("--page", action="store_true", help="write the table of docs/performance.md")
    asked = parser.parse_args()
    path = asked.log or asked.folder / "wrenchgap-long.mcap"
    try:
        start = time.monotonic()
        size = path.stat().st_size if asked.log else write(path, asked.hours, asked.picture)
        took, own = time.monotonic() - start, resource.getrusage(0).ru_maxrss // 1024
        print(f"{size / 1e9:.2f} GB in {took:.0f} s, by {own} MB", flush=True)
        rows, before = [], os.getloadavg()[0]
        for command in asked.command or ("inspect", "compare"):
            words = [sys.executable, "-m", "wrenchgap", command, str(path), "-m", "crazyflie"]
            words += ["--topic=commanded=/command/wrench", "--topic=imu=/imu", "--topic=odometry=/odometry"]
            rows.append({"command": command, **peak(words)})
            print(json.dumps(rows[-1]), flush=True)
            if asked.page:
                load = f"Load while measured: {before:.1f} to {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
                pages.renew(pages.PERFORMANCE, {"hours": table(size, asked.hours, rows, load)})
    finally:
        if not asked.log:
            path.unlink(missing_ok=True)


if __name__ == "__main__":
    main()
