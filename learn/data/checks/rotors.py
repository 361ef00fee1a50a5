"""Order and spin of the rotors and the sign of tilt: what the model makes of the logged actuators, against a witness.

The witness is the commanded wrench where it is logged: the allocation makes it of these very actuators, so that nothing
but the model stands between them. Else it is the motion above `COMPARED.fast_hz`, where torques turn the vehicle;
below, commands answer what disturbs it, and the rotors of a hover make torques that the motion does not show at all.

Where the motion does not decide, as in a hover, the feedback does: a stabilising loop commands each torque against the
rate about its own axis, so that minus the torque and the rate are correlated on all three. Of another order, by which
columns are exchanged, torques are mixed and the correlation is smaller.

The order is found from how the witness goes with each column of the log: with T (K, R) the thrusts of the columns and W
(K, 4) force along z and torques, W = T B has the least-squares solution of smallest norm B (R, 4), and row j is what
column j does. Rotor i of the model does b_i; the assignment of columns to rotors that maximises the sum of correlations
is found in polynomial time (Kuhn 1955; `scipy.optimize.linear_sum_assignment`).
"""

import itertools
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.motion import cosine
from wrenchgap.flight.checks.remedies import option
from wrenchgap.flight.flight import GRAVITY, Array, Flight
from wrenchgap.learn.data.checks.commands_and_motion import CommandsAndMotion, at_lags, compared, moving
from wrenchgap.learn.data.checks.torques import TORQUES, Turned
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.controller import pushes_along_z_only
from wrenchgap.plant.model import Model
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import about_com


@dataclass(frozen=True)
class RotorThresholds:
    """From when on another order, spin or tilt of the rotors is the likely one."""

    fits: float = 0.8
    """Cosine with the witness that another reading must reach. With the motion, in which there is more than the rotors
    made, it is `TORQUES.moves`: real hovers have 0.66 to 0.89."""
    better: float = 0.25
    """By how much its cosine must exceed that of the reading as stated."""
    commanded: float = 1e-5
    """Torque [m], over the weight, below which none is commanded: 1 % of the weight at 1 mm."""
    against: float = 0.5
    """Cosine with the motion about z from which on an opposite torque is worth a word."""
    same: float = 0.97
    """Cosine with a commanded wrench above which the stated order is it."""
    exact: float = 0.99
    """Cosine above which another order is."""
    clear: float = 0.9
    """Cosine with the motion that an order must reach to be better than one that is like it too."""
    left: float = 1.0 / 3.0
    """Share of what that left unexplained, at most."""
    feedback: float = 0.3
    """Correlation of minus the commanded torque with the body rate, mean of the axes, that another order must reach."""
    feedback_better: float = 0.15
    """By how much it must exceed that of the order as stated. Of 65 recorded flights the stated order is the best of 24
    on 64, by 0.01 to 0.41, and behind by 0.06 on one. Both halves of a flight must show it: of 36 exchanges of two
    columns 33 do, and of 131 sound ones, 66 of them simulated, none."""
    seen: float = 1e-3
    """Of the largest: singular values of thrusts below it tell nothing."""


ROTORS = RotorThresholds()


TURN = "turn every spin over"


