"""Time by the clock of the first `demo` and the first `explain` on a machine, which compile, beside later ones.

    python -m benchmarks.cold_start             # a table; nothing is written
    python -m benchmarks.cold_start --page      # and docs/performance.md

Each is begun with an empty cache of compiled code, in processes of its own: as after `pip install`, and after
`scripts/warm_kernels.py`, with which `make setup` ends. `explain` is that of the demo's log of 40 s.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks import pages

COMMANDS = {"demo": ("demo", "--force"), "explain": ("explain", "demo-output/train.mcap", "-m", "tilt_hexarotor")}
WARM = Path(__file__).parents[1] / "scripts" / "warm_kernels.py"


def taken(command, folder, cache):
    """Seconds of a program of Python."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    start = time.perf_counter()
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.run([sys.executable, *command], cwd=folder, env=environment, check=True, **quiet)
    return time.perf_counter() - start


def rows():
    """What was measured, as it comes."""
    with tempfile.TemporaryDirectory() as folder:
        for label, command in COMMANDS.items():
            empty, warm = (Path(folder) / f"{label}-{kind}" for kind in ("empty", "warm"))
            run = ("-m", "wrenchgap", *command)
            yield {
                "command": label,
                "first_s": taken(run, folder, empty),
                "second_s": taken(run, folder, empty),
                "warming_s": taken((str(WARM),), folder, warm),
                "warmed_s": taken(run, folder, warm),
            }


def table(found, load):
    """In Markdown."""
    lines = [
        (r["command"], f"{r['first_s']:.0f}", f"{r['second_s']:.1f}", f"{r['warming_s']:.0f}", f"{r['warmed_s']:.1f}")
        for r in found
    ]
    return pages.markdown(("command", "first, s", "second, s", "warming, s", "first after it, s"), lines, load)


def main():
    """Measure; with --page, renew the page."""
    asked = pages.options(__doc__).parse_args()
    pages.measure(asked, "cold-start", rows(), table)


if __name__ == "__main__":
    main()
