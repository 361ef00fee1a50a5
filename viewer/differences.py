"""What the panel about several flights asks of a session: what differs between them beyond what healthy ones do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from wrenchgap.flight.flight import Array
from wrenchgap.viewer.background import Report


@dataclass(frozen=True)
class FlightMean:
    """The mean (6,) [N, Nm] of what the model leaves on a flight; `role` is "healthy", "odd" or "suspect", `beyond`
    (6,) its distance from that of the healthy flights, in what healthy flights differ by.
    """  # noqa: D205

    flight: str
    role: str
    mean: Array
    beyond: Array


@dataclass(frozen=True)
class Change:
    """One parameter that changed; `where` is the user's name of rotor, arm or sensor, `words` its values."""

    effect: str
    where: str
    words: str
    significance: float


@dataclass(frozen=True)
class Differences:
    """What changed on the `suspect` flight against healthy ones: verdict (changed, nothing, unknown) and evidence.

    `effects` are those whose change can be put into the model; `inspect` says where to look on the vehicle.
    """

    suspect: str
    healthy: tuple[str, ...]
    model: str
    verdict: str
    sentences: tuple[str, ...]
    changes: tuple[Change, ...]
    rows: tuple[FlightMean, ...]
    inspect: tuple[str, ...]
    effects: tuple[str, ...]


class Comparisons(Protocol):
    """What the panel asks."""

    def of(self, suspect: str, healthy: tuple[str, ...], report: Report) -> Differences:
        """Compare one flight with others of the same vehicle on which all was well; takes long."""

    def add(self, found: Differences) -> None:
        """Put what changed into the model, with the sizes that were found; can be undone."""
