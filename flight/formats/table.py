"""One topic's messages as columns: what every format becomes before anything is known of flights."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Table:
    """One topic's messages: N log times [ns] and, where the topic was wanted, its fields as columns.

    `header_ns` are the header's stamps [ns], or None where the type has none or nobody filled it in. `problem` says
    why a wanted topic could not be decoded. Rows are in the order of the log time.
    """

    topic: str
    type: str
    log_time_ns: NDArray[np.int64]
    header_ns: NDArray[np.int64] | None = None
    columns: Columns = field(default_factory=dict)
    problem: str | None = None

    def __len__(self) -> int:
        return len(self.log_time_ns)


def give_away(tables: Mapping[str, Table], keep: Collection[str]) -> None:
    """Let go of the columns of all topics but those to `keep`: nobody will ask for them any more."""
    for topic, table in tables.items():
        if topic not in keep:
            table.columns.clear()


Selection = Callable[[str, str, list[str]], bool]
"""Says from topic, type and dotted field names whether a topic's messages are worth decoding."""
