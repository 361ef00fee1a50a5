"""Damage that knows what people write: tables, model files, stored GPs, robot descriptions."""

from __future__ import annotations

import io
import json
import pickle
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Fault = Callable[[Path, np.random.Generator], None]

# --- tables

CELLS = (
    "",
    "nan",
    "inf",
    "1e999",
    "-",
    "text",
    '"',
    "'",
    "0x10",
    "1,5",
    "99999999999999999999999",
    "é",
    "\x00",
    "a" * 200_000,
)


def csv_cells(path: Path, rng: np.random.Generator) -> None:
    """Cells that hold no number, or one too many."""
    lines = path.read_text(encoding="utf-8").split("\n")
    for _ in range(int(rng.choice([1, 5, 50]))):
        row = int(rng.integers(len(lines)))
        cells = lines[row].split(",")
        cells[int(rng.integers(len(cells)))] = CELLS[int(rng.integers(len(CELLS)))]
        lines[row] = ",".join(cells)
    path.write_text("\n".join(lines), encoding="utf-8")


def csv_lines(path: Path, rng: np.random.Generator) -> None:
    """Lines in another order, twice, too short, too long, or none but the header."""
    head, *lines = path.read_text(encoding="utf-8").strip().split("\n")
    lines = [lines[i] for i in rng.integers(len(lines), size=int(rng.choice([0, 1, 2, len(lines)])))]
    lines = [line[: int(rng.integers(len(line)))] if rng.random() < 0.1 else line for line in lines]
    lines = [line + ",1,2,3" if rng.random() < 0.1 else line for line in lines]
    path.write_text("\n".join([head, *lines]), encoding="utf-8")


def csv_header(path: Path, rng: np.random.Generator) -> None:
    """Headers that are doubled, empty, absurd, missing, or thousands."""
    head, *lines = path.read_text(encoding="utf-8").split("\n")
    names = head.split(",")
    kinds = (
        lambda: ",".join(["time_s"] * len(names)),
        lambda: ",".join(rng.permutation(names)),
        lambda: "," * (len(names) - 1),
        lambda: head.replace("time_s", str(rng.choice(["t", "time [us]", "time [parsec]", "date", "time,time"]))),
        lambda: head + "".join(f",motor_{i}" for i in range(5, 3000)),
        lambda: head.replace("gyro_x", "gyro_x [" + "(" * 50),
        lambda: "",
        lambda: head.replace("motor_1", "motor_99999999999999999999"),
    )
    path.write_text("\n".join([kinds[int(rng.integers(len(kinds)))](), *lines]), encoding="utf-8")


def csv_coded(path: Path, rng: np.random.Generator) -> None:
    """In another encoding, or with other ends of lines."""
    text = path.read_text(encoding="utf-8")
    codes = ("utf-16", "utf-8-sig", "utf-32", "utf-16-be")
    data = text.encode(codes[int(rng.integers(len(codes)))])
    path.write_bytes(data if rng.random() < 0.6 else text.replace("\n", "\r").encode())


CSV: tuple[Fault, ...] = (csv_cells, csv_lines, csv_header, csv_coded)


def parquet_columns(path: Path, rng: np.random.Generator) -> None:
    """Columns of other types, with nothing in them, or no rows."""
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq

    frame = pd.read_parquet(path)
    name = str(rng.choice(frame.columns))
    n = len(frame)
    kinds: tuple[Callable[[], Any], ...] = (
        lambda: ["text"] * n,
        lambda: [None] * n,
        lambda: [b"\xff"] * n,
        lambda: [[1.0, 2.0]] * n,
        lambda: [[1.0] * (i % 3) for i in range(n)],
        lambda: [{"a": 1}] * n,
        lambda: [True] * n,
        lambda: [2**62] * n,
        lambda: pd.to_datetime(["2026-01-01"] * n),
        lambda: pd.to_timedelta([5] * n),
        lambda: pd.Categorical(["a"] * n),
        lambda: np.zeros(n, dtype=np.float16),
    )
    columns = {key: pa.array(frame[key]) for key in frame.columns}
    columns[name] = pa.array(kinds[int(rng.integers(len(kinds)))]())
    table = pa.table(columns)
    rows = int(rng.choice([0, 1, 2, n]))
    pq.write_table(table.slice(0, rows), path)


