"""What a pilot should know of a log, each in one sentence or two: what, where, how much, what to do."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.check import Level
from wrenchgap.learn.health.answers import Answer, Lack, Setting
from wrenchgap.learn.health.autopilot_messages import BATTERY, ESTIMATOR, Estimator
from wrenchgap.learn.health.health import LogHealth, Rate
from wrenchgap.learn.health.logged_messages import changed_before
from wrenchgap.learn.health.motors import MOTORS, Motor, Motors, Shape
from wrenchgap.learn.health.phases import AIRBORNE, NoPhases
from wrenchgap.learn.health.rotors import RotorPlace
from wrenchgap.learn.health.vibration import VIBRATION, Peak, Vibration
from wrenchgap.replay.present.numbers import by_reason, capitalised, number, share, side_of
from wrenchgap.replay.present.what_to_inspect import YAW_BIAS

LEVELS = ("bad", "warn", "ok")
HELD = ("imu", "commanded", "actuators")
"""Roles without which nothing of a flight is known."""
LOST = 0.01
"""Share of a log that its logger lost, which is worth a word: what is left is enough for any analysis."""
LEFT_OUT = 0.1
"""Share of a role's samples that the reader left out, which is worth a word: a wrong reading or a damaged file."""
LONG_GAP = 0.5
"""Gap of commands or IMU [s] that is worth a word: stretches between gaps are analysed each by itself."""
SHAKES = 1.0
"""Root mean square of a rotor's peak [m/s^2] that is worth a word: a tenth of g."""


@dataclass(frozen=True)
class Statement:
    """A sentence, how bad it is, what it is about, and the same in a few words for a line of several."""

    level: Level
    about: str
    short: str
    words: str


def statements(log: LogHealth) -> list[Statement]:
    """Everything about a log that is not as it should be, the worst first."""
    found = [*_flight(log), *_checks(log), *_motors(log), *_vibration(log.vibration, log.motors)]
    found += [*_messages(log), *_battery(log), *_estimator(log.estimator), *_logger(log)]
    return sorted(found, key=lambda one: LEVELS.index(one.level))


def rotor(place: RotorPlace) -> str:
    """A rotor by its place and its name: "front right (M1)"."""
    if place.x is None or place.y is None:
        return place.name
    return f"{side_of(place.x, place.y)} ({place.name})"


NO_FLIGHT = {
    NoPhases.POWER: "The motors never ran, or only idled: this log holds no flight. Give another log.",
    NoPhases.BENCH: "The motors ran, and neither gyroscope nor accelerometer went with them: this log is of a bench.",
}


def _flight(log: LogHealth) -> Iterator[Statement]:
    """Crashes and impacts, and a log without a flight."""
    for name in ("crash", "impact"):
        events = log.phases.named(name)
        if events:
            more = f" (and {len(events) - 1} more)" if len(events) > 1 else ""
            todo = "inspect the whole vehicle before it flies again" if name == "crash" else "inspect it for damage"
            at = events[0].start if events[0].event is None else events[0].event
            mode = changed_before(log.modes, at)
            after = "" if mode is None else f"; flight mode {mode.name} since {mode.start:.1f} s"
            why = "; a log alone does not tell why: `wrenchgap view` shows the seconds before" * (name == "crash")
            words = f"{events[0].title} at {at:.1f} s from the log's start{more}: {events[0].why}{after}; {todo}{why}."
            yield Statement("bad" if name == "crash" else "warn", name, f"{name} at {at:.1f} s", words)
    if log.phases.lack in NO_FLIGHT:
        yield Statement("warn", "flight", "no flight", NO_FLIGHT[log.phases.lack])
    elif log.phases.phases and not log.phases.seconds(*AIRBORNE):
        words = "It never left the ground in this log, as far as thrust and motion tell."
        yield Statement("warn", "flight", "no flight", words)
    elif log.autopilot is not None and log.phases.phases and log.phases.phases[-1].name in AIRBORNE:
        words = "The log ends in the air: the power was lost, or the file is cut short."
        if (early := _stopped_early(log)) is not None:
            words = f"The record of {early.topic} ({early.role}) stops in the air at {early.last:.1f} s, and others go "
            words += "on: what was flown afterwards is not known here."
        yield Statement("warn", "flight", "ends in the air", words)


