"""Options and arguments that several commands share."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from wrenchgap.replay.cli import values


def existing_path(path: Path) -> Path:
    """The same path, once it is there: asked before anything heavy is imported.

    Where pathlib made an option (of ./--force) or nothing (of .) of its name, the whole path: commands that are
    proposed have it.
    """
    if not path.exists():
        raise typer.BadParameter(f"{path}: no such file or folder")
    return path.absolute() if str(path).startswith("-") or not path.name else path


def existing_paths(paths: list[Path] | None) -> list[Path] | None:
    """The same of several."""
    return paths and [existing_path(path) for path in paths]


def logs_in(paths: list[Path] | None) -> list[Path] | None:
    """The same logs, with each folder that is no bag replaced by the logs in it."""
    existing_paths(paths)
    if paths and any(path.is_dir() for path in paths):
        from wrenchgap.flight.formats.folders import flights_in

        paths = [log for path in paths for log in flights_in(path)]
    return existing_paths(paths)


def option(metavar: str, words: str, *names: str, **more: Any) -> Any:
    """An option with a value, which the help calls `metavar`; its names where they are not that of the parameter."""
    return typer.Option(*names, metavar=metavar, help=words, **more)


def output(metavar: str, words: str) -> Any:
    """The option of what a command writes."""
    return option(metavar, words, "--output", "-o")


Logs = Annotated[
    list[Path],
    typer.Argument(
        metavar="LOG...",
        help="Logs: .mcap, .bag, ROS 2 bag, .ulg, .bin, .csv, .parquet, or folders of them.",
        callback=logs_in,
    ),
]
SomeLogs = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="[LOG...]", help="Logs, as of other commands; none: they are dropped on the page.", callback=logs_in
    ),
]
FromLogs = Annotated[list[Path] | None, option("LOG...", "Logs to fit to.", "--from", callback=logs_in)]
Validate = Annotated[
    list[Path] | None, option("LOG...", "Flights to test the result on; never fitted.", callback=logs_in)
]
Log = Annotated[
    Path,
    typer.Argument(
        metavar="LOG", help="Log: .mcap, .bag, ROS 2 bag folder, .ulg, .bin, .csv, .parquet.", callback=existing_path
    ),
]
_MODEL = {
    "metavar": "MODEL",
    "help": "Model file (.toml), or the name of a shipped model.",
    "autocompletion": values.complete_models,
}
ModelOption = Annotated[str, typer.Option("--model", "-m", **_MODEL)]
OptionalModel = Annotated[str | None, typer.Option("--model", "-m", **_MODEL)]
ModelFile = Annotated[str, typer.Argument(**_MODEL)]
BudgetOption = Annotated[
    str | None,
    option(
        "MEMORY,TIME",
        "What reading one log may take, e.g. 8GB,120s, where the default refuses a sound log (docs/logs.md).",
    ),
]
Lead = Annotated[
    float | None,
    option("S", "Lead time (lag compensation horizon), in seconds, with physics as the GP's mean."),
]
JsonFile = Annotated[
    Path | None,
    typer.Option(
        "--json",
        metavar="FILE",
        help="Write the result as JSON as well (docs/json.md), - to standard output alone.",
        dir_okay=False,
        allow_dash=True,
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite output files that exist.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
LogOut = Annotated[Path | None, output("LOG2", "Log to write (.mcap).")]
GpOption = Annotated[Path | None, option("GP", "A Gaussian process of `wrenchgap learn`, on MODEL.")]
Against = Annotated[
    list[str] | None,
    option("MODEL2...", "Other models of the same vehicle.", autocompletion=values.complete_models),
]
Figure = Annotated[Path | None, option("PNG", "Draw the result.")]
Csv = Annotated[Path | None, option("FILE", "Every sample as a table.")]
Effects = Annotated[
    list[str], typer.Argument(metavar="EFFECT...", help="Names of effects.", autocompletion=values.complete_effects)
]
ModelOut = Annotated[Path, output("MODEL2", "Model file to write.")]
DespiteVerdict = Annotated[
    bool, typer.Option("--despite-verdict", help="Compensate in full, also where the verdict of learn is against it.")
]
Fit = Annotated[
    str | None,
    option(
        "A,B",
        "Effects to fit to each flight. Default: those of MODEL, else rotor_thrust of rotors "
        "that do not tilt, else thrust_scale,com_offset.",
    ),
]
ChangesOnly = Annotated[str | None, option("A,B", "Try changes of these effects only.")]
Injections = Annotated[
    int,
    option(
        "N",
        "Check N of the limits of what could have been shown by adding the effect to the logs and searching "
        "again; each takes as long as the search.",
        min=0,
        max=200,
    ),
]
Page = Annotated[Path | None, option("FILE", "All of it as a web page (.html).")]


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


@dataclass
class Reading:
    """How logs are to be read, as typed, and as `options`; raises UsageError for one that is not understood."""

    topic: Annotated[
        list[str] | None,
        option(
            "ROLE=/TOPIC",
            "Which topic plays a role and what it means, e.g. imu=/my/imu:frd,g or tilt=/servo[0:6]; repeat for more.",
            autocompletion=values.complete_topics,
        ),
    ] = None
    shift: Annotated[
        list[str] | None,
        option(
            "ROLE=SECONDS",
            "Move the stamps of a sensor topic, e.g. odometry=-0.0123 for one that lags by 12.3 ms; repeat for more.",
        ),
    ] = None
    cutoff: Annotated[
        float | None,
        option(
            "HZ",
            "Low-pass on measurement and prediction alike, in Hz; default: the model file's, or 8; of "
            "`replay` and `view` with a GP that of its data.",
        ),
    ] = None
    between: Annotated[
        list[str] | None,
        option(
            "T0:T1",
            "Use only this part of each flight, in seconds of its own clock, e.g. 5:40 or :40; repeat for more.",
        ),
    ] = None
    unmeasured: Annotated[
        str | None,
        option(
            "A,B", "Axes that the IMU did not measure, e.g. force_x,force_y: left out of everything (docs/logs.md)."
        ),
    ] = None
    accept: Annotated[
        list[str] | None,
        option(
            "CHECK",
            "Go on although this check calls the log bad, e.g. accelerometer-unit (docs/checks.md); repeat for more.",
            autocompletion=values.complete_checks,
        ),
    ] = None
    keep: Annotated[
        list[str] | None,
        option(
            "PHASE",
            "Use this phase too: ground, held, take-off, landing, impact, crash, saturation or all; repeat for more.",
            autocompletion=values.complete_phases,
        ),
    ] = None
    budget: BudgetOption = None

    def __post_init__(self) -> None:
        from wrenchgap.flight.check import accepted_names
        from wrenchgap.flight.unmeasured import axis_names
        from wrenchgap.learn.data.phases.phase import phase_names
        from wrenchgap.learn.data.read_options import ReadOptions

        self.options = ReadOptions(
            topics=values.parse_topics(self.topic),
            shifts=values.parse_shifts(self.shift),
            cutoff_hz=None if self.cutoff is None else values.parse_cutoff(self.cutoff),
            between=values.parse_between(self.between),
            unmeasured=axis_names(values.parse_names(self.unmeasured)),
            accept=accepted_names(name for text in self.accept or () for name in values.parse_names(text)),
            keep=phase_names(name for text in self.keep or () for name in values.parse_names(text)),
            budget=values.parse_budget(self.budget),
        )


@dataclass
class Gate:
    """What of the optimum is applied, as typed."""

    no_filter: Annotated[
        bool, typer.Option("--no-filter", help="Apply the optimum in full, whatever its uncertainty.")
    ] = False
    sigma_threshold: Annotated[
        float | None, typer.Option(help="Standard deviation at which half of the optimum is withheld.")
    ] = None
    kappa: Annotated[
        float | None, typer.Option(help="Gate slope: how sharply the correction fades around the threshold.")
    ] = None
    decay_time: Annotated[
        float, typer.Option(help="Time constant with which a withheld correction fades, in seconds.")
    ] = 0.15
    despite_verdict: DespiteVerdict = False

    def settings(self, **more: Any) -> Any:
        """The same as `compensate.Settings`, with others."""
        from wrenchgap.compensate import Settings

        same = {name: value for name, value in vars(self).items() if name != "no_filter"}
        return Settings(filter_uncertain=not self.no_filter, **same, **more)
