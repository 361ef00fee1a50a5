"""All that a step is handed in two arrays, for numba unpacks sixty in the time of two steps; and its views.

The order is that of `compensate.tables.layout`. `views_module` prints the function that finds the parts again.
"""

import math
from typing import Any, get_type_hints

import numpy as np

from wrenchgap.compensate.tables import Compensation, Entry, Everything, Ints, Memory, Room, layout
from wrenchgap.flight.flight import Array

LINE = 8
"""Numbers of a line of the processor's cache: what begins with one is fetched in fewer pieces."""
ENTRIES = tuple(layout(Everything))
SIZES = tuple(dict.fromkeys(s for entry in ENTRIES for s in entry.shape if isinstance(s, str) and "+" not in s))
"""Names of the sizes, with which the integers begin."""


def packed(compensation: Compensation, sizes: dict[str, int]) -> tuple[Array, Ints]:
    """Copies of a compensation, and room for the rest, in one array of numbers and one of integers."""
    totals = {False: LINE, True: len(SIZES)}
    for entry in ENTRIES:
        twice = 1 + (entry.path[0] == "memory")  # what it was before a step
        totals[entry.integer] += twice * -(-math.prod(_sizes(entry, sizes)) // LINE) * LINE
    room = np.zeros(totals[False])
    start = -(room.ctypes.data // room.itemsize) % LINE
    numbers, counts = room[start:], np.zeros(totals[True], dtype=np.int64)
    counts[: len(SIZES)] = [sizes[name] for name in SIZES]
    ends = {False: 0, True: len(SIZES)}
    for entry in ENTRIES:
        size = math.prod(_sizes(entry, sizes))
        if entry.path[0] == "compensation":
            value: Any = compensation
            for name in entry.path[1:]:
                value = getattr(value, name)
            array = counts if entry.integer else numbers
            array[ends[entry.integer] :][:size] = np.ravel(value)
        ends[entry.integer] += -(-size // LINE) * LINE
    return numbers, counts


def _sizes(entry: Entry, sizes: dict[str, int]) -> list[int]:
    return [s if isinstance(s, int) else sizes[s.removesuffix(" + 1")] + s.endswith(" + 1") for s in entry.shape]


def views_module() -> str:
    """The text of `compensate.generated.views`."""
    head = (
        '"""Printed by `make generated` from `compensate.tables`; not to be edited."""\n\n'
        "# mypy: ignore-errors\n# ruff: noqa\n# fmt: off\n\n"
        "from wrenchgap.compensate import tables as t\n"
        "from wrenchgap.compensate.compiling import cube, matrix, opening, vector\n\n\n"
        "@opening\ndef opened(numbers, counts):\n"
        '    """`Everything` as it lies in the two arrays, what is remembered as one array (M,), and as much room."""\n'
        "    # Long because every array has a line.\n"
    )
    lines = [f"    {name} = counts[{k}]" for k, name in enumerate(SIZES)]
    lines += ["    f, i = 0, " + str(len(SIZES))]
    for entry in ENTRIES:
        name, at, source = "_".join(entry.path), "i" if entry.integer else "f", ("numbers", "counts")[entry.integer]
        if entry.path == ("memory", Memory._fields[0]):
            lines.append("    first = f")
        if entry.path == ("room", *next(layout(Room)).path):
            lines += ["    flat = numbers[first:f]", "    before, f = vector(numbers, f, len(flat))"]
        kind = ("number", "vector", "matrix", "cube")[len(entry.shape)]
        shape = "".join(f", {size}" for size in entry.shape)
        lines.append(
            f"    {name}, {at} = {source}[{at}], {at} + {LINE}" if not entry.shape
            else f"    {name}, {at} = {kind}({source}, {at}{shape})"
        )  # fmt: skip
    return head + "\n".join(lines) + f"\n    return {_made(Everything, ())}, flat, before\n"


def _made(kind: Any, path: tuple[str, ...]) -> str:
    """The expression that puts a tuple together."""
    parts = [
        _made(hint, (*path, name)) if isinstance(hint, type) and hasattr(hint, "_fields") else "_".join((*path, name))
        for name, hint in get_type_hints(kind, include_extras=True).items()
    ]
    return f"t.{kind.__name__}({', '.join(parts)})"
