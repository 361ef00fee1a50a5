"""Public functions that bring a compensation onto the vehicle; the others are in `replay.api`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from wrenchgap.compensate import Combined, Compensator, Settings
from wrenchgap.flight.arguments import check_arguments
from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.identify.add import Addition, model_of
from wrenchgap.learn.identify.learning import Learnt
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.model import Model
from wrenchgap.replay.compensation.compensators import combined as combined_of
from wrenchgap.replay.export import export as exporting
from wrenchgap.replay.export.export import EVALUATIONS, Export, Precision
from wrenchgap.replay.export.flown import prove_flown as prove_flown
from wrenchgap.replay.export.folder import checked, write_folder
from wrenchgap.replay.export.observer import Asked, ObserverSettings


@check_arguments
def combined(
    gp: GaussianProcess | Learnt,
    model: Model | Addition,
    settings: Settings | None = None,
    *,
    lead: float | None = None,
) -> Combined | Compensator:
    """Feed-forward and observer in one object for your own loop: `compensator`, and an observer of what it leaves.

    The observer's bandwidth is that of the training log (docs/do-no-harm.md). `settings` are by default those of the
    model's control rate. Where the training log gives no bandwidth, because nothing is left for an observer to
    remove, or because none keeps the loop's margin, this is `compensator` without one, and `without_observer` says
    why. Raises
    FitError for another vehicle's GP.
    """
    known, process = model_of(model), gp.gp if isinstance(gp, Learnt) else gp
    return combined_of(process, known, settings or Settings(dt=1.0 / known.controller.rate_hz), lead=lead)


@check_arguments
def export_compensator(
    gp: GaussianProcess | Learnt | None,
    model: Model | Addition,
    folder: str | Path,
    settings: Settings | None = None,
    *,
    lead: float | None = None,
    precision: Precision = "double",
    without: Sequence[str] = (),
    names: tuple[str, str] = ("-", "-"),
    command: str = "wrenchgap.export_compensator",
    force: bool = False,
    observer: Asked = None,
    observer_max: float | None = None,
) -> Export:
    """Write the compensation as a folder of C99 (docs/export.md), all of it or nothing.

    Without a process, that of the model's effects alone. `settings` are by default those of the model's control rate,
    with 12 evaluations of the model in one search. Effects in `without` are left out. With an `observer` of so many Hz,
    or "log" for the bandwidth in the GP's file, what the rest leaves is corrected too, by at most `observer_max` [Nm].

    Raises UsageError where the folder exists and `force` is not given, and for what cannot be exported, by name.
    """
    path, known = Path(folder), model_of(model)
    checked(path, tuple(exporting.FILES), force=force)
    if known.path is not None and known.path.resolve().is_relative_to(path.resolve()):
        raise UsageError(f"--output {path}: the model {known.path} is in it; choose another name")
    process = gp.gp if isinstance(gp, Learnt) else gp
    asked = settings or Settings(dt=1.0 / known.controller.rate_hz, max_evaluations=EVALUATIONS)
    made = exporting.export(
        process,
        known,
        replace(asked, solver="onboard"),
        lead=lead,
        precision=precision,
        leave_out=without,
        names=names,
        command=command,
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        observer=ObserverSettings(observer, observer_max),
    )
    write_folder(path, made.files, force=force)
    return made
