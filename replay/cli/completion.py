"""What the shell completes: models, effects, trajectories, roles, checks, phases."""

from __future__ import annotations

import ast
from importlib.metadata import entry_points
from pathlib import Path

from wrenchgap._escaping import completable

ROLES = (
    *("commanded", "desired", "actuators", "tilt", "rotor_speed", "imu", "gyroscope", "accelerometer"),
    *("odometry", "pose", "twist"),
    *("reference", "reference_pose", "reference_twist", "reference_acceleration", "battery"),
)
"""What a topic can be mapped to: roles and their parts (`flight.roles`)."""

_ROOT = Path(__file__).parents[2]


def complete_models(incomplete: str) -> list[str]:
    """Shipped models by name, and model files in the folder that is being typed."""
    shipped = {p.stem for p in (_ROOT / "models").glob("*.toml")}
    folder = Path(incomplete).parent if "/" in incomplete else Path()
    files = {str(p) for p in folder.glob("*.toml")} if folder.is_dir() else set()
    return sorted(name for name in shipped | files if name.startswith(incomplete) and completable(name))


def complete_effects(incomplete: str) -> list[tuple[str, str]]:
    """Effects of the catalogue with their first line; read from the sources, because a tab must answer at once."""
    found = []
    for path in sorted((_ROOT / "plant" / "effects").glob("*.py")):
        for item in ast.parse(path.read_text(encoding="utf-8")).body:
            name = _class_name(item)
            if name.startswith(incomplete) and name and isinstance(item, ast.ClassDef):
                found.append((name, (ast.get_docstring(item) or "").split("\n")[0]))
    return found + [(p.name, "") for p in entry_points(group="wrenchgap.effects") if p.name.startswith(incomplete)]


def _class_name(item: ast.stmt) -> str:
    """The text that a class gives to its attribute `name`, or nothing."""
    for line in item.body if isinstance(item, ast.ClassDef) else ():
        if isinstance(line, ast.Assign) and ast.unparse(line.targets[0]) == "name":
            return str(line.value.value) if isinstance(line.value, ast.Constant) else ""
    return ""


def complete_trajectories(incomplete: str) -> list[str]:
    """Trajectories by name, read from the source likewise; and files, where a path is being typed."""
    if "/" in incomplete or incomplete.endswith(".toml"):
        files = map(str, Path(incomplete).parent.glob("*.toml"))
        return sorted(name for name in files if name.startswith(incomplete) and completable(name))
    source = ast.parse((_ROOT / "plant" / "trajectory" / "__init__.py").read_text(encoding="utf-8"))
    tables = [i.value for i in source.body if isinstance(i, ast.AnnAssign) and ast.unparse(i.target) == "TRAJECTORIES"]
    keys = [key for table in tables if isinstance(table, ast.Dict) for key in table.keys]
    names = [str(key.value) for key in keys if isinstance(key, ast.Constant)]
    return [name for name in names if name.startswith(incomplete)]


def complete_topics(incomplete: str) -> list[str]:
    """Roles and their parts, each with its equals sign."""
    return [f"{name}=" for name in ROLES if name.startswith(incomplete)]


def complete_checks(incomplete: str) -> list[tuple[str, str]]:
    """Checks by name, and what they look at."""
    from wrenchgap.flight.check import NAMES

    return [(name, what) for name, what in NAMES.items() if name.startswith(incomplete)]


def complete_phases(incomplete: str) -> list[tuple[str, str]]:
    """Phases of a flight that are left out, by name, and what they are."""
    from wrenchgap.learn.data.phases.phase import EVERY, NAMES

    every = {**NAMES, EVERY: "all of them"}
    return [(name, what) for name, what in every.items() if name.startswith(incomplete)]
