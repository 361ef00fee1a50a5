"""Commands without the packages of an extra: one line before any work, nothing written."""

import sys

import pytest

CASES = {
    "compare LOG HEXA --csv x.csv": ("pandas", "tables"),
    "replay LOG HEXA --gp some.gp --parquet x.parquet": ("pandas", "tables"),
    "inspect a.csv": ("pandas", "tables"),
    "inspect a.ulg": ("pyulog", "px4"),
    "view LOG HEXA": ("viser", "viewer"),
    "batch inspect LOG HEXA -o out": ("pyarrow", "batch"),
    "model new --from a.urdf -o m.toml": ("mujoco", "mujoco"),
}
MODULES = ("wrenchgap.viewer", "wrenchgap.replay.session", "wrenchgap.replay.batch")
"""Packages whose modules import those of an extra when they are loaded."""


@pytest.mark.parametrize("command", CASES)
def test_a_missing_extra_is_one_line(command, logs, refused, tmp_path, monkeypatch):
    package, extra = CASES[command]
    for name in [n for n in sys.modules if n == package or n.startswith((f"{package}.", *MODULES))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / "a.csv").write_text("time_s,gyro_x\n0,0\n0.01,0\n")
    (tmp_path / "a.ulg").write_bytes(b"ULog\x01\x12\x35\x01" + bytes(64))
    (tmp_path / "a.bin").write_bytes(b"\xa3\x95\x80" + bytes(200))
    (tmp_path / "a.urdf").write_text('<robot name="a"><link name="base"/></robot>')
    before = sorted(tmp_path.iterdir())
    places = {"LOG": str(logs.test), "HEXA": "-m tilt_hexarotor"}
    line = refused(*" ".join(places.get(word, word) for word in command.split()).split())
    assert f"pip install 'wrenchgap[{extra}]'" in line
    assert sorted(tmp_path.iterdir()) == before
