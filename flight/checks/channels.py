"""Each channel by itself: roles, units that sizes betray, axes without a reading, gaps, jitter, clocks.

A sensor that is logged faster than it reads comes in runs of one length; it is as fast as its runs, and late by half.
"""

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.masking import MASKING
from wrenchgap.flight.checks.remedies import option
from wrenchgap.flight.clocks import UNIT_RATES, Timing
from wrenchgap.flight.flight import AXES, Array, Flight
from wrenchgap.flight.mapping_units import topic_of
from wrenchgap.flight.row_kernels import varying
from wrenchgap.flight.stamps import Steps, thinned
from wrenchgap.flight.unmeasured import sentence, unmeasured_axes, zero_axes


def roles(flight: Flight) -> Iterator[Check]:
    """What is played, and what cannot be done without the rest."""
    played = flight.series()
    if "commanded" not in played and "actuators" not in played:
        words = "Neither a commanded wrench nor actuators: there is no model to compare with."
        yield Check("roles", "bad", f"{words} Map one with --topic {flight.command_option}.")
    if "imu" not in played:
        instead = "rates and forces come from the odometry" if "odometry" in played else "map one with --topic imu=..."
        yield Check("roles", "warn" if "odometry" in played else "bad", f"No IMU: {instead}.")
    if "odometry" not in played:
        yield Check("roles", "warn", "No odometry: attitude and velocity are unknown; no counterfactual flight.")
    if {"commanded", "imu", "odometry"} <= set(played):
        yield Check("roles", "ok", f"Roles played: {', '.join(played)}.")


def vehicles(found: Sequence[tuple[str, str]]) -> tuple[Check, ...]:
    """Whether the log is of one vehicle, or nobody said of which."""
    if not found:
        return ()
    listed = ", ".join(topic for _, topic in found)
    part, topic = found[0]
    words = f"The log may be of {len(found)} vehicles: {listed} could each be the {part}; say which, the rest follows"
    return (Check("vehicles", "bad", words, f"--topic {shlex.quote(f'{part}={topic}')}"),)


def units(flight: Flight, rows: int = 20_000) -> Iterator[Check]:
    """Rotor speeds and tilt angles, by their sizes in so many rows, evenly spread over the flight."""
    if flight.actuators is None or flight.actuators.unit != "rad/s":
        return
    some = thinned(len(flight.actuators.time), rows)
    speeds, tilts = np.abs(flight.actuators.rotor_speed[some]), np.abs(flight.actuators.tilt[some])
    if speeds.size and float(np.median(speeds)) > 3500.0:
        words = f"Median rotor speed is {np.median(speeds):.0f}: rpm? Expected rad/s (rpm / 9.549)."
        yield Check("rotor-speed-unit", "warn", words, option(flight, "rpm", "rotor_speed"))
    if speeds.size and float(np.max(speeds)) <= 1.0 and 0.0 < np.max(np.abs(flight.actuators.rotor_speed)) <= 1.0:
        yield Check("rotor-speed-unit", "warn", "Rotor speeds never exceed 1: normalised commands? Expected rad/s.")
    if tilts.size and float(np.percentile(tilts, 90)) > 4 * np.pi:
        words = f"Tilt reaches {np.max(tilts):.0f}: degrees, expected rad"
        yield Check("tilt-unit", "bad", words, option(flight, "deg", "tilt"))


def unmeasured(flight: Flight) -> Iterator[Check]:
    """Axes of the IMU without a reading: known to have none, or zero throughout, which no sensor in flight reads."""
    absent = unmeasured_axes(flight)
    if absent:
        yield Check("not-measured", "warn", sentence(flight.name, absent))
    if zero := zero_axes(flight):
        mend = f"--unmeasured {','.join(zero)}"
        words = f"The IMU reads exactly zero throughout on {', '.join(zero)} (force: accelerometer, torque: gyroscope)"
        words += f": not measured? Left out of every analysis, as with {mend}."
        yield Check("not-measured", "warn", words, mend if len(zero) < len(AXES) else "--topic imu=none")


