"""`wrenchgap convert` writes any log as MCAP, reading it back gives the same flight, and nothing is overwritten."""

from dataclasses import fields

import numpy as np
import pandas as pd
import pytest

from wrenchgap import flight
from wrenchgap.flight.write import provenance


@pytest.fixture
def table(tmp_path):
    """A CSV table with odometry, IMU, a reference and normalised motors, as a file."""
    time = np.arange(0, 4.0, 0.01)
    columns = {"time [ms]": 1e3 * time}
    for i, axis in enumerate("xyz"):
        columns[f"gyro_{axis}"] = 0.1 * np.sin(time + i)
        columns[f"acc_{axis}"] = 9.81 * (i == 2) + 0.2 * np.cos(time * (i + 1))
        columns[f"pos_{axis}"] = columns[f"ref_pos_{axis}"] = np.sin(0.7 * time + i)
        columns[f"v{axis}"] = 0.7 * np.cos(0.7 * time + i)
    for prefix in ("", "ref_"):
        columns |= {f"{prefix}roll": 0.1 * np.sin(time), f"{prefix}pitch": 0.0 * time, f"{prefix}yaw": 1.0 + 0.0 * time}
    columns |= {f"throttle_{i}": 0.4 + 0.01 * i + 0.1 * np.sin(time) for i in range(4)}
    path = tmp_path / "flight.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def same(one, other):
    assert one.series().keys() == other.series().keys()
    assert one.start_ns == other.start_ns
    for role, series in one.series().items():
        for item in fields(series):
            if item.name in ("topic", "dropped"):
                continue
            mine, theirs = getattr(series, item.name), getattr(other.series()[role], item.name)
            if isinstance(mine, np.ndarray):
                np.testing.assert_allclose(theirs, mine, atol=1e-12, err_msg=f"{role}.{item.name}")
            else:
                assert mine == theirs, f"{role}.{item.name}"


def test_reading_it_back_gives_the_same_flight(table, result_of, tmp_path):
    result = result_of("convert", table, "-o", "out.mcap")
    assert result["schema"] == "wrenchgap.convert/1"
    (body,) = result["logs"]
    assert body["roles"]["imu"] == {"topic": "/imu", "samples": 400}
    given, back = flight.load(table), flight.load(tmp_path / "out.mcap")
    same(given, back)
    assert back.actuators.unit == "normalised"
    assert provenance(tmp_path / "out.mcap")["source_sha256"] == given.content_hash


def test_several_logs_go_into_a_folder_and_options_are_followed(table, run, tmp_path):
    other = table.with_name("second.csv")
    other.write_bytes(table.read_bytes())
    (tmp_path / "out").mkdir()
    done = run("convert", table, other, "-o", "out", "--topic", "reference=none", "--shift", "odometry=-0.01")
    assert done.exit_code == 0, done.output
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["flight.mcap", "second.mcap"]
    back = flight.load(tmp_path / "out" / "second.mcap")
    assert back.reference is None
    np.testing.assert_allclose(back.imu.time[0] - back.odometry.time[0], 0.01, atol=1e-9)


def test_nothing_is_overwritten_or_left_half_written(table, run, refused, tmp_path):
    assert run("convert", table, "-o", "out.mcap").exit_code == 0
    before = (tmp_path / "out.mcap").read_bytes()
    assert "--force" in refused("convert", table, "-o", "out.mcap")
    assert run("convert", table, "-o", "out.mcap", "--force").exit_code == 0
    assert (tmp_path / "out.mcap").read_bytes()[:8] == before[:8]
    assert "inputs" in refused("convert", tmp_path / "out.mcap", "-o", "out.mcap", "--force")
    assert ".mcap" in refused("convert", table, "-o", "out.bag")
    assert "folder" in refused("convert", table, tmp_path / "out.mcap", "-o", "both.mcap")
    assert "no such file" in refused("convert", "missing.ulg", "-o", "x.mcap")
    assert {p.name for p in tmp_path.iterdir()} == {"flight.csv", "out.mcap"}