def _stopped_early(log: LogHealth, least: float = 2.0) -> Rate | None:
    """What stops `least` seconds before what is logged last, more than topics of slow rates differ by; else None."""
    first = min((rate for rate in log.rates if rate.role in HELD), key=lambda rate: rate.last, default=None)
    return first if first is not None and max(rate.last for rate in log.rates) - first.last > least else None


def _checks(log: LogHealth) -> Iterator[Statement]:
    for check in log.bad:
        said = "; ".join(filter(None, (check.words.rstrip(". "), check.remedy)))
        yield Statement("bad", "log", f"check {check.name}", f"The log is not what it seems ({check.name}): {said}.")
    for check in log.contradictions[:1]:
        said = f"{check.name}: {check.words.removeprefix(f'{log.name}: ').rstrip('.? ')}"
        words = f"The model does not fit this log, which is judged without it ({said})."
        yield Statement("bad", "log", f"model {check.name}", words)
    yield from (Statement(c.level, c.name, c.name, f"{c.words.rstrip('. ')}.") for c in log.doubts)
    for check in log.inspection.checks:
        words = check.words.rstrip(". ")
        if check.level == "bad" and (check.accepted or check.name == "roles"):
            words = f"Check {check.name}{', accepted' if check.accepted else ''}: {words}"
            yield Statement("warn", "log", f"check {check.name}", f"{words}.")
        first = check.name in ("accelerometer-scale", "gyroscope-scale", "parameters") and check.level == "warn"
        if first or (check.name == "clipped" and words.startswith("the commands")):
            yield Statement("warn", "log", f"check {check.name}", f"{capitalised(words)}.")
    series = {} if log.inspection.flight is None else log.inspection.flight.series()
    lost = {
        role: sum(one.dropped.values()) / (sum(one.dropped.values()) + len(one.time))
        for role, one in series.items()
        if role != "reference"  # a setpoint that is not a number is none: nothing was asked for, nothing is wrong
    }
    worst = max(lost, key=lambda role: lost[role], default="")
    if worst and lost[worst] > LEFT_OUT:
        words = f"{share(lost[worst])} of the samples of {worst} are no possible readings and were left out"
        yield Statement("warn", "log", "samples left out", f"{words}; `wrenchgap inspect --details` says why.")


def _motors(log: LogHealth) -> Iterator[Statement]:
    motors = log.motors
    if motors is None:
        return
    for one in motors.stopped:
        until = "to the end" if one.last else f"to {one.stop:.1f} s"
        words = f"{capitalised(rotor(one.rotor))} was commanded nothing from {one.start:.1f} s {until}, in the air, "
        words += "and others were: the autopilot took it for failed. Inspect its propeller, motor, ESC and wires."
        yield Statement("bad", "motors", f"{one.rotor.name} stopped at {one.start:.1f} s", words)
    drift = "" if log.phases.speed_known else " Steady flight may do the same: the speed is not logged."
    if motors.balance_level != "ok":
        hard = motors.hardest
        short = f"{hard.rotor.name} {100 * hard.deviation:+.0f} % thrust"
        told = "A model that fits the log tells" if log.contradictions else "Give its model with -m, to see"
        yield Statement(motors.balance_level, "motors", short, _balance(motors, drift, told))
    if motors.saturation_level == "ok":
        return
    if (motors.at_most or 0.0) > MOTORS.saturated:
        worst, end, time = max(motors.motors, key=lambda m: m.at_most or 0.0), "largest", motors.at_most
        so = "with no reserve for control: less weight, a fresher battery, or gentler flight"
    else:
        worst, end, time = max(motors.motors, key=lambda m: m.at_least or 0.0), "smallest", motors.at_least
        so = "and cannot be turned down further: descend more gently, or raise the idle command"
    words = (
        f"{capitalised(rotor(worst.rotor))} is at its {end} command {share(time or 0.0)} of the time in the air, {so}."
    )
    yield Statement(motors.saturation_level, "saturation", f"{worst.rotor.name} saturated", capitalised(words))


