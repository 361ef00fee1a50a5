"""Open-loop prediction: from the recorded state at a sample, what the logged commands make of it.

The usual figure of vehicle identification: Newton and Euler are integrated from every start at once, with commands as
logged and nothing corrected on the way, and the state at each horizon is compared with the recorded one: lengths of
the errors of position, velocity, angle of the turn between the attitudes, body rates. A model is worth something
beside "constant velocity", the motion that goes on with the velocity and the body rate of its start.

States are those of `learn.data.recording`: odometry and IMU made one smooth motion, up to `CUTOFF_HZ`. Effects on
sensors do not act: the motion is taken as it was reported.

How far a prediction may be off follows from two things. What the model leaves of the recorded motion as a wrench is
put into predictions at other times of these flights (a block bootstrap: its spectrum, its size and its mean are those
that the vehicle meets), and the model's values are drawn with their standard deviations.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import LogError, ModelError, UsageError, so3
from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.flight import Array
from wrenchgap.flight.result import Result
from wrenchgap.flight.stamps import interpolated
from wrenchgap.learn import GaussianProcess, OpenFlight
from wrenchgap.learn.data.measurement import Record, commands_of
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.learn.data.recording import CUTOFF_HZ, recorded_motion, samples_over_periods
from wrenchgap.learn.process.predictors import predictors
from wrenchgap.plant import Model, Vehicle
from wrenchgap.plant.effect_values import drawn
from wrenchgap.plant.rigid_body import RigidBody, unpack
from wrenchgap.plant.state import Commands, Motion, State, rows
from wrenchgap.plant.wrench_model import WrenchModel, about_origin, measured_wrench

Index = NDArray[np.int_]

QUANTITIES = {"position": "m", "velocity": "m/s", "attitude": "rad", "rate": "rad/s"}
"""What is compared, and its unit."""
HORIZONS = (0.1, 0.5, 1.0)
"""[s]"""
NAIVE = "constant velocity"
"""Name of the prediction without a model."""
ROWS = 4096
"""Starts that are integrated at once: their arrays stay in a processor's cache."""
MOST_HORIZONS = 100
"""Each keeps the states of all starts, 0.5 MB a copy."""
MOST_STARTS = 5000
"""Of more samples so many, evenly spread: neighbours share all but one of their commands and say the same twice."""
FEWER_STARTS = 300
"""Where predictions are one result among others: as many as there are seconds of independent motion, and more."""
FARTHEST = 1e6
"""[m] from where a path begins: no vehicle goes as far in a second, and a page draws numbers of single precision."""
DRAWS, DRAWN = 8, 4000
"""Draws of the model's values, and predictions of what may be off: of 4,000 errors 200 are beyond their quantile."""
LIMIT = 0.95
"""Share of predictions that should be off by no more than is said."""


@dataclass(frozen=True)
class PredictionErrors:
    """Errors of one model: `mae`, `rmse` (H, 4) of H horizons and `QUANTITIES`, in their units.

    `limit` (H, 4) is what 95 % of predictions should be off by at most, `within` (H, 4) the share that is; None of
    the motion without a model.
    """

    name: str
    mae: Array
    rmse: Array
    limit: Array | None = None
    within: Array | None = None


@dataclass(frozen=True, repr=False)
class OpenLoop(Result):
    """Predictions of flights at `horizons` (H,) [s], each model from the same `starts`; the first without a model."""

    flights: tuple[str, ...]
    horizons: Array
    starts: int
    models: tuple[PredictionErrors, ...]
    opened: tuple[OpenFlight, ...]
    notes: tuple[object, ...] = ()


@dataclass(frozen=True)
class RecordedStretch:
    """N samples of a flight, `dt` [s] apart: states `y` (N, 13), commands over the period from each sample on.

    `motion` is the recorded one, `record` the same stretch as models are compared on it.
    """

    y: Array
    state: State
    motion: Motion
    commands: Commands
    dt: float
    record: Record


