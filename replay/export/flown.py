"""A flight of an exported compensation, proved: its C is stepped again from the state and the input of every record.

What a record is, and how it is logged, says `wrenchgap_record.h` in the exported folder. Records are found in any log,
by their first bytes and their checksum: a file of records, a topic of bytes in an MCAP or a bag, a field of a ULog.
"""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.arguments import check_arguments
from wrenchgap.flight.budget import Budget
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Array
from wrenchgap.flight.result import Result
from wrenchgap.replay.export import records as recording
from wrenchgap.replay.export.records import HEAD, OUTPUT, PRECISION, record_type

WRENCHES = ("wrench_cmd", "correction", "optimum", "expected", "estimate")
STATUS = ("WG_OK", "WG_BAD_INPUT", "WG_NOT_ACCEPTED", "WG_NO_NUMBER", "WG_UNREACHABLE")


class Deviation(NamedTuple):
    """A number that the export does not make: of which period, in the units of `wg_output`, with both status."""

    number: int
    time: float
    quantity: str
    flown: float
    made: float
    status_flown: str
    status_made: str


@dataclass(frozen=True, repr=False)
class FlownExport(Result):
    """K recorded periods of an exported compensation, beside what its C makes of their states and inputs.

    flown, made   (K,) structured arrays, as `record_type` has them; `made` has the state after the period
    reset         (1,) the state that wg_reset leaves
    tolerance     of two builds [N, Nm], and `tolerance_of_beta`
    damaged       places that begin like a record and are none
    repeated      records that repeat others, byte for byte, and were left out
    others        records of other exports, by their ids
    """

    path: Path
    folder: Path
    export: str
    precision: str
    flown: NDArray[np.void]
    made: NDArray[np.void]
    reset: NDArray[np.void]
    tolerance: float
    tolerance_of_beta: float
    damaged: int
    repeated: int
    others: dict[str, int]

    def __len__(self) -> int:
        return len(self.flown)

    @cached_property
    def identical(self) -> NDArray[np.bool_]:
        """(K,) whether all that was put out is the same to the last bit, and the state is the one that was left."""
        names = (*OUTPUT, "evaluations", "status")
        parts = [_rows(_bits(self.flown[n]) == _bits(self.made[n])) for n in names]
        same = _rows(_bits(self.flown["state"]) == _bits(self._before("state")))
        return np.asarray(np.all([*parts, same | ~self.follows], axis=0))

    @cached_property
    def apart(self) -> Array:
        """(K,) largest difference of command, correction, optimum, expected wrench and estimate [N, Nm], and of the
        mismatch that is left, the root of `cost`.
        """  # noqa: D205
        parts = [_largest(self.flown[n], self.made[n]) for n in WRENCHES]
        return np.asarray(np.max([*parts, _largest(np.sqrt(self.flown["cost"]), np.sqrt(self.made["cost"]))], axis=0))

    @cached_property
    def agrees(self) -> NDArray[np.bool_]:
        """(K,) whether the outputs are the same within the tolerances, and the status."""
        gates = [_largest(self.flown[n], self.made[n]) for n in ("sigma", "beta")]
        scale = np.maximum(1.0, np.abs(self.made["sigma"].astype(float)))
        return np.asarray(
            (self.apart <= self.tolerance)
            & (gates[0] <= self.tolerance_of_beta * scale)
            & (gates[1] <= self.tolerance_of_beta)
            & (self.flown["status"] == self.made["status"])
        )

    @cached_property
    def at_reset(self) -> NDArray[np.bool_]:
        """(K,) whether the state is the one that wg_reset leaves; a refused period may leave the same."""
        return _rows(self.flown["state"] == self.reset["state"]) & _rows(self.flown["counts"] == self.reset["counts"])

    @cached_property
    def steps(self) -> NDArray[np.int32]:
        """(K,) by how much `number` goes up from the record before, modulo 2^32; 1 for the first."""
        return np.concatenate((np.ones(1, np.int32), np.diff(self.flown["number"]).astype(np.uint32).view(np.int32)))

    @cached_property
    def restarts(self) -> NDArray[np.bool_]:
        """(K,) whether the count starts again: with the state of wg_reset, at the first number of the run or below."""
        out, first = np.zeros(len(self), bool), int(self.flown["number"][0])
        for k in np.flatnonzero((self.steps <= 0) & self.at_reset):
            number = int(self.flown["number"][k])
            if _ahead(number, first) <= 0:
                out[k], first = True, number
        return out

    @cached_property
    def ordered(self) -> NDArray[np.bool_]:
        """(K,) whether `number` goes up, or starts again."""
        return (self.steps > 0) | self.restarts

    @cached_property
    def follows(self) -> NDArray[np.bool_]:
        """(K,) whether the period before is the record before, and nobody called wg_reset between them."""
        return (np.arange(len(self)) > 0) & (self.steps <= 1) & ~self.at_reset

    @cached_property
    def begins(self) -> NDArray[np.bool_]:
        """(K,) whether a run is known to begin here: with wg_reset, whose state the period before did not leave."""
        left = _rows(self._before("state") == self.reset["state"]) & _rows(
            self._before("counts") == self.reset["counts"]
        )
        first = np.arange(len(self)) == 0
        return np.asarray(self.at_reset & (first | self.restarts | ((self.steps == 1) & ~left)))

    def _before(self, name: str) -> NDArray[Any]:
        """(K, ...) what the period before left or put out; of the first record its own."""
        return np.concatenate((self.flown[name][:1], self.made[name][:-1]))

    @cached_property
    def pushed(self) -> Array:
        """(K, numbers of the state) what was added to the state since the period before, beyond what two builds differ
        by: what their outputs do, and the last places. Zero where that is not known (`follows`).
        """  # noqa: D205
        flown, made = self.flown["state"].astype(float), self._before("state").astype(float)
        with np.errstate(invalid="ignore", over="ignore"):
            apart = np.concatenate(([0.0], self.apart[:-1]))[:, None] * np.maximum(1.0, np.abs(made))
            added = np.where((flown == made) | (np.isnan(flown) & np.isnan(made)), 0.0, flown - made)
            beyond = np.maximum(np.abs(added) - apart - self._rounding * np.abs(made), 0.0)
            return np.where(self.follows[:, None], np.sign(added) * beyond, 0.0)

    @cached_property
    def _rounding(self) -> float:
        """By how much a state may differ between two builds of one step, besides what their outputs differ: 16 units in
        the last place, sums of some ten terms. Measured: 2 (-O3 with fused multiplication against -O2).
        """  # noqa: D205
        return 16.0 * float(np.finfo(self.flown["state"].dtype.base).eps)

    @cached_property
    def continues(self) -> NDArray[np.bool_]:
        """(K,) whether the state is the one that the period before left, also when what is added in many periods is put
        together, or that of wg_reset; true where the period before is not recorded.
        """  # noqa: D205
        little = np.abs(self.pushed) <= self._rounding
        total = np.cumsum(np.where(little, self.pushed, 0.0), axis=0)
        start = np.maximum.accumulate(np.where(self.follows, 0, np.arange(len(self))))
        size = np.maximum(1.0, np.abs(self._before("state").astype(float)))
        near = little & (np.abs(total - total[start]) <= self.tolerance * size)
        same = _rows(near) & _rows(self.flown["counts"] == self._before("counts"))
        return np.asarray(same | ~self.follows)

    @cached_property
    def state_apart(self) -> float:
        """Largest difference of a number of the state from what the period before left, beyond what outputs explain."""
        return float(np.nan_to_num(np.abs(self.pushed), nan=np.inf).max(initial=0.0))

    @property
    def proved(self) -> bool:
        """Whether this export made every output, and nothing else changed its state between two periods."""
        return bool(self.agrees.all() and self.continues.all() and self.ordered.all())

    @cached_property
    def lost(self) -> int:
        """Periods between the first and the last record that are not recorded."""
        return int(np.sum(self.steps[self.steps > 1].astype(np.int64) - 1))

    @property
    def statuses(self) -> dict[str, int]:
        """How many periods ended with which status."""
        return {_status(s): n for s, n in sorted(Counter(self.flown["status"].tolist()).items())}

    def deviations(self, most: int) -> list[Deviation]:
        """The largest deviation of each of the first `most` periods that do not agree."""
        return [_deviation(self.flown[k], self.made[k]) for k in np.flatnonzero(~self.agrees)[:most]]


