"""The text of a model file: the user's own text with comments and order kept, its effects and history rewritten."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from datetime import UTC, datetime
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from wrenchgap._escaping import storable
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.effects import sources
from wrenchgap.plant.history import BY_HAND, GIVEN, Trial, Version
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file.command import table_of
from wrenchgap.plant.model_file.reading import SCHEMA
from wrenchgap.plant.model_file.shipped import as_argument
from wrenchgap.plant.vehicle import Rotors, Vehicle
from wrenchgap.plant.wrench_model import ModelEffect, Provenance


def content_hash(model: Model) -> str:
    """SHA-256 of the text that `dumps` writes but for the history: the same for models that say the same."""
    return hashlib.sha256(dumps(replace(model, history=())).encode()).hexdigest()


def dumps(model: Model) -> str:
    """Text of the model file: the model's own text with its effects and history replaced."""
    text = _without_effects(model.text or tomlkit.dumps(_skeleton(model)))
    tables = [_effect_lines(model.vehicle, item) for item in model.effects] + [_version_lines(v) for v in model.history]
    if (scatter := model.between_flights) is not None:
        tables.insert(0, ["[between_flights]", *_entries({"force": scatter[:3], "torque": scatter[3:]})])
    return storable(text + "".join("\n" + "\n".join(lines) + "\n" for lines in tables))


@lru_cache(maxsize=8)
def _without_effects(text: str) -> str:
    """The text of a model file without what `dumps` rewrites; cached, since parsing takes 20 ms."""
    document = tomlkit.parse(text)
    for name in ("effects", "history", "between_flights"):
        document.pop(name, None)
    return tomlkit.dumps(document).rstrip("\n") + "\n"


def toml_value(value: Any, digits: int = 9) -> str:
    """A value as TOML: numbers as floats with so many digits, lists and tables in one line."""
    if isinstance(value, str):
        return str(tomlkit.string(value).as_string())
    if isinstance(value, dict):
        return f"{{ {', '.join(_entries(value, digits))} }}"
    if np.ndim(value):
        return f"[{', '.join(toml_value(v, digits) for v in value)}]"
    text = f"{float(value):.{digits}g}"
    return text if any(c in text for c in ".e") or text in ("inf", "-inf", "nan") else text + ".0"


def _entries(table: Mapping[str, Any], digits: int = 9) -> list[str]:
    """Keys with their values; those of None are left out."""
    return [f"{key} = {toml_value(value, digits)}" for key, value in table.items() if value is not None]


def _rows(key: str, tables: Iterable[Mapping[str, Any]]) -> list[str]:
    """A list of tables, one a line."""
    return [f"{key} = [", *(f"  {toml_value(dict(table))}," for table in tables), "]"]


def _files(files: Iterable[tuple[str, str]]) -> list[dict[str, str]]:
    return [{"file": name, "sha256": sha} for name, sha in files]


def _version_lines(entry: Version) -> list[str]:
    texts = {"date": entry.date, "command": entry.command, "wrenchgap": entry.tool, "file": entry.file}
    texts |= {"content": entry.content, "parent": entry.parent}
    lines = ["[[history]]", f"version = {entry.number}", *_entries({k: text for k, text in texts.items() if text})]
    if entry.flights:
        lines += _rows("flights", _files(entry.flights))
    if entry.trial is not None:
        names = ("before", "after", "noise", "change", "t")
        lines += ["[history.held_out]", *_entries({name: getattr(entry.trial, name) for name in names})]
    for effect in entry.effects:
        lines += ["[[history.effects]]", *_entries({"name": effect.effect})]
        values = ({"name": v.name, "value": v.value, "std": v.std, "unit": v.unit} for v in effect.values)
        lines += _rows("parameters", values)
    return lines


def _effect_lines(vehicle: Vehicle, item: ModelEffect) -> list[str]:
    stds: Any = [None] * len(item.theta) if item.std is None else item.std
    given = zip(item.effect.parameters(vehicle), item.theta, stds, strict=False)
    parameters = {p.name: {"value": value, "std": std, "unit": p.unit} for p, value, std in given}
    lines = ["[[effects]]", *_entries({"name": item.name}), "[effects.parameters]", *_entries(parameters)]
    source = item.provenance
    own = source.source or sources().get(item.name)
    if own is not None:
        lines += ["[effects.source]", *_entries({"file": own.file, "sha256": own.sha256})]
    if replace(source, source=None) != Provenance():
        names = ("fitted", "version", "method")
        lines += ["[effects.provenance]", *_entries({name: getattr(source, name) or None for name in names})]
        for file in _files(source.logs):
            lines += ["[[effects.provenance.logs]]", *_entries(file)]
    return lines


def _with_tolerance(value: float | Array, tolerance: float | Array | None) -> Any:
    """A value, or a table of it and its tolerance."""
    plain = np.asarray(value).tolist()
    if tolerance is None:
        return plain
    table = tomlkit.inline_table()
    table.update({"value": plain, "tolerance": np.asarray(tolerance).tolist()})
    return table


