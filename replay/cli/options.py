"""Options that several commands share, and the parsing of their values."""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand

from wrenchgap.replay.cli.completion import (
    complete_checks,
    complete_effects,
    complete_models,
    complete_phases,
    complete_topics,
)
from wrenchgap.replay.cli.completion import complete_trajectories as complete_trajectories
from wrenchgap.replay.cli.logs import FromLogs as FromLogs
from wrenchgap.replay.cli.logs import Log as Log
from wrenchgap.replay.cli.logs import Logs as Logs
from wrenchgap.replay.cli.logs import Validate as Validate

T = TypeVar("T")

ModelOption = Annotated[
    str,
    typer.Option(
        "--model",
        "-m",
        metavar="MODEL",
        help="Model file (.toml), or the name of a shipped model.",
        autocompletion=complete_models,
        show_default=False,
    ),
]
Topics = Annotated[
    list[str] | None,
    typer.Option(
        "--topic",
        metavar="ROLE=/TOPIC",
        help="Which topic plays a role and what it means, e.g. imu=/my/imu:frd,g or tilt=/servo[0:6]; repeat for more.",
        autocompletion=complete_topics,
    ),
]
Cutoff = Annotated[
    float, typer.Option("--cutoff", metavar="HZ", help="Low-pass on measurement and prediction alike, in Hz.")
]
Between = Annotated[
    list[str] | None,
    typer.Option(
        "--between",
        metavar="T0:T1",
        help="Use only this part of each flight, in seconds of its own clock, e.g. 5:40 or :40; repeat for more.",
    ),
]
Shift = Annotated[
    list[str] | None,
    typer.Option(
        "--shift",
        metavar="ROLE=SECONDS",
        help="Move the stamps of a sensor topic, e.g. odometry=-0.0123 for one that lags by 12.3 ms; repeat for more.",
    ),
]
Unmeasured = Annotated[
    str | None,
    typer.Option(
        "--unmeasured",
        metavar="A,B",
        help="Axes that the IMU did not measure, e.g. force_x,force_y: left out of everything (docs/logs.md).",
    ),
]
Accept = Annotated[
    list[str] | None,
    typer.Option(
        "--accept",
        metavar="CHECK",
        help="Go on although this check calls the log bad, e.g. accelerometer-unit (docs/checks.md); repeat for more.",
        autocompletion=complete_checks,
    ),
]
Keep = Annotated[
    list[str] | None,
    typer.Option(
        "--keep",
        metavar="PHASE",
        help="Use this phase too: ground, held, take-off, landing, impact, crash, saturation or all; repeat for more.",
        autocompletion=complete_phases,
    ),
]
BudgetOption = Annotated[
    str | None,
    typer.Option(
        "--budget",
        metavar="MEMORY,TIME",
        help="What reading one log may take, e.g. 8GB,120s, where the default refuses a sound log (docs/logs.md).",
    ),
]
Lead = Annotated[
    float | None,
    typer.Option(
        "--lead",
        metavar="S",
        help="Lead time (lag compensation horizon), in seconds, with physics as the GP's mean.",
    ),
]
JsonFile = Annotated[
    Path | None,
    typer.Option("--json", metavar="FILE", help="Write the result as JSON as well (docs/json.md).", dir_okay=False),
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite output files that exist.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
LogOut = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="LOG2", help="Log to write (.mcap).", show_default=False)
]
GpOption = Annotated[
    Path | None, typer.Option("--gp", metavar="GP", help="A Gaussian process of `wrenchgap learn`, on MODEL.")
]
Against = Annotated[
    list[str] | None,
    typer.Option(
        "--against", metavar="MODEL2...", help="Other models of the same vehicle.", autocompletion=complete_models
    ),
]
Figure = Annotated[Path | None, typer.Option("--figure", metavar="PNG", help="Draw the result.")]
Csv = Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="Every sample as a table.")]
Effects = Annotated[
    list[str],
    typer.Argument(metavar="EFFECT...", help="Names of effects.", autocompletion=complete_effects, show_default=False),
]
ModelOut = Annotated[
    Path, typer.Option("--output", "-o", metavar="MODEL2", help="Model file to write.", show_default=False)
]


def _load_own_effects(paths: list[Path] | None) -> list[Path] | None:
    """Put the user's own effects into the catalogue for this run, before any name is looked up."""
    if paths or "wrenchgap.plant.own_effects" in sys.modules:
        from wrenchgap.plant import own_effects

        own_effects.use(paths or ())
    return paths


OwnEffects = Annotated[
    list[Path] | None,
    typer.Option(
        "--effects",
        metavar="FILE.py",
        help="A file with an effect of your own (docs/effects/your-own.md); repeat for more.",
        callback=_load_own_effects,
        is_eager=True,
    ),
]


def many(*options: str) -> type[TyperCommand]:
    """A command in which these options take all values up to the next option: `--from a.mcap b.mcap`."""

    class Many(TyperCommand):
        def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
            return super().parse_args(ctx, list(_repeated(args, options)))

    return Many


def _repeated(args: Sequence[str], options: Sequence[str]) -> Iterable[str]:
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


def command_line(ctx: typer.Context, *without: str) -> str:
    """The command that is running, as a user would type it; without options that do not change its result."""
    silent = {"json", "force", "quiet", *without}
    return shlex.join(["wrenchgap", *ctx.command_path.split()[1:], *_words(ctx, lambda name: name not in silent)])


COMMON = ("topic", "shift", "cutoff", "between", "unmeasured", "accept", "keep", "budget", "own")
"""Options that say how flights are read, by the names of their parameters."""


