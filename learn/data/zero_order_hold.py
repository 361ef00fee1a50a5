"""Held signals on another clock: what a logged command was on average around each instant, or from each instant on.

A measurement at an instant sees the command on average *around* it (`flight.resample`); a plant that is stepped from
instant to instant holds what was sent on average *over* the period that begins there.
"""

from __future__ import annotations

from dataclasses import replace

from wrenchgap.flight.flight import Array, Flight, Samples, Series, WrenchSeries
from wrenchgap.flight.resample import held_mean
from wrenchgap.learn.data.measurement import Record, commands_of, low_pass
from wrenchgap.plant.vehicle import Vehicle


def _near(series: Series, values: Array, time: Array, middle: Array, window: float) -> Array:
    """Means over `window` [s] around each `middle` (N,), from the part of a series that lies about `time` (N,)."""
    run = (series.time >= time[0] - 1.0) & (series.time <= time[-1] + 1.0)
    return held_mean(middle, series.time[run], values[run], series.period, window)


def samples_over_periods(samples: Samples, log: Flight) -> Samples:
    """The samples of a log, with commands over the period that begins at each instant instead of around it."""

    def mean(series: Series, values: Array) -> Array:
        return _near(series, values, samples.time, samples.time + 0.5 * samples.dt, samples.dt)

    used: dict[str, Array] = {}
    if samples.wrench_cmd_B is not None and log.commanded is not None:
        used["wrench_cmd_B"] = mean(log.commanded, log.commanded.wrench_B)
    if samples.wrench_des_B is not None and log.desired is not None:
        used["wrench_des_B"] = mean(log.desired, log.desired.wrench_B)
    if samples.rotor_speed_cmd is not None and log.actuators is not None:
        used["tilt_cmd"] = mean(log.actuators, log.actuators.tilt)
        used["rotor_speed_cmd"] = mean(log.actuators, log.actuators.rotor_speed)
    return replace(samples, **used)  # type: ignore[arg-type]


def commanded_otherwise(record: Record, samples: Samples, command: WrenchSeries, vehicle: Vehicle) -> Record:
    """The record of `samples` as if another wrench had been commanded, in the motion that was flown."""
    wrench = _near(command, command.wrench_B, samples.time, samples.time, max(samples.dt, command.period))
    other = replace(samples, wrench_cmd_B=wrench, tilt_cmd=None, rotor_speed_cmd=None)
    commands, source = commands_of(other, vehicle)
    filtered = low_pass(wrench, record.dt, record.cutoff_hz)[record.keep]
    return replace(record, commands=commands, commanded=filtered, source=source)
