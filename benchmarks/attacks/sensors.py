"""Sensors that lie, and one flight under two names: what an operator who notices nothing gets from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import butter, sosfilt

from benchmarks.attacks import Attack, Outcome
from wrenchgap import changed, load_model, open_flights, ready, save_log, simulate
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Flight
from wrenchgap.replay.readiness import Decision

AREA = "Sensors that lie"
MODEL = "tilt_hexarotor"
SECONDS = 14.0
Change = Callable[[Flight], Flight]


def flown(seconds: float = SECONDS) -> Flight:
    """A flight with motion about every axis."""
    return simulate(load_model(MODEL), "multi_axis", duration=seconds, seed=5)


def _imu(flight: Flight, name: str, change: Callable[[np.ndarray], np.ndarray]) -> Flight:
    imu = flight.imu
    assert imu is not None
    return replace(flight, imu=replace(imu, **{name: change(getattr(imu, name).copy())}))


def scaled(flight: Flight) -> Flight:
    """A gyroscope that reads 10 % too little."""
    return _imu(flight, "omega_B", lambda v: 0.9 * v)


def dead(flight: Flight) -> Flight:
    """A gyroscope that reads one value from 70 % of the flight on."""

    def stopped(values: np.ndarray) -> np.ndarray:
        first = int(0.7 * len(values))
        values[first:] = values[first]
        return values

    return _imu(flight, "omega_B", stopped)


def high_passed(flight: Flight) -> Flight:
    """A gyroscope that takes its bias off by a high-pass of 0.1 Hz."""
    period = 0.0 if flight.imu is None else flight.imu.period
    sos = butter(1, 0.1, "highpass", fs=1.0 / period, output="sos")
    return _imu(flight, "omega_B", lambda v: sosfilt(sos, v, axis=0))


def gained(flight: Flight) -> Flight:
    """An accelerometer whose y axis reads 1.6 times what there is."""
    return _imu(flight, "specific_force_B", lambda v: v * [1.0, 1.6, 1.0])


def repeated(flight: Flight) -> Flight:
    """Commands of which the log repeats every tenth."""
    sent = flight.actuators
    assert sent is not None
    held = {
        name: np.repeat(getattr(sent, name)[::10], 10, axis=0)[: len(sent.time)] for name in ("tilt", "rotor_speed")
    }
    return replace(flight, actuators=replace(sent, **held), commanded=None, desired=None)


def fast_rotor(flight: Flight) -> Flight:
    """One rotor whose logged speed is 5 % too large, beside a commanded wrench that is as sent."""
    sent = flight.actuators
    assert sent is not None
    speed = sent.rotor_speed * np.where(np.arange(sent.rotor_speed.shape[1]) == 4, 1.05, 1.0)
    return replace(flight, actuators=replace(sent, rotor_speed=speed))


def flat(flight: Flight) -> Flight:
    """A gyroscope whose range ends at 90 % of what it reads."""
    return _imu(flight, "omega_B", lambda v: np.clip(v, -0.9 * np.abs(v).max(), 0.9 * np.abs(v).max()))


def opposite(flight: Flight) -> Flight:
    """An accelerometer whose y axis changes its sign for the last 55 % of the flight."""

    def turned(values: np.ndarray) -> np.ndarray:
        values[int(0.45 * len(values)) :, 1] *= -1.0
        return values

    return _imu(flight, "specific_force_B", turned)


def stopped(flight: Flight) -> Flight:
    """A rotor whose logged command stands still from 60 % of the flight on."""

    def change(speed: np.ndarray) -> None:
        first = int(0.6 * len(speed))
        speed[first:, 2] = speed[first, 2]

    return _rotors(flight, change)


def _rotors(flight: Flight, change: Callable[[np.ndarray], None]) -> Flight:
    actuators = flight.actuators
    assert actuators is not None
    speed = actuators.rotor_speed.copy()
    change(speed)
    return replace(flight, actuators=replace(actuators, rotor_speed=speed))


def twin(flight: Flight) -> Flight:
    """A rotor whose logged command is that of a rotor on another arm."""

    def change(speed: np.ndarray) -> None:
        speed[:, 3] = speed[:, 0]

    return _rotors(flight, change)


def hundredfold(flight: Flight) -> Flight:
    """A rotor whose command is in another unit from half to 80 % of the flight."""

    def change(speed: np.ndarray) -> None:
        speed[len(speed) // 2 : int(0.8 * len(speed)), 1] *= 100.0

    return _rotors(flight, change)


def held(flight: Flight) -> Flight:
    """An accelerometer that is logged twenty times as often as it reads."""
    return _imu(flight, "specific_force_B", lambda v: np.repeat(v[::20], 20, axis=0)[: len(v)])


def said(change: Change, check: str, folder: Path, seconds: float = SECONDS) -> Outcome:
    """Whether the log is refused by this check, or opened with a warning of it."""
    log = save_log(change(flown(seconds)), folder / "log.mcap")
    try:
        (opened,) = open_flights(log, load_model(MODEL))
    except LogError as error:
        return Outcome(f": {check}: " in str(error) and "\n" not in str(error), f"refused: {str(error)[:160]}")
    found = [one for one in opened.checks if one.name == check and one.level != "ok"]
    return Outcome(bool(found), found[0].words if found else "nothing was said")


def wrong_unit(folder: Path) -> Outcome:
    """Whether no command is made up for the stretch."""
    log = save_log(hundredfold(flown()), folder / "log.mcap")
    (opened,) = open_flights(log, load_model(MODEL))
    said = [one.words for one in opened.checks if one.name == "spikes"]
    actuators = opened.flight.actuators
    gaps = () if actuators is None else actuators.gaps
    longest = max((gap.stop - gap.start for gap in gaps), default=0.0)
    return Outcome(bool(said) and longest > 0.25 * SECONDS, f"{' '.join(said)} A gap of {longest:.2f} s")


def late(flight: Flight) -> Flight:
    """An accelerometer that is 40 ms late."""
    samples = round(0.04 / flight.imu.period) if flight.imu is not None else 0
    return _imu(flight, "specific_force_B", lambda v: np.roll(v, samples, axis=0))


def jumping(flight: Flight) -> Flight:
    """An IMU whose stamps step by 80 ms in the middle of the flight."""
    imu = flight.imu
    assert imu is not None
    time = imu.time + 0.08 * (imu.time > float(np.mean(imu.time)))
    return replace(flight, imu=replace(imu, time=time))


def throttle(folder: Path) -> Outcome:
    """The mean command of a quadrotor that turns, in every rotor's column."""
    model = load_model("crazyflie")
    flight = simulate(model, "multi_axis", duration=SECONDS, seed=5, excitation=1.0)

    def change(speed: np.ndarray) -> None:
        speed[:] = speed.mean(axis=1, keepdims=True)

    log = save_log(_rotors(replace(flight, commanded=None, desired=None), change), folder / "log.mcap")
    try:
        open_flights(log, model)
    except LogError as error:
        return Outcome(": rotors: all 4 rotors have one command" in str(error), f"refused: {str(error)[:160]}")
    return Outcome(False, "was opened")


