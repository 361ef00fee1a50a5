"""Model files: TOML, checked whole on reading, comments kept on writing. Their keys: docs/model-file.md."""

from dataclasses import replace
from pathlib import Path

from wrenchgap.flight.atomic import atomic
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file.reading import loads as loads
from wrenchgap.plant.model_file.shipped import as_argument as as_argument
from wrenchgap.plant.model_file.shipped import find_model as find_model
from wrenchgap.plant.model_file.shipped import is_model as is_model
from wrenchgap.plant.model_file.shipped import shipped_models as shipped_models
from wrenchgap.plant.model_file.writing import changed_since as changed_since
from wrenchgap.plant.model_file.writing import content_hash as content_hash
from wrenchgap.plant.model_file.writing import dumps as dumps
from wrenchgap.plant.model_file.writing import next_version as next_version
from wrenchgap.plant.model_file.writing import provenance_now as provenance_now
from wrenchgap.plant.model_file.writing import tool_version as tool_version
from wrenchgap.plant.model_file.writing import utc_now as utc_now
from wrenchgap.plant.model_file.writing import with_reading as with_reading
from wrenchgap.plant.reader import text_of


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
