"""Files with a reference trajectory: TOML, written by `wrenchgap design`, flown by `wrenchgap simulate -t FILE`.

    schema = 1
    [trajectory]    name, vehicle, duration [s], home [m, in E], attitude ("free" or "thrust")
    [[moves]]       kind, start, duration and the fields of that kind (`plant.trajectory.maneuvers`); angles in degrees,
                    keys end in _deg
    [purpose]       what the flight is for; kept as it is, no part of the motion

Reading checks every key (plant.reader). The motion is exactly that of the file: what is written has been rounded
before it was judged. docs/design-flights.md lists the keys.
"""

import csv
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomlkit
from pydantic import Field

from wrenchgap._escaping import storable
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.plant import reader
from wrenchgap.plant.reader import Number, Positive, Table, Text, Vector, expected
from wrenchgap.plant.trajectory.maneuvers import KINDS, Move, Moves, Shake

SCHEMA = 1
PAGE = "docs/design-flights.md"
ANGLES = ("angle", "azimuth", "sweep", "phase")
"""Fields of moves in rad; their keys end in _deg."""
MOST_MOVES, MOST_HARMONICS = 500, 4000
"""Of a file: `design` writes some ten moves, and a shake has some 30 harmonics. So much is sampled in a minute."""
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
    """A trajectory with its name, the vehicle that it was designed for, and its purpose (TOML values)."""

    name: str
    trajectory: Moves
    vehicle: str = ""
    purpose: Mapping[str, Any] = field(default_factory=dict)
    text: str = ""

    @property
    def sha256(self) -> str:
        """SHA-256 of the text."""
        return hashlib.sha256((self.text or dumps(self)).encode()).hexdigest()


class HeadTable(Table):
    """The table [trajectory]."""

    name: Text = ""
    vehicle: Text = ""
    duration: Positive
    home: Vector
    attitude: Annotated[Literal["free", "thrust"], expected("one of free, thrust")] = "free"


class FileTable(Table):
    """The whole file; moves are read by their kind."""

    version: Number = Field(alias="schema")
    trajectory: HeadTable
    moves: tuple[dict[str, Any], ...] = ()
    purpose: dict[str, Any] = Field({})


def load(path: Path) -> TrajectoryFile:
    """Read and check a file; UsageError in one line where something is wrong."""
    text = reader.text_of(path, "as a trajectory file", UsageError, "; `wrenchgap design` writes one")
    try:
        return loads(text)
    except UsageError as error:
        raise UsageError(f"{path.name}: {error}") from None


def loads(text: str) -> TrajectoryFile:
    """A trajectory from the text of its file."""
    document = reader.toml(text, UsageError)
    if "vehicle" in document and "trajectory" not in document:
        raise UsageError("is a model file, not a trajectory; give it with -m, and a file of `wrenchgap design` with -t")
    reader.check_schema(document, SCHEMA, UsageError)
    table = reader.read(FileTable, document, page=PAGE, error=UsageError)
    head, moves = table.trajectory, _moves(table.moves)
    plan = Moves(head.duration, head.home, moves, ATTITUDES[head.attitude])
    return TrajectoryFile(head.name or "trajectory", plan, head.vehicle, table.purpose, text)


def dumps(file: TrajectoryFile) -> str:
    """Text of the file."""
    document = tomlkit.document()
    for line in HEADER.splitlines():
        document.add(tomlkit.comment(line))
    document["schema"] = SCHEMA
    plan = file.trajectory
    attitude = next(word for word, flag in ATTITUDES.items() if flag == plan.follows_thrust)
    values = {"name": file.name, "vehicle": file.vehicle, "duration": plan.duration, "home": list(plan.home)}
    document["trajectory"] = {**values, "attitude": attitude}
    if plan.moves:
        document["moves"] = [_keys(move) for move in plan.moves]
    if file.purpose:
        document["purpose"] = dict(file.purpose)
    return storable(tomlkit.dumps(document))


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


def _moves(items: Sequence[dict[str, Any]]) -> tuple[Move, ...]:
    if len(items) > MOST_MOVES:
        raise UsageError(f"moves: got {len(items):,}, expected at most {MOST_MOVES}")
    moves, harmonics = list[Move](), 0
    for number, item in enumerate(items):
        moves.append(move := _move(item, number))
        harmonics += move.harmonics if isinstance(move, Shake) else 0
        if harmonics > MOST_HARMONICS:
            raise UsageError(
                f"moves[{number}] (shake): with the shakes before it has {harmonics:,} harmonics, expected at most "
                f"{MOST_HARMONICS:,}; narrow the bands or leave shakes out"
            )
    return tuple(moves)


def _move(item: dict[str, Any], number: int) -> Move:
    where, kind = f"moves[{number}]", item.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise UsageError(f"{where}.kind: got {kind!r}, available: {', '.join(KINDS)}")
    keys = {key: value for key, value in item.items() if key != "kind"}
    values = reader.values_of(KINDS[kind], keys, where=f"{where} ({kind})", page=PAGE, error=UsageError, degrees=ANGLES)
    try:
        return KINDS[kind](**values)
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from None