def rotors(flight: Flight, model: Model, seen: CommandsAndMotion, turned: Turned | None = None) -> Iterator[Check]:
    """Whether another order, spin or sign of tilt explains the witness, and the stated one does not.

    `turned`: an IMU that is turned explains it, and is said where no order does as well.
    """
    if seen.made is None or seen.speed is None or seen.tilt is None:
        return
    name, fits = ("the commanded wrench", ROTORS.fits) if seen.wrench is not None else ("the motion", TORQUES.moves)
    scale = _scale(model.vehicle, seen)
    if seen.wrench is not None and np.all(scale < ROTORS.commanded * model.vehicle.body.mass * GRAVITY):
        return  # no torque is commanded: what is left is how the log rounds
    stated = _alike(seen, seen.made, scale)
    if turned is not None and stated > fits:
        yield turned.check
        return
    if stated > fits and not _reordered(model.vehicle, seen, scale, stated):
        unclear = seen.wrench is None and stated < ROTORS.clear
        if unclear and (other := list(_order_by_feedback(flight, model.vehicle, seen))):
            yield from other
            return
        yield Check("rotors", "ok", f"The logged actuators make torques like {name} (cosine {stated:.2f}).")
        yield from _yaw(seen, name)
        return
    order, readings = _readings(model.vehicle, seen, scale)
    found = {what: _alike(seen, made, scale) for what, made in readings.items()}
    what = max(("spin", "tilt", "order"), key=lambda k: found[k])
    if _explained(found[what], found["order and spin"]):  # two mistakes only where they say much more than one
        what = "order and spin"
    if turned is not None and _explained(found[what], turned.whole):
        yield turned.check
        return
    if found[what] < fits or not (found[what] > stated + ROTORS.better or _explained(stated, found[what])):
        words = f"The logged actuators make torques unlike {name} (cosine {stated:.2f})"
        if seen.wrench is not None:
            yield Check("rotors", "warn", f"{words}: check order, spin, c_f and tilt signs, or saturation.")
        else:
            yield from _order_by_feedback(flight, model.vehicle, seen)
        return
    words = f"The logged actuators make torques like {name} by a cosine of {stated:.2f}, with "
    if what == "spin":
        words += f"the drag torque of every rotor the other way by {found[what]:.2f}"
        yield Check("rotors", "bad", f"{words}: {TURN} in the model file")
    elif what == "tilt":
        words += f"the sign of tilt turned by {found[what]:.2f}"
        yield Check("rotors", "bad", words, option(flight, "*-1", "tilt"))
    elif what == "order and spin":
        words += f"the rotors in another order and every spin turned over by {found[what]:.2f}"
        yield Check("rotors", "bad", f"{words}: correct the places of the rotors in the model file")
    else:
        words += f"the columns of the rotor speeds in the order {', '.join(map(str, order))} by {found[what]:.2f}"
        words += "" if seen.wrench is not None else ", unless it is the IMU that is turned about z"
        yield Check("rotors", "bad", words, _columns(flight, [int(k) for k in order]))


def _readings(vehicle: Vehicle, seen: CommandsAndMotion, scale: Array) -> tuple[NDArray[np.intp], dict[str, Array]]:
    """The likeliest order of the columns, and the wrenches (N, 6) by what may be wrong with the model."""
    assert seen.tilt is not None
    assert seen.speed is not None
    _, known = vehicle.geometry()
    backwards = replace(vehicle, rotors=replace(known, spin=-known.spin))
    order = _order(vehicle, seen, scale)
    return order, {
        "spin": _made(backwards, seen, seen.tilt, seen.speed),
        "tilt": _made(vehicle, seen, -seen.tilt, seen.speed),
        "order": _made(vehicle, seen, seen.tilt, seen.speed[:, order]),
        "order and spin": _made(backwards, seen, seen.tilt, seen.speed[:, _order(backwards, seen, scale)]),
    }


def _order_by_feedback(flight: Flight, vehicle: Vehicle, seen: CommandsAndMotion) -> Iterator[Check]:
    """Another order by the feedback of the attitude loop, which a hover shows as well (see above)."""
    assert seen.speed is not None
    count = seen.speed.shape[1]
    if not pushes_along_z_only(vehicle) or count < 3:
        return
    same = np.arange(count)
    orders = [np.array(order) for order in itertools.permutations(same)] if count == 4 else _usual(count)
    halves = FeedbackCorrelation.halves(vehicle, seen)
    order = max(orders, key=lambda one: sum(half.mean(one) for half in halves))
    stated, best = (np.array([half.mean(one) for half in halves]) for one in (same, order))
    if np.any(best < ROTORS.feedback) or np.any(best - stated < ROTORS.feedback_better):
        return
    words = f"Torques are commanded against the body rate with a mean correlation of {stated.mean():.2f}, and of "
    words += f"{best.mean():.2f} with the columns of the rotor speeds in the order {', '.join(map(str, order))}"
    yield Check("rotors", "bad", words, _columns(flight, [int(k) for k in order]))


