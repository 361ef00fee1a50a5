"""Compile the kernels that numba has not kept yet, once and on two cores, before pytest's workers would do so each.

    python scripts/warm_kernels.py

A new clone takes a minute of processor time for it, a second time hardly more than the imports
(docs/decisions/0026-compiled-kernels.md). `make test` and `make slow` begin with it.
"""

import subprocess
import sys

COMPENSATING = "from wrenchgap.compensate.fast import warm; warm()"
ANALYSING = """
import tempfile
from pathlib import Path
import wrenchgap as wg

model = wg.load_model("tilt_hexarotor")
flown = wg.simulate(model, "multi_axis", duration=30.0, excitation=1.0, hide=["com_offset=x:0.004"])
with tempfile.TemporaryDirectory() as folder:
    path = wg.save_log(flown, Path(folder) / "flight.mcap")
    wg.inspect(path, model)
    names = ("com_offset", "rotor_thrust", "rotor_drag", "axial_inflow", "servo_lag", "asymmetric_motor_lag")
    opened = wg.open_flights(path, model)
    wg.explain(opened, model, names=names, jobs=1)
    wg.learn_gp(opened, model)
"""


def main() -> int:
    """The worst exit code of both processes."""
    running = [subprocess.Popen([sys.executable, "-c", code]) for code in (COMPENSATING, ANALYSING)]
    return max(process.wait() for process in running)


if __name__ == "__main__":
    sys.exit(main())
