"""Opens one file as the commands do, and says what came of it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

LONGEST = 2000
"""Characters of a refusal that count as one line: a list of a file's topics is long."""


class Outcome(StrEnum):
    """What came of a file."""

    WHOLE = "whole"  # the same numbers as of the intact file
    RECOVERED = "recovered"  # other numbers, and something is said that the intact file does not make it say
    ALTERED = "altered"  # as many samples, other numbers, nothing said: a number was changed into another number
    SHORTER = "shorter"  # fewer samples and nothing said: the format does not tell how many there were
    REFUSED = "refused"  # one line
    FAULT = "fault"  # another exception, several lines, too long, too much memory, or the process died


@dataclass(frozen=True)
class Opened:
    """What a file gave: a digest of its numbers, how many samples, and what was said of it."""

    digest: str
    samples: int
    said: frozenset[str]


def opened(kind: str, path: Path) -> Opened:
    """Open a file of a form; whatever its reader raises goes on."""
    return (OPENERS.get(kind) or _log)(path)


def judged(kind: str, path: Path, intact: Opened) -> tuple[Outcome, str]:
    """The outcome for a file that may be damaged, and its error where there is one."""
    from wrenchgap.flight.errors import WrenchgapError

    try:
        found = opened(kind, path)
    except WrenchgapError as error:
        text = str(error)
        fine = text and "\n" not in text and len(text) <= LONGEST
        return (Outcome.REFUSED, text) if fine else (Outcome.FAULT, f"refused in more than one line: {text[:300]!r}")
    except OSError as error:  # the command line says these in one line, by their file
        text = f"{error.filename}: {error.strerror}"
        return (Outcome.REFUSED, text) if error.filename is not None else (Outcome.FAULT, _traced(error))
    except BaseException as error:
        return Outcome.FAULT, _traced(error)
    if found.digest == intact.digest:
        return Outcome.WHOLE, ""
    if found.said - intact.said:
        return Outcome.RECOVERED, ""
    return (Outcome.SHORTER if found.samples < intact.samples else Outcome.ALTERED), ""


def _traced(error: BaseException) -> str:
    """The exception with where it came from, innermost last."""
    import traceback

    frames = traceback.extract_tb(error.__traceback__)[-4:]
    places = " < ".join(f"{Path(f.filename).name}:{f.lineno} {f.name}" for f in reversed(frames))
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]} | {places}"


def _log(path: Path) -> Opened:
    """As `wrenchgap inspect` without a model."""
    from wrenchgap import flight

    found = flight.inspect(path)
    digest, samples = hashlib.sha256(), 0
    for topic in found.topics:
        samples += topic.count
    series = found.flight.series() if found.flight is not None else {}
    for role, one in sorted(series.items()):
        for name, value in sorted(vars(one).items()):
            if isinstance(value, np.ndarray):
                digest.update(f"{role}.{name}".encode() + np.ascontiguousarray(value).tobytes())
    digest.update(repr([(t.topic, t.count) for t in found.topics]).encode())
    said = set(found.notes) | {t.problem for t in found.topics if t.problem}
    said |= {f"{check.name} {check.level}" for check in found.checks if check.level != "ok"}
    dropped = {f"{t.topic} {reason} {count}" for t in found.topics for reason, count in t.dropped.items() if count}
    gaps = {f"{t.topic}: {t.gaps} gaps" for t in found.topics if t.gaps}
    return Opened(digest.hexdigest(), samples, frozenset(said | dropped | gaps))


def _log_for_model(path: Path) -> Opened:
    """As every command opens a log: the checks against a model, resampled, filtered."""
    from wrenchgap.learn.data.opening import open_flights
    from wrenchgap.learn.diagnose.model_checks import inspect
    from wrenchgap.plant import model_file

    model = model_file.load("crazyflie")
    found = _log(path)
    inspect(path, model)
    open_flights([path], model)
    return found


def _digest(*parts: Any) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def _model(path: Path) -> Opened:
    from wrenchgap.flight.roles import selection
    from wrenchgap.plant import model_file

    model = model_file.load(path)
    if model.topics:
        selection(model.topics)
    text = "\n".join(line for line in model_file.dumps(model).splitlines() if not line.lstrip().startswith("#"))
    return Opened(_digest(text), 1, frozenset(model.notes))


def _process(path: Path) -> Opened:
    from wrenchgap.learn.process import store

    gp = store.load(path)
    query = np.random.default_rng(0).normal(size=(5, len(gp.input_mean)))
    values = gp.mean(query).tobytes(), gp.std(query).tobytes()
    return Opened(_digest(values, gp.settings, gp.provenance), len(gp.inputs), frozenset())


def _trajectory(path: Path) -> Opened:
    from wrenchgap.plant.trajectory import file as trajectory_file

    file = trajectory_file.load(path)
    return Opened(_digest(file.trajectory, file.name, file.vehicle, file.purpose), 1, frozenset())


def _description(path: Path) -> Opened:
    """As `wrenchgap model new --from`, of which the log readers' part is in the other forms."""
    from wrenchgap.plant.drafts.draft import completed
    from wrenchgap.plant.drafts.model_text import text_of
    from wrenchgap.plant.drafts.sources import Given, draft_of_source
    from wrenchgap.plant.model_file import loads

    drawn = completed(draft_of_source(path, Given(mass=1.2, arm=0.2)))
    text = text_of(drawn, ("",))
    loads(text)
    return Opened(_digest(text), 1, frozenset(drawn.notes))


OPENERS: dict[str, Callable[[Path], Opened]] = {
    "for model": _log_for_model,
    "model": _model,
    "mapping": _model,
    "trajectory": _trajectory,
    "gp": _process,
    "parameters": _description,
    "sdf": _description,
    "urdf": _description,
    "mjcf": _description,
}
"""By form, what opens it; every other form is a log."""
