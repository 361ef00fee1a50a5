"""Which clock a flight is told in.

A message has up to two times: the header's stamp, given where it was made, and the log's, given where it was recorded.
The stamp is the better one, unless it belongs to another clock than the other topics' stamps. Such clocks occur: a
simulator at half real time, a microcontroller that counts from its start. The relation between a topic's stamps and
its log times tells:

    stamp = offset + rate * log time - delay,    delay >= 0

so the upper edge of (stamp - line) is where the delay was least. A foreign clock is mapped along that edge, which may
bend: simulators do not keep a constant rate.

Velocities and accelerations are only right in the clock of the motion. Where that clock runs at another rate than the
log's, the flight is told in the motion's clock and everything else is mapped to it; otherwise in the log's.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from wrenchgap.flight.flight import Array, Mask, Stamps
from wrenchgap.flight.formats import Table
from wrenchgap.flight.stamps import thinned


@dataclass(frozen=True)
class ClockLimits:
    """When stamps are of another clock than the log's."""

    same_offset: float = 1.0
    """Offset from the log's clock [s] up to which stamps are of that clock: transport delay."""
    same_rate: float = 0.01
    """Relative difference in rate up to which it is a drift and not another kind of time."""
    tilt: float = 5.2
    """Residuals over the span by which arrivals in bursts can tilt a line: 1.5 times their range of sqrt(12)."""
    shortest: float = 2.0
    """Span of a topic [s] below which it has no rate worth the name."""
    edge_window: float = 0.5
    """Time [s] for which a foreign clock's map has one knot."""
    unit_within: float = 0.005
    """Relative difference within which a rate is that of another unit (`UNIT_RATES`)."""
    jump: float = 1.0
    """Step away from the log's clock [s] that stays there: somebody set a clock."""
    slowest: float = 1e-9
    """Rate, of real time, below which a clock stands still."""
    messages: int = 10_000
    """Messages of a topic that a relation is told from, at most."""
    straight: float = 0.002
    """Residual [s] below which a relation is a line."""
    simulated: float = 0.01
    """How far from one the rate of a clock is that no quartz keeps: those of autopilots are 1e-4 off at most."""


CLOCKS = ClockLimits()


UNIT_RATES = {
    1e3: "milliseconds",
    1e6: "microseconds",
    1e9: "nanoseconds",
    1e-3: "microseconds where nanoseconds were meant",
    1e-6: "milliseconds where nanoseconds were meant",
}
"""Rates of stamps that are no clock but another unit."""


@dataclass(frozen=True)
class Relation:
    """How a topic's stamps relate to its log times: `rate` (stamp seconds per log second), median `offset` [s].

    `residual` [s] is the standard deviation of the stamps from the best line: jitter of the transport, or the bends
    of a clock that is not steady. `span` [s] is the time that they are from.
    """

    rate: float
    offset: float
    residual: float
    span: float = np.inf

    @property
    def doubt(self) -> float:
        """By how much the rate may be off because messages arrive late, and in bursts."""
        return CLOCKS.tilt * self.residual / self.span

    @property
    def same_rate(self) -> bool:
        """Whether the stamps advance as the log's clock does, as far as can be told."""
        return abs(self.rate - 1.0) <= CLOCKS.same_rate + self.doubt

    @property
    def kind(self) -> str:
        """What it is by its rate, after a comma: a simulation's time, which runs as fast as the computer can."""
        real = abs(self.rate - 1.0) <= CLOCKS.simulated + self.doubt or self.unit is not None
        return "" if real else ", as simulation time does"

    @property
    def unit(self) -> float | None:
        """The rate that this one is within half a per cent, where that is a power of a thousand; else None."""
        return next((u for u in UNIT_RATES if abs(self.rate / u - 1.0) < CLOCKS.unit_within), None)

    @property
    def same(self) -> bool:
        """Whether the stamps are of the log's clock."""
        return self.same_rate and abs(self.offset) <= CLOCKS.same_offset


def relation(log_time_ns: Stamps, header_ns: Stamps) -> Relation:
    """Fit stamps against log times, robustly: two rounds without the points further than 5 median deviations out.

    Of many messages, those of `CLOCKS.messages` that are evenly spread.
    """
    if np.array_equal(log_time_ns, header_ns):  # many recorders write one time twice
        return Relation(1.0, 0.0, 0.0)
    rows = thinned(len(header_ns), CLOCKS.messages)
    log_time_ns, header_ns = log_time_ns[rows], header_ns[rows]
    x, y = _seconds(log_time_ns), _seconds(header_ns)
    offset = float(np.median((header_ns - log_time_ns) * 1e-9))
    if len(x) < 3 or x[-1] - x[0] < CLOCKS.shortest:
        return Relation(1.0, offset, float(np.std(y - x)))
    rate, _, inliers = _line(x, y)
    x, y = x[inliers], y[inliers]
    slope, intercept = _straight(x, y)
    return Relation(rate, offset, float(np.std(y - intercept - slope * x)), float(np.ptp(x)))


