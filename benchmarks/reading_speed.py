"""Processor time of reading logs into arrays, beside other decoders and beside decompression alone, in one run.

    python -m benchmarks.reading_speed                           # two minutes of log, a table; nothing is written
    python -m benchmarks.reading_speed --minutes 10 --page       # and docs/performance.md
    python -m benchmarks.reading_speed --json rows.json          # rows as they come

A log of seven topics (wrenches, actuators, IMU, odometry, reference) at 200 Hz, written as MCAP (zstd), and a part of
it as ROS 2 sqlite3 and as ROS 1 bag. `read_log` gives columns, with the file's hash and every check of damage that it
has; the others give one object for each message. All columns are compared with rosbags' values bit for bit.
Processor time, because the machine may be busy; the ratio of rows of one run is what counts, and the load is stated.
"""

import hashlib
import struct
import tempfile
import zlib
from pathlib import Path
from time import process_time

import numpy as np
import zstandard
from mcap.reader import NonSeekingReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Bag1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from benchmarks import pages
from wrenchgap import flight
from wrenchgap.flight import ActuatorSeries, Flight, ImuSeries, OdometrySeries, ReferenceSeries, WrenchSeries, so3
from wrenchgap.flight.formats import read_log
from wrenchgap.flight.formats.decode import ACTUATORS

RATE = 200.0
LONGER = 10.0
"""Minutes of a second log for `inspect`."""
BAG_MESSAGES = 60_000
"""Messages of the sqlite3 and ROS 1 bags: rosbags takes long to write them."""
TIMES = 3
"""Readings of which the fastest counts; of the others, which take long, one."""


def everything(topic, kind, fields):
    """Decode all topics."""
    return True


def recorded(minutes):
    """A flight in numbers: slow motion, noise on all of it."""
    time = np.arange(0.0, 60.0 * minutes, 1.0 / RATE)
    rng = np.random.default_rng(0)
    waves = np.stack([np.sin((0.3 + 0.1 * k) * time + k) for k in range(12)], axis=1)

    def noisy(columns, size=1e-3):
        return waves[:, :columns] + size * rng.standard_normal((len(time), columns))

    quat = so3.continuous(so3.exp(0.3 * waves[:, :3]))
    motion = noisy(3), quat, noisy(3), noisy(3)
    series = {
        "commanded": WrenchSeries("/w", time, noisy(6)),
        "desired": WrenchSeries("/d", time, noisy(6)),
        "actuators": ActuatorSeries("/a", time, noisy(6), 500.0 + noisy(12)),
        "imu": ImuSeries("/i", time, noisy(3), noisy(3)),
        "odometry": OdometrySeries("/o", time, *motion),
        "reference": ReferenceSeries("/r", time, *motion, noisy(3), noisy(3)),
    }
    return Flight("made", Path("made.mcap"), "0" * 64, 1_700_000_000_000_000_000, **series)


def stores():
    """Types of ROS 1 and ROS 2, with those of `flight.write`."""
    made = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
    name = "actuator_msgs/msg/Actuators"
    for store in made:
        store.register(get_types_from_msg(ACTUATORS[name], name))
    return made


def as_ros1(message, kind, store):
    """A message of ROS 2 as one of ROS 1, whose header counts."""
    values = {}
    for name, (node, inner) in store.fielddefs[kind][1]:
        value = getattr(message, name, 0)
        if kind == "builtin_interfaces/msg/Time":
            value = getattr(message, {"nsec": "nanosec"}.get(name, name))
        values[name] = as_ros1(value, inner, store) if node == Nodetype.NAME else value
    return store.types[kind](**values)


def bags(mcap, folder):
    """The first messages of an MCAP as a ROS 2 folder with sqlite3 and as a ROS 1 bag."""
    ros1, ros2 = stores()
    paths = folder / "made_sqlite3", folder / "made.bag"
    with (
        AnyReader([mcap]) as log,
        Bag2Writer(paths[0], version=9, storage_plugin=StoragePlugin.SQLITE3) as second,
        Bag1Writer(paths[1]) as first,
    ):
        known = {}
        for number, (connection, time, raw) in enumerate(log.messages()):
            if number == BAG_MESSAGES:
                break
            topic, kind = connection.topic, connection.msgtype
            if topic not in known:
                pair = (second, ros2), (first, ros1)
                known[topic] = [bag.add_connection(topic, kind, typestore=store) for bag, store in pair]
            second.write(known[topic][0], time, raw)
            made = as_ros1(ros2.deserialize_cdr(raw, kind), kind, ros1)
            first.write(known[topic][1], time, ros1.serialize_ros1(made, kind))
    return paths


def seconds(act, times=1):
    """Least processor time of an act, and what it gave."""
    took = []
    for _ in range(times):
        start = process_time()
        found = act()
        took.append(process_time() - start)
    return min(took), found


def decompressed(path):
    """What nobody can do without: read the file, hash it, decompress its chunks, check their sums."""
    data = path.read_bytes()
    hashlib.sha256(data).hexdigest()
    position, total = 8, 0
    while position < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, position)
        position += 9
        if opcode == 6:
            _, _, size, crc, name = struct.unpack_from("<QQQII", data, position)
            start = position + 40 + name
            records = zstandard.ZstdDecompressor().decompress(memoryview(data)[start : position + length], size)
            assert not crc or zlib.crc32(records) == crc
            total += len(records)
        position += length
    return total


