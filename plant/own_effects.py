"""User effects: a Python file with subclasses of the places of effects, checked before use.

What is checked, on two vehicles (tilting arms with twelve rotors; one of which only the wrench is known) and a few
states in motion: it has a name of its own and says what excites it; parameters have names, finite ranges and
a size; at zero it changes nothing; `apply` returns the right shapes, finite, leaves what it was given alone, and
says the same sample by sample as for all samples at once (simulation and identification call the same function).

Every message begins with the file and the line. How to write one: docs/effects/your-own.md.
"""

import copy
import hashlib
import importlib.util
import inspect
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

from wrenchgap.flight import so3
from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.plant import effects, model_file
from wrenchgap.plant.actuation import actuation
from wrenchgap.plant.reader import BOUNDS, text_of
from wrenchgap.plant.state import Commands, Motion, Rates, State, rows
from wrenchgap.plant.vehicle import Body, Vehicle

PAGE = "see docs/effects/your-own.md"
PLACES: dict[type, tuple[type, tuple[str, ...]]] = {
    effects.CommandEffect: (Commands, ("wrench_B", "tilt", "rotor_speed")),
    effects.BodyEffect: (Body, ("mass", "inertia", "com_B")),
    effects.SensorEffect: (Motion, ("omega_B", "omega_dot_B", "specific_force_B")),
    effects.ThrustEffect: (np.ndarray, ("the thrusts",)),
    effects.WrenchEffect: (np.ndarray, ("the added wrench",)),
    effects.AirEffect: (np.ndarray, ("the air's velocity",)),
}
"""What `apply` returns at each place, and what its arrays are called."""
LISTED = ", ".join(place.__name__ for place in PLACES)
_PREFIX = "wrenchgap_own_effect_"


def use(paths: Iterable[Path]) -> None:
    """Make the effects of these files the user effects of this process, in place of any others; raises ModelError."""
    effects.forget()
    for path in paths:
        for effect, source in load(path):
            effects.register(effect, source)


def files() -> tuple[Path, ...]:
    """The files of the user effects of this process, which another process has to `use`."""
    modules = (sys.modules.get(type(effects.find(name)).__module__) for name in effects.sources())
    return tuple(dict.fromkeys(Path(m.__file__) for m in modules if m is not None and m.__file__ is not None))


def load(path: Path) -> list[tuple[effects.AnyEffect, effects.Source]]:
    """The checked effects of a file; raises ModelError with file and line of the first error."""
    if path.suffix != ".py" or not path.exists() or path.is_dir():  # `*.csv` may be a log named --effects=x.csv
        raise ModelError(f"--effects {path}: no such file ending in .py; expected a Python file with an effect, {PAGE}")
    text = text_of(path, "as --effects")
    try:
        code = compile(text, str(path), "exec")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:  # the last two: expressions too deep
        line, said = getattr(error, "lineno", None) or 1, getattr(error, "msg", str(error)) or "too deeply nested"
        raise ModelError(f"{path}:{line}: is not Python: {said}") from None
    module = _run(code, path)
    classes = [c for c in vars(module).values() if inspect.isclass(c) and c.__module__ == module.__name__]
    found = [file.checked() for file in (_File(path, c) for c in classes) if file.is_meant()]
    if not found:
        raise ModelError(f"{path}:1: defines no effect; expected a subclass of one of {LISTED}; {PAGE}")
    names = [effect.name for effect in found]
    for effect in found:
        where = f"{path}:{_line_of(type(effect), path)}"
        if names.count(effect.name) > 1 or effect.name in effects.catalogue():
            raise ModelError(f"{where}: name: effect {effect.name!r} exists already; rename yours")
    source = effects.Source(path.name, hashlib.sha256(text.encode()).hexdigest())
    return [(effect, source) for effect in found]


def blame(error: BaseException) -> str | None:
    """`file:line: error` for an error that was raised in the file of a user effect, else None."""
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


def _line_of(cls: type, path: Path) -> int:
    text = path.read_text(encoding="utf-8").splitlines()
    pattern = re.compile(rf"\s*class\s+{re.escape(cls.__name__)}\b")
    return next((n for n, line in enumerate(text, 1) if pattern.match(line)), 1)


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [""])[0]


class Wrong(Exception):
    """The result of `apply` does not suit its place."""


