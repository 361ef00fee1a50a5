"""The command line: finds the commands, runs one, and turns what goes wrong into one line.

Exit codes: 0 done; 2 the input or its use is wrong (one line on standard error says what and what to do); 3 `inspect`
found a log bad; 1 a fault of wrenchgap itself (the traceback goes to a file); 130 interrupted, 143 ended by SIGTERM,
129 as its terminal closed.

Modules are imported when a command needs them, so that `wrenchgap --help` is quick.
"""

import inspect
import os
import re
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from wrenchgap._escaping import printable
from wrenchgap._kernels import refused_setting, removed_kernels
from wrenchgap._signals import interrupt_of
from wrenchgap.replay.cli.commands import analysis, batch, compensation, demo, export, flights, logs, model, view
from wrenchgap.replay.cli.requests import flat_command
from wrenchgap.replay.cli.values import usage_error

NAME = "wrenchgap"
COMMANDS = (
    *(logs.check, logs.inspect, model.calibrate, analysis.compare),
    *(flights.predict, flights.ready, analysis.where, analysis.explain, analysis.discover),
    *(analysis.changed, analysis.trend, model.add, model.remove, model.history),
    *(model.effectiveness, model.write),
    *(compensation.learn, analysis.report, compensation.replay, compensation.counterfactual, export.export),
    *(flights.design, flights.simulate, logs.convert, view.view, demo.demo),
)
"""In the order of the help; `GROUPS` of further ones follow."""
GROUPS = {
    "model": ("Make a model file from what is known of a vehicle, and look at one.", (model.new, model.show)),
    "batch": (
        "One command over thousands of logs, in parallel on this machine or on a Dask cluster (docs/batch.md).",
        (batch.inspect, batch.compare, batch.explain, batch.changed),
    ),
}
SEVERAL = frozenset(
    f"--{name}"
    for name in ("from", "validate", "healthy", "against", "value", "hide", "with", "without", "gains", "also")
)
"""Options that take all values up to the next option: `--from a.mcap b.mcap`."""


class Commands(TyperGroup):
    """The group of all commands, with one policy for errors."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run, and leave with the exit code."""
        kwargs["standalone_mode"] = False
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, TextIOWrapper):  # a name that the terminal's encoding lacks is no reason to end
                stream.reconfigure(errors="replace")
        warnings.filterwarnings("error", "Environment variable 'NUMBA_", RuntimeWarning)  # could not be parsed
        try:
            code = super().main(*args, **kwargs)
        except BaseException as error:
            code = report(error)
        sys.exit(code if isinstance(code, int) else 0)

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Read the command line."""
        with telling("interrupted"):
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with telling("interrupted; nothing was left half-written"):
            return super().invoke(ctx)


@contextmanager
def telling(words: str) -> Iterator[None]:
    """Say of an interrupt that there was one, and keep the code of its signal: typer makes it 130 without a word."""
    try:
        yield
    except BaseException as error:
        if (interrupt := interrupt_of(error)) is None:
            raise
        say(words)
        raise typer.Exit(_code(interrupt)) from None


def say(message: str) -> None:
    """One line on standard error."""
    sys.stderr.write(f"{NAME}: {printable(' '.join(message.split()))}\n")
    sys.stderr.flush()


def report(error: BaseException) -> int:
    """Say in one line what went wrong, and return the exit code."""
    errors, own = (sys.modules.get(f"wrenchgap.{name}") for name in ("flight.errors", "plant.own_effects"))
    if isinstance(error, SystemExit) and not (own is not None and own.blame(error)):
        return error.code if isinstance(error.code, int) else 1
    if isinstance(error, typer.Abort) and isinstance(error.__cause__, EOFError):  # of a file; a prompt's has no cause
        error = error.__cause__
    interrupt = interrupt_of(error)
    if interrupt is not None or isinstance(error, typer.Abort):
        say("interrupted")
        return _code(interrupt or error)
    if isinstance(error, BrokenPipeError):  # the reader of our output, e.g. `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    if hasattr(error, "format_message"):  # wrong use of the command line
        return _usage(error)
    said: str | None
    if errors is not None and isinstance(error, errors.WrenchgapError):
        said = str(error)
    elif own is not None and (said := own.blame(error)):
        said += " (in an effect of your own, see docs/effects/your-own.md)"
    elif isinstance(error, OSError) and error.filename is not None:
        said = f"{error.filename}: {error.strerror or error}"
    elif isinstance(error, OSError) and error.errno is not None:
        said = f"a file could not be written or read: {error.strerror}; see the free space and the limits"
    elif (said := removed_kernels(error) or refused_setting(error)) is None and isinstance(error, MemoryError):
        said = "out of memory; use fewer or shorter logs, or raise the limit that `ulimit -a` shows"
    if said is None:
        return _fault(error)
    say(said)
    return 2


def _code(error: BaseException) -> int:
    return getattr(error, "code", 130)  # that of its signal


PLAIN = {
    "Value error, ": "",
    "Input should be a valid number, unable to parse string as a number": "expected a number without its unit",
    "Input should be a valid integer, unable to parse string as an integer": "expected a whole number",
}
"""What pydantic, which checks typer's options, says, and what a user reads."""