def without_jumps(log_time_ns: Stamps, header_ns: Stamps) -> tuple[Stamps, tuple[tuple[int, float], ...]]:
    """Stamps that go on as if nobody had set the clock, and the jumps: index of the first message after, and seconds.

    A jump is a step of stamps against log times by more than `CLOCKS.jump` that lasts; one wrong stamp, or a pause of
    both, is none.
    """
    if len(header_ns) < 20 or np.array_equal(log_time_ns, header_ns):
        return header_ns, ()
    dx, dy = np.diff(log_time_ns) * 1e-9, np.diff(header_ns) * 1e-9
    rows = thinned(len(dx), CLOCKS.messages)
    forward = dx[rows] > 0
    rate = float(np.median(dy[rows][forward] / dx[rows][forward])) if np.any(forward) else 1.0
    step = dy - rate * dx
    moved, jumps = header_ns.copy(), []
    for i in np.flatnonzero(np.abs(step) > CLOCKS.jump + 0.2 * np.abs(dx)):
        around = slice(max(i - 5, 0), i), slice(i + 1, i + 6)
        steady = all(float(np.abs(np.sum(step[part]))) < 0.5 * abs(step[i]) for part in around)
        if steady and i + 5 < len(header_ns):
            moved[i + 1 :] -= round(float(step[i]) * 1e9)
            jumps.append((int(i) + 1, float(step[i])))
    return moved, tuple(jumps)


@dataclass(frozen=True)
class ClockMap:
    """Maps log times to another clock: piecewise linear between knots, straight on at `rate` outside."""

    log_origin_ns: int
    origin_ns: int
    log_knots: Array  # s since log_origin_ns
    knots: Array  # s since origin_ns
    rate: float

    def __call__(self, log_time_ns: Stamps) -> Stamps:
        """Stamps [ns] of the other clock."""
        x = (log_time_ns - self.log_origin_ns) * 1e-9
        y = np.interp(x, self.log_knots, self.knots)
        y = y + self.rate * (np.minimum(x - self.log_knots[0], 0.0) + np.maximum(x - self.log_knots[-1], 0.0))
        return self.origin_ns + _nanoseconds(y)

    def inverse(self, stamps_ns: Stamps) -> Stamps:
        """Log times [ns] of stamps of the other clock."""
        y = (stamps_ns - self.origin_ns) * 1e-9
        x = np.interp(y, self.knots, self.log_knots)
        rate = self.rate if self.rate > CLOCKS.slowest else 1.0  # a clock that stands still tells no time
        x = x + (np.minimum(y - self.knots[0], 0.0) + np.maximum(y - self.knots[-1], 0.0)) / rate
        return self.log_origin_ns + _nanoseconds(x)


def clock_map(log_time_ns: Stamps, header_ns: Stamps) -> ClockMap:
    """The map along the edge of least delay; a straight line where the relation is one."""
    x, y = _seconds(log_time_ns), _seconds(header_ns)
    rate, offset, inliers = _line(x, y)
    x, y = x[inliers], y[inliers]
    residual = y - offset - rate * x
    if np.std(residual) < CLOCKS.straight:
        ends = np.array([x[0], x[-1]])
        return ClockMap(int(log_time_ns[0]), int(header_ns[0]), ends, offset + rate * ends, rate)
    window = np.floor((x - x[0]) / CLOCKS.edge_window).astype(int)
    groups = np.split(np.arange(len(x)), np.flatnonzero(np.diff(window)) + 1)
    best = [members[np.argmax(residual[members])] for members in groups]
    log_knots, knots = x[best], np.maximum.accumulate(y[best])
    keep = np.concatenate(([True], (np.diff(knots) > 0) & (np.diff(log_knots) > 0)))
    return ClockMap(int(log_time_ns[0]), int(header_ns[0]), log_knots[keep], knots[keep], rate)


@dataclass(frozen=True)
class Timing:
    """Stamps [ns] by topic on the flight's one clock, and what had to be done to get there.

    `mapped` are the topics whose times were mapped to another clock.
    """

    stamps: dict[str, Stamps]
    relations: dict[str, Relation]
    notes: tuple[str, ...]
    jumps: dict[str, tuple[tuple[int, float], ...]] = field(default_factory=dict)
    mapped: tuple[str, ...] = ()


def one_clock(tables: Mapping[str, Table], motion: Iterable[str] = ()) -> Timing:
    """Put all `tables` on one clock; `motion` are topics whose clock is that of the vehicle's motion, best first.

    Jumps of the stamps are taken out before.
    """
    steady, jumps, relations = dict(tables), dict[str, tuple[tuple[int, float], ...]](), dict[str, Relation]()
    for topic, table in tables.items():
        if table.header_ns is not None:
            moved, found = without_jumps(table.log_time_ns, table.header_ns)
            if found:
                jumps[topic], steady[topic] = found, replace(table, header_ns=moved)
            relations[topic] = relation(table.log_time_ns, moved)
    base = next((topic for topic in motion if topic in relations and not relations[topic].same_rate), None)
    if base is None:
        stamps, notes, mapped = _in_log_clock(steady, relations)
        unstamped = [topic for topic in tables if topic not in relations]
        if unstamped:
            notes.append(f"Log time is used for {', '.join(unstamped)}: no header stamps.")
    else:
        stamps, notes, mapped = _in_clock_of(base, steady, relations)
    notes += [
        f"{topic}: its stamps jump by {', '.join(f'{by:+.3f} s' for _, by in found)} against log time: taken out."
        for topic, found in jumps.items()
    ]
    return Timing(stamps, relations, tuple(notes), jumps, tuple(mapped))