PARQUET: tuple[Fault, ...] = (parquet_columns,)

# --- model files

VALUES = (
    *("-1", "0", "nan", "inf", "-inf", "1e308", "1e-308", "9" * 400, "true", '"text"', '""', "[]", "{}", "[[]]"),
    *(
        "2026-01-01",
        "1e999",
        "0x7fffffffffffffffff",
        '"\\u0000"',
        "'''\n'''",
        "[1, 2",
        "{ value = 1.0 }",
        "[nan, nan, nan]",
    ),
    *(
        "{ value = 1, tolerance = -1 }",
        "[1, 2, 3, 4]",
        "[0, 0, 0]",
        "[" * 5000 + "]" * 5000,
        "{ a = " * 400 + "}" * 400,
    ),
    *('["a", "b"]', "12:00:00", '"/imu"', '"/imu:frd,g,deg"', '"/imu.a.b[0:99999999999]"', '"/imu*nan"', '"bench.csv"'),
    *('"/dev/zero"', '"../../../etc/passwd"', '"."', '"\\ud800"'),
)


def toml_value(path: Path, rng: np.random.Generator) -> None:
    """Values of another kind, size or sign."""
    lines = path.read_text(encoding="utf-8").split("\n")
    places = [i for i, line in enumerate(lines) if re.match(r"\s*[\w.]+\s*=", line)]
    for _ in range(int(rng.choice([1, 1, 3]))):
        at = int(rng.choice(places))
        lines[at] = lines[at].split("=")[0] + "= " + VALUES[int(rng.integers(len(VALUES)))]
    path.write_text("\n".join(lines), encoding="utf-8")


def toml_lines(path: Path, rng: np.random.Generator) -> None:
    """Lines gone, doubled, moved, or keys that nobody knows."""
    lines = path.read_text(encoding="utf-8").split("\n")
    at, to = (int(x) for x in rng.integers(len(lines), size=2))
    kinds = (
        lambda: lines.pop(at),
        lambda: lines.insert(to, lines[at]),
        lambda: lines.insert(to, lines.pop(at)),
        lambda: lines.insert(at, "unknown = 1"),
        lambda: lines.insert(at, "[unknown.table]"),
        lambda: lines.insert(at, "[[effects]]\nname = 'mass'\n" * 300),
        lambda: lines.insert(at, "[[effects]]\nname = 'wind'\nvelocity_x = 1e300"),
        lambda: lines.insert(at, '[[effects]]\nname = \'__import__("os").system("true")\''),
        lambda: lines.insert(at, "[[vehicle.arms]]\n" * 2000),
        lambda: lines.insert(at, "a." * 5000 + "b = 1"),
    )
    kinds[int(rng.integers(len(kinds)))]()
    path.write_text("\n".join(lines), encoding="utf-8")


TOML: tuple[Fault, ...] = (toml_value, toml_value, toml_lines)


def bench(path: Path, rng: np.random.Generator) -> None:
    """A bench table that is none."""
    kinds = (b"", b"command,thrust\n", b"command,thrust\n1000,a\n", b"\xff\xfe", b"command\n1\n", b"x,y\n1,2\n")
    kinds += (
        b"command,thrust\n1000,0\n1000,0\n",
        b"command,thrust\n1000,nan\n2000,1\n",
        b"command,command\n1,2\n3,4\n",
    )
    kinds += (b"command,thrust\n1000,0,5\n2000,1,6\n", b'command,thrust\n"1000,0\n', b"command,thrust\n1000\n2000,1\n")
    file = path.with_name("bench.csv")
    file.unlink()
    if rng.random() < 0.9:
        file.write_bytes(kinds[int(rng.integers(len(kinds)))])
    elif rng.random() < 0.5:
        file.mkdir()


# --- stored GPs


class Executed:
    """What a pickle runs when it is loaded."""

    def __init__(self, target: str) -> None:
        self.target = target

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        """Write a file: a sign that something was unpickled."""
        return (Path.write_text, (Path(self.target), "unpickled"))


