"""The tilting hexarotor: the engine of `hidden_effects`, in missions and turbulence too, with the field's sensors."""

from __future__ import annotations

import numpy as np

from benchmarks.field.cases import Case
from benchmarks.field.flying import gusts
from benchmarks.field.sensors import measured
from benchmarks.hidden_effects.engine import ALWAYS, fly
from benchmarks.hidden_effects.hidden import HIDDEN
from benchmarks.hidden_effects.world import Engine, Hidden
from wrenchgap.flight.flight import Flight

TRAJECTORY = {"excited": "train", "mission": "mission", "turbulence": "hover"}
INTEGRAL = {"excited": 0.3, "mission": 0.3, "turbulence": 0.8}
"""1/s, of the autopilot's attitude error."""
GUSTS = 1.0
AREA, GUST_TORQUE, TICK = 0.18, 0.06, 0.01  # m^2; Nm rms, half a per cent of m g times the arm; s


class Turbulence(Hidden):
    """Air that moves about a hovering vehicle: plates in gusts of one second, and torques of a quarter of one."""

    def __init__(self, seconds: float, seed: int) -> None:
        rng, time = np.random.default_rng([seed, 47]), np.arange(0.0, seconds + 1.0, TICK)
        self._air = gusts(time, GUSTS, 1.0, rng) * np.array((1.0, 1.0, 0.5))
        self._torque = gusts(time, GUST_TORQUE, 0.25, rng)

    def push(self, world: Engine) -> None:
        """Drag of the air that passes, |v| v."""
        k = round(world.time / TICK)
        v = world.velocity_E - self._air[k]
        world.push(-0.5 * 1.2 * AREA * float(np.linalg.norm(v)) * v, world.position_E)
        world.twist(world.R_EB @ self._torque[k])


def flown(case: Case) -> Flight:
    """The flight of a case as its sensors recorded it."""
    also = (Turbulence(case.seconds, case.seed),) if case.flying == "turbulence" else ()
    sizes = tuple(HIDDEN[e].size * s for e, s in zip(case.effects, case.scales, strict=True))
    flight, _ = fly(
        case.effects,
        sizes or None,
        TRAJECTORY[case.flying],
        case.seconds,
        case.seed,
        INTEGRAL[case.flying],
        noise=0.0,
        also=also,
    )
    return measured(flight, case.imu, case.seed)


def answers(effect: str) -> tuple[frozenset[str], ...]:
    """Sets of names that are right for a hidden effect of that engine; none for what is in no catalogue."""
    listed = HIDDEN[effect].answers
    return () if listed[0] == "unknown" else tuple(frozenset((name,)) for name in listed)


def near(effect: str) -> tuple[str, ...]:
    """Names that are not wrong for it."""
    return tuple(name for name in HIDDEN[effect].answers if name != "unknown")


HAS_ANYWAY = tuple(ALWAYS)
"""What this vehicle has when nothing is hidden."""
