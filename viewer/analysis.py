"""What the panels ask of a session: where the model fails, which effects explain it, what a compensation would do.

Plain data only. Methods that take long take a `report` (share done, words) and are called on a thread beside the page;
all others must be quick: the page waits for them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.viewer.background import Report as Report
from wrenchgap.viewer.scene import Motion, Stretch

VIEWS = ("all axes", "force", "torque", *AXES)
"""What an error may be looked at: everything on one scale [N], the norms of force [N] and torque [Nm], one axis."""
UNITS = ("N", "N", "Nm", *("N" if axis.startswith("force") else "Nm" for axis in AXES))


@dataclass(frozen=True)
class Cell:
    """The time in which something was within bounds.

    `words` are the bounds, `seconds` how long it was; per view (V,): `rms` of the error, its `mean` (of one axis with
    its sign, of several the norm), `noise` of the sensors, and `time` [s], the instant at which the error was largest.
    """

    words: str
    seconds: float
    rms: Array
    mean: Array
    noise: Array
    time: Array


@dataclass(frozen=True)
class Quantity:
    """How the error goes with one quantity; `words` say how much of it does, `sure` whether that is beyond chance."""

    label: str
    unit: str
    words: str
    sure: bool
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class Grid:
    """The error over two quantities; `rows[i][j]` is the cell of the i-th bin of y and the j-th of x, or None."""

    x_label: str
    y_label: str
    rows: tuple[tuple[Cell | None, ...], ...]
    x_words: tuple[str, ...]
    y_words: tuple[str, ...]


@dataclass(frozen=True)
class Budget:
    """What the mean square error of the nominal model is made of, on one axis or on all.

    `rms` is of the nominal model; the parts are shares of its square and add up to one. `process` is None where no
    Gaussian process was asked; what it would explain is then in `unexplained`.
    """

    view: str
    unit: str
    rms: float
    noise: float
    physics: float
    process: float | None
    unexplained: float


@dataclass(frozen=True)
class Failure:
    """Where a model fails on one flight: quantities, those first with which most of the error goes."""

    flight: str
    model: str
    quantities: tuple[Quantity, ...]
    grid: Grid | None
    budget: tuple[Budget, ...]
    worst: tuple[Stretch, ...]
    sentences: tuple[str, ...]
    lacking: tuple[str, ...]


class Failures(Protocol):
    """What the failure panel asks."""

    def of(self, flight: str) -> Failure:
        """Where the model as it stands fails on a flight; the budget without a Gaussian process."""

    def full_budget(self, flight: str, report: Report) -> tuple[Budget, ...]:
        """The budget with what a Gaussian process would explain; takes seconds."""


@dataclass(frozen=True)
class Value:
    """One parameter: `low` and `high` bound what is plausible, `scale` is a typical size, `std` None if not fitted."""

    name: str
    unit: str
    value: float
    std: float | None
    low: float
    high: float
    scale: float


@dataclass(frozen=True)
class Installed:
    """An effect of the model as it stands, and where its values come from, in a few words."""

    name: str
    values: tuple[Value, ...]
    source: str


@dataclass(frozen=True)
class Stair:
    """One step down: the rms (6,) that is left, and in all [N], newton metres on the scale of newtons."""

    name: str
    rms: Array
    in_all: float


@dataclass(frozen=True)
class Staircase:
    """The error on one flight (or on some) from the nominal vehicle downwards; `held_out` if nothing was fitted there.

    The last of `stairs` is the model as it stands.
    """

    title: str
    stairs: tuple[Stair, ...]
    noise: Stair
    held_out: bool


@dataclass(frozen=True)
class ModelState:
    """The model as it stands. `undo`, `redo` say what would be undone and done again, empty where there is nothing.

    `available` are names of effects that can be added; `lacking` those that cannot, by reason.
    """

    model: str
    installed: tuple[Installed, ...]
    available: tuple[str, ...]
    lacking: tuple[tuple[str, tuple[str, ...]], ...]
    undo: str
    redo: str
    saved: bool
    words: str


@dataclass(frozen=True)
class Candidate:
    """One effect of the ranking: `score` is the share of the error energy that it takes off by itself on held-out time,
    `t` how sure that is (3 and more is no chance), `falls` (6,) the fractions of rms; `mark` is one of "chosen",
    "alike" (cannot be told from a chosen one), "implausible", "".
    """  # noqa: D205

    name: str
    score: float
    t: float
    falls: Array
    values: str
    mark: str


@dataclass(frozen=True)
class Named:
    """An effect that is missing: how sure (0 to 1), its share of the error, its values, what cannot be told from it."""

    name: str
    sure: float
    share: float
    t: float
    values: tuple[Value, ...]
    alike: tuple[str, ...]


@dataclass(frozen=True)
class Ranking:
    """What is missing in a model on a flight: verdict (effect, group, unknown, nothing), and the evidence."""

    flight: str
    model: str
    verdict: str
    sentence: str
    named: tuple[Named, ...]
    candidates: tuple[Candidate, ...]
    groups: tuple[tuple[str, ...], ...]
    open: tuple[str, ...]
    not_tried: tuple[str, ...]


@dataclass(frozen=True)
class NextFlight:
    """A flight that would tell effects apart: `position_E` (K, 3) of its reference at `time` (K,) [s], and its file.

    `separable` is false where no flight does; `sentence` says so, `advice` what would help instead.
    """

    names: tuple[str, ...]
    separable: bool
    sentence: str
    advice: tuple[str, ...]
    moves: str
    time: Array
    position_E: Array
    quat_ED: Array
    text: str


class Effects(Protocol):
    """What the effects panel asks. Whatever changes the model can be undone."""

    def state(self, flight: str) -> ModelState:
        """The model as it stands, seen from a flight."""

    def staircases(self, flight: str) -> tuple[Staircase, ...]:
        """The errors down to the model as it stands, on this flight and on others; takes a while on a long one."""

    def add(self, names: tuple[str, ...], flight: str) -> None:
        """Put effects in, fitted on the flight together with those that are in."""

    def remove(self, name: str) -> None:
        """Take one out; the others keep their values."""

    def refit(self, flight: str) -> None:
        """Fit all that are in anew on the flight."""

    def set_value(self, effect: str, parameter: str, value: float) -> None:
        """Set a parameter by hand; several in a row of one effect are one change."""

    def undo(self) -> None:
        """Take the last change back."""

    def redo(self) -> None:
        """Do again what was taken back."""

    @property
    def saves(self) -> bool:
        """Whether the session has a folder to save into."""

    def save(self, name: str) -> str:
        """Write the model with its history into the session's folder; what was written, in words."""

    def model_text(self, name: str) -> str:
        """The same as text, for a session that has no folder. Raises UsageError for a bad name, as `save` does."""

    def save_trajectory(self, found: NextFlight, name: str) -> str:
        """Write a designed flight as a trajectory file into the session's folder; what was written, in words."""

    def explain(self, flight: str, report: Report) -> Ranking:
        """Search for what is missing; takes long."""

    def next_flight(self, names: tuple[str, ...], flight: str, report: Report) -> NextFlight:
        """Search for the flight that tells these effects apart; takes long."""


