"""What a process looks at on recorded flights: the command, and what it was told to look at besides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.measurement import Record, low_pass
from wrenchgap.plant.mismatch_inputs import POSED, extra_inputs


def check(names: Sequence[str], record: Record) -> None:
    """Raise FitError for a group that needs a pose where the log has none."""
    missing = [name for name in names if name in POSED]
    if missing and not record.has_pose:
        raise FitError(
            f"{record.flight}: input {', '.join(missing)} needs odometry, which the log lacks; map it with "
            "--topic odometry=/your/topic, or learn a GP without this input (--inputs)"
        )


def process_inputs(names: Sequence[str], record: Record) -> Array:
    """Commands (K, 6) and the columns of the groups `names` behind them, filtered as the measurement is.

    Raises FitError for a group that needs a pose where the log has none.
    """
    if not names:
        return record.commanded
    check(names, record)
    wrench = record.commands.wrench_B
    sent = np.concatenate((wrench[:1], wrench[:-1]))
    extra, _ = extra_inputs(names, sent, record.state, record.dt)
    return np.hstack((record.commanded, low_pass(extra, record.dt, record.cutoff_hz)[record.keep]))


def pooled_inputs(names: Sequence[str], records: Sequence[Record]) -> Array:
    """Of all records, one after the other."""
    return np.concatenate([process_inputs(names, record) for record in records])
