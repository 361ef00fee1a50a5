"""What a model says that the measured wrench of a record should have been, with a process on top where there is one.

A process looks at the command, and at what it was told to look at besides (`process_inputs`).
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol, TypeVar

import numpy as np

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Array
from wrenchgap.flight.memory import HOURS, give_back, on_disk
from wrenchgap.learn.data.candidates import Untried, inapplicable
from wrenchgap.learn.data.measurement import Record, low_pass, thinned
from wrenchgap.plant.actuation import actuation
from wrenchgap.plant.effects import WrenchEffect
from wrenchgap.plant.mismatch import MismatchModel, output_indices
from wrenchgap.plant.mismatch_inputs import POSED, extra_inputs
from wrenchgap.plant.model import Model
from wrenchgap.plant.state import Actuation, Commands, Posture
from wrenchgap.plant.vehicle import Body
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel, about_origin

T = TypeVar("T")


def predict(record: Record, model: WrenchModel, body: Body | None = None) -> Array:
    """The measured wrench (K, 6) that the model predicts, through the same filter as the measurement.

    `body` is that of the nominal processing, where the measurement was made with another than the model's vehicle has.
    """
    return Evaluator(record)(model, body)


Key = tuple[object, ...]


class Evaluator:
    """Predictions of one record by models that differ in little from one another: what they share is computed once.

    A search changes one parameter at a time. The effective commands depend on the effects on commands alone, the
    rotors' wrench on those, the effects on thrusts and the air, and what is geometry in it on the tilt angles; since
    the filter is linear, each added wrench is filtered on its own, and kept for as long as what it `depends_on` stays.
    Of a `linear` effect the wrench of each parameter at one is kept. Where the vehicle is `balanced`, the mean wrench
    that a model leaves of the record acts on it, too.
    """

    def __init__(self, record: Record, *, balanced: bool = False) -> None:
        self.record, self.balanced = record, balanced
        self._commands: OrderedDict[Key, Commands] = OrderedDict()
        self._rotors: OrderedDict[Key, tuple[Actuation | None, Array, Array]] = OrderedDict()
        self._added: OrderedDict[Key, Array] = OrderedDict()
        self._linear: OrderedDict[Key, Array] = OrderedDict()
        self._postures: list[Posture] = []
        self._nominal: list[tuple[Commands, Actuation]] = []

    def forget(self) -> None:
        """Free the memory; what is asked for again is worked out again."""
        for memory in (self._commands, self._rotors, self._added, self._linear, self._postures, self._nominal):
            memory.clear()

    def __call__(self, model: WrenchModel, body: Body | None = None) -> Array:
        """The measured wrench (K, 6) that the model predicts; see `predict`."""
        record = self.record
        model = model.acting
        sent = (record.commands, record.state, record.dt)
        on_commands = _key(model, "commands")
        commands = _kept(self._commands, on_commands, 2, lambda: model.command(*sent)[0])
        air, on_thrusts = _key(model, "air"), _key(model, "thrusts")
        rated = any(item.effect.needs_rates for item in model.effects)
        key = (on_commands, on_thrusts, air if on_thrusts else (), rated)
        act, rotors, total = _kept(self._rotors, key, 2, lambda: self._rotor_part(model, commands))
        levels: dict[str, Key] = {"state": (), "commands": (on_commands, rated), "thrusts": key}
        for item in model.added:
            assert isinstance(item.effect, WrenchEffect)
            of = (levels[item.effect.depends_on], air, item.name)
            if item.effect.linear:
                unit = partial(self._by_parameter, model, item, act, rotors)
                total = total + np.tensordot(item.theta, _kept(self._linear, of, 16, unit), axes=1)
            else:
                made = partial(self._addition, model, item, act, rotors)
                total = total + _kept(self._added, (*of, item.theta.tobytes()), 16, made)
        return self._reported(model, total, body)

    def _reported(self, model: WrenchModel, wrench_B: Array, body: Body | None) -> Array:
        """What the IMU reports (K, 6) under this wrench about O: docs/theory/measured-wrench.md.

        A model without the torque that balances the vehicle predicts accelerations that never were, 20 rad/s^2 of a
        quadrotor that hovers with a weak rotor, and its mass properties and its IMU's mounting answer to them.
        """
        state, believed = self.record.state_kept, body or model.vehicle.body
        reported = model.report(wrench_B, state, body)
        if not self.balanced or not any(item.effect.place in ("body", "sensor") for item in model.effects):
            return reported
        unmodelled = np.nan_to_num(np.mean(self.record.measured - reported, axis=0, keepdims=True))
        return np.asarray(model.report(wrench_B + about_origin(believed, unmodelled), state, body) - unmodelled)

    def _rotor_part(self, model: WrenchModel, commands: Commands) -> tuple[Actuation | None, Array, Array]:
        rates, _ = model.rates(commands, self.record.dt)
        act, rotors = model.rotors(commands, self.record.state, rates, self._nominally(model, commands))
        act, rotors = act and act.with_thrust(on_disk(act.thrust)), on_disk(rotors)
        give_back(len(rotors))
        return act, rotors, self._filter(rotors)

    def _addition(self, model: WrenchModel, item: ModelEffect, act: Actuation | None, rotors: Array) -> Array:
        if act is not None:
            self._posture(act.posture)
        return self._filter(model.addition(item, act, rotors, self.record.state))

    def _by_parameter(self, model: WrenchModel, item: ModelEffect, act: Actuation | None, rotors: Array) -> Array:
        """What a linear effect adds (P, K, 6) with each of its parameters at one and the others at zero."""
        units = (replace(item, theta=unit) for unit in np.eye(len(item.theta)))
        return np.stack([self._addition(model, one, act, rotors) for one in units])

    def _nominally(self, model: WrenchModel, commands: Commands) -> Actuation | None:
        """What the rotors nominally do at these commands, of which the last two are kept; None where not known."""
        if commands.tilt is None or not model.vehicle.has_rotors:
            return None
        same = [a for sent, a in self._nominal if sent is commands and a.vehicle is model.vehicle]
        posture = self._posture(same[0].posture if same else Posture(model.vehicle, commands.tilt))
        found = same[0] if same else actuation(model.vehicle, commands, posture)
        if len(found.thrust) < HOURS:
            self._nominal = [(commands, found), *(pair for pair in self._nominal if pair[1] is not found)][:2]
        return found

    def _posture(self, asked: Posture) -> Posture:
        """That of these tilt angles: one of the last two if they are the same. Only the last has its arrays."""
        if self._postures and self._postures[0] is asked:
            return asked

        def alike(p: Posture) -> bool:
            return p.vehicle is asked.vehicle and (p.tilt is asked.tilt or np.array_equal(p.tilt, asked.tilt))

        found = next((p for p in self._postures if p is asked or alike(p)), asked)
        others = [p for p in self._postures if p is not found]
        for other in others:
            other.forget()
        self._postures = [found, *others[:1]]
        return found

    def _filter(self, wrench: Array) -> Array:
        return thinned(wrench, self.record.dt, self.record.cutoff_hz, self.record.keep)


def _key(model: WrenchModel, place: str) -> Key:
    """What of a model's effects at one place a prediction depends on."""
    return tuple((item.name, item.theta.tobytes()) for item in model.effects if item.effect.place == place)