def _array(values: Any, pickled: bool = False) -> bytes:
    stream = io.BytesIO()
    np.save(stream, values, allow_pickle=pickled)
    return stream.getvalue()


def _claimed(shape: str) -> bytes:
    """An array that claims a shape and holds nothing."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode()
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head


def gp_part(path: Path, rng: np.random.Generator) -> None:
    """A part with another content: other shapes, no numbers, pickles, claims, JSON that says something else."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    name = str(rng.choice(sorted(parts)))
    contents: tuple[bytes, ...] = (
        *(b"", b"\x00" * 50, _array(np.full((3, 3), np.nan)), _array(np.zeros(0)), _array(np.array(["a"]))),
        *(_array(np.array([{}], dtype=object), pickled=True), pickle.dumps(Executed("/nowhere/unpickled"))),
        *(_claimed("(1000000000000,)"), _claimed("(-1,)"), _claimed("('a',)"), _claimed("(" * 500 + ")" * 500)),
        *(
            b"{}",
            b"[]",
            b"null",
            b'{"format": 1}',
            b"[" * 100_000,
            b"\xff",
            b'{"a": NaN}',
            _array(np.zeros((3, 6)) + 1j),
        ),
        *(
            _array(np.full((12, 6), 1e308)),
            _array(np.zeros((3, 6))),
            _array(np.array(5.0)),
            _array(np.zeros((2, 2, 2, 2))),
        ),
    )
    if name == "gp.json" and rng.random() < 0.7:
        parts[name] = json.dumps(_other(json.loads(parts[name]), rng)).encode()
    else:
        parts[name] = contents[int(rng.integers(len(contents)))]
    if rng.random() < 0.1:
        parts["more.npy"] = contents[2]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED if rng.random() < 0.5 else zipfile.ZIP_STORED) as archive:
        for key, content in parts.items():
            archive.writestr(zipfile.ZipInfo(key), content, archive.compression)


def _other(value: Any, rng: np.random.Generator) -> Any:
    """The same JSON with one value replaced."""
    strange = (None, -1, 1e308, "text", [], {}, [[[]]], True, 2**70, "\x00")
    if isinstance(value, dict) and value and rng.random() < 0.85:
        key = sorted(value)[int(rng.integers(len(value)))]
        return {**value, key: _other(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.7:
        at = int(rng.integers(len(value)))
        return [*value[:at], _other(value[at], rng), *value[at + 1 :]]
    return strange[int(rng.integers(len(strange)))]


def gp_bomb(path: Path, rng: np.random.Generator) -> None:
    """A part that is small in the file and large out of it."""
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("inputs2.npy"), bytes(20_000_000), archive.compression)


GP: tuple[Fault, ...] = (gp_part,)

# --- robot descriptions

LAUGHS = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10 if i else "ha"}">' for i in range(10))


def xml_values(path: Path, rng: np.random.Generator) -> None:
    """Attributes and elements with other values, doubled, gone, nested, or made of entities."""
    text = path.read_text(encoding="utf-8")
    values = ("", "nan", "inf", "-1", "0", "1e308", "text", "1 2", "1 2 3 4 5 6 7", "&lt;", "&a9;", "base", "rotor_0")
    value = values[int(rng.integers(len(values)))]
    places = list(re.finditer(r'(?<==)["\'][^"\']*["\']|(?<=>)[^<>\s][^<>]*(?=<)', text))
    found = places[int(rng.integers(len(places)))]
    quoted = found[0][0] in "\"'"
    changed = text[: found.start()] + (f'"{value}"' if quoted else value) + text[found.end() :]
    tag = re.findall(r"<(\w+)", text)
    kinds = (
        *[lambda: changed] * 6,
        lambda: f"<!DOCTYPE x [{LAUGHS}]>{re.sub(r'<[?].*?[?]>', '', changed)}",
        lambda: re.sub(rf"<(/?){tag[int(rng.integers(len(tag)))]}\b", r"<\1other", text),
        lambda: text.replace("rotor_1", "rotor_0"),
        lambda: "<a>" * 3000 + text + "</a>" * 3000,
    )
    path.write_text(kinds[int(rng.integers(len(kinds)))](), encoding="utf-8")


XML: tuple[Fault, ...] = (xml_values,)
