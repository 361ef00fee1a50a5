"""Small valid files, one a form: logs by the writers of the tests (libraries other than ours), model files, the rest.

The numbers are those of a closed-form motion; what they are does not matter here.
"""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 0.6

MAPPING = """
[command]
unit = "pwm"
range = [1000, 2000]
table = "bench.csv"
"""
BENCH = "command,thrust\n1000,0\n1250,0.7\n1500,2.1\n2000,6.4\n"


@cache
def _writers(path: str) -> ModuleType:
    """The module of a conftest of the tests."""
    found = importlib.util.spec_from_file_location(f"writers_{path.replace('/', '_')}", ROOT / "tests" / path)
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


def _recorded(form: str) -> Callable[[Path], Path]:
    def made(folder: Path) -> Path:
        writers = _writers("flight/conftest.py")
        suffix = {"bag": ".bag", "folder": ""}.get(form.partition("-")[0], ".mcap")
        path: Path = writers.plain_flight(SECONDS).save(folder / f"log{suffix}", form)
        return path

    return made


def _sqlite(folder: Path) -> Path:
    """The file of a bag folder by itself."""
    (found,) = _recorded("folder-sqlite3")(folder).glob("*.db3")
    return found.rename(folder / "log.db3")


def _json_mcap(folder: Path) -> Path:
    """Foxglove's schemas in JSON."""
    from mcap.writer import Writer

    writers = _writers("flight/conftest.py")
    time = np.arange(0.0, SECONDS, 0.01)
    motion = writers.Motion(time)
    path = folder / "log.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=16384)
        writer.start()
        schema = writer.register_schema("lab.Imu", "jsonschema", json.dumps(_json_schema()).encode())
        channel = writer.register_channel("/imu", "json", schema)
        for i, at in enumerate(time):
            stamp = writers.START_NS + round(at * 1e9)
            message = {"timestamp": dict(zip(("sec", "nsec"), divmod(stamp, 10**9), strict=True))}
            message |= {"angular_velocity": dict(zip("xyz", motion.omega_B[i].tolist(), strict=True))}
            message |= {"linear_acceleration": dict(zip("xyz", motion.specific_force_B[i].tolist(), strict=True))}
            writer.add_message(channel, stamp, json.dumps(message).encode(), stamp)
        writer.finish()
    return path


def _json_schema() -> dict[str, Any]:
    def table(*names: str) -> dict[str, Any]:
        return {"type": "object", "properties": {name: {"type": "number"} for name in names}}

    inner = {"timestamp": table("sec", "nsec"), "angular_velocity": table(*"xyz")}
    return {"type": "object", "properties": inner | {"linear_acceleration": table(*"xyz")}}


def _protobuf_mcap(folder: Path) -> Path:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap.writer import Writer

    writers = _writers("flight/conftest.py")
    file = descriptor_pb2.FileDescriptorProto(name="lab.proto", package="lab")
    vector = file.message_type.add(name="Vector")
    for number, axis in enumerate("xyz", 1):
        vector.field.add(name=axis, number=number, type=1, label=1)
    imu = file.message_type.add(name="Imu")
    for number, name in enumerate(("angular_velocity", "linear_acceleration"), 1):
        imu.field.add(name=name, number=number, type=11, label=1, type_name=".lab.Vector")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName("lab.Imu"))
    time = np.arange(0.0, SECONDS, 0.01)
    motion = writers.Motion(time)
    path = folder / "log.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=16384)
        writer.start()
        text = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()
        channel = writer.register_channel("/imu", "protobuf", writer.register_schema("lab.Imu", "protobuf", text))
        for i, at in enumerate(time):
            message = kind()
            for name, values in (
                ("angular_velocity", motion.omega_B),
                ("linear_acceleration", motion.specific_force_B),
            ):
                for axis, value in zip("xyz", values[i], strict=True):
                    setattr(getattr(message, name), axis, value)
            stamp = writers.START_NS + round(at * 1e9)
            writer.add_message(channel, stamp, message.SerializeToString(), stamp)
        writer.finish()
    return path


def _ulog(folder: Path) -> Path:
    autopilots = _writers("flight/formats/conftest.py")
    time = np.arange(0.0, SECONDS, 0.01)
    climb = autopilots.Climb(time)
    stamps = np.round(time * 1e6).astype(int)
    parameters = {f"CA_ROTOR{i}_{key}": 0.1 for i in range(4) for key in ("PX", "PY", "KM")} | {"CA_ROTOR_COUNT": 4}
    log = autopilots.Ulog(parameters)
    both = {"timestamp": stamps, "gyro_rad": climb.gyro, "accelerometer_m_s2": climb.accelerometer}
    log.topic("sensor_combined", "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2", both)
    log.topic("vehicle_attitude", "uint64_t timestamp;float[4] q", {"timestamp": stamps, "q": climb.q})
    place = {"timestamp": stamps, **dict(zip(("x", "y", "z"), climb.ned.T, strict=True))}
    place |= dict(zip(("vx", "vy", "vz"), climb.v_ned.T, strict=True))
    fields = "uint64_t timestamp;" + ";".join(f"float {name}" for name in ("x", "y", "z", "vx", "vy", "vz"))
    log.topic("vehicle_local_position", fields, place)
    path: Path = log.dropout(5).save(folder / "log.ulg")
    return path


def _usd(folder: Path) -> Path:
    path = folder / "log00"
    path.write_bytes(_writers("flight/formats/test_crazyflie_usd.py").log(_writers("flight/conftest.py")))
    return path


