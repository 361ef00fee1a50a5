"""`wrenchgap check`, `inspect`, `convert`: what is in logs."""

import shlex
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import wrenchgap as wg
from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import FOUND_BAD, DetailedRun, Omit, Run
from wrenchgap.replay.cli.values import check_ending, usage_error

if TYPE_CHECKING:
    from wrenchgap.learn.data.read_options import ReadOptions
    from wrenchgap.plant.model import Model


def _said_once(command: str) -> str:
    """A command in which each role has one --topic, the first."""
    words, out, roles = shlex.split(command), list[str](), set[str]()
    for word, before in zip(words, ["", *words], strict=False):
        role = word.partition("=")[0]
        if before == "--topic" and role in roles:
            out.pop()
            continue
        roles |= {role} if before == "--topic" else set()
        out.append(word)
    return shlex.join(out)


def check(
    reading: Annotated[o.Reading, Omit("between", "shift", "cutoff", "keep")],
    run: DetailedRun,
    logs: o.Logs,
    model: o.OptionalModel = None,
    figure: o.Figure = None,
    page: o.Page = None,
) -> None:
    """What to look at first, without a mass and without a model: one screen about a vehicle and its logs.

    Flight phases, motor balance, saturation, vibration, battery, estimator, rates, and what the log can answer. Several
    logs stand side by side, with the parameters of the autopilot that differ. MODEL, if given, says where the rotors
    are and which topics play the roles.

    Example: `wrenchgap check flight.ulg`
    """
    from wrenchgap._lazy import uncollected

    with uncollected():
        look_at = wg.check

    run.claim({"--figure": figure, "--page": page}, *logs, model)
    known = None if model is None else run.model(model)
    with run.progress("checking") as report:
        found = look_at(logs, known, reading.options, progress=report)
    run.inputs[:0] = [
        {"role": "log", "file": str(log.inspection.path), "sha256": log.inspection.content_hash} for log in found.logs
    ]
    run.result(found)
    run.save("check", found, figure=figure, page=page)


def inspect(
    reading: Annotated[o.Reading, Omit("between")],
    run: DetailedRun,
    logs: o.Logs,
    model: o.OptionalModel = None,
    output: Annotated[
        Path | None,
        o.output(
            "MODEL2",
            "Write MODEL with the --topic, --shift, --cutoff and --unmeasured of this command, where no check is bad.",
        ),
    ] = None,
) -> None:
    """What is in a log: topics, the roles they play, rates, gaps, clocks, and whether the values are plausible.

    Each check that fails says what to do. With a model, its mass, rotors and actuation are checked as well. Then the
    delays between the topics and, with a model, of the response behind its commands (docs/timing.md).

    The exit code is 3 where a check is bad and not accepted, so that a script does not go on.

    Example: `wrenchgap inspect flight.mcap -m crazyflie --topic imu=/my/imu`

    What reads a log well is kept by `-o`: `wrenchgap inspect flight.mcap -m crazyflie --topic imu=/my/imu:frd,g -o
    mine.toml`; `-m mine.toml` then reads logs of this vehicle so.
    """
    from wrenchgap._lazy import uncollected

    with uncollected():
        from wrenchgap.learn.diagnose import model_checks
        from wrenchgap.replay.present.inspection import next_command

    asked = reading.options
    run.claim({"--output": output}, *logs)
    known = None if model is None else run.model(model)
    said = asked.topics or asked.shifts or asked.cutoff_hz or asked.unmeasured
    if output is not None and (known is None or not said):
        raise usage_error("inspect -o: expected -m MODEL and what to keep: --topic, --shift, --cutoff, --unmeasured")
    bodies = []
    for path in logs:
        seen = model_checks.inspect(path, known, asked)
        run.result(seen)
        run.line(f"next: {_said_once(next_command(seen) + run.common_options())}", style="bold")
        bodies.append(seen.to_json())
    run.inputs[:0] = [{"role": "log", "file": b["path"], "sha256": b["sha256"]} for b in bodies]
    found = [check for body in bodies for check in (*body["checks"], *body["model_checks"])]
    bad = any(check["level"] == "bad" and not check["accepted"] for check in found)
    if known is not None and output is not None and not bad:
        _keep(run, known, asked, output, {"logs": bodies})
        return
    run.write("inspect", {"logs": bodies})
    if bad:
        raise typer.Exit(FOUND_BAD)


def _keep(run: DetailedRun, model: "Model", asked: "ReadOptions", output: Path, body: Mapping[str, Any]) -> None:
    """Write the model with how the logs were read, and say what of it is kept."""
    from wrenchgap.replay.present.inspection import kept_in_words

    kept = asked.recorded_in(model)
    saved = wg.save_model(kept, output, before=model, command=run.command_line(), force=run.force)
    run.line(f"kept in {output}: {kept_in_words(asked)}")
    run.write_model("inspect", body, saved, output)


def convert(
    reading: Annotated[o.Reading, Omit("cutoff", "between", "accept", "keep")],
    run: Run,
    logs: o.Logs,
    output: Annotated[Path, o.output("OUT", "Log to write (.mcap), or an existing folder.")],
) -> None:
    """Write logs of any format as MCAP with ROS 2 messages, which Foxglove, PlotJuggler and the rosbag tools open.

    Only what plays a role is written, in SI, FLU and ENU, on one clock, without what was left out. Several logs go into
    a folder, under their own names. Reading the result gives the same flight.

    Example: `wrenchgap convert flight.ulg -o flight.mcap`
    """
    from wrenchgap import flight
    from wrenchgap.replay.present.documents import log_input

    asked = reading.options
    targets = _targets(logs, output)
    run.claim({f"--output {log.name}": target for log, target in targets.items()}, *logs)
    bodies = []
    with run.progress("converting") as told:
        for number, (log, target) in enumerate(targets.items()):
            told(number / len(targets), f"reading {log.name}")
            found = flight.load(log, asked.topics, unmeasured=asked.unmeasured, budget=asked.budget)
            found = flight.shifted(found, asked.shifts or {})
            source = {"source": str(log), "source_sha256": found.content_hash, "command": run.command_line()}
            flight.write(found, target, metadata=source | {"notes": "\n".join(found.notes)}, force=run.force)
            run.inputs.append(log_input(found))
            played = found.series().items()
            run.line(f"{log}: {', '.join(f'{role} ({len(series.time)})' for role, series in played)}")
            run.notes(found.notes)
            run.line(f"wrote log {target}")
            roles = {role: {"topic": series.topic, "samples": len(series.time)} for role, series in played}
            bodies.append({"log": str(log), "output": str(target), "roles": roles, "notes": list(found.notes)})
    run.write("convert", {"logs": bodies})


def _targets(logs: list[Path], output: Path) -> dict[Path, Path]:
    """Where each log goes; raises UsageError for several logs and no folder, or of one name."""
    if output.is_dir():
        targets = {log: output / f"{log.name if log.is_dir() else log.stem}.mcap" for log in logs}
        twice = [target for target, count in Counter(targets.values()).items() if count > 1]
        if twice:
            raise usage_error(
                f"--output {output}: several of the logs would be written as {twice[0].name}; convert them apart"
            )
        return targets
    if len(logs) > 1:
        raise usage_error(f"--output {output}: {len(logs)} logs go into a folder; expected one that exists")
    check_ending(output, "logs are written as MCAP", ".mcap", ", or a folder")
    return {logs[0]: output}