def _usage(error: Any) -> int:
    ctx = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError":
        sys.stdout.write(f"{error.format_message()}\n" if ctx is None else ctx.get_help() + "\n")
        return 2
    where = NAME if ctx is None else ctx.command_path
    words = error.format_message()
    for theirs, ours in PLAIN.items():
        words = words.replace(theirs, ours, 1)
    example = ""
    if type(error).__name__ == "MissingParameter" and ctx is not None:  # what an answer looks like is in the help
        found = re.search(r"Example: (`[^`]+`)", ctx.command.help or "")
        example = "" if found is None else f", as in {found[1]}"
    say(f"{words.rstrip('.')}{example}; see `{where} --help`")
    return 2


def _fault(error: BaseException) -> int:
    text = "".join(traceback.format_exception(error))
    if os.environ.get("WRENCHGAP_DEBUG"):
        sys.stderr.write(text)
        return 1
    how: Any = {"mode": "w", "suffix": ".txt", "delete": False, "encoding": "utf-8", "errors": "replace"}
    with tempfile.NamedTemporaryFile(prefix=f"{NAME}-", **how) as file:
        file.write(f"{' '.join(sys.argv)}\n{text}")
    said = str(error).splitlines() or [""]
    say(
        f"internal error: {type(error).__name__}: {said[0]} - please report it with {file.name} "
        "(WRENCHGAP_DEBUG=1 shows the traceback here)"
    )
    return 1


app = typer.Typer(
    name=NAME,
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"{NAME} {version(NAME)}")
        raise typer.Exit()


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Find the physical effect that a vehicle's model is missing, from its flight logs.

    Start with `wrenchgap check LOG`, or with `wrenchgap demo`.
    """


class Command(TyperCommand):
    """A command in which the options of `SEVERAL` may have more than one value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As typer, which wants an option before each value."""
        if not ctx.resilient_parsing:
            _refuse_empty(args)
        listed = {name for one in self.params if getattr(one, "multiple", False) for name in one.opts}
        try:
            return super().parse_args(ctx, list(_repeated(args, SEVERAL & listed)))
        except Exception as error:
            if getattr(error, "ctx", ctx) is None:  # an option without its value: say whose help has it
                error.ctx = ctx  # type: ignore[attr-defined]
            raise


def _refuse_empty(args: Sequence[str]) -> None:
    """Raise UsageError for an empty argument, such as a shell variable that is not set: as a path it is this folder."""
    for before, arg in zip(("", *args), args, strict=False):
        bare = arg[:-1] if arg.startswith("--") and arg.find("=") == len(arg) - 1 else ""
        if not arg or bare:
            where = bare or (before if before.startswith("-") else "an argument")
            raise usage_error(f"{where}: is empty; expected a value, perhaps of a shell variable that is not set")


def _repeated(args: Sequence[str], options: Collection[str]) -> Iterator[str]:
    """`--from a b -m c` as `--from a --from b -m c`."""
    current, fresh = "", False
    for arg in args:
        if arg.startswith("-") and len(arg) > 1:
            current, fresh = (arg if arg in options else ""), True
            yield arg
        elif current and not fresh:
            yield from (current, arg)
        else:
            fresh = False
            yield arg


def _add_commands(group: typer.Typer, commands: Sequence[Callable[..., None]]) -> None:
    for command in commands:
        paragraphs = inspect.cleandoc(command.__doc__ or "").split("\n\n")  # on one line each: the help wraps them
        words = "\n\n".join(" ".join(part.split()) for part in paragraphs)
        group.command(command.__name__, cls=Command, help=words)(flat_command(command))


_add_commands(app, COMMANDS)
for name, (words, commands) in GROUPS.items():
    below = typer.Typer(name=name, no_args_is_help=True, help=words)
    _add_commands(below, commands)
    app.add_typer(below)


def main() -> None:
    """Entry point of the `wrenchgap` command."""
    app(prog_name=NAME)
