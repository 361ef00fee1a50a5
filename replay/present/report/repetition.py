"""What is needed to come to the same numbers again: commands, inputs with their hashes, options, versions."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from wrenchgap.learn.posterior.verdict import Verdict
from wrenchgap.plant.effects import sources
from wrenchgap.plant.model_file import as_argument, dumps, next_version, tool_version
from wrenchgap.replay.present.documents import sha256
from wrenchgap.replay.report import Report

PACKAGES = ("numpy", "scipy", "GPy", "matplotlib", "mcap", "rosbags", "tomlkit", "pyclustering")
"""Packages whose versions may change numbers."""
FITTED = "fitted.toml"
"""What the fitted model is called in commands and in the page."""


@dataclass(frozen=True)
class Repetition:
    """Everything that is needed to repeat a report.

    `inputs` are role, path and SHA-256 of each file, `fitted_model` is the text of the model file, with history.
    """

    date: str
    commands: tuple[str, ...]
    inputs: tuple[tuple[str, str, str], ...]
    options: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]
    fitted_model: str

    @classmethod
    def of(
        cls,
        report: Report,
        model: str = "",
        command: str = "",
        common: str = "",
        options: Mapping[str, str] | None = None,
        gp_file: Path | None = None,
    ) -> Repetition:
        """That of a report.

        `model` is what the user called the model, by default its file, else its name; `command` the command that asks
        for this, `common` those of its options that other commands need as well to come to the same numbers (with a
        space before them), `options` what they mean.
        """
        named = model or as_argument(report.model)
        cutoff = f"{report.flights[0].records[0].cutoff_hz:g} Hz"
        return cls(
            datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
            (*filter(None, [command]), *(f"{line}{common}" for line in _commands(report, named, gp_file))),
            _inputs(report, gp_file),
            tuple({"cut-off": cutoff, **(options or {})}.items()),
            _versions(),
            _fitted_model(report, command),
        )


def _commands(report: Report, model: str, gp_file: Path | None) -> list[str]:
    """Commands that lead to the same numbers one by one."""
    logs, unseen = (shlex.join(str(f.flight.path) for f in group) for group in (report.flights, report.unseen))
    target = fitted = shlex.quote(model)
    listed = [f"wrenchgap explain {logs} -m {target}" + (f" --validate {unseen}" if unseen else "")]
    if names := report.explanation.effects:
        fitted = FITTED
        listed.append(f"wrenchgap add {' '.join(names)} -m {target} --from {logs} -o {fitted}")
        listed.append(f"wrenchgap compare {unseen or logs} -m {target} --against {fitted}")
    listed.append(f"wrenchgap where {unseen or logs} -m {fitted}")
    if report.explanation.verdict is Verdict.UNKNOWN:
        held_out = f" --validate {unseen}" if unseen else ""
        listed.append(f"wrenchgap discover {logs} -m {target}{held_out} -o law.py")
    if gp_file is None:
        listed.append(f"wrenchgap learn {logs} -m {fitted} -o rest.gp")
    return listed


def _inputs(report: Report, gp_file: Path | None) -> tuple[tuple[str, str, str], ...]:
    flights = [("log", report.flights), ("unseen log", report.unseen)]
    listed = [(role, str(f.flight.path), f.flight.content_hash) for role, group in flights for f in group]
    files = (("model", report.model.path), ("GP", gp_file))
    listed += [(role, str(path), sha256(path)) for role, path in files if path is not None]
    listed += [(f"effect {name}", source.file, source.sha256) for name, source in sources().items()]
    return tuple(listed)


def _versions() -> tuple[tuple[str, str], ...]:
    listed = [("wrenchgap", tool_version()), ("Python", platform.python_version()), ("system", platform.platform())]
    for name in PACKAGES:
        try:
            listed.append((name, version(name)))
        except PackageNotFoundError:
            continue
    return tuple(listed)


def _fitted_model(report: Report, command: str) -> str:
    """The text of the model file that `wrenchgap add` would write; the given one's where nothing was named."""
    if not report.explanation.effects:
        return dumps(report.model)
    model, added, path = report.model, report.addition, Path(FITTED)
    return dumps(next_version(model, added.model, command=command, path=path, flights=added.logs, trial=added.trial))
