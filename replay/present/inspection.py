"""What is in a log: topics, checks, timing."""

import shlex
from collections.abc import Sequence
from dataclasses import asdict
from os.path import commonpath
from typing import Any

import numpy as np

from wrenchgap.flight import Series, unmeasured_axes
from wrenchgap.flight.check import Check, Level
from wrenchgap.flight.inspection import Inspection, TopicReport
from wrenchgap.learn.data.phases.phase import Phase
from wrenchgap.learn.data.read_options import ReadOptions
from wrenchgap.learn.diagnose.model_checks import LogReport
from wrenchgap.replay.present import timing
from wrenchgap.replay.present.documents import VERSIONS
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.notes import grouped
from wrenchgap.replay.present.numbers import entries, number
from wrenchgap.replay.present.tables import Line, Part, Table, note_lines, styled, table

LOOKS = {"bad": "bold red", "warn": "yellow", "ok": "green"}
NAMES: dict[Level, str] = {"bad": "bad", "warn": "to look at", "ok": "passed"}


def kept_in_words(asked: ReadOptions) -> str:
    """What of reading a log a model file keeps."""
    said = [f"{role} = {topic}" for role, topic in (asked.topics or {}).items()]
    said += [f"shift of {role} {seconds:+g} s" for role, seconds in (asked.shifts or {}).items()]
    said += [] if asked.cutoff_hz is None else [f"cut-off {asked.cutoff_hz:g} Hz"]
    return ", ".join([*said, *(f"{axis} not measured" for axis in asked.unmeasured)])


def parts(seen: LogReport) -> list[Part]:
    """Checks, topics, phases, timing, notes."""
    out: list[Part] = [*_answer(seen), checks((*seen.inspection.checks, *seen.model_checks))]
    out.append(topics(seen.inspection))
    if hidden := len(seen.inspection.topics) - len(rows_of(seen.inspection.topics)):
        out.append(Line(f"and {hidden:,} more topics, which play no role; --json FILE lists them all", "dim"))
    if seen.phases:
        out += [Line(), phases(seen.phases)]
    if seen.timing is not None:
        out += timing.parts(seen.timing)
    out += note_lines(grouped(seen.notes))
    unused = {part: t for t in seen.inspection.topics for part in t.could_play if not t.plays}
    if unused:
        others = ", ".join(f"--topic {shlex.quote(f'{part}={t.topic}')}" for part, t in unused.items())
        out.append(Line(f"could also be read: {others}", "dim"))
    return [*out, Line()]


def topics(seen: Inspection, most: int = 300) -> Table:
    """Topics of a log: roles, rates, gaps; `most` of those that play none."""
    size = f"{seen.size / 1e6:.1f} MB" if seen.size >= 1e5 else f"{seen.size / 1e3:.1f} kB"
    title = f"{seen.path} ({seen.format}, {size}, {seen.duration:.1f} s)"
    common = _namespace([t.topic for t in seen.topics])
    first = ("topic in", common) if common else "topic"
    rows = []
    for t in rows_of(seen.topics, most):
        gaps = f"{t.gaps} (to {t.longest_gap:.2f} s)" if t.gaps else "0"
        jitter = "-" if t.jitter is None else number(round(1e3 * t.jitter, 3), 2)
        role = styled(", ".join(t.plays), "bold green") if t.plays else styled("-", "dim")
        lost = str(sum(t.dropped.values())) if t.dropped else "0"
        name, kind = t.topic.removeprefix(common), t.type.split("/")[-1]
        rows.append((name, kind, role, t.count, number(t.rate, 4), jitter, gaps, lost))
    heads = (first, "type", "role", "messages", "rate [Hz]", "jitter [ms]", "gaps", "left out")
    return table(title, heads, rows, left=3)


def rows_of(every: Sequence[TopicReport], most: int = 300) -> list[TopicReport]:
    """Topics that have a row: all that play a role, and the first `most` of the others, as nobody reads thousands."""
    others = [t for t in every if not t.plays][:most]
    return [t for t in every if t.plays or any(t is other for other in others)]


def _namespace(names: Sequence[str], shortest: int = 8) -> str:
    """The namespace that all topics share, with its last slash; nothing below `shortest` characters."""
    absolute = all(name.startswith("/") for name in names)
    shared = commonpath(names) + "/" if absolute and len(names) > 1 else ""
    return shared if len(shared) > shortest else ""


def checks(found: Sequence[Check]) -> Table:
    """Findings, the bad ones first."""
    out = Table(box=None, show_header=False, pad_edge=False, padding=(0, 1))
    for check in sorted(found, key=lambda c: list(LOOKS).index(c.level)):
        out.add_row(styled(check.level, LOOKS[check.level]), check.name, _words(check))
    return out


def _words(check: Check) -> str:
    """What was found, and what mends it."""
    if check.level != "bad":
        return check.words
    said = check.words.rstrip(". ")
    return f"{said}: accepted." if check.accepted else "; ".join(filter(None, (said, check.remedy)))


