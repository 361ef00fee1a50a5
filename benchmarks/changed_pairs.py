"""`wrenchgap changed` on simulated pairs: graded changes of the hexarotor of `benchmarks.hidden_effects`.

    python -m benchmarks.changed_pairs --json FILE [--seconds 12] [--quiet-flights 6]

Three healthy flights, one suspect, all excited. The model is wrong in all: 5 % too much thrust, a centre of mass
7 mm off, no servo lag. Effects are the whole catalogue; what is hidden is made by an engine that shares no formula with
it. A row is written as soon as it is known; the same command goes on where it was interrupted.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import wrenchgap as wg
from benchmarks.hidden_effects import engine

GRADED: tuple[tuple[str, str, tuple[float, ...]], ...] = (
    ("weak_rotor", "rotor_thrust", (0.02, 0.01, 0.005)),
    ("com_offset", "com_offset", (0.002, 0.001, 0.0005)),
    ("servo_lag", "servo_lag", (0.012, 0.006, 0.003)),
)
"""What the engine hides, what the catalogue calls it, sizes: share of thrust, m, s."""


def model_of() -> Any:
    """The hexarotor's model, wrong in all flights alike."""
    model = wg.load_model("tilt_hexarotor")
    vehicle = model.vehicle
    rotors = replace(vehicle.rotors, c_f=1.05 * vehicle.rotors.c_f)
    body = replace(vehicle.body, com_B=vehicle.body.com_B + np.array([0.006, -0.004, 0.0]))
    return replace(model, vehicle=replace(vehicle, rotors=rotors, body=body))


def true_of(name: str, truth: Any) -> dict[str, float]:
    """Parameters of the catalogue's effect that the engine's truth is."""
    values = truth.parameters.get(name, {})
    if name == "weak_rotor":
        return {f"rotor_{int(values['rotor'])}": -float(values["loss"])}
    if name == "servo_lag":
        return {"tau": float(values["added"])}
    return {k: float(v) for k, v in values.items()}


def main() -> None:
    """Fly and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--quiet-flights", type=int, default=6)
    given = parser.parse_args()
    model = model_of()
    healthy = [engine.fly("none", None, "train", given.seconds, seed=s)[0] for s in (1, 2, 3)]
    cases = [(h, e, s, 9) for h, e, sizes in GRADED for s in sizes]
    cases += [("none", "", 0.0, 100 + k) for k in range(given.quiet_flights)]
    rows = json.loads(given.json.read_text())["rows"] if given.json.exists() else []
    done = {(r["hidden"], r["size"], r["seed"]) for r in rows}
    for hidden, effect, size, seed in [c for c in cases if (c[0], c[2], c[3]) not in done]:
        flight, truth = engine.fly(hidden, size or None, "train", given.seconds, seed=seed)
        opened = wg.open_flights([*healthy, flight], model)
        found = wg.changed(opened[3:], opened[:3], model, jobs=1)
        true = true_of(hidden, truth)
        listed = {p.name: p for p in found.parameters if p.effect == effect}
        pulls = [
            (listed[n].change - v) / np.hypot(listed[n].std, listed[n].scatter) for n, v in true.items() if n in listed
        ]
        row = {"hidden": hidden, "size": size, "seed": seed, "verdict": str(found.verdict), "firm": list(found.firm)}
        row |= {"names": list(found.names), "truth": true, "found": {n: p.change for n, p in listed.items()}}
        row |= {"pulls": [float(p) for p in pulls], "odd": [o.flight for o in found.odd]}
        rows.append(row)
        print(row, flush=True)
        given.json.write_text(json.dumps({"rows": rows}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