def squared(folder: Path) -> Outcome:
    """Rotor speeds of the suspect flight as their squares, about the same hover; no commanded wrench."""
    model = load_model("crazyflie")
    flights = [
        replace(
            simulate(model, "multi_axis", duration=SECONDS, seed=seed, excitation=1.0), commanded=None, desired=None
        )
        for seed in (5, 6, 7)
    ]

    def change(speed: np.ndarray) -> None:
        speed[:] = speed**2 / np.median(speed)

    flights[-1] = _rotors(flights[-1], change)
    logs = [save_log(flight, folder / f"log{k}.mcap") for k, flight in enumerate(flights)]
    try:
        changed(open_flights(logs[2], model), open_flights(logs[:2], model), model, names=["com_offset"], jobs=1)
    except LogError as error:
        return Outcome("how thrust goes with the commands" in str(error), f"refused: {str(error)[:300]}")
    return Outcome(False, "was compared")


def later(folder: Path) -> Outcome:
    """A flight that answers 90 ms later than the model says, given to `ready` for the next one."""
    model = load_model(MODEL)
    flight = simulate(model, "multi_axis", duration=24.0, seed=8, hide=["command_delay=delay:0.09"], excitation=1.0)
    found = ready(open_flights(save_log(flight, folder / "log.mcap"), model), model, "multi_axis")
    seen = [one.change for one in found.contradicted if one.effect == "command_delay"]
    return Outcome(
        found.decision is not Decision.GO and bool(seen), f"{found.decision}: {1e3 * sum(seen):.0f} ms later"
    )