@dataclass(frozen=True)
class Gating:
    """Settings of the compensation: on or off; sigma_th and kappa of the gate, decay time [s] of what is withheld.

    With `gated` off the correction is taken whatever its uncertainty.
    """

    on: bool
    gated: bool
    sigma_threshold: float
    kappa: float
    decay_time: float


@dataclass(frozen=True)
class Compensation:
    """The compensation as it is set, for a GP called `name`, and the ranges of its sliders."""

    name: str
    gating: Gating
    sigma_threshold_max: float
    kappa_max: float
    decay_time_max: float
    unit: str
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Compensated:
    """A replay: rows (label, before, after) of what the correction does, and sentences."""

    rows: tuple[tuple[str, str, str], ...]
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class Reflown:
    """A counterfactual: the re-flight to be drawn, and tracking errors, rows (label, recorded, null run, re-flown)."""

    motion: Motion
    rows: tuple[tuple[str, str, str, str], ...]
    sentences: tuple[str, ...]


class Compensations(Protocol):
    """What the compensation panel asks."""

    setting: Compensation | None
    """The compensation as it is set, None without a GP."""

    def set(self, gating: Gating) -> None:
        """Change it; what was replayed with other settings is forgotten."""

    def replay(self, flight: str, report: Report) -> Compensated:
        """Replay the compensation on a flight; afterwards the flight's scene has what it did. Takes seconds."""

    def refly(self, flight: str, start: float, duration: float, report: Report) -> Reflown:
        """Fly (a part of) a flight again with the compensation in the loop, or without where it is off; takes long."""
