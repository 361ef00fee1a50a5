"""What is done with every log of a batch, in plain values that travel to any worker."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import tool_version
from wrenchgap.replay import api

COMMANDS = ("inspect", "compare", "explain", "changed")


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

    def next_pass(self, points: Mapping[str, Mapping[str, Any]]) -> Plan:
        """The same with candidates linearised elsewhere."""
        return replace(self, points=points, number=self.number + 1)


def model_text(name: str) -> ModelText:
    """A shipped model, or a file. Raises ModelError for what is no model."""
    found = api.load_model(name)
    assert found.path is not None
    return ModelText(found.path.name, found.path.read_text(encoding="utf-8"))


def models_by_vehicle(texts: tuple[str, ...] | list[str]) -> dict[str, ModelText]:
    """`["crazyflie", "big=octo.toml"]`: the model of all vehicles, and of some by name. Raises UsageError."""
    out: dict[str, ModelText] = {}
    for text in texts:
        vehicle, equals, name = text.rpartition("=")
        if vehicle in out:
            raise UsageError(f"--model {text}: {vehicle or 'all vehicles'} have a model already; say it once")
        if equals and not vehicle:
            raise UsageError(f"--model {text}: expected MODEL or VEHICLE=MODEL")
        out[vehicle] = model_text(name)
    return out


@lru_cache(maxsize=32)
def model_of(text: ModelText) -> Model:
    """The model, read once by each process."""
    with tempfile.TemporaryDirectory(prefix="wrenchgap-") as folder:
        path = Path(folder) / text.name
        path.write_text(text.text, encoding="utf-8")
        return api.load_model(path)
