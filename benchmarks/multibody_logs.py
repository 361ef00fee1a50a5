"""What is named, and how far the error falls, on the logs of an independent multibody simulation.

    python -m benchmarks.multibody_logs FOLDER [--json FILE] [--page docs/results.md]

FOLDER holds NAME.train.mcap and NAME.test.mcap, one hidden effect each. Fitted on train, judged on test.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from benchmarks.pages import renew
from wrenchgap import add, compare, explain, learn_gp, load_model, open_flights
from wrenchgap.learn import FitSettings

HIDDEN = {
    "ideal": "servo_lag",
    "com_offset": "com_offset",
    "servo_lag": "servo_lag",
    "weak_rotor": "rotor_thrust",
    "wake": "rotor_interference",
}


def percent(values):
    """Fractions as percentages in columns."""
    return " ".join("   -" if np.isnan(v) else f"{100 * v:4.0f}" for v in values)


def one(folder, name, model):
    """Everything about one pair of flights."""
    train, test = open_flights([folder / f"{name}.{k}.mcap" for k in ("train", "test")], model)
    start = time.process_time()
    found = explain(train, model, jobs=1)
    seconds = time.process_time() - start
    gp = learn_gp(train, model, settings=FitSettings(points=200), guard=False).gp
    hidden, named = add(model, HIDDEN[name], train), add(model, found)
    compared = compare(test, model, hidden, named, gp=gp)
    before, after, everything, learnt = (e.pooled.rms for e in compared.evaluations)
    worth = before > 3.0 * compared.noise  # below that there is nothing to remove
    return {
        "verdict": found.verdict,
        "effects": list(found.effects),
        "groups": [list(g) for g in found.groups],
        "parameters": [{"effect": s.effect, **v.__dict__} for s in found.fit.snapshot for v in s.values],
        "test_rms": before.tolist(),
        "noise": compared.noise.tolist(),
        "reduction_with_hidden_effect": np.where(worth, 1 - after / before, np.nan).tolist(),
        "reduction_with_all_named": np.where(worth, 1 - everything / before, np.nan).tolist(),
        "reduction_with_gp": np.where(worth, 1 - learnt / before, np.nan)[3:].tolist(),
        "explain_cpu_seconds": seconds,
    }


def described(name, r):
    """One pair of flights as lines."""
    yield f"{name}: {r['verdict']}: {', '.join(r['effects'])}   groups {r['groups']}"
    yield f"  with the hidden effect   {percent(r['reduction_with_hidden_effect'])}"
    yield f"  with all that was named  {percent(r['reduction_with_all_named'])}"
    yield f"  with a torque GP                        {percent(r['reduction_with_gp'])}"
    for p in r["parameters"]:
        if abs(p["value"]) > 3 * p["std"]:
            yield f"  {p['effect']}.{p['name']} = {p['value']:.4g} +- {p['std']:.1g} {p['unit']}"
    yield f"  explain took {r['explain_cpu_seconds']:.1f} s of CPU"


def main():
    """Print the table, write the JSON and the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", type=Path, help="the page whose table is written anew")
    options = parser.parse_args()
    if not (options.folder / "ideal.train.mcap").exists():
        parser.error(f"{options.folder}: no multibody logs there; expected NAME.train.mcap and NAME.test.mcap")
    model = load_model("tilt_hexarotor")
    results = {}
    said = [
        "RMS reduction on the unseen test flight [%], F_x F_y F_z M_x M_y M_z; "
        "-: below three times the sensor noise already"
    ]
    for name in HIDDEN:
        results[name] = one(options.folder, name, model)
        lines = "\n".join(described(name, results[name]))
        print(lines, flush=True)
        said.append(lines)
    if options.json:
        options.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    if options.page:
        renew(options.page, {"multibody": "```text\n" + "\n\n".join(said) + "\n```"})


if __name__ == "__main__":
    main()
