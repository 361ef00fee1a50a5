"""A user's own effect: one Python file with a subclass of an effect's place, checked before it is used.

What is checked, on two vehicles (tilting arms with twelve rotors; one of which only the wrench is known) and a few
states in motion: it has a name of its own and says what excites it; parameters have names, finite ranges and
a size; at zero it changes nothing; `apply` returns the right shapes, finite, leaves what it was given alone, and
says the same sample by sample as for all samples at once (simulation and identification call the same function).

Every message begins with the file and the line. How to write one: docs/effects/your-own.md.
"""

from __future__ import annotations

import copy
import hashlib
import importlib.util
import inspect
import math
import re
import sys
import traceback
from collections.abc import Callable, Iterable
from dataclasses import fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn, cast

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import so3
from wrenchgap.flight.errors import ModelError
from wrenchgap.plant.actuation import actuation
from wrenchgap.plant.effects import (
    AnyEffect,
    BodyEffect,
    CommandEffect,
    Context,
    Effect,
    Parameter,
    SensorEffect,
    Source,
    ThrustEffect,
    WrenchEffect,
    catalogue,
    find,
    forget,
    register,
    sources,
)
from wrenchgap.plant.state import Commands, Motion, Rates, State
from wrenchgap.plant.vehicle import Arms, Body, Rotors, Vehicle

Array = NDArray[np.float64]

PLACES = (CommandEffect, ThrustEffect, WrenchEffect, BodyEffect, SensorEffect)
PAGE = "see docs/effects/your-own.md"
SAMPLES = 6
"""How many samples the checks use."""

_PREFIX = "wrenchgap_own_effect_"


def use(paths: Iterable[Path]) -> None:
    """Make these files' effects, and no others, the own effects of this process; raises ModelError."""
    forget()
    for path in paths:
        for effect, source in load(path):
            register(effect, source)


def files() -> tuple[Path, ...]:
    """The files whose effects are own ones of this process: what another process has to `use`."""
    modules = (sys.modules.get(type(find(name)).__module__) for name in sources())
    return tuple(dict.fromkeys(Path(m.__file__) for m in modules if m is not None and m.__file__ is not None))


def load(path: Path) -> list[tuple[AnyEffect, Source]]:
    """The checked effects of a file; raises ModelError with file and line for whatever is wrong with it."""
    if path.is_dir() or not path.exists():
        raise ModelError(f"--effects {path}: no such file; expected a Python file with an effect, {PAGE}")
    try:
        text = path.read_text(encoding="utf-8")
        code = compile(text, str(path), "exec")
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"--effects {path}: cannot be read as text: {error}") from None
    except (SyntaxError, ValueError) as error:
        line = getattr(error, "lineno", None) or 1
        raise ModelError(f"{path}:{line}: is not Python: {getattr(error, 'msg', error)}") from None
    module = _run(code, path)
    classes = [c for c in vars(module).values() if inspect.isclass(c) and c.__module__ == module.__name__]
    found = [_File(path, c).checked() for c in classes if _is_meant(c, path)]
    if not found:
        listed = ", ".join(c.__name__ for c in PLACES)
        raise ModelError(f"{path}:1: defines no effect; expected a subclass of one of {listed}; {PAGE}")
    names = [effect.name for effect in found]
    for effect in found:
        where = f"{path}:{_line_of(type(effect), path)}"
        if names.count(effect.name) > 1 or effect.name in catalogue():
            raise ModelError(f"{where}: name: effect {effect.name!r} exists already; rename yours")
    source = Source(path.name, hashlib.sha256(text.encode()).hexdigest())
    return [(effect, source) for effect in found]


def blame(error: BaseException) -> str | None:
    """`file:line: what` where an error was raised inside the file of an own effect, None where it was not."""
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        if any(m.__file__ == frame.filename for n, m in list(sys.modules.items()) if n.startswith(_PREFIX)):
            return f"{frame.filename}:{frame.lineno}: {type(error).__name__}: {_first_line(error)}"
    return None


def _run(code: Any, path: Path) -> ModuleType:
    """The file as a module of its own."""
    name = _PREFIX + hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:12]
    spec = importlib.util.spec_from_loader(name, loader=None, origin=str(path))
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    module.__file__ = str(path)
    sys.modules[name] = module
    try:
        exec(code, module.__dict__)
    except (KeyboardInterrupt, MemoryError):
        raise
    except BaseException as error:
        said = blame(error) or f"{path}:1: {type(error).__name__}: {_first_line(error)}"
        raise ModelError(f"{said} (while the file was loaded)") from None
    return module


