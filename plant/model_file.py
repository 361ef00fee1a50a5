"""Model files: TOML, checked whole on reading, comments kept on writing. The keys are documented in docs/model-file.md.

Writing keeps the file's own text, comments and order, and replaces only the effects and the history.
"""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import NDArray
from tomlkit.exceptions import ParseError

from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.effects import Source, catalogue, sources
from wrenchgap.plant.history import BY_HAND, GIVEN, Snapshot, Trial, Value, Version
from wrenchgap.plant.model import Model, make_effect
from wrenchgap.plant.sensors import SensorNoise
from wrenchgap.plant.vehicle import Arms, Body, Rotors, Vehicle
from wrenchgap.plant.wrench_model import ModelEffect, Provenance

Array = NDArray[np.float64]

SCHEMA = 1
_SHIPPED = Path(__file__).parent.parent / "models"


def content_hash(model: Model) -> str:
    """SHA-256 of the text that `dumps` writes but for the history: the same for models that say the same."""
    return hashlib.sha256(dumps(replace(model, history=())).encode()).hexdigest()


def find_model(name_or_path: str | Path) -> Path:
    """Path of a model file: as given, or a shipped model by its name."""
    path = Path(name_or_path)
    if path.is_file():
        return path
    if path.is_dir():
        raise ModelError(f"{path}: is a folder, expected a model file (.toml)")
    shipped = {p.stem: p for p in sorted(_SHIPPED.glob("*.toml"))}
    if str(name_or_path) in shipped:
        return shipped[str(name_or_path)]
    raise ModelError(
        f"{name_or_path}: no such model file; give a path to a .toml file or one of the shipped models: "
        f"{', '.join(sorted(shipped))}"
    )


def load(name_or_path: str | Path) -> Model:
    """Read and check a model file, or a shipped model by its name."""
    path = find_model(name_or_path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"{path}: cannot be read as text: {error}") from None
    try:
        return replace(loads(text), path=path)
    except ModelError as error:
        raise ModelError(f"{path.name}: {error}") from None


def loads(text: str) -> Model:
    """A model from the text of a model file."""
    try:
        document = tomlkit.parse(text).unwrap()
    except ParseError as error:
        raise ModelError(f"is not TOML: {error}") from None
    root = _Table(document, "")
    schema = root.number("schema")
    if schema != SCHEMA:
        raise ModelError(f"schema: got {schema:g}, this version of wrenchgap reads {SCHEMA}")
    vehicle = _vehicle(root.table("vehicle"))
    controller = _dataclass(root.table("controller", optional=True), ControllerGains)
    sensors = _dataclass(root.table("sensors", optional=True), SensorNoise)
    topics = {str(k): str(v) for k, v in root.table("topics", optional=True).take_all().items()}
    read = [_effect(vehicle, t) for t in root.tables("effects", optional=True)]
    notes = tuple(note for _, note in read if note)
    versions = tuple(_version(t) for t in root.tables("history", optional=True))
    root.finish()
    model = Model(vehicle, (), controller, sensors, topics, None, text, versions, notes)
    return model.with_effects(effect for effect, _ in read)


def dumps(model: Model) -> str:
    """Text of the model file: the model's own text with its effects and history replaced."""
    document = tomlkit.parse(model.text) if model.text else _skeleton(model)
    document.pop("effects", None)
    document.pop("history", None)
    text = tomlkit.dumps(document).rstrip("\n") + "\n"
    for item in model.effects:
        text += "\n" + _effect_text(model.vehicle, item)
    for entry in model.history:
        text += "\n" + _version_text(entry)
    return text


