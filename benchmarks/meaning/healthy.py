"""Healthy logs that look unusual: what no check may call bad, nor warn of beyond what is so."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.meaning.flying import GRAVITY, Craft, Manner, fly
from wrenchgap.flight.flight import Flight

Change = Callable[[Flight], Flight]


@dataclass(frozen=True)
class Healthy:
    """`changed` is what the log lacks, or has more slowly."""

    name: str
    manner: Manner
    changed: Change | None = None


def _every(count: int) -> Change:
    def apply(flight: Flight) -> Flight:
        odometry = flight.odometry
        assert odometry is not None
        arrays = {k: v[::count] for k, v in vars(odometry).items() if isinstance(v, np.ndarray)}
        return replace(flight, odometry=replace(odometry, **arrays))

    return apply


def _biased(flight: Flight) -> Flight:
    imu = flight.imu
    assert imu is not None
    bias = np.array([0.05, -0.04, 0.06])
    omega, force = imu.omega_B + bias, imu.specific_force_B + 2.0 * bias
    return replace(flight, imu=replace(imu, omega_B=omega, specific_force_B=force))


def _on_the_ground(flight: Flight) -> Flight:
    """Four seconds at rest before the flight, motors off, sensors free of noise as in a simulator."""
    sent, actuators, imu, odometry = flight.commanded, flight.actuators, flight.imu, flight.odometry
    assert sent is not None
    assert actuators is not None
    assert imu is not None
    assert odometry is not None
    out = {}
    for name, series in (("commanded", sent), ("actuators", actuators), ("imu", imu), ("odometry", odometry)):
        count = round(4.0 / series.period)
        arrays = {k: v for k, v in vars(series).items() if isinstance(v, np.ndarray) and k != "time"}
        zero = {k: np.zeros((count, *v.shape[1:])) for k, v in arrays.items()}
        if name == "imu":
            zero["specific_force_B"][:, 2] = GRAVITY
        if name == "odometry":
            zero["quat_EB"][:, 0] = 1.0
            zero["position_E"][:] = odometry.position_E[0]
        time = np.concatenate((series.time[0] + np.arange(count) * series.period, series.time + count * series.period))
        joined = {k: np.concatenate((zero[k], v)) for k, v in arrays.items()}
        out[name] = replace(series, time=time, **joined)
    return replace(flight, **out)


HEALTHY = (
    Healthy("excited", Manner()),
    Healthy("hover without excitation", Manner(excitation=0.0, reach=0.02)),
    Healthy("cheap IMU", Manner(noise=8.0), _biased),
    Healthy("aerobatics", Manner(flips=True)),
    Healthy("no odometry", Manner(), lambda f: replace(f, odometry=None)),
    Healthy("odometry at 1 Hz", Manner(), _every(125)),
    Healthy("odometry at 10 Hz", Manner(), _every(12)),
    Healthy("no IMU", Manner(), lambda f: replace(f, imu=None)),
    Healthy("actuators alone", Manner(), lambda f: replace(f, commanded=None)),
    Healthy("wrench alone", Manner(), lambda f: replace(f, actuators=None)),
    Healthy("wrench and IMU alone", Manner(), lambda f: replace(f, actuators=None, odometry=None)),
    Healthy("on the ground first", Manner(), _on_the_ground),
)
"""Of every vehicle with fixed rotors."""


def healthy_of(craft: Craft, seed: int) -> Iterator[tuple[str, Flight]]:
    """Name and flight; what is flown alike is flown once."""
    flown: dict[Manner, Flight] = {}
    for case in HEALTHY:
        if case.manner not in flown:
            flown[case.manner] = fly(craft, 16.0, seed, case.manner)
        flight = flown[case.manner]
        yield case.name, flight if case.changed is None else case.changed(flight)
