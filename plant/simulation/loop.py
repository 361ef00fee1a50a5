"""Loops of stages over signals: how everything that flies here is stepped.

A loop holds named signals: a state, readings, commands, the memory of effects. A stage computes new values of some of
them from all of them and from a row of inputs; the stages that are due at a step act one after the other. Stages are
written in numpy. Each is traced once (`plant.trace.arrays`) and then evaluated by compiled code. A stage that cannot be
traced, such as an effect of a user's own, or that must not be, such as a compensator, is called in numpy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.plant.trace.arrays import Node, Traced, Untraceable
from wrenchgap.plant.trace.tape import Tape, compiled, evaluate, program

Ints = NDArray[np.int64]


LINES, READS, ROWS, WRITES, LOGS, GIVEN, LOGGED = range(7)
"""Columns of `Plan.begin`."""


class Plan(NamedTuple):
    """S stages as compiled code takes them, each part of theirs one behind the other.

    code, value  (n, 4), (n,) lines of all tapes (`plant.trace.tape.Program`), and room for their values
    reads        (R, 2) a line, and the place of the signal that it takes
    rows         (G,) lines that take the row that is given
    writes       (W, 2) a line with a result, and the place of the signal that it becomes
    logs         (L,) places of signals that are kept
    given        all rows that are given
    logged       all that is kept
    begin        (S + 1, 7) where each of these begins for a stage
    every        (S,) steps from one time to the next
    calls        (S,) steps in which Python is asked instead
    stop         place of the signal that ends the loop where it is not zero
    """

    code: NDArray[np.int32]
    value: Array
    reads: Ints
    rows: Ints
    writes: Ints
    logs: Ints
    given: Array
    logged: Array
    begin: Ints
    every: Ints
    calls: Ints
    stop: int


@compiled
def act(plan: Plan, signals: Array, s: int, k: int) -> None:
    """Stage s, for the k-th time."""
    begin, end, value = plan.begin[s], plan.begin[s + 1], plan.value
    for i in range(begin[READS], end[READS]):
        value[plan.reads[i, 0]] = signals[plan.reads[i, 1]]
    width = end[ROWS] - begin[ROWS]
    for i in range(width):
        value[plan.rows[begin[ROWS] + i]] = plan.given[begin[GIVEN] + k * width + i]
    evaluate(plan, begin[LINES], end[LINES])
    for i in range(begin[WRITES], end[WRITES]):
        signals[plan.writes[i, 1]] = value[plan.writes[i, 0]]


@compiled
def keep(plan: Plan, signals: Array, s: int, k: int) -> None:
    """Log what stage s keeps, for the k-th time."""
    begin = plan.begin[s]
    width = plan.begin[s + 1, LOGS] - begin[LOGS]
    for i in range(width):
        plan.logged[begin[LOGGED] + k * width + i] = signals[plan.logs[begin[LOGS] + i]]


@compiled
def advance(plan: Plan, signals: Array, n: int, s: int, end: int) -> tuple[int, int]:
    """Steps from stage s of step n until step `end`, a stage that Python acts for, or one that stops the loop.

    The step, and the stage that is next: -1 where the loop was stopped.
    """
    count = len(plan.every)
    while n < end:
        while s < count:
            if n % plan.every[s] == 0:
                if n < plan.calls[s]:
                    return n, s
                act(plan, signals, s, n // plan.every[s])
                keep(plan, signals, s, n // plan.every[s])
                if signals[plan.stop] != 0.0:
                    return n, -1
            s += 1
        s = 0
        n += 1
    return n, 0


Signals = Mapping[str, Array]
"""Signals by name, each (C,)."""

ALWAYS = 2**62
"""Steps in which a stage is called that never runs compiled."""
REPORT = 200
"""Steps between two reports of progress."""


@dataclass(frozen=True, eq=False)
class Stage:
    """One part of a loop.

    act      new values of some signals, from all of them and from the row (C,) that is given
    given    (K, C): a row for each time that the stage is due; the caller says in which units
    every    steps from one time to the next
    log      signals whose values the loop keeps each time, as they are after the stage
    calls    steps in which `act` is called as it stands: 0, ALWAYS, or those before which it cannot be written down
    written  is written down in place of `act`, where that remembers things that are no signals
    foreign  holds a user's own code, and is called where that cannot be written down
    """

    name: str
    act: Callable[[Signals, Array], Signals]
    given: Array
    every: int = 1
    log: tuple[str, ...] = ()
    calls: int = 0
    written: Callable[[Signals, Array], Signals] | None = None
    foreign: bool = False


@dataclass(eq=False)
class Loop:
    """Stages that act in their order upon signals, which have their first values.

    stop    the first number of this signal ends the loop where it is not zero; without one it goes on to its end
    plain   no stage is compiled

    `called` says of foreign stages that cannot be compiled why.
    """

    signals: dict[str, Array]
    stages: Sequence[Stage]
    steps: int
    stop: str = "stop"
    plain: bool = False
    called: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.signals = {self.stop: np.zeros(1)} | self.signals
        ends = np.cumsum([len(value) for value in self.signals.values()])
        self._at = {
            name: slice(end - len(self.signals[name]), end) for name, end in zip(self.signals, ends, strict=True)
        }
        self._numbers = np.concatenate([np.asarray(value, dtype=float) for value in self.signals.values()])
        self._plan = self._compiled()

    def run(self, progress: Callable[[float], None] | None = None) -> tuple[int, bool]:
        """How many steps were made, and whether the loop was stopped in the one that followed."""
        n = s = 0
        while n < self.steps:
            if progress is not None and s == 0:
                progress(n / self.steps)
            n, s = advance(self._plan, self._numbers, n, s, min(n - n % REPORT + REPORT, self.steps))
            if s >= 0 and n < self.steps and self._due(n, s):
                s = self._call(n, s)
            if s < 0:
                return n, True
        if progress is not None:
            progress(1.0)
        return n, False

    def logged(self, stage: str, name: str, count: int) -> Array:
        """What a stage kept of a signal (count, C) in its first times."""
        s = [one.name for one in self.stages].index(stage)
        first = 0
        for other in self.stages[s].log:
            size = len(self.signals[other])
            if other == name:
                return self._log(s)[:count, first : first + size]
            first += size
        raise KeyError(name)

    def now(self, name: str) -> Array:
        """The present value (C,) of a signal, a copy."""
        return self._numbers[self._at[name]].copy()

    def _due(self, n: int, s: int) -> bool:
        return n < self._plan.calls[s] and n % self.stages[s].every == 0

    def _call(self, n: int, s: int) -> int:
        """Stage s in Python; the next, -1 where it stops the loop."""
        stage, k = self.stages[s], n // self.stages[s].every
        with np.errstate(over="ignore", invalid="ignore"):  # a state beyond all bounds is seen by who stops the loop
            made = stage.act({name: self.now(name) for name in self.signals}, stage.given[k])
        for name, value in made.items():
            self._numbers[self._at[name]] = value
        keep(self._plan, self._numbers, s, k)
        return -1 if self._numbers[self._plan.stop] != 0.0 else s + 1

    def _log(self, s: int) -> Array:
        first, last = self._plan.begin[s : s + 2, LOGGED]
        return self._plan.logged[first:last].reshape(self._times(s), -1)

    def _times(self, s: int) -> int:
        """How often a stage is due."""
        return -(-self.steps // self.stages[s].every)

    def _compiled(self) -> Plan:
        """All stages in one table; what cannot be written down is called."""
        parts, calls = [], []
        for s in range(len(self.stages)):
            part, asked = self._part(s)
            parts.append(part)
            calls.append(asked)
        starts = np.concatenate(([0], np.cumsum([len(part.code) for part in parts])))
        for part, start in zip(parts, starts.tolist(), strict=False):
            part.code[:, 1:] += start
            part.reads[:, 0] += start
            part.writes[:, 0] += start
            part.rows[:] += start
        names = ("code", "reads", "rows", "writes", "logs", "given", "logged")  # columns of `Plan.begin`
        sizes = np.array([[len(getattr(part, name)) for name in names] for part in parts])
        whole = {name: np.concatenate([getattr(part, name) for part in parts]) for name in (*names, "value")}
        return Plan(
            **whole,
            begin=np.vstack((np.zeros((1, len(names)), dtype=int), np.cumsum(sizes, axis=0))),
            every=np.array([stage.every for stage in self.stages]),
            calls=np.array(calls),
            stop=self._at[self.stop].start,
        )

    def _part(self, s: int) -> tuple[_Part, int]:
        """What a stage adds to the table, and in how many steps it is called."""
        stage = self.stages[s]
        logs = np.array([k for name in stage.log for k in self._places(name)], dtype=np.int64)
        asked = ALWAYS if self.plain else stage.calls
        part = _Part(logs=logs, logged=np.zeros(self._times(s) * len(logs)))
        if asked == ALWAYS:
            return part, asked
        try:
            return self._written(stage, part), asked
        except Untraceable as error:
            if not stage.foreign:
                raise
            self.called[stage.name] = str(error)
            return part, ALWAYS

    def _places(self, name: str) -> range:
        return range(self._at[name].start, self._at[name].stop)

    def _written(self, stage: Stage, part: _Part) -> _Part:
        """The part of a stage with its tape. Raises Untraceable."""
        tape = Tape()

        def inputs(name: str, size: int) -> Traced:
            return Traced.of([Node(tape, tape.input(f"{name} {k}")) for k in range(size)])

        known = {name: inputs(name, len(value)) for name, value in self.signals.items()}
        row = inputs("given", stage.given.shape[1])
        try:
            made = (stage.written or stage.act)(known, row)
        except (TypeError, AttributeError, ValueError) as error:
            raise Untraceable(f"{stage.name}: {' '.join(str(error).split())}") from None
        results = {
            place: node.line if isinstance(node, Node) else tape.constant(float(node))
            for name, values in made.items()
            for place, node in zip(self._places(name), np.asarray(values, dtype=object), strict=True)
        }
        asked = tape.needed(list(results.values()))
        lines = [(node.line, k) for name in known for node, k in zip(known[name], self._places(name), strict=True)]
        reads = [(line, k) for line, k in lines if line in asked]
        rows = [node.line for node in row] if any(node.line in asked for node in row) else []
        found = program(tape, [*(line for line, _ in reads), *rows], [], list(results.values()))
        return replace(
            part,
            code=found.code,
            value=found.start,
            reads=_pairs(found.inputs[: len(reads)], [k for _, k in reads]),
            rows=found.inputs[len(reads) :],
            writes=_pairs(found.results, list(results)),
            given=np.ravel(stage.given).astype(float) if rows else np.zeros(0),
        )


def _integers(*shape: int) -> Ints:
    return np.zeros(shape, dtype=np.int64)


def _pairs(lines: Ints, places: Sequence[int]) -> Ints:
    return np.column_stack((lines, np.array(places, dtype=np.int64)))


@dataclass(frozen=True, eq=False)
class _Part:
    """What one stage is in a `Plan`; nothing where it is called."""

    logs: Ints
    logged: Array
    code: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 4), dtype=np.int32))
    value: Array = field(default_factory=lambda: np.zeros(0))
    reads: Ints = field(default_factory=lambda: _integers(0, 2))
    rows: Ints = field(default_factory=lambda: _integers(0))
    writes: Ints = field(default_factory=lambda: _integers(0, 2))
    given: Array = field(default_factory=lambda: np.zeros(0))
