"""What a flight as a whole may be off by, whatever effects there are: its accelerometer's bias, and its trim.

No two flights of a vehicle are trimmed alike: a battery goes in a little further aft, a propeller has been nicked, the
air is thinner. The wrench that is left on average therefore differs from flight to flight by more than the flights'
own noise. `between_flights` measures by how much; a model file keeps it (`plant.model.Model.between_flights`), and
every fit and search then grants each flight a wrench of that size, constant in B: a later flight that differs no more
than the earlier ones did among themselves shows nothing. Source: a random effect by flight, Pinheiro and Bates,
"Mixed-Effects Models in S and S-PLUS", 2000, ch. 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import AXES, Array, Indices
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.data.dataset import Dataset, length_scale
from wrenchgap.learn.data.errors import means_by
from wrenchgap.learn.data.measurement import Record
from wrenchgap.plant.history import Value
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import GRAVITY

ACCELEROMETER_BIAS = 0.05
"""Largest bias of an accelerometer that is taken to be the sensor's own, per axis [m/s^2] (5 mg)."""


WORTH = 2.0
"""Flights that the typical values are worth, where few flights say how much they differ."""
ROTOR, PLACE, AIR = 0.01, 0.02, 0.015
"""Typical between flights: thrust of one rotor, relative to it; place of the centre of mass, relative to the radius of
the circle on which the rotors are; thrust of all rotors (battery, density), relative to the weight."""


@dataclass(frozen=True)
class Trim:
    """Unknowns of every flight: one for each of `axes` (A,) of the wrench, `unit` (A,) N or Nm each.

    `scale` (A,) are their standard deviations, `limit` (A,) what they stay below.
    """

    axes: Indices
    unit: Array
    scale: Array
    limit: Array

    def columns(self, data: Dataset) -> Array:
        """Derivatives (K, 6, flights x A) of the measured wrench, by flight; zero on axes that were not measured."""
        size = len(self.axes)
        out = np.zeros((len(data.flight), 6, size * (int(data.flight.max()) + 1)))
        rows = np.arange(len(data.flight))
        for k, axis in enumerate(self.axes):
            if data.measured_axes[axis]:
                out[rows, axis, size * data.flight + k] = self.unit[k]
        return out


def trim_of(model: Model, far: float = 5.0) -> Trim:
    """Of flights of this model's vehicle: force as an acceleration [m/s^2], and torque [Nm] where flights differ or
    rotors' axes are unsure. No flight is beyond `far` standard deviations of that.
    """  # noqa: D205
    mass = model.vehicle.body.mass
    scatter = np.zeros(6) if model.between_flights is None else np.array(model.between_flights)
    scatter[5] = np.hypot(scatter[5], twist_of_axes(model))
    bias = np.full(3, ACCELEROMETER_BIAS)
    turned = 3 + np.flatnonzero(scatter[3:] > 0.0)
    return Trim(
        np.concatenate((np.arange(3), turned)),
        np.concatenate((np.full(3, mass), np.ones(len(turned)))),
        np.concatenate((np.hypot(0.5 * bias, scatter[:3] / mass), scatter[turned])),
        np.concatenate((bias + far * scatter[:3] / mass, far * scatter[turned])),
    )


def twist_of_axes(model: Model) -> float:
    """Standard deviation [Nm] of the torque about z of rotors whose thrust axes are off by the model's tolerance, each
    by itself: in hover delta r m g / sqrt(n).
    """  # noqa: D205
    vehicle = model.vehicle
    if not vehicle.tolerances.thrust_axis or vehicle.arms is None or vehicle.rotors is None:
        return 0.0
    radius = float(np.median(np.linalg.norm(vehicle.arms.position_B[:, :2], axis=1)))
    weight = vehicle.body.mass * GRAVITY
    return vehicle.tolerances.thrust_axis * radius * weight / float(np.sqrt(len(vehicle.rotors)))


