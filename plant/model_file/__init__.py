"""Model files: TOML, checked whole on reading, comments kept on writing. Their keys: docs/model-file.md."""

from dataclasses import replace
from pathlib import Path

from wrenchgap.flight.atomic import atomic
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file.reading import loads
from wrenchgap.plant.model_file.writing import (
    changed_since,
    content_hash,
    dumps,
    next_version,
    tool_version,
    with_reading,
)
from wrenchgap.plant.reader import text_of

__all__ = [
    "as_argument",
    "changed_since",
    "content_hash",
    "dumps",
    "find_model",
    "load",
    "loads",
    "next_version",
    "save",
    "shipped_models",
    "tool_version",
    "with_reading",
]

_SHIPPED = Path(__file__).parents[2] / "models"


def find_model(name_or_path: str | Path) -> Path:
    """Path of a model file: as given, or a shipped model by its name."""
    path = Path(name_or_path)
    if path.is_file():
        return path
    if path.is_dir():
        raise ModelError(f"{path}: is a folder, expected a model file (.toml)")
    if str(name_or_path) in shipped_models():
        return _SHIPPED / f"{name_or_path}.toml"
    raise ModelError(
        f"{name_or_path}: no such model file; give a path to a .toml file or one of the shipped models: "
        f"{', '.join(shipped_models())}"
    )


def shipped_models() -> list[str]:
    """Names of the models that come with this package."""
    return sorted(path.stem for path in _SHIPPED.glob("*.toml"))


def as_argument(model: Model) -> str:
    """What `-m` takes for a model: the name of a shipped one, the path of a file."""
    path = model.path
    return path.stem if path is not None and path.parent == _SHIPPED else str(path or model.name)


def load(name_or_path: str | Path) -> Model:
    """Read and check a model file, or a shipped model by its name."""
    path = find_model(name_or_path)
    text = text_of(path, "as a model file")
    try:
        return replace(loads(text, path.parent), path=path)
    except ModelError as error:
        raise ModelError(f"{path.name}: {error}") from None


def save(model: Model, path: Path, *, force: bool = False) -> Model:
    """Write a model file and return the model with its path; does not overwrite without `force`.

    Raises ModelError for a model whose file could not be read again: nothing is written then.
    """
    if path.exists() and not force:
        raise UsageError(f"{path}: exists already; choose another name or say --force to overwrite it")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: the folder {path.parent} does not exist; make it first")
    text = dumps(model)
    try:
        loads(text)
    except ModelError as error:
        raise ModelError(f"{path}: not written, since it could not be read again: {error}") from None
    with atomic(path) as partial:
        partial.write_text(text, encoding="utf-8")
    return replace(model, path=path, text=text)
