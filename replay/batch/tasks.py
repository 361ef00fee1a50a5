"""What is done with every log of a batch, in plain values that travel to any worker; and how a worker does it.

It reads the log, does the command and writes the row; nothing that goes wrong leaves it.
"""

import hashlib
import json
import resource
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

import wrenchgap as wg
from wrenchgap._kernels import removed_kernels
from wrenchgap.flight import AXES, UsageError, WrenchgapError, work_files
from wrenchgap.learn.data.opening import OpenFlight, open_flight
from wrenchgap.learn.identify.trend import flight_values, followed_flight
from wrenchgap.learn.posterior.flight_evidence import evidence, packed
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import is_model, tool_version
from wrenchgap.replay.batch.sources import Source, at_hand
from wrenchgap.replay.batch.store import Store, fit_json
from wrenchgap.replay.present.documents import plain


@dataclass(frozen=True)
class ModelText:
    """A model file as text: workers need not see the folder that it lies in. `name` is that of the file."""

    name: str
    text: str

    @property
    def sha256(self) -> str:
        """Of the text."""
        return hashlib.sha256(self.text.encode()).hexdigest()


@dataclass(frozen=True)
class Plan:
    """`command` on every log, with the model of its vehicle: `models` by vehicle, that of "" for all others.

    `reading` are options of `api.open_flights`, `names` effects (`changed` and `explain`: candidates; `compare`: those
    followed by `trend`), `healthy` the logs of `changed`. `each` says that `explain` also searches every log by itself.
    `points` are the values at which candidates are linearised, by vehicle, of the `number`-th pass.
    """

    command: str
    models: Mapping[str, ModelText]
    reading: Mapping[str, Any] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    healthy: tuple[str, ...] = ()
    each: bool = False
    points: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    number: int = 1

    def model_text(self, vehicle: str) -> ModelText | None:
        """Of a vehicle; None where there is none, which `inspect` alone allows."""
        return self.models.get(vehicle, self.models.get(""))

    @property
    def identity(self) -> dict[str, Any]:
        """Everything that the numbers depend on but for the log: what a run is recognised by."""
        models = {vehicle: {"name": m.name, "sha256": m.sha256} for vehicle, m in sorted(self.models.items())}
        return {
            "command": self.command,
            "models": models,
            "reading": json.loads(json.dumps(dict(self.reading), sort_keys=True)),
            "names": list(self.names),
            "healthy": list(self.healthy),
            "each": self.each,
            "version": tool_version(),
        }

    def key(self, content: str, vehicle: str) -> str:
        """Of a row: of a log's content, its vehicle, the command with its options, the version, and the pass."""
        of = {**self.identity, "content": content, "vehicle": vehicle, "points": self.points.get(vehicle, {})}
        return hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()[:32]


def model_text(name: str) -> ModelText:
    """A shipped model, or a file. Raises ModelError for what is no model."""
    found = wg.load_model(name)
    assert found.path is not None
    return ModelText(found.path.name, found.text)  # with the bench table, which workers do not see


def models_by_vehicle(texts: tuple[str, ...] | list[str]) -> dict[str, ModelText]:
    """`["crazyflie", "big=octo.toml"]`: the model of all vehicles, and of some by name. Raises UsageError."""
    out: dict[str, ModelText] = {}
    for text in texts:
        splits = [("", text), *((text[:k], text[k + 1 :]) for k, letter in enumerate(text) if letter == "=")]
        vehicle, name = next((one for one in splits if is_model(one[1])), splits[-1])
        if vehicle in out:
            raise UsageError(f"--model {text}: {vehicle or 'all vehicles'} have a model already; say it once")
        if not vehicle and name != text:
            raise UsageError(f"--model {text}: expected MODEL or VEHICLE=MODEL")
        out[vehicle] = model_text(name)
    return out


@lru_cache(maxsize=32)
def model_of(text: ModelText) -> Model:
    """The model, read once by each process."""
    with tempfile.TemporaryDirectory(dir=work_files.folder()) as folder:
        path = Path(folder) / text.name
        path.write_text(text.text, encoding="utf-8")
        return wg.load_model(path)


KEPT = ("key", "log", "status", "reason", "wall_s", "cpu_s", "bytes", "peak_mb")
"""What of a row goes back to where the batch was started."""


@dataclass(frozen=True)
class Task:
    """One log, the key of its row, and what identifies its content."""

    source: Source
    content: str
    key: str


def work(task: Task, plan: Plan, output: str) -> dict[str, Any]:
    """Do the command on one log and write its row; returns the row without its results."""
    wall, cpu = time.monotonic(), time.process_time()
    row, read = _empty(task, plan), ""
    try:
        with threadpool_limits(1), at_hand(task.source) as path:
            read = str(path)
            row |= _COMMANDS[plan.command](path, plan, plan.model_text(task.source.vehicle), task.source.vehicle)
        row["status"] = "ok"
    except Exception as error:
        row |= {"status": "failed", "reason": reason(error)}
        if read:  # a copy that is gone says nothing to anybody
            row["reason"] = row["reason"].replace(read, task.source.url)
    row |= {"wall_s": time.monotonic() - wall, "cpu_s": time.process_time() - cpu, "peak_mb": peak_mb()}
    return _stored(row, task, plan, output)


