"""Faults that damaged files showed (benchmarks/faults): what can be read is read and counted, the rest is one line."""

import os
import sqlite3
import struct
import time
import zlib
from pathlib import Path

import numpy as np
import pytest
import zstandard

from benchmarks.faults.structured import CHUNK, MAGIC, bomb, chunk, joined, records
from benchmarks.faults.valid import FORMS
from wrenchgap import flight
from wrenchgap.flight import work_files
from wrenchgap.flight.clocks import ClockMap
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats import mcap, read_log, reader, rosbag2
from wrenchgap.flight.formats.decode import Decoder, UndecodableError, definitions_of, flat_fields
from wrenchgap.flight.formats.reader import Channel, Places
from wrenchgap.flight.formats.tabular import CsvReader

END = (15, bytes(4))


def everything(topic, kind, fields):
    return True


@pytest.fixture
def chunks(logs, tmp_path):
    """The records of an MCAP, several of which are chunks, and a function that writes others and reads them."""
    path = logs.plain_flight(3.0).save(tmp_path / "log.mcap", "mcap-zstd")
    found = records(path.read_bytes(), len(MAGIC))
    place = next(i for i, (opcode, _) in enumerate(found) if opcode == CHUNK)

    def read(changed):
        path.write_bytes(MAGIC + joined([*changed, END]) + MAGIC)
        return read_log(path, everything)

    return [record for record in found[: found.index(END) if END in found else None] if record[0] != 15], place, read


def imu(log):
    return len(log.tables["/imu"])


def test_a_chunk_that_unfolds_to_gigabytes_is_left_out(chunks):
    found, place, read = chunks
    load = bomb("zstd", 600)
    claims = struct.pack("<QQQII", 0, 0, 2**42, 0, 4) + b"zstd" + struct.pack("<Q", len(load)) + load
    log = read([*found[: place + 1], (CHUNK, claims), *found[place + 1 :]])
    assert any("1 chunk(s)" in said and "checksum" in said for said in log.damage)
    assert imu(log) == 300


def test_one_chunk_of_an_unknown_compression_costs_what_is_in_it(chunks):
    found, place, read = chunks
    strange = (CHUNK, chunk(b"", b"z" * 70_000))
    log = read([*found[: place + 1], strange, *found[place + 1 :]])
    assert any("1 chunk(s)" in said and "compressed with" in said and len(said) < 200 for said in log.damage)
    assert imu(log) == 300
    with pytest.raises(LogError, match=r"chunks compressed with 'z*', expected none, lz4 or zstd") as caught:
        read([strange])
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("length", [2**40, 2**64 - 1, None])
def test_after_a_record_that_cannot_be_the_walk_goes_on_at_the_next_chunk(chunks, length):
    found, place, read = chunks
    whole = imu(read(found))
    path = read.__closure__[0].cell_contents
    bad = bytes(5000) if length is None else struct.pack("<BQ", 6, length) + bytes(100)
    path.write_bytes(MAGIC + joined(found[: place + 2]) + bad + joined([*found[place + 2 :], END]) + MAGIC)
    log = read_log(path, everything)
    assert imu(log) == whole == 300
    assert any("1 place(s)" in said for said in log.damage)


def test_zeros_in_a_chunk_end_it_at_once(chunks):
    found, _, read = chunks
    start = time.process_time()
    log = read([*found, (CHUNK, chunk(bytes(100_000_000), b"zstd"))])
    assert time.process_time() - start < 10.0
    assert imu(log) == 300
    assert any("1 record(s)" in said for said in log.damage)


def test_an_attachment_is_not_read_into_memory(chunks):
    found, place, read = chunks
    log = read([*found[:place], (9, bytes(100)), *found[place:]])
    assert imu(log) == 300
    assert log.notes == read(found).notes


@pytest.mark.parametrize("form", ["mcap-none", "mcap-unchunked", "ulog", "csv", "bag-plain", "db3"])
def test_a_file_that_grows_while_it_is_read_is_what_it_was_at_the_beginning(form, tmp_path):
    path = FORMS[form](tmp_path)
    whole = read_log(path, everything)
    grown = []

    def growing(topic, kind, fields):
        if not grown:
            grown.append(path.stat().st_size)
            with path.open("ab") as file:
                file.write(path.read_bytes()[-300:])
        return True

    log = read_log(path, growing)
    for topic in log.tables.keys() & whole.tables.keys() if grown else ():
        assert len(log.tables[topic]) == len(whole.tables[topic])
    assert not grown or any("grew from" in note for note in log.notes)
    assert bool(grown) == (form not in ("ulog", "csv"))  # of those the library reads all before anybody asks


def replaced(path):
    other = path.with_name("other")
    other.write_bytes(path.read_bytes() * 2)
    other.replace(path)


def becomes_a_pipe(path):
    path.unlink()
    os.mkfifo(path)


