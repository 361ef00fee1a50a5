"""What the header of a table means: quantities, axes and units by the names of columns (docs/formats.md).

A header is a name, an axis or number, and perhaps a unit, which stands in brackets or at the end: `gyro_x [deg/s]`,
`gyro_x_dps`, `gyroX`. Names are compared without regard to capitals and punctuation. Words before a known name must be
known as well (`imu_gyro_x`, `ref_pos_z`), so that a payload's position is not taken for the vehicle's.
Columns whose header is known become topics that play roles (`flight.formats.named_columns`).
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

from wrenchgap.flight.budget import LIMITS
from wrenchgap.flight.formats.header_names import FIRMWARE_UNITS, KNOWN, NAMES, OTHER_ROTOR_UNITS, REFERENCE, UNITS, XYZ

Names = tuple[list[str], ...]
_SPLIT: tuple[tuple[str, str, str, Names], ...] = tuple(
    (field, quantity, axes, tuple(name.split("_") for name in sorted(spelled.split(), key=len, reverse=True)))
    for field, quantity, axes, spelled in NAMES
)
"""The same with names as words, the longest first."""
_BARE = tuple(entry for entry in _SPLIT if entry[2] == "bare")
_SPELLED = {
    last: tuple(entry for entry in _SPLIT if entry[2] == "bare" or any(name[-1] == last for name in entry[3]))
    for last in {name[-1] for entry in _SPLIT for name in entry[3]}
}
"""Those that a last word leaves: a table may have a hundred thousand columns."""


@dataclass(frozen=True)
class Meaning:
    """Of one column: `field` ("gyro", "ref position", ...), place along it, factor to SI, unit if one is stated.

    `firmware` is the one whose name it is, where no other has it; then the unit may be what this firmware logs.
    """

    field: str
    index: int
    factor: float
    unit: str
    firmware: str = ""


@lru_cache(maxsize=4096)
def meaning(header: str) -> Meaning | None:
    """What a column holds, or None where its header is not known."""
    if len(header) > LIMITS.header_letters:
        return None
    name, bracketed = _split(header)
    for words, index in _indexed(name):
        for size in range(len(words) + 1):
            for found in _named(words[:size], words[size:], index, bracketed):
                return found
    return None


def _split(header: str) -> tuple[list[str], str | None]:
    """Lower-case words, and the unit in brackets."""
    name, unit = header.strip(), None
    if name.endswith(("]", ")")):
        inner = name[:-1]
        first = max(inner.rfind("]"), inner.rfind(")"), 0)
        for at in range(first, len(inner) - 1):  # the first bracket that the last one closes and that holds no number
            if inner[at] in "[(" and not inner[at + 1].isdecimal():
                name, unit = inner[:at].rstrip(), inner[at + 1 :]
                break
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return [word.lower() for word in re.split(r"[^A-Za-z0-9µ]+", spaced) if word], unit


def _indexed(words: list[str]) -> Iterator[tuple[list[str], str]]:
    """The words with an axis or number taken out of them, wherever one may be; without one last."""
    for place in range(len(words) - 1, -1, -1):
        word, rest = words[place], (words[:place], words[place + 1 :])
        if re.fullmatch(r"[wxyz]|\d+", word) and (place or word in "xyz"):
            yield [*rest[0], *rest[1]], word
        elif match := re.fullmatch(r"([a-zµ]+?)([wxyz]|\d+)", word):
            yield [*rest[0], match[1], *rest[1]], match[2]
    if words:
        yield words, ""


def _named(words: list[str], unit: list[str], index: str, bracketed: str | None) -> Iterator[Meaning]:
    """Meanings of a name whose last words are `unit`."""
    if unit and bracketed is not None:
        return
    stated = " ".join(unit) if bracketed is None else " ".join(re.split(r"[^\wµ]+", bracketed.lower())).strip()
    for name, quantity, axes, spelled in _SPELLED.get(words[-1] if words else "", _BARE):
        found = _before(words, spelled, bare=axes == "bare")
        place = _place(index, axes)
        if found is None or place is None or not found[0] <= KNOWN:
            continue
        prefix, spelling = found
        if axes == "" and name == "time" and prefix:
            continue
        firmware, usual = FIRMWARE_UNITS.get(spelling, ("", ""))
        factor = _factor(quantity, stated or usual, words)
        if factor is not None:
            free = name in ("rotor", "tilt", "voltage", "time") or name.startswith(("est ", "ref "))
            yield Meaning("ref " * (bool(prefix & REFERENCE) and not free) + name, place, *factor, firmware)


def _before(words: list[str], spelled: Names, bare: bool) -> tuple[frozenset[str], str] | None:
    """The words before a known name, and its spelling; None where they do not end in one. A bare axis has no name."""
    if bare:
        return (frozenset(words), "") if not set(words) - KNOWN else None
    for parts in spelled:
        if words[-len(parts) :] == parts:
            return frozenset(words[: -len(parts)]), "_".join(parts)
    return None


def _place(index: str, axes: str) -> int | None:
    """Where along a field of these axes an index is; None where it cannot be."""
    if axes == "":
        return 0 if not index else None
    if axes == "number":
        return int(index) if index.isdigit() else None
    letters = XYZ if axes == "bare" else axes
    if index.isdigit() and axes != "bare":
        return int(index) if int(index) < len(axes) else None
    return letters.index(index) if index and index in letters else None


def _factor(quantity: str, stated: str, words: list[str]) -> tuple[float, str] | None:
    """Factor and unit; "" where none is stated, None where the stated one does not belong to the quantity."""
    if quantity == "rotor" and not stated:
        spelt = (("rpm", "rpm"), ("pwm", "pwm"), ("throttle", "normalised"))
        stated = next((unit for word, unit in spelt if word in words), "")
    if quantity == "rotor" and stated in OTHER_ROTOR_UNITS:
        return 1.0, OTHER_ROTOR_UNITS[stated]
    if not stated:
        return 1.0, ""
    known = UNITS[quantity].get(stated)
    return None if known is None else (known, stated)


def listed(names: Sequence[str], longest: int = 100, most: int = 12) -> str:
    """Names for a sentence: the first `most`, each to its `longest` letter, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(f'{name:.{longest}}' for name in names[:most])}{more}"