def _balance(motors: Motors, drift: str, told: str) -> str:
    """Which motor works harder, what that looks like, and what to do, which `told` begins where places are unknown."""
    hard = motors.hardest
    amount = f"commanded {share(hard.deviation)} more thrust than the mean in level hover"
    said = f"{capitalised(rotor(hard.rotor))} is {amount}"
    if hard.alike:
        said = f"The coaxial pair {_pair(hard)} is {amount}"
    if motors.shape is Shape.YAW and motors.yaw is not None:
        turning = "counter-clockwise" if motors.yaw > 0.0 else "clockwise"
        side = [m.rotor for m in motors.motors if (m.rotor.spin or 0) * motors.yaw > 0.0]
        amount = share(float(np.mean([m.deviation for m in motors.motors if m.rotor in side])))
        who = " and ".join(map(rotor, side))
        uneven = hard.deviation - float(np.mean([m.deviation for m in motors.motors if m.rotor in side]))
        also = f", and at the propeller of {hard.rotor.name}, {100 * hard.deviation:+.0f} %" * (
            uneven > MOTORS.beside_yaw
        )
        return (
            f"The motors that turn {turning}, {who}, are commanded {amount} more thrust than the mean in level hover: "
            f"a yaw bias. Look for {YAW_BIAS}{also}; a sound vehicle may have a part of it: compare with an earlier "
            "flight."
        )
    earlier = " A sound vehicle may have a part of it: compare with an earlier flight." * (
        motors.balance_level == "warn"
    )
    if motors.shape is Shape.COM and motors.centre is not None:
        off = float(np.hypot(*motors.centre))
        where = side_of(*motors.centre)
        return (
            f"{said}, and all together put the centre of thrust {share(off)} of the arm to the {where}: the "
            "centre of mass is there, or the propellers there are weak. Inspect these; if they are sound, move the "
            f"battery away from there.{earlier}{drift}"
        )
    others = [m.deviation for m in motors.motors if m.rotor not in (hard.rotor, *hard.alike)]
    said_of_one = (
        f"{said}, the others are within {share(max(others, default=0.0) - min(others, default=0.0))} of each other"
    )
    if motors.shape is Shape.ONE and hard.alike:
        names = " and ".join(one.name for one in (hard.rotor, *hard.alike))
        return (
            f"{said_of_one}. One command drives both, so that the log does not show which of {names} is "
            "weak: inspect both propellers, then motors and ESCs."
        )
    if motors.shape is Shape.ONE:
        return f"{said_of_one}. Inspect the propeller of {hard.rotor.name}, then its motor and ESC.{earlier}"
    if motors.shape is Shape.UNKNOWN:
        return f"{said}. {told} whether a weight, a yaw bias or a propeller makes it."
    least = min(motors.motors, key=lambda m: m.deviation)
    less = f"{_pair(least) if least.alike else rotor(least.rotor)} {share(-least.deviation)} less"
    return (
        f"{said}, {less}: neither one weak propeller, nor a weight, nor a yaw bias alone makes this pattern. Compare "
        "with a log from when it flew well (`wrenchgap changed`) before you change a part."
    )


def _pair(motor: Motor) -> str:
    """A motor and those that are coaxial with it and commanded alike: "back left (M5 and M6)"."""
    named = " and ".join(one.name for one in (motor.rotor, *motor.alike))
    return rotor(replace(motor.rotor, name=named))