def _kept(memory: OrderedDict[Key, T], key: Key, most: int, make: Callable[[], T]) -> T:
    """The remembered value, or a new one; the `most` recently used stay."""
    if key in memory:
        memory.move_to_end(key)
        return memory[key]
    value = memory[key] = make()
    if len(memory) > most:
        memory.popitem(last=False)
    return value


class Process(MismatchModel, Protocol):
    """A mismatch model that may look at more than the command."""

    @property
    def input_groups(self) -> tuple[str, ...]:
        """Groups of inputs besides the command (`plant.mismatch_inputs`)."""


@dataclass(frozen=True)
class Predictor:
    """A model, with a process on top where there is one, under its name in tables."""

    name: str
    model: WrenchModel
    gp: Process | None = None

    def predict(self, record: Record, body: Body) -> Array:
        """Measured wrench (K, 6) that the model expects, as processed with the mass and inertia of `body`."""
        predicted = predict(record, self.model, body)
        if self.gp is not None:
            predicted[:, output_indices(self.gp.outputs)] += self.gp.mean(process_inputs(self.gp.input_groups, record))
        return predicted

    def sigma(self, record: Record) -> Array | None:
        """Standard deviation (K, 6) where a process knows one; not a number on the other axes."""
        if self.gp is None:
            return None
        sigma = np.full((len(record), 6), np.nan)
        sigma[:, output_indices(self.gp.outputs)] = self.gp.std(process_inputs(self.gp.input_groups, record))
        return sigma

    def usable(self, model: Model, records: Sequence[Record]) -> tuple[Predictor, tuple[Untried, ...]]:
        """The same without effects that need what these records of `model`'s vehicle lack, and which those are."""
        reasons = {e.name: inapplicable(e.name, model, records) for e in self.model.effects}
        lacking = tuple(reason for reason in reasons.values() if reason is not None)
        if not lacking:
            return self, ()
        kept = tuple(e for e in self.model.effects if reasons[e.name] is None)
        return replace(self, model=WrenchModel(self.model.vehicle, kept)), lacking


def require_pose(names: Sequence[str], record: Record) -> None:
    """Raise FitError for a group that needs a pose where the log has none."""
    missing = [name for name in names if name in POSED]
    if missing and not record.has_pose:
        raise FitError(
            f"{record.flight}: input {', '.join(missing)} needs odometry, which the log lacks; map it with "
            "--topic odometry=/your/topic, or learn a GP without this input (--inputs)"
        )


def process_inputs(names: Sequence[str], record: Record) -> Array:
    """Commands (K, 6) and the columns of the groups `names` behind them, filtered as the measurement is.

    Raises FitError for a group that needs a pose where the log has none.
    """
    if not names:
        return record.commanded
    require_pose(names, record)
    wrench = record.commands.wrench_B
    sent = np.concatenate((wrench[:1], wrench[:-1]))
    extra, _ = extra_inputs(names, sent, record.state, record.dt)
    return np.hstack((record.commanded, low_pass(extra, record.dt, record.cutoff_hz)[record.keep]))


def pooled_inputs(names: Sequence[str], records: Sequence[Record]) -> Array:
    """Of all records, one after the other."""
    return np.concatenate([process_inputs(names, record) for record in records])
