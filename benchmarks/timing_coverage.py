"""How often the 95 % intervals of `timing` hold the true offset, on flights of which it is known.

    python -m benchmarks.timing_coverage --rows rows.jsonl --page docs/timing.md   # minutes; goes on if stopped

Flights of MuJoCo (`benchmarks.meaning.flying`) and of `wrenchgap.simulate`, 16 s, from hardly any excitation to a
lot. Every topic is stamped when it was true, but MuJoCo's IMU: its sensors are those of the beginning of the physics
step of 1 ms after which they are read. What the accelerometer feels is constant over that step (thrusts and drag are),
so it is half a step late. The odometry is moved by up to 15 ms either way. Responses are of flights of `simulate` whose
commands travel for 0, 10 or 20 ms and whose actuators do nothing else; an axis that the log calls feedback, or whose
phases it does not trust, has no number.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import wrenchgap as wg
from benchmarks.meaning.flying import NANO, QUAD, Craft, Manner, fly
from wrenchgap.flight.compared_signals import sensor_offsets, shifted
from wrenchgap.flight.flight import Flight
from wrenchgap.flight.offsets import Offset
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.data.response import responses

MANNERS = (Manner(), Manner(excitation=0.3), Manner(excitation=0.3, reach=0.4), Manner(noise=4.0))
TRAJECTORIES = (("pitch", 0.0), ("multi_axis", 0.0), ("figure8", 0.0), ("hover", 0.0), ("hover", 1.0), ("hover", 0.3))
STEP = 1e-3
"""Of MuJoCo's physics [s]."""
IMU_LATE = {("MuJoCo", "gyroscope"): STEP, ("MuJoCo", "accelerometer"): 0.5 * STEP}
"""[s]"""
COMMANDS_LATE = (0.0, 0.01, 0.02)
"""[s]"""
SECONDS = 16.0


@dataclass(frozen=True)
class Case:
    """A flight of `kind`; `number` counts those of a seed."""

    kind: str
    number: int
    seed: int

    @property
    def key(self) -> str:
        """Its name in a file of rows."""
        return f"{self.kind} {self.number} {self.seed}"

    def flight(self) -> Flight:
        """It is flown."""
        if self.kind == "MuJoCo":
            crafts: tuple[Craft, ...] = (QUAD, NANO)
            return fly(crafts[self.number % 2], SECONDS, self.noise, MANNERS[self.number // 2])
        trajectory, excitation = TRAJECTORIES[self.number]
        late = self.late
        hide = (f"command_delay=delay:{late}",) if late else ()
        model = wg.load_model("tilt_hexarotor")
        how = {"duration": SECONDS, "excitation": excitation, "seed": self.noise, "hide": hide}
        return wg.simulate(model, trajectory, **how)

    @property
    def noise(self) -> int:
        """Seed of its noise: no two flights may share one, or they count as one."""
        return 1000 + 100 * self.seed + self.number

    @property
    def late(self) -> float:
        """By how much its commands take effect late [s]."""
        return COMMANDS_LATE[self.seed % len(COMMANDS_LATE)] if self.kind == "simulate" else 0.0

    def rows(self) -> list[dict[str, object]]:
        """One of each offset."""
        rng = np.random.default_rng([1, self.seed, self.number, self.kind == "simulate"])
        by = float(rng.uniform(-0.015, 0.015))
        flight = self.flight()
        found = []
        for offset in sensor_offsets(shifted(flight, {"odometry": by})):
            own = offset.first.startswith("odometry") and offset.second.startswith("odometry")
            found.append((offset, 0.0 if own else by - IMU_LATE.get((self.kind, offset.first), 0.0)))
        if self.kind == "simulate":
            model = wg.load_model("tilt_hexarotor")
            opened = open_flight(flight, model, gate=False)
            every = responses(opened.flight, model.vehicle, opened.records)
            found += [(r.offset, self.late) for r in every if r.shape != "lag"]
        return [self._row(*one) for one in found]

    def _row(self, offset: Offset, truth: float) -> dict[str, object]:
        return {
            "case": self.key,
            "kind": self.kind,
            "pair": f"{offset.second} behind {offset.first}",
            "truth": truth,
            "seconds": offset.seconds,
            "std": offset.std,
            "interval": offset.interval,
            "blocks": offset.blocks,
            "problem": None if offset.problem is None else offset.problem.value,
        }


def cases(seeds: int, only: str) -> Iterator[Case]:
    """Kinds in turn, so that a part of the run has something of each."""
    for seed in range(seeds):
        for kind, count in (("MuJoCo", 2 * len(MANNERS)), ("simulate", len(TRAJECTORIES))):
            for number in range(count) if only in ("", kind) else ():
                yield Case(kind, number, seed)


def table(rows: list[dict[str, object]]) -> str:
    """Markdown, a line for each kind of flight and pair."""
    lines = ["| flights | pair | held | median half width, ms | no number |", "|---|---|---:|---:|---:|"]
    pairs = dict.fromkeys((row["kind"], row["pair"]) for row in rows)
    groups = [(kind, pair, [r for r in rows if (r["kind"], r["pair"]) == (kind, pair)]) for kind, pair in sorted(pairs)]
    for kind, pair, own in [*groups, ("all", "", rows)]:
        told = [(r["seconds"], r["truth"], r["interval"]) for r in own if r["seconds"] is not None]
        flights = len({r["case"] for r in own})
        said = "-", "-"
        if told:
            held = sum(abs(seconds - truth) <= interval for seconds, truth, interval in told)
            width = 1e3 * float(np.median([interval for *_, interval in told]))
            said = f"{held} of {len(told)} ({100 * held / len(told):.0f} %)", f"{width:.2g}"
        lines.append(f"| {flights} of {kind} | {pair} | {said[0]} | {said[1]} | {len(own) - len(told)} |")
    return "\n".join(lines)


def with_table(page: str, text: str) -> str:
    """A page with the table between its marks."""
    mark = re.compile(r"(<!-- coverage -->\n).*?(<!-- /coverage -->)", re.DOTALL)
    return mark.sub(lambda m: m[1] + text + "\n" + m[2], page)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--only", default="", choices=("", "MuJoCo", "simulate"))
    parser.add_argument("--rows", type=Path, help="a file to which rows are added; what it has is not flown again")
    parser.add_argument("--so-far", action="store_true", help="fly nothing more: what is in --rows")
    parser.add_argument("--page", type=Path, help="the page whose table is written anew")
    asked = parser.parse_args()
    known = asked.rows.read_text(encoding="utf-8").splitlines() if asked.rows and asked.rows.exists() else []
    rows = [json.loads(line) for line in known]
    done = {row["case"] for row in rows}
    for case in () if asked.so_far else cases(asked.seeds, asked.only):
        if case.key in done:
            continue
        found = case.rows()
        rows += found
        if asked.rows:
            with asked.rows.open("a", encoding="utf-8") as stream:
                stream.write("".join(json.dumps(row) + "\n" for row in found))
    text = table(rows)
    print(text)
    if asked.page:
        asked.page.write_text(with_table(asked.page.read_text(encoding="utf-8"), text), encoding="utf-8")


if __name__ == "__main__":
    main()
