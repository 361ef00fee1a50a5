"""How the health of a vehicle reads: the answer in eight lines, then a row a quantity and a column a log."""

import shlex
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from posixpath import commonpath
from typing import Any

import numpy as np

from wrenchgap.flight.formats.headers import CRAZYFLIE
from wrenchgap.learn.health.answers import NEEDS, Lack
from wrenchgap.learn.health.health import Health, LogHealth
from wrenchgap.learn.health.motors import Motors
from wrenchgap.learn.health.phases import AIRBORNE, NoPhases
from wrenchgap.plant.drafts.ardupilot import frame_of
from wrenchgap.plant.drafts.px4 import placeholders
from wrenchgap.plant.model_file import load, shipped_models
from wrenchgap.replay.present import inspection, parameters
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.health_rows import ROWS, TOO_LITTLE_HOVER
from wrenchgap.replay.present.inspection import LOOKS
from wrenchgap.replay.present.notes import grouped
from wrenchgap.replay.present.numbers import entries, number, share
from wrenchgap.replay.present.statements import LEVELS, rotor, setting, statements
from wrenchgap.replay.present.tables import ANSWER_LINES, Line, Part, Table, note_lines, styled, table

SIDE_BY_SIDE = 6
"""Logs in one table: of more, a terminal shows columns that are narrower than words, and of many none at all."""


def parts(found: Health) -> list[Part]:
    """The answer, the table, which parameters differ, the long tables."""
    long = (part for log in found.logs for part in _details(log, several=len(found.logs) > 1))
    return [*brief(found, details=True), *long]


def brief(found: Health, *, details: bool = False) -> list[Part]:
    """The answer, the table, and which parameters differ; without `details` of so many logs and parameters as fit."""
    lines = [Line(text, look) for text, look in answer(found)]
    several = [found.logs[k : k + SIDE_BY_SIDE] for k in range(0, len(found.logs), SIDE_BY_SIDE)]
    tables = [overview(replace(found, logs=logs)) for logs in several[: None if details else 1]]
    more = 0 if details else len(found.logs) - len(several[0])
    left = [Line(f"{more} more logs: --details.")] if more else []
    return [*lines, Line(), *tables, *left, *parameters.parts(found.parameters, None if details else 12)]


def answer(found: Health) -> list[tuple[str, str]]:
    """At most `ANSWER_LINES` lines with their looks: result, what to look at, what is not answered, next command."""
    flown_at_all = any(log.phases.lack is not NoPhases.POWER for log in found.logs)
    tail = [(f"next: {next_command(found)}", "bold")]
    if flown_at_all:
        tail[:0] = _lacks(found)
    if found.parameters.differ:
        tail.insert(0, (f"Parameters that differ: {parameters.named(found.parameters)}.", "yellow"))
    if found.repeated:
        tail.insert(0, (_repeated(found), "yellow"))
    room = ANSWER_LINES - 1 - len(tail)
    if len(found.logs) > 1:
        every = sorted(map(_in_short, found.logs), key=lambda line: list(LOOKS.values()).index(line[1]))
        what = "logs"
    else:
        every = [(one.words, LOOKS[one.level]) for one in statements(found.logs[0])]
        what = "things"
    shown = every if len(every) <= room else [*every[: room - 1], (f"and {len(every) - room + 1} more {what}.", "")]
    return [(summary(found), "bold"), *shown, *tail]


def _repeated(found: Health) -> str:
    """Which logs were given more than once."""
    (again, first), *others = found.repeated
    more = f", and {len(others)} more of this kind" if others else ""
    return f"{again} is the same file as {first}, and is left out{more}."


def _in_short(log: LogHealth) -> tuple[str, str]:
    """A line on one of several logs, with the look of the worst that is to be said of it."""
    said = statements(log)
    text = f"{log.name}: {flown(log)}; {', '.join(one.short for one in said) or _quiet([log])}"
    return text, LOOKS[said[0].level if said else "ok"]


def _quiet(logs: Sequence[LogHealth]) -> str:
    """What is said where nothing was found."""
    judged = any(log.phases.lack is None for log in logs)
    return "nothing out of the ordinary" if judged else "nothing of the flight could be judged"


