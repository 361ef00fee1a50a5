"""What is typed after an option: completed by the shell, and read as a value.

Each `parse_` raises UsageError for what it does not understand. What needs the package is imported late, because a tab
and `--help` must be quick.
"""

import ast
import math
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import TypeVar

from wrenchgap._escaping import completable

T = TypeVar("T")


def usage_error(text: str) -> Exception:
    """What to raise where an option cannot be used; imported late, because `--help` must be quick."""
    from wrenchgap.flight.errors import UsageError

    return UsageError(text)


def check_ending(path: Path, what: str, ending: str, others: str = "") -> None:
    """Raise UsageError for an --output whose name does not end as `what` is written."""
    if path.suffix != ending:
        raise usage_error(f"--output {path}: {what}; expected a name that ends in {ending}{others}")


def parse_cutoff(hz: float) -> float:
    """The cut-off [Hz], if it is one; raises UsageError."""
    if not (math.isfinite(hz) and hz > 0):
        raise usage_error(f"--cutoff {hz:g}: expected a positive number of Hz, e.g. 8")
    return hz


def parse_between(texts: Sequence[str] | None) -> tuple[tuple[float, float], ...] | None:
    """`["5:40"]` as ((5.0, 40.0),), either side may be left open; raises UsageError on anything else."""
    found = []
    for text in texts or ():
        first, colon, last = text.partition(":")
        try:
            start, stop = float(first or "-inf"), float(last or "inf")
        except ValueError:
            start = stop = float("nan")
        if not colon or not start < stop:
            raise usage_error(f"--between {text}: expected T0:T1 in seconds with T0 before T1, e.g. --between 5:40")
        found.append((start, stop))
    return tuple(found) or None


def parse_numbers(option: str, text: str, expected: str, count: int | None = None) -> tuple[float, ...]:
    """`"0.1,0.5"` as (0.1, 0.5), so many as `count`; raises UsageError on anything but numbers."""
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if not found or count not in (None, len(found)):
        raise usage_error(f"{option} {text}: expected {expected}")
    return found


def parse_shifts(texts: Sequence[str] | None) -> dict[str, float]:
    """`["odometry=-0.012"]` as `{"odometry": -0.012}`; raises UsageError on anything else."""

    def seconds(text: str) -> float | None:
        try:
            return float(text) if math.isfinite(float(text)) else None
        except ValueError:
            return None

    return _by_role("--shift", texts, seconds, "ROLE=SECONDS, e.g. --shift odometry=-0.0123")


def parse_topics(texts: Sequence[str] | None) -> dict[str, str]:
    """`["imu=/my/imu"]` as `{"imu": "/my/imu"}`; raises UsageError on anything else."""
    return _by_role("--topic", texts, lambda topic: topic or None, "ROLE=/TOPIC, e.g. --topic imu=/my/imu")


def _by_role(option: str, texts: Sequence[str] | None, read: Callable[[str], T | None], expected: str) -> dict[str, T]:
    found: dict[str, T] = {}
    for text in texts or ():
        role, _, given = text.partition("=")
        value = read(given)
        if not role or value is None:
            raise usage_error(f"{option} {text}: expected {expected}")
        if role in found:
            raise usage_error(f"{option} {role}: given twice; say it once")
        found[role] = value
    return found


def parse_budget(text: str | None) -> str | None:
    """A memory, a time or both, as it is; raises UsageError for others."""
    if text is not None:
        from wrenchgap.flight.budget import Budget

        Budget.of(text)
    return text


def parse_effects(text: str | None) -> tuple[str, ...]:
    """`"a,b"` as names of effects; raises ModelError for one that is not in the catalogue."""
    from wrenchgap.plant.effects import find

    return tuple(find(name).name for name in parse_names(text))


def parse_outputs(text: str) -> tuple[str, ...]:
    """`torque`, `wrench`, or names of axes separated by commas; raises UsageError on anything else."""
    from wrenchgap.flight.flight import AXES

    if text in ("torque", "wrench"):
        return AXES[3:] if text == "torque" else AXES
    names = parse_names(text)
    wrong = [n for n in names if n not in AXES]
    if wrong or not names or len(set(names)) < len(names):
        raise usage_error(f"--outputs {text}: expected torque, wrench, or different names out of {', '.join(AXES)}")
    return names


def parse_names(text: str | None) -> tuple[str, ...]:
    """`"a,b"` as `("a", "b")`; raises UsageError for a text that names nothing, or one thing twice."""
    names = tuple(part.strip() for part in (text or "").split(",") if part.strip())
    if text is not None and not 0 < len(set(names)) == len(names):
        raise usage_error(
            f"{text!r}: names nothing, or one twice; expected names divided by commas, e.g. mass,com_offset"
        )
    return names


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
        if path.stem == "by_part":  # not in the catalogue
            continue
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