def next_version(
    parent: Model,
    model: Model,
    *,
    command: str,
    path: Path,
    flights: Sequence[tuple[str, str]] = (),
    trial: Trial | None = None,
) -> Model:
    """`model` with `parent`'s history and one version more: itself, as made by `command` and written to `path`.

    A parent without history becomes the first version; one that was changed since its last version gets a version
    for that.
    """
    versions = list(parent.history)
    content = content_hash(parent)
    if not versions or versions[-1].content != content:
        last = versions[-1] if versions else None
        versions.append(
            Version(
                1 if last is None else last.number + 1,
                GIVEN if last is None else BY_HAND,
                content,
                "" if parent.path is None else str(parent.path),
                "" if last is None else last.content,
                effects=parent.snapshot,
            )
        )
    last = versions[-1]
    made = Version(
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
    return replace(model, history=(*versions, made))


def changed_since(model: Model) -> bool:
    """Whether the file was changed by hand after its last version was written."""
    return bool(model.history) and model.history[-1].content != content_hash(model)


def save(model: Model, path: Path, *, force: bool = False) -> Model:
    """Write a model file and return the model as it stands there; never overwrites without `force`."""
    if path.exists() and not force:
        raise UsageError(f"{path}: exists already; choose another name or say --force to overwrite it")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: the folder {path.parent} does not exist; make it first")
    text = dumps(model)
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text, encoding="utf-8")
    temporary.replace(path)
    return replace(model, path=path, text=text)


def tool_version() -> str:
    """Version of wrenchgap, for provenance."""
    try:
        return version("wrenchgap")
    except PackageNotFoundError:
        return "unknown"


class _Table:
    """One TOML table, read key by key; what is left at the end is an error."""

    def __init__(self, values: Mapping[str, Any], where: str) -> None:
        self._values = dict(values)
        self._where = where
        self._asked: set[str] = set()

    def name(self, key: str) -> str:
        """The key with the tables that it is in."""
        return self._key(key)

    def _key(self, key: str) -> str:
        return f"{self._where}.{key}" if self._where else key

    def _get(self, key: str, default: Any = None) -> Any:
        self._asked.add(key)
        if key in self._values:
            return self._values.pop(key)
        if default is None:
            near = difflib.get_close_matches(key, self._values, 1)
            meant = f"; {near[0]!r} is there: did you mean {key!r}?" if near else "; see docs/model-file.md"
            raise ModelError(f"{self._key(key)}: is missing{meant}")
        return default

    def has(self, key: str) -> bool:
        self._asked.add(key)
        return key in self._values

    def number(self, key: str, default: float | None = None) -> float:
        value = self._get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise ModelError(f"{self._key(key)}: got {value!r}, expected a finite number")
        return float(value)

    def numbers(self, key: str, count: int, said: str, default: Any = None) -> Array:
        value = self._get(key, default)
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError):
            array = np.empty(0)
        if array.shape != (count,) or not np.all(np.isfinite(array)):
            raise ModelError(f"{self._key(key)}: got {value!r}, expected {said} finite numbers")
        return array

    def vector(self, key: str, default: tuple[float, float, float] | None = None) -> Array:
        return self.numbers(key, 3, "three", default)

    def unit(self, key: str, default: tuple[float, float, float] | None = None) -> Array:
        value = self.vector(key, default)
        norm = float(np.linalg.norm(value))
        if norm < 1e-9:
            raise ModelError(f"{self._key(key)}: has no direction: {value.tolist()}")
        return value / norm

    def inertia(self, key: str) -> Array:
        value = self._get(key)
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError):
            array = np.empty(0)
        if array.shape == (3,):
            array = np.diag(array)
        if array.shape != (3, 3) or not np.all(np.isfinite(array)):
            raise ModelError(f"{self._key(key)}: got {value!r}, expected [xx, yy, zz] or three rows of three [kg m^2]")
        return array

    def text(self, key: str, default: str | None = None) -> str:
        value = self._get(key, default)
        if not isinstance(value, str):
            raise ModelError(f"{self._key(key)}: got {value!r}, expected text")
        return value

    def flag(self, key: str, default: bool) -> bool:
        self._asked.add(key)
        value = self._values.pop(key, default)
        if not isinstance(value, bool):
            raise ModelError(f"{self._key(key)}: got {value!r}, expected true or false")
        return value

    def table(self, key: str, optional: bool = False) -> _Table:
        value = self._get(key, {} if optional else None)
        if not isinstance(value, dict):
            raise ModelError(f"{self._key(key)}: got {value!r}, expected a table [{self._key(key)}]")
        return _Table(value, self._key(key))

    def tables(self, key: str, optional: bool = False) -> list[_Table]:
        value = self._get(key, [] if optional else None)
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise ModelError(f"{self._key(key)}: expected tables [[{self._key(key)}]]")
        return [_Table(v, f"{self._key(key)}[{i}]") for i, v in enumerate(value)]

    def with_defaults(self, defaults: Mapping[str, Any]) -> _Table:
        return _Table({**defaults, **self._values}, self._where)

    def discard(self, *keys: str) -> None:
        """Accept and ignore keys that defaults for all arms may have brought in."""
        for key in keys:
            self._values.pop(key, None)

    def take_all(self) -> dict[str, Any]:
        taken, self._values = self._values, {}
        return taken

    def finish(self) -> None:
        if self._values:
            key = next(iter(self._values))
            raise ModelError(
                f"{self._key(key)}: is not a key of the model file; expected one of: {', '.join(sorted(self._asked))}"
            )