@check_arguments
def prove_flown(log: str | Path, folder: str | Path, *, budget: Budget | str | None = None) -> FlownExport:
    """Step the exported C in `folder` again from the records in `log`, and compare.

    It compiles and runs the code of that folder, which is the code that was flown. Raises UsageError for a folder that
    is no export, was changed since, or cannot be compiled, and LogError for a log without records of it.
    """
    path, place = Path(log), Path(folder)
    export, contents = recording.checked_export(place)
    records, damaged = recording.read_records(path, budget)
    heads = np.frombuffer(b"".join(r[: HEAD.itemsize] for r in records), HEAD)
    ids = [bytes(one).hex() for one in heads["export"]]
    own, repeated = _without_repeats([r for r, one in zip(records, ids, strict=True) if one == export])
    others = {one: n for one, n in Counter(ids).items() if one != export}
    if not own:
        raise LogError(
            f"{path}: its {len(records)} records are of the export {in_short(others)}, and {place} is {export}; "
            "name the folder that was flown"
        )
    kinds = {r[: HEAD.itemsize - 4] for r in own}
    if len(kinds) > 1:
        raise LogError(f"{path}: its records are of {len(kinds)} builds of one export; expected one; cut the log apart")
    kind = record_type(*recording.sizes_of(np.frombuffer(own[0][: HEAD.itemsize], HEAD)[0]))
    flown = np.frombuffer(b"".join(own), kind)
    tolerances, made = recording.stepped(place, contents, own, PRECISION[int(flown["real"][0])], kind)
    return FlownExport(
        path=path,
        folder=place,
        export=export,
        precision=PRECISION[int(flown["real"][0])],
        flown=flown,
        made=made[1:],
        reset=made[:1],
        tolerance=tolerances[0],
        tolerance_of_beta=tolerances[1],
        damaged=damaged,
        repeated=repeated,
        others=others,
    )


