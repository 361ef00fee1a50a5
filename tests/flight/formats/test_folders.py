"""A split recording is one flight, a folder of flights several; times decide."""

import struct

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats.folders import flights_in
from wrenchgap.replay.cli.options import logs_in


def parts(logs, folder, starts, names, form="mcap-zstd"):
    """Files of 2 s each that begin at `starts` [s]."""
    folder.mkdir(exist_ok=True)
    for start, name in zip(starts, names, strict=True):
        logs.Recording().plain("/imu", start + np.arange(0, 2.0, 0.01)).save(folder / name, form)
    return folder


@pytest.mark.parametrize(
    "names", [("run_0.mcap", "run_1.mcap", "run_2.mcap"), ("rec-10h00.mcap", "rec-10h05.mcap", "z.mcap")]
)
def test_files_that_follow_one_another_are_one_flight_whatever_their_names(logs, tmp_path, names):
    folder = parts(logs, tmp_path / "split", (0.0, 2.0, 4.0), names)
    found = flight.load(folder)
    assert flights_in(folder) == [folder]
    assert len(found.imu.time) == 600
    np.testing.assert_allclose(np.diff(found.imu.time), 0.01, atol=1e-8)


def test_files_that_do_not_are_several_flights_even_if_numbered(logs, tmp_path):
    folder = parts(logs, tmp_path / "flights", (0.0, 100.0), ("flight_1.mcap", "flight_2.mcap"))
    with pytest.raises(LogError, match=r"do not follow one another.*name one of its files: flight_1\.mcap") as caught:
        flight.load(folder)
    assert "\n" not in str(caught.value)
    assert [path.name for path in logs_in([folder])] == ["flight_1.mcap", "flight_2.mcap"]


def test_formats_may_be_mixed_and_a_bag_folder_is_one(logs, tmp_path):
    folder = parts(logs, tmp_path / "flights", (0.0,), ("b.mcap",))
    (folder / "a.csv").write_text("time,gyro_x\n0,1\n")
    (folder / "notes.md").write_text("no log")
    logs.plain_flight(1.0).save(folder / "c", "folder-sqlite3")
    assert [path.name for path in flights_in(folder)] == ["a.csv", "b.mcap", "c"]
    assert flights_in(folder / "c") == [folder / "c"]
    assert logs_in([folder / "a.csv"]) == [folder / "a.csv"]


def test_a_split_recording_among_others_is_refused(logs, tmp_path):
    folder = parts(logs, tmp_path / "both", (0.0, 2.0, 90.0), ("a_0.mcap", "a_1.mcap", "b.mcap"))
    with pytest.raises(LogError, match=r"a_0\.mcap, a_1\.mcap are one recording"):
        flights_in(folder)


def test_damaged_files_are_told_apart_by_their_names(logs, tmp_path):
    folder = parts(logs, tmp_path / "split", (0.0, 2.0), ("run_0.mcap", "run_1.mcap"))
    last = folder / "run_1.mcap"
    last.write_bytes(last.read_bytes()[: last.stat().st_size // 2])
    found = flight.load(folder)
    assert len(found.imu.time) > 200
    assert any("cut short" in said for said in found.damage)


def test_an_empty_folder(tmp_path):
    with pytest.raises(LogError, match=r"holds no \.db3 or \.mcap file"):
        flight.load(tmp_path)


def test_a_summary_that_lies_tells_no_times(logs, tmp_path):
    """Counts by channel that go on behind the end of the file were an internal error; the messages are all there."""
    folder = parts(logs, tmp_path / "split", (0.0, 2.0), ("a_0.mcap", "a_1.mcap"))
    path = folder / "a_1.mcap"
    data = bytearray(path.read_bytes())
    (at,) = struct.unpack_from("<Q", data, len(data) - 28)  # the footer: where the summary begins
    while data[at] != 0x0B:  # Statistics
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    struct.pack_into("<I", data, at + 9 + 42, 2**32 - 1)  # behind six counts and two times: bytes of those by channel
    path.write_bytes(data)
    assert len(flight.load(folder).imu.time) == 400


def test_a_name_with_a_digit_that_is_no_number_has_its_place(logs, tmp_path):
    for name in ("1\u00b23", "b"):
        logs.plain_flight(1.0).save(tmp_path / f"{name}.mcap", "mcap-none")
    assert [p.name for p in flights_in(tmp_path)] == ["1\u00b23.mcap", "b.mcap"]
