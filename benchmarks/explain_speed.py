"""How long `explain` takes on a ten-minute log at 200 Hz against the whole catalogue, on one core and on several.

    python -m benchmarks.explain_speed                      # ten minutes, a table; nothing is written
    python -m benchmarks.explain_speed --page               # and docs/performance.md
    python -m benchmarks.explain_speed --minutes 2 --jobs 1 --profile 30

The log is one simulated minute (tilt_hexarotor, multi-axis excitation, a hidden centre-of-mass offset and servo lag)
with fresh sensor noise for every repetition, a second of silence between them. As with the command, workers start while
the log is read. Processor seconds are those of all processes; seconds by the clock say something on an idle machine
only. --hide replaces what is hidden (repeat it; what is hard to name takes longer). --profile prints the N functions
in which most time goes, of a run on one core, since a profile does not see into workers.
"""

import cProfile
import pstats
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks import pages
from wrenchgap import flight
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.parallel import cores, get_ready
from wrenchgap.learn.posterior.explain import explain
from wrenchgap.plant import model_file
from wrenchgap.plant.sensors import imu_errors
from wrenchgap.plant.simulation.flight_plan import Plan, fly

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
    """Seconds by the clock, processor seconds of this process and of its workers so far."""
    import psutil

    own = psutil.Process()
    times = [process.cpu_times() for process in (own, *own.children(recursive=True))]
    return np.array((time.perf_counter(), sum(t.user + t.system for t in times)))


def rows(minutes, hidden, jobs, profile):
    """What was measured, as it comes: the same log on so many cores each."""
    model = model_file.load("tilt_hexarotor")
    with tempfile.TemporaryDirectory() as folder:
        path = flight.write(long_flight(minutes, hidden), Path(folder) / "long.mcap")
        one = None
        for count in jobs:
            begun = clock()
            get_ready(count)
            opened = open_flight(path, model)
            read = clock()
            profiler = cProfile.Profile(time.process_time)
            if profile and count == 1:
                profiler.enable()
            found = explain([opened], model, jobs=count)
            profiler.disable()
            done = clock()
            if profile and count == 1:
                for order in ("tottime", "cumtime"):
                    pstats.Stats(profiler).sort_stats(order).print_stats(profile)
            one = one or (done - read)[0]
            yield {
                "minutes": minutes,
                "cores": count,
                "reading_s": (read - begun).tolist(),
                "explaining_s": (done - read).tolist(),
                "faster": one / (done - read)[0],
                "verdict": found.verdict,
                "effects": list(found.effects),
                "weights": [s.weight for s in found.posterior.sets[:3]],
            }


def table(found, load):
    """In Markdown."""
    heads = (
        "minutes",
        "cores",
        "read, processor s",
        "explain, processor s",
        "explain, s by the clock",
        "times as fast",
    )
    lines = []
    for row in found:
        wall, processor = row["explaining_s"]
        cells = [f"{row['minutes']:g}", f"{row['cores']}", f"{row['reading_s'][1]:.1f}", f"{processor:.1f}"]
        lines.append([*cells, f"{wall:.1f}", f"{row['faster']:.2f}"])
    same = all(row["weights"] == found[0]["weights"] for row in found)
    said = f"The same digits on any number of cores: {'yes' if same else 'no'}."
    return pages.markdown(heads, lines, f"{said} {load}", left=0)


def main():
    """Measure; with --page, renew the page."""
    parser = pages.options(__doc__)
    parser.add_argument("--minutes", type=int, default=10, help="of log")
    parser.add_argument("--hide", action="append", metavar="EFFECT=P:V,...")
    parser.add_argument("--profile", type=int, default=0, metavar="N", help="print the N costliest functions")
    parser.add_argument("--jobs", type=int, nargs="+", default=sorted({1, min(2, cores())}))
    asked = parser.parse_args()
    pages.measure(asked, "explain", rows(asked.minutes, asked.hide or HIDDEN, asked.jobs, asked.profile), table)


if __name__ == "__main__":
    main()
