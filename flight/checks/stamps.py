"""Gaps, jitter, samples that were left out, clocks."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping

from wrenchgap.flight.check import Check
from wrenchgap.flight.clocks import UNIT_RATES, Relation, Timing
from wrenchgap.flight.flight import Flight, Series
from wrenchgap.flight.mapping_units import topic_of
from wrenchgap.flight.stamps import Steps

STAMP_WORDS = {1e3: "ms", 1e6: "us", 1e9: "ns"}


def stamps(flight: Flight) -> Iterator[Check]:
    """Gaps and jitter."""
    by_message: dict[tuple[str, str], list[str]] = {}
    for role, series in flight.series().items():
        if role == "battery" or len(series.time) < 3:
            continue
        for name, message in _stamp_faults(series):
            by_message.setdefault((name, message), []).append(role)
    for (name, message), roles in by_message.items():  # topics of one recorder share their gaps
        yield Check(name, "warn", f"{', '.join(roles)}: {message}")


def _stamp_faults(series: Series) -> Iterator[tuple[str, str]]:
    if series.gaps:
        longest = max(series.gaps, key=lambda gap: gap.stop - gap.start)
        yield (
            "gaps",
            f"{len(series.gaps)} gap(s), the longest {longest.stop - longest.start:.3f} s at {longest.start:.2f} s; "
            "stretches are split there.",
        )
    spread = Steps(series.time).jitter
    if spread > 0.3 * series.period:
        yield (
            "jitter",
            f"the period varies by {1e3 * spread:.2g} ms around {1e3 * series.period:.3g} ms: stamped on arrival? "
            "Record header stamps.",
        )


def dropped(flight: Flight) -> Iterator[Check]:
    """Samples that the reader left out."""
    for role, series in flight.series().items():
        lost = sum(series.dropped.values())
        if lost > 0.01 * (lost + len(series.time)):
            listed = ", ".join(f"{count} {reason}" for reason, count in series.dropped.items())
            yield Check("left-out", "warn", f"{role}: {lost} of {lost + len(series.time)} samples ({listed}).")


def clocks(timing: Timing, mapping: Mapping[str, str]) -> tuple[Check, ...]:
    """Stamps against log times; `mapping` is that of the flight, for the option that mends them."""
    return (*_units(timing, mapping), *_jumps(timing), *_others(timing))


def _units(timing: Timing, mapping: Mapping[str, str]) -> Iterator[Check]:
    strange = {topic: r.unit for topic, r in timing.relations.items() if r.unit is not None}
    if not strange:
        return
    mends = []
    for part, source in mapping.items():
        unit = next((u for topic, u in strange.items() if topic_of(source) == topic), None)
        if unit is not None:
            word = STAMP_WORDS.get(unit) or f"stamp*{1.0 / unit:g}"
            mends.append(f"--topic {shlex.quote(f'{part}={source}' + (',' if ':' in source else ':') + word)}")
    rates = ", ".join(f"{topic} {unit:g} times ({UNIT_RATES[unit]})" for topic, unit in strange.items())
    words = f"Stamps advance faster or slower than time by a power of a thousand: {rates}"
    yield Check("clock-unit", "bad", words, " ".join(mends))


def _jumps(timing: Timing) -> Iterator[Check]:
    for topic, found in timing.jumps.items():
        listed = ", ".join(f"{seconds:+.3f} s at message {index}" for index, seconds in found)
        yield Check("clock-jump", "warn", f"{topic}: stamps jump by {listed}: a clock was set; taken out.")


def _others(timing: Timing, slow_link: float = 0.1) -> Iterator[Check]:
    """How clocks differ from the recorder's, and links that are later than `slow_link` [s]."""
    relations = {topic: clock for topic, clock in timing.relations.items() if clock.unit is None}
    if relations and not timing.mapped and not any(clock.same for clock in relations.values()):
        topic, clock = next(iter(relations.items()))
        words = "All stamps are of one clock, which is not the recorder's: they are used as they are"
        yield Check("clock", "ok", f"{words} ({topic}: {_described(clock)}).")
        return
    for topic, clock in relations.items():
        if not clock.same:
            yield Check("clock", "warn", f"{topic}: {_described(clock)}; see the notes for how they are used.")
        elif abs(clock.offset) > slow_link:
            yield Check("clock", "warn", f"{topic}: recorded {-clock.offset:.3f} s after its stamp: a slow link.")


def _described(clock: Relation) -> str:
    return (
        f"header stamps differ from log time by {clock.offset:+.3f} s and run at {clock.rate:.4f} times its rate "
        f"(residual {1e3 * clock.residual:.1f} ms)"
    )
