"""`wrenchgap batch`: one command over thousands of logs, here or on a Dask cluster (docs/batch.md)."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Annotated, Any

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Run
from wrenchgap.replay.cli.values import complete_models, parse_effects, usage_error

Sources = Annotated[
    list[str],
    typer.Argument(
        metavar="LOGS...",
        help="Logs, folders (with all folders in them), globs, lists (.txt, a log in each line), s3://..., gs://...",
    ),
]
Models = Annotated[
    list[str],
    o.option(
        "MODEL",
        "Model file (.toml) or shipped model, of all vehicles, or VEHICLE=MODEL of one; repeat for more.",
        "--model",
        "-m",
        autocompletion=complete_models,
    ),
]
SomeModels = Annotated[
    list[str] | None,
    o.option("MODEL", "Check logs against this model too, or VEHICLE=MODEL; repeat for more.", "--model", "-m"),
]
Output = Annotated[
    str,
    o.output(
        "FOLDER", "Where rows are written, a folder or s3://...; the same command again goes on where it stopped."
    ),
]


@dataclass
class Where:
    """Who does the work."""

    scheduler: Annotated[str | None, o.option("tcp://HOST:PORT", "A Dask cluster. Default: this machine.")] = None
    workers: Annotated[int | None, o.option("N", "Processes on this machine. Default: its cores.", min=1)] = None
    memory: Annotated[str, o.option("SIZE", "Most memory of each of them, e.g. 2GB; `auto`: its share.")] = "auto"
    vehicle: Annotated[str | None, o.option("NAME", "Of all logs. Default: the folder that a log is in.")] = None
    again: Annotated[
        bool, typer.Option("--again", help="Try logs once more that have failed, or whose row cannot be read.")
    ] = False

    def __post_init__(self) -> None:
        if self.scheduler is not None and (self.workers is not None or self.memory != "auto"):
            raise usage_error("--scheduler: the workers are those of the cluster; leave out --workers and --memory")


def _batch(
    command: str,
    logs: list[str],
    models: list[str],
    output: str,
    *,
    reading: o.Reading,
    where: Where,
    run: Run,
    healthy: Sequence[str] = (),
    passes: int = 1,
    **asked: Any,
) -> None:
    """One command over logs: do it, print and write what came of it; raises UsageError where every log failed.

    `asked` are further fields of the plan (`replay.batch.tasks.Plan`).
    """
    from wrenchgap.flight.errors import UsageError
    from wrenchgap.flight.extras import needed_for

    with needed_for("batches", extra="batch"):
        from wrenchgap.replay.batch import driver, sources, words
        from wrenchgap.replay.batch.store import Store
        from wrenchgap.replay.batch.tasks import Plan, models_by_vehicle

    asked["healthy"] = tuple(one.url for one in sources.logs_named(healthy)) if healthy else ()
    plan = Plan(command, models_by_vehicle(models), reading.options.to_json(), **asked)
    if run.own:
        raise UsageError("--effects: workers have the effects of the catalogue only; leave the option out")
    run.claim({})
    driver.dask_distributed()
    store = Store(output)
    found = sources.logs_named(logs, where.vehicle)
    store.claim(plan.identity)
    with store.alone(), run.progress(f"batch {plan.command}", f"{len(found)} logs") as report:
        report(0.0, "starting workers")
        with driver.client(where.scheduler, where.workers, where.memory, most=len(found)) as client:
            driver.agree(client, store)
            bokeh = "" if find_spec("bokeh") else " (its pages need bokeh: pip install bokeh)"
            run.line(f"Dask's dashboard: {client.dashboard_link}{bokeh}", style="dim")
            result = driver.passes(client, found, plan, store, report, passes, again=where.again)
    run.show(*words.parts(result))
    for vehicle, text in plan.models.items():
        run.inputs.append({"role": "model", "file": text.name, "sha256": text.sha256, "vehicle": vehicle or None})
    run.write("batch", words.to_json(result))
    if result.rows and len(result.failures) == len(result.rows):
        raise UsageError(f"all {len(result.rows)} logs failed; the first: {result.failures[0]['reason']}")


def inspect(
    logs: Sources, output: Output, model: SomeModels = None, *, reading: o.Reading, where: Where, run: Run
) -> None:
    """Check every log: a row with its worst check and all that `wrenchgap inspect --json` says.

    Example: `wrenchgap batch inspect flights/ -o inspected`
    """
    _batch("inspect", logs, model or [], output, reading=reading, where=where, run=run)


def compare(
    reading: o.Reading,
    where: Where,
    run: Run,
    logs: Sources,
    model: Models,
    output: Output,
    fit: o.Fit = None,
) -> None:
    """Errors of the model on every flight, and each flight's own parameters: `wrenchgap trend FOLDER` follows them.

    Example: `wrenchgap batch compare 'flights/*/*.mcap' -m my_quadrotor -o compared`
    """
    _batch("compare", logs, model, output, reading=reading, where=where, run=run, names=parse_effects(fit))


def explain(
    reading: o.Reading,
    where: Where,
    run: Run,
    logs: Sources,
    model: Models,
    output: Output,
    effects_only: Annotated[str | None, o.option("A,B", "Try these effects only.")] = None,
    passes: Annotated[
        int, o.option("N", "Most passes over the logs: each linearises candidates where the last found them.", min=1)
    ] = 2,
    each: Annotated[
        bool, typer.Option("--each", help="Search every log by itself as well, as `wrenchgap explain` does.")
    ] = False,
) -> None:
    """Rank the effects that the model is missing, vehicle by vehicle, on all flights together.

    Every log is read once a pass; its evidence is kept with its row, merged, and cross-validated by flight without
    reading a log again.

    Example: `wrenchgap batch explain s3://flights/2026/ -m my_quadrotor -o s3://results/explained --scheduler
    tcp://10.0.0.1:8786`
    """
    how: dict[str, Any] = {"names": parse_effects(effects_only), "each": each, "passes": passes}
    _batch("explain", logs, model, output, reading=reading, where=where, run=run, **how)


def changed(
    reading: o.Reading,
    where: Where,
    run: Run,
    logs: Sources,
    model: Models,
    healthy: Annotated[list[str], o.option("LOG...", "Logs of the same vehicle when all was well.")],
    output: Output,
    effects_only: o.ChangesOnly = None,
) -> None:
    """What changed on every flight, each by itself, against the same healthy flights of that vehicle.

    Example: `wrenchgap batch changed flights/ --healthy first/*.mcap -m my_quadrotor -o changed`
    """
    names = parse_effects(effects_only)
    _batch("changed", logs, model, output, reading=reading, where=where, run=run, names=names, healthy=healthy)