def phases(found: Sequence[Phase], most: int = 4, title: str = "phases besides flight") -> Table:
    """What is no ordinary flight; phases of one kind in one line where there are more than `most`."""
    groups: dict[tuple[str, bool], list[Phase]] = {}
    for phase in found:
        groups.setdefault((phase.name, phase.left_out), []).append(phase)
    rows = [[p] for many in groups.values() if len(many) <= most for p in many]
    rows += [many for many in groups.values() if len(many) > most]
    cells = []
    for row in sorted(rows, key=lambda many: many[0].start):
        first, last = row[0], row[-1]
        times = f"{first.start:.2f} - {last.stop:.2f}" + (f", {len(row)} times" if len(row) > 1 else "")
        length = sum(p.stop - p.start for p in row)
        cells.append((first.name, times, f"{length:.2f}", "left out" if first.left_out else "used", first.why))
    return table(title, ("phase", "time [s]", "length [s]", "analysis", "why"), cells, left=5)


def to_json(seen: LogReport) -> dict[str, Any]:
    """One entry of `logs` in the `inspect` schema."""
    names = ("path", "format", "size_bytes=size", "sha256=content_hash", "start_ns", "duration_s=duration", "level")
    return {
        "version": VERSIONS["inspect"],
        **entries(seen.inspection, *names, "topics", "mapping", "checks"),
        **entries(seen, "model_checks", "notes", "shift_s=shifts", "left_out", "phases"),
        "unmeasured": [] if seen.inspection.flight is None else list(unmeasured_axes(seen.inspection.flight)),
        "timing": None if seen.timing is None else timing.to_json(seen.timing),
    }


def brief(seen: LogReport) -> list[Part]:
    """What the log is, what its checks warn of, and the topics that play roles."""
    every = (*seen.inspection.checks, *seen.model_checks)
    wrong = [checks([c for c in every if c.level != "ok"])] if any(c.level != "ok" for c in every) else []
    late = [] if seen.timing is None else note_lines(timing.in_short([seen.timing]), "warning")
    return [*_answer(seen), *wrong, *late, topics(seen.inspection, most=0)]


def _answer(seen: LogReport) -> list[Line]:
    """One line: what the log is, how many checks passed, and how many did not."""
    every = [c.level for c in (*seen.inspection.checks, *seen.model_checks)]
    counts = [f"{every.count(level)} {name}" for level, name in NAMES.items() if every.count(level)]
    plays = sum(bool(t.plays) for t in seen.inspection.topics)
    topics_said = f"{plays} of {len(seen.inspection.topics)} topics play a role"
    name = f"{seen.inspection.path} ({seen.inspection.format}, {seen.inspection.duration:.1f} s)"
    return [Line(f"{name}: checks: {', '.join(counts) or 'none'}; {topics_said}.", "bold"), Line()]


def next_command(seen: LogReport) -> str:
    """The one command to run next: what mends the first bad check, else the question that comes after this one."""
    log, model = str(seen.inspection.path), ["-m", seen.model] if seen.model else []
    bad = [c for c in (*seen.inspection.checks, *seen.model_checks) if c.level == "bad" and not c.accepted]
    if bad:
        mend = next((check.mend for check in bad if check.mend), "--details")
        return f"{shlex.join(['wrenchgap', 'inspect', log, *model])} {mend}"
    return shlex.join(["wrenchgap", "compare" if model else "check", log, *model])


def frame(seen: LogReport) -> list[dict[str, Any]]:
    """One row for each topic."""
    return [{**asdict(t), "plays": ", ".join(t.plays)} for t in seen.inspection.topics]


def picture(seen: LogReport) -> style.Picture:
    """Axes (R, 1): rates and gaps, a row for each role that a topic plays; one with a sentence where none does."""
    rows = max(1, len({} if seen.inspection.flight is None else seen.inspection.flight.series()))
    size, title = (10.0, 1.25 * rows + 1.0), f"{seen.inspection.path.name}: rates and gaps of the topics"
    return style.Picture((rows, 1), size, lambda axes: _draw(seen, axes[:, 0]), title=title, share=True)


def _draw(seen: LogReport, panels: Any) -> None:
    flight = seen.inspection.flight
    if flight is None or not flight.series():
        style.nothing(panels[0], "no topic plays a role; map one with --topic ROLE=/your/topic")
        return
    for panel, (role, series) in zip(panels, flight.series().items(), strict=True):
        _rate(panel, series, seen.inspection.duration)
        panel.set_title(
            f"{role}: {style.shortened(series.topic, style.LONGEST_LABEL)}", fontsize=style.SMALL, loc="left"
        )
        panel.set_xlim(0.0, max(seen.inspection.duration, 1e-3))
    style.labelled(panels[-1], "time since the first message", "s", "x")
    style.grid(panels)


def _rate(panel: Any, series: Series, duration: float) -> None:
    """Messages a second in windows of half a second or more, 300 at most, and the gaps."""
    count = max(1, min(300, int(duration / 0.5)))
    found, edges = np.histogram(series.time, bins=np.linspace(0.0, max(duration, 1e-3), count + 1))
    rate = found / np.diff(edges)
    panel.stairs(rate, edges, baseline=None, color=style.MODELS[0], lw=1.0)
    for k, gap in enumerate(series.gaps):
        panel.axvspan(gap.start, gap.stop, color=style.WARNING, alpha=0.3, lw=0, label="gap" if k == 0 else None)
    words = f"{len(series.gaps)} gaps" if len(series.gaps) != 1 else "1 gap"
    panel.annotate(words, (1.0, 1.02), xycoords="axes fraction", ha="right", va="bottom", fontsize=style.SMALL)
    panel.set_ylim(0.0, 1.15 * float(max(rate.max(), 1e-9)))
    style.labelled(panel, "rate", "Hz")
