"""Loops of stages over signals, in which every closed loop is stepped.

A loop holds named signals: a state, readings, commands, the memory of effects. A stage computes new values of some of
them from all of them and from a row of inputs; the stages that are due at a step act one after the other. Stages are
written in numpy. Each is traced once (`plant.trace.arrays`) and then evaluated by compiled code. A stage that cannot be
traced, such as an effect of a user's own, or that must not be, such as a compensator, is called in numpy.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.plant.trace.arrays import Node, Traced, Untraceable
from wrenchgap.plant.trace.tape import Tape, compiled, evaluate, program

Ints = NDArray[np.int64]
Signals = Mapping[str, Array]
"""Signals by name, each (C,)."""

LINES, READS, ROWS, WRITES, LOGS, INPUTS, LOGGED = range(7)
"""Columns of `StageTable.begin`."""
ALWAYS = np.iinfo(np.int64).max
"""Number of numpy steps of a stage that is never compiled."""


class StageTable(NamedTuple):
    """S stages as compiled code takes them: each array holds the parts of all stages, one after the other."""

    code: NDArray[np.int32]  # (n, 4) lines of all tapes (`plant.trace.tape.Program`)
    value: Array  # (n,) of their results
    reads: Ints  # (R, 2) a line, and the index of the signal value that it takes
    rows: Ints  # (G,) lines that take the row of inputs
    writes: Ints  # (W, 2) a line with a result, and the index of the signal value that it sets
    logs: Ints  # (L,) indices of the signal values that are logged
    inputs: Array  # all rows of inputs
    logged: Array  # all logged values
    begin: Ints  # (S + 1, 7) where each of these begins for a stage
    every: Ints  # (S,) see `Stage`, as the next
    numpy_steps: Ints  # (S,)
    stop: int  # index of the signal value that ends the loop where it is not zero


@compiled
def evaluate_stage(table: StageTable, signals: Array, s: int, k: int) -> None:
    """Evaluate stage s for the k-th time."""
    begin, end, value = table.begin[s], table.begin[s + 1], table.value
    for i in range(begin[READS], end[READS]):
        value[table.reads[i, 0]] = signals[table.reads[i, 1]]
    width = end[ROWS] - begin[ROWS]
    for i in range(width):
        value[table.rows[begin[ROWS] + i]] = table.inputs[begin[INPUTS] + k * width + i]
    evaluate(table, begin[LINES], end[LINES])
    for i in range(begin[WRITES], end[WRITES]):
        signals[table.writes[i, 1]] = value[table.writes[i, 0]]


@compiled
def log_signals(table: StageTable, signals: Array, s: int, k: int) -> None:
    """Log the signals of stage s for the k-th time."""
    begin = table.begin[s]
    width = table.begin[s + 1, LOGS] - begin[LOGS]
    for i in range(width):
        table.logged[begin[LOGGED] + k * width + i] = signals[table.logs[begin[LOGS] + i]]


@compiled
def advance(table: StageTable, signals: Array, n: int, s: int, end: int) -> tuple[int, int]:
    """Run from stage s of step n until step `end`, a stage that is called in numpy, or one that stops the loop.

    Returns
    -------
    tuple[int, int]
        The step, and the next stage in it; -1 where the loop was stopped.
    """
    count = len(table.every)
    while n < end:
        while s < count:
            if n % table.every[s] == 0:
                if n < table.numpy_steps[s]:
                    return n, s
                evaluate_stage(table, signals, s, n // table.every[s])
                log_signals(table, signals, s, n // table.every[s])
                if signals[table.stop] != 0.0:
                    return n, -1
            s += 1
        s = 0
        n += 1
    return n, 0


@dataclass(frozen=True, eq=False)
class Stage:
    """One part of a loop: `act` gives new values of some signals, from all signals and the row (C,) of `inputs`.

    A row of `inputs` (K, C), in units of the caller's choice, is for one time that the stage is due.
    """

    name: str
    act: Callable[[Signals, Array], Signals]
    inputs: Array
    every: int = 1  # steps from one time that it is due to the next
    log: tuple[str, ...] = ()  # signals that the loop logs each time, as they are after the stage
    numpy_steps: int = 0  # steps in which `act` is called in numpy: 0, ALWAYS, or those after which it can be traced
    traced: Callable[[Signals, Array], Signals] | None = None  # in place of `act`, if that has a memory of its own
    user_code: bool = False  # whether it holds a user's own code, called in numpy where it cannot be traced


@dataclass(frozen=True, eq=False)
class _Part:
    """The arrays of one stage in a `StageTable`; empty where it is called in numpy."""

    logs: Ints
    logged: Array
    code: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 4), dtype=np.int32))
    value: Array = field(default_factory=lambda: np.zeros(0))
    reads: Ints = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    rows: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    writes: Ints = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    inputs: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(eq=False)
class Loop:
    """Stages that act in their order upon signals, which hold their first values."""

    signals: dict[str, Array]
    stages: Sequence[Stage]
    steps: int
    stop: str = "stop"  # the signal whose first value ends the loop where it is not zero
    compiled: bool = True  # False: all stages are called in numpy
    report_every: int = 200  # steps between two reports of progress: some milliseconds of compiled code
    not_compiled: dict[str, str] = field(default_factory=dict)  # why a stage with user code is called in numpy

    def __post_init__(self) -> None:
        self.signals = {self.stop: np.zeros(1)} | self.signals
        ends = np.cumsum([len(value) for value in self.signals.values()]).tolist()
        sizes = zip(self.signals.items(), ends, strict=True)
        self._at = {name: slice(end - len(value), end) for (name, value), end in sizes}
        self._places = {name: range(at.start, at.stop) for name, at in self._at.items()}
        self._values = np.concatenate([np.asarray(value, dtype=float) for value in self.signals.values()])
        self._table = self._stage_table()

    def run(self, progress: Callable[[float], None] | None = None) -> tuple[int, bool]:
        """The number of complete steps, and whether the loop was stopped in the one that followed."""
        n, s, every = 0, 0, self.report_every
        while n < self.steps:
            if progress is not None and s == 0:
                progress(n / self.steps)
            n, s = advance(self._table, self._values, n, s, min(n - n % every + every, self.steps))
            if s >= 0 and n < self.steps and n < self._table.numpy_steps[s] and n % self.stages[s].every == 0:
                s = self._numpy_step(n, s)
            if s < 0:
                return n, True
        if progress is not None:
            progress(1.0)
        return n, False

    def logged(self, stage: str, name: str, count: int) -> Array:
        """Logged values (count, C) of a signal, from the first `count` times of a stage."""
        s = [one.name for one in self.stages].index(stage)
        log = self.stages[s].log
        before, width = (sum(len(self.signals[one]) for one in names) for names in (log[: log.index(name)], log))
        begin, end = self._table.begin[s : s + 2, LOGGED]
        rows = self._table.logged[begin:end].reshape(-1, width)
        return rows[:count, before : before + len(self.signals[name])]

    def now(self, name: str) -> Array:
        """The present value (C,) of a signal, a copy."""
        return self._values[self._at[name]].copy()

    def _numpy_step(self, n: int, s: int) -> int:
        """Call stage s in numpy; the index of the next stage, -1 where it stops the loop."""
        stage, k = self.stages[s], n // self.stages[s].every
        with np.errstate(over="ignore", invalid="ignore"):  # a state that is not finite stops the loop
            changed = stage.act({name: self.now(name) for name in self.signals}, stage.inputs[k])
        for name, value in changed.items():
            self._values[self._at[name]] = value
        log_signals(self._table, self._values, s, k)
        return -1 if self._values[self._table.stop] != 0.0 else s + 1

    def _stage_table(self) -> StageTable:
        """All stages in one table."""
        parts, numpy_steps = zip(*map(self._part, self.stages), strict=True)
        starts = np.concatenate(([0], np.cumsum([len(part.code) for part in parts])))
        for part, start in zip(parts, starts.tolist(), strict=False):
            part.code[:, 1:] += start
            part.reads[:, 0] += start
            part.writes[:, 0] += start
            part.rows[:] += start
        names = ("code", "reads", "rows", "writes", "logs", "inputs", "logged")  # columns of `StageTable.begin`
        sizes = np.array([[len(getattr(part, name)) for name in names] for part in parts])
        joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in (*names, "value")}
        return StageTable(
            **joined,
            begin=np.vstack((np.zeros((1, len(names)), dtype=int), np.cumsum(sizes, axis=0))),
            every=np.array([stage.every for stage in self.stages]),
            numpy_steps=np.array(numpy_steps),
            stop=self._at[self.stop].start,
        )

    def _part(self, stage: Stage) -> tuple[_Part, int]:
        """The part of a stage in the table, and the number of its numpy steps."""
        logs = np.array([k for name in stage.log for k in self._places[name]], dtype=np.int64)
        numpy_steps = stage.numpy_steps if self.compiled else ALWAYS
        times = -(-self.steps // stage.every)  # that it is due
        part = _Part(logs=logs, logged=np.zeros(times * len(logs)))
        if numpy_steps == ALWAYS:
            return part, numpy_steps
        try:
            return self._traced_part(stage, part), numpy_steps
        except Untraceable as error:
            if not stage.user_code:
                raise
            self.not_compiled[stage.name] = str(error)
            return part, ALWAYS

    def _traced_part(self, stage: Stage, part: _Part) -> _Part:
        """The part with the tape of its stage; raises Untraceable."""
        tape = Tape()

        def nodes(name: str, size: int) -> Traced:
            return Traced.of([Node(tape, tape.input(f"{name} {k}")) for k in range(size)])

        signals = {name: nodes(name, len(value)) for name, value in self.signals.items()}
        row = nodes("input", stage.inputs.shape[1])
        try:
            changed = (stage.traced or stage.act)(signals, row)
        except (TypeError, AttributeError, ValueError) as error:
            raise Untraceable(f"{stage.name}: {' '.join(str(error).split())}") from None
        results = {
            place: node.line if isinstance(node, Node) else tape.constant(float(node))
            for name, values in changed.items()
            for place, node in zip(self._places[name], np.asarray(values, dtype=object), strict=True)
        }
        needed = tape.needed(list(results.values()))
        lines = [(node.line, k) for name in signals for node, k in zip(signals[name], self._places[name], strict=True)]
        reads = [(line, k) for line, k in lines if line in needed]
        rows = [node.line for node in row] if any(node.line in needed for node in row) else []
        compact = program(tape, [*(line for line, _ in reads), *rows], [], list(results.values()))
        return replace(
            part,
            code=compact.code,
            value=compact.start,
            reads=_pairs(compact.inputs[: len(reads)], [k for _, k in reads]),
            rows=compact.inputs[len(reads) :],
            writes=_pairs(compact.results, list(results)),
            inputs=np.ravel(stage.inputs).astype(float) if rows else np.zeros(0),
        )


def _pairs(lines: Ints, places: Sequence[int]) -> Ints:
    return np.column_stack((lines, np.array(places, dtype=np.int64)))