def _vibration(found: Vibration | None, motors: Motors | None) -> Iterator[Statement]:
    if found is None:
        return
    high = max(found.levels, default=0.0)
    if found.limits is not None and high > found.limits[0]:
        k = 1 if high > found.limits[1] else 0
        axis = f" along {'xyz'[int(np.argmax(found.levels))]}" if len(found.levels) == 3 else ""
        words = f"Vibration of {number(high, 2)} m/s^2{axis} in flight ({found.source}), above {found.limits[k]:g}: "
        words += "balance the propellers, check mounts and screws."
        yield Statement("bad" if k else "warn", "vibration", f"vibration {number(high, 2)} m/s^2", words)
    if (found.clipped or 0) > VIBRATION.clips:
        words = f"The accelerometer was clipped {found.clipped:,} times in flight: its mean is wrong then. Damp the "
        words += "autopilot's mount, and balance the propellers."
        yield Statement("warn", "clipping", "accelerometer clipped", words)
    for peak in found.peaks:
        if peak.rms > SHAKES and peak.multiple == 1 and not peak.folded:
            known = {m.rotor.name: m.rotor for m in (motors.motors if motors else ())}
            names = " or ".join(rotor(known.get(name, RotorPlace(name))) for name in peak.rotors)
            words = f"{number(peak.rms, 2)} m/s^2 at {peak.hz:.0f} Hz turn with {names}: balance its propeller."
            yield Statement("warn", "vibration", f"{peak.hz:.0f} Hz of {', '.join(peak.rotors)}", words)


def _messages(log: LogHealth, most: int = 2) -> Iterator[Statement]:
    """The worst of what the autopilot reported in flight."""
    flown = [one for one in log.messages if one.in_flight]
    if flown:
        said = ", ".join(f'"{one.text}" ({one.level}, {one.time:.1f} s)' for one in flown[:most])
        more = f" and {len(flown) - most} more (--details)" if len(flown) > most else ""
        yield Statement("warn", "messages", f'"{flown[0].text}"', f"The autopilot reported in flight: {said}{more}.")


def _battery(log: LogHealth) -> Iterator[Statement]:
    battery = log.battery
    if battery is None or battery.level == "ok":
        return
    amperes = f"{battery.current or 0.0:.2g} A in flight: not what the motors take" if battery.no_current else ""
    if battery.none:
        short, words = "no battery", f"The battery reads {battery.flight:.2g} V in flight: not a battery"
        words += f", and {amperes}" if amperes else ""
        words += ". Set up the power module; until then nothing can be said of thrust and voltage."
    elif battery.cells_wrong:
        each = battery.flight / (battery.cells or 1)
        short, words = "battery cells", f"{battery.flight:.1f} V over {battery.cells} cells is {each:.1f} V a cell, "
        words += "which none has: correct the number of cells, or the calibration of the voltage."
    elif battery.below > BATTERY.low:
        short, words = "battery low", f"The battery was below {battery.limit:.1f} V ({battery.limit_of}) for "
        words += f"{battery.below:.0f} s of flight (lowest {battery.lowest:.1f} V): land earlier, or check that value."
    else:
        short, words = "no current", f"The current reads {amperes}. Set up the power module; until then the autopilot "
        words += "cannot count the charge."
    yield Statement("warn", "battery", short, words)


def _estimator(estimator: Estimator | None) -> Iterator[Statement]:
    if estimator is None or estimator.level == "ok":
        return
    worst = estimator.worst
    if estimator.faulty > 0.0:
        words = f"The estimator reports a fault {share(estimator.faulty)} of the time in the air ({estimator.topic}): "
        words += "do not trust attitude and position there."
    elif worst.rejected > ESTIMATOR.rarely:
        words = f"The estimator rejects its {worst.of} {share(worst.rejected)} of the time in the air "
        words += f"({worst.topic}): check that sensor, its mounting and its calibration."
    elif estimator.disturbed > ESTIMATOR.often:
        words = ""
    else:
        worst = max(estimator.ratios, key=lambda ratio: ratio.median)
        words = f"Innovations of the {worst.of} are {number(worst.median, 2)} of what the estimator accepts, usual is "
        words += f"below {ESTIMATOR.usual:g} ({estimator.topic}): check that sensor and its calibration."
    if estimator.disturbed > ESTIMATOR.often:
        words += f" The magnetic field is not the expected one {share(estimator.disturbed)} of the time in the air "
        words += "(cs_mag_field_disturbed): keep the compass away from iron and from wires of the battery."
    yield Statement(estimator.level, "estimator", "estimator", words.strip())


