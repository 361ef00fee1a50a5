"""A log with a fault, opened as every command opens it: whether it is named, and whether what is proposed mends it."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.meaning.answers import answer
from benchmarks.meaning.faults import SAME, Fault
from wrenchgap import load_model, save_log
from wrenchgap.flight.check import Check
from wrenchgap.flight.errors import WrenchgapError
from wrenchgap.flight.flight import Flight
from wrenchgap.learn.data.opening import OpenFlight, open_flights

HARMLESS = ("roles", "gaps", "left-out", "weight", "clock", "jitter")
"""Warnings that healthy logs may have: no odometry, no IMU, an offset of clocks."""

MENDS = 3
"""Options that a user would follow one after the other."""
REFUSED = re.compile(r"; read it with (.*), or take it as it is")


@dataclass(frozen=True)
class Row:
    """One log: `stopped` is the one line of the refusal, `found` the checks that are not ok.

    `firm` and `wrong` are those of `benchmarks.meaning.answers`, where it was asked for and the log was not refused.
    `named`: the fault was said by a check that means it. `seen`: anything was said. `mended`: with the option that was
    proposed the log is healthy (None: none was proposed).
    """

    vehicle: str
    fault: str
    stopped: str
    found: tuple[str, ...]
    named: bool
    seen: bool
    mend: str | None
    mended: bool | None
    firm: tuple[str, ...] | None = None
    wrong: str = ""


def judge(vehicle: str, flight: Flight, model: str, fault: Fault, folder: Path, *, ask: bool = False) -> Row:
    """Write it, open it, mend it; with `ask` explain it too, if it can be opened."""
    folder.mkdir(parents=True, exist_ok=True)
    changed = flight if fault.flight is None else fault.flight(flight)
    log, model_path = folder / "log.mcap", folder / "vehicle.toml"
    save_log(replace(changed, reference=None, desired=None), log, force=True)
    if fault.file is not None:
        fault.file(log)
    beside = []
    if fault.again is not None:
        beside = [folder / "again.mcap"]
        save_log(replace(fault.again(changed), reference=None, desired=None), beside[0], force=True)
    model_path.write_text(model if fault.model is None else fault.model(model), encoding="utf-8")
    stopped, checks = _opened([log, *beside], model_path)
    said = [check for check in checks if check.level != "ok" and check.name not in HARMLESS]
    named = any(check.name in fault.named for check in said) or any(f": {name}:" in stopped for name in fault.named)
    named = named or any(name == SAME and f"is {name} as" in stopped for name in fault.named)
    mends = [check for check in said if check.mend and check.name in fault.named]
    refused = REFUSED.search(stopped)
    mend = mends[0].mend if mends else refused[1] if refused else None
    mended = None if mend is None else _mended(log, model_path, mend)
    names = tuple(dict.fromkeys(check.name for check in said))
    row = Row(vehicle, fault.name, stopped, names, named, bool(said or stopped), mend, mended)
    if not ask or stopped:
        return row
    loaded = load_model(model_path)
    found = answer(open_flights([log], loaded)[0], loaded)
    return replace(row, firm=found.firm, wrong=found.wrong)


def _opened(logs: Sequence[Path], model: Path, **how: Any) -> tuple[str, Sequence[Check]]:
    """The refusal, and every check of the first log (asked again without the gate where it refused)."""
    try:
        loaded = load_model(model)
    except WrenchgapError as error:
        return f": inertia: {error}" if "moment" in str(error) else str(error), ()
    try:
        opened: OpenFlight = open_flights(logs, loaded, **how)[0]
    except WrenchgapError as error:
        try:
            return str(error), open_flights(logs[:1], loaded, gate=False, **how)[0].checks
        except WrenchgapError:
            return str(error), ()
    return "", opened.checks


def _mended(log: Path, model: Path, options: str) -> bool:
    """Whether the proposed options make the log pass, a second fault that they bring to light mended likewise."""
    how: dict[str, Any] = {"topics": {}}
    for _ in range(MENDS):
        words = shlex.split(options)
        said = list(zip(words[::2], words[1::2], strict=True))
        how["topics"] |= dict(word.split("=", 1) for flag, word in said if flag == "--topic")
        for flag, word in said:
            how |= {"cutoff_hz": float(word)} if flag == "--cutoff" else {}
            how |= {"unmeasured": word.split(",")} if flag == "--unmeasured" else {}
        stopped, _ = _opened([log], model, **how)
        refused = REFUSED.search(stopped)
        if refused is None:
            return not stopped
        options = refused[1]
    return False


def plain(row: Row) -> dict[str, Any]:
    """For JSON."""
    return asdict(row)


def read(row: dict[str, Any]) -> Row:
    """Of JSON."""
    firm = row.get("firm")
    return Row(**{**row, "found": tuple(row["found"]), "firm": None if firm is None else tuple(firm)})