def unsure_thrust(model: Model, names: Sequence[str] = ()) -> float:
    """Standard deviation of the thrust of all rotors, relative to it, where the model file gives one and no flight has
    told better: neither the model nor `names` have thrust_scale.
    """  # noqa: D205
    named = "thrust_scale" in (*names, *(e.name for e in model.effects))
    return 0.0 if named else model.vehicle.tolerances.thrust or 0.0


def mean_force_error(records: Sequence[Record]) -> float | None:
    """The mean measured force along the mean commanded one, both in B, over the size of that, less one; None where no
    flight measured F_z. Below zero the rotors make less than they are asked for, or the vehicle is heavier.

    Of means: changes of the force that come late, or of commands that are logged slowly, are no scale.
    """  # noqa: D205
    seen = [r for r in records if r.measured_axes[2]]
    if not seen:
        return None
    measured, commanded = (
        np.nan_to_num(np.concatenate([getattr(r, name)[:, :3] for r in seen]).mean(axis=0))
        for name in ("measured", "commanded")
    )
    return float(measured @ commanded / (commanded @ commanded)) - 1.0


def with_thrust_as_given(model: Model) -> Model:
    """The model, sure of its thrust: values that are written beside that thrust have to hold with it.

    A fit that is granted another thrust, which is then not written, leaves its counterpart in the effects: of a hover
    whose commands vary little, a constant force of the opposite sign.
    """
    known = replace(model.vehicle.tolerances, thrust=None)
    return replace(model, vehicle=replace(model.vehicle, tolerances=known))


def typical_trim(model: Model) -> Array:
    """Standard deviation (6,) [N, Nm] of the trim between flights of vehicles like this, where nothing better is known.

    A centre of mass that is `PLACE` off in both directions, every rotor `ROTOR` off by itself, the air and the battery
    `AIR`; forces across thrust as from thrust axes half a degree off.
    """
    vehicle = model.vehicle
    weight = vehicle.body.mass * GRAVITY
    radius, kappa, share = length_scale(model), 0.05 * length_scale(model), 0.5
    if vehicle.arms is not None and vehicle.rotors is not None:
        radius = float(np.median(np.linalg.norm(vehicle.arms.position_B[:, :2], axis=1)))
        kappa = float(np.median(np.abs(vehicle.rotors.kappa)))
        share = 1.0 / np.sqrt(len(vehicle.rotors))
    across = np.radians(0.5) * weight
    tilting = np.hypot(PLACE, ROTOR * share / np.sqrt(2.0)) * radius * weight
    return np.array([across, across, AIR * weight, tilting, tilting, ROTOR * share * kappa * weight])


def between_flights(data: Dataset, left: Array, model: Model, different: float = 4.0) -> Array | None:
    """Standard deviation (6,) of what a model leaves (K, 6) on average of a flight; None where flights do not differ.

    They do where the mean square of their differences is `different` times that which their blocks of time make likely:
    all six axes together stay below it with 99.9 % where nothing but noise differs.
    """
    count = int(data.flight.max()) + 1
    if count < 2:
        return None
    means, noise = means_of_flights(data, left)
    known = data.measured_axes
    if float(np.mean(means.var(axis=0, ddof=1)[known] / np.maximum(noise[known], 1e-30))) < different:
        return None
    return np.where(known, scatter_between(means, typical_trim(model)) * np.sqrt(1.0 + 1.0 / count), 0.0)


def scatter_between(means: Array, usual: Array, noise: Array | float = 0.0) -> Array:
    """Standard deviation (6,) [N, Nm] between flights, of their means (F, 6), which have the variance `noise` (6,)
    themselves; `usual` (6,) is the typical one.
    """  # noqa: D205
    count = len(means)
    spread = np.sum((means - means.mean(axis=0)) ** 2, axis=0)
    more = np.maximum(spread - (count - 1) * np.asarray(noise), 0.0)
    return np.asarray(np.sqrt((more + WORTH * usual**2) / (count - 1 + WORTH)))


@dataclass(frozen=True)
class FlightsApart:
    """What is left on average of each flight (n,) [N or Nm] on one `axis`, where flights do not agree."""

    axis: int
    names: tuple[str, ...]
    means: Array


