"""How long the viewer takes to refresh everything after the model changed, on a one-minute flight.

    python -m benchmarks.viewer_effects_speed [--seconds 60] [--repeat 5] [--json FILE]

The flight hides an offset of the centre of mass, a thrust scale and a lag of the servos; a second one of 20 s is held
out. Wall seconds, median and worst, from the click to a page that is up to date at the server (fit, predictions on both
flights, arrows and plots, failure map, budget, staircases): adding an effect, undoing, a slider, removing, another
flight. The goal is 1 s for adding an effect on 2 cores. The search runs beside the page; for it the time is printed
that a refresh of the page takes meanwhile.
"""

import argparse
import json
import os
import statistics
import tempfile
import time
from pathlib import Path

import wrenchgap as wg
from wrenchgap import flight
from wrenchgap.plant import model_file
from wrenchgap.plant.simulation.flight_plan import Plan, fly, provenance
from wrenchgap.replay.session.log_session import LogSession
from wrenchgap.replay.session.panels.effects import EffectsPanel
from wrenchgap.viewer.page import Page

HIDDEN = ("com_offset=x:-0.004,y:0.007,z:-0.005", "thrust_scale=scale:-0.04", "servo_lag=tau:0.03")
EFFECTS = ("com_offset", "thrust_scale", "servo_lag", "rotor_thrust")
GOAL = 1.0  # s


def logs(folder, seconds):
    """A flight to fit and one to hold out."""
    believed = model_file.load("tilt_hexarotor")
    paths = []
    for name, trajectory, length, excitation in (("train", "multi_axis", seconds, 1.0), ("test", "pitch", 20.0, 0.0)):
        plan = Plan(believed, trajectory, length, excitation, 1, None, HIDDEN)
        paths.append(folder / f"{name}.mcap")
        flight.write(fly(plan, name=name), paths[-1], metadata=provenance(plan))
    return paths


def timed(found, what, act):
    """Do it and note how long it took."""
    begin = time.perf_counter()
    act()
    found.setdefault(what, []).append(time.perf_counter() - begin)


def changes(page, panel, repeat):
    """Wall seconds of every change, by name."""
    found = {}
    effects = page.session.effects
    for _ in range(repeat):
        for name in EFFECTS:
            timed(found, f"add {name}", lambda name=name: panel.add(name))
        timed(found, "slider", lambda: panel.sliders.on_set("com_offset", "x", 0.001))
        timed(found, "remove", lambda: panel.sliders.on_remove("thrust_scale"))
        while page.session.working.undoable:
            timed(found, "undo", lambda: (effects.undo(), page.refresh()))
        timed(found, "another flight", lambda: page.open("test"))
        page.open("train")
    return found


def beside(page, panel):
    """Seconds of the search, and of refreshing the page meanwhile."""
    begin, found = time.perf_counter(), {}
    panel._explain()
    while panel.work.running:
        timed(found, "refresh during a search", page.refresh)
        timed(found, "cursor during a search", lambda: page.cursor.go(30.0))
        time.sleep(0.1)
    found["search"] = [time.perf_counter() - begin]
    return found


def main():
    """Fly, open a page, change the model."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        model = wg.load_model("tilt_hexarotor")
        flights = wg.open_flights(logs(Path(folder), arguments.seconds), model)
        page = Page(LogSession(flights, model), port=0)
        try:
            panel = next(p for p in page.panels if isinstance(p, EffectsPanel))
            panel.add("com_offset")  # what is loaded once
            page.session.effects.undo()
            page.refresh()
            found = changes(page, panel, arguments.repeat) | beside(page, panel)
        finally:
            page.stop()
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; flight of {arguments.seconds:g} s")
    for what, times in found.items():
        print(f"{what:26s} median {statistics.median(times):6.3f} s   worst {max(times):6.3f} s")
    slowest = max(max(times) for what, times in found.items() if what.startswith("add "))
    print(f"adding an effect refreshes everything within {slowest:.2f} s (goal {GOAL:g} s)")
    if arguments.json:
        result = {"seconds": arguments.seconds, "goal_s": GOAL, "wall_s": found, "slowest_add_s": slowest}
        arguments.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
