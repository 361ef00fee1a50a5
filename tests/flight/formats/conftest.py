"""Autopilots' logs made on the spot, byte by byte after the published formats, with motion known in closed form."""

import struct
import sys

import numpy as np
import pytest

from wrenchgap.flight.flight import GRAVITY

CODES = {"uint64_t": "Q", "int64_t": "q", "uint32_t": "I", "int32_t": "i", "float": "f", "uint8_t": "B", "bool": "?"}


class Ulog:
    """A ULog file (docs.px4.io, ULog File Format): definitions first, then data in the order in which it is added."""

    def __init__(self, parameters=()):
        self.head, self.data, self.formats = [], [], {}
        for name, value in dict(parameters).items():
            kind, code = ("int32_t", "i") if isinstance(value, int) else ("float", "f")
            key = f"{kind} {name}".encode()
            self.head.append(self._message("P", bytes([len(key)]) + key + struct.pack(f"<{code}", value)))

    def topic(self, name, fields, columns, instance=0):
        """`fields` such as "uint64_t timestamp;float[3] xyz"; `columns` by name, (N,) or (N, K)."""
        if name not in self.formats:
            self.formats[name] = fields
            self.head.append(self._message("F", f"{name}:{fields};".encode()))
        number = sum(kind == "A" for kind, _ in self.data)
        layout, names = "<", []
        for field in fields.split(";"):
            kind, key = field.split(" ")
            base, _, count = kind.partition("[")
            layout += f"{count.rstrip(']') or 1}{CODES[base]}"
            names.append(key)
        self.data.append(("A", self._message("A", struct.pack("<BH", instance, number) + name.encode())))
        rows = np.column_stack([np.asarray(columns[key], dtype=object) for key in names])
        casts = [int if code in "QqIiB?" else float for code in _each(layout)]
        for row in rows:
            values = [cast(value) for cast, value in zip(casts, row, strict=True)]
            self.data.append(("D", self._message("D", struct.pack("<H", number) + struct.pack(layout, *values))))
        return self

    def nested(self, name, fields, inner, layout, rows):
        """A topic with messages within: `inner` are their fields by type, `rows` all numbers as in `layout`."""
        for kind, text in {**inner, name: fields}.items():
            self.head.append(self._message("F", f"{kind}:{text};".encode()))
        number = sum(kind == "A" for kind, _ in self.data)
        self.data.append(("A", self._message("A", struct.pack("<BH", 0, number) + name.encode())))
        for row in rows:
            self.data.append(("D", self._message("D", struct.pack("<H", number) + struct.pack(f"<{layout}", *row))))
        return self

    def parameter(self, name, value):
        """Set in flight: between the messages added before and behind it."""
        key = f"float {name}".encode()
        self.data.append(("P", self._message("P", bytes([len(key)]) + key + struct.pack("<f", value))))
        return self

    def dropout(self, milliseconds):
        self.data.append(("O", self._message("O", struct.pack("<H", milliseconds))))
        return self

    def said(self, level, microseconds, text):
        self.data.append(("L", self._message("L", struct.pack("<BQ", ord(str(level)), microseconds) + text.encode())))
        return self

    def save(self, path):
        start = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + self._message("B", bytes(40))
        path.write_bytes(start + b"".join(self.head) + b"".join(message for _, message in self.data))
        return path

    @staticmethod
    def _message(kind, payload):
        return struct.pack("<HB", len(payload), ord(kind)) + payload


def _each(layout):
    """Code of every value of a struct's layout."""
    number = ""
    for sign in layout[1:]:
        if sign.isdigit():
            number += sign
        else:
            yield from sign * int(number or 1)
            number = ""


LETTERS = "b:b B:B h:h H:H i:i I:I q:q Q:Q f:f d:d c:h C:H e:i E:I L:i M:b n:4s N:16s Z:64s a:64s"
STRUCT = dict(pair.split(":") for pair in LETTERS.split())
SCALE = {"c": 100, "C": 100, "e": 100, "E": 100, "L": 1e7}


class Dataflash:
    """An ArduPilot log: FMT messages lay out types, FMTU names their units, then messages in the order of time."""

    def __init__(self, parameters=(), units=True):
        self.head, self.messages, self.types, self.units = [], [], {}, units
        self._format(0x80, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
        if units:
            self.define("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
        for name, value in dict(parameters).items():
            self.add("PARM", "QNf", "TimeUS,Name,Value", [0], [name.encode()], [value])

    def define(self, name, layout, columns, instance=None):
        if name in self.types:
            return
        self.types[name] = 0x81 + len(self.types)
        self._format(self.types[name], name, layout, columns)
        if instance is not None and self.units:
            ids = "".join("#" if column == instance else "-" for column in columns.split(","))
            self.head.append(self._packed("FMTU", "QBNN", (0, self.types[name], ids.encode(), b"-" * len(ids))))

    def add(self, name, layout, columns, *values, instance=None):
        """Messages of one type, one a row; `values` in the order of the columns, the time first [us]."""
        self.define(name, layout, columns, instance)
        for row in zip(*values, strict=True):
            self.messages.append((int(row[0]), self._packed(name, layout, row)))
        return self

    def save(self, path):
        ordered = [message for _, message in sorted(self.messages, key=lambda entry: entry[0])]
        path.write_bytes(b"".join(self.head + ordered))
        return path

    def _format(self, number, name, layout, columns):
        size = 3 + sum(struct.calcsize(f"<{STRUCT[letter]}") for letter in layout)
        fields = (number, size, name.encode(), layout.encode(), columns.encode())
        self.head.append(b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", *fields))

    def _packed(self, name, layout, row):
        values = []
        for letter, value in zip(layout, row, strict=True):
            whole = letter not in "fdnNZa"
            values.append(round(value * SCALE.get(letter, 1)) if whole else value)
        body = struct.pack("<" + "".join(STRUCT[letter] for letter in layout), *values)
        return b"\xa3\x95" + bytes([self.types[name]]) + body


class Climb:
    """A vehicle that heads north, pitches up and down and climbs, as an autopilot sees it: FRD and NED.

    Pitch (nose up) is b sin(v t), north a sin(w t), down -0.5 t - c sin(u t).
    """

    a, w, b, v, c, u = 0.8, 1.7, 0.4, 2.3, 0.2, 3.1

    def __init__(self, time):
        t = np.asarray(time, dtype=float)
        zero = np.zeros_like(t)
        pitch = self.b * np.sin(self.v * t)
        self.time, self.pitch = t, pitch
        self.q = np.stack((np.cos(pitch / 2), zero, np.sin(pitch / 2), zero), axis=1)
        self.gyro = np.stack((zero, self.b * self.v * np.cos(self.v * t), zero), axis=1)
        self.ned = np.stack((self.a * np.sin(self.w * t), zero, -0.5 * t - self.c * np.sin(self.u * t)), axis=1)
        self.v_ned = np.stack(
            (self.a * self.w * np.cos(self.w * t), zero, -0.5 - self.c * self.u * np.cos(self.u * t)), axis=1
        )
        north = -self.a * self.w**2 * np.sin(self.w * t)
        felt = self.c * self.u**2 * np.sin(self.u * t) - GRAVITY  # along down, without the weight
        # body x is (cos pitch, -sin pitch) in (north, down), body z is (sin pitch, cos pitch)
        self.accelerometer = np.stack(
            (np.cos(pitch) * north - np.sin(pitch) * felt, zero, np.sin(pitch) * north + np.cos(pitch) * felt), axis=1
        )


@pytest.fixture(scope="session")
def autopilots():
    """This module."""
    return sys.modules[__name__]