def failed(task: Task, plan: Plan, output: str, why: str) -> dict[str, Any]:
    """The row of a log that no worker survived."""
    return _stored({**_empty(task, plan), "status": "failed", "reason": why}, task, plan, output)


def _stored(row: dict[str, Any], task: Task, plan: Plan, output: str) -> dict[str, Any]:
    row["finished"] = datetime.now(UTC).isoformat(timespec="seconds")
    Store(output).add(row, task.source.vehicle, plan.number)
    return {name: row.get(name) for name in KEPT}


def _empty(task: Task, plan: Plan) -> dict[str, Any]:
    model = plan.model_text(task.source.vehicle)
    about = {"model": "", "model_sha256": ""} if model is None else {"model": model.name, "model_sha256": model.sha256}
    own = {"key": task.key, "log": task.source.url, "content": task.content, "bytes": task.source.size, "reason": ""}
    return {**own, **about, "command": plan.command, "version": tool_version(), "host": socket.gethostname()}


def reason(error: BaseException) -> str:
    """One line on what went wrong."""
    if isinstance(error, WrenchgapError):
        return str(error)
    if (removed := removed_kernels(error)) is not None:
        return removed
    if isinstance(error, MemoryError):
        return "out of memory; give the workers more, or fewer logs at a time with --workers"
    said = " ".join(str(error).split())
    if isinstance(error, OSError):
        return f"cannot be read: {error.strerror or said}"
    return f"internal error: {type(error).__name__}: {said}"


def peak_mb() -> float:
    """Most memory that this process has held [MB]."""
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used / (2**20 if sys.platform == "darwin" else 2**10)


def _text(result: Mapping[str, Any]) -> str:
    return json.dumps(plain(result), allow_nan=False)


def _open(path: Path, plan: Plan, text: ModelText | None) -> tuple[OpenFlight, Model, dict[str, Any]]:
    if text is None:
        raise UsageError("no model for this vehicle; name one with --model VEHICLE=MODEL")
    model = model_of(text)
    one = open_flight(path, model, **plan.reading)
    found = followed_flight(one)
    seconds = sum(len(r) * r.dt_kept for r in one.records)
    row = {"flight": one.flight.name, "start_ns": one.flight.start_ns, "seconds": float(seconds)}
    return one, model, {**row, "noise": plain(found.noise)}


def _inspect(path: Path, plan: Plan, text: ModelText | None, vehicle: str) -> dict[str, Any]:
    options = {k: v for k, v in plan.reading.items() if k != "between"}
    seen = wg.inspect(path, None if text is None else model_of(text), **options)
    found = plain(seen.to_json())
    checks = [*found["checks"], *found["model_checks"]]
    levels = [c["level"] for c in checks if not c["accepted"]]
    worst = next((level for level in ("bad", "warn") if level in levels), "ok")
    about = {"flight": path.stem, "start_ns": found["start_ns"], "seconds": found["duration_s"]}
    return {**about, "verdict": worst, "result": _text(found)}


def _compare(path: Path, plan: Plan, text: ModelText | None, vehicle: str) -> dict[str, Any]:
    one, model, row = _open(path, plan, text)
    found = wg.compare([one], model, ahead=False)
    rms = {"rms": plain(found.evaluations[-1].pooled.rms), "rms_nominal": plain(found.evaluations[0].pooled.rms)}
    fitted = fit_json(flight_values(one, model.without_tolerances, plan.names), followed_flight(one))
    return {**row, **rms, "fit": _text(fitted), "result": _text(found.to_json())}


def _explain(path: Path, plan: Plan, text: ModelText | None, vehicle: str) -> dict[str, Any]:
    one, model, row = _open(path, plan, text)
    found = evidence(one, model, plan.names, plan.points.get(vehicle))
    left = (found.power.sum(axis=0) / found.count.sum()) ** 0.5
    rms: list[float | None] = [None] * len(AXES)
    for k, axis in enumerate(found.axes):
        rms[int(axis)] = float(left[k])
    row |= {"rms": rms, "evidence": packed(found)}
    if plan.each:
        seen = wg.explain([one], model, names=plan.names, jobs=1)
        row |= {"verdict": str(seen.verdict), "result": _text(seen.to_json())}
    return row


def _changed(path: Path, plan: Plan, text: ModelText | None, vehicle: str) -> dict[str, Any]:
    one, model, row = _open(path, plan, text)
    assert text is not None
    good = _healthy(plan.healthy, text, json.dumps(dict(plan.reading)))
    found = wg.changed([one], list(good), model, names=plan.names, jobs=1)
    body = plain(found.to_json())
    return {**row, "verdict": str(body["verdict"]), "result": _text(body)}


@lru_cache(maxsize=4)
def _healthy(urls: tuple[str, ...], text: ModelText, reading: str) -> tuple[OpenFlight, ...]:
    """The healthy flights, opened once by each worker."""
    model, options = model_of(text), json.loads(reading)
    out = []
    for url in urls:
        with at_hand(Source(url, "", 0)) as path:
            out.append(open_flight(path, model, **options))
    return tuple(out)


_COMMANDS: dict[str, Callable[[Path, Plan, ModelText | None, str], dict[str, Any]]] = {
    "inspect": _inspect,
    "compare": _compare,
    "explain": _explain,
    "changed": _changed,
}