def coarse(flight: Flight, most: float = 0.5, rows: int = 20_000) -> Iterator[Check]:
    """Axes of the IMU that read one value in more than `most` of the samples in which others go on, of at most `rows`.

    Steps q of a signal whose standard deviation is s do that from q = 1.35 s on: what is lost in rounding is then
    q / sqrt(12) = 0.4 s, and moves with the signal. A dead band does it too. Of 43 recorded and simulated
    logs no axis is above 0.02; at 0.25 or 0.75 the same logs are found.
    """
    if flight.imu is None:
        return
    at = np.arange(1, len(flight.imu.time))[thinned(len(flight.imu.time) - 1, rows)]
    before, some = (np.hstack((flight.imu.specific_force_B[k], flight.imu.omega_B[k])) for k in (at - 1, at))
    shares = {}
    for axis, values in zip(AXES, some[np.any(some != before, axis=1)].T, strict=True):
        if len(values) and varying(values[:, None]).any():
            _, often = np.unique(values, return_counts=True)
            shares[axis] = float(often.max() / len(values))
    found = {axis: share for axis, share in shares.items() if share > most}
    if found:
        listed = ", ".join(f"{axis} {100.0 * share:.3g} %" for axis, share in found.items())
        words = f"The IMU reads one value for most of the time while others go on ({listed} of the samples; force: "
        words += "accelerometer, torque: gyroscope): its steps are larger than what it measures, or it has a dead band"
        yield Check("not-measured", "bad", words, f"--unmeasured {','.join(found)}")


def constant(flight: Flight) -> Iterator[Check]:
    """Channels that never change; an IMU of which nothing does is none."""
    columns: list[tuple[str, Array]] = []
    if flight.imu is not None:
        columns += [("gyroscope", flight.imu.omega_B), ("accelerometer", flight.imu.specific_force_B)]
        if not any(varying(values).any() for _, values in columns):
            mend = "--topic imu=none" if flight.odometry is not None else None
            yield Check("constant-channel", "bad", "The IMU never changes at all: it is stuck, or no IMU", mend)
            columns = []
    if flight.odometry is not None:
        columns += [("position", flight.odometry.position_E), ("attitude", flight.odometry.quat_EB[:, 1:])]
    if flight.actuators is not None and flight.actuators.rotor_speed.size:
        columns.append(("rotor speed", flight.actuators.rotor_speed))
    if flight.commanded is not None:
        columns.append(("commanded wrench", flight.commanded.wrench_B))
    if same := held_voltage(flight):
        words = f"battery voltage: {same}, which no battery in flight keeps: what its fall takes from the thrust is in "
        yield Check("constant-channel", "warn", f"{words}no prediction, and may be found as another effect.")
    for name, values in columns:
        flat = [str(i) for i in np.flatnonzero(~varying(values) & ~np.isnan(values[0]))]
        usual, word = (3, "components") if name == "commanded wrench" else (0, "component(s)")
        if len(flat) > usual:
            yield Check("constant-channel", "warn", f"{name}: {word} {', '.join(flat)} never change.")


def held_voltage(flight: Flight, longer: float = 5.0) -> str:
    """What a voltmeter reads that has stopped, and from when on; empty if it has not, or nothing says so.

    While motors run, the voltage follows their current: where it changed before, it has stopped in a run that is
    `longer` times as long as any other and longer than a frozen sensor's. Over 13 recorded flights the longest run is
    up to 2.3 times the next: with 2.5 or 10 none of them is called stopped either.
    """
    if flight.battery is None or flight.battery.none or len(flight.battery.voltage) < 2:
        return ""
    time, volts = flight.battery.time, flight.battery.voltage
    if not varying(volts[:, None]).any():
        return f"{volts[0]:.4g} V in all {len(volts)} samples"
    if flight.actuators is not None and (speeds := flight.actuators.rotor_speed).size:
        on = flight.actuators.time[np.flatnonzero(speeds.max(axis=1) > 0.0)]
        flown = (time >= on.min(initial=math.inf)) & (time <= on.max(initial=-math.inf))
        time, volts = time[flown], volts[flown]
    if not len(volts):
        return ""
    starts = np.flatnonzero(np.append(True, volts[1:] != volts[:-1]))
    lengths = np.diff(np.append(starts, len(volts)))
    where = int(np.argmax(lengths))
    first, last = time[starts[where]], time[starts[where] + lengths[where] - 1]
    fewest = max(MASKING.frozen_samples, longer * np.delete(lengths, where).max(initial=1))
    if where == 0 or lengths[where] < fewest:  # before the first change the vehicle may have stood at rest
        return ""
    return f"{volts[starts[where]]:.4g} V from {first:.1f} s to {last:.1f} s, where motors run"