def flights_apart(
    data: Dataset, left: Array, model: Model, different: float = 5.0, usual: float = 3.0
) -> tuple[FlightsApart, ...]:
    """Axes on which what a model leaves (K, 6) differs between flights by far more than noise, the farthest first.

    By `different` times what their blocks of time make likely and `usual` times what flights of one vehicle differ by:
    as the model says, or as is typical. No one number is the constant of these flights.
    """
    if int(data.flight.max()) < 1:
        return ()
    means, noise = means_of_flights(data, left)
    typical = typical_trim(model) if model.between_flights is None else np.array(model.between_flights)
    apart = np.std(means, axis=0, ddof=1) / np.maximum(np.maximum(different * np.sqrt(noise), usual * typical), 1e-30)
    names = tuple(dict.fromkeys(r.flight for r in data.records))
    axes = [int(k) for k in np.argsort(-apart) if data.measured_axes[k] and apart[k] > 1.0]
    return tuple(FlightsApart(k, names, means[:, k]) for k in axes)


@dataclass(frozen=True)
class GrantedTrim:
    """What is left on average of all flights, `mean` [N or Nm] on one `axis`, that is taken for their trim; `ratio` to
    one standard deviation of what the model says that flights differ by, or its thrust axes make.
    """  # noqa: D205

    axis: int
    mean: float
    ratio: float


def granted_trims(
    data: Dataset, left: Array, given: Array, model: Model, different: float = 5.0, unusual: float = 2.0
) -> tuple[GrantedTrim, ...]:
    """What flights share of what a model leaves (K, 6) that its scatter between flights, or thrust axes that it is not
    sure of, would make, the most unusual first.

    A mean that is `different` times its noise, and beyond what one flight in twenty differs by: `unusual` standard
    deviations of the mean of so many. Every fit grants it, so no effect has to explain it; it is there nevertheless.
    Where the model as `given` does not leave that much (K, 6), it is what the fit has brought in, and not there.
    """  # noqa: D205
    trim, usual = trim_of(model), np.full(6, np.inf)
    usual[trim.axes] = trim.scale * trim.unit
    if model.between_flights is None:  # an accelerometer's bias is the sensor's, and no trim
        usual[:3] = np.inf
    means, noise = means_of_flights(data, left)
    mean, root = means.mean(axis=0), np.sqrt(len(means))
    clear = data.measured_axes & (np.abs(mean) * root > np.maximum(different * np.sqrt(noise), unusual * usual))
    clear &= np.abs(means_of_flights(data, given)[0].mean(axis=0)) * root > unusual * usual
    order = np.argsort(-np.abs(mean) / usual)
    return tuple(GrantedTrim(int(k), float(mean[k]), float(abs(mean[k]) / usual[k])) for k in order if clear[k])


def unclear_constant(values: Sequence[Value]) -> Array:
    """Of a constant wrench that was fitted (6,), the components that are within chance: a trim that is granted too has
    the rest of each, and neither is beyond its error by itself.
    """  # noqa: D205
    by = {v.name: v for v in values}
    unclear = [name in by and abs(by[name].value) <= SIGNIFICANCE.alone * (by[name].std or 0.0) for name in AXES]
    return np.array([by[name].value if keep else 0.0 for name, keep in zip(AXES, unclear, strict=True)])


def means_of_flights(data: Dataset, left: Array) -> tuple[Array, Array]:
    """Means (F, 6) over the blocks of time of each flight, of what is left (K, 6), and the variance (6,) that such a
    mean has from what wanders within a flight: the mean over flights.
    """  # noqa: D205
    blocks, flight = means_by(data.block, left), data.flight[np.unique(data.block, return_index=True)[1]]
    each = [blocks[flight == f] for f in range(int(flight.max()) + 1)]
    variances = [own.var(axis=0) / max(len(own) - 1, 1) for own in each]
    return np.array([own.mean(axis=0) for own in each]), np.mean(variances, axis=0)
