"""Explain flights of vehicles whose laws have other forms than the model's and the catalogue's.

    pip install -e '.[benchmark]'                                  # drone-models
    python -m benchmarks.other_laws --json /tmp/rows.json          # others to tune on, first seed 0
    python -m benchmarks.other_laws --seed 1000 --json docs/other-laws.json --page docs/other-laws.md

The second command flies the published flights, which nobody tunes on. The engine is that of
`benchmarks.autopilot_logs`; motors are logged at 400 Hz and the IMU at 200, so that laws are all that is in question.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import drone_models  # noqa: F401  before scipy, whose arrays it chooses

from benchmarks import pages
from benchmarks.autopilot_logs.__main__ import ANYWAY, HIDDEN, explained
from benchmarks.autopilot_logs.engine import Case, Laws, fly
from wrenchgap.plant.effects import family

FLYING = ("hover", "mission", "excited")


@dataclass(frozen=True)
class Plant:
    """`laws` of a vehicle, more arguments of `Case`, and what may be said of them: families of effects whose form is
    near enough; whether `unknown` is the answer where they show.
    """  # noqa: D205

    words: str
    laws: Laws
    says: tuple[str, ...]
    more: dict[str, Any]
    unknown: bool = False


PLANTS = {
    "as believed": Plant("T = k w^2, Q = k_m w^2, motors that follow in 20 ms", Laws(), (), {}),
    "curves": Plant(
        "15 % of the thrust and 10 % of the torque are linear in w at hover, Q 4 % larger",
        Laws(thrust_linear=0.15, torque_linear=0.10, torque=1.04),
        ("thrust_curve", "thrust_scale", "drag_torque"),
        {},
    ),
    "spin": Plant(
        "motors follow with w^2, in 20 ms upwards and 40 downwards", Laws(squared=(0.02, 0.04)), ("motor_lag",), {}
    ),
    "early IMU": Plant(
        "15 % more drag torque, IMU stamped 2 ms early",
        Laws(torque=1.15, imu_early=0.002),
        ("drag_torque",),
        {},
    ),
    "low centre": Plant("centre of mass 20 mm lower", Laws(), ("com_offset",), {"com": (0.0, 0.0, -0.02)}),
    "gusts": Plant("gusts of 2 m/s rms", Laws(), (), {"gusts": 2.0}),
    "heading": Plant("a yaw torque of 0.05 Nm sin(2 heading)", Laws(heading=0.05), (), {}, unknown=True),
}


def cases(seed: int) -> list[Case]:
    """Every plant in every kind of flying with everything hidden, two draws of each."""
    out = []
    for k, (flying, plant, hidden, _) in enumerate(itertools.product(FLYING, PLANTS, HIDDEN, range(2))):
        own = PLANTS[plant]
        hide = dict(HIDDEN[hidden][0])
        if "com" in own.more and "com" in hide:
            hide["com"] = (*hide["com"][:2], own.more["com"][2])
        more = {**own.more, **hide}
        name = f"{flying}.{plant}.{hidden}.{seed + k}"
        out.append(
            Case(name, flying, 400.0, 200.0, seconds=45.0, seed=seed + k, hidden=(hidden, plant), laws=own.laws, **more)
        )
    return out


def judged(case: Case, flight: Any) -> dict[str, Any]:
    """The answer for one flight. What the plant's own laws are is no wrong name, and no name of what is hidden."""
    hidden, plant = case.hidden
    own = PLANTS[plant]
    row = explained(case, flight, HIDDEN[hidden][1], (*ANYWAY, *own.says))
    said = {family(n) for n in row["effects"]}
    return {**row, "plant": plant, "says": bool(said & set(own.says))}


def table(rows: Sequence[dict[str, Any]]) -> str:
    """In Markdown, by plant and kind of flying."""
    lines = []
    for plant, flying in itertools.product(PLANTS, FLYING):
        own = [r for r in rows if r["plant"] == plant and r["flying"] == flying]
        there, none = [r for r in own if r["hidden"] != "nothing"], [r for r in own if r["hidden"] == "nothing"]
        usual = {*ANYWAY, *PLANTS[plant].says}
        quiet = sum(not (set(map(family, r["effects"])) - usual) for r in none)
        wrong, firm = (sum(len(r[key]) for r in own) for key in ("wrong", "firm"))
        named, firmly = (sum(r[key] for r in there) for key in ("named", "firmly"))
        says = f"{sum(r['says'] for r in own)}/{len(own)}" if PLANTS[plant].says else "-"
        unknown = f"{sum(r['verdict'] == 'unknown' for r in own)}/{len(own)}"
        shares = (f"{named}/{len(there)}", f"{firmly}/{len(there)}", f"{quiet}/{len(none)}", says, unknown)
        lines.append((plant, flying, *shares, f"{wrong} of {firm}"))
    heads = ("plant", "flying", "named", "firm", "quiet where nothing", "own law named", "unknown", "firm and wrong")
    cpu = sorted(r["cpu_seconds"] for r in rows)
    wrong, firm = (sum(len(r[key]) for r in rows) for key in ("wrong", "firm"))
    load = (
        f"{len(rows)} flights of 42 s, {wrong} of {firm} firm names wrong; processor time {cpu[len(cpu) // 2]:.1f} s "
        f"in the median, {cpu[-1]:.1f} at most."
    )
    return pages.markdown(heads, lines, load, 2)


def main() -> None:
    """Fly, explain; write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--every", type=int, default=1, help="only every so many of the flights")
    parser.add_argument("--first", type=int, default=0, help="the first of them")
    asked = parser.parse_args()
    some = cases(asked.seed)[asked.first :: asked.every]
    rows = []
    for case, flight in zip(some, fly(some), strict=True):
        rows.append(judged(case, flight))
        print(json.dumps(rows[-1]), flush=True)
    text = table(rows)
    print(text)
    if asked.json:
        asked.json.write_text(json.dumps({"explained": rows}, indent=1) + "\n", encoding="utf-8")
    if asked.page:
        pages.renew(asked.page, {"other laws": text})


if __name__ == "__main__":
    main()
