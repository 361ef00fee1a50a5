"""ROS 1 bags (`.bag`, format 2.0), through rosbags' reader.

Of a whole bag the index is taken as arrays and the messages of a chunk are found by one walk; where anything does not
agree (an index entry without its message, another time, a record that cannot be), rosbags reads the bag by itself.
"""

import bz2
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import lz4.frame
import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as BagReader
from rosbags.rosbag1 import reader as rosbag1

from wrenchgap.flight.budget import LIMITS, Account, BudgetError
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats.kernels import walked_bag
from wrenchgap.flight.formats.reader import (
    Batch,
    Channel,
    DoubtfulError,
    Gatherer,
    Places,
    Reader,
    Wanted,
    normalised_type,
    one_line,
)

SHORTEST = 46
"""Bytes of a message's record without its payload, at least."""
PIECE = 2**24
"""Bytes that are decompressed at once."""
PACKERS: dict[Callable[[bytes], bytes], Callable[[], Any]] = {
    rosbag1.decompressors[rosbag1.Compression.BZ2.value]: bz2.BZ2Decompressor,
    rosbag1.decompressors[rosbag1.Compression.LZ4.value]: lz4.frame.LZ4FrameDecompressor,
}
ENTRY = np.dtype([("seconds", "<u4"), ("nanoseconds", "<u4"), ("offset", "<u4")])
"""Of an index."""


@dataclass
class Rosbag1Reader(Reader):
    """Reads one ROS 1 bag."""

    name: ClassVar[str] = "ROS 1 bag"
    expected: ClassVar[str] = "ROS 1 bag (.bag)"
    magic: ClassVar[bytes] = b"#ROSBAG V"

    def batches(self, wanted: Wanted) -> Iterator[Batch]:
        """Go through the bag, chunk by chunk, or carefully in order of time."""
        if self.careful:
            yield from self._carefully(wanted)
            return
        try:
            with IndexedBag(self.path, self.account) as bag:
                yield from bag.batches(wanted)
        except BudgetError:
            raise
        except Exception as error:  # of a damaged bag rosbags raises many kinds
            raise DoubtfulError(one_line(error)) from error

    def _carefully(self, wanted: Wanted) -> Iterator[Batch]:
        gathered = Gatherer(self.account)
        try:
            with CountedBag(self.path, self.account) as bag:
                channels = {connection.id: _channel(connection) for connection in bag.connections}
                for connection, log_time_ns, payload in bag.messages():
                    channel = channels[connection.id]
                    yield from gathered.add(channel, log_time_ns, bytes(payload) if wanted(channel) else b"")
        except BudgetError:
            raise
        except Exception as error:  # a damaged bag makes rosbags raise many kinds
            if not gathered.total:
                raise LogError(
                    f"{self.path}: not a readable ROS 1 bag ({one_line(error)}); "
                    "a bag that was cut short is repaired by `rosbag reindex`"
                ) from error
            self.damage.append(f"{self.path.name} is damaged ({one_line(error)}): read as far as it goes.")
        yield from gathered.flush()


@dataclass(frozen=True, eq=False)
class Entries:
    """What an index says of one connection in one chunk: log times [ns] (K,) and where the records begin (K,)."""

    connection: int
    log_time_ns: NDArray[np.int64]
    offsets: NDArray[np.int64]


