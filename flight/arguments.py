"""Arguments of public functions: one of another type than its annotation says is refused where it enters."""

import inspect
import os
import re
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from numbers import Integral, Real
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from wrenchgap.flight.errors import UsageError

F = TypeVar("F", bound=Callable[..., Any])
Progress = Callable[[float, str], None]
"""Called with the fraction done (0 to 1) and what is being done."""
WIDER: dict[Any, Any] = {float: Real, int: Integral, bool: bool | np.bool_, Path: os.PathLike}
"""What stands for a type as well: numbers of numpy, and whatever is a path."""


def silent(fraction: float, words: str) -> None:
    """Progress that nobody looks at."""


def part_of(progress: Progress, start: float, stop: float, prefix: str = "") -> Progress:
    """Progress of a part, which takes the whole from one fraction to another."""
    return lambda fraction, words: progress(start + (stop - start) * fraction, prefix + words)


def check_arguments(function: F) -> F:
    """The same function, which raises UsageError for an argument that does not fit its annotation."""
    signature = inspect.signature(function)

    @wraps(function)
    def called(*args: Any, **options: Any) -> Any:
        try:
            bound = signature.bind(*args, **options).arguments
        except TypeError:  # which the function itself says better
            return function(*args, **options)
        check_types(function, bound)
        return function(*args, **options)

    return cast("F", called)


def check_types(of: Any, values: Mapping[str, Any]) -> None:
    """Raise UsageError for the first value that does not fit what a function or a dataclass annotates by its name.

    Whole numbers are counts and seeds here: none is negative.
    """
    hints = get_type_hints(of)
    for name, value in values.items():
        hint = hints.get(name, Any)
        repeated = not isinstance(of, type) and f"*{name}" in str(inspect.signature(of))
        for one in value if repeated and isinstance(value, tuple) else [value]:
            if not _fits(one, hint):
                words = re.sub(r"[\w.]+\.(?=\w)", "", inspect.formatannotation(hint)).replace("NoneType", "None")
                got = f"{type(one).__name__} {one!r:.60}"
                raise UsageError(f"{of.__name__}: {name}: got {got}; expected {words} (docs/api.md)")
            if hint in (int, int | None) and one is not None and one < 0:
                raise UsageError(f"{of.__name__}: {name}: got {one}; expected a whole number that is not negative")


def _fits(value: Any, hint: Any) -> bool:
    """Whether a value is of a type; of containers that are no list, tuple or mapping, only whether they are one."""
    kind, parts = get_origin(hint), get_args(hint)
    if kind in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if kind is Literal:
        return value in parts
    if kind is None:
        if hint is Any or not isinstance(hint, type) or getattr(hint, "_is_protocol", False):
            return True
        return isinstance(value, WIDER.get(hint, hint)) and not (isinstance(value, bool) and hint in (int, float))
    if kind is Callable:
        return callable(value)
    if issubclass(kind, Mapping):
        return isinstance(value, Mapping) and all(_fits(v, parts[1]) for v in value.values())
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        return False
    if kind is tuple and Ellipsis not in parts and isinstance(value, list | tuple):
        return len(value) == len(parts) and all(map(_fits, value, parts))
    return not isinstance(value, list | tuple) or all(_fits(one, parts[0]) for one in value)
