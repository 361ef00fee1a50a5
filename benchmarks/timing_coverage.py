"""How often the 95 % intervals of `timing` hold the true offset, on flights of which it is known.

    python -m benchmarks.timing_coverage          # prints a table; minutes

Flights of MuJoCo (`benchmarks.meaning.flying`) and of `wrenchgap.simulate`, 15 to 20 s, from hardly any excitation to a
lot. Every topic is stamped when it was true, but MuJoCo's IMU one physics step later: its sensors are those of the
beginning of the step after which they are read. Then the odometry is moved by up to 15 ms either way.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

import wrenchgap as wg
from benchmarks.meaning.flying import NANO, QUAD, Manner, fly
from wrenchgap.flight.flight import Flight
from wrenchgap.flight.shift import shifted
from wrenchgap.flight.topic_offsets import sensor_offsets

MANNERS = (Manner(), Manner(excitation=0.3), Manner(excitation=0.3, reach=0.4), Manner(noise=4.0))
TRAJECTORIES = (("pitch", 0.0), ("multi_axis", 0.0), ("figure8", 0.0), ("hover", 0.0), ("hover", 1.0), ("hover", 0.3))
IMU_LATE = {"MuJoCo": 1e-3, "simulate": 0.0}
"""[s]"""


def flights(seeds: int, only: str) -> Iterator[tuple[str, Flight]]:
    """Kind and flight."""
    model = wg.load_model("tilt_hexarotor")
    for seed in range(seeds):
        for manner in MANNERS if only != "simulate" else ():
            for craft in (QUAD, NANO):
                yield "MuJoCo", fly(craft, 16.0, 100 + seed, manner)
        for trajectory, excitation in TRAJECTORIES if only != "MuJoCo" else ():
            yield "simulate", wg.simulate(model, trajectory, duration=16.0, excitation=excitation, seed=100 + seed)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--only", default="", help="MuJoCo or simulate")
    asked = parser.parse_args()
    rng = np.random.default_rng(1)
    rows: dict[tuple[str, str], list[tuple[bool, float] | None]] = {}
    for kind, flight in flights(asked.seeds, asked.only):
        by = float(rng.uniform(-0.015, 0.015))
        for found in sensor_offsets(shifted(flight, {"odometry": by})):
            own = found.first.startswith("odometry") and found.second.startswith("odometry")
            place = rows.setdefault((kind, f"{found.second} behind {found.first}"), [])
            if found.seconds is None or found.interval is None:
                place.append(None)
            else:
                error = abs(found.seconds - (0.0 if own else by - IMU_LATE[kind]))
                place.append((error <= found.interval, found.interval))
    every = [r for place in rows.values() for r in place]
    for (kind, pair), place in rows.items():
        print(f"{kind:9s} {pair:42s} {_said(place)}")
    print(f"{'all':52s} {_said(every)}")


def _said(place: list[tuple[bool, float] | None]) -> str:
    told = [r for r in place if r is not None]
    if not told:
        return f"nothing said of {len(place)}"
    held, width = sum(r[0] for r in told), 1e3 * float(np.median([r[1] for r in told]))
    return f"{held}/{len(told)} = {100 * held / len(told):.0f} % held, median +-{width:.2g} ms, of {len(place)} flights"


if __name__ == "__main__":
    main()
