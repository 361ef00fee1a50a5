"""Files with a reference trajectory: TOML, written by `wrenchgap design`, flown by `wrenchgap simulate -t FILE`.

    schema = 1
    [trajectory]    name, vehicle, duration [s], home [m, in E], attitude ("free" or "thrust")
    [[moves]]       kind, start, duration and what the kind needs (plant.moves); angles in degrees, keys end in _deg
    [purpose]       what the flight is for; kept as it is, no part of the motion

Reading checks every key. The motion is exactly that of the file: what is written has been rounded before it was
judged. docs/design-flights.md lists the keys.
"""

from __future__ import annotations

import csv
import difflib
import hashlib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import NDArray
from tomlkit.exceptions import ParseError

from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.moves import KINDS, Move, Moves

Array = NDArray[np.float64]

SCHEMA = 1
ANGLES = ("angle", "azimuth", "sweep", "phase")
"""Fields of moves in rad; their keys end in _deg."""
ATTITUDES = {"free": False, "thrust": True}
HEADER = (
    "Reference trajectory for wrenchgap simulate -t. Moves begin and end at rest; moves that overlap in time add.\n"
    "Positions are metres in E (z up), times seconds. Keys: docs/design-flights.md."
)
COLUMNS = (
    *("time_s", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz", "vx_m_s", "vy_m_s", "vz_m_s"),
    *("wx_rad_s", "wy_rad_s", "wz_rad_s", "ax_m_s2", "ay_m_s2", "az_m_s2"),
    *("wdotx_rad_s2", "wdoty_rad_s2", "wdotz_rad_s2"),
)
"""Columns of `sampled`: position, velocity, acceleration of O in E; attitude; rates and their derivatives in D."""


@dataclass(frozen=True)
class TrajectoryFile:
    """A trajectory with its name, the vehicle that it was made for, and what it is for (plain TOML values)."""

    name: str
    trajectory: Moves
    vehicle: str = ""
    purpose: Mapping[str, Any] = field(default_factory=dict)
    text: str = ""

    @property
    def sha256(self) -> str:
        """Of its text."""
        return hashlib.sha256((self.text or dumps(self)).encode()).hexdigest()


def load(path: Path) -> TrajectoryFile:
    """Read and check a file; UsageError in one line where something is wrong."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "is not text"
        raise UsageError(
            f"{path}: cannot be read as a trajectory file: {reason}; `wrenchgap design` writes one"
        ) from None
    try:
        return loads(text)
    except UsageError as error:
        raise UsageError(f"{path.name}: {error}") from None


def loads(text: str) -> TrajectoryFile:
    """A trajectory from the text of its file."""
    try:
        document = tomlkit.parse(text).unwrap()
    except ParseError as error:
        raise UsageError(f"is not TOML: {error}") from None
    if "vehicle" in document and "trajectory" not in document:
        raise UsageError("is a model file, not a trajectory; give it with -m, and a file of `wrenchgap design` with -t")
    _known(document, ("schema", "trajectory", "moves", "purpose"), "")
    schema = document.get("schema")
    if schema != SCHEMA:
        raise UsageError(f"schema: got {schema!r}, this version of wrenchgap reads {SCHEMA}")
    head = _table(document, "trajectory")
    _known(head, ("name", "vehicle", "duration", "home", "attitude"), "trajectory.")
    attitude = head.get("attitude", "free")
    if attitude not in ATTITUDES:
        raise UsageError(f"trajectory.attitude: got {attitude!r}, expected one of {', '.join(ATTITUDES)}")
    listed = document.get("moves", [])
    if not isinstance(listed, list):
        raise UsageError("moves: expected tables [[moves]], one for each move")
    duration = _number(head, "duration", "trajectory.")
    if duration <= 0:
        raise UsageError(f"trajectory.duration: got {duration:g} s, expected more than 0 s")
    moves = Moves(
        duration,
        _vector(head, "home", "trajectory."),
        tuple(_move(item, number) for number, item in enumerate(listed)),
        ATTITUDES[attitude],
    )
    names = [str(head.get(key, "")) for key in ("name", "vehicle")]
    return TrajectoryFile(names[0] or "trajectory", moves, names[1], dict(document.get("purpose", {})), text)


def dumps(file: TrajectoryFile) -> str:
    """Text of the file."""
    document = tomlkit.document()
    for line in HEADER.splitlines():
        document.add(tomlkit.comment(line))
    document["schema"] = SCHEMA
    plan = file.trajectory
    head = tomlkit.table()
    attitude = next(word for word, flag in ATTITUDES.items() if flag == plan.follows_thrust)
    values = {"name": file.name, "vehicle": file.vehicle, "duration": plan.duration, "home": list(plan.home)}
    head.update({**values, "attitude": attitude})
    document["trajectory"] = head
    if plan.moves:
        listed = tomlkit.aot()
        for move in plan.moves:
            listed.append(tomlkit.item(_keys(move)))
        document["moves"] = listed
    if file.purpose:
        document["purpose"] = dict(file.purpose)
    return tomlkit.dumps(document)


def sampled(file: TrajectoryFile, rate_hz: float) -> Array:
    """The reference at `rate_hz`, (N, 20) with the columns `COLUMNS`."""
    plan = file.trajectory
    r = plan.at(np.arange(round(plan.duration * rate_hz) + 1) / rate_hz)
    parts = (r.position_E, r.quat_ED, r.velocity_E, r.omega_D, r.acceleration_E, r.omega_dot_D)
    return np.column_stack((r.time, *parts))


def write_csv(file: TrajectoryFile, path: Path, rate_hz: float) -> None:
    """`sampled` as a table for other flight stacks."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        writer.writerows([f"{value:.9g}" for value in row] for row in sampled(file, rate_hz))


def _keys(move: Move) -> dict[str, Any]:
    """A move as TOML values; angles in degrees, and numbers without the noise of the conversion."""
    out: dict[str, Any] = {"kind": move.kind}
    for item in fields(move):
        value = getattr(move, item.name)
        if item.name in ANGLES:
            out[f"{item.name}_deg"] = round(float(np.degrees(value)), 9)
        else:
            out[item.name] = list(value) if isinstance(value, tuple) else value
    return out


def _move(item: Any, number: int) -> Move:
    """One move of the file."""
    where = f"moves[{number}]"
    if not isinstance(item, dict):
        raise UsageError(f"{where}: expected a table [[moves]]")
    kind = item.get("kind")
    if kind not in KINDS:
        raise UsageError(f"{where}.kind: got {kind!r}, available: {', '.join(KINDS)}")
    cls = KINDS[kind]
    keys = {f"{f.name}_deg" if f.name in ANGLES else f.name: f for f in fields(cls)}
    _known(item, ("kind", *keys), f"{where} ({kind}): ")
    values: dict[str, Any] = {}
    for key, spec in keys.items():
        if key not in item and spec.default is not MISSING:
            continue
        prefix = f"{where} ({kind}): "
        if spec.name == "by":
            values[spec.name] = _vector(item, key, prefix)
        elif spec.name == "axes":
            values[spec.name] = _texts(item, key, prefix)
        elif spec.name == "seed":
            values[spec.name] = round(_number(item, key, prefix))
        else:
            value = _number(item, key, prefix)
            values[spec.name] = float(np.radians(value)) if spec.name in ANGLES else value
    try:
        return cls(**values)
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from None


def _known(table: Mapping[str, Any], keys: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in keys:
            near = difflib.get_close_matches(key, keys, 1)
            meant = f"did you mean {near[0]!r}?" if near else f"available: {', '.join(keys)}"
            raise UsageError(f"{where}{key} is not known; {meant}")


def _table(table: Mapping[str, Any], key: str) -> dict[str, Any]:
    value = table.get(key)
    if not isinstance(value, dict):
        raise UsageError(f"[{key}]: is missing; a file of `wrenchgap design` has it")
    return value


def _number(table: Mapping[str, Any], key: str, where: str) -> float:
    value = table.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        got = "is missing" if value is None else f"got {value!r}"
        raise UsageError(f"{where}{key}: {got}, expected a finite number")
    return float(value)


def _vector(table: Mapping[str, Any], key: str, where: str) -> tuple[float, float, float]:
    value = table.get(key)
    if not isinstance(value, list) or len(value) != 3:
        raise UsageError(f"{where}{key}: {'is missing' if value is None else f'got {value!r}'}, expected three numbers")
    x, y, z = (_number({key: part}, key, where) for part in value)
    return x, y, z


def _texts(table: Mapping[str, Any], key: str, where: str) -> tuple[str, ...]:
    value = table.get(key)
    if not isinstance(value, list) or not all(isinstance(part, str) for part in value):
        raise UsageError(f"{where}{key}: got {value!r}, expected a list of names")
    return tuple(value)
