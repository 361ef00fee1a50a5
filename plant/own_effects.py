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
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn, cast

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.effects import (
    AnyEffect,
    BodyEffect,
    Effect,
    Parameter,
    Source,
    catalogue,
    find,
    forget,
    register,
    sources,
)
from wrenchgap.plant.own_effect_trial import PLACES, Trial, Wrong, vehicles
from wrenchgap.plant.reader import BOUNDS, text_of
from wrenchgap.plant.vehicle import Vehicle

PAGE = "see docs/effects/your-own.md"
LISTED = ", ".join(place.__name__ for place in PLACES)
_PREFIX = "wrenchgap_own_effect_"


def use(paths: Iterable[Path]) -> None:
    """Make the effects of these files the user effects of this process, in place of any others; raises ModelError."""
    forget()
    for path in paths:
        for effect, source in load(path):
            register(effect, source)


def files() -> tuple[Path, ...]:
    """The files of the user effects of this process, which another process has to `use`."""
    modules = (sys.modules.get(type(find(name)).__module__) for name in sources())
    return tuple(dict.fromkeys(Path(m.__file__) for m in modules if m is not None and m.__file__ is not None))


def load(path: Path) -> list[tuple[AnyEffect, Source]]:
    """The checked effects of a file; raises ModelError with file and line of the first error."""
    if path.is_dir() or not path.exists():
        raise ModelError(f"--effects {path}: no such file; expected a Python file with an effect, {PAGE}")
    text = text_of(path, "as --effects")
    try:
        code = compile(text, str(path), "exec")
    except (SyntaxError, ValueError) as error:
        line = getattr(error, "lineno", None) or 1
        raise ModelError(f"{path}:{line}: is not Python: {getattr(error, 'msg', error)}") from None
    module = _run(code, path)
    classes = [c for c in vars(module).values() if inspect.isclass(c) and c.__module__ == module.__name__]
    found = [file.checked() for file in (_File(path, c) for c in classes) if file.is_meant()]
    if not found:
        raise ModelError(f"{path}:1: defines no effect; expected a subclass of one of {LISTED}; {PAGE}")
    names = [effect.name for effect in found]
    for effect in found:
        where = f"{path}:{_line_of(type(effect), path)}"
        if names.count(effect.name) > 1 or effect.name in catalogue():
            raise ModelError(f"{where}: name: effect {effect.name!r} exists already; rename yours")
    source = Source(path.name, hashlib.sha256(text.encode()).hexdigest())
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


class _File:
    """One class of a user's file, and its checks."""

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
            if issubclass(self.cls, Effect):
                self.fail(f"subclasses Effect; subclass one of {LISTED}")
            return False
        missing = sorted(getattr(self.cls, "__abstractmethods__", ()))
        if missing and "name" in vars(self.cls):
            self.fail(f"lacks the method {missing[0]!r}; {PAGE}")
        return not missing

    def checked(self) -> AnyEffect:
        for attribute, pattern in (("name", r"[a-z][a-z0-9_]*"), ("excited_by", r"(?s).+")):
            value = getattr(self.cls, attribute, None)
            if not isinstance(value, str) or not re.fullmatch(pattern, value):
                wanted = "text like my_effect" if attribute == "name" else "a few words on what shows it"
                self.fail(f"has no valid {attribute!r}: got {value!r}, expected {wanted}")
        alike = getattr(self.cls, "confused_with", ())
        if not (isinstance(alike, tuple) and all(isinstance(name, str) for name in alike)):
            self.fail(f"has no valid 'confused_with': got {alike!r}, expected a tuple of names of effects")
        effect = cast(AnyEffect, self.call("__init__", lambda: self.cls()))
        tried = 0
        for vehicle in vehicles():
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
        trial = Trial(effect, vehicle)
        pairs = zip(trial.results, self.shapes(trial, zero), trial.unchanged(), strict=True)
        unlike = ", ".join(name for name, a, b in pairs if not np.allclose(a, b, rtol=1e-9, atol=1e-12))
        if unlike:
            self.fail(f"changes {unlike} although all parameters are zero; zero must mean no effect", "apply")
        whole = self.shapes(trial, typical)
        if trial.place is not BodyEffect:
            single = self.call("apply", lambda: trial.one_by_one(typical))
            if not all(np.allclose(a, b, rtol=1e-6, atol=1e-9) for a, b in zip(whole, single, strict=True)):
                self.fail("gives other results for one sample at a time than for all at once", "apply")
        return True

    def check_parameters(self, parameters: Any) -> None:
        if not isinstance(parameters, tuple) or not parameters or not all(isinstance(p, Parameter) for p in parameters):
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
