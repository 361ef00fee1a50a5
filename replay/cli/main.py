"""The command line: finds the commands, runs one, and turns what goes wrong into one line.

Exit codes: 0 done; 2 the input or its use is wrong (one line on standard error says what and what to do); 3 `inspect`
found a log bad; 1 a fault of wrenchgap itself (the traceback goes to a file); 130 interrupted, 143 ended by SIGTERM.

Modules are imported when a command needs them, so that `wrenchgap --help` is quick.
"""

from __future__ import annotations

import importlib
import inspect
import os
import pkgutil
import sys
import tempfile
import traceback
from types import ModuleType
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from wrenchgap._escaping import printable
from wrenchgap.replay.cli import commands
from wrenchgap.replay.cli.options import many
from wrenchgap.replay.cli.requests import grouped

NAME = "wrenchgap"
ORDER = (
    *("model", "inspect", "calibrate", "compare", "where", "explain", "changed", "trend", "add", "remove", "history"),
    *(
        "learn",
        "report",
        "replay",
        "counterfactual",
        "export",
        "design",
        "simulate",
        "convert",
        "batch",
        "view",
        "demo",
    ),
)
"""Order in the help; commands that are not listed come last."""


class Commands(TyperGroup):
    """The group of all commands, with one policy for errors."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run, and leave with the exit code."""
        kwargs["standalone_mode"] = False
        try:
            code = super().main(*args, **kwargs)
        except BaseException as error:
            code = report(error)
        sys.exit(code if isinstance(code, int) else 0)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; an interrupt is told before it becomes an exit code."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            say("interrupted; nothing was left half-written")
            raise typer.Exit(_code(error)) from None


def say(message: str) -> None:
    """One line on standard error."""
    sys.stderr.write(f"{NAME}: {printable(' '.join(message.split()))}\n")
    sys.stderr.flush()


def report(error: BaseException) -> int:
    """Say in one line what went wrong, and return the exit code."""
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else 1
    if isinstance(error, typer.Abort) and isinstance(error.__cause__, EOFError):  # of a file; a prompt's has no cause
        error = error.__cause__
    if isinstance(error, (typer.Abort, KeyboardInterrupt)):
        say("interrupted")
        return _code(error.__cause__ or error)
    if isinstance(error, BrokenPipeError):  # the reader of our output, e.g. `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    if hasattr(error, "format_message"):  # wrong use of the command line
        return _usage(error)
    errors, own = (sys.modules.get(f"wrenchgap.{name}") for name in ("flight.errors", "plant.own_effects"))
    if errors is not None and isinstance(error, errors.WrenchgapError):
        say(str(error))
        return 2
    if own is not None and (said := own.blame(error)):
        say(f"{said} (in an effect of your own, see docs/effects/your-own.md)")
        return 2
    if isinstance(error, OSError) and error.filename is not None:
        say(f"{error.filename}: {error.strerror or error}")
        return 2
    if isinstance(error, OSError) and error.errno is not None:
        say(f"a file could not be written or read: {error.strerror}; see the free space and the limits")
        return 2
    if isinstance(error, MemoryError):
        say("out of memory; use fewer or shorter logs")
        return 1
    return _fault(error)


def _code(error: BaseException) -> int:
    return getattr(error, "code", 130)  # that of its signal


def _usage(error: Any) -> int:
    ctx = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError":
        sys.stdout.write(f"{error.format_message()}\n" if ctx is None else ctx.get_help() + "\n")
        return 2
    where = NAME if ctx is None else ctx.command_path
    say(f"{error.format_message().rstrip('.')}; see `{where} --help`")
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

    Start with `wrenchgap inspect LOG`, or with `wrenchgap demo`.
    """


def _unwrapped(text: str) -> str:
    """A docstring with each paragraph on one line, so that the help wraps it to the terminal."""
    return "\n\n".join(" ".join(part.split()) for part in inspect.cleandoc(text).split("\n\n"))


def _add_commands(group: typer.Typer, package: ModuleType) -> None:
    """Every module of a package as a command, every package in it as a group of commands."""
    found = {module.name: module.ispkg for module in pkgutil.iter_modules(package.__path__)}
    for name in sorted(found, key=lambda name: (*ORDER, name).index(name)):
        module = importlib.import_module(f"{package.__name__}.{name}")
        if found[name]:
            below = typer.Typer(name=name, no_args_is_help=True, help=_unwrapped(module.__doc__ or ""))
            _add_commands(below, module)
            group.add_typer(below)
        else:
            command, options = getattr(module, name), getattr(module, "MANY", ())
            group.command(name, cls=many(*options), help=_unwrapped(command.__doc__ or ""))(grouped(command))


_add_commands(app, commands)


def main() -> None:
    """Entry point of the `wrenchgap` command."""
    app(prog_name=NAME)