def _skeleton(model: Model) -> tomlkit.TOMLDocument:
    """A document for a model without a file."""
    v = model.vehicle
    t, body = v.tolerances, v.body
    vehicle: dict[str, Any] = {"name": v.name, "mass": _with_tolerance(body.mass, t.mass)}
    vehicle |= {"inertia": _with_tolerance(body.inertia, t.inertia), "com": _with_tolerance(body.com_B, t.com)}
    vehicle["imu_position"] = _with_tolerance(v.imu_position_B, t.imu_position)
    if t.thrust is not None:
        vehicle["thrust_tolerance"] = t.thrust
    if t.thrust_axis is not None:
        vehicle["thrust_axis_tolerance_deg"] = float(np.degrees(t.thrust_axis))
    document = tomlkit.document()
    document["schema"] = SCHEMA
    if model.unmeasured:
        document["unmeasured"] = list(model.unmeasured)
    if model.cutoff_hz is not None:
        document["cutoff_hz"] = model.cutoff_hz
    document["vehicle"] = tomlkit.item(vehicle)
    if v.arms is not None and v.rotors is not None:
        arms = tomlkit.aot()
        for i in range(len(v.arms)):
            limits = {"min": v.arms.tilt_min, "max": v.arms.tilt_max, "rate": v.arms.tilt_rate_max}
            named = {"name": v.arm_names[i]} if v.named("arm", i) else {}
            arm = {
                **named,
                "position": v.arms.position_B[i].tolist(),
                "tilt_axis": v.arms.axis_B[i].tolist(),
                "thrust_direction": v.arms.normal_B[i].tolist(),
                "tilts": bool(v.arms.tilts[i]),
                **{f"tilt_{key}_deg": float(np.degrees(values[i])) for key, values in limits.items()},
            }
            names = [item.name for item in fields(Rotors) if item.name != "arm"]
            rotors = tomlkit.array()
            for r in np.flatnonzero(v.rotors.arm == i):
                row = tomlkit.inline_table()
                if called := v.named("rotor", int(r)):
                    row["name"] = called
                row.update({name: float(getattr(v.rotors, name)[r]) for name in names})
                rotors.append(row)
            table = tomlkit.item(arm)
            table["rotors"] = rotors
            arms.append(table)
        document["vehicle"]["arms"] = arms
    for key, part in (("controller", model.controller), ("sensors", model.sensors)):
        values = {item.name: getattr(part, item.name) for item in fields(part)}
        document[key] = {k: list(x) if isinstance(x, tuple | np.ndarray) else x for k, x in values.items()}
    if model.command is not None:
        document["command"] = tomlkit.item(table_of(model.command))
    for key, by_role in (("topics", model.topics), ("shifts", model.shifts)):
        if by_role:
            document[key] = dict(by_role)
    return document


def with_reading(
    model: Model,
    topics: Mapping[str, str],
    shifts: Mapping[str, float],
    cutoff_hz: float | None = None,
    unmeasured: Sequence[str] = (),
) -> Model:
    """The model with how logs of its vehicle are read, in its text too, beside or in place of what it said before."""
    said: dict[str, Any] = {"topics": {**model.topics, **topics}, "shifts": {**model.shifts, **shifts}}
    said |= {"cutoff_hz": cutoff_hz or model.cutoff_hz}
    said |= {"unmeasured": tuple(axis for axis in AXES if axis in (*model.unmeasured, *unmeasured))}
    document = tomlkit.parse(model.text or tomlkit.dumps(_skeleton(model)))
    for key, value in said.items():
        if isinstance(value, dict) and key in document:
            document[key].update(value)
        elif value:
            document[key] = list(value) if isinstance(value, tuple) else value
    return replace(model, **said, text=tomlkit.dumps(document))


def next_version(
    parent: Model,
    model: Model,
    *,
    command: str,
    path: Path,
    flights: Sequence[tuple[str, str]] = (),
    trial: Trial | None = None,
) -> Model:
    """`model` with the history of `parent` and one more version: itself, by `command`, in the file `path`.

    A parent without history becomes the first version; one that was changed since its last version gets a version
    for that.
    """
    versions = list(parent.history)
    content = content_hash(parent)
    if not versions or versions[-1].content != content:
        reason, before = (BY_HAND, versions[-1].content) if versions else (GIVEN, "")
        number, file = versions[-1].number + 1 if versions else 1, "" if parent.path is None else as_argument(parent)
        versions.append(Version(number, reason, content, file, before, effects=parent.snapshot))
    last = versions[-1]
    new = Version(
        last.number + 1, command, content_hash(model), str(path), last.content,
        utc_now(), tool_version(), tuple(flights), trial, model.snapshot,
    )  # fmt: skip
    return replace(model, history=(*versions, new))


def changed_since(model: Model) -> bool:
    """Whether the file was changed by hand after its last version was written."""
    return bool(model.history) and model.history[-1].content != content_hash(model)


def provenance_now(method: str, logs: Sequence[tuple[str, str]] = ()) -> Provenance:
    """Of values that are put into a model now: how, and fitted to which logs (file, SHA-256)."""
    return Provenance(tuple(logs), utc_now(), tool_version(), method)


def utc_now() -> str:
    """The time now, UTC, as files say it."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def tool_version() -> str:
    """Version of wrenchgap, for provenance."""
    try:
        return version("wrenchgap")
    except PackageNotFoundError:
        return "unknown"
