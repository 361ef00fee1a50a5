"""How long `explain` takes on a ten-minute log at 200 Hz against the whole catalogue.

    python -m benchmarks.explain_speed [--minutes 10] [--profile N] [--json FILE]

The log is one simulated minute (tilt_hexarotor, multi-axis excitation, a hidden centre-of-mass offset and servo lag)
with fresh sensor noise for every repetition, a second of silence between them. Wall and CPU seconds are printed beside
those of reading the log, and the ratio; the goal is 60 s of wall time on 2 cores. --hide replaces what is hidden
(repeat it; what is hard to name takes longer). --profile prints the N functions in which most time goes; it works on
one core, since a profile does not see into workers. --jobs sets how many work otherwise (default: all cores).
"""

import argparse
import cProfile
import json
import os
import pstats
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from wrenchgap import flight
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.parallel import cores
from wrenchgap.learn.posterior.explain import explain
from wrenchgap.plant import model_file
from wrenchgap.plant.flight_plan import Plan, fly
from wrenchgap.plant.sensors import imu_errors
from wrenchgap.replay.cli.console import progress

HIDDEN = ("com_offset=x:-0.004,y:0.007,z:-0.005", "servo_lag=tau:0.03")
MINUTE = 60.0
SILENCE = 1.0  # s


def long_flight(minutes, hidden):
    """A flight of that many minutes with hidden effects."""
    believed = model_file.load("tilt_hexarotor")
    made = fly(Plan(believed, "multi_axis", MINUTE, 1.0, 1, None, tuple(hidden)), name="long")
    rng = np.random.default_rng(5)
    series = {role: [] for role in made.series()}
    for k in range(minutes):
        for role, item in made.series().items():
            item = replace(item, time=item.time + k * (MINUTE + SILENCE))
            if role == "imu" and k:
                noise = imu_errors(believed.sensors, len(item.time), rng)
                item = replace(
                    item, omega_B=item.omega_B + noise[:, :3], specific_force_B=item.specific_force_B + noise[:, 3:]
                )
            series[role].append(item)
    return replace(made, **{role: joined(parts) for role, parts in series.items()})


def joined(parts):
    """Series one after the other."""
    arrays = {name for name, value in vars(parts[0]).items() if isinstance(value, np.ndarray)}
    return replace(parts[0], **{name: np.concatenate([getattr(p, name) for p in parts]) for name in arrays})


def clock():
    """Wall and CPU seconds, the CPU of finished workers included."""
    return np.array((time.perf_counter(), sum(os.times()[:4])))


def since(start):
    """What has passed, by name."""
    return dict(zip(("wall_s", "cpu_s"), (clock() - start).tolist(), strict=True))


def main():
    """Make the log, read it, explain it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=int, default=10)
    parser.add_argument("--hide", action="append", metavar="EFFECT=P:V,...")
    parser.add_argument("--profile", type=int, default=0, metavar="N", help="print the N costliest functions")
    parser.add_argument("--jobs", type=int, default=cores())
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    model = model_file.load("tilt_hexarotor")
    with tempfile.TemporaryDirectory() as folder:
        path = flight.write(long_flight(options.minutes, options.hide or HIDDEN), Path(folder) / "long.mcap")
        size = path.stat().st_size
        start = clock()
        opened = open_flight(path, model)
        reading = since(start)
    jobs = 1 if options.profile else options.jobs
    profiler = cProfile.Profile()
    start = clock()
    with progress("explaining") as report:
        if options.profile:
            profiler.enable()
        found = explain([opened], model, jobs=jobs, progress=report)
        profiler.disable()
    explaining = since(start)
    ratio = explaining["cpu_s"] / reading["cpu_s"]
    samples = sum(map(len, opened.records))
    print(f"log: {options.minutes} min, {size / 1e6:.0f} MB, {samples} compared samples, {jobs} at work")
    for words, seconds in (("reading", reading), ("explaining", explaining)):
        print(f"{words:10s} {seconds['wall_s']:7.1f} s wall {seconds['cpu_s']:7.1f} s CPU")
    print(f"explaining takes {ratio:.1f} times the CPU of reading; verdict {found.verdict}: {', '.join(found.effects)}")
    if options.profile:
        pstats.Stats(profiler).sort_stats("tottime").print_stats(options.profile)
        pstats.Stats(profiler).sort_stats("cumtime").print_stats(options.profile)
    if options.json:
        body = {"minutes": options.minutes, "jobs": jobs, "reading": reading, "explaining": explaining}
        body |= {"ratio_cpu": ratio, "verdict": found.verdict, "effects": list(found.effects)}
        options.json.write_text(json.dumps(body, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