def open_loop(
    flights: Sequence[OpenFlight],
    model: Model,
    others: Sequence[Model] = (),
    *,
    gp: GaussianProcess | None = None,
    horizons: Sequence[float] = HORIZONS,
    names: Sequence[str] = (),
    most: int = MOST_STARTS,
    drawn: int = DRAWN,
    seed: int = 0,
    progress: Progress | None = None,
) -> OpenLoop:
    """Predict flights that were opened for `model` over `horizons` [s]: without a model, nominal, with effects, others.

    A process acts as it does along the recorded flight. `names` are those of the model and of others, by default of
    their files; of more samples than `most`, so many are started from, and `drawn` predictions say what errors should
    be; none, nothing is said of it. Raises LogError where a flight lacks the odometry or is shorter than the longest
    horizon, UsageError for horizons that are no positive numbers or shorter than a sample, ModelError for a motion that
    grows beyond all.
    """
    report = progress or silent
    asked = np.unique(np.asarray(horizons, dtype=float))
    if not len(asked) or not (np.isfinite(asked).all() and asked[0] > 0.0):
        raise UsageError(f"--horizon {','.join(f'{h:g}' for h in horizons)}: expected positive numbers of seconds")
    if len(asked) > MOST_HORIZONS:
        raise UsageError(f"--horizon: names {len(asked)} horizons; expected {MOST_HORIZONS} at most")
    report(0.0, "recorded motion")
    stretches = [s for one in flights for s in stretches_of(one, model.vehicle)]
    stride = 1 + sum(len(s.y) for s in stretches) // most
    longest = max(len(s.y) * s.dt for s in stretches)
    period = max(s.dt for s in stretches)
    if asked[0] < 0.5 * period:
        raise UsageError(f"--horizon {asked[0]:g}: expected seconds from the sample period of the log, {period:g}, on")
    every = []
    if asked[-1] < longest:  # else the number of steps may be none that an integer holds
        every = [ahead for s in stretches if len((ahead := Ahead(s, _steps(asked, s.dt), stride)).starts)]
    if not every:
        raise LogError(
            f"{flights[0].flight.path}: the longest stretch of flight lasts {longest:.1f} s, and the motion is "
            f"predicted {asked[-1]:g} s ahead; ask for shorter ones with --horizon"
        )
    found, said = predictors(model, others, gp, flights[0].records[0].cutoff_hz, names)
    notes: list[object] = [*said]
    errors = [_errors(NAIVE, np.concatenate([ahead.errors(ahead.naive()) for ahead in every], axis=1))]
    for k, one in enumerate(found):
        report((k + 1) / (len(found) + 1), f"predicting with {one.name}")
        usable, lacking = one.usable(model, [ahead.stretch.record for ahead in every])
        notes += lacking
        with np.errstate(over="ignore", invalid="ignore"):  # a motion without end is refused
            errors.append(_of_model(usable, every, drawn, np.random.default_rng(seed)))
    count = sum(len(ahead.starts) for ahead in every)
    flown = tuple(f.records[0].flight for f in flights)
    told = tuple(dict.fromkeys((*notes, *(note for f in flights for note in f.notes))))
    return OpenLoop(flown, asked, count, tuple(errors), tuple(flights), told)


def open_loop_beside(
    flights: Sequence[OpenFlight], model: Model, others: Sequence[Model] = (), **settings: Any
) -> tuple[OpenLoop | None, tuple[str, ...]]:
    """The same beside another result, or None and why: of fewer predictions, and not what their errors should be."""
    try:
        return open_loop(flights, model, others, most=FEWER_STARTS, drawn=0, **settings), ()
    except (LogError, ModelError, UsageError) as error:
        return None, (f"Nothing was predicted ahead: {error}",)