def _in_log_clock(
    tables: Mapping[str, Table], relations: Mapping[str, Relation]
) -> tuple[dict[str, Stamps], list[str], list[str]]:
    foreign = [topic for topic, found in relations.items() if not found.same]
    if foreign and len(foreign) == len(tables) and _agree([relations[topic] for topic in foreign]):
        stamps = {topic: table.header_ns for topic, table in tables.items() if table.header_ns is not None}
        return stamps, [_one_foreign(relations[foreign[0]])], []
    notes = [
        f"Two clocks: {topic} {_describe(relations[topic])}; its stamps were mapped to log time."
        for topic in tables
        if topic in foreign
    ]
    return {topic: _log_times(table, relations.get(topic)) for topic, table in tables.items()}, notes, foreign


def _in_clock_of(
    base: str, tables: Mapping[str, Table], relations: Mapping[str, Relation]
) -> tuple[dict[str, Stamps], list[str], list[str]]:
    reference, found = tables[base], relations[base]
    assert reference.header_ns is not None
    to_base = clock_map(reference.log_time_ns, reference.header_ns)
    stamps: dict[str, Stamps] = {}
    mapped: list[str] = []
    for topic, table in tables.items():
        if table.header_ns is not None and _agree([found, relations[topic]]):
            stamps[topic] = table.header_ns
        else:
            stamps[topic] = to_base(_log_times(table, relations.get(topic)))
            mapped.append(topic)
    if not mapped:
        return stamps, [_one_foreign(found)], mapped
    then = f"mapped to it: {', '.join(mapped)}."
    notes = [f"Two clocks: {base} {_describe(found)}. All times are given in that clock; {then}"]
    if found.residual > CLOCKS.straight:
        notes.append(
            f"The two clocks are not in a linear relation (residual {1e3 * found.residual:.0f} ms): the map is "
            f"piecewise linear, {CLOCKS.edge_window} s each; expect tens of ms of error between topics of different "
            "clocks."
        )
    return stamps, notes, mapped


def _one_foreign(found: Relation) -> str:
    return f"Header stamps are used; they differ from log time: {_describe(found)}."


def _log_times(table: Table, found: Relation | None) -> Stamps:
    """Log times; better, stamps of the same clock; or foreign stamps mapped to it."""
    if found is None or table.header_ns is None:
        return table.log_time_ns
    if found.same:
        return table.header_ns
    return clock_map(table.log_time_ns, table.header_ns).inverse(table.header_ns)


def _agree(relations: list[Relation]) -> bool:
    """Whether several topics' stamps are of one clock."""
    first = relations[0]
    bend = abs(1.0 - first.rate) * 10.0
    return all(
        abs(other.rate - first.rate) <= CLOCKS.same_rate + first.doubt + other.doubt
        and abs(other.offset - first.offset) <= CLOCKS.same_offset + 5 * (first.residual + other.residual) + bend
        for other in relations
    )


def _describe(found: Relation) -> str:
    rate = "" if found.same_rate else f"; its clock runs at {found.rate:.4g} times the log's{found.kind}"
    return f"carries stamps {found.offset:+.3f} s from log time{rate} (residual {1e3 * found.residual:.2g} ms)"


def _nanoseconds(seconds: Array) -> Stamps:
    """Within a century: garbage in a stamp must not overflow."""
    return np.asarray(np.round(np.clip(seconds, -3e9, 3e9) * 1e9).astype(np.int64))


def _seconds(stamps_ns: Stamps) -> Array:
    return np.asarray((stamps_ns - stamps_ns[0]) * 1e-9)


def _line(x: Array, y: Array) -> tuple[float, float, Mask]:
    """Slope, intercept and inliers of a robust straight line."""
    inliers = np.ones(len(x), dtype=bool)
    slope, intercept = 1.0, float(np.median(y - x))
    for _ in range(3):
        if np.ptp(x[inliers]) > 0 and inliers.sum() > 2:
            slope, intercept = _straight(x[inliers], y[inliers])
        residual = np.abs(y - intercept - slope * x)
        inliers = residual <= 5.0 * np.median(residual) + 1e-6
    return slope, intercept, inliers


def _straight(x: Array, y: Array) -> tuple[float, float]:
    """Slope and intercept of the least-squares line; hours of stamps want no matrix."""
    middle = float(np.mean(x))
    lever = x - middle
    spread = float(lever @ lever)
    slope = float(lever @ y) / spread if spread > 0.0 else 0.0
    return slope, float(np.mean(y)) - slope * middle
