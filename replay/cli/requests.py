"""What commands have in common: options that come together, flights opened as they ask, results printed and written."""

from __future__ import annotations

import inspect
import os
import shlex
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property, wraps
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin, get_type_hints

import typer

from wrenchgap._escaping import printable
from wrenchgap.flight.errors import UsageError
from wrenchgap.replay import present
from wrenchgap.replay.cli import options as o

if TYPE_CHECKING:
    from wrenchgap.flight.arguments import Progress
    from wrenchgap.learn.data.opening import OpenFlight
    from wrenchgap.learn.data.read_options import ReadOptions
    from wrenchgap.learn.process.gp import GaussianProcess
    from wrenchgap.plant.model import Model


PATIENCE = 10.0
"""Seconds between lines of progress where standard error is no terminal."""


def console(least: int = 120, least_prose: int = 60) -> Any:
    """A rich console: sentences are as wide as the terminal, tables wide enough for their numbers on any.

    `least` are the columns that the widest tables need; a narrower terminal wraps their lines, but loses no digit.
    Sentences are not broken into lines shorter than `least_prose`.
    """
    from rich.console import Console
    from rich.table import Table

    known = sys.stdout.isatty() or "COLUMNS" in os.environ
    real = shutil.get_terminal_size().columns if known else 132

    class Terminal(Console):
        def print(self, *objects: Any, **options: Any) -> None:
            tables = any(isinstance(one, Table) and one.show_header for one in objects)
            width = max(real, least if tables else least_prose)
            super().print(*objects, **{"width": width} | options)

        def on_broken_pipe(self) -> None:  # whoever reads, e.g. `head`, has seen enough: files are written all the same
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

    return Terminal(width=max(real, least), highlight=False)


@contextmanager
def progress(label: str, quiet: bool = False) -> Iterator[Progress]:
    """Progress of long work: a bar on a terminal that goes away, else a line every `PATIENCE` seconds."""
    if quiet:
        yield lambda fraction, words: None
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(printable(label), total=1.0)
            yield lambda fraction, words: bar.update(task, completed=fraction, description=printable(words or label))
    else:
        said = time.monotonic()

        def plain(fraction: float, words: str) -> None:
            nonlocal said
            if time.monotonic() - said > PATIENCE:
                said = time.monotonic()
                sys.stderr.write(printable(f"{label}: {100 * fraction:.0f} % {words}") + "\n")
                sys.stderr.flush()

        yield plain


FOUND_BAD = 3
"""Exit code where a command did its work, and the log is bad, or its records are not what the export makes."""
COMMON = (*(one.name for one in fields(o.Reading)), "own")
"""Options that say how flights are read, by the names of their parameters."""


class Omit:
    """Of a group of options, those that a command has not: `Annotated[Reading, Omit("cutoff")]`."""

    def __init__(self, *names: str) -> None:
        self.names = names