def summary(found: Health) -> str:
    """What was flown, and how many things are to be looked at."""
    said = [one for log in found.logs for one in statements(log)]
    count = f"{len(said)} thing{'s' if len(said) > 1 else ''} to look at" if said else _quiet(found.logs)
    if len(found.logs) > 1:
        kinds = {_kind(log) for log in found.logs}
        boards = len({kind[0] for kind in kinds}) == 1  # one firmware, or one format
        unlike = "boards" if boards else "autopilots or formats"
        mixed = f" They come of different {unlike}: are they of one vehicle?" if len(kinds) > 1 else ""
        return f"{len(found.logs)} logs: {count}.{mixed}"
    (log,) = found.logs
    checked: dict[str, object] = {"motors": log.motors, "battery": log.battery, "estimator": log.estimator}
    checked["vibration levels"] = log.vibration if log.vibration is not None and log.vibration.levels else None
    unseen = [name for name, one in checked.items() if one is None and log.phases.lack is not NoPhases.POWER]
    if log.motors is not None and log.motors.condition != "hover":
        unseen.insert(0, f"motor balance ({TOO_LITTLE_HOVER})")
    unknown = f" Not judged, for want of data: {', '.join(unseen)}." if unseen else ""
    return f"{log.name}: {flown(log)}; {count}.{unknown}"


def _when(motors: Motors) -> str:
    """The time of which the deviations of motors are."""
    return "level hover" if motors.condition == "hover" else motors.condition


def flown(log: LogHealth, short: float = 20.0) -> str:
    """How long a log is, and how much of it is flight: below `short` [s] to a tenth, as some answers need ten."""
    length = f"{log.inspection.duration:.0f} s"
    air = log.phases.seconds(*AIRBORNE)
    if log.phases.lack is not None:
        return f"{length}, phases unknown ({log.phases.lack})"
    return f"{length}, {air:.{0 if air >= short else 1}f} s in the air"


def _lacks(found: Health) -> list[tuple[str, str]]:
    """What the logs cannot answer, and the settings that change it; of several logs what all of them lack."""
    lacks = [{a.question: a.lack for a in log.answers if a.lack is not None} for log in found.logs]
    both = [a.question for a in found.logs[0].answers if all(a.question in one for one in lacks)]
    calm = [question for question in both if any(one[question] in (Lack.SPEED, Lack.TURNING) for one in lacks)]
    several = len(found.logs) > 1
    whole = ("None of the logs can answer" if several else "The log cannot answer", [q for q in both if q not in calm])
    partly = (f"The log{'s are' if several else ' is'} too calm for small values of", calm)
    said = " ".join(f"{who}: {'; '.join(map(str, asked))}." for who, asked in (whole, partly) if asked)
    said = f"{said.removesuffix('.')} (why: table)." if said else ""
    todo = dict.fromkeys(setting(one) for log in found.logs for one in log.settings)
    more = f"{next(iter(todo))}, to answer more." if todo else ""
    longer = f"Fly at least {NEEDS.flight:g} s: `explain` needs as much." if _short(found.logs) else ""
    return [(text, "") for text in (said, more, longer) if text]


def next_command(found: Health) -> str:
    """The one command to run next."""
    logs = [str(log.inspection.path) for log in found.logs]
    doubtful = next((log for log in found.logs if log.bad), None)
    if doubtful is not None and doubtful.bad[0].mend:
        return f"{shlex.join(['wrenchgap', 'check', *logs])} {doubtful.bad[0].mend}"
    if doubtful is not None:
        return shlex.join(["wrenchgap", "inspect", str(doubtful.inspection.path)])
    flown_ones = [log for log in found.logs if log.phases.lack is not NoPhases.POWER]
    if not flown_ones:
        return "wrenchgap check ANOTHER_LOG"
    mend = next((check.mend for log in found.logs for check in log.contradictions if check.mend), None)
    if mend:
        return f"{shlex.join(['wrenchgap', 'check', *logs, '-m', found.model])} {mend}"
    if found.fits and len(flown_ones) > 1 and len({_kind(log) for log in flown_ones}) == 1:
        return shlex.join([*_comparison(flown_ones), "-m", found.model])
    if not found.model and (shipped := shipped_for(flown_ones)):
        return shlex.join(["wrenchgap", "check", *logs, "-m", shipped])
    if found.fits:
        first = flown_ones[0]
        fine = all(check.level == "ok" for check in first.inspection.checks) and not any(c.stops for c in first.doubts)
        command = "compare" if fine else "inspect"
        return shlex.join(["wrenchgap", command, str(first.inspection.path), "-m", found.model])
    if _short(flown_ones):
        return "wrenchgap check ANOTHER_LOG"
    return f"{shlex.join(['wrenchgap', 'model', 'new', *_source(flown_ones[0])])} -o vehicle.toml"


