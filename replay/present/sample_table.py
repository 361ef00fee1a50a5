"""The samples of a comparison as one table, for other tools."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.comparison import Comparison
from wrenchgap.replay.present.documents import atomic, claim


def frame(comparison: Comparison) -> pd.DataFrame:
    """One row for each compared sample: flight, time, then `commanded.force_x`, `measured...`, `<model>...`."""
    parts = []
    for index, record in enumerate(comparison.records):
        columns: dict[str, object] = {"flight": record.flight, "time": record.time}
        wrenches = {"commanded": record.commanded, "measured": record.measured}
        wrenches |= {e.name: e.predictions[index] for e in comparison.evaluations}
        for name, values in wrenches.items():
            columns |= {f"{name}.{axis}": values[:, k] for k, axis in enumerate(AXES)}
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def write_csv(comparison: Comparison, path: Path, *, force: bool) -> None:
    """Write `frame` as CSV, all of it or nothing."""
    claim({"--csv": path}, force=force)
    with atomic(path) as partial:
        frame(comparison).to_csv(partial, index=False, float_format="%.9g")