@np.errstate(over="ignore", invalid="ignore")  # a motion without end is not shown
def paths_ahead(
    stretches: Sequence[RecordedStretch], predictor: Predictor, horizon: float = 1.0, most: int = 100, points: int = 20
) -> tuple[Array, Array] | None:
    """Where predictions lead in `points` steps up to a `horizon` [s]: times (S,) at which they start, and positions
    (S, 1 + D, points + 1, 3) [m] in E, the model's own and D that what it leaves and does not know may make of it.

    None where no stretch is as long, or a motion goes beyond `FARTHEST`.
    """  # noqa: D205
    stride, times, paths = 1 + sum(len(s.y) for s in stretches) // most, [], []
    rng = np.random.default_rng(0)
    for s in stretches:
        ahead = Ahead(s, _steps(horizon * np.arange(1, points + 1) / points, s.dt), stride)
        if not len(ahead.starts):
            continue
        added, left = _wrenches(predictor, s)
        found = [ahead.states(predictor.model, added, ahead.starts)]
        found += [_drawn_states(predictor.model, ahead, ahead.starts, added, left, rng) for _ in range(DRAWS)]
        states = np.array(found)[..., :3].transpose(2, 0, 1, 3)
        begin = np.broadcast_to(s.y[ahead.starts, None, None, :3], (*states.shape[:2], 1, 3))
        times.append(s.state.time[ahead.starts])
        paths.append(np.concatenate((begin, states), axis=2))
    if not times or not all((np.abs(path - path[:, :, :1]) < FARTHEST).all() for path in paths):
        return None
    return np.concatenate(times), np.concatenate(paths)


def stretches_of(one: OpenFlight, vehicle: Vehicle) -> list[RecordedStretch]:
    """What flew of a flight. Raises LogError where the log lacks the odometry."""
    odometry = one.flight.odometry
    if odometry is None or any(samples.quat_EB is None for samples in one.flown):
        raise LogError(
            f"{one.flight.path}: a prediction starts from the recorded position and attitude, and no topic plays the "
            "role 'odometry' throughout; map one with --topic odometry=/your/topic"
        )
    out = []
    for samples, record in zip(one.flown, one.records, strict=True):
        held = samples_over_periods(samples, one.flight)
        cutoff_hz = min(CUTOFF_HZ, 0.3 / samples.dt)
        flown = recorded_motion(held, odometry, vehicle.imu_position_B, cutoff_hz=cutoff_hz)
        s = flown.state
        y = np.concatenate((s.position_E, s.quat_EB, s.velocity_E, s.omega_B), axis=1)
        out.append(RecordedStretch(y, s, flown.motion, commands_of(held, vehicle)[0], samples.dt, record))
    return out


def _steps(horizons: Array, dt: float) -> Index:
    """Horizons in samples."""
    return np.asarray(np.maximum(np.round(horizons / dt).astype(int), 1))


class Ahead:
    """Predictions of one stretch, which start at samples (`every` so many) that the longest of `steps` (H,) follows."""

    def __init__(self, stretch: RecordedStretch, steps: Index, every: int = 1) -> None:
        self.stretch, self.steps = stretch, steps
        self.starts = np.arange(0, max(len(stretch.y) - int(steps[-1]), 0), every)

    def naive(self) -> Array:
        """States (H, S, 13) of a motion that goes on with the velocity and the body rate of its start."""
        y, out = self.stretch.y[self.starts], []
        for time in self.steps * self.stretch.dt:
            turned = so3.multiply(y[:, 3:7], so3.exp(time * y[:, 10:13]))
            out.append(np.concatenate((y[:, :3] + time * y[:, 7:10], turned, y[:, 7:]), axis=1))
        return np.array(out)

    def states(
        self, model: WrenchModel, added: Array, starts: Index, left: Array | None = None, elsewhere: Index | None = None
    ) -> Array:
        """States (H, S, 13) that a model predicts from `starts` (S,).

        Wrenches about O act besides: `added` (N, 6) at their samples, `left` (N, 6) from samples `elsewhere` (S,) on.
        """
        s, body = self.stretch, RigidBody(model.body)
        commands, _ = model.command(s.commands, s.state, s.dt)
        rates, _ = model.rates(commands, s.dt)
        voltage = s.state.voltage
        out = np.empty((len(self.steps), len(starts), s.y.shape[1]))
        for part in (slice(k, k + ROWS) for k in range(0, len(starts), ROWS)):
            y = s.y[starts[part]]
            for k in range(int(self.steps[-1])):
                now = starts[part] + k
                at = unpack(s.state.time[now], y, None if voltage is None else voltage[now])
                wrench = model.wrench(commands.take(now), at, None if rates is None else rows(rates, now)) + added[now]
                if left is not None and elsewhere is not None:
                    wrench = wrench + left[elsewhere[part] + k]
                y = body.step(y, wrench, s.dt)
                out[self.steps == k + 1, part] = y
        return out

    def errors(self, states: Array) -> Array:
        """Lengths of the errors (H, S, 4) of states (H, S, 13) that were predicted from `starts`."""
        return lengths(states, self.stretch.y[self.starts + self.steps[:, None]])


