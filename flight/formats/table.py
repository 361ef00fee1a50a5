"""One topic's messages as columns: what every format becomes before anything is known of flights."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.budget import Account
from wrenchgap.flight.flight import Indices

Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Table:
    """One topic's messages: N log times [ns] and, where the topic was wanted, its fields as columns.

    `header_ns` are the header's stamps [ns], or None where the type has none or nobody filled it in. `problem` says
    why a wanted topic could not be decoded. Rows are in the order of the log time. `firmware` is the one whose
    names the columns of a table have.
    """

    topic: str
    type: str
    log_time_ns: NDArray[np.int64]
    header_ns: NDArray[np.int64] | None = None
    columns: Columns = field(default_factory=dict)
    problem: str | None = None
    firmware: str = ""

    def __len__(self) -> int:
        return len(self.log_time_ns)


def in_order(stamps: NDArray[np.int64], what: str, notes: list[str]) -> Indices:
    """The order of N rows by their stamps [ns]; the notes are told where they were in another."""
    if moved := int((stamps[1:] < stamps[:-1]).sum()):
        notes.append(f"{what}: time goes back {moved} time(s); the rows were put in order.")
    return np.argsort(stamps, kind="stable")


def give_away(tables: Mapping[str, Table], keep: Collection[str]) -> None:
    """Let go of the columns of all topics but those to `keep`: nobody will ask for them any more."""
    for topic, table in tables.items():
        if topic not in keep:
            table.columns.clear()


Selection = Callable[[str, str, list[str]], bool]
"""Says from topic, type and dotted field names whether a topic's messages are worth decoding."""


def joined(parts: Sequence[tuple[Any, Columns]], count: int, account: Account, what: str) -> Columns:
    """Columns (count, ...) out of those of some rows each, which are given away column by column.

    Where widths differ or rows are missing, the rest is NaN (text: empty); a number where others have an array is none.
    `what` is a column to the account, with its `{name}`.
    """
    out: Columns = {}
    for name in dict.fromkeys(name for _, columns in parts for name in columns):
        some = [(rows, columns.pop(name)) for rows, columns in parts if name in columns]
        shape = max((values.shape[1:] for _, values in some), key=lambda shape: (len(shape), shape))
        dtype = np.result_type(*{values.dtype for _, values in some})
        account.take(dtype.itemsize * count * int(np.prod(shape)), what.format(name=name[:100]))
        account.check_time()
        complete = sum(len(values) for _, values in some if values.shape[1:] == shape) == count
        if not complete and dtype.kind != "S":
            dtype = np.dtype(float)
        out[name] = np.zeros((count, *shape), dtype=dtype)
        if not complete and dtype.kind == "f":
            out[name][:] = np.nan
        for rows, values in some:
            if not shape:
                out[name][rows] = values
            elif values.ndim > 1:
                out[name][rows, : values.shape[1]] = values
    return out
