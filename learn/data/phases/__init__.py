"""Phases of a flight: which parts of it are no ordinary flight, found from what the log carries, in one place.

    phase       names, and what an analysis leaves out
    signals     commanded and felt force side by side
    ground      contact, take-off, landing
    crash       impacts, loss of control
    saturation  commands beyond what the rotors can make

Asked in `learn.data.opening`; docs/checks.md says what is done with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrenchgap.flight.flight import Samples
from wrenchgap.learn.data.phases.crash import crashes, spikes
from wrenchgap.learn.data.phases.ground import contact, ground
from wrenchgap.learn.data.phases.phase import Phase, runs, used
from wrenchgap.learn.data.phases.saturation import saturations
from wrenchgap.learn.data.phases.signals import command_scale, signals
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import Vehicle

MOSTLY = 0.5
"""Share of the time in the air beyond which saturation is no phase of a flight, but a limit that is too low."""


def phases_of(
    parts: Sequence[tuple[Samples, Commands, str]], vehicle: Vehicle, cutoff_hz: float, keep: Sequence[str] = ()
) -> tuple[Phase, ...]:
    """Phases of a flight, in order of time, of its stretches with their commands (`measurement.commands_of`).

    `keep` are names of phases that are found but not left out.
    """
    found = _grounded(parts, vehicle)
    limited = [p for one in parts for p in saturations(*one, vehicle, cutoff_hz)]
    limited = [p for p in limited if not _within(p, found)]
    if _seconds(limited) > MOSTLY * _flown(parts, found):
        why = "for most of the flight: is vehicle.rotor.speed_max too low?"
        limited = [replace(p, why=why, left_out=False) for p in limited]
    every = (replace(p, left_out=False) if p.name in keep else p for p in (*found, *limited))
    return tuple(sorted(every, key=lambda phase: (phase.start, phase.stop)))


def _grounded(parts: Sequence[tuple[Samples, Commands, str]], vehicle: Vehicle) -> list[Phase]:
    """On the ground, taking off, landing, crashed; the signals that tell are gone when this returns."""
    seen = [one for samples, commands, _ in parts if (one := signals(samples, commands, vehicle)) is not None]
    found: list[Phase] = []
    if seen:
        scale = command_scale(seen)
        on = [contact(part, scale) for part in seen]
        air = np.concatenate([spikes(part, scale)[~flags] for part, flags in zip(seen, on, strict=True)])
        usual = 0.0 if len(air) == 0 else float(np.percentile(air, 25.0))
        for part, flags in zip(seen, on, strict=True):
            lost = crashes(part, flags, scale, usual)
            found += [p for p in ground(part, flags, vehicle) if not _within(p, lost)] + lost
    return found


def _within(phase: Phase, others: Sequence[Phase]) -> bool:
    """Whether a phase lies in another one that is left out."""
    return any(o.left_out and o.start <= phase.start and phase.stop <= o.stop for o in others)


def _seconds(phases: Sequence[Phase]) -> float:
    return sum(p.stop - p.start for p in phases if p.left_out)


def _flown(parts: Sequence[tuple[Samples, Commands, str]], found: Sequence[Phase]) -> float:
    return float(sum(used(samples.time, found).sum() * samples.dt for samples, _, _ in parts))


__all__ = ["Phase", "phases_of", "runs", "used"]