def _short(logs: Sequence[LogHealth]) -> bool:
    """Whether none of these logs has as much flight as the analyses with a model need."""
    return all(log.phases.lack is None and log.phases.seconds(*AIRBORNE) < NEEDS.flight for log in logs)


def shipped_for(logs: Sequence[LogHealth]) -> str:
    """The one shipped model of the vehicle that these logs are of, by their columns or topics; empty without one."""
    if all(log.inspection.flight is not None and log.inspection.flight.firmware == CRAZYFLIE for log in logs):
        return "crazyflie"
    logged = set.intersection(*({one.topic for one in log.inspection.topics} for log in logs))
    theirs = [name for name in shipped_models() if _named_so(logged, load(name).topics.values())]
    return theirs[0] if len(theirs) == 1 else ""


def _named_so(logged: Collection[str], sources: Iterable[str]) -> bool:
    """Whether a log has topics in the namespace of a model's sources, or all of those where they share none."""
    topics = {source.split(":")[0] for source in sources} - {"none"}
    space = commonpath(topics) if topics else "/"
    return bool(topics) and (topics <= set(logged) if space == "/" else any(t.startswith(f"{space}/") for t in logged))


def _kind(log: LogHealth) -> tuple[str, ...]:
    """What logs of one vehicle have in common."""
    one = log.autopilot
    return (log.inspection.format,) if one is None else (one.name, str(one.hardware), one.serial)


def _comparison(logs: Sequence[LogHealth]) -> list[str]:
    """The log whose vehicle has the most to look at beside those with less, of which no check is off where there are
    such; a place for one where none is.
    """  # noqa: D205

    def worst(log: LogHealth) -> int:
        of_vehicle = [one.level for one in statements(log) if one.about in ("motors", "crash", "impact")]
        return min(map(LEVELS.index, [*of_vehicle, "ok"]))

    suspect = min(reversed(logs), key=worst)
    fine = worst(suspect) == LEVELS.index("ok")
    sound = [log for log in logs if log is not suspect and (fine or worst(log) > worst(suspect))]
    whole = [log for log in sound if all(check.level == "ok" for check in log.inspection.checks)]
    healthy = [str(log.inspection.path) for log in whole or sound] or ["HEALTHY_LOG"]
    return ["wrenchgap", "changed", str(suspect.inspection.path), "--healthy", *healthy]


def _source(log: LogHealth) -> list[str]:
    """What a model is made of: an autopilot's log, or answers to questions."""
    if log.autopilot is None:
        return ["--interactive"]
    known = log.autopilot.parameters
    said = ["--from", str(log.inspection.path), "--mass", "KG"]
    if log.autopilot.name == "PX4":
        return said if "CA_ROTOR_COUNT" in known and not placeholders(known) else [*said, "--arm", "METRES"]
    return [*said, "--arm", "METRES", *([] if frame_of(known, log.autopilot.frame) else ["--frame", "FRAME"])]


def overview(found: Health) -> Table:
    """A row for each quantity, a column for each log."""
    looks = [{one.about: LOOKS[one.level] for one in reversed(statements(log))} for log in found.logs]
    cells = [
        (head, *(styled(cell(log), look.get(about, "")) for log, look in zip(found.logs, looks, strict=True)))
        for head, cell, about in ROWS
    ]
    return table("", ("", *(log.name for log in found.logs)), cells, left=1 + len(found.logs))