@dataclass(frozen=True)
class FeedbackCorrelation:
    """What thrusts of R columns and body rates have in common, at each of the lags that are tried.

    `torque` (R, 3) is what a unit of thrust of each rotor makes; of the thrusts `own` (R, R) and, for each lag, `cross`
    (R, 3) with the rates and the rates' `size` (3,).
    """

    torque: Array
    own: Array
    lags: tuple[tuple[Array, Array], ...]

    @classmethod
    def halves(cls, vehicle: Vehicle, seen: CommandsAndMotion) -> list["FeedbackCorrelation"]:
        """Of the first and the last half of a flight, in which chance does not repeat."""
        assert seen.speed is not None
        count = seen.speed.shape[1]
        unit = Commands(np.zeros((count, 6)), np.zeros((count, len(vehicle.geometry()[0].tilts))), np.eye(count))
        torque = about_com(vehicle.body, nominal_wrench(vehicle, unit))[:, 3:]
        squares = moving(seen, compared(seen.speed**2, seen.dt), fast=True)
        rates = at_lags(seen, seen.omega, fast=True)
        middle = len(squares) // 2
        return [
            cls(torque, s.T @ s, tuple((s.T @ w[rows], np.sum(w[rows] ** 2, axis=0)) for w in rates))
            for rows in (slice(middle), slice(middle, None))
            for s in [squares[rows]]
        ]

    def mean(self, order: NDArray[np.intp]) -> float:
        """Mean over the axes of the correlation between minus the torque and the rate, columns in this order."""
        own = np.einsum("ri,rs,si->i", self.torque, self.own[np.ix_(order, order)], self.torque)
        found = [
            -np.einsum("ri,ri->i", self.torque, cross[order]) / np.sqrt(np.maximum(own * size, 1e-300))
            for cross, size in self.lags
        ]
        return float(max(np.mean(one) for one in found))


def _columns(flight: Flight, order: list[int]) -> str:
    """The mapping with the columns in another order."""
    source = flight.mapping.get("rotor_speed", "/topic")
    head, bracket, rest = source.partition("[")
    if bracket:
        text, _, tail = rest.partition("]")
        present = [int(k) for k in text.split(",") if k.strip().isdecimal()]
        order = [present[k] for k in order] if len(present) == len(order) else order
    else:
        cut = min((head.index(mark) for mark in "*:" if mark in head), default=len(head))
        head, tail = head[:cut], head[cut:]
    listed = ",".join(map(str, order))
    return f"--topic {shlex.quote(f'rotor_speed={head}[{listed}]{tail}')}"


def _yaw(seen: CommandsAndMotion, name: str) -> Iterator[Check]:
    """Spins: the torque about z alone, of vehicles whose rotors make it by drag."""
    assert seen.made is not None
    fast = seen.wrench is None
    truth = moving(seen, seen.witness, fast=fast)[:, [5]]
    alike = max((cosine(truth, made[:, [5]]) for made in at_lags(seen, seen.made, fast=fast)), key=abs)
    if alike < -(ROTORS.against if fast else ROTORS.fits):
        words = f"The logged actuators make a torque about z opposite to {name} (cosine {alike:.2f})"
        yield Check("rotors", "bad" if alike < -ROTORS.fits else "warn", f"{words}: {TURN} in the model file")


def _reordered(vehicle: Vehicle, seen: CommandsAndMotion, scale: Array, stated: float) -> bool:
    """Whether a witness like the rotors' is that of another order, and clearly: six rotors hide two, twelve one."""
    if stated > (ROTORS.same if seen.wrench is not None else ROTORS.clear):
        return False
    assert seen.speed is not None
    assert seen.tilt is not None
    found = _alike(seen, _made(vehicle, seen, seen.tilt, seen.speed[:, _order(vehicle, seen, scale)]), scale)
    return found > ROTORS.exact if seen.wrench is not None else found > ROTORS.clear and _explained(stated, found)


def _explained(stated: float, found: float) -> bool:
    """Whether a cosine `found` leaves less than a third of the energy that the `stated` one leaves unexplained."""
    return 1.0 - found**2 < ROTORS.left * (1.0 - stated**2)