@dataclass
class Run:
    """One run of a command: notes what is read, for the JSON result; prints, unless `quiet`; writes."""

    ctx: typer.Context = None  # type: ignore[assignment]
    own: o.OwnEffects = None
    json: o.JsonFile = None
    force: o.Force = False
    quiet: o.Quiet = False
    details = True  # no option: those of `DetailedRun` ask for them

    def __post_init__(self) -> None:
        self.inputs: list[Mapping[str, Any]] = []
        self._piped = self.json == Path("-")
        if self._piped:  # nothing else goes to standard output
            self.json, self.quiet = None, True
        self._outputs: dict[str, Path | None] = {}
        self._logs: list[tuple[OpenFlight, str]] = []

    def claim(self, outputs: Mapping[str, Path | None], *inputs: Path | str | None) -> None:
        """Check, before any work, that the outputs may be written (by option; --json is known)."""
        from wrenchgap.plant.model_file.shipped import shipped_models
        from wrenchgap.replay.present.documents import claim

        for option, path in outputs.items():
            if path is not None and str(path) in shipped_models():
                raise UsageError(f"{option} {path}: is what -m takes for a shipped model; write {path}.toml")
        read = [path for path in (*inputs, *(self.own or ())) if path is not None]
        self._outputs = {**outputs, "--json": self.json}
        claim(self._outputs, force=self.force, inputs=read)

    @contextmanager
    def progress(self, label: str, first: str = "reading logs") -> Iterator[Progress]:
        """Progress on standard error; `first` is what is done first."""
        with progress(label, self.quiet) as report:
            report(0.0, first)
            yield report

    def model(self, name: str, role: str = "model") -> Model:
        """The model of this name; its hash is noted now, because the output may replace the file."""
        from wrenchgap.plant import model_file

        found = model_file.load(name)
        assert found.path is not None
        self.note_input(found.path, role)
        for path in found.beside:
            self.note_input(path, "bench table")
        self.notes((e.changed_source for e in found.effects if e.changed_source), "warning")
        return found

    def note_input(self, path: Path, role: str) -> None:
        """Note a file that went into the result.

        Raises UsageError where an output would replace it; a model may be its own --output.
        """
        from wrenchgap.replay.present.documents import sha256

        for option, output in self._outputs.items():
            own = option == "--output" and role == "model"
            if output is not None and not own and output.resolve() == path.resolve():
                raise UsageError(f"{option} {output}: is one of the inputs; choose another name")
        self.inputs.append({"role": role, "file": str(path), "sha256": sha256(path)})

    def gp(self, path: Path | None) -> GaussianProcess | None:
        """The process of a file, where one is named."""
        if path is None:
            return None
        from wrenchgap.learn.process import store

        found = store.load(path)
        self.note_input(path, "gp")
        return found

    def open(
        self,
        options: ReadOptions,
        logs: Sequence[Path],
        model: Model,
        unseen: Sequence[Path] | None = None,
        roles: tuple[str, str] = ("log", "validation"),
        *,
        unseen_first: bool = False,
        **how: Any,
    ) -> tuple[list[OpenFlight], list[OpenFlight]]:
        """Flights of `logs` and of `unseen`, opened for a model; `how` as `learn.data.opening.opened` has it.

        `roles` are those of the two among what went into the result; `unseen_first` reads those first, so that what is
        wrong with them is said first.
        """
        from wrenchgap.learn.data.opening import open_flights

        sides = [list(logs), list(unseen or ())][:: -1 if unseen_first else 1]
        every = open_flights([*sides[0], *sides[1]], model, options, **how)
        parts = [every[: len(sides[0])], every[len(sides[0]) :]]
        flights, tests = parts[:: -1 if unseen_first else 1]
        self._logs += [*((one, roles[0]) for one in flights), *((one, roles[1]) for one in tests)]
        return flights, tests

    @cached_property
    def _console(self) -> Any:
        return console()

    def show(self, *parts: Any) -> None:
        """Print lines and tables (`replay.present.tables`)."""
        if not self.quiet:
            from wrenchgap.replay.present.tables import show

            for part in parts:
                show(self._console, part)

    def result(self, result: Any, **how: Any) -> None:
        """Print a result; `how` as `replay.present.parts` and that of its module have it."""
        how = {"details": self.details, **how}
        self.show(*present.parts(result, **how))
        if not how["details"]:
            self.line("tables and notes: --details", "dim")

    def line(self, text: str = "", style: str = "") -> None:
        """Print one text as it is, without markup."""
        from wrenchgap.replay.present.tables import Line

        self.show(Line(text, style))

    def notes(self, notes: Iterable[object], title: str = "note") -> None:
        """Print plain sentences that a user should read."""
        from wrenchgap.replay.present.notes import sentences
        from wrenchgap.replay.present.tables import note_lines

        self.show(*note_lines(sentences(notes), title))

    def draw(self, result: Any, path: Path | None) -> None:
        """Write a result's picture, where one is asked for."""
        if path is not None:
            present.save_figure(result, path, force=self.force)

    def save(
        self,
        command: str,
        result: Any,
        *,
        figure: Path | None = None,
        csv: Path | None = None,
        parquet: Path | None = None,
        page: Path | None = None,
        **more: Any,
    ) -> None:
        """Write what is asked for of a result: picture, every sample or value, page, and JSON with the keys `more`."""
        from wrenchgap.replay.present.documents import write_csv, write_parquet

        self.draw(result, figure)
        if csv is not None:
            write_csv(result.to_frame(), csv)
        if parquet is not None:
            write_parquet(result.to_frame(), parquet)
        if page is not None:
            from wrenchgap.flight.atomic import write_text
            from wrenchgap.replay.present.report.page import PAGES

            write_text(page, PAGES[type(result)](result, self.command_line()))
        self.write(command, {**result.to_json(), **more}, figure=figure, table=csv or parquet, page=page)

    @property
    def read(self) -> list[Mapping[str, Any]]:
        """What went into the result: logs, models and files with role, path and hash."""
        from wrenchgap.replay.present.documents import log_input

        return [*(log_input(one.flight, role) for one, role in self._logs), *self.inputs]

    def write(self, command: str, body: Mapping[str, Any], **files: Any) -> None:
        """Write the JSON of a command with what went in, where it is asked for; say which files were written."""
        if self.json is not None or self._piped:
            from wrenchgap.replay.present.documents import document, write_json

            write_json(self.json, document(command, body, self.read), force=self.force)
        for what, path in {**files, "result": self.json}.items():
            if path is not None:
                self.line(f"wrote {what.replace('_', ' ')} {path}")

    def write_model(
        self, command: str, body: Mapping[str, Any], saved: Model, path: Path, *, unchanged: bool = False
    ) -> None:
        """The same of a command that saved a model as a new version at `path`, or as a copy where it is `unchanged`."""
        number = saved.history[-1].number if saved.history else 1
        what = "unchanged copy of the model" if unchanged else f"model (version {number})"
        self.write(command, {**body, "model": str(path), "model_version": number}, **{what: path})

    def command_line(self) -> str:
        """The command that is running, as a user would type it; without options that do not change its result."""
        words = self.given(lambda name: name not in ("json", "force", "quiet", "details")).values()
        return shlex.join(["wrenchgap", *self.ctx.command_path.split()[1:], *chain(*words)])

    def common_options(self, *without: str) -> str:
        """Options of the running command that others need to read the same flights, with a space before them."""
        words = shlex.join(chain(*self.given(lambda name: name in COMMON and name not in without).values()))
        return f" {words}" if words else ""

    def given(self, wanted: Callable[[str], bool]) -> dict[str, list[str]]:
        """Options that were typed with another value than their own, and the words of each; arguments are under ""."""
        found: dict[str, list[str]] = {"": []}
        for parameter in self.ctx.command.params:
            value = self.ctx.params.get(parameter.name or "")
            if not wanted(parameter.name or "") or value in (None, [], (), parameter.default):
                continue
            listed = value if isinstance(value, list | tuple) else [value]
            name = max(parameter.opts, key=len)
            if parameter.param_type_name == "argument":
                found[""] += [str(v) for v in listed]
            elif isinstance(value, bool):
                found[name] = [name if value else max(parameter.secondary_opts or [name], key=len)]
            else:
                found[name] = [word for v in listed for word in (name, str(v))]
        return found


