"""What flights show against a model that a flight to come depends on: late commands, thrusts that are gone, a trim.

They are fitted to the flights beside what the model has, with the thrust of all rotors, which a wrong mass or a battery
would make. A change counts where it is clear and large enough to matter. Near hover a weak rotor and a constant torque,
of a centre of mass say, leave the same: rotors are said to be weaker only where that fits better.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import GRAVITY
from wrenchgap.learn.data.candidates import inapplicable
from wrenchgap.learn.data.dataset import dataset, latest, spread_out
from wrenchgap.learn.data.errors import energy
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.timing import answering_axes, timing_of
from wrenchgap.learn.identify.bias_and_trim import trim_of, typical_trim
from wrenchgap.learn.identify.fit import Fit, fit
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model

DELAY, ROTORS, ALL = "command_delay", "rotor_thrust", "thrust_scale"
PLACE, CONSTANT = "com_offset", "constant_wrench"
ABOUT_LEVEL = {3, 4}
"""Axes on which the attitude loops turn the vehicle."""


@dataclass(frozen=True)
class Contradiction:
    """A `parameter` of an effect that flights show to be another than in the model, by `change` +- `std` in `unit`."""

    effect: str
    parameter: str
    change: float
    std: float
    unit: str


@dataclass(frozen=True)
class ContradictionThresholds:
    """From when on flights contradict a model."""

    late: float = 0.01
    """Delay [s]: a tenth of a good phase margin (60 deg) at a crossover of 10 rad/s."""
    weak: float = 0.1
    """Share of a rotor's thrust that is gone: three times what sound propellers differ by."""
    beyond: float = 2.0
    """Times its tolerance by which the thrust of all rotors must be less, where the model knows it no better."""
    trims: float = 3.0
    """A constant torque, or its lever arm, in standard deviations of what flights of such vehicles differ by."""
    clear: float = 3.0
    """Standard deviations of the fit."""
    better: float = 0.9
    """Error energy that weaker rotors leave, at most, of what a constant cause leaves in their place: 0.07 to 0.64 with
    a weak rotor, 0.98 to 1 without on 22 flights, 0.93 of two hovers with a cut propeller. 0.8 says the same."""
    seconds: float = 120.0
    """Of longer logs, pieces of so many seconds together."""
    recent: float = 10.0
    """The last seconds, which count first: as the vehicle ended, so it flies again."""


THRESHOLDS = ContradictionThresholds()


def as_flown(flights: Sequence[OpenFlight], model: Model) -> tuple[Model, tuple[Contradiction, ...]]:
    """The model with what these flights show of delay, thrusts and trim, and where that contradicts it."""
    records = tuple(r for f in flights for r in f.records)
    answering = answering_axes([timing_of(f, model) for f in flights])
    both = [ALL] if set(answering) >= ABOUT_LEVEL else [DELAY, ALL]  # else a delay is the phase of the controller
    names = [name for name in both if not inapplicable(name, model, records)]
    either = [name for name in (ROTORS, PLACE, CONSTANT) if not inapplicable(name, model, records)]
    untested = any(inapplicable(e.name, model, records) for e in model.effects)  # of what the model has
    if not either or untested:
        return model, ()
    for some in (latest(records, THRESHOLDS.recent), spread_out(records, THRESHOLDS.seconds)):
        data = dataset(some, model, answering)
        try:
            fits = [fit(data, model, [*names, name]) for name in either]
        except FitError:  # too short, or too calm, to contradict anything
            continue
        left = [energy(found.residual, data.weights) for found in fits]
        if either[0] == ROTORS:
            left[0] /= THRESHOLDS.better
        found = fits[int(np.argmin(left))]
        if wrong := _contradictions(found, model):
            replaced = {one.effect for one in wrong}
            return model.with_replaced(e for e in found.effects if e.name in replaced), wrong
    return model, ()


def _contradictions(found: Fit, model: Model) -> tuple[Contradiction, ...]:
    trim, usual_torque = trim_of(model), typical_trim(model)
    usual_torque[trim.axes] = np.maximum(usual_torque[trim.axes], trim.scale * trim.unit)  # what the model grants
    torque = usual_torque[3:]
    lever = float(torque[0]) / (model.vehicle.body.mass * GRAVITY)
    usual = dict(zip(("torque_x", "torque_y", "torque_z"), torque, strict=True)) | {"x": lever, "y": lever}
    out = []
    for (effect, parameter), value, std in zip(found.parameters, found.theta, found.std, strict=True):
        at = [p.name for p in find(effect).parameters(model.vehicle)].index(parameter.name)
        change = float(value - model.theta(effect)[at])
        worse, least = {
            DELAY: (change, THRESHOLDS.late),
            ALL: (-change, max(THRESHOLDS.weak, THRESHOLDS.beyond * (model.vehicle.tolerances.thrust or 0.0))),
            ROTORS: (-change, THRESHOLDS.weak),
        }.get(effect, (abs(change), THRESHOLDS.trims * usual.get(parameter.name, np.inf)))
        if worse > max(least, THRESHOLDS.clear * float(std)):
            out.append(Contradiction(effect, parameter.name, change, float(std), parameter.unit))
    return tuple(out)