def copied(flight: Flight, turns: float = 0.1) -> Iterator[Check]:
    """Rotors whose commands are another's, sample by sample, in a vehicle that does not drive all of them so.

    Where pairs share one signal all are pairs; and where the vehicle never turns about an axis, both of its sides are
    told the same. Where all share one, nothing but arms that tilt turns a vehicle, by `turns` [rad/s] rms and more: a
    gyroscope's noise, and a hull that is carried up and down, have less.
    """
    speeds = np.zeros((0, 0)) if flight.actuators is None else flight.actuators.rotor_speed
    turning = flight.imu is None or bool(varying(flight.imu.omega_B).all())
    alike: dict[bytes, list[int]] = {}
    for k, column in enumerate(speeds.T):
        if np.count_nonzero(np.diff(column)) >= MASKING.frozen_samples:
            alike.setdefault(column.tobytes(), []).append(k)
    rotors = len(speeds.T)
    every = any(len(found) == rotors > 2 for found in alike.values())
    if every and flight.actuators is not None and flight.imu is not None:
        rate = float(np.sqrt(np.var(np.nan_to_num(flight.imu.omega_B), axis=0).mean()))
        if rate > turns and not varying(flight.actuators.tilt).any():
            words = (
                f"all {rotors} rotors have one command in all {len(speeds)} samples, and the vehicle turns: that is "
            )
            words += "a throttle, and not what drove each rotor. Log the command of each"
            yield Check("rotors", "bad", words)
    sizes = [len(found) for found in alike.values()]
    usual = int(np.argmax(np.bincount(sizes))) if sizes and turning else rotors
    for found in (found for found in alike.values() if len(found) > usual):
        words = f"rotor_speed {', '.join(map(str, found))} are equal in all {len(speeds)} samples, which others are not"
        words += ": is one logged in the place of another, whose command then is not in the log? Log each"
        yield Check("rotors", "bad", words)


def held_for(values: Array, share: float = 0.8) -> int:
    """How many samples a channel (N,) keeps each value for: the usual length of its runs, 1 where that varies.

    It is usual where the `share` of the samples is in runs of that length: coarse readings make runs of any length.
    """
    runs = np.diff(np.flatnonzero(np.concatenate(([True], values[1:] != values[:-1], [True]))))
    usual = int(np.median(runs)) if len(runs) > 1 else 1
    return usual if float(np.sum(runs[runs == usual])) > share * len(values) else 1


def sensors_held_for(flight: Flight) -> dict[str, int]:
    """For how many samples the slowest axis of each sensor of the IMU keeps its values."""
    imu = flight.imu
    readings = {} if imu is None else {"gyroscope": imu.omega_B, "accelerometer": imu.specific_force_B}
    return {name: max(map(held_for, values.T)) for name, values in readings.items()}


def held(flight: Flight) -> Iterator[Check]:
    """A sensor of the IMU that comes less often than its stamps say."""
    for name, count in sensors_held_for(flight).items():
        if flight.imu is not None and count > 1:
            period = flight.imu.period
            words = f"The {name} has each value {count} times: it reads at {1.0 / (count * period):.3g} Hz, not at the "
            words += f"{1.0 / period:.3g} Hz of its stamps, and is late by {500.0 * (count - 1) * period:.2g} ms"
            yield Check("rate", "warn", f"{words}: log each reading once, with its own stamp.")