class Trial:
    """One effect on one vehicle: arguments for `apply` on so many `samples`, and the arrays that it returns."""

    def __init__(self, effect: effects.AnyEffect, vehicle: Vehicle, samples: int = 6) -> None:
        self.effect, self.vehicle, self.samples = effect, vehicle, samples
        self.place = next(place for place in PLACES if isinstance(effect, place))
        self.state, self.commands, self.motion = _flight(vehicle, samples)
        self.context = effects.Context(vehicle, self.state)
        self.actuation = None
        if vehicle.has_rotors:
            a, r = (0.1 * np.ones((samples, len(part))) for part in vehicle.geometry())
            self.actuation = replace(actuation(vehicle, self.commands), rates=Rates(a, a, r))

    @property
    def results(self) -> tuple[str, ...]:
        """Names of the arrays that `apply` returns."""
        _, names = PLACES[self.place]
        return names[:1] if self.place is effects.CommandEffect and not self.vehicle.has_rotors else names

    def unchanged(self) -> tuple[Array, ...]:
        """The results of `apply` without an effect."""
        if self.place in (effects.WrenchEffect, effects.AirEffect):
            return (np.zeros((self.samples, 6 if self.place is effects.WrenchEffect else 3)),)
        given = self.arguments(np.zeros(0))[0]
        if self.place is effects.ThrustEffect:
            return (given.thrust,)
        return self.arrays((given, None) if self.place is effects.CommandEffect else given)

    def arguments(self, theta: Array, at: slice = slice(None), memory: Any = None) -> tuple[Any, ...]:
        """Arguments of `apply` for some of the samples."""
        state, act = self.state.take(at), self.actuation
        context = effects.Context(self.vehicle, state)
        if act is not None:
            act = replace(rows(act, at), rates=rows(act.rates, at))
        given: dict[type, tuple[Any, ...]] = {
            effects.CommandEffect: (self.commands.take(at), theta, context, 0.01, memory),
            effects.BodyEffect: (self.vehicle.body, theta),
            effects.AirEffect: (state, theta),
            effects.SensorEffect: (rows(self.motion, at), theta, context),
            effects.ThrustEffect: (act, theta, context),
            effects.WrenchEffect: (act, self.commands.wrench_B[at], theta, context),
        }
        return given[self.place]

    def arrays(self, returned: Any) -> tuple[Array, ...]:
        """The arrays in the result of `apply`; raises Wrong for a result of another kind."""
        kind, words = PLACES[self.place][0], type(returned).__name__
        if self.place is effects.CommandEffect:
            if not (isinstance(returned, tuple) and len(returned) == 2 and isinstance(returned[0], kind)):
                raise Wrong(f"returned {words}, expected (Commands, memory)")
            returned = returned[0]
        elif not isinstance(returned, kind):
            raise Wrong(f"returned {words}, expected {'an array' if kind is np.ndarray else kind.__name__}")
        if kind is np.ndarray:
            return (np.asarray(returned, dtype=float),)
        return tuple(np.asarray(getattr(returned, name), dtype=float) for name in self.results)

    def one_by_one(self, theta: Array) -> tuple[Array, ...]:
        """The arrays when samples come one at a time, as in a simulation."""
        memory: Any = None
        parts = []
        for k in range(self.samples):
            returned = self.effect.apply(*self.arguments(theta, slice(k, k + 1), memory))
            if self.place is effects.CommandEffect:
                memory = cast(Any, returned)[1]
            parts.append(self.arrays(returned))
        return tuple(np.concatenate(columns) for columns in zip(*parts, strict=True))


@cache
def vehicles() -> tuple[Vehicle, Vehicle]:
    """Six tilting arms with twelve rotors; and one of which only the wrench is known."""
    shipped = model_file.load("tilt_hexarotor").vehicle
    body = replace(shipped.body, com_B=np.array([0.001, -0.002, 0.003]))
    whole = replace(shipped, name="trial", body=body, imu_position_B=np.array([0.01, 0.0, 0.02]))
    return whole, replace(whole, arms=None, rotors=None)


def _flight(vehicle: Vehicle, n: int) -> tuple[State, Commands, Motion]:
    """N samples of a vehicle that moves, turns and tilts."""
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