def _vehicle(table: _Table) -> Vehicle:
    """The [vehicle] table."""
    name = table.text("name")
    body = Body(table.number("mass"), table.inertia("inertia"), table.vector("com", (0.0, 0.0, 0.0)))
    low, middle, high = np.linalg.eigvalsh(body.inertia)
    if high > 1.001 * (low + middle):
        raise ModelError(
            f"{table.name('inertia')}: no body has the principal moments {low:.4g}, {middle:.4g}, {high:.4g} kg m^2: "
            "the largest exceeds the sum of the others"
        )
    imu = table.vector("imu_position", (0.0, 0.0, 0.0))
    arm_defaults = table.table("arm", optional=True).take_all()
    rotor_defaults = table.table("rotor", optional=True).take_all()
    arm_tables = [t.with_defaults(arm_defaults) for t in table.tables("arms", optional=True)]
    table.finish()
    if not arm_tables:
        return Vehicle(name, body, None, None, imu)
    arms: list[tuple[Any, ...]] = []
    rotors: list[tuple[Any, ...]] = []
    for index, arm in enumerate(arm_tables):
        arms.append(_arm(arm))
        for rotor in arm.tables("rotors"):
            rotors.append((index, *_rotor(rotor.with_defaults(rotor_defaults))))
        arm.finish()
    p, a, n, tilts, low, high, rate = (np.array(column) for column in zip(*arms, strict=True))
    on, offset, spin, c_f, kappa, radius, slow, fast = (np.array(column) for column in zip(*rotors, strict=True))
    return Vehicle(
        name,
        body,
        Arms(p, a, n, tilts, low, high, rate),
        Rotors(on.astype(np.intp), offset, spin, c_f, kappa, radius, slow, fast),
        imu,
    )


def _arm(arm: _Table) -> tuple[Any, ...]:
    """One arm: position, axis, normal, tilts, limits. By azimuth and length, or by its pose."""
    if arm.has("position"):
        position = arm.vector("position")
        outward = (float(position[0]), float(position[1]), 0.0)
        flat = float(np.hypot(*outward[:2])) > 1e-9
        axis = arm.unit("tilt_axis", outward if flat else None)
        arm.discard("azimuth_deg", "length")
    else:
        azimuth = np.radians(arm.number("azimuth_deg"))
        axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        position = arm.number("length") * axis
        axis = arm.unit("tilt_axis", (float(axis[0]), float(axis[1]), 0.0))
    normal = arm.unit("thrust_direction", (0.0, 0.0, 1.0))
    tilts = arm.flag("tilts", True)
    low, high = np.radians(arm.number("tilt_min_deg", -1e9)), np.radians(arm.number("tilt_max_deg", 1e9))
    rate = np.radians(arm.number("tilt_rate_deg", 1e9))
    if low >= high:
        raise ModelError("vehicle.arms: tilt_min_deg must be below tilt_max_deg")
    if rate <= 0:
        raise ModelError("vehicle.arms: tilt_rate_deg must be positive")
    if tilts and abs(float(axis @ normal)) > 1e-6:
        raise ModelError("vehicle.arms: tilt_axis and thrust_direction must be at right angles")
    return position, axis, normal, tilts, low, high, rate