STAMP_WORDS = {1e3: "ms", 1e6: "us", 1e9: "ns"}


def stamps(flight: Flight) -> Iterator[Check]:
    """Gaps and jitter."""
    by_message: dict[tuple[str, str], list[str]] = {}
    for role, series in flight.series().items():
        if role == "battery" or len(series.time) < 3:
            continue
        if series.gaps:
            longest = max(series.gaps, key=lambda gap: gap.stop - gap.start)
            words = f"the longest {longest.stop - longest.start:.3f} s at {longest.start:.2f} s"
            words = f"{len(series.gaps)} gap(s), {words}; stretches are split there."
            by_message.setdefault(("gaps", words), []).append(role)
        spread = Steps(series.time).jitter
        if spread > 0.3 * series.period:
            words = f"the period varies by {1e3 * spread:.2g} ms around {1e3 * series.period:.3g} ms: stamped on "
            by_message.setdefault(("jitter", f"{words}arrival? Record header stamps."), []).append(role)
    for (name, message), roles in by_message.items():  # topics of one recorder share their gaps
        yield Check(name, "warn", f"{', '.join(roles)}: {message}")


def dropped(flight: Flight) -> Iterator[Check]:
    """Samples that the reader left out."""
    for role, series in flight.series().items():
        lost = sum(series.dropped.values())
        if lost > 0.01 * (lost + len(series.time)):
            listed = ", ".join(f"{count} {reason}" for reason, count in series.dropped.items())
            yield Check("left-out", "warn", f"{role}: {lost} of {lost + len(series.time)} samples ({listed}).")


def damaged(flight: Flight) -> Iterator[Check]:
    """Where the file holds less than was recorded."""
    if flight.damage:
        yield Check("damaged", "warn", f"{' '.join(flight.damage)} What was recorded there is missing.")


def clocks(timing: Timing, mapping: Mapping[str, str], slow_link: float = 0.1) -> Iterator[Check]:
    """Stamps against log times, and links that are later than `slow_link` [s].

    `mapping` is that of the flight, for the option that mends their unit.
    """
    strange = {topic: r.unit for topic, r in timing.relations.items() if r.unit is not None}
    if strange:
        mends = []
        for part, source in mapping.items():
            unit = strange.get(topic_of(source))
            if unit is not None:
                word = STAMP_WORDS.get(unit) or f"stamp*{1.0 / unit:g}"
                mends.append(f"--topic {shlex.quote(f'{part}={source}' + (',' if ':' in source else ':') + word)}")
        rates = ", ".join(f"{topic} {unit:g} times ({UNIT_RATES[unit]})" for topic, unit in strange.items())
        words = f"Stamps advance faster or slower than time by a power of a thousand: {rates}"
        yield Check("clock-unit", "bad", words, " ".join(mends))
    for topic, found in timing.jumps.items():
        listed = ", ".join(f"{seconds:+.3f} s at message {index}" for index, seconds in found)
        yield Check("clock-jump", "warn", f"{topic}: stamps jump by {listed}: a clock was set; taken out.")
    relations = {topic: clock for topic, clock in timing.relations.items() if topic not in strange}
    alone = relations and not timing.mapped and not any(clock.same for clock in relations.values())
    for topic, clock in relations.items():
        described = f"header stamps differ from log time by {clock.offset:+.3f} s and run at {clock.rate:.4f} times "
        described += f"its rate{clock.kind} (residual {1e3 * clock.residual:.1f} ms)"
        if alone:
            words = "All stamps are of one clock, which is not the recorder's: they are used as they are"
            yield Check("clock", "ok", f"{words} ({topic}: {described}).")
            return
        if not clock.same:
            yield Check("clock", "warn", f"{topic}: {described}; see the notes for how they are used.")
        elif abs(clock.offset) > slow_link:
            yield Check("clock", "warn", f"{topic}: recorded {-clock.offset:.3f} s after its stamp: a slow link.")
