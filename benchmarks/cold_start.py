"""Time by the clock of the first `demo` and the first `explain` on a machine, which compile, beside the second.

    python -m benchmarks.cold_start             # a table; nothing is written
    python -m benchmarks.cold_start --page      # and docs/performance.md

Every pair begins with an empty cache of compiled code, in processes of its own. `explain` is that of the demo's log of
40 s. Set-up (`make setup`) is not counted.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks import pages

COMMANDS = {"demo": ("demo", "--force"), "explain": ("explain", "demo-output/train.mcap", "-m", "tilt_hexarotor")}


def rows():
    """What was measured, as it comes."""
    with tempfile.TemporaryDirectory() as folder:
        for label, command in COMMANDS.items():
            environment = os.environ | {"NUMBA_CACHE_DIR": str(Path(folder) / f"cache-{label}")}
            taken = []
            for _ in range(2):
                start = time.perf_counter()
                subprocess.run(
                    [sys.executable, "-m", "wrenchgap", *command],
                    cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True,
                )  # fmt: skip
                taken.append(time.perf_counter() - start)
            yield {"command": label, "first_s": taken[0], "second_s": taken[1]}


def table(found, load):
    """In Markdown."""
    lines = [
        (r["command"], f"{r['first_s']:.0f}", f"{r['second_s']:.1f}", f"{r['first_s'] / r['second_s']:.1f}")
        for r in found
    ]
    return pages.markdown(("command", "first, s", "second, s", "ratio"), lines, load)


def main():
    """Measure; with --page, renew the page."""
    asked = pages.options(__doc__).parse_args()
    pages.measure(asked, "cold-start", rows(), table)


if __name__ == "__main__":
    main()