def common_options(ctx: typer.Context, *without: str) -> str:
    """Options of the running command that others need as well to read the same flights, with a space before them."""
    words = shlex.join(_words(ctx, lambda name: name in COMMON and name not in without))
    return f" {words}" if words else ""


def _words(ctx: typer.Context, wanted: Callable[[str], bool]) -> list[str]:
    words: list[str] = []
    for parameter in sorted(ctx.command.params, key=lambda p: p.param_type_name != "argument"):
        value = ctx.params.get(parameter.name or "")
        if not wanted(parameter.name or "") or value is None or value == parameter.default:
            continue
        listed = value if isinstance(value, list | tuple) else [value]
        name = max(parameter.opts, key=len)
        if parameter.param_type_name == "argument":
            words += [str(v) for v in listed]
        elif isinstance(value, bool):
            words.append(name if value else max(parameter.secondary_opts or [name], key=len))
        else:
            words += [word for v in listed for word in (name, str(v))]
    return words


def usage_error(text: str) -> Exception:
    """What to raise where an option cannot be used; imported late, because `--help` must be quick."""
    from wrenchgap.flight.errors import UsageError

    return UsageError(text)


def parse_cutoff(hz: float) -> float:
    """The cut-off [Hz], if it is one; raises UsageError."""
    if not (math.isfinite(hz) and hz > 0):
        raise usage_error(f"--cutoff {hz:g}: expected a positive number of Hz, e.g. 8")
    return hz


def parse_between(texts: Sequence[str] | None) -> tuple[tuple[float, float], ...] | None:
    """`["5:40"]` as ((5.0, 40.0),), either side may be left open; raises UsageError on anything else."""
    return tuple(map(_interval, texts)) if texts else None


def _interval(text: str) -> tuple[float, float]:
    first, colon, last = text.partition(":")
    try:
        start, stop = float(first or "-inf"), float(last or "inf")
    except ValueError:
        start = stop = float("nan")
    if not colon or not start < stop:
        raise usage_error(f"--between {text}: expected T0:T1 in seconds with T0 before T1, e.g. --between 5:40")
    return start, stop


def parse_shifts(texts: Sequence[str] | None) -> dict[str, float]:
    """`["odometry=-0.012"]` as `{"odometry": -0.012}`; raises UsageError on anything else."""

    def seconds(text: str) -> float | None:
        try:
            return float(text) if math.isfinite(float(text)) else None
        except ValueError:
            return None

    return _by_role("--shift", texts, seconds, "ROLE=SECONDS, e.g. --shift odometry=-0.0123")


def parse_topics(texts: Sequence[str] | None) -> dict[str, str]:
    """`["imu=/my/imu"]` as `{"imu": "/my/imu"}`; raises UsageError on anything else."""
    return _by_role("--topic", texts, lambda topic: topic or None, "ROLE=/TOPIC, e.g. --topic imu=/my/imu")


def _by_role(option: str, texts: Sequence[str] | None, read: Callable[[str], T | None], expected: str) -> dict[str, T]:
    found: dict[str, T] = {}
    for text in texts or ():
        role, _, given = text.partition("=")
        value = read(given)
        if not role or value is None:
            raise usage_error(f"{option} {text}: expected {expected}")
        if role in found:
            raise usage_error(f"{option} {role}: given twice; say it once")
        found[role] = value
    return found


def parse_unmeasured(text: str | None) -> tuple[str, ...]:
    """`"force_x,force_y"` as names of axes; raises UsageError for others."""
    from wrenchgap.flight.unmeasured import axis_names

    return axis_names(parse_names(text))


def parse_accept(texts: Sequence[str] | None) -> tuple[str, ...]:
    """Names of checks; raises UsageError for one that there is not."""
    if not texts:
        return ()
    from wrenchgap.flight.check import accepted_names

    return accepted_names(name for text in texts for name in parse_names(text))


def parse_keep(texts: Sequence[str] | None) -> tuple[str, ...]:
    """Names of phases; raises UsageError for one that there is not."""
    if not texts:
        return ()
    from wrenchgap.learn.data.phases.phase import phase_names

    return phase_names(name for text in texts for name in parse_names(text))


def parse_budget(text: str | None) -> str | None:
    """A memory, a time or both, as it is; raises UsageError for others."""
    if text is not None:
        from wrenchgap.flight.budget import Budget

        Budget.of(text)
    return text


def parse_effects(text: str | None) -> tuple[str, ...]:
    """`"a,b"` as names of effects; raises ModelError for one that is not in the catalogue."""
    from wrenchgap.plant.effects import find

    return tuple(find(name).name for name in parse_names(text))


def parse_outputs(text: str) -> tuple[str, ...]:
    """`torque`, `wrench`, or names of axes separated by commas; raises UsageError on anything else."""
    from wrenchgap.flight.flight import AXES

    if text in ("torque", "wrench"):
        return AXES[3:] if text == "torque" else AXES
    names = parse_names(text)
    wrong = [n for n in names if n not in AXES]
    if wrong or not names or len(set(names)) < len(names):
        raise usage_error(f"--outputs {text}: expected torque, wrench, or different names out of {', '.join(AXES)}")
    return names


def parse_room(text: str | None) -> tuple[float, float, float] | None:
    """`"4,4,3"` as three lengths [m]; raises UsageError on anything else."""
    if text is None:
        return None
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise usage_error(f"--room {text}: expected three lengths in metres, e.g. --room 4,4,3") from None
    return x, y, z


def parse_names(text: str | None) -> tuple[str, ...]:
    """`"a,b"` as `("a", "b")`."""
    return tuple(part.strip() for part in (text or "").split(",") if part.strip())
