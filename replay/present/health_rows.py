"""A row for each quantity of the health of a vehicle: what a log says of it in a few words."""

from collections.abc import Callable

import numpy as np

from wrenchgap.learn.health.answers import ASKED, NEEDS, Lack, Question
from wrenchgap.learn.health.health import LogHealth
from wrenchgap.learn.health.motors import MOTORS
from wrenchgap.learn.health.phases import AIRBORNE, HOVER, NoPhases
from wrenchgap.learn.health.vibration import SLOW_HZ
from wrenchgap.replay.present.numbers import number, share
from wrenchgap.replay.present.statements import peak, unanswered

TOO_LITTLE_HOVER = f"less than {MOTORS.briefest:g} s of hover within {np.degrees(HOVER.level):.0f} deg of level"


def _vehicle(log: LogHealth) -> str:
    if log.autopilot is None:
        return log.inspection.format
    one = log.autopilot
    count = len(log.motors.motors) if log.motors is not None else 0
    said = [one.firmware if one.name in one.firmware or "Ardu" in one.firmware else f"{one.name} {one.firmware}"]
    said += [one.hardware, one.frame, f"{count} motors" if count else ""]
    return ", ".join(text.strip() for text in said if text.strip())


def _phases(log: LogHealth) -> str:
    if log.phases.lack is not None:
        return f"unknown: {log.phases.lack}"
    names = ("ground", "held", "take-off", "hover", "moving", "landing", "impact", "crash")
    times = [(name, log.phases.seconds(name)) for name in names if log.phases.named(name)]
    steady = "" if log.phases.speed_known else " (speed unknown: steady flight counts as hover)"
    return ", ".join(f"{name} {seconds:.1f} s" for name, seconds in times) + steady


def _missing(log: LogHealth, role: str = "") -> str:
    """Why a quantity is not there; the names of an autopilot's messages are known, those of other logs may be any."""
    if log.phases.lack is NoPhases.DOUBT:
        return f"not judged: {NoPhases.DOUBT}"
    if role == "imu" and any(rate.role == role and rate.hz < SLOW_HZ for rate in log.rates):
        return "the IMU is too slow to show any"
    if any(rate.role == role for rate in log.rates) and log.phases.seconds(*AIRBORNE) < NEEDS.flight:
        return "not judged: too little flight"
    return "not found" if log.autopilot is None else "not logged"


def _balance(log: LogHealth) -> str:
    if log.motors is None:
        return _missing(log, "actuators")
    each = ", ".join(f"{m.rotor.name} {round(100 * m.deviation):+d} %" for m in log.motors.motors)
    if log.motors.condition != "hover":
        return f"not known: {TOO_LITTLE_HOVER} (in all of the flight: {each} of the mean)"
    f = log.motors.curve
    law = {None: "", 0.0: "; thrust taken in proportion to the command", 1.0: "; thrust taken as the command's square"}
    mixed = f"; thrust taken as {number(f, 2)} u^2 + {number(1.0 - (f or 0.0), 2)} u of a command u"
    curve = law.get(f, mixed)
    return f"{each} of the mean thrust in level hover ({log.motors.shape}{curve})"


def _saturation(log: LogHealth) -> str:
    if log.motors is None:
        return _missing(log, "actuators")
    if log.motors.at_most is None:
        return "unknown: the log does not say where its commands end"
    return f"{share(log.motors.at_most)} of flight at the largest, {share(log.motors.at_least or 0.0)} at the smallest"


def _vibration(log: LogHealth) -> str:
    found = log.vibration
    if found is None or (not found.levels and found.rms is None):
        return _missing(log, "imu")
    if not found.levels:
        x, y, z = found.rms or (0.0, 0.0, 0.0)
        return f"x {number(x, 2)}, y {number(y, 2)}, z {number(z, 2)} m/s^2 rms above 20 Hz, as logged"
    limits = f"limits {found.limits[0]:g} and {found.limits[1]:g}" if found.limits else ""
    return f"{', '.join(number(v, 2) for v in found.levels)} m/s^2, 95th percentile ({found.source}; {limits})"


def _clipping(log: LogHealth) -> str:
    clipped = None if log.vibration is None else log.vibration.clipped
    return "not counted by the autopilot" if clipped is None else f"{clipped} samples"


