"""Models that come with this package, and what `-m` takes for one of them or for a file."""

from pathlib import Path

from wrenchgap.flight.errors import ModelError, meant
from wrenchgap.plant.model import Model

_SHIPPED = Path(__file__).parents[2] / "models"


def find_model(name_or_path: str | Path) -> Path:
    """Path of a model file: as given, or a shipped model by its name."""
    path = Path(name_or_path)
    if path.is_file():
        return path
    if str(name_or_path) in shipped_models():  # also where a folder of logs has that name
        return _SHIPPED / f"{name_or_path}.toml"
    if path.is_dir():
        raise ModelError(f"{path}: is a folder, expected a model file (.toml)")
    raise ModelError(
        f"{name_or_path}: no such model file{meant(str(name_or_path), shipped_models())}; give a path to a .toml file "
        "or one of the shipped models: "
        f"{', '.join(shipped_models())}"
    )


def is_model(name_or_path: str) -> bool:
    """Whether `find_model` finds it."""
    return Path(name_or_path).is_file() or name_or_path in shipped_models()


def shipped_models() -> list[str]:
    """Names of the models that come with this package."""
    return sorted(path.stem for path in _SHIPPED.glob("*.toml"))


def as_argument(model: Model) -> str:
    """What `-m` takes for a model: the name of a shipped one, the path of a file."""
    path = model.path
    return path.stem if path is not None and path.parent == _SHIPPED else str(path or model.name)
