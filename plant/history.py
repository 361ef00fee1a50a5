"""The history of a model: its versions, one after the other, kept in the model file itself.

A version is a snapshot of the effects with the reason for it: the command, the flights, the error on time that was not
fitted before and after. The first is the model as it was given. A version names its parent by content hash
(`plant.model_file.content_hash`, which leaves the history out), and carries everything that is shown of it, so the
chain can be read when the parents' files are gone. A change by hand between two versions becomes a version of
its own as soon as the next one is written.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

import numpy as np

from wrenchgap.flight.flight import Array

GIVEN = "as given"
BY_HAND = "changed by hand"
"""Commands of versions that no command made."""


@dataclass(frozen=True)
class Value:
    """One parameter of a version; its standard deviation is None where it was not fitted."""

    name: str
    value: float
    std: float | None
    unit: str


@dataclass(frozen=True)
class Snapshot:
    """One effect of a version, with its values."""

    effect: str
    values: tuple[Value, ...]


class Outcome(StrEnum):
    """Effect of a version on the error on held-out time."""

    BETTER = "better"
    WORSE = "worse"
    UNCLEAR = "unclear"


@dataclass(frozen=True)
class Trial:
    """Error on time that was not fitted: rms (6,) of the parent and of the version, sensor noise (6,) [N, Nm].

    `change` is the relative change of the error energy (the weighted squared error over six axes; -0.65 where 65 % are
    gone), `t` the paired t over blocks of time, positive where the version is better. Beyond `clear_t` a change is not
    chance (docs/decisions/0006-blocks.md).
    """

    clear_t: ClassVar[float] = 3.0

    before: Array
    after: Array
    noise: Array
    change: float
    t: float

    @property
    def outcome(self) -> Outcome:
        """Whether the change is clear, and to which side."""
        return Outcome.BETTER if self.t > self.clear_t else Outcome.WORSE if self.t < -self.clear_t else Outcome.UNCLEAR

    @property
    def rms_reduction(self) -> Array:
        """Relative reduction (6,) of the parent's rms."""
        return np.asarray(1.0 - self.after / np.maximum(self.before, 1e-30))


@dataclass(frozen=True)
class Version:
    """One version. `content` is its own content hash, `parent` that of the version before ("" for the first);
    `flights` are (file name, SHA-256) of the logs that it was fitted to; `tool` is the version of wrenchgap.
    """  # noqa: D205

    number: int
    command: str
    content: str
    file: str = ""
    parent: str = ""
    date: str = ""
    tool: str = ""
    flights: tuple[tuple[str, str], ...] = ()
    trial: Trial | None = None
    effects: tuple[Snapshot, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(e.effect for e in self.effects)


@dataclass(frozen=True)
class Change:
    """One parameter that is in both of two versions, with other values."""

    effect: str
    before: Value
    after: Value

    @property
    def sigmas(self) -> float | None:
        """The change in standard deviations of both values together, None where neither has one."""
        spread = float(np.hypot(self.before.std or 0.0, self.after.std or 0.0))
        return (self.after.value - self.before.value) / spread if spread > 0.0 else None


@dataclass(frozen=True)
class Changes:
    """What a version changed: effects added and removed, parameters that moved."""

    added: tuple[Snapshot, ...]
    removed: tuple[Snapshot, ...]
    moved: tuple[Change, ...]


def changes(before: Version | None, after: Version) -> Changes:
    """What `after` changed of `before`; of the first version, everything is as it was given."""
    if before is None:
        return Changes((), (), ())
    old = {e.effect: e for e in before.effects}
    new = {e.effect: e for e in after.effects}
    moved = []
    for name in sorted(old.keys() & new.keys()):
        was = {v.name: v for v in old[name].values}
        now = [(was.get(v.name), v) for v in new[name].values]
        moved += [Change(name, w, v) for w, v in now if w is not None and w.value != v.value]
    return Changes(
        tuple(new[n] for n in sorted(new.keys() - old.keys())),
        tuple(old[n] for n in sorted(old.keys() - new.keys())),
        tuple(moved),
    )


def order_of_addition(versions: Sequence[Version], names: Sequence[str]) -> tuple[str, ...]:
    """These effects in the order in which they came into the model; those that it always had first."""
    seen: list[str] = []
    for version in versions:
        seen = [n for n in seen if n in version.names] + [n for n in version.names if n not in seen]
    return tuple(sorted(names, key=lambda n: (seen.index(n) if n in seen else -1, n)))
