"""Which flights the field has: vehicles, kinds of flying, IMUs, what is hidden; tuned and published ones apart.

`everything(8000)` are the flights of docs/field.md. While something is tuned, `--seed 7000` gives others: other draws,
trajectories and noise. Nobody tunes on the published ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

Kind = Literal["one", "several", "none", "outside"]

TUNING, PUBLISHED = 7000, 8000
"""First seeds."""
SECONDS = {"excited": 24.0, "mission": 28.0, "turbulence": 24.0, "low": 24.0}


@dataclass(frozen=True)
class Case:
    """One flight. `scales` multiply the effects' typical sizes."""

    vehicle: str
    flying: str
    imu: str
    kind: Kind
    effects: tuple[str, ...] = ()
    scales: tuple[float, ...] = ()
    seed: int = 0
    seconds: float = 24.0

    @property
    def name(self) -> str:
        """Unique in the list."""
        hidden = "+".join(f"{e}x{s:g}" for e, s in zip(self.effects, self.scales, strict=True)) or "none"
        return f"{self.vehicle}.{self.flying}.{self.imu}.{hidden}.{self.seed}"


NONE = """
nano: excited good, mission cheap, turbulence good, turbulence cheap
quad: excited cheap, mission good, turbulence good, turbulence cheap
x8: excited good, mission cheap, turbulence good, turbulence cheap
blind: excited cheap, mission good, turbulence cheap
hexa: excited good, mission cheap, turbulence good, turbulence cheap
"""
ONE = """
nano: excited good weak_rotor, excited good slow_motors, mission good rotor_drag
nano: excited cheap parcel, turbulence good beside, mission good late
quad: excited good uneven_motors, excited good dead_band, mission good bluff_body
quad: mission good wind, low good ground, turbulence good weak_rotor, mission cheap battery, excited cheap sluggish
x8: excited good slipstream, excited good twisting, mission good inflow
x8: turbulence cheap heavier, excited good imu_moved, mission cheap fading
blind: excited good parcel, mission good bluff_body, excited cheap imu_turned
blind: turbulence good beside, mission good line
hexa: excited cheap weak_rotor, mission good com_offset, excited cheap servo_lag, turbulence good thin_air
"""
SEVERAL = """
nano: excited good beside slow_motors, mission good weak_rotor rotor_drag, excited good parcel slow_motors rotor_drag
quad: excited good weak_rotor sluggish, mission good wind beside, excited good dead_band uneven_motors
quad: excited good rotor_drag inflow slow_motors, excited cheap parcel weak_rotor slow_motors rotor_drag
quad: excited good beside weak_rotor dead_band rotor_drag imu_turned
x8: excited good slipstream beside, mission good heavier bluff_body, excited cheap thin_air imu_turned
x8: excited good slipstream slow_motors rotor_drag beside
x8: excited good parcel twisting rotor_drag slow_motors imu_turned
blind: excited good heavier imu_turned, mission good parcel bluff_body, excited cheap sluggish beside line
hexa: excited good com_offset weak_rotor, excited cheap wake com_offset servo_lag, mission good payload thin_air
"""
OUTSIDE = """
nano: excited good slung_load, mission good compass
quad: mission good slung_load, excited good slosh, mission cheap loose_rotor
x8: excited good compass, excited cheap slosh
blind: excited good slosh, mission good slung_load
hexa: excited good resonance, mission good slung_load
"""
LISTS: dict[Kind, str] = {"none": NONE, "one": ONE, "several": SEVERAL, "outside": OUTSIDE}


def everything(first_seed: int) -> Iterator[Case]:
    """The field; every flight has a seed of its own, counted from `first_seed`."""
    seed = first_seed
    for kind, listed in LISTS.items():
        for line in listed.strip().splitlines():
            vehicle, _, flights = line.partition(":")
            for flight in flights.split(","):
                seed += 1
                flying, imu, *effects = flight.split()
                scales = (1.0,) * len(effects)
                yield Case(vehicle, flying, imu, kind, tuple(effects), scales, seed, SECONDS[flying])


def shorter(cases: Iterator[Case], seconds: float) -> Iterator[Case]:
    """The same, for a look: flights of `seconds`."""
    for case in cases:
        yield replace(case, seconds=seconds)
