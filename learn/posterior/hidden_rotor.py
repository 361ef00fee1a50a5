"""Whether a calibrated model still shows a weak rotor that the model before it shows.

A calibration that is wrong (inputs that a log does not carry, say) can make up for damage that it has not seen, and
then nothing is found missing where a propeller is cut. So a loss of one rotor is added to the measured wrench of the
flights (`learn.posterior.injection`), and searched for with both models.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.candidates import candidates
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.timing import answering_axes, timing_of
from wrenchgap.learn.identify.calibrate import Calibration, Fate, HiddenRotor
from wrenchgap.learn.posterior.explain import Explanation, search_dataset
from wrenchgap.learn.posterior.injection import Injection, injection
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model

ROTOR = "rotor_thrust"
SHARE = 2.0
"""Of the smallest loss that would have been firm: twice of it is, whatever the noise. With half, the flights of
tests/independent/test_calibrate.py are judged alike; with double, the loss is so large (4 %) that the wrong model shows
it, too, and is not refused."""


def refused_where_hidden(found: Calibration, progress: Progress = silent) -> Calibration:
    """The calibration, or the model as it was where a weak rotor would not be found any more."""
    progress(0.95, "whether a weak rotor would still be found")
    hidden = None if found.added is None else hidden_rotor(found.flights, found.given, found.model)
    if hidden is None:
        return found
    tried = tuple(replace(t, fate=Fate.HIDES) if t.fate is Fate.KEPT else t for t in found.tried)
    return replace(
        found, added=None, tried=tried, trimmed=(), after=found.before, unseen=_as_before(found), hidden=hidden
    )


def _as_before(found: Calibration) -> tuple[tuple[str, Array, Array], ...]:
    return tuple((name, before, before) for name, before, _ in found.unseen)


def hidden_rotor(flights: Sequence[OpenFlight], before: Model, after: Model) -> HiddenRotor | None:
    """A loss of one rotor's thrust that flights show with the model `before` and not with `after`; None without one.

    Where the limit of what would be firm has grown beyond `SHARE` of itself, injections decide.
    """
    records = [r for f in flights for r in f.records]
    answering = answering_axes([timing_of(f, before) for f in flights])

    def search(model: Model, injected: Injection | None = None, limits_of: Sequence[str] = ()) -> Explanation:
        """Among a rotor's thrust and what it is confused with."""
        given = records if injected is None else injected.into(records, model)
        names = candidates(given, model, (ROTOR, *find(ROTOR).confused_with))
        return search_dataset(dataset(given, model, answering), model, names, limits_of=limits_of)

    limits = [one for one in search(before, limits_of=(ROTOR,)).limits if one.shown]
    if not limits:
        return None
    least = min(limits, key=lambda one: abs(one.size))
    still = {one.parameter: abs(one.size) for one in search(after, limits_of=(ROTOR,)).limits if one.shown}
    if still.get(least.parameter, np.inf) <= SHARE * abs(least.size):
        return None
    firm = [ROTOR in search(model, injection(least, SHARE, model)).firm for model in (before, after)]
    return HiddenRotor(least.parameter, SHARE * least.size) if firm == [True, False] else None