def with_mcap_ros2(path):
    """Every message decoded by mcap-ros2-support."""
    with path.open("rb") as stream:
        reader = NonSeekingReader(stream, decoder_factories=[DecoderFactory()])
        return sum(1 for _ in reader.iter_decoded_messages(log_time_order=False))


def with_rosbags(path, take=None):
    """Every message decoded by rosbags; `take` is given topic and message."""
    count = 0
    with AnyReader([path], default_typestore=stores()[1]) as log:
        for connection, _, raw in log.messages():
            message = log.deserialize(raw, connection.msgtype)
            count += 1
            if take is not None:
                take(connection.topic, message)
    return count


def differing(path, log):
    """How many values of all columns differ from rosbags' in any bit, and how many were compared."""
    cells = {topic: {name: [] for name in table.columns} for topic, table in log.tables.items()}
    paths = {topic: [(name.split("."), rows) for name, rows in found.items()] for topic, found in cells.items()}

    def take(topic, message):
        for names, rows in paths[topic]:
            value = message
            for name in names:
                value = getattr(value, name, None)
            rows.append(value)

    with_rosbags(path, take)
    apart = total = 0
    for topic, table in log.tables.items():
        for name, ours in table.columns.items():
            if ours.dtype.kind == "S":
                theirs = np.array([text.encode() for text in cells[topic][name]])
            elif cells[topic][name][0] is None:  # stamps of ROS 1 have another name in rosbags
                continue
            else:
                theirs = np.array(cells[topic][name]).reshape(len(table), -1)[:, : int(np.prod(ours.shape[1:]))]
                theirs = theirs.reshape(ours.shape).astype(ours.dtype)
            same = np.array_equal(ours, theirs) or ours.tobytes() == theirs.tobytes()
            apart += 0 if same else ours.size
            total += ours.size
    return apart, total


def rows(folder, minutes):
    """Lines of the table, as they are measured."""
    mcap = flight.write(recorded(minutes), folder / "made.mcap")
    sqlite, bag = bags(mcap, folder)
    for name, path in (("MCAP, zstd", mcap), ("ROS 2, sqlite3", sqlite), ("ROS 1 bag", bag)):
        read_log(path, everything)  # compiles, or loads what is compiled
        ours, log = seconds(lambda path=path: read_log(path, everything), TIMES)
        floor = seconds(lambda path=path: decompressed(path), TIMES)[0] if path == mcap else None
        theirs, count = seconds(lambda path=path: with_rosbags(path))
        official = seconds(lambda path=path: with_mcap_ros2(path))[0] if path == mcap else None
        apart, values = differing(path, log)
        messages = sum(map(len, log.tables.values()))
        yield {
            "log": name,
            "messages": messages,
            "as_many": messages == count,
            "MB": round(log.size / 1e6, 1),
            "ours_s": ours,
            "decompression_s": floor,
            "mcap_ros2_s": official,
            "rosbags_s": theirs,
            "values": values,
            "differing": apart,
        }
    longer = flight.write(recorded(LONGER), folder / "longer.mcap")
    for path, length in ((mcap, minutes), (longer, LONGER)):
        for with_model in (False, True):
            yield inspected(path, length, with_model)


def inspected(path, minutes, with_model):
    """`inspect` beside reading alone."""
    from wrenchgap.plant import model_file
    from wrenchgap.replay import api

    model = model_file.load("voliro_x") if with_model else None
    api.inspect(path, model)
    alone, _ = seconds(lambda: flight.load(path), TIMES)
    reading, log = seconds(lambda: read_log(path, everything), TIMES)
    whole, _ = seconds(lambda: api.inspect(path, model), TIMES)
    return {
        "log": "inspect with a model" if with_model else "inspect",
        "minutes": minutes,
        "messages": sum(map(len, log.tables.values())),
        "reading_s": reading,
        "load_s": alone,
        "inspect_s": whole,
    }


def lines(found, load):
    """Two tables in Markdown."""
    heads = ("log", "messages", "MB", "here, s", "floor, s", "mcap-ros2", "rosbags", "values", "differing")
    out = ["| " + " | ".join(heads) + " |", "| --- |" + " ---: |" * (len(heads) - 1)]
    for row in (row for row in found if "ours_s" in row):
        ratio = [f"{row[k] / row['ours_s']:.1f}x" if row[k] else "-" for k in ("mcap_ros2_s", "rosbags_s")]
        floor = f"{row['decompression_s']:.2f}" if row["decompression_s"] else "-"
        cells = (row["log"], f"{row['messages']:,}", f"{row['MB']:.0f}", f"{row['ours_s']:.2f}", floor, *ratio)
        out.append("| " + " | ".join([*cells, f"{row['values']:,}", f"{row['differing']:,}"]) + " |")
    out += ["", "| command | minutes | reading, s | load, s | whole, s | whole / reading |"]
    out += ["| --- |" + " ---: |" * 5]
    for row in (row for row in found if "inspect_s" in row):
        times = (f"{row[k]:.2f}" for k in ("reading_s", "load_s", "inspect_s"))
        out.append(
            f"| {row['log']} | {row['minutes']:g} | {' | '.join(times)} | {row['inspect_s'] / row['reading_s']:.1f} |"
        )
    return "\n".join([*out, "", load])


def main():
    """Measure; with --page, renew the page."""
    parser = pages.options(__doc__)
    parser.add_argument("--minutes", type=float, default=2.0, help="of log")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        pages.measure(asked, "reading", rows(Path(folder), asked.minutes), lines)


if __name__ == "__main__":
    main()
