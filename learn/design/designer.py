"""The flight that tells effects apart: searched among manoeuvres, checked on the plant.

A flight of length T is cut into segments of about `SEARCH.segment` seconds, each filled by one manoeuvre
(`learn.design.manoeuvres`). Screening flies them open loop: reference -> feedforward of the controller -> allocation,
with sensor noise, which is what perfect tracking commands. The segments are chosen one after the other, each time that
with which the flight so far separates the group best (`Separability.merit`, linearised: `learn.design.screening`);
then each is exchanged for others as long as that helps. The winner is flown in closed loop with each effect hidden in
turn; that flight must keep the limits (else the manoeuvres are softened), and both explanations are fitted to it,
which gives the separation that a user may expect.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from wrenchgap.flight import so3
from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.resample import uniform
from wrenchgap.learn.data.candidates import inapplicable
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.errors import energy, rms
from wrenchgap.learn.data.measurement import Record, prepare
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.design.design_result import Design, Flown, Segment, rounded
from wrenchgap.learn.design.manoeuvres import Limits, Task, available, space, usual
from wrenchgap.learn.design.screening import Piece, Screen, broken, lost_after, rehearse, rotor_use, tracking
from wrenchgap.learn.design.separability import (
    SEPARATION,
    Separability,
    measured_separation,
    nuisances,
    separability,
    sized,
    thorough,
)
from wrenchgap.plant.effects import find, require_force
from wrenchgap.plant.model import Model
from wrenchgap.plant.simulation.simulate import physics_rate, simulate
from wrenchgap.plant.trajectory.file import TrajectoryFile, dumps, loads
from wrenchgap.plant.trajectory.maneuvers import Move, Moves
from wrenchgap.plant.wrench_model import ModelEffect


@dataclass(frozen=True)
class SearchSettings:
    """How a flight is searched for."""

    segment: float = 10.0
    """Length of a segment to aim for [s]."""
    shortest: float = 8.0
    """Shortest flight that can be designed [s]."""
    longest: float = 120.0
    """Longest flight that can be designed [s]."""
    rest: float = 0.5
    """Hover at either end of a flight [s]."""
    grid: float = 0.04
    """Segments last a multiple of this [s], so that halves and quarters are whole hundredths."""
    vigours: tuple[float, ...] = (1.0, 0.8, 0.6, 0.4, 0.2)
    """Vigours that are tried, until a manoeuvre keeps the limits."""
    softer: float = 0.85
    """Factor on the vigour where the plant did not keep the limits."""
    attempts: int = 4
    """How often a flight is made softer, at most."""
    hover: float = 4.0
    """Time [s] for which a vehicle must hover with an effect hidden; else the effect is halved."""
    halved: int = 5
    """How often it is halved, at most."""
    hopeless: int = 2
    """After so many segments that leave next to nothing unimitated the search ends: no flight will."""
    sweeps: int = 3
    """How often each segment is exchanged for any other, as long as that helps."""
    azimuths: tuple[float, ...] = tuple(np.radians([0.0, 30.0, 60.0, 90.0, 150.0]))
    """Azimuths that are tried [rad]."""


SEARCH = SearchSettings()


def design(
    names: Sequence[str],
    model: Model,
    *,
    flights: Sequence[OpenFlight] = (),
    limits: Limits | None = None,
    duration: float = 30.0,
    also: Sequence[str] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Design:
    """The flight of `duration` [s] that tells the effects `names` apart best, within `limits`.

    `also` are effects fitted along with each (see `learn.design.separability.nuisances`). Sizes of the effects: the
    model's, else fitted on `flights`, else typical. Raises FitError for an effect that no flight of
    this model can show, UsageError for a length or room in which nothing can be flown.
    """
    if len(set(names)) < 2:
        raise UsageError("design: expected at least two different effects to separate")
    if not SEARCH.shortest <= duration <= SEARCH.longest:
        raise UsageError(f"--duration {duration:g}: expected {SEARCH.shortest:g} to {SEARCH.longest:g} s")
    report = progress or silent
    records = tuple(r for f in flights for r in f.records)
    with threadpool_limits(1, user_api="blas"):  # small matrices: threads cost more than they bring
        found = _Search(tuple(dict.fromkeys(names)), model, records, limits, duration, also, seed, report).run()
    return replace(found, flights=tuple(flights))


# --- the search -------------------------------------------------------------------------------------------------------


class _Search:
    def __init__(
        self,
        names: tuple[str, ...],
        model: Model,
        records: tuple[Record, ...],
        limits: Limits | None,
        duration: float,
        also: Sequence[str] | None,
        seed: int,
        report: Progress,
    ) -> None:
        self.model, self.records, self.duration, self.also = model, records, duration, also
        self.seed, self.report = seed, report
        self.rng = np.random.default_rng(seed)
        self.base = model.without([n for n in names if model.effect(n) is not None])
        self.limits = limits or usual(model.vehicle)
        self.room = space(model.vehicle, self.limits)
        self.count = max(1, round((duration - 2.0 * SEARCH.rest) / SEARCH.segment))
        self.length = SEARCH.grid * float(np.floor((duration - 2.0 * SEARCH.rest) / self.count / SEARCH.grid))
        self.manoeuvres = available(self.room)
        self.pieces: dict[Segment, Piece] = {}
        self.tried = 0
        self._applicable(names)
        data = dataset(records, self.base) if records else None
        self.effects = tuple(self._sized(n, data) for n in names)
        self.floor: Array | None = None
        if data is not None:  # what the best of the explanations leaves on a log: on the next not much less is left
            left = [thorough(data, self.base, n, nuisances(also, names, self.base)).residual for n in names]
            best = min(left, key=lambda r: energy(r, data.weights))
            self.floor = np.maximum(rms(best), data.noise)
        self.screen = Screen(self.base, self.effects, nuisances(also, names, self.base), self.floor)

    def _path(self, duration: float, moves: Sequence[Move] = ()) -> Moves:
        return Moves(duration, self.room.home, tuple(moves), not self.room.tilts)

    def _sized(self, name: str, data: Dataset | None) -> ModelEffect:
        """The model's, else fitted, else typical; halved while the vehicle cannot even hover with it."""
        effect = self.model.effect(name) or sized(name, self.base, data, also=self.also)
        hover = self._path(SEARCH.hover)
        for _ in range(SEARCH.halved):
            if lost_after(self._flight(hover, effect), hover) is None:
                break
            effect = replace(effect, theta=0.5 * effect.theta)
        return effect

    def _applicable(self, names: Sequence[str]) -> None:
        """FitError for effects that this model, or any flight that can be designed, cannot show."""
        hover, _ = rehearse(self._path(2.0), self.base, self.limits)
        for name in names:
            require_force([*(e.name for e in self.base.effects), name])
            if find(name).needs_voltage:
                raise FitError(
                    f"design: {name} shows while the battery's voltage falls, which no trajectory brings about; repeat "
                    "the same flight with a full and with a low battery, and log the voltage"
                )
            reason = inapplicable(name, self.base, [hover])
            if reason is not None:
                raise FitError(f"design: {reason}")

    def run(self) -> Design:
        """Search, check on the plant, and put together what a user should know."""
        file, segments, flown = self._fly(self._compose())
        return Design(
            self.effects,
            file,
            segments,
            self.limits,
            self._judge(self.records or self._rehearsed(self._path(self.duration))),
            "the given logs" if self.records else "hover",
            self._judge(self._rehearsed(file.trajectory)),
            flown,
            self.tried,
            self.base,
        )

    def _compose(self) -> tuple[Segment, ...]:
        """Segment after segment the manoeuvre that helps most, then exchanges as long as they help."""
        flyable = self._flyable()
        if not flyable:
            raise FitError(
                f"design: {self.model.vehicle.name} flies none of the manoeuvres {', '.join(self.manoeuvres)} within "
                "its limits; check its mass and highest thrust (`wrenchgap model show`), or give wider limits "
                "(`wrenchgap design --help`)"
            )
        chosen: tuple[Segment, ...] = ()
        best = 0.0
        for number in range(self.count):
            pieces = [self.pieces[s] for s in chosen]
            if number == SEARCH.hopeless and self.screen.judge(pieces).share < 0.3 * SEPARATION.least_share:
                break
            merits = [self._merit((*chosen, s), 0.2 + 0.3 * number / self.count) for s in flyable]
            chosen = (*chosen, flyable[int(np.argmax(merits))])
            best = max(merits)
        for sweep in range(SEARCH.sweeps):
            before = best
            for k in range(len(chosen)):
                trials = [(*chosen[:k], s, *chosen[k + 1 :]) for s in flyable]
                merits = [self._merit(t, 0.5 + 0.3 * (sweep + k / len(chosen)) / SEARCH.sweeps) for t in trials]
                if max(merits) > 1.01 * best:
                    chosen, best = trials[int(np.argmax(merits))], max(merits)
            if best <= 1.02 * before:
                break
        return chosen

    def _flyable(self) -> list[Segment]:
        """Every manoeuvre, in every azimuth that makes a difference, at the largest vigour that keeps the limits.

        Each is flown alone, open loop; what is found then is one of the pieces.
        """
        found: list[Segment] = []
        tight = self.limits.tightened()
        for number, name in enumerate(self.manoeuvres):
            self.report(0.2 * number / len(self.manoeuvres), f"trying {name}")
            seen: list[Sequence[Move]] = []
            for azimuth in SEARCH.azimuths:
                for vigour in SEARCH.vigours:
                    segment = Segment(name, vigour, float(azimuth))
                    moves = self._moves(segment)
                    if moves in seen:
                        break
                    if moves is None:
                        continue
                    record, beyond = rehearse(self._path(self.length, moves), self.base, tight, seed=self.seed)
                    if not beyond:
                        self.pieces[segment] = self.screen.piece(record)
                        seen.append(moves)
                        found.append(segment)
                        break
        return found

    def _moves(self, segment: Segment) -> Sequence[Move] | None:
        return self.manoeuvres[segment.name](Task(self.length, self.room, segment.vigour, segment.azimuth))

    def _merit(self, segments: Sequence[Segment], done: float) -> float:
        """How well these segments, one after the other, separate the group."""
        self.tried += 1
        self.report(done, f"trying {', '.join(map(str, segments))}")
        return self.screen.merit([self.pieces[s] for s in segments])

    def _rehearsed(self, trajectory: Moves) -> list[Record]:
        return [rehearse(trajectory, self.base, self.limits, seed=self.seed)[0]]

    def _judge(self, records: Sequence[Record]) -> Separability:
        return separability(records, self.base, *self.effects, also=self.also, floor=self.floor)

    def _fly(self, segments: tuple[Segment, ...]) -> tuple[TrajectoryFile, tuple[Segment, ...], tuple[Flown, ...]]:
        """The flight on the plant: softer until it keeps the limits with nothing hidden; then with each effect.

        With an effect hidden it must stay in the room and under control; that effect, not the trajectory, may tilt it
        further or take an actuator to its limit.
        """
        reasons: list[str] = []
        for _ in range(SEARCH.attempts):
            self.report(0.86, "checking the flight on the plant")
            file = self._file(segments)
            found = self._flight(file.trajectory)
            reasons = broken(found, file.trajectory, self.model, self.limits, believed=True)
            flown: list[Flown] = []
            wide = replace(self.limits, tilt=float(np.pi), speed=1e3)
            for k, truth in enumerate([] if reasons else self.effects):
                self.report(0.9 + 0.1 * k / len(self.effects), f"flying with {truth.name} hidden")
                flight = self._flight(file.trajectory, truth)
                beyond = broken(flight, file.trajectory, self.model, wide, believed=False)
                reasons = [f"with {truth.name} {r}" for r in beyond]
                if reasons:
                    break
                flown.append(self._measure(flight, file.trajectory, truth))
            if not reasons:
                return file, segments, tuple(flown)
            segments = tuple(replace(s, vigour=SEARCH.softer * s.vigour) for s in segments)
        raise FitError(
            f"design: on the plant the vehicle {'; '.join(reasons)}, even when softened {SEARCH.attempts - 1} times; "
            "give it more room (--room) or speed (--max-speed), or less tilt (--max-tilt)"
        )

    def _file(self, segments: Sequence[Segment]) -> TrajectoryFile:
        """The flight as it will be read from its file."""
        moves: list[Move] = []
        for k, segment in enumerate(segments):
            start = SEARCH.rest + k * self.length
            moves += [replace(m, start=m.start + start) for m in self._moves(segment) or []]
        plan = self._path(self.duration, [rounded(m) for m in moves])
        return loads(dumps(TrajectoryFile("_or_".join(e.name for e in self.effects), plan, self.model.vehicle.name)))

    def _flight(self, trajectory: Moves, truth: ModelEffect | None = None) -> Flight:
        hidden = self.base if truth is None else self.base.with_effects([*self.base.effects, truth])
        rng = np.random.default_rng(self.seed)
        return simulate(hidden, self.base, trajectory, rng=rng, physics_rate=physics_rate(self.base))

    def _as_on_the_logs(self, record: Record) -> Record:
        """With as much left on each axis as the best of the explanations leaves on the given logs, as white noise."""
        if self.floor is None:
            return record
        missing = np.sqrt(np.maximum(self.floor**2 - record.noise**2, 0.0))
        return replace(record, measured=record.measured + missing * self.rng.normal(size=record.measured.shape))

    def _measure(self, flight: Flight, trajectory: Moves, truth: ModelEffect) -> Flown:
        seen = [replace(s, unmeasured=self.model.unmeasured) for s in uniform(flight)]
        records = [self._as_on_the_logs(prepare(s, self.model.vehicle, imu=flight.imu)) for s in seen]
        data = dataset(records, self.base)
        others = [e.name for e in self.effects if e.name != truth.name]
        found = {n: measured_separation(data, self.base, truth.name, n, self.also) for n in others}
        assert flight.odometry is not None
        tilt = float(so3.tilt_angle(flight.odometry.quat_EB).max())
        speed = float(np.linalg.norm(np.asarray(flight.odometry.velocity_E), axis=1).max())
        return Flown(truth.name, found, tilt, speed, rotor_use(flight, self.model), *tracking(flight, trajectory))
