"""The text of a model file: the user's own text with comments and order kept, its effects and history rewritten."""

import hashlib
from collections.abc import Sequence
from dataclasses import fields, replace
from datetime import UTC, datetime
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from wrenchgap._escaping import storable
from wrenchgap.flight.flight import Array
from wrenchgap.plant.effects import sources
from wrenchgap.plant.history import BY_HAND, GIVEN, Trial, Version
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file.command import table_of
from wrenchgap.plant.model_file.reading import SCHEMA
from wrenchgap.plant.vehicle import Rotors, Vehicle
from wrenchgap.plant.wrench_model import ModelEffect, Provenance


def content_hash(model: Model) -> str:
    """SHA-256 of the text that `dumps` writes but for the history: the same for models that say the same."""
    return hashlib.sha256(dumps(replace(model, history=())).encode()).hexdigest()


def dumps(model: Model) -> str:
    """Text of the model file: the model's own text with its effects and history replaced."""
    text = _without_effects(model.text or tomlkit.dumps(_skeleton(model)))
    if model.between_flights is not None:
        text += "\n" + _between_flights_text(model.between_flights)
    for item in model.effects:
        text += "\n" + _effect_text(model.vehicle, item)
    for entry in model.history:
        text += "\n" + _version_text(entry)
    return storable(text)


@lru_cache(maxsize=8)
def _without_effects(text: str) -> str:
    """The text of a model file without what `dumps` rewrites; cached, since parsing takes 20 ms."""
    document = tomlkit.parse(text)
    for name in ("effects", "history", "between_flights"):
        document.pop(name, None)
    return tomlkit.dumps(document).rstrip("\n") + "\n"


def _between_flights_text(scatter: Sequence[float]) -> str:
    rows = (("force", scatter[:3]), ("torque", scatter[3:]))
    lines = [f"{key} = [{', '.join(_number(v) for v in values)}]" for key, values in rows]
    return "\n".join(["[between_flights]", *lines]) + "\n"


def _version_text(entry: Version) -> str:
    texts = {
        "date": entry.date,
        "command": entry.command,
        "wrenchgap": entry.tool,
        "file": entry.file,
        "content": entry.content,
        "parent": entry.parent,
    }
    lines = ["[[history]]", f"version = {entry.number}"]
    lines += [f"{key} = {_text(value)}" for key, value in texts.items() if value]
    if entry.flights:
        rows = [f"{{ file = {_text(file)}, sha256 = {_text(sha)} }}" for file, sha in entry.flights]
        lines += ["flights = [", *(f"  {row}," for row in rows), "]"]
    if entry.trial is not None:
        trial = entry.trial
        lines.append("[history.held_out]")
        for key, values in (("before", trial.before), ("after", trial.after), ("noise", trial.noise)):
            lines.append(f"{key} = [{', '.join(_number(v) for v in values)}]")
        lines += [f"change = {_number(trial.change)}", f"t = {_number(trial.t)}"]
    for effect in entry.effects:
        lines += ["[[history.effects]]", f"name = {_text(effect.effect)}", "parameters = ["]
        for v in effect.values:
            std = "" if v.std is None else f", std = {_number(v.std)}"
            lines.append(f"  {{ name = {_text(v.name)}, value = {_number(v.value)}{std}, unit = {_text(v.unit)} }},")
        lines.append("]")
    return "\n".join(lines) + "\n"


def _text(value: str) -> str:
    return str(tomlkit.string(value).as_string())


def _effect_text(vehicle: Vehicle, item: ModelEffect) -> str:
    lines = ["[[effects]]", f"name = {_text(item.name)}", "[effects.parameters]"]
    for k, parameter in enumerate(item.effect.parameters(vehicle)):
        std = f", std = {_number(item.std[k])}" if item.std is not None else ""
        value = f"{{ value = {_number(item.theta[k])}{std}, unit = {_text(parameter.unit)} }}"
        lines.append(f"{parameter.name} = {value}")
    own = item.provenance.source or sources().get(item.name)
    if own is not None:
        lines += ["[effects.source]", f"file = {_text(own.file)}", f"sha256 = {_text(own.sha256)}"]
    source = item.provenance
    if replace(source, source=None) != Provenance():
        lines += [
            "[effects.provenance]",
            f"fitted = {_text(source.fitted)}",
            f"version = {_text(source.version)}",
            f"method = {_text(source.method)}",
        ]
        for file, sha in source.logs:
            lines += ["[[effects.provenance.logs]]", f"file = {_text(file)}", f"sha256 = {_text(sha)}"]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """A TOML float that keeps nine digits."""
    text = f"{float(value):.9g}"
    return text if any(c in text for c in ".e") or text in ("inf", "-inf", "nan") else text + ".0"


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
    document = tomlkit.document()
    document["schema"] = SCHEMA
    if model.unmeasured:
        document["unmeasured"] = list(model.unmeasured)
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
    if model.topics:
        document["topics"] = dict(model.topics)
    return document


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
        number, file = versions[-1].number + 1 if versions else 1, "" if parent.path is None else str(parent.path)
        versions.append(Version(number, reason, content, file, before, effects=parent.snapshot))
    last = versions[-1]
    new = Version(
        last.number + 1,
        command,
        content_hash(model),
        str(path),
        last.content,
        datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        tool_version(),
        tuple(flights),
        trial,
        model.snapshot,
    )
    return replace(model, history=(*versions, new))


def changed_since(model: Model) -> bool:
    """Whether the file was changed by hand after its last version was written."""
    return bool(model.history) and model.history[-1].content != content_hash(model)


def tool_version() -> str:
    """Version of wrenchgap, for provenance."""
    try:
        return version("wrenchgap")
    except PackageNotFoundError:
        return "unknown"