def _peaks(log: LogHealth) -> str:
    found = log.vibration
    if found is None or found.spectrum is None or found.rate is None:
        return _missing(log, "imu")
    said = "; ".join(map(peak, found.peaks)) or "none"
    said += "; no rotor speed is logged, to tell whose" if found.peaks and not found.rotor_hz else ""
    return f"{said} (log shows up to {0.5 * found.rate:.0f} Hz)"


def _battery(log: LogHealth) -> str:
    battery = log.battery
    if battery is None:
        return _missing(log)
    drawn = "" if battery.current is None else f", {battery.current:.2g} A in flight"
    drawn += ": not what the motors take" if battery.no_current else ""
    if battery.none:
        return f"reads {battery.flight:.2g} V: not a battery{drawn}"
    rest = "" if battery.rest is None else f"{battery.rest:.1f} V at rest, "
    sag = "" if battery.sag is None else f", sag {battery.sag:.1f} V"
    return f"{rest}{battery.flight:.1f} V in flight{sag}, lowest {battery.lowest:.1f} V, end {battery.end:.1f} V{drawn}"


def _estimator(log: LogHealth) -> str:
    if log.estimator is None:
        return "not judged: no flight" if log.autopilot and not log.phases.seconds(*AIRBORNE) else _missing(log)
    each = ", ".join(f"{r.of} {number(r.median, 2)} ({share(r.rejected)})" for r in log.estimator.ratios)
    fix = "; the GPS never had a fix" if log.estimator.no_fix else ""
    fix += f": position from {' and '.join(log.estimator.sources)}" if fix and log.estimator.sources else ""
    return f"test ratio, median (rejected): {each}{fix}"


def _rates(log: LogHealth) -> str:
    each = [f"{r.role} {number(r.hz, 3)} Hz{f' (gaps: {r.gaps})' if r.gaps else ''}" for r in log.rates]
    return ", ".join(each) or "no topic plays a role"


def _dropouts(log: LogHealth) -> str:
    if log.autopilot is None:
        return _missing(log)
    lost = "" if log.autopilot.lost is None or not log.autopilot.dropouts else f", {log.autopilot.lost:.2f} s in all"
    return f"{log.autopilot.dropouts}{lost}"


def _noticed(log: LogHealth) -> str:
    levels = {level: [c.name for c in log.inspection.checks if c.level == level] for level in ("bad", "warn")}
    said = [f"{level}: {', '.join(dict.fromkeys(names))}" for level, names in levels.items() if names]
    return "; ".join(said) or "all ok"


def _can(log: LogHealth) -> str:
    if not log.answers:
        return _missing(log, "imu")
    can = [answer.question for answer in log.answers if answer.lack is None]
    if log.follows is not None:
        return ", ".join(can) or "none of these questions"
    alone = [question for question in can if question is Question.SPECTRUM]
    unsure = [question for question in can if Lack.FOLLOWING in ASKED[question]]
    sure = [question for question in can if question not in (*alone, *unsure)]
    said = [", ".join(alone)] if alone else []
    said += [f"with a model: {', '.join(sure)}"] if sure else []
    if unsure:
        said.append(f"{', '.join(unsure)} if the motion follows the commands, which `check -m MODEL` tells")
    return "; ".join(said) or "none of these questions"


ROWS: tuple[tuple[str, Callable[[LogHealth], str], str], ...] = (
    ("vehicle", _vehicle, ""),
    ("phases", _phases, "crash"),
    ("motor balance", _balance, "motors"),
    ("saturation", _saturation, "saturation"),
    ("vibration", _vibration, "vibration"),
    ("clipping", _clipping, "clipping"),
    ("peaks", _peaks, ""),
    ("battery", _battery, "battery"),
    ("estimator", _estimator, "estimator"),
    ("rates", _rates, "gaps"),
    ("dropouts", _dropouts, "logger"),
    ("checks", _noticed, "log"),
    ("enough for", _can, ""),
    ("not for", lambda log: unanswered(log.answers) or "-", ""),
)
"""Rows of the table: head, cell of a log, and what statements that colour it are about."""