def _rotor(rotor: _Table) -> tuple[float, ...]:
    """One rotor: offset, spin, c_f, kappa, radius, speed limits."""
    spin = rotor.number("spin")
    if spin not in (1.0, -1.0):
        raise ModelError(f"vehicle.arms.rotors.spin: got {spin:g}, expected 1 (counter-clockwise about thrust) or -1")
    values = (
        rotor.number("offset", 0.0),
        spin,
        rotor.number("c_f"),
        rotor.number("kappa"),
        rotor.number("radius"),
        rotor.number("speed_min", 0.0),
        rotor.number("speed_max"),
    )
    for key, value in (("c_f", values[2]), ("radius", values[4]), ("speed_max", values[6])):
        if value <= 0:
            raise ModelError(f"vehicle rotor {key}: got {value:g}, expected a positive number")
    if values[5] < 0 or values[5] >= values[6]:
        raise ModelError("vehicle rotor speed_min: must not be negative and must be below speed_max")
    rotor.finish()
    return values


def _dataclass(table: _Table, cls: type[Any]) -> Any:
    """A frozen dataclass of numbers, tuples of numbers, or None-able numbers, from a table with the same keys."""
    given: dict[str, Any] = {}
    defaults = cls()
    for item in fields(cls):
        if not table.has(item.name):
            continue
        default = getattr(defaults, item.name)
        if isinstance(default, tuple | np.ndarray):
            given[item.name] = tuple(float(v) for v in table.vector(item.name))
        else:
            given[item.name] = table.number(item.name)
    table.finish()
    return cls(**given)


def _effect(vehicle: Vehicle, table: _Table) -> tuple[ModelEffect, str]:
    """One [[effects]] entry, and a note on it."""
    name = table.text("name")
    own, note = _own(name, table.table("source", optional=True))
    values: dict[str, float] = {}
    stds: dict[str, float] = {}
    for key, value in table.table("parameters").take_all().items():
        entry = value if isinstance(value, dict) else {"value": value}
        parameter = _Table(entry, f"effects.{name}.{key}")
        values[key] = parameter.number("value")
        if parameter.has("std"):
            stds[key] = parameter.number("std")
        parameter.text("unit", "")
        parameter.finish()
    source = table.table("provenance", optional=True)
    logs = tuple((t.text("file"), t.text("sha256")) for t in source.tables("logs", optional=True))
    fitted, tool, method = (source.text(key, "") for key in ("fitted", "version", "method"))
    provenance = Provenance(logs, fitted, tool, method, own)
    source.finish()
    table.finish()
    made = make_effect(vehicle, name, values)
    names = [p.name for p in made.effect.parameters(vehicle)]
    missing = [n for n in names if n not in values]
    if missing:
        raise ModelError(f"effect {name}: parameter {missing[0]!r} is missing; expected {', '.join(names)}")
    std = np.array([stds[n] for n in names]) if len(stds) == len(names) else None
    return replace(made, std=std, provenance=provenance), note


def _own(name: str, table: _Table) -> tuple[Source | None, str]:
    """The file of a user's own effect, and a note where another one is loaded; an error where none is."""
    file, sha = table.text("file", ""), table.text("sha256", "")
    table.finish()
    if not file:
        return None, ""
    if name not in catalogue():
        raise ModelError(f"effect {name!r} is a user's own, from {file}; pass that file with --effects {file}")
    loaded = sources().get(name)
    if loaded is None or loaded.sha256 == sha:
        return Source(file, sha), ""
    note = f"effect {name}: {loaded.file} is not as it was when the effect was fitted; fit it anew with wrenchgap add."
    return Source(file, sha), note


