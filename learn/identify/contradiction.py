"""What flights show against a model that a flight to come depends on: commands that come later, thrusts that are gone.

Both are fitted to the flights beside what the model has, with the thrust of all rotors, which a wrong mass or a battery
would make. A change counts where it is clear and large enough to matter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from wrenchgap.flight.errors import FitError
from wrenchgap.learn.data.candidates import inapplicable
from wrenchgap.learn.data.dataset import dataset, latest, spread_out
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.timing import answering_axes, timing_of
from wrenchgap.learn.identify.fit import fit
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model

DELAY, ROTORS, ALL = "command_delay", "rotor_thrust", "thrust_scale"


@dataclass(frozen=True)
class Contradiction:
    """A `parameter` of an effect that flights show to be another than in the model, by `change` +- `std` in `unit`."""

    effect: str
    parameter: str
    change: float
    std: float
    unit: str


def as_flown(
    flights: Sequence[OpenFlight],
    model: Model,
    *,
    late: float = 0.01,
    weak: float = 0.1,
    clear: float = 3.0,
    seconds: float = 120.0,
    recent: float = 10.0,
) -> tuple[Model, tuple[Contradiction, ...]]:
    """The model with a delay and thrusts of rotors as these flights show them, and where that contradicts it.

    From a delay that is `late` [s] on, a tenth of a good phase margin (60 deg) at a crossover of 10 rad/s; from a rotor
    on that is `weak` by this share of its thrust, three times what sound propellers differ by; and `clear` standard
    deviations. The last `recent` seconds count first, as the vehicle ended, so it flies again; then all of it, of
    longer logs in pieces of so many `seconds` together.
    """
    records = tuple(r for f in flights for r in f.records)
    names = [name for name in (DELAY, ALL, ROTORS) if not inapplicable(name, model, records)]
    if not names or any(inapplicable(e.name, model, records) for e in model.effects):  # what it has is not to be tested
        return model, ()
    answering = answering_axes([timing_of(f, model) for f in flights])
    for some in (latest(records, recent), spread_out(records, seconds)):
        try:
            found = fit(dataset(some, model, answering), model, names)
        except FitError:  # too short, or too calm, to contradict anything
            continue
        wrong, least = [], {DELAY: late, ROTORS: weak}
        for (effect, parameter), value, std in zip(found.parameters, found.theta, found.std, strict=True):
            at = [p.name for p in find(effect).parameters(model.vehicle)].index(parameter.name)
            change = float(value - model.theta(effect)[at])
            worse = change if effect == DELAY else -change
            if effect in least and worse > max(least[effect], clear * float(std)):
                wrong.append(Contradiction(effect, parameter.name, change, float(std), parameter.unit))
        if wrong:
            replaced = {one.effect for one in wrong}
            return model.with_replaced(e for e in found.effects if e.name in replaced), tuple(wrong)
    return model, ()