def lengths(one: Array, other: Array) -> Array:
    """By how much states (..., 13) differ (..., 4), in the order of `QUANTITIES`: lengths, the angle of attitudes."""
    a, b = (x.reshape(-1, x.shape[-1]) for x in (one, other))
    turn = so3.log(so3.multiply(so3.conjugate(a[:, 3:7]), b[:, 3:7]))
    parts = (a[:, :3] - b[:, :3], a[:, 7:10] - b[:, 7:10], turn, a[:, 10:] - b[:, 10:])
    return np.stack([np.linalg.norm(part, axis=1) for part in parts], axis=1).reshape(*one.shape[:-1], len(parts))


def _errors(name: str, errors: Array) -> PredictionErrors:
    """Of errors (H, S, 4)."""
    return PredictionErrors(name, errors.mean(axis=1), np.sqrt((errors**2).mean(axis=1)))


def _of_model(one: Predictor, every: Sequence[Ahead], count: int, rng: np.random.Generator) -> PredictionErrors:
    """Errors of a model, and by `count` predictions what they should be within by what it leaves and does not know."""
    found, off = [], []
    draws = DRAWS if any(effect.std is not None for effect in one.model.effects) else 1
    starts = sum(len(ahead.starts) for ahead in every)
    for ahead in every:
        added, left = _wrenches(one, ahead.stretch)
        found.append(ahead.errors(ahead.states(one.model, added, ahead.starts)))
        some = rng.choice(ahead.starts, -(-count * len(ahead.starts) // (draws * starts)))
        plain = ahead.states(one.model, added, some)
        off += [lengths(_drawn_states(one.model, ahead, some, added, left, rng), plain) for _ in range(draws)]
    errors = np.concatenate(found, axis=1)
    limit = np.quantile(np.concatenate(off, axis=1), LIMIT, axis=1) if count else None
    if not np.isfinite(errors).all() or not (limit is None or np.isfinite(limit).all()):
        raise ModelError(
            f"{one.name}: the motion that it predicts grows beyond all numbers; check mass, inertia and effects of the "
            "model, or ask for shorter predictions with --horizon"
        )
    within = None if limit is None else (errors <= limit[:, None]).mean(axis=1)
    return replace(_errors(one.name, errors), limit=limit, within=within)


def _wrenches(one: Predictor, stretch: RecordedStretch) -> tuple[Array, Array]:
    """About O, along the recorded flight: what a process adds (N, 6), zero without one, and the model leaves (N, 6)."""
    record, model, added = stretch.record, one.model, np.zeros((len(stretch.y), 6))
    if one.gp is not None:
        more = one.predict(record, model.vehicle.body) - replace(one, gp=None).predict(record, model.vehicle.body)
        added = about_origin(model.vehicle.body, interpolated(stretch.state.time, record.time, more))
    flown = about_origin(model.body, measured_wrench(model.body, stretch.motion))
    return added, flown - model.actuate(stretch.commands, stretch.state, stretch.dt)[0] - added


def _drawn_states(
    model: WrenchModel, ahead: Ahead, starts: Index, added: Array, left: Array, rng: np.random.Generator
) -> Array:
    """States (H, S, 13) with values drawn within what is known of them, and what is left of another time."""
    elsewhere = rng.choice(ahead.starts, len(starts))
    return ahead.states(drawn(model, rng), added, starts, left, elsewhere)