class CountedBag(BagReader):
    """A bag whose connections, index and chunks are asked of an account before they are unfolded."""

    def __init__(self, path: Any, account: Account) -> None:
        super().__init__(path)
        self.account = account

    def read_connection(self) -> Connection:
        """One of them."""
        found = super().read_connection()
        self.account.take(LIMITS.bag_connection + 2 * len(found.msgdef.data), "connections")
        self.account.check_time()
        return found

    def read_chunk(self) -> rosbag1.Chunk:
        """One of them, whose decompression is counted."""
        found = super().read_chunk()
        self.account.take(LIMITS.bag_connection, "the index of chunks")
        packer = PACKERS.get(found.decompressor)
        return found if packer is None else found._replace(decompressor=lambda data: self._unfolded(packer, data))

    def read_index_data(self, pos: int, indexes: dict[int, list[rosbag1.IndexData]]) -> None:
        """The entries of one connection in the chunk at `pos`."""
        assert self.bio
        before = self.bio.tell()
        super().read_index_data(pos, indexes)
        self.account.take((self.bio.tell() - before) // ENTRY.itemsize * LIMITS.bag_object, "the index of messages")
        self.account.check_time()

    def _unfolded(self, packer: Callable[[], Any], data: bytes) -> bytes:
        """The records of a chunk; those of bz2 may be several streams."""
        found = bytearray()
        while data:
            stream = packer()
            while not stream.eof:
                piece = stream.decompress(data, max_length=PIECE)
                if not piece and stream.needs_input:
                    raise rosbag1.ReaderError("a chunk that is cut short")
                found += piece
                data = b""
                self.account.ask(LIMITS.bag_unfolded * len(found), "a chunk")
                self.account.check_time()
            data = stream.unused_data if packer is bz2.BZ2Decompressor else b""
        return bytes(found)


class IndexedBag(CountedBag):
    """A bag whose index is kept as arrays, by chunk; rosbags' own has an object for every message."""

    def __init__(self, path: Any, account: Account) -> None:
        super().__init__(path, account)
        self.entries: dict[int, list[Entries]] = {}

    def read_index_data(self, pos: int, indexes: dict[int, list[rosbag1.IndexData]]) -> None:
        """The entries of one connection in the chunk at `pos`."""
        assert self.bio
        header = rosbag1.Header.read(self.bio, rosbag1.RecordType.IDXDATA)
        count = header.get_uint32("count")
        data = rosbag1.read_bytes(self.bio, rosbag1.read_uint32(self.bio))
        if header.get_uint32("ver") != 1 or len(data) != count * ENTRY.itemsize:
            raise DoubtfulError("an index of another kind")
        self.account.take(LIMITS.bag_entries + 16 * count, "the index of messages")
        self.account.check_time()
        found = np.frombuffer(data, dtype=ENTRY)
        time = found["seconds"].astype(np.int64) * 10**9 + found["nanoseconds"]
        offsets = found["offset"].astype(np.int64)
        self.entries.setdefault(pos, []).append(Entries(header.get_uint32("conn"), time, offsets))

    def batches(self, wanted: Wanted) -> Iterator[Batch]:
        """The messages of every chunk, by connection, in the order of the index."""
        channels = {connection.id: _channel(connection) for connection in self.connections}
        every = [entries for several in self.entries.values() for entries in several if len(entries.offsets)]
        for entries in sorted(every, key=lambda e: int(e.log_time_ns.min())):
            wanted(channels[entries.connection])  # the first message of a topic decides its type
        gathered = Gatherer(self.account)
        for info in self.chunk_infos:
            yield from self._chunk(info.pos, channels, wanted, gathered)

    def _chunk(self, pos: int, channels: dict[int, Channel], wanted: Wanted, gathered: Gatherer) -> Iterator[Batch]:
        assert self.bio
        self.account.check_time()
        chunk: rosbag1.Chunk = self.chunks[pos]
        self.bio.seek(chunk.datapos)
        data = bytes(chunk.decompressor(rosbag1.read_bytes(self.bio, chunk.datasize)))
        places = np.empty((6, len(data) // SHORTEST + 1), dtype=np.int64)
        count = walked_bag(np.frombuffer(data, dtype=np.uint8), places)
        if count < 0:
            raise DoubtfulError("a record that is odd")
        connection, time, starts, lengths, begin, before = places[:, :count]
        for entries in self.entries.get(pos, ()):
            rows = np.searchsorted(begin, entries.offsets)
            rows = np.minimum(rows, count - 1)
            agree = (begin[rows] == entries.offsets) | (before[rows] == entries.offsets)
            agree &= (connection[rows] == entries.connection) & (time[rows] == entries.log_time_ns)
            if not agree.all():
                raise DoubtfulError("an index that does not fit")
            channel = channels[entries.connection]
            payloads = Places(data, starts[rows], lengths[rows]) if wanted(channel) else None
            yield from gathered.direct(channel, time[rows], payloads)


def _channel(connection: Connection) -> Channel:
    return Channel(connection.topic, normalised_type(connection.msgtype), "ros1", connection.msgdef.data or None)