def _version(table: _Table) -> Version:
    """One [[history]] entry."""
    flights = tuple((t.text("file"), t.text("sha256")) for t in table.tables("flights", optional=True))
    held_out = table.table("held_out", optional=True)
    trial = None
    if held_out.has("before"):
        before, after, noise = (held_out.numbers(key, 6, "six") for key in ("before", "after", "noise"))
        trial = Trial(before, after, noise, held_out.text("verdict", ""))
    held_out.finish()
    effects = []
    for item in table.tables("effects", optional=True):
        values = []
        for row in item.tables("parameters", optional=True):
            std = row.number("std") if row.has("std") else None
            values.append(Value(row.text("name"), row.number("value"), std, row.text("unit", "")))
            row.finish()
        effects.append(Snapshot(item.text("name"), tuple(values)))
        item.finish()
    made = Version(
        int(table.number("version")),
        table.text("command", ""),
        table.text("content"),
        table.text("file", ""),
        table.text("parent", ""),
        table.text("date", ""),
        table.text("wrenchgap", ""),
        flights,
        trial,
        tuple(effects),
    )
    table.finish()
    return made


def _version_text(entry: Version) -> str:
    """TOML of one entry."""
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
        lines.append(f"verdict = {_text(trial.verdict)}")
    for effect in entry.effects:
        lines += ["[[history.effects]]", f"name = {_text(effect.effect)}", "parameters = ["]
        for v in effect.values:
            std = "" if v.std is None else f", std = {_number(v.std)}"
            lines.append(f"  {{ name = {_text(v.name)}, value = {_number(v.value)}{std}, unit = {_text(v.unit)} }},")
        lines.append("]")
    return "\n".join(lines) + "\n"


def _text(value: str) -> str:
    """A TOML string."""
    return str(tomlkit.string(value).as_string())


def _effect_text(vehicle: Vehicle, item: ModelEffect) -> str:
    """TOML of one effect."""
    lines = ["[[effects]]", f'name = "{item.name}"', "[effects.parameters]"]
    for k, parameter in enumerate(item.effect.parameters(vehicle)):
        std = f", std = {_number(item.std[k])}" if item.std is not None else ""
        lines.append(f'{parameter.name} = {{ value = {_number(item.theta[k])}{std}, unit = "{parameter.unit}" }}')
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


def _skeleton(model: Model) -> tomlkit.TOMLDocument:
    """A document for a model that was made in code."""
    v = model.vehicle
    document = tomlkit.document()
    document["schema"] = SCHEMA
    vehicle = tomlkit.table()
    vehicle["name"] = v.name
    vehicle["mass"] = v.body.mass
    vehicle["inertia"] = v.body.inertia.tolist()
    vehicle["com"] = v.body.com_B.tolist()
    vehicle["imu_position"] = v.imu_position_B.tolist()
    if v.arms is not None and v.rotors is not None:
        arms = tomlkit.aot()
        for i in range(len(v.arms)):
            arm = tomlkit.table()
            arm["position"] = v.arms.position_B[i].tolist()
            arm["tilt_axis"] = v.arms.axis_B[i].tolist()
            arm["thrust_direction"] = v.arms.normal_B[i].tolist()
            arm["tilts"] = bool(v.arms.tilts[i])
            for key, values in (
                ("tilt_min_deg", v.arms.tilt_min),
                ("tilt_max_deg", v.arms.tilt_max),
                ("tilt_rate_deg", v.arms.tilt_rate_max),
            ):
                arm[key] = float(np.degrees(values[i]))
            rotors = tomlkit.array()
            for r in np.flatnonzero(v.rotors.arm == i):
                row = tomlkit.inline_table()
                for item in fields(Rotors):
                    if item.name != "arm":
                        row[item.name] = float(getattr(v.rotors, item.name)[r])
                rotors.append(row)
            arm["rotors"] = rotors
            arms.append(arm)
        vehicle["arms"] = arms
    document["vehicle"] = vehicle
    parts: tuple[tuple[str, ControllerGains | SensorNoise], ...] = (
        ("controller", model.controller),
        ("sensors", model.sensors),
    )
    for key, part in parts:
        table = tomlkit.table()
        for item in fields(part):
            entry = getattr(part, item.name)
            table[item.name] = list(entry) if isinstance(entry, tuple | np.ndarray) else entry
        document[key] = table
    if model.topics:
        document["topics"] = dict(model.topics)
    return document