def _is_meant(cls: type, path: Path) -> bool:
    """Whether a class is an effect to be used; an abstract one without a name is a base of others."""
    if issubclass(cls, Effect) and not issubclass(cls, PLACES):
        listed = ", ".join(c.__name__ for c in PLACES)
        raise ModelError(f"{path}:{_line_of(cls, path)}: {cls.__name__} subclasses Effect; subclass one of {listed}")
    if not issubclass(cls, PLACES):
        return False
    missing = sorted(getattr(cls, "__abstractmethods__", ()))
    if missing and "name" in vars(cls):
        raise ModelError(f"{path}:{_line_of(cls, path)}: {cls.__name__} lacks the method {missing[0]!r}; {PAGE}")
    return not missing


def _line_of(cls: type, path: Path) -> int:
    """The line on which a class begins."""
    text = path.read_text(encoding="utf-8").splitlines()
    pattern = re.compile(rf"\s*class\s+{re.escape(cls.__name__)}\b")
    return next((n for n, line in enumerate(text, 1) if pattern.match(line)), 1)


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [""])[0]


class _Wrong(Exception):
    """What `apply` returned is not what its place asks for."""


class _File:
    """One class of a user's file, and what is checked of it."""

    def __init__(self, path: Path, cls: type) -> None:
        self.path = path
        self.cls = cls

    def fail(self, words: str, method: str = "") -> NoReturn:
        """Raise the error, at the class or at one of its methods."""
        function = getattr(self.cls, method, None) if method else None
        code = getattr(function, "__code__", None)
        line = code.co_firstlineno if code is not None else _line_of(self.cls, self.path)
        what = f"{self.cls.__name__}.{method}" if method else self.cls.__name__
        raise ModelError(f"{self.path}:{line}: {what} {words}")

    def call(self, method: str, function: Callable[[], Any]) -> Any:
        """What a method returns; what it raises becomes an error at that line."""
        try:
            with np.errstate(all="ignore"):
                return function()
        except ModelError:
            raise
        except _Wrong as error:
            self.fail(str(error), method)
        except Exception as error:
            said = blame(error)
            if said is None:
                self.fail(f"raised {type(error).__name__}: {_first_line(error)}", method)
            raise ModelError(f"{said} (in a trial of {self.cls.__name__}.{method})") from None

    def checked(self) -> AnyEffect:
        """The effect, if all is well."""
        for attribute, pattern in (("name", r"[a-z][a-z0-9_]*"), ("excited_by", r"(?s).+")):
            value = getattr(self.cls, attribute, None)
            if not isinstance(value, str) or not re.fullmatch(pattern, value):
                wanted = "text like my_effect" if attribute == "name" else "a few words on what shows it"
                self.fail(f"has no valid {attribute!r}: got {value!r}, expected {wanted}")
        effect = cast(AnyEffect, self.call("__init__", lambda: self.cls()))
        tried = 0
        for vehicle in _vehicles():
            if vehicle.has_rotors or not (effect.needs_rotors or effect.needs_rates):
                tried += self.try_on(effect, vehicle)
        if not tried:
            self.fail("could not be tried: it refuses a vehicle with six tilting arms and twelve rotors", "parameters")
        return effect

    def try_on(self, effect: AnyEffect, vehicle: Vehicle) -> bool:
        """Check parameters and `apply` on one vehicle; False where the effect says that it is not for it."""
        try:
            parameters = self.call("parameters", lambda: effect.parameters(vehicle))
        except ModelError as error:
            if str(self.path) in str(error):
                raise
            return False
        self.check_parameters(parameters)
        zero = np.zeros(len(parameters))
        typical = np.array([min(max(p.start or p.scale, p.low), p.high) for p in parameters])
        trial = _Trial(effect, vehicle)
        unlike = self.compare(trial, zero, trial.unchanged())
        if unlike:
            self.fail(f"changes {unlike} although all parameters are zero; zero must mean no effect", "apply")
        whole = self.shapes(trial, typical)
        if trial.steps is not None:
            single = self.call("apply", lambda: trial.one_by_one(typical))
            if not all(np.allclose(a, b, rtol=1e-6, atol=1e-9) for a, b in zip(whole, single, strict=True)):
                self.fail("says something else for one sample at a time than for all at once", "apply")
        return True

    def check_parameters(self, parameters: Any) -> None:
        """Names, ranges and sizes."""
        if not isinstance(parameters, tuple) or not parameters or not all(isinstance(p, Parameter) for p in parameters):
            self.fail(f"returned {parameters!r}, expected a tuple of one Parameter or more", "parameters")
        names = [p.name for p in parameters]
        for p in parameters:
            if not re.fullmatch(r"[A-Za-z0-9_]+", str(p.name)) or names.count(p.name) > 1:
                self.fail(
                    f"names a parameter {p.name!r}; expected different names of letters, digits and _", "parameters"
                )
            numbers = (p.low, p.high, p.scale, p.start)
            if not all(isinstance(v, int | float | np.floating) and math.isfinite(v) for v in numbers):
                self.fail(f"parameter {p.name}: low, high, scale and start must be finite numbers", "parameters")
            if not p.low <= p.start <= p.high or p.low == p.high:
                said = f"got low {p.low:g}, high {p.high:g}, start {p.start:g}; the start must lie between the others"
                self.fail(f"parameter {p.name}: {said}", "parameters")
            if p.scale <= 0.0:
                self.fail(
                    f"parameter {p.name}: got scale {p.scale:g}, expected a typical size above zero", "parameters"
                )

    def compare(self, trial: _Trial, theta: Array, expected: tuple[Array, ...]) -> str:
        """Names of the arrays that `apply` changes."""
        got = self.shapes(trial, theta)
        pairs = zip(trial.results, got, expected, strict=True)
        return ", ".join(name for name, a, b in pairs if not np.allclose(a, b, rtol=1e-9, atol=1e-12))

    def shapes(self, trial: _Trial, theta: Array) -> tuple[Array, ...]:
        """The arrays that `apply` returns, of the right shapes and finite; nothing it was given has changed."""
        given = trial.arguments(theta)
        before = copy.deepcopy(given)
        got = self.call("apply", lambda: trial.arrays(trial.effect.apply(*given)))
        for name, array, expected in zip(trial.results, got, trial.unchanged(), strict=True):
            if array.shape != expected.shape:
                self.fail(f"returned {name} with shape {array.shape}, expected {expected.shape}", "apply")
            if not np.isfinite(array).all():
                self.fail(f"returned {name} that is not finite for plausible parameters", "apply")
        if not _same(before, given):
            self.fail("changes its arguments; return new arrays instead", "apply")
        return cast(tuple[Array, ...], got)


