"""Builds the wheel, installs it into a new environment outside the repository and uses it there.

What it shows: the command starts, `wrenchgap` is the only name that is installed, the shipped models are found by
name, and nothing comes from the repository.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import venv
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOCK = ROOT / "requirements.lock"

MODELS = sorted(path.stem for path in (ROOT / "models").glob("*.toml"))
FOLDERS = sorted(path.name for path in (ROOT / "src" / "wrenchgap").iterdir() if path.is_symlink())

USE = f"""
from importlib.metadata import files
from importlib.util import find_spec
from pathlib import Path
import wrenchgap
from wrenchgap.plant import model_file
assert not Path(wrenchgap.__file__).is_relative_to({str(ROOT)!r}), wrenchgap.__file__
tops = {{path.parts[0] for path in files("wrenchgap")}} - {{".."}}  # .. is bin/
assert {{top for top in tops if not top.endswith(".dist-info")}} == {{"wrenchgap"}}, tops
for name in {FOLDERS!r}:
    assert (Path(wrenchgap.__file__).parent / name).is_dir(), f"{{name}} is not in the wheel"
    assert find_spec(name) is None, f"{{name}} is a name of its own"
for name in {MODELS!r}:
    model = model_file.load(name)
    print(f"{{name}}: {{model.vehicle.body.mass}} kg, from {{model_file.find_model(name)}}")
"""


def run(*command: str | Path, cwd: Path) -> None:
    """Runs a command that must succeed, without the repository on Python's path."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    subprocess.run([str(part) for part in command], cwd=cwd, env=environment, check=True)


def main() -> None:
    """Leaves the wheel in dist/; raises CalledProcessError where a step fails."""
    pip = ("-m", "pip", "-qq", "--disable-pip-version-check")
    with tempfile.TemporaryDirectory(prefix="wrenchgap-wheel-") as folder:
        outside = Path(folder)
        pinned = outside / "constraints.txt"  # a hash of a constraint asks for one of the wheel, too
        pinned.write_text("\n".join(re.findall(r"^\S+==[^\\\n]*", LOCK.read_text(), re.MULTILINE)) + "\n")
        run(sys.executable, *pip, "wheel", "--no-deps", "--build-constraint", pinned, "-w", outside, ROOT, cwd=outside)
        (wheel,) = outside.glob("wrenchgap-*.whl")
        venv.create(outside / "env", with_pip=True)
        python = outside / "env" / "bin" / "python"
        run(python, *pip, "install", f"pip=={version('pip')}", cwd=outside)
        run(python, *pip, "install", "--build-constraint", pinned, "--constraint", pinned, wheel, cwd=outside)
        run(outside / "env" / "bin" / "wrenchgap", "--help", cwd=outside)
        run(python, "-c", USE, cwd=outside)
        (ROOT / "dist").mkdir(exist_ok=True)
        shutil.copy(wheel, ROOT / "dist")
        print(f"dist/{wheel.name}: installs, starts and loads the shipped models outside the repository")


if __name__ == "__main__":
    main()