def copied(folder: Path) -> Outcome:
    """A cut of the training flight, stamped an hour later and in single precision, as the flight to test on."""
    flight = flown()
    cut: dict[str, Any] = {"start_ns": flight.start_ns + 3_600_000_000_000}
    for role, series in flight.series().items():
        rows = slice(int(np.searchsorted(series.time, 3.0)), None)
        arrays = {k: v[rows].astype(np.float32) for k, v in vars(series).items() if isinstance(v, np.ndarray)}
        arrays = {k: v.astype(float) for k, v in arrays.items()} | {"time": series.time[rows] - 3.0}
        cut[role] = replace(series, **arrays)
    logs = [save_log(flight, folder / "train.mcap"), save_log(replace(flight, **cut), folder / "test.mcap")]
    try:
        open_flights(logs, load_model(MODEL))
    except LogError as error:
        return Outcome("is the same flight as" in str(error), "refused, with both names")
    return Outcome(False, "both were opened")


ATTACKS = (
    Attack(
        "a gyroscope scaled by 0.9, in front of a good attitude",
        "refused: gyroscope-scale, with the factor",
        lambda folder: said(scaled, "gyroscope-scale", folder),
    ),
    Attack(
        "a gyroscope that takes its bias off in flight, by a high-pass of 0.1 Hz",
        "refused: gyroscope-scale, with the corner",
        lambda folder: said(high_passed, "gyroscope-scale", folder, 2.0 * SECONDS),
    ),
    Attack(
        "an accelerometer whose y axis reads 1.6 times what there is",
        "refused: accelerometer-scale, with the scale",
        lambda folder: said(gained, "accelerometer-scale", folder),
    ),
    Attack(
        "motor commands of which the log repeats every tenth",
        "said: rate, with the lag below which nothing is known",
        lambda folder: said(repeated, "rate", folder),
    ),
    Attack(
        "one rotor whose logged speed is 5 % too large, beside a sound commanded wrench",
        "refused: actuation, with the rotor and the factor",
        lambda folder: said(fast_rotor, "actuation", folder),
    ),
    Attack(
        "a gyroscope that dies until the end of the log",
        "left out from there on, and said",
        lambda folder: said(dead, "frozen", folder),
    ),
    Attack(
        "a gyroscope at the end of its range",
        "said, with value and count",
        lambda folder: said(flat, "clipped", folder),
    ),
    Attack(
        "an accelerometer whose y axis changes its sign in flight",
        "refused: accelerometer-scale, with axis, moment and correlations",
        lambda folder: said(opposite, "accelerometer-scale", folder),
    ),
    Attack(
        "a rotor whose command stands still until the end of the log",
        "left out from there on, and said",
        lambda folder: said(stopped, "frozen", folder),
    ),
    Attack(
        "a rotor whose logged command is that of another arm's, in a vehicle that drives its rotors in pairs",
        "refused: rotors, with which and in how many samples",
        lambda folder: said(twin, "rotors", folder),
    ),
    Attack(
        "a rotor whose command is in another unit from half to 80 % of the flight",
        "left out, as a gap and not bridged, and said",
        wrong_unit,
    ),
    Attack(
        "an accelerometer that repeats each value twenty times",
        "refused: rate, with the rate at which it reads",
        lambda folder: said(held, "rate", folder),
    ),
    Attack(
        "one throttle logged as the command of all rotors of a quadrotor that turns",
        "refused: rotors",
        throttle,
    ),
    Attack(
        "a suspect flight of `changed` whose rotor speeds were logged as their squares",
        "refused: inertia, or how thrust goes with the commands",
        squared,
    ),
    Attack(
        "a flight that answers 90 ms later than the model that `ready` is asked with",
        "no plain go, and said",
        later,
    ),
    Attack(
        "an accelerometer that is 40 ms late",
        "said, with by how much",
        lambda folder: said(late, "rate", folder, 2.0 * SECONDS),
    ),
    Attack(
        "an IMU whose stamps step by 80 ms in the middle of the flight",
        "said, with when and by how much",
        lambda folder: said(jumping, "clock-jump", folder, 3.0 * SECONDS),
    ),
    Attack(
        "a cut of the training flight as the test, other stamps and precision",
        "refused",
        copied,
    ),
)