def _details(log: LogHealth, *, several: bool) -> list[Part]:
    """Motors, phases, test ratios, checks and notes of one log."""
    out: list[Part] = [Line(), Line(log.name, "bold")] if several else [Line()]
    if log.motors is not None:
        each = []
        for m in log.motors.motors:
            ends = ("-" if v is None else share(v) for v in (m.at_least, m.at_most))
            each.append((rotor(m.rotor), f"{100 * m.deviation:+.1f} %", *ends))
        heads = ("motor", f"thrust in {_when(log.motors)}, of the mean", "at smallest command", "at largest command")
        out.append(table("motors", heads, each))
    if log.phases.phases:
        out.append(inspection.phases(log.phases.phases, title="phases"))
    if log.estimator is not None:
        ratios = [(r.of, number(r.median), number(r.high), share(r.rejected)) for r in log.estimator.ratios]
        out.append(table("test ratios in the air", ("innovation", "median", "95th percentile", "above 1"), ratios))
    if log.messages:
        said = [(number(m.time, 4), m.level, m.text, str(m.count)) for m in log.messages]
        out.append(table("reported by the autopilot", ("s", "level", "message", "times"), said, left=3))
    return [*out, inspection.checks(log.inspection.checks), *note_lines(grouped(log.inspection.notes))]


def to_json(found: Health) -> dict[str, Any]:
    """The `check` schema."""
    return {
        "answer": [text for text, _ in answer(found)],
        "logs": [_log_json(log) for log in found.logs],
        "repeated": [{"log": again, "same_as": first} for again, first in found.repeated],
        "autopilot_parameters": parameters.to_json(found.parameters),
    }


def _log_json(log: LogHealth) -> dict[str, Any]:
    one, shaken = log.autopilot, log.vibration
    autopilot = ("name", "firmware", "hardware", "frame", "dropouts", "lost_s=lost")
    vibration = ("source", "levels", "limits", "clipped", "rate_hz=rate", "rms", "peaks", "rotor_hz")
    return {
        **entries(log.inspection, "path", "format", "sha256=content_hash", "duration_s=duration", "level", "checks"),
        **entries(log, "motors", "battery", "estimator", "rates", "answers", "settings", "contradictions"),
        "messages": log.messages,
        "statements": statements(log),
        "autopilot": None if one is None else entries(one, *autopilot),
        "phases": [entries(phase, "name", "start", "stop", "why", "event") for phase in log.phases.phases],
        "phases_lack": log.phases.lack,
        "vibration": None if shaken is None else entries(shaken, *vibration),
        "notes": grouped(log.inspection.notes),
    }


def frame(found: Health) -> list[dict[str, Any]]:
    """One row for each motor of each log."""
    keys = ("name=rotor.name", "x=rotor.x", "y=rotor.y", "spin=rotor.spin", "deviation", "at_most", "at_least")
    return [{"log": log.name, **entries(m, *keys)} for log in found.logs if log.motors for m in log.motors.motors]


def picture(found: Health) -> style.Picture:
    """A row for each log. Axes are (L, 2): thrust of each motor in hover, and the spectrum of the specific force."""
    count = len(found.logs)
    title = f"{', '.join(log.name for log in found.logs)}: motors and vibration"
    return style.Picture((count, 2), (11.0, 2.6 * count + 0.4), lambda axes: _draw(found, axes), title=title)


def _draw(found: Health, axes: Any) -> None:
    for (left, right), log in zip(axes, found.logs, strict=True):
        if log.motors is None:
            style.nothing(left, "no command of each motor is logged, or it did not fly")
        else:
            names = [m.rotor.name for m in log.motors.motors]
            left.bar(names, [100.0 * m.deviation for m in log.motors.motors], color=style.MODELS[0])
            left.axhline(0.0, color="0.4", lw=0.8)
            style.labelled(left, f"thrust in {_when(log.motors)}, of the mean", "%")
        density = None if log.vibration is None else log.vibration.spectrum
        if density is None:
            style.nothing(right, "no spectrum: the IMU is not logged, too slow, or it did not fly")
            continue
        right.semilogy(density[0], np.maximum(density[1], 1e-12), color=style.MEASURED, lw=0.9)
        style.labelled(right, "specific force", "m^2/s^4/Hz")
        style.labelled(right, "frequency", "Hz", "x")