class _File:
    """One class of a user's file, and its checks."""

    def __init__(self, path: Path, cls: type) -> None:
        self.path, self.cls = path, cls

    def fail(self, words: str, method: str = "") -> NoReturn:
        """Raise the error, at the class or at one of its methods."""
        function = getattr(self.cls, method, None) if method else None
        code = getattr(function, "__code__", None)
        line = code.co_firstlineno if code is not None else _line_of(self.cls, self.path)
        what = f"{self.cls.__name__}.{method}" if method else self.cls.__name__
        raise ModelError(f"{self.path}:{line}: {what} {words}")

    def call(self, method: str, function: Callable[[], Any]) -> Any:
        """The result of a method; an exception becomes an error at its line."""
        try:
            with np.errstate(all="ignore"):
                return function()
        except ModelError:
            raise
        except Wrong as error:
            self.fail(str(error), method)
        except (Exception, SystemExit) as error:
            said = blame(error)
            if said is None:
                self.fail(f"raised {type(error).__name__}: {_first_line(error)}", method)
            raise ModelError(f"{said} (in a trial of {self.cls.__name__}.{method})") from None

    def is_meant(self) -> bool:
        """Whether it is an effect to be used; an abstract one without a name is a base of others."""
        if not issubclass(self.cls, tuple(PLACES)):
            if issubclass(self.cls, effects.Effect):
                self.fail(f"subclasses Effect; subclass one of {LISTED}")
            return False
        missing = sorted(getattr(self.cls, "__abstractmethods__", ()))
        if missing and "name" in vars(self.cls):
            self.fail(f"lacks the method {missing[0]!r}; {PAGE}")
        return not missing

    def checked(self) -> effects.AnyEffect:
        for attribute, pattern in (("name", r"[a-z][a-z0-9_]*"), ("excited_by", r"(?s).+")):
            value = getattr(self.cls, attribute, None)
            if not isinstance(value, str) or not re.fullmatch(pattern, value):
                wanted = "text like my_effect" if attribute == "name" else "a few words on what shows it"
                self.fail(f"has no valid {attribute!r}: got {value!r}, expected {wanted}")
        alike = getattr(self.cls, "confused_with", ())
        if not (isinstance(alike, tuple) and all(isinstance(name, str) for name in alike)):
            self.fail(f"has no valid 'confused_with': got {alike!r}, expected a tuple of names of effects")
        effect = cast(effects.AnyEffect, self.call("__init__", lambda: self.cls()))
        tried = 0
        for vehicle in vehicles():
            if vehicle.has_rotors or not (effect.needs_rotors or effect.needs_rates):
                tried += self.try_on(effect, vehicle)
        if not tried:
            self.fail("could not be tried: it refuses a vehicle with six tilting arms and twelve rotors", "parameters")
        return effect

    def try_on(self, effect: effects.AnyEffect, vehicle: Vehicle) -> bool:
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
        trial = Trial(effect, vehicle)
        pairs = zip(trial.results, self.shapes(trial, zero), trial.unchanged(), strict=True)
        if unlike := ", ".join(name for name, a, b in pairs if not np.allclose(a, b, rtol=1e-9, atol=1e-12)):
            self.fail(f"changes {unlike} although all parameters are zero; zero must mean no effect", "apply")
        whole = self.shapes(trial, typical)
        if trial.place is not effects.BodyEffect:
            single = self.call("apply", lambda: trial.one_by_one(typical))
            if not all(np.allclose(a, b, rtol=1e-6, atol=1e-9) for a, b in zip(whole, single, strict=True)):
                self.fail("gives other results for one sample at a time than for all at once", "apply")
        return True

    def check_parameters(self, parameters: Any) -> None:
        listed = isinstance(parameters, tuple) and all(isinstance(p, effects.Parameter) for p in parameters)
        if not listed or not parameters:
            self.fail(f"returned {parameters!r}, expected a tuple of one Parameter or more", "parameters")
        names = [p.name for p in parameters]
        for p in parameters:
            if not re.fullmatch(r"[A-Za-z0-9_]+", str(p.name)) or names.count(p.name) > 1:
                said = f"names a parameter {p.name!r}; expected different names of letters, digits and _"
                self.fail(said, "parameters")
            if not (isinstance(p.unit, str) and len(p.unit) <= 20 and p.unit.isprintable()):
                self.fail(f"parameter {p.name}: got unit {p.unit!r}, expected one short line of text", "parameters")
            numbers = [v for v in (p.low, p.high, p.scale, p.start) if isinstance(v, int | float | np.floating)]
            if len(numbers) < 4 or not all(-BOUNDS.largest <= v <= BOUNDS.largest for v in numbers):
                said = f"low, high, scale and start must be numbers of a size up to {BOUNDS.largest:g}"
                self.fail(f"parameter {p.name}: {said}", "parameters")
            if not p.low <= p.start <= p.high or p.low == p.high:
                said = f"got low {p.low:g}, high {p.high:g}, start {p.start:g}; the start must lie between the others"
                self.fail(f"parameter {p.name}: {said}", "parameters")
            if not min(p.scale, p.high - p.low) >= BOUNDS.smallest:
                sizes = f"scale {p.scale:g} and a range of {p.high - p.low:g}"
                said = f"got {sizes}, expected {BOUNDS.smallest:g} at least of both"
                self.fail(f"parameter {p.name}: {said}", "parameters")

    def shapes(self, trial: Trial, theta: Array) -> tuple[Array, ...]:
        """The arrays that `apply` returns, checked to be finite, of the right shapes, and without changed arguments."""
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


def _same(first: Any, second: Any) -> bool:
    if isinstance(first, np.ndarray):
        return bool(np.array_equal(first, second))
    if isinstance(first, tuple):
        return all(_same(a, b) for a, b in zip(first, second, strict=True))
    if is_dataclass(first):
        return all(_same(getattr(first, f.name), getattr(second, f.name)) for f in fields(first))
    return True