@pytest.mark.timeout(20)
@pytest.mark.parametrize("change", [replaced, becomes_a_pipe, Path.unlink, lambda path: os.truncate(path, 0)])
@pytest.mark.parametrize("form", ["mcap-none", "db3"])
def test_a_file_that_another_one_replaces_while_it_is_read_is_refused(form, change, tmp_path):
    """Its SHA-256 was that of the other one, and a pipe was waited for."""
    path, asked = FORMS[form](tmp_path), []

    def changing(topic, kind, fields):
        if not asked:
            asked.append(change(path))
        return True

    with pytest.raises(LogError, match="was replaced, cut or removed while it was read"):
        read_log(path, changing)


def becomes_a_folder(path):
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize("change", [Path.unlink, becomes_a_folder])
def test_a_file_that_is_gone_when_it_is_opened_again_is_said_in_one_line(change, tmp_path, monkeypatch):
    path, read = FORMS["csv"](tmp_path), CsvReader.tables
    monkeypatch.setattr(CsvReader, "tables", lambda self, asked: change(path) or read(self, asked))
    with pytest.raises(LogError, match=r"log\.csv: cannot be read: "):
        read_log(path, everything)


def test_rows_that_only_the_write_ahead_log_of_a_bag_has_are_said_to_be_missing(tmp_path):
    """A recorder that was killed leaves them there; they were left out in silence."""
    path = FORMS["db3"](tmp_path)
    recorder = sqlite3.connect(path)
    recorder.execute("PRAGMA journal_mode = WAL")
    recorder.execute("INSERT INTO messages (topic_id, timestamp, data) SELECT topic_id, timestamp, data FROM messages")
    recorder.commit()
    notes = read_log(path, everything).notes
    recorder.close()  # which moves the rows, and removes the other file
    move = f"`sqlite3 {path} 'PRAGMA wal_checkpoint'` moves them"
    assert any("log.db3-wal holds rows" in note and move in note for note in notes), notes
    assert not any("-wal" in note for note in read_log(path, everything).notes)


def test_a_message_that_unfolds_to_gigabytes_is_no_message():
    with pytest.raises(zstandard.ZstdError, match="64 MB"):
        reader.decompressed(bomb("zstd", 600))
    assert reader.decompressed(zstandard.compress(b"\0\1\0\0abc")) == b"\0\1\0\0abc"


def test_lengths_and_compression_of_a_chunk_are_what_it_is_known_by():
    inner = joined([(5, bytes(40))])
    for compression in (b"", b"zstd", b"lz4"):
        body = joined([(6, chunk(inner, compression))])
        data = b"\x06" * 30 + bytes(17) + body
        assert mcap._next_chunk(data, 0) == 47
        assert mcap._next_chunk(data, 48) == len(data)
    assert zlib.crc32(inner)


def altered(path, *statements):
    with sqlite3.connect(path) as database:
        for statement in statements:
            database.execute(statement)
    return path


def test_a_view_without_end_in_place_of_the_messages_is_refused(tmp_path):
    endless = "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n) "
    endless += "SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM n"
    path = altered(FORMS["db3"](tmp_path), "ALTER TABLE messages RENAME TO kept", endless)
    with pytest.raises(LogError, match="not a readable ROS 2 bag"):
        flight.load(path)


@pytest.mark.parametrize("change", ["name = x'ff00'", "type = x'00'", "serialization_format = x'05'"])
def test_rows_that_describe_no_topic_are_counted(tmp_path, change):
    path = altered(FORMS["db3"](tmp_path), f"UPDATE topics SET {change} WHERE name != '/imu'")
    found = flight.load(path)
    assert len(found.imu.time) == 60
    assert any("row(s)" in said for said in found.damage)


def test_one_damaged_file_of_a_recording_costs_what_is_in_it(tmp_path):
    folder = FORMS["folder-sqlite3"](tmp_path)
    (folder / "folder_1.db3").write_bytes(b"SQLite format 3\0" + bytes(500))
    (folder / "metadata.yaml").unlink()
    for number, path in enumerate(sorted(folder.glob("*.db3"))):
        path.rename(folder / f"log_{number}.db3")
    found = flight.load(folder)
    assert len(found.imu.time) == 60
    assert any("1 file(s) are left out" in said for said in found.damage)


