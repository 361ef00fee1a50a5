"""What healthy flights differ by, as parameters: a battery that sits elsewhere, an IMU that was taken out and put back.

Where flights are excited, a centre of mass that lies 2 mm off is no constant torque, and no constant trim explains it:
it would be a change on every flight. So each flight f has, beside its trim, a deviation d_f of its own of the effects
that are never twice the same (`typical_of`), and the wind of its day, a force fixed in E:

    d_f ~ N(0, s_p^2),    s_p^2 = (sum_f (d_f^2 + var d_f) + WORTH t_p^2) / (F + WORTH)

for each parameter p, F the healthy flights, t_p the typical scatter; rotors, and servos, have one s for all of them.
Source: a random effect by flight (Pinheiro and Bates, "Mixed-Effects Models in S and S-PLUS", 2000, ch. 1), its
variance by expectation and maximisation (Dempster, Laird and Rubin, J. R. Stat. Soc. B 39, 1977) with a conjugate
prior. Where only means are compared, trims are all.

By how much they differ as a wrench, which a change has to exceed, is

    s^2 = (max(sum_f (m_f - m)^2 - (F - 1) n^2, 0) + WORTH t^2) / (F - 1 + WORTH)

m_f is what is left of flight f on average when all that is common to the flights is taken off, F the healthy flights,
n^2 the variance that such a mean has from what wanders within the flights: that is noise, which the likelihood has
already. t is the typical scatter (`learn.identify.bias_and_trim.typical_trim`), which is worth `WORTH` flights. One
healthy flight says nothing of its scatter: then t alone. Source: a random effect by flight (Pinheiro and Bates,
"Mixed-Effects Models in S and S-PLUS", 2000, ch. 1) with a conjugate prior of its variance.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array, Indices, Mask
from wrenchgap.learn.changed.linearised_effects import LinearisedEffect
from wrenchgap.learn.changed.priors import change_prior
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.identify.bias_and_trim import AIR, PLACE, ROTOR, WORTH
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.plant.effects import find
from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import GRAVITY, Vehicle

MOUNTING, SERVO = np.radians(0.15), np.radians(0.15)
"""Typical between flights: mounting of the IMU about each axis, zero of each servo [rad]: our estimates."""
BREEZE = 0.004
"""Typical between flights: force of the wind, relative to the weight: 0.4 m/s on rotors that drag 1 % per m/s."""
GUST = 1.0
"""Typical between flights: the wind in each level direction [m/s], where there is drag that sees it: light air."""
LEFT = 0.2
"""Share of typical trims that is left for what else differs: our estimate."""
WIND = "wind of the day"
DRAG_TORQUE = "drag torque of each rotor"
"""Beside its thrust: propellers of one make differ in both, and not by the same share."""
FAR = 5.0
"""Deviation that no flight has, in standard deviations."""


def typical_of(vehicle: Vehicle, name: str) -> float:
    """Standard deviation between flights of each parameter of an effect, in its unit; 0 for what stays as it is."""
    known = {
        "com_offset": PLACE * span(vehicle),
        "thrust_scale": AIR,
        "rotor_thrust": ROTOR,
        "imu_misalignment": MOUNTING,
        "tilt_offset": SERVO,
        DRAG_TORQUE: ROTOR,
        "wind": GUST,
        WIND: BREEZE * vehicle.body.mass * GRAVITY,
    }
    return float(known.get(name, 0.0))


@dataclass(frozen=True)
class Varying:
    """One thing that differs between flights: what it adds (K, 6, P), and its scatter (P,)."""

    name: str
    jacobian: Array
    scale: Array

    def column(self, rows: Mask, share: float = 1.0) -> Column:
        """On some rows, `share` of its scatter."""
        return Column.straight((), self.jacobian * rows[:, None, None], share * self.scale + 1e-12, FAR)


def varying(
    data: Dataset, model: Model, laws: Sequence[LinearisedEffect], scales: dict[str, Array]
) -> tuple[Varying, ...]:
    """What differs between flights of this data, with `scales` where these are known already, else typical ones."""
    out = []
    for one in laws:
        size = typical_of(model.vehicle, one.name)
        if size > 0.0:
            usual = np.full(len(find(one.name).parameters(model.vehicle)), size)
            out.append(Varying(one.name, one.line.jacobian, scales.get(one.name, usual)))
        if one.torque is not None:
            usual = np.full(one.torque.shape[2], typical_of(model.vehicle, DRAG_TORQUE))
            out.append(Varying(DRAG_TORQUE, one.torque, scales.get(DRAG_TORQUE, usual)))
    blown = Varying(WIND, blowing(data), scales.get(WIND, np.full(2, typical_of(model.vehicle, WIND))))
    return (*out, blown)


def seeming(name: str, jacobian: Array, scale: Array) -> Varying:
    """What a law (K, 6, P), typical sizes `scale` (P,), is off by on some flights more than on others."""
    prior = change_prior(name)
    return Varying(name, jacobian, prior.slack * prior.share * scale)


def blowing(data: Dataset) -> Array:
    """A level force fixed in E, as seen in B, per newton (K, 6, 2)."""
    quat = np.concatenate([r.state_kept.quat_EB for r in data.records])
    if not np.all(np.isfinite(quat)):  # no attitude, no wind that could be told
        return np.zeros((len(quat), 6, 2))
    from scipy.spatial.transform import Rotation  # here: others need not wait for it

    turned = Rotation.from_quat(quat, scalar_first=True).inv().as_matrix()
    out = np.zeros((len(quat), 6, 2))
    out[:, :3] = turned[:, :, :2]
    out[:, ~data.measured_axes] = 0.0
    return out


def columns(parts: Sequence[Varying], flight: Indices, suspects: Collection[int]) -> tuple[Column, ...]:
    """For every flight what it differs by; several suspects differ by some of it together, as on one day."""
    known = [v.column(flight == f) for f in range(int(flight.max()) + 1) for v in parts]
    if len(suspects) > 1:
        known += [v.column(np.isin(flight, list(suspects)), share_of_day(suspects)) for v in parts]
    return tuple(known)


def share_of_day(suspects: Collection[int]) -> float:
    """Of a scatter, that which several suspect flights have in common."""
    return float(np.sqrt(1.0 - 1.0 / len(suspects)))


def renewed(parts: Sequence[Varying], theta: Array, variance: Array, flights: int, model: Model) -> dict[str, Array]:
    """The scatter (P,) of each, from the deviations of the healthy flights (flights x all P,) and their variances."""
    square = (theta**2 + variance).reshape(flights, -1).sum(axis=0)
    out, at = {}, 0
    for v in parts:
        size = len(v.scale)
        usual, mine = typical_of(model.vehicle, v.name) ** 2, square[at : at + size]
        own = v.name in (WIND, DRAG_TORQUE)
        if v.name == DRAG_TORQUE or (not own and find(v.name).sparse):  # parts of one make: what one does, others may
            out[v.name] = np.full(size, np.sqrt((mine.sum() + WORTH * usual) / (size * flights + WORTH)))
        else:
            out[v.name] = np.sqrt((mine + WORTH * usual) / (flights + WORTH))
        at += size
    return out