def _scale(vehicle: Vehicle, seen: CommandsAndMotion) -> Array:
    """Torques by which axes are made comparable: the inertia for the motion, the witness's own for a wrench."""
    if seen.wrench is None:
        return np.asarray(np.diag(vehicle.body.inertia))
    return np.asarray(np.maximum(np.std(moving(seen, seen.wrench[:, 3:]), axis=0), 1e-9))


def _alike(seen: CommandsAndMotion, made: Array, scale: Array) -> float:
    """Cosine of torques made with those of the witness, at the likeliest lag."""
    fast = seen.wrench is None
    truth = moving(seen, seen.witness[:, 3:], fast=fast) / scale
    tried = at_lags(seen, made[:, 3:], fast=True) if fast else [moving(seen, made[:, 3:])]
    return max(cosine(truth, torque / scale) for torque in tried)


def _made(vehicle: Vehicle, seen: CommandsAndMotion, tilt: Array, speed: Array) -> Array:
    """The wrench (N, 6) of other actuators, filtered as the rest."""
    wrench = about_com(vehicle.body, nominal_wrench(vehicle, Commands(np.zeros((len(speed), 6)), tilt, speed)))
    return compared(wrench, seen.dt)


def _order(vehicle: Vehicle, seen: CommandsAndMotion, scale: Array) -> NDArray[np.intp]:
    """Column of the log for each rotor (R,): the likeliest of the assignment and of what people do."""
    assert seen.tilt is not None
    assert seen.speed is not None
    tried = [*_usual(seen.speed.shape[1]), _assigned(vehicle, seen)]
    alike = [_alike(seen, _made(vehicle, seen, seen.tilt, seen.speed[:, order]), scale) for order in tried]
    return tried[int(np.argmax(np.round(alike, 3)))]


def _usual(count: int) -> list[NDArray[np.intp]]:
    """Orders in which rotors are counted: from another one on, backwards, upper before lower ones, and lower first.

    The assignment knows what a rotor does at zero tilt; on arms that tilt far it may miss these.
    """
    plain: NDArray[np.intp] = np.arange(count)
    layers = [plain.reshape(2, -1).T.ravel(), plain.reshape(-1, 2).T.ravel()] if count % 2 == 0 else []
    pairs = [plain.reshape(-1, 2)[:, ::-1].ravel()] if count % 2 == 0 else []
    return [*(np.roll(plain, k) for k in range(1, count)), plain[::-1], *layers, *pairs]


def _assigned(vehicle: Vehicle, seen: CommandsAndMotion) -> NDArray[np.intp]:
    """Column of the log for each rotor (R,), by what each of both does."""
    from scipy.optimize import linear_sum_assignment  # here: others need not wait for it

    arms, known = vehicle.geometry()
    assert seen.speed is not None
    fast, axes = seen.wrench is None, [2, 3, 4, 5]
    alone = Commands(np.zeros((len(known), 6)), np.zeros((len(known), len(arms))), np.diag(1.0 / np.sqrt(known.c_f)))
    effect = about_com(vehicle.body, nominal_wrench(vehicle, alone))[:, axes]  # of a newton of each rotor
    target = moving(seen, seen.witness[:, axes], fast=fast)
    size = np.maximum(np.std(target, axis=0), 1e-12)
    thrust = compared(known.c_f.mean() * seen.speed**2, seen.dt)
    found: list[tuple[float, NDArray[np.intp]]] = []
    for pushed in at_lags(seen, thrust, fast=True) if fast else [moving(seen, thrust)]:
        solved = np.linalg.pinv(pushed, rcond=ROTORS.seen) @ target
        likeness = _normalised(effect / size) @ _normalised(solved / size).T
        rows, columns = linear_sum_assignment(-likeness)
        found.append((float(likeness[rows, columns].sum()), columns))
    return max(found, key=lambda one: one[0])[1]


def _normalised(rows: Array) -> Array:
    centred = rows - rows.mean(axis=0)
    return np.asarray(centred / np.maximum(np.linalg.norm(centred, axis=1, keepdims=True), 1e-30))