def in_short(others: dict[str, int], most: int = 3) -> str:
    """At `most` so many of the ids of other exports, and how many more there are."""
    more = f" and {len(others) - most:,} more" if len(others) > most else ""
    return ", ".join(sorted(others)[:most]) + more


def _without_repeats(records: list[bytes]) -> tuple[list[bytes], int]:
    """Records without those that a second topic or a copy repeats, and how many these are.

    Two runs may begin with the same bytes. What comes again is a repeat where the next new record goes on from the last
    one before it, or there is none; else it is the beginning of another run.
    """
    out: list[bytes] = []
    again: list[bytes] = []
    seen: set[bytes] = set()
    repeated = 0
    for one in records:
        if one in seen:
            again.append(one)
            continue
        numbers = [int(np.frombuffer(r[: HEAD.itemsize], HEAD)["number"][0]) for r in (one, *out[-1:])]
        if again and _ahead(*numbers) <= 0:
            out += again
        else:
            repeated += len(again)
        again = []
        out.append(one)
        seen.add(one)
    return out, repeated + len(again)


def _ahead(number: int, other: int) -> int:
    """By how much a count of 32 bits is ahead of another."""
    return (number - other + 2**31) % 2**32 - 2**31


def _deviation(flown: np.void, made: np.void) -> Deviation:
    """The number of a record that is furthest from what the export makes."""
    names = [f"{name}[{i}]" if size > 1 else name for name, size in OUTPUT.items() for i in range(size)]
    one, other = (np.concatenate([np.ravel(row[name]) for name in OUTPUT]).astype(float) for row in (flown, made))
    apart = np.where(one == other, 0.0, np.abs(one - other))
    worst = int(np.argmax(np.nan_to_num(apart, nan=np.inf)))
    status = [_status(int(row["status"])) for row in (flown, made)]
    return Deviation(
        int(flown["number"]), float(flown["time"]), names[worst], float(one[worst]), float(other[worst]), *status
    )


def _bits(values: NDArray[Any]) -> NDArray[Any]:
    return values.view(f"<u{values.dtype.itemsize}")


def _rows(same: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether all of a row are true."""
    return np.asarray(same if same.ndim == 1 else same.all(axis=1))


def _largest(one: NDArray[Any], other: NDArray[Any]) -> Array:
    """Largest difference of each row; none where both are the same or no number, infinite where one is none."""
    first, second = one.astype(float), other.astype(float)
    apart = np.where((first == second) | (np.isnan(first) & np.isnan(second)), 0.0, np.abs(first - second))
    apart = np.nan_to_num(apart, nan=np.inf, posinf=np.inf)
    return apart if apart.ndim == 1 else apart.max(axis=1)


def _status(number: int) -> str:
    return STATUS[number] if 0 <= number < len(STATUS) else f"status {number}"
