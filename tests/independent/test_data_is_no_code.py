"""Logs, models, processes and whatever else is read are data: nothing in them is unpickled or executed."""

import contextlib
import io
import pickle
import zipfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer

from benchmarks.faults.opening import opened
from benchmarks.faults.valid import FORMS
from benchmarks.faults.written import Executed
from wrenchgap.flight import cache
from wrenchgap.flight.errors import ModelError, WrenchgapError
from wrenchgap.plant import model_file

SIDE_EFFECT = "from pathlib import Path; Path({!r}).write_text('executed')"


@pytest.fixture
def target(tmp_path):
    """A file that appears where a payload was run."""
    path = tmp_path / "executed"
    pickle.loads(pickle.dumps(Executed(str(path))))
    assert path.exists(), "the payload works"
    path.unlink()
    return path


def attempt(kind, path):
    with contextlib.suppress(WrenchgapError):
        opened(kind, path)


@pytest.mark.parametrize("form", [form for form in FORMS if not form.startswith("folder")])
def test_a_pickle_in_place_of_any_file_is_not_loaded(form, target, tmp_path):
    path = FORMS[form](tmp_path)
    whole, payload = path.read_bytes(), pickle.dumps(Executed(str(target)))
    for content in (payload, whole[:8] + payload, whole[:64] + payload, whole + payload):
        path.write_bytes(content)
        attempt(form, path)
    assert not target.exists()


def objects(target):
    """An array of Python objects as numpy saves it: a pickle."""
    stream = io.BytesIO()
    np.save(stream, np.array([Executed(str(target))], dtype=object), allow_pickle=True)
    return stream.getvalue()


def test_objects_in_the_arrays_of_a_process_are_refused(target, tmp_path):
    path = FORMS["gp"](tmp_path)
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    for name in parts:
        with zipfile.ZipFile(path, "w") as archive:
            for key, content in parts.items():
                archive.writestr(key, objects(target) if key == name else content)
        with pytest.raises(WrenchgapError, match=r"not a stored GP|cannot be read"):
            opened("gp", path)
    assert not target.exists()


def test_objects_in_a_kept_flight_are_not_loaded(target, tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "folder", lambda: tmp_path / "cache")
    log = FORMS["mcap-zstd"](tmp_path)
    first = cache.load(log)
    (kept,) = (tmp_path / "cache").glob("*.npz")
    with zipfile.ZipFile(kept) as archive:
        names = archive.namelist()
    with zipfile.ZipFile(kept, "w") as archive:
        for name in names:
            archive.writestr(name, objects(target))
    again = cache.load(log)
    np.testing.assert_array_equal(again.imu.omega_B, first.imu.omega_B)
    assert not target.exists()


def test_an_extension_type_of_a_parquet_column_is_not_unpickled(target, tmp_path):
    """As in CVE-2023-47248 of older pyarrow."""
    named = {"ARROW:extension:name": "arrow.py_extension_type"}
    named["ARROW:extension:metadata"] = pickle.dumps(Executed(str(target)))
    fields = [pa.field("time_s", pa.float64()), pa.field("gyro_x", pa.float64(), metadata=named)]
    columns = [pa.array(np.arange(0.0, 1.0, 0.01))] * 2
    pq.write_table(pa.table(columns, schema=pa.schema(fields)), tmp_path / "log.parquet")
    attempt("parquet", tmp_path / "log.parquet")
    assert not target.exists()


INJECTED = (
    "float64 x={code}",
    "float64 x\nstring NAME={code}",
    "float64 x\n) or [{code}] or (",
    "float64 __import__('pathlib').Path('{target}').touch()",
)


@pytest.mark.parametrize("text", INJECTED)
def test_a_message_definition_is_not_executed(text, target, tmp_path):
    """rosbags makes classes by executing text of its own; nothing of a log may reach that."""
    code = f"__import__('pathlib').Path('{target}').touch()"
    with (tmp_path / "log.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        definition = text.format(code=code, target=target).encode()
        for number, name in enumerate(("lab_msgs/msg/Thing", f"lab_msgs/msg/Thing: {code}")):
            schema = writer.register_schema(name, "ros2msg", definition)
            channel = writer.register_channel(f"/imu{number}", "cdr", schema)
            writer.add_message(channel, 10**9, b"\0\1\0\0" + bytes(8), 10**9)
        writer.finish()
    attempt("log", tmp_path / "log.mcap")
    assert not target.exists()


def test_an_effects_file_runs_only_where_the_user_names_it(target, tmp_path, monkeypatch):
    path = FORMS["model"](tmp_path)
    (tmp_path / "mine.py").write_text(SIDE_EFFECT.format(str(target)))
    monkeypatch.chdir(tmp_path)
    plain = path.read_text(encoding="utf-8")
    for effect in ('name = "mine"', 'name = "mine"\nsource = "mine.py"', f'name = "mine"\nfile = "{tmp_path}/mine.py"'):
        path.write_text(f"{plain}\n[[effects]]\n{effect}\n", encoding="utf-8")
        with pytest.raises(ModelError):
            model_file.load(path)
    assert not target.exists()
