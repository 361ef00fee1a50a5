"""What parameters of RotorPy and drone-models have in common: places from the centre of mass, rotors that point up."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, TypeVar

import numpy as np

from wrenchgap._escaping import printable
from wrenchgap.plant.drafts.draft import EffectDraft, Sourced
from wrenchgap.plant.reader import Number, Table, expected, quoted, read

AnyTable = TypeVar("AnyTable", bound=Table)
Numbers = Annotated[tuple[Number, ...], expected("a list of finite numbers")]
UP = Sourced((0.0, 0.0, 1.0), "rotors of this package point up")
CENTRE = Sourced((0.0, 0.0, 0.0), "places are from the centre of mass, which is the origin")
INSTANT = 1e-3
"""[s], the time constant of rotors of which none is known, where a format needs one; one as short is none."""


def read_known(table: type[AnyTable], values: Mapping[str, Any], where: str) -> tuple[AnyTable, list[str]]:
    """The keys of `table`, checked, and the others that are not zero. Raises ModelError, in one line."""
    plain = {key: _plain(value) for key, value in values.items()}
    known = {key: value for key, value in plain.items() if key in table.model_fields}
    unread = [key for key, value in plain.items() if key not in known and not _is_zero(value)]
    return read(table, known, where=where), unread


def notes_of(where: str, unread: Sequence[str], effects: Sequence[EffectDraft]) -> tuple[str, ...]:
    """What became an effect, and what was left out, in words."""
    notes = []
    if effects:
        names = ", ".join(one.name for one in effects)
        notes.append(f"{where}: what it says beyond the nominal vehicle are effects of the model: {names}.")
    if unread:
        names = quoted(printable(", ".join(unread)), 300)
        notes.append(f"{where}: not read, since a model file has nothing of the kind: {names}.")
    return tuple(notes)


def lag_effect(up: float, down: float, source: str) -> tuple[EffectDraft, ...]:
    """The lag of rotors with these time constants [s]; none where both are `INSTANT`."""
    up, down = (0.0 if tau <= INSTANT * (1.0 + 1e-9) else tau for tau in (up, down))
    if not max(up, down):
        return ()
    if abs(up - down) <= 1e-9 * up:
        return (EffectDraft("motor_lag", {"tau": up}, source),)
    return (EffectDraft("asymmetric_motor_lag", {"tau_up": up, "tau_down": down}, source),)


def _plain(value: Any) -> Any:
    """The value with lists in place of arrays."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list) else value


def _is_zero(value: Any) -> bool:
    return isinstance(value, int | float) and value == 0