@dataclass
class DetailedRun(Run):
    """A run of a command that prints the answer, and what is behind it only where that is asked for."""

    details: Annotated[bool, typer.Option("--details", help="All tables and notes behind the answer.")] = False


def flat_command(function: Callable[..., None]) -> Callable[..., None]:
    """A command with its options one by one, as typer wants them: dataclasses of options become their fields, last."""
    groups: dict[str, tuple[Any, list[str]]] = {}
    options: list[inspect.Parameter] = []
    grouped: list[inspect.Parameter] = []
    hints = get_type_hints(function, include_extras=True)
    for one in inspect.signature(function).parameters.values():
        annotation = hints[one.name]
        kind, *marks = get_args(annotation) if get_origin(annotation) is Annotated else (annotation,)
        if not is_dataclass(kind):
            options.append(one.replace(kind=one.KEYWORD_ONLY, annotation=annotation))
            continue
        own = get_type_hints(kind, include_extras=True)
        without = {name for mark in marks if isinstance(mark, Omit) for name in mark.names}
        wanted = [f for f in fields(kind) if f.name not in without]
        groups[one.name] = kind, [f.name for f in wanted]
        grouped += [
            inspect.Parameter(f.name, one.KEYWORD_ONLY, default=f.default, annotation=own[f.name]) for f in wanted
        ]

    @wraps(function)
    def called(**values: Any) -> None:
        made = {name: kind(**{n: values.pop(n) for n in names}) for name, (kind, names) in groups.items()}
        function(**values, **made)

    options += grouped
    called.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
    called.__annotations__ = {option.name: option.annotation for option in options}
    return called
