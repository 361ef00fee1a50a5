"""A case of the vehicles that RotorPy flies: the flight as its sensors recorded it, what was there, the model file."""

from __future__ import annotations

from benchmarks.field.cases import Case
from benchmarks.field.engine import fly, recorded
from benchmarks.field.hidden import HIDDEN, build
from benchmarks.field.oracle import amplitudes
from benchmarks.field.sensors import measured
from benchmarks.field.told import AIRS, BIASED, Told, families
from benchmarks.field.truth import Truth
from benchmarks.field.vehicles import GRAVITY, vehicle
from wrenchgap.flight.flight import Flight
from wrenchgap.plant.model import Model

GUSTS = 1.0
"""m/s rms, of the turbulence."""
DRAG, SINK, SQUARE = 0.02, 0.02, 0.006
"""What turbulence acts through: shares of the weight per m/s sideways and up, and at 1 m/s squared."""


def surroundings(case: Case) -> Truth:
    """The believed vehicle; in turbulence, in air that acts on it."""
    bare = Truth(vehicle(case.vehicle))
    if case.flying != "turbulence":
        return bare
    weight = bare.vehicle.mass * GRAVITY
    per_rotor = weight / (bare.vehicle.rotors * bare.vehicle.hover_speed)
    square = dict.fromkeys(("c_Dx", "c_Dy", "c_Dz"), SQUARE * weight)
    return bare.with_params(k_d=DRAG * per_rotor, k_z=SINK * per_rotor, **square).but(gusts=GUSTS)


def flown(case: Case) -> tuple[Flight, Told, Model]:
    """Fly, record, and say what was there."""
    bare = surroundings(case)
    truth = build(bare, case.effects, case.scales, case.seed)
    seen = fly(truth, case.flying, case.seconds, case.seed)
    flight = measured(recorded(seen, truth, case.name), case.imu, case.seed)
    sizes: tuple[float, ...] | None = None
    if case.effects and case.kind != "outside":
        sizes = tuple(amplitudes(bare, case.effects, case.scales, case.seed, seen, case.imu))
    hidden = [HIDDEN[e] for e in case.effects]
    told = Told(
        answers=tuple(tuple(families(s) for s in h.answers) for h in hidden),
        anyway=families((*BIASED[case.imu], *(AIRS if case.flying == "turbulence" else ()))),
        near=families(name for h in hidden for name in h.near),
        amplitudes=sizes,
    )
    return flight, told, bare.vehicle.model
