"""From batches of raw messages to tables: what each channel is decoded with, and what could not be."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.budget import LIMITS, Account
from wrenchgap.flight.formats.decode import Decoder, UndecodableError, definitions_of, flat_fields
from wrenchgap.flight.formats.encodings import Encoded, encoded
from wrenchgap.flight.formats.message_walk import Definitions
from wrenchgap.flight.formats.reader import Batch, Channel, Places
from wrenchgap.flight.formats.table import Columns, Selection, Table

ROS = ("cdr", "ros1")
OTHERS = ("json", "protobuf")
STAMPS = (
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("header.stamp.sec", "header.stamp.nsec"),
    ("timestamp.sec", "timestamp.nsec"),
    ("timestamp.seconds", "timestamp.nanos"),
)
"""Where a message has the time at which it was made: of ROS, and of Foxglove's schemas in JSON and protobuf."""


@dataclass
class Collector:
    """Decodes batches as they come. A topic's first channel decides its type.

    Two channels of a topic whose definitions of the type differ are each read by their own: files of a recording may
    have been written before and after a message changed.
    """

    selection: Selection
    account: Account
    times: dict[str, list[NDArray[np.int64]]] = field(default_factory=dict)
    channels: dict[str, Channel] = field(default_factory=dict)
    decoders: dict[Channel, Decoder | Encoded | None] = field(default_factory=dict)
    definitions: dict[Channel, Definitions] = field(default_factory=dict)
    problems: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def wanted(self, channel: Channel) -> bool:
        """Whether the payloads of a channel are worth reading."""
        if channel not in self.decoders:
            self.decoders[channel] = self._decoder(channel)
        return self.decoders[channel] is not None

    def _decoder(self, channel: Channel) -> Decoder | Encoded | None:
        first = self.channels.setdefault(channel.topic, channel)
        if (channel.type, channel.encoding) != (first.type, first.encoding):
            self.notes.append(f"{channel.topic} carries {first.type} and also {channel.type}: the latter is left out.")
            return None
        if first is not channel and self.decoders.get(first) is not None:
            return self._shared(first, channel)
        if channel.encoding not in (*ROS, *OTHERS):
            self.problems[channel.topic] = (
                f"its messages are encoded as {channel.encoding!r}, expected cdr, ros1, json or protobuf"
            )
            return None
        try:
            if channel.encoding in OTHERS:
                decoder = encoded(channel, self.account)
                known = decoder.fields or channel.encoding == "json"  # JSON may come without a schema
                return decoder if known and self._chosen(channel, decoder.fields) else None
            definitions = definitions_of(channel)
            fields = flat_fields(channel.type, definitions)
        except (UndecodableError, KeyError) as error:
            self.problems[channel.topic] = str(error)
            return None
        return Decoder(channel, definitions, self.account) if self._chosen(channel, fields) else None

    def _chosen(self, channel: Channel, fields: list[str]) -> bool:
        return not fields or self.selection(channel.topic, channel.type, fields)

    def _shared(self, first: Channel, channel: Channel) -> Decoder | Encoded | None:
        """The decoder of another writer of the topic, which may know the type by another definition."""
        decoder = self.decoders[first]
        if channel.definition == first.definition or not isinstance(decoder, Decoder):
            return decoder
        try:
            self.definitions[channel] = definitions_of(channel)
        except UndecodableError as error:
            self.notes.append(f"{channel.topic}: another writer's messages are left out: {error}.")
            return None
        if self.definitions[channel].get(channel.type) != decoder.definitions.get(channel.type):
            note = f"{channel.topic}: two definitions of {channel.type} in this log; each message is read by its own."
            if note not in self.notes:
                self.notes.append(note)
        return decoder

    def add(self, batch: Batch) -> None:
        """Take some messages in."""
        channel = batch.channel
        first = self.channels[channel.topic]
        decoder = self.decoders[channel]
        if channel.type != first.type or (decoder is None and self.decoders.get(first) is not None):
            return
        self.account.take(LIMITS.log_times + 8 * len(batch.log_time_ns), "log times")
        self.account.check_time()
        self.times.setdefault(channel.topic, []).append(np.array(batch.log_time_ns, dtype=np.int64))
        if isinstance(decoder, Decoder):
            decoder.add(batch.payloads, self.definitions.get(channel))
        elif decoder is not None:
            payloads = batch.payloads
            decoder.add(payloads.payloads() if isinstance(payloads, Places) else payloads)

    def tables(self) -> dict[str, Table]:
        """All topics, in the order of their names."""
        return {topic: self._table(topic) for topic in sorted(self.times)}

    def _table(self, topic: str) -> Table:
        channel = self.channels[topic]
        log_time_ns = np.concatenate(self.times[topic])
        in_order = bool(np.all(log_time_ns[1:] >= log_time_ns[:-1]))  # then hours of log need no copy
        order: Any = slice(None) if in_order else np.argsort(log_time_ns, kind="stable")
        decoder = self.decoders[channel]
        problem = self.problems.get(topic)
        if decoder is None:
            return Table(topic, channel.type, log_time_ns[order], problem=problem)
        if decoder.malformed:
            problem = f"{decoder.malformed} of {decoder.count} messages do not fit the definition of {channel.type}"
        columns = {name: values[order] for name, values in decoder.columns().items()}
        return Table(topic, channel.type, log_time_ns[order], _header_ns(columns), columns, problem)


def _header_ns(columns: Columns) -> NDArray[np.int64] | None:
    """Header stamps [ns]; None where there is no header, or where all its stamps are zero."""
    place = next((names for names in STAMPS if all(name in columns for name in names)), None)
    if place is None:
        return None
    seconds, nanoseconds = (columns[name] for name in place)
    if seconds.dtype.kind == "f":  # some messages were malformed
        seconds, nanoseconds = np.nan_to_num(seconds), np.nan_to_num(nanoseconds)
    stamps = seconds.astype(np.int64) * 1_000_000_000 + nanoseconds.astype(np.int64)
    return stamps if np.any(stamps) else None
