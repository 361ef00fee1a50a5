"""Checked reading of files that people write: known keys, valid values, the first error in one line.

A file's shape is a `Table` (pydantic) whose fields are of the kinds below; a table that is nothing but the fields of
a dataclass needs no class of its own (`stored`, `values_of`). An error names the key with the tables that it is in,
what was found and what is expected: `vehicle.arms[2].rotors[0].c_f: got -1.0, expected a positive number`.
docs/decisions/0014-validating-reader.md says why.
"""

import difflib
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import MISSING, dataclass, fields
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Annotated, Any, TypeVar, get_type_hints

import numpy as np
import tomlkit
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    create_model,
    model_validator,
    with_config,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from wrenchgap.flight.errors import ModelError, WrenchgapError
from wrenchgap.flight.flight import AXES


@dataclass(frozen=True)
class Bounds:
    """What is accepted in a file.

    No quantity of a flying vehicle in SI units comes near these sizes, and products of a few fit single precision.
    """

    largest: float = 1e12  # size of a number
    smallest: float = 1e-15  # size of a number that is positive
    name: int = 200  # characters of a name: as many as a column of a table may have
    rotors: int = 200  # of a vehicle, and arms: those that fly have some 40


BOUNDS = Bounds()


def expected(words: str) -> WrapValidator:
    """Validator whose every error says `got ..., expected WORDS`."""

    def check(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            return handler(value)
        except ValidationError:
            raise PydanticCustomError("expected", "expected {words}", {"words": words}) from None

    return WrapValidator(check)


def rule_error(words: str) -> PydanticCustomError:
    """The error, to be raised in a validator, of a value or table that breaks a rule."""
    return PydanticCustomError("rule", "{words}", {"words": words})


def _direction(value: tuple[float, float, float]) -> tuple[float, float, float]:
    norm = float(np.linalg.norm(value))
    if norm < 1e-9:
        raise rule_error(f"has no direction: {list(value)}")
    x, y, z = (np.array(value) / norm).tolist()
    return x, y, z


def _axes(names: tuple[str, ...]) -> tuple[str, ...]:
    if not set(names) < set(AXES):
        raise rule_error("")
    return tuple(axis for axis in AXES if axis in names)


def _name(text: str) -> str:
    if not text.strip() or not text.isprintable() or len(text) > BOUNDS.name:
        raise rule_error("")
    return text.strip()


_Finite = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-BOUNDS.largest, le=BOUNDS.largest)]
Number = Annotated[_Finite, expected("a finite number, of a size up to 1e12")]
Positive = Annotated[_Finite, Field(ge=BOUNDS.smallest), expected("a positive number, from 1e-15 to 1e12")]
NotNegative = Annotated[_Finite, Field(ge=0), expected("a number that is not negative, up to 1e12")]
Integer = Annotated[int, expected("a whole number")]
Flag = Annotated[bool, Field(strict=True), expected("true or false")]
Text = Annotated[str, Field(strict=True), expected("text")]
Name = Annotated[
    str,
    Field(strict=True),
    AfterValidator(_name),
    expected(f"a name: printable text of one line, not empty, of {BOUNDS.name} characters at most"),
]
Names = Annotated[tuple[Text, ...], expected("a list of names")]
Vector = Annotated[tuple[_Finite, _Finite, _Finite], expected("three finite numbers, of a size up to 1e12")]
Axes = Annotated[tuple[Text, ...], AfterValidator(_axes), expected(f"a list of at most five of {', '.join(AXES)}")]
Direction = Annotated[Vector, AfterValidator(_direction)]
Real = Annotated[float, Field(strict=True)]
"""Any number, also none: what is only said, and never computed with."""
SixMeasured = Annotated[
    tuple[Real, Real, Real, Real, Real, Real], expected("six numbers, nan for what was not measured")
]

_KINDS: dict[Any, Any] = {
    float: Number,
    int: Integer,
    bool: Flag,
    str: Text,
    tuple[float, float, float]: Vector,
    tuple[str, ...]: Names,
}
"""How a dataclass's field of a type is read."""


