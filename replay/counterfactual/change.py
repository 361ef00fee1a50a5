"""What is changed in a re-simulation, from what a user asked for in words: effects, gains, beliefs, compensation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from wrenchgap.compensate import Settings
from wrenchgap.compensate.allocator import Allocator
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.learn.parallel import one_thread
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant import Model, Vehicle
from wrenchgap.plant.allocation_problem import allocation_problem
from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.effect_values import with_values
from wrenchgap.plant.effectiveness import effectiveness
from wrenchgap.plant.reader import BOUNDS
from wrenchgap.plant.simulation.flight_computer import Allocating, Compensating
from wrenchgap.replay.compensation import compensators as compensating

SETTABLE = ("zeta_position", "omega_position", "zeta_attitude", "omega_attitude", "integral", "integral_limit")
"""Gains that a counterfactual may change."""


@dataclass(frozen=True)
class Change:
    """What is different in the re-simulation; nothing by default.

    plant        effects and vehicle that fly
    gains        of the control law
    believed     vehicle that controller and allocation assume
    compensator  in the loop
    allocating   in place of the nominal allocation
    beside       others to compare it with, by name, each flown in its place
    words        the same for tables and provenance
    process      what the compensator was made of
    """

    plant: Model | None = None
    gains: ControllerGains | None = None
    believed: Vehicle | None = None
    compensator: Compensating | None = None
    allocating: Allocating | None = None
    beside: tuple[tuple[str, Compensating], ...] = ()
    words: tuple[str, ...] = ()
    process: GaussianProcess | None = None


def changed_gains(gains: ControllerGains, texts: Sequence[str]) -> ControllerGains:
    """Gains with some replaced by texts such as `integral=0` or `omega_attitude=5,5,3.5` (one number: all axes).

    Raises UsageError for an unknown name or a value that is no number, ModelError for one out of range.
    """
    given: set[str] = set()
    for text in texts:
        name, equals, values = (part.strip() for part in text.partition("="))
        if name in given:
            raise UsageError(f"--gains {name}: given twice; say it once")
        given.add(name)
        if name not in SETTABLE or not equals:
            raise UsageError(f"--gains {text}: expected NAME=VALUE with a name out of {', '.join(SETTABLE)}")
        try:
            numbers = tuple(float(value) for value in values.split(","))
        except ValueError:
            raise UsageError(f"--gains {text}: {values!r} is not a number, or three with commas between") from None
        per_axis = name in ("zeta_attitude", "omega_attitude")
        if len(numbers) not in ((1, 3) if per_axis else (1,)):
            raise UsageError(f"--gains {text}: got {len(numbers)} numbers, expected {'1 or 3' if per_axis else '1'}")
        if any(abs(number) > BOUNDS.largest for number in numbers):
            raise UsageError(f"--gains {text}: expected numbers up to {BOUNDS.largest:g}")
        spread = numbers * 3 if per_axis and len(numbers) == 1 else numbers
        changed: dict[str, Any] = {name: spread if per_axis else numbers[0]}
        gains = replace(gains, **changed)
    return gains


def believed_vehicle(model: Model, believed: Model) -> Vehicle:
    """The model's vehicle with mass, inertia and centre of mass as `believed` (with its effects) has them."""
    if believed.vehicle.name != model.vehicle.name:
        raise ModelError(
            f"{believed.name}: is a model of {believed.vehicle.name}, expected one of {model.vehicle.name}; "
            "a controller can be told another mass, inertia and centre of mass, not another vehicle"
        )
    return replace(model.vehicle, body=believed.wrench_model.body)


def corrected_allocation(model: Model, flown: Model) -> Allocator:
    """The corrected allocation of another model of the vehicle, with its effects.

    Raises ModelError for a model of another vehicle, without rotors, of one that cannot hover as flown, and of one
    whose allocation is the nominal one.
    """
    if flown.vehicle.name != model.vehicle.name:
        raise ModelError(
            f"{flown.name}: is a model of {flown.vehicle.name}, expected one of {model.vehicle.name}; its allocation "
            "asks other rotors"
        )
    found = effectiveness(flown)
    if not found.matrix.by:
        left = f" ({', '.join(found.left_out)}: left out, at a limit of what is plausible)" if found.left_out else ""
        raise ModelError(
            f"{flown.name}: no effect of it changes what rotors make{left}, so that its allocation is the nominal one; "
            "fit what `wrenchgap explain` names, all together, with `wrenchgap add`"
        )
    return Allocator(allocation_problem(flown))


@one_thread
def change(
    model: Model,
    *,
    period: float,
    gp: tuple[str, GaussianProcess] | None = None,
    lead: float | None = None,
    without: Sequence[str] = (),
    with_: Sequence[str] = (),
    gains: Sequence[str] = (),
    believe: Model | None = None,
    allocation: Model | None = None,
    baselines: bool = False,
    feedback: Sequence[str] = (),
    despite_verdict: bool = False,
) -> Change:
    """What the options of the command line ask for; `period` [s] is that of the control loop.

    Raises UsageError, ModelError or FitError for options that ask for nothing that can be.
    """
    if lead is not None and gp is None:
        raise UsageError(f"--lead {lead:g}: is the lead time of a compensation, and there is none; give one with --gp")
    plant = with_values(model.without(without), with_) if without or with_ else None
    words = [f"without {name}" for name in without] + [f"with {text}" for text in with_]
    words += [f"gains {text}" for text in gains]
    if believe is not None:
        words.append(f"controller believes {believe.name}")
    if allocation is not None:
        words.append(f"allocated by {allocation.name} as flown")
    compensator, process = None, None if gp is None else gp[1]
    if gp is not None and process is not None:
        name = gp[0]
        words.append(f"compensated by {name}" + ("" if lead is None else f", lead time {lead:g} s"))
        settings = Settings(dt=period, despite_verdict=despite_verdict)
        compensator = compensating.compensator(process, model, settings, lead=lead)
    beside = compensating.baselines(process, model, period) if baselines else ()
    beside += tuple(compensating.feedback(text, model, period, process) for text in feedback)
    return Change(
        plant=plant,
        gains=changed_gains(model.controller, gains) if gains else None,
        believed=None if believe is None else believed_vehicle(model, believe),
        compensator=compensator,
        allocating=None if allocation is None else corrected_allocation(model, allocation),
        beside=tuple(dict(beside).items()),
        words=tuple(words),
        process=process.despite_verdict() if process is not None and despite_verdict else process,
    )
