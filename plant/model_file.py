"""Model files: TOML, checked whole on reading, comments kept on writing. The keys are documented in docs/model-file.md.

Writing keeps the file's own text, comments and order, and replaces only the effects.
"""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Mapping
from dataclasses import fields, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import NDArray
from tomlkit.exceptions import ParseError

from flight.errors import ModelError, UsageError
from plant.controller import ControllerGains
from plant.model import Model, make_effect
from plant.sensors import SensorNoise
from plant.vehicle import Arms, Body, Rotors, Vehicle
from plant.wrench_model import ModelEffect, Provenance

Array = NDArray[np.float64]

SCHEMA = 1
_SHIPPED = (Path(__file__).parent / "models", Path(__file__).parent.parent / "models")


def content_hash(model: Model) -> str:
    """SHA-256 of the text that `dumps` writes: the same for models that say the same."""
    return hashlib.sha256(dumps(model).encode()).hexdigest()


def find_model(name_or_path: str | Path) -> Path:
    """Path of a model file: as given, or a shipped model by its name."""
    path = Path(name_or_path)
    if path.is_file():
        return path
    if path.is_dir():
        raise ModelError(f"{path}: is a folder, expected a model file (.toml)")
    shipped = {p.stem: p for folder in reversed(_SHIPPED) if folder.is_dir() for p in sorted(folder.glob("*.toml"))}
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
    effects = [_effect(vehicle, t) for t in root.tables("effects", optional=True)]
    root.finish()
    return Model(vehicle, (), controller, sensors, topics, None, text).with_effects(effects)


def dumps(model: Model) -> str:
    """Text of the model file: the model's own text with its effects replaced."""
    document = tomlkit.parse(model.text) if model.text else _skeleton(model)
    document.pop("effects", None)
    text = tomlkit.dumps(document).rstrip("\n") + "\n"
    for item in model.effects:
        text += "\n" + _effect_text(model.vehicle, item)
    return text


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

    def vector(self, key: str, default: tuple[float, float, float] | None = None) -> Array:
        value = self._get(key, default)
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError):
            array = np.empty(0)
        if array.shape != (3,) or not np.all(np.isfinite(array)):
            raise ModelError(f"{self._key(key)}: got {value!r}, expected three finite numbers")
        return array

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


def _effect(vehicle: Vehicle, table: _Table) -> ModelEffect:
    """One [[effects]] entry."""
    name = table.text("name")
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
    provenance = Provenance(logs, source.text("fitted", ""), source.text("version", ""), source.text("method", ""))
    source.finish()
    table.finish()
    made = make_effect(vehicle, name, values)
    names = [p.name for p in made.effect.parameters(vehicle)]
    missing = [n for n in names if n not in values]
    if missing:
        raise ModelError(f"effect {name}: parameter {missing[0]!r} is missing; expected {', '.join(names)}")
    std = np.array([stds[n] for n in names]) if len(stds) == len(names) else None
    return replace(made, std=std, provenance=provenance)


def _effect_text(vehicle: Vehicle, item: ModelEffect) -> str:
    """TOML of one effect."""
    lines = ["[[effects]]", f'name = "{item.name}"', "[effects.parameters]"]
    for k, parameter in enumerate(item.effect.parameters(vehicle)):
        std = f", std = {_number(item.std[k])}" if item.std is not None else ""
        lines.append(f'{parameter.name} = {{ value = {_number(item.theta[k])}{std}, unit = "{parameter.unit}" }}')
    source = item.provenance
    if source != Provenance():
        lines += [
            "[effects.provenance]",
            f"fitted = {tomlkit.string(source.fitted).as_string()}",
            f"version = {tomlkit.string(source.version).as_string()}",
            f"method = {tomlkit.string(source.method).as_string()}",
        ]
        for file, sha in source.logs:
            lines += [
                "[[effects.provenance.logs]]",
                f"file = {tomlkit.string(file).as_string()}",
                f"sha256 = {tomlkit.string(sha).as_string()}",
            ]
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