class Table(BaseModel):
    """A table of a file: its keys, and no others."""

    model_config = ConfigDict(frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _no_other_keys(cls, values: Any) -> Any:
        keys = [item.alias or name for name, item in cls.model_fields.items()]
        for key in values if isinstance(values, dict) else ():
            if key not in keys:
                near = difflib.get_close_matches(key, keys, 1)
                meant = f"did you mean {near[0]!r}?" if near else f"expected one of: {', '.join(sorted(keys))}"
                raise PydanticCustomError("unknown", "is not a known key; {meant}", {"key": key, "meant": meant})
        return values


T = TypeVar("T")
stored = with_config(ConfigDict(extra="forbid"))
"""Decorates a dataclass whose annotations are the kinds above, and which `read` makes: of its keys, and no others."""


def partial(table: type[Table]) -> type[Table]:
    """A table of the same keys, all optional: the defaults."""
    entries: dict[str, Any] = {}
    for name, item in table.model_fields.items():
        optional = copy(item)
        optional.default, optional.default_factory = None, None
        entries[name] = (item.annotation, optional)
    return create_model(f"{table.__name__}Defaults", __base__=Table, **entries)


def read(
    table: type[T], values: Any, *, where: str = "", page: str = "", error: type[WrenchgapError] = ModelError
) -> T:
    """`values` as that `Table`, or `stored` dataclass; raises `error` in one line. `where` is the key of the table,
    `page` explains its keys.
    """  # noqa: D205
    try:
        return TypeAdapter(table).validate_python(values)
    except ValidationError as found:
        raise error(_line(found.errors(include_url=False)[0], where, page)) from None


def values_of(
    cls: type,
    values: Any,
    *,
    where: str,
    page: str = "",
    error: type[WrenchgapError] = ModelError,
    degrees: Iterable[str] = (),
) -> dict[str, Any]:
    """Checked arguments for the dataclass `cls`, from a table with its fields as keys; absent ones stay absent.

    Fields named in `degrees` are in rad and read from a key that ends in _deg.
    """
    hints, degrees, entries = get_type_hints(cls), tuple(degrees), dict[str, Any]()
    for item in fields(cls):
        needed = item.default is MISSING and item.default_factory is MISSING
        alias = f"{item.name}_deg" if item.name in degrees else None
        entries[item.name] = (_KINDS[hints[item.name]], Field(... if needed else None, alias=alias))
    checked = read(create_model(cls.__name__, __base__=Table, **entries), values, where=where, page=page, error=error)
    given = {name: getattr(checked, name) for name in checked.model_fields_set}
    return {name: float(np.radians(v)) if name in degrees else v for name, v in given.items()}


LONGEST_TEXT, LONGEST_TOML = 2**24, 2**18
"""Bytes of a file that is read as text; characters of a TOML document: a model of 600 versions, rewritten in 7 s."""
STRINGS = re.compile(
    r'"""(?:[^\\]|\\.)*?""""{0,2}|\'\'\'.*?\'\'\'\'{0,2}|"(?:[^"\\\n]|\\.)*+"?|\'[^\'\n]*+\'?|#[^\n]*', re.DOTALL
)
"""Strings and comments of TOML."""
DEEP_KEY = re.compile(r"(?<![\w-])(?:[\w-]+[ \t]*\.[ \t]*){50}")
"""A key within 50 others, which no file has: the parser of plain values takes the square of their number."""


def text_of(path: Path, words: str, error: type[WrenchgapError] = ModelError, remedy: str = "") -> str:
    """The text of a file; raises `error`, which says that it cannot be read `words` ("as a model file")."""
    try:
        if path.exists() and not path.is_file() and not path.is_dir():  # a pipe would be waited for without end
            raise OSError(0, "it is no ordinary file")
        with path.open("rb") as file:
            content = file.read(LONGEST_TEXT + 1)
        if len(content) <= LONGEST_TEXT:
            return content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
        reason = f"it is longer than {LONGEST_TEXT // 2**20} MB"
    except (OSError, UnicodeDecodeError) as found:
        reason = getattr(found, "strerror", None) or "it is not text"
    except ValueError:  # a zero byte
        reason = "that is no name of a file"
    name = str(path) if str(path).isprintable() else repr(str(path))
    raise error(f"{name}: cannot be read {words}: {reason}{remedy}")


def path_inside(folder: Path, name: str, where: str) -> Path:
    """Path of a file, which need not exist, that a file in `folder` names under the key `where`.

    Raises ModelError unless it is an ordinary file in that folder or below, also after links were followed: to read
    somebody else's model must not open any other file of the machine.
    """
    said = f"{where}: {quoted(repr(name))}"
    try:
        path = (folder / name).resolve()
        ordinary = path.is_file() or not path.exists()
    except (OSError, ValueError, RuntimeError):  # a zero byte, too long, links in a circle
        raise ModelError(f"{said} is no name of a file") from None
    posix, windows = PurePosixPath(name), PureWindowsPath(name)
    absolute = posix.is_absolute() or windows.is_absolute() or bool(windows.drive) or "://" in name
    if absolute or ".." in (*posix.parts, *windows.parts) or not path.is_relative_to(folder.resolve()):
        raise ModelError(f"{said} is not in the folder of the file that names it; copy it there")
    if not ordinary:
        raise ModelError(f"{said} is no ordinary file")
    return path


def sibling_file(folder: Path, name: str, ending: str, where: str) -> Path:
    """Path of an existing file in `folder` or below (`path_inside`) with this ending."""
    path = path_inside(folder, name, where)
    if not path.is_file() or path.suffix.lower() != ending:
        said = f"{where}: {quoted(repr(name))}"
        raise ModelError(f"{said}: no such {ending} file in the folder of the file that names it")
    return path


def toml(text: str, error: type[WrenchgapError] = ModelError) -> dict[str, Any]:
    """A TOML document as plain values."""
    return _parsed(tomllib.loads, text, error)


def toml_document(text: str, error: type[WrenchgapError] = ModelError) -> tomlkit.TOMLDocument:
    """A TOML document with its comments; ask `toml` first, as this may take a hundred times as long."""
    return _parsed(tomlkit.parse, text, error)


def _parsed(parse: Callable[[str], T], text: str, error: type[WrenchgapError]) -> T:
    if len(text) > LONGEST_TOML:
        raise error(f"is longer than {LONGEST_TOML:,} characters; shorten it, in a model file the oldest [[history]]")
    if re.search(r"0[xob]\w{1000}", text):  # no decimal has as many digits, and messages write it as one
        raise error("is not TOML: a whole number of more than 64 bits")
    if DEEP_KEY.search(STRINGS.sub("q", text)):
        raise error("is not TOML that is read here: a key within 50 others")
    try:
        return parse(text)
    except RecursionError:
        raise error("is not TOML: tables or lists within one another without end") from None
    except Exception as found:  # a damaged document makes tomlkit raise many kinds
        json = "it looks like JSON; " if text.lstrip().startswith("{") else ""
        raise error(f"is not TOML: {json}{quoted(' '.join(str(found).split()))}") from None


def check_schema(document: Mapping[str, Any], schema: int, error: type[WrenchgapError] = ModelError) -> None:
    """Raise `error` where a document is of another version of its format than `schema`."""
    if document.get("schema") != schema:
        got = f"got {document['schema']!r}" if "schema" in document else "is missing"
        raise error(f"schema: {got}, this version of wrenchgap reads {schema}")


def _line(found: ErrorDetails, where: str, page: str) -> str:
    kind, context = found["type"], found.get("ctx", {})
    place = (*found["loc"], context["key"]) if kind == "unknown" else found["loc"]
    path = where
    for part in place:
        path += f"[{part}]" if isinstance(part, int) else f".{part}" if path else part
    if kind in ("unknown", "rule"):
        return f"{path}: {found['msg']}" if path else found["msg"]
    if kind == "unexpected_keyword_argument":
        return f"{path}: is not a known key"
    if kind == "missing":
        return f"{path}: is missing{f'; see {page}' if page else ''}"
    shapes = dict.fromkeys(("model_type", "dict_type", "dataclass_type"), f"a table [{path}]")
    shapes["tuple_type"] = f"tables [[{path}]]"
    wanted = f"expected {shapes[kind]}" if kind in shapes else found["msg"]
    return f"{path}: got {quoted(repr(found['input']))}, {wanted}"


def quoted(text: str, most: int = 80) -> str:
    """The first `most` characters of a text, for a message."""
    return text if len(text) <= most else f"{text[: most - 3]}..."
