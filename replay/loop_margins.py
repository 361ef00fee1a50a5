"""Margins of the attitude loops of a model and of draws of it, with the gains that flew.

Nominal, and as drawn: with the lags, the delays, the inertia and the effectiveness of the rotors.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from wrenchgap.flight.flight import AXES, Array, Mask
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.flown_controller import flown_by_autopilot, flown_by_controller
from wrenchgap.learn.identify.guard import GUARD, loop_of
from wrenchgap.learn.posterior.settings import DEFAULT
from wrenchgap.plant.effectiveness import RANK, linear_matrix
from wrenchgap.plant.model import Model
from wrenchgap.plant.stability import open_loop, phase_and_gain_margins, rate_loop
from wrenchgap.plant.wrench_model import WrenchModel

GO = 0.9
"""Probability from which on a loop keeps its margins, and a flight is a go."""
PHASE, GAIN = 45.0, 6.0
"""Margins [deg], [dB] that a loop should have (Astrom and Murray, "Feedback Systems", 2008, 11.3)."""
FACTORS = np.geomspace(1.0, 0.25, 29)
"""By which gains are multiplied to look for lost margins; in steps of 5 %."""
ROTOR_INERTIA = "rotor_gyroscopic"
"""The effect that has the inertia of a rotor: of the vehicle, and in its nominal loops too."""
WITHIN = (5.0, 50.0, 95.0)
"""Percentiles of what a part needs."""


class Gains(StrEnum):
    """Whose gains flew. Without a lag or delay of actuators in the model an autopilot's margins are upper bounds."""

    MODEL = "model"
    PX4 = "PX4"
    PX4_NO_LAG = "PX4, no lag in the model"
    ARDUPILOT = "ArduPilot"
    ARDUPILOT_NO_LAG = "ArduPilot, no lag in the model"
    UNKNOWN = "unknown"

    @property
    def upper_bounds(self) -> bool:
        """Whether margins are upper bounds."""
        return self in (Gains.PX4_NO_LAG, Gains.ARDUPILOT_NO_LAG)


@dataclass(frozen=True)
class LoopMargins:
    """Of the attitude loop about an `axis`: margins of phase [deg] and gain [dB], `nominal` (2,), and as drawn, 5th,
    50th and 95th percentile (3,) each; the `probability` that both are large enough, and that `half` of them is left;
    by what to multiply the gains so that it is `GO`, one where it is, None where less gain does not help.
    """  # noqa: D205

    axis: str
    nominal: Array
    phase: Array
    gain: Array
    probability: float
    half: float
    factor: float | None


def flown_loops(
    model: Model, models: Sequence[WrenchModel], flights: Sequence[OpenFlight], voltage: float | None
) -> tuple[tuple[LoopMargins, ...], Gains]:
    """Margins with the gains that flew, an autopilot's or the model file's, and whose they are; none of unknown ones.

    About z an autopilot's loop depends on the inertia of the rotors, which turn the body as they speed up: without
    `rotor_gyroscopic` in the model nothing is said of it.
    """
    pilot = flown_by_autopilot(model, flights, voltage)
    if pilot is not None:
        gains, acceleration, inertia = pilot.gains, pilot.acceleration, model.vehicle.body.inertia

        def loop(one: Model) -> Array:
            late, lead = loop_of(one), pilot.lead(_rotor_inertia(one), inertia)
            return rate_loop(gains, acceleration, late.lag, late.named_delay + GUARD.periods * gains.period, lead)

        own, known = loop_of(model), np.array([True, True, _rotor_inertia(model, least=2.0) > 0.0])
        lag = "" if own.lag + own.named_delay > 0.0 else ", no lag in the model"
        return _loops(model, models, loop, pilot.axes & known), Gains(pilot.name + lag)
    if flown_by_controller(model, flights):
        return _loops(model, models, lambda one: open_loop(loop_of(one)), np.ones(3, dtype=bool)), Gains.MODEL
    return (), Gains.UNKNOWN


def _rotor_inertia(model: Model, least: float = 0.0) -> float:
    """Inertia of one rotor about its axis [kg m^2]; zero without one, or for one below `least` standard deviations."""
    found = [e for e in model.effects if e.name == ROTOR_INERTIA]
    return float(sum(e.theta[0] for e in found if e.std is None or e.theta[0] > least * e.std[0]))


def _loops(
    model: Model, models: Sequence[WrenchModel], loop: Callable[[Model], Array], axes: Mask
) -> tuple[LoopMargins, ...]:
    """Margins of a model's `loop` L (3, F), about those `axes` (3,) of the body that the vehicle can turn about."""
    nominal = loop(replace(model, effects=tuple(e for e in model.effects if e.name == ROTOR_INERTIA)))
    B = linear_matrix(model, [])
    inverse, own = np.linalg.pinv(B, rcond=RANK), np.diag(model.vehicle.body.inertia)
    drawn_loops = []
    for one in models:
        steady = [e for e in one.effects if e.effect.place != "air" and not e.effect.needs_voltage]
        gain = np.diag(linear_matrix(model, steady) @ inverse)[3:] * own / np.diag(one.body.inertia)
        drawn_loops.append(gain[:, None] * loop(replace(model, effects=tuple(one.effects))))
    loops, out = np.array(drawn_loops), []
    before = np.transpose(phase_and_gain_margins(nominal))
    for k in np.flatnonzero(axes & (np.diag(B @ inverse)[3:] > 0.5)):
        by_factor = [phase_and_gain_margins(factor * loops[:, k]) for factor in FACTORS]
        share = [float(np.mean((phase >= PHASE) & (gain >= GAIN))) for phase, gain in by_factor]
        helped = [float(f) for f, p in zip(FACTORS, share, strict=True) if p >= GO]
        half = float(np.mean((by_factor[0][0] >= 0.5 * PHASE) & (by_factor[0][1] >= 0.5 * GAIN)))
        phase, gain = (np.percentile(np.minimum(x, 1e3), WITHIN) for x in by_factor[0])
        sure = (min(share[0], DEFAULT.certain), min(half, DEFAULT.certain))
        out.append(LoopMargins(AXES[3 + k], before[k], phase, gain, *sure, helped[0] if helped else None))
    return tuple(out)