class _Trial:
    """One effect on one vehicle: arguments for `apply`, and the arrays that it returns."""

    def __init__(self, effect: AnyEffect, vehicle: Vehicle) -> None:
        self.effect = effect
        self.vehicle = vehicle
        self.state, self.commands, self.motion = _flight(vehicle)
        self.context = Context(vehicle, self.state)
        self.actuation = None
        if vehicle.has_rotors:
            a, r = (0.1 * np.ones((SAMPLES, n)) for n in (len(vehicle.geometry()[0]), len(vehicle.geometry()[1])))
            self.actuation = replace(actuation(vehicle, self.commands), rates=Rates(a, a, r))

    @property
    def steps(self) -> range | None:
        """The samples one by one; None where the effect does not depend on samples."""
        return None if isinstance(self.effect, BodyEffect) else range(SAMPLES)

    @property
    def results(self) -> tuple[str, ...]:
        """Names of the arrays that `apply` returns."""
        if isinstance(self.effect, CommandEffect):
            return ("wrench_B", "tilt", "rotor_speed")[: 3 if self.vehicle.has_rotors else 1]
        if isinstance(self.effect, BodyEffect):
            return ("mass", "inertia", "com_B")
        if isinstance(self.effect, SensorEffect):
            return ("omega_B", "omega_dot_B", "specific_force_B")
        return ("the thrusts",) if isinstance(self.effect, ThrustEffect) else ("the added wrench",)

    def unchanged(self) -> tuple[Array, ...]:
        """What no effect returns."""
        if isinstance(self.effect, WrenchEffect):
            return (np.zeros((SAMPLES, 6)),)
        if isinstance(self.effect, ThrustEffect):
            assert self.actuation is not None
            return (self.actuation.thrust,)
        whole: Any = {CommandEffect: self.commands, BodyEffect: self.vehicle.body, SensorEffect: self.motion}
        kind = next(k for k in whole if isinstance(self.effect, k))
        return self.arrays((whole[kind], None) if kind is CommandEffect else whole[kind])

    def arguments(self, theta: Array, rows: slice = slice(None), memory: Any = None) -> tuple[Any, ...]:
        """Arguments of `apply` for some of the samples."""
        context = Context(self.vehicle, _rows(self.state, rows))
        act = None if self.actuation is None else _rows(self.actuation, rows)
        if isinstance(self.effect, CommandEffect):
            return (_rows(self.commands, rows), theta, context, 0.01, memory)
        if isinstance(self.effect, BodyEffect):
            return (self.vehicle.body, theta)
        if isinstance(self.effect, SensorEffect):
            return (_rows(self.motion, rows), theta, context)
        if isinstance(self.effect, ThrustEffect):
            return (act, theta, context)
        return (act, self.commands.wrench_B[rows], theta, context)

    def arrays(self, returned: Any) -> tuple[Array, ...]:
        """The arrays of what `apply` returned; raises _Wrong where it is something else."""
        if isinstance(self.effect, CommandEffect):
            if not (isinstance(returned, tuple) and len(returned) == 2 and isinstance(returned[0], Commands)):
                raise _Wrong(f"returned {type(returned).__name__}, expected (Commands, memory)")
            return tuple(np.asarray(getattr(returned[0], name), dtype=float) for name in self.results)
        wanted: Any = {BodyEffect: Body, SensorEffect: Motion}
        for kind, cls in wanted.items():
            if isinstance(self.effect, kind):
                if not isinstance(returned, cls):
                    raise _Wrong(f"returned {type(returned).__name__}, expected {cls.__name__}")
                return tuple(np.asarray(getattr(returned, name), dtype=float) for name in self.results)
        if not isinstance(returned, np.ndarray):
            raise _Wrong(f"returned {type(returned).__name__}, expected an array")
        return (np.asarray(returned, dtype=float),)

    def one_by_one(self, theta: Array) -> tuple[Array, ...]:
        """The arrays when samples come one at a time, as in a simulation."""
        memory: Any = None
        parts = []
        for k in range(SAMPLES):
            returned = self.effect.apply(*self.arguments(theta, slice(k, k + 1), memory))
            if isinstance(self.effect, CommandEffect):
                memory = cast(Any, returned)[1]
            parts.append(self.arrays(returned))
        return tuple(np.concatenate(columns) for columns in zip(*parts, strict=True))