def test_a_damaged_compressed_file_is_read_as_far_as_it_goes(logs, tmp_path):
    folder = logs.plain_flight(6.0).save(tmp_path / "bag", "folder-mcap-file")
    (path,) = folder.glob("*.zstd")
    data = path.read_bytes()
    path.write_bytes(data + b"no frame of zstd")
    found = flight.load(folder)
    assert len(found.imu.time) == 600
    assert any("read as far as it goes" in said for said in found.damage)
    path.write_bytes(data[: len(data) // 2] + bytes(50) + data[len(data) // 2 :])
    log = read_log(folder, everything)
    assert 0 < len(log.tables["/imu"]) < 600
    assert any("read as far as it goes" in said for said in log.damage)


def test_a_bag_is_unpacked_into_the_folder_that_goes_with_its_process(logs, tmp_path, monkeypatch):
    bag = logs.plain_flight(6.0).save(tmp_path / "bag", "folder-mcap-file")
    (tmp_path / "work").mkdir()
    monkeypatch.setattr(work_files, "folder", lambda: str(tmp_path / "work"))
    opened = rosbag2.McapReader
    places = []

    def noted(path, **options):
        places.append(path)
        return opened(path, **options)

    monkeypatch.setattr(rosbag2, "McapReader", noted)
    assert len(flight.load(bag).imu.time) == 600
    assert places
    assert all(tmp_path / "work" in path.parents for path in places)
    assert not list((tmp_path / "work").iterdir())


LOOP = "lab_msgs/Loop next\n" + "=" * 80 + "\nMSG: lab_msgs/Loop\n"


def test_a_type_that_contains_itself_has_no_end_and_is_not_followed():
    channel = Channel("/x", "lab_msgs/msg/Loop", "cdr", LOOP + "lab_msgs/Loop next\n")
    decoder = Decoder(channel, definitions_of(channel))
    decoder.add([b"\0\1\0\0" + bytes(100)])
    assert decoder.malformed == 1
    many = "".join(f"lab_msgs/Loop next{i}\n" for i in range(40))
    wide = Channel("/x", "lab_msgs/msg/Loop", "cdr", many + LOOP.partition("\n")[2] + many)
    assert 4000 < len(flat_fields(wide.type, definitions_of(wide))) <= 5000


def test_more_messages_than_bytes_are_not_counted_up_to():
    text = "lab_msgs/Nothing[] many\n" + "=" * 80 + "\nMSG: lab_msgs/Nothing\n"
    channel = Channel("/x", "lab_msgs/msg/Thing", "ros1", text)
    decoder = Decoder(channel, definitions_of(channel))
    decoder.add([b"\xff\xff\xff\xff" + bytes(20)])
    assert decoder.malformed == 1


def test_an_array_of_negative_length_does_not_lead_before_the_message():
    """Compiled copies would read what else the process has there: one message, and many at once."""
    channel = Channel("/x", "lab_msgs/msg/Thing", "cdr", "uint8[-65300] back\nuint8[60000] leak\n")
    decoder = Decoder(channel, definitions_of(channel))
    decoder.add([b"\0\1\0\0" + bytes(66000)] * 20)
    assert decoder.malformed == 20
    assert not decoder.parts
    data = (b"\0\1\0\0" + bytes(66000)) * 20
    places = Places(data, np.arange(20) * 66004, np.full(20, 66004))
    packed = Decoder(channel, definitions_of(channel))
    packed.add(places)
    assert packed.malformed == 20


@pytest.mark.parametrize("text", ["(" * 3000, "float64[2000000000", "float64 9x", "\xff\xfe"])
def test_what_is_no_definition_is_said_to_be_none(text):
    with pytest.raises(UndecodableError, match="cannot be read"):
        definitions_of(Channel("/x", "lab_msgs/msg/Thing", "cdr", text))


def test_columns_of_one_name_make_no_table(tmp_path):
    from benchmarks.faults.autopilot import FMT

    path = FORMS["dataflash"](tmp_path)
    twice = FMT.pack(0xC0, 19, b"TWO", b"QQ", b"TimeUS,TimeUS")
    path.write_bytes(path.read_bytes() + b"\xa3\x95\x80" + twice + b"\xa3\x95\xc0" + bytes(16))
    assert "TWO" not in read_log(path, everything).tables


def test_messages_without_columns_make_no_table(tmp_path):
    from benchmarks.faults.autopilot import FMT

    path = FORMS["dataflash"](tmp_path)
    empty = FMT.pack(0xC0, 3, b"NONE", b"", b"")
    path.write_bytes(path.read_bytes() + b"\xa3\x95\x80" + empty + b"\xa3\x95\xc0" * 3)
    assert "NONE" not in read_log(path, everything).tables


def test_a_file_that_begins_with_an_empty_line_is_no_table(tmp_path):
    (tmp_path / "log.any").write_bytes(b"\n")
    with pytest.raises(LogError, match="not a log"):
        flight.load(tmp_path / "log.any")


def test_a_clock_that_stands_still_tells_no_time():
    still = ClockMap(0, 0, np.array([0.0, 1.0]), np.array([0.0, 0.0]), 0.0)
    asked = np.array([0, 10**9, 2 * 10**9])
    assert np.diff(still.inverse(asked)).tolist() == [10**9, 10**9]  # and no division by its rate


def test_names_of_a_log_do_not_break_the_line_nor_the_terminal():
    assert str(LogError("topics: \n\x1b[31m/imu\tred")) == "topics: \N{REPLACEMENT CHARACTER}[31m/imu red"


def test_pages_of_a_bag_in_another_order_are_damage(tmp_path):
    """SQLite walks over rows that are out of order without a word, and answers with others than were asked for."""
    path = FORMS["db3"](tmp_path)
    assert flight.load(path).damage == ()
    pages = path.read_bytes()
    size = int.from_bytes(pages[16:18], "big")  # of a page: the file format of SQLite, 1.3.2
    one, other = (slice(k * size, (k + 1) * size) for k in (7, 8))  # leaves of the table of messages
    changed = bytearray(pages)
    changed[one], changed[other] = pages[other], pages[one]
    path.write_bytes(changed)
    (said,) = flight.load(path).damage
    assert "out of order" in said
