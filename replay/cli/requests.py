"""What commands have in common: flights opened as the options ask, results printed and written."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wrenchgap.replay.cli.options import parse_between, parse_cutoff, parse_shifts, parse_topics

if TYPE_CHECKING:
    from wrenchgap.learn.data.opening import OpenFlight
    from wrenchgap.learn.process.gp import GaussianProcess
    from wrenchgap.plant.model import Model
    from wrenchgap.replay.cli.console import Printer


@dataclass(frozen=True)
class Reading:
    """How logs are to be read: the values of --topic, --shift, --cutoff and --between, checked."""

    topics: Mapping[str, str]
    shifts: Mapping[str, float]
    cutoff_hz: float
    between: tuple[float, float] | None

    @classmethod
    def of(
        cls, topic: Sequence[str] | None, shift: Sequence[str] | None, cutoff: float = 8.0, between: str | None = None
    ) -> Reading:
        """From the texts of the command line; raises UsageError for one that is not understood."""
        return cls(parse_topics(topic), parse_shifts(shift), parse_cutoff(cutoff), parse_between(between))

    def open(self, logs: Sequence[Path], model: Model, **how: Any) -> list[OpenFlight]:
        """The flights of these logs, opened for a model; `how` as in `learn.data.opening.open_flights`."""
        from wrenchgap.learn.data.opening import open_flights

        asked = {"topics": self.topics, "cutoff_hz": self.cutoff_hz, "between": self.between, "shifts": self.shifts}
        return open_flights(logs, model, **asked, **how)  # type: ignore[arg-type]


def load_gp(path: Path | None) -> GaussianProcess | None:
    """The process of a file, where one is named."""
    if path is None:
        return None
    from wrenchgap.learn.process import store

    return store.load(path)


def write_result(
    path: Path | None,
    command: str,
    body: Mapping[str, Any],
    *,
    force: bool,
    flights: Iterable[OpenFlight] = (),
    validation: Iterable[OpenFlight] = (),
    models: Iterable[tuple[Model, str]] = (),
    files: Iterable[tuple[Path | None, str]] = (),
    inputs: Iterable[Mapping[str, Any]] = (),
) -> None:
    """Write the JSON of a command where one is asked for, with what went in: flights, models and files by role.

    `inputs` are those whose hash had to be taken before the work.
    """
    if path is None:
        return
    from wrenchgap.replay.present.documents import document, write_json

    read = [*inputs_of(flights, (), (), validation), *inputs, *inputs_of((), models, files)]
    write_json(path, document(command, body, read), force=force)


def inputs_of(
    flights: Iterable[OpenFlight],
    models: Iterable[tuple[Model, str]],
    files: Iterable[tuple[Path | None, str]] = (),
    validation: Iterable[OpenFlight] = (),
) -> list[dict[str, Any]]:
    """What went into a result, each with role, file and hash."""
    from wrenchgap.replay.present.documents import file_input, log_input, model_input

    read = [*(log_input(f.flight) for f in flights), *(log_input(f.flight, "validation") for f in validation)]
    read += [model_input(model, role) for model, role in models]
    return read + [file_input(file, role) for file, role in files if file is not None]


def show_result(printer: Printer, result: Any) -> None:
    """Print a result."""
    from wrenchgap.replay.present import parts

    printer.show(*parts(result))