def _rows(item: Any, rows: slice) -> Any:
    """Some samples of a dataclass of arrays."""
    changed = {}
    for field in fields(item):
        value = getattr(item, field.name)
        if isinstance(value, np.ndarray):
            changed[field.name] = value[rows]
        elif isinstance(value, Rates):
            changed[field.name] = _rows(value, rows)
    return replace(item, **changed)


def _same(first: Any, second: Any) -> bool:
    """Whether two arguments hold the same numbers."""
    if isinstance(first, np.ndarray):
        return bool(np.array_equal(first, second))
    if isinstance(first, tuple):
        return all(_same(a, b) for a, b in zip(first, second, strict=True))
    if is_dataclass(first):
        return all(_same(getattr(first, f.name), getattr(second, f.name)) for f in fields(first))
    return True


@cache
def _vehicles() -> tuple[Vehicle, Vehicle]:
    """Six tilting arms with twelve rotors; and one of which only the wrench is known."""
    azimuth = np.radians(np.arange(6) * 60.0)
    outward = np.stack((np.cos(azimuth), np.sin(azimuth), np.zeros(6)), axis=1)
    wide = np.full(6, 10.0)
    arms = Arms(0.3 * outward, outward, np.tile([0.0, 0.0, 1.0], (6, 1)), np.ones(6, dtype=bool), -wide, wide, wide)
    ones = np.ones(12)
    rotors = Rotors(
        np.repeat(np.arange(6), 2),
        0.035 * np.tile([1.0, -1.0], 6),
        np.tile([1.0, -1.0, -1.0, 1.0], 3),
        7.2e-6 * ones,
        0.0165 * ones,
        0.115 * ones,
        0.0 * ones,
        1250.0 * ones,
    )
    body = Body(4.0, np.diag([0.10, 0.11, 0.19]), np.array([0.001, -0.002, 0.003]))
    place = np.array([0.01, 0.0, 0.02])
    return Vehicle("trial", body, arms, rotors, place), Vehicle("trial", body, None, None, place)


def _flight(vehicle: Vehicle) -> tuple[State, Commands, Motion]:
    """A few samples of a vehicle that moves, turns and tilts."""
    n = SAMPLES
    rng = np.random.default_rng(7)
    quat = so3.exp(rng.normal(0.0, 0.5, (n, 3)))
    time = np.linspace(0.0, 0.01 * (n - 1), n, dtype=np.float64)
    omega = rng.normal(size=(n, 3))
    position = rng.normal((0.0, 0.0, 2.0), 1.0, (n, 3))
    voltage = np.linspace(16.0, 15.0, n, dtype=np.float64)
    state = State(time, position, quat, 2.0 * rng.normal(size=(n, 3)), omega, voltage)
    wrench = rng.normal((0.0, 0.0, 39.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.5, 0.5, 0.5), (n, 6))
    commands = Commands(wrench)
    if vehicle.has_rotors:
        arms, rotors = vehicle.geometry()
        speed = 650.0 + 50.0 * rng.normal(size=(n, len(rotors)))
        commands = Commands(wrench, 0.3 * rng.normal(size=(n, len(arms))), speed)
    return state, commands, Motion(omega, rng.normal(size=(n, 3)), rng.normal((0.0, 0.0, 9.8), 1.0, (n, 3)))
