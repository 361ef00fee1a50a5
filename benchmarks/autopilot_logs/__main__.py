"""Explain logs as autopilots write them, and calibrate on those of healthy vehicles.

    pip install -e '.[benchmark]'                                     # drone-models
    python -m benchmarks.autopilot_logs --json /tmp/rows.json         # others to tune on, first seed 0
    python -m benchmarks.autopilot_logs --seed 1000 --json docs/autopilot-logs.json --page docs/autopilot-logs.md

The second command flies the published flights, which nobody tunes on: 144 that are explained, and 12 vehicles that are
calibrated on three healthy flights each.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from time import process_time
from typing import Any

import drone_models  # noqa: F401  before scipy, whose arrays it chooses

import wrenchgap as wg
from benchmarks import pages
from benchmarks.autopilot_logs.engine import QUAD, Case, fly
from wrenchgap.plant.effects import family

HIDDEN: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "nothing": ({}, ()),
    "rotor_thrust": ({"weak": (1.0, 0.85, 1.0, 1.0)}, ("rotor_thrust",)),
    "com_offset": ({"com": (0.012, -0.006, 0.0)}, ("com_offset",)),
    "mass": ({"mass": 1.06}, ("mass", "thrust_scale")),
}
"""What is hidden: arguments of `Case`, and the families of which one says it."""
ANYWAY = ("body_drag", "rotor_drag", "axial_inflow", "wind", "motor_lag", "command_delay", "constant_wrench")
"""Families that are there in every flight: drag in gusts (along z it is a thrust that falls as the vehicle climbs),
motors that follow in 20 ms, filters of the IMU."""
RATES = ((10.0, 25.0), (25.0, 50.0), (50.0, 100.0), (400.0, 200.0))
"""Hz, of the motors' commands and of the IMU."""
CUTOFF = 8.0
"""Hz; of slower logs, the most that `inspect` recommends."""


def cases(seed: int) -> list[Case]:
    """Every kind of flying at every pair of rates with everything hidden, three draws of each."""
    out = []
    kinds = itertools.product(("hover", "mission", "excited"), RATES, HIDDEN, range(3))
    for k, (flying, (motor, imu), hidden, _) in enumerate(kinds):
        name = f"{flying}.{motor:g}.{hidden}.{seed + k}"
        more = HIDDEN[hidden][0]
        out.append(Case(name, flying, motor, imu, seconds=45.0, seed=seed + k, hidden=(hidden,), **more))
    return out


def cutoff(case: Case) -> float:
    """Hz."""
    return min(CUTOFF, 0.38 * min(case.motor_hz, case.imu_hz))


def explained(case: Case, flight: Any, answers: Sequence[str], anyway: Sequence[str] = ANYWAY) -> dict[str, Any]:
    """The answer for one flight, judged: families of which one says what is hidden, and those that are there anyway."""
    opened = wg.open_flights([flight], QUAD.model, cutoff_hz=cutoff(case), accept=("rate",))
    start = process_time()
    found = wg.explain(opened, QUAD.model, jobs=1)
    named, firm = ({family(n) for n in names} for names in (found.effects, found.firm))
    return {
        "case": case.name, "flying": case.flying, "motor_hz": case.motor_hz, "hidden": case.hidden[0],
        "verdict": str(found.verdict), "effects": list(found.effects), "firm": list(found.firm),
        "named": bool(named & set(answers)), "firmly": bool(firm & set(answers)),
        "wrong": sorted(firm - set(answers) - set(anyway)), "cpu_seconds": process_time() - start,
    }  # fmt: skip


