"""Print what is generated from other source, and write it where it belongs: `make generated`.

python -m scripts.generate            # writes
python -m scripts.generate --check    # fails where a file is not what would be written
"""

import sys
from pathlib import Path
from typing import Any, get_type_hints

from scripts.c_printer import allocation_header, allocation_text, memory_text, period_text
from wrenchgap.compensate.tables import ENTRIES, LINE, SIZES, Everything, Memory, Room, layout

ROOT = Path(__file__).resolve().parents[1]


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


FILES = {
    "compensate/generated/views.py": views_module,
    "compensate/generated/period.c": period_text,
    "compensate/generated/memory.h": memory_text,
    "compensate/generated/allocation.c": allocation_text,
    "compensate/generated/allocation.h": allocation_header,
}


def main() -> int:
    """Number of files that are not what they should be, with --check."""
    stale = 0
    for name, made in FILES.items():
        place = ROOT / name
        if "--check" not in sys.argv:
            place.write_text(made())
        elif place.read_text() != made():
            print(f"{name}: stale; run `make generated`")
            stale += 1
    return stale


if __name__ == "__main__":
    sys.exit(main())