def _logger(log: LogHealth) -> Iterator[Statement]:
    """Dropouts, gaps, and damage to the file."""
    flight = log.inspection.flight
    if flight is not None and flight.damage:
        yield Statement("warn", "log", "damaged file", f"{flight.damage[0]} What was recorded there is missing.")
    autopilot, length = log.autopilot, log.inspection.duration
    if autopilot is not None and (autopilot.lost or 0.0) > LOST * length:
        words = f"The logger lost {autopilot.lost:.1f} s of {length:.0f} s in {autopilot.dropouts} dropouts: use a "
        yield Statement("warn", "logger", "dropouts", f"{words}faster card, or log less.")
    elif autopilot is not None and autopilot.lost is None and autopilot.dropouts:
        words = f"The logger dropped {autopilot.dropouts:,} blocks of messages: use a faster card, or log less."
        yield Statement("warn", "logger", "dropouts", words)
    gaps = [rate for rate in log.rates if rate.in_flight > LONG_GAP and rate.role in HELD]
    if gaps:
        worst = max(gaps, key=lambda rate: rate.in_flight)
        words = f"Nothing was logged of {worst.topic} ({worst.role}) for {worst.in_flight:.1f} s between take-off and "
        words += "landing: what happened meanwhile is not known."
        yield Statement("warn", "gaps", f"gap of {worst.in_flight:.1f} s", words)


def unanswered(answers: Sequence[Answer]) -> str:
    """What a log cannot answer and why, by reason; empty where it can answer everything."""
    lacking = by_reason((lack(answer), answer.question) for answer in answers if answer.lack is not None)
    return "; ".join(f"{', '.join(questions)} ({why})" for why, questions in lacking.items())


def lack(answer: Answer) -> str:
    """What an answer lacks, in a few words."""
    if answer.lack is None:
        return "can be answered"
    name, _, rest = answer.lack.partition(" [")
    name = "fall of the voltage during the flight" if answer.lack is Lack.VOLTAGE and answer.have is not None else name
    if answer.have is None:
        return f"{name.removeprefix('rate of ').removeprefix('drop of ').removesuffix(' for rotors')} not found"
    needed = "needed" if answer.lack in EXACT else "typically needed"
    return f"{name} {number(answer.have, 2)} {rest.rstrip(']')}, {answer.need:g} {needed}"


EXACT = (Lack.ANY, Lack.MOTORS, Lack.COMMANDS, Lack.IMU, Lack.FLIGHT)
"""What the analyses need whatever the vehicle; of the rest they need what is typical."""


def setting(one: Setting) -> str:
    """What to set in the logger."""
    if one.name == "cflib":
        return "Log with cflib in blocks of a 10 ms period: motor.m1 to .m4, gyro.x to .z, acc.x to .z, pm.vbat"
    if not one.name:
        return "Log motor commands and the IMU faster, at 100 Hz or more"
    now = "" if one.now is None else f" from {one.now}"
    gives = {
        "SDLOG_PROFILE": "IMU and motor commands at full rate",
        "LOG_BITMASK": "IMU, ATT and RATE at the rate of the main loop",
    }
    return f"Set {one.name}{now} to {one.to} ({gives[one.name]})"


def peak(one: Peak) -> str:
    """A peak in a few words."""
    said = f"{number(one.rms, 2)} m/s^2 at {one.hz:.0f} Hz"
    if one.rotors:
        turn = "the speed" if one.multiple == 1 else f"{one.multiple} times the speed"
        return f"{said} ({turn} of {', '.join(one.rotors)}{', folded' if one.folded else ''})"
    return f"{said} (with a harmonic)" if one.harmonic else said