def _dataflash(folder: Path) -> Path:
    autopilots = _writers("flight/formats/conftest.py")
    time = np.arange(0.0, SECONDS, 0.01)
    climb = autopilots.Climb(time)
    stamps = np.round(time * 1e6).astype(int)
    log = autopilots.Dataflash({"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0})
    names = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
    values = (stamps, 0 * stamps, *climb.gyro.T, *climb.accelerometer.T)
    log.add("IMU", "QBffffff", names, *values, instance="I")
    log.add("ATT", "Qccc", "TimeUS,Roll,Pitch,Yaw", stamps, 0 * time, np.degrees(climb.pitch), 0 * time)
    log.add("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4", stamps, *(1500 + i + 0 * stamps for i in range(4)))
    path: Path = log.save(folder / "log.bin")
    return path


def _table(suffix: str) -> Callable[[Path], Path]:
    def made(folder: Path) -> Path:
        import pandas as pd

        time = np.arange(0.0, SECONDS, 0.01)
        motion = _writers("flight/conftest.py").Motion(time)
        columns = {"time_s": time}
        for i, axis in enumerate("xyz"):
            columns[f"gyro_{axis}"] = motion.omega_B[:, i]
            columns[f"acc_{axis}"] = motion.specific_force_B[:, i]
            columns[f"pos_{axis}"] = motion.position_E[:, i]
        columns |= {f"q{axis}": motion.quat_EB[:, i] for i, axis in enumerate("wxyz")}
        columns |= {f"motor_{i + 1}": 500.0 + i + np.sin(time) for i in range(4)}
        frame, path = pd.DataFrame(columns), folder / f"log.{suffix}"
        frame.to_csv(path, index=False) if suffix == "csv" else frame.to_parquet(path)
        return path

    return made


def _model(folder: Path) -> Path:
    path = folder / "model.toml"
    path.write_text((ROOT / "models/crazyflie.toml").read_text(encoding="utf-8"), encoding="utf-8")
    return path


def _mapping(folder: Path) -> Path:
    """A model with a mapping of topics, a command curve and a bench table beside it."""
    path = _model(folder)
    text = (ROOT / "models/asymmetric_quadrotor.toml").read_text(encoding="utf-8")
    path.write_text(text + MAPPING, encoding="utf-8")
    (folder / "bench.csv").write_text(BENCH, encoding="utf-8")
    return path


def _trajectory(folder: Path) -> Path:
    from wrenchgap.plant.trajectory.file import dumps

    path = folder / "trajectory.toml"
    path.write_text(dumps(_writers("plant/test_trajectory_file.py").FILE), encoding="utf-8")
    return path


def _process(folder: Path) -> Path:
    """A stored GP whose parts are drawn."""
    from wrenchgap.learn.process import store
    from wrenchgap.learn.process.gp import GaussianProcess

    rng, three = np.random.default_rng(3), ("torque_x", "torque_y", "torque_z")
    parts = {"input_mean": (6,), "mean_coefficients": (3, 7), "inputs": (12, 6), "residuals": (12, 3)}
    drawn = {name: rng.normal(size=shape) for name, shape in parts.items()}
    sizes = {"input_scale": (6,), "output_scale": (3,), "lengthscales": (3, 6), "signal_variance": (3,)}
    sizes |= {"noise_variance": (3,), "sigma_training": (3,), "mismatch_max": (3,)}
    drawn |= {name: rng.uniform(0.5, 2.0, size=shape) for name, shape in sizes.items()}
    path = folder / "process.gp"
    store.save(GaussianProcess(three, **drawn), path, force=True)
    return path


def _parameters(folder: Path) -> Path:
    """ArduPilot's parameters."""
    path = folder / "copter.param"
    path.write_text("FRAME_CLASS,1\nFRAME_TYPE,1\nMOT_SPIN_MIN,0.15\nMOT_PWM_MIN,1000\nMOT_PWM_MAX,2000\n")
    return path


def _described(suffix: str, maker: str) -> Callable[[Path], Path]:
    def made(folder: Path) -> Path:
        path = folder / f"vehicle.{suffix}"
        path.write_text(getattr(_writers("plant/test_robot_descriptions.py"), maker)(), encoding="utf-8")
        return path

    return made


LOGS: dict[str, Callable[[Path], Path]] = {
    **{f"mcap-{kind}": _recorded(f"mcap-{kind}") for kind in ("zstd", "lz4", "none", "unchunked")},
    "mcap-ros1": _recorded("mcap1-zstd"),
    "mcap-json": _json_mcap,
    "mcap-protobuf": _protobuf_mcap,
    **{f"bag-{kind or 'plain'}": _recorded(f"bag-{kind}") for kind in ("", "bz2", "lz4")},
    "db3": _sqlite,
    "folder-sqlite3": _recorded("folder-sqlite3"),
    "folder-mcap": _recorded("folder-mcap"),
    "folder-zstd": _recorded("folder-sqlite3-file"),
    "ulog": _ulog,
    "dataflash": _dataflash,
    "crazyflie-usd": _usd,
    "csv": _table("csv"),
    "parquet": _table("parquet"),
}
OTHERS: dict[str, Callable[[Path], Path]] = {
    "model": _model,
    "mapping": _mapping,
    "trajectory": _trajectory,
    "gp": _process,
    "parameters": _parameters,
    "sdf": _described("sdf", "sdf"),
    "urdf": _described("urdf", "urdf"),
    "mjcf": _described("xml", "mjcf"),
}
FORMS = LOGS | OTHERS
"""By name, what writes a valid file of the form into a folder."""