def calibrated(seed: int) -> Iterator[dict[str, Any]]:
    """Healthy vehicles, each on three flights: what is put into the model, and whether it is there."""
    kinds = list(itertools.product(("hover", "mission", "excited"), RATES))
    every = [
        Case(f"healthy.{flying}.{motor:g}.{k}", flying, motor, imu, seconds=45.0, seed=seed + 500 + 3 * n + k)
        for n, (flying, (motor, imu)) in enumerate(kinds)
        for k in range(3)
    ]
    flights = fly(every)
    for n, (flying, (motor, _)) in enumerate(kinds):
        some = flights[3 * n : 3 * n + 3]
        opened = wg.open_flights(some, QUAD.model, cutoff_hz=cutoff(every[3 * n]), accept=("rate",))
        found = wg.calibrate(opened, QUAD.model)
        values = {f"{t.effect}.{t.name}": float(t.value) for t in found.trimmed}
        wrong = sorted(n for n in found.effects if not believable(n, values))
        yield {"flying": flying, "motor_hz": motor, "effects": list(found.effects), "values": values, "wrong": wrong}


def believable(name: str, values: dict[str, float]) -> bool:
    """Whether a healthy vehicle of the engine has it: a lag or delay of 10 to 45 ms (motors of 20, filters of 8), and
    otherwise within 2 % of nothing, 2 mm and half a degree.
    """  # noqa: D205
    own = [v for key, v in values.items() if key.startswith(f"{name}.")]
    if name in ("motor_lag", "command_delay"):
        return all(0.01 <= v <= 0.045 for v in own)
    most = {"com_offset": 2e-3, "imu_lever_arm": 2e-3, "imu_misalignment": 9e-3}.get(name, 0.02)
    return all(abs(v) <= most for v in own)


def tables(rows: list[dict[str, Any]], healthy: list[dict[str, Any]], load: str) -> dict[str, str]:
    """In Markdown, by mark."""
    lines = []
    for flying, motor in itertools.product(("hover", "mission", "excited"), [r[0] for r in RATES]):
        own = [r for r in rows if r["flying"] == flying and r["motor_hz"] == motor]
        there, none = [r for r in own if r["hidden"] != "nothing"], [r for r in own if r["hidden"] == "nothing"]
        quiet = sum(not (set(map(family, r["effects"])) - set(ANYWAY)) for r in none)
        wrong, firm = (sum(len(r[key]) for r in own) for key in ("wrong", "firm"))
        named, firmly = (sum(r[key] for r in there) for key in ("named", "firmly"))
        shares = (f"{named}/{len(there)}", f"{firmly}/{len(there)}", f"{quiet}/{len(none)}", f"{wrong} of {firm}")
        lines.append((flying, f"{motor:g}", *shares))
    heads = ("flying", "motors, Hz", "named", "firm", "quiet where nothing", "firm and wrong")
    text = pages.markdown(heads, lines, load)
    said = [
        (r["flying"], f"{r['motor_hz']:g}", ", ".join(r["effects"]) or "-", ", ".join(r["wrong"]) or "-")
        for r in healthy
    ]
    return {"explained": text, "calibrated": pages.markdown(("flying", "motors, Hz", "put in", "wrong"), said, "", 4)}


def main() -> None:
    """Fly, explain, calibrate; write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--every", type=int, default=1, help="only every so many of the flights")
    asked = parser.parse_args()
    some = cases(asked.seed)[:: asked.every]
    rows = []
    for case, flight in zip(some, fly(some), strict=True):
        rows.append(explained(case, flight, HIDDEN[case.hidden[0]][1]))
        print(json.dumps(rows[-1]), flush=True)
    healthy = list(calibrated(asked.seed))
    cpu = sorted(r["cpu_seconds"] for r in rows)
    load = (
        f"{len(rows)} flights of 42 s; processor time {cpu[len(cpu) // 2]:.1f} s in the median, {cpu[-1]:.1f} at most."
    )
    text = tables(rows, healthy, load)
    print("\n\n".join(text.values()))
    if asked.json:
        asked.json.write_text(json.dumps({"explained": rows, "calibrated": healthy}, indent=1) + "\n", encoding="utf-8")
    if asked.page:
        pages.renew(asked.page, text)


if __name__ == "__main__":
    main()
