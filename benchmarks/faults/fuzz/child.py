"""One turn of libFuzzer on one target.

python -m benchmarks.faults.fuzz.child TARGET FINDINGS [options of libFuzzer]

Compiled kernels have no branches that atheris could see, and instrumented ones cannot be compiled. So they run as
Python, where an index out of range is an error too; for the target `compiled` they are compiled and not instrumented.
"""

from __future__ import annotations

import hashlib
import os
import sys
import traceback
import warnings
from pathlib import Path
from typing import Any

COMPILED = sys.argv[1:2] == ["compiled"]
if not COMPILED:
    os.environ["NUMBA_DISABLE_JIT"] = "1"  # before numba is imported

import atheris  # noqa: E402

INCLUDE = ["wrenchgap.flight", "wrenchgap.plant", "wrenchgap.learn.process", "rosbags", "pyulog", "tomlkit"]
KERNELS = ["block_integrals", "filters", "formats.kernels", "row_kernels"]
EXCLUDE = [*(f"wrenchgap.flight.{name}" for name in KERNELS), "wrenchgap.plant.simulation.loop"]
with atheris.instrument_imports(include=INCLUDE, exclude=EXCLUDE if COMPILED else None):
    # all of it now: what is imported later, by a function, would not be seen
    import wrenchgap.flight
    import wrenchgap.flight.formats
    import wrenchgap.flight.inspection
    import wrenchgap.learn.process.store
    import wrenchgap.plant.model_file
    import wrenchgap.plant.trajectory.file  # noqa: F401
    from benchmarks.faults.fuzz.targets import TARGETS
    from wrenchgap.flight.formats import kernels

if not COMPILED:

    def copy_bytes(into: Any, at: int, data: Any, start: int, size: int) -> None:
        """What copies memory in compiled code, with the bounds that it does not look at."""
        flat = into.reshape(-1)
        if min(at, start, size) < 0 or at + size > len(flat) or start + size > len(data):
            raise IndexError(f"{size} bytes from {start} of {len(data)} to {at} of {len(flat)}")
        flat[at : at + size] = data[start : start + size]

    kernels.copy_bytes = copy_bytes


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
