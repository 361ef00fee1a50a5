"""One turn of libFuzzer on one target.

python -m benchmarks.faults.fuzz.child TARGET FINDINGS [options of libFuzzer]
"""

from __future__ import annotations

import hashlib
import sys
import traceback
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(
    include=["wrenchgap.flight", "wrenchgap.plant", "wrenchgap.learn.process", "rosbags", "pyulog", "tomlkit"]
):
    # all of it now: what is imported later, by a function, would not be seen
    import wrenchgap.flight
    import wrenchgap.flight.formats
    import wrenchgap.flight.inspection
    import wrenchgap.learn.process.store
    import wrenchgap.plant.model_file
    import wrenchgap.plant.trajectory_file  # noqa: F401
    from benchmarks.faults.fuzz.targets import TARGETS


def main() -> None:
    """Fuzz until the time is over; an error is written down once for each place where it is raised."""
    name, findings, *options = sys.argv[1:]
    target, folder = TARGETS[name], Path(findings)
    folder.mkdir(parents=True, exist_ok=True)
    warnings.filterwarnings("error", category=RuntimeWarning, module=r"wrenchgap\.")

    def once(data: bytes) -> None:
        try:
            target(data)
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            places = [f"{f.filename}:{f.lineno}" for f in frames[-3:]]
            key = hashlib.sha256(f"{type(error).__name__} {places}".encode()).hexdigest()[:12]
            file = folder / f"{name}-{type(error).__name__}-{key}"
            if not file.exists():
                file.write_bytes(data)
                text = "".join(traceback.format_exception(error))
                file.with_suffix(".txt").write_text(text, encoding="utf-8")

    atheris.Setup([sys.argv[0], *options], once)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
