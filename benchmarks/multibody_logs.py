"""What is named, and how far the error falls, on the logs of an independent multibody simulation.

    python -m benchmarks.multibody_logs [--data FOLDER] [--json FILE]

FOLDER holds NAME.train.mcap and NAME.test.mcap, one hidden effect each. Fitted on train, judged on test. The tables of
docs/results.md are what this prints.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.identify.explain import explain
from wrenchgap.learn.identify.fit import fit, with_fit
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.learn.process.train import fit as fit_gp
from wrenchgap.plant import model_file

HIDDEN = {
    "ideal": "servo_lag",
    "com_offset": "com_offset",
    "servo_lag": "servo_lag",
    "weak_rotor": "rotor_thrust",
    "wake": "rotor_interference",
}
DEFAULT = Path(__file__).parent.parent.parent / "shared" / "data" / "multibody"


def percent(values):
    """Fractions as percentages in columns."""
    return " ".join("   -" if np.isnan(v) else f"{100 * v:4.0f}" for v in values)


def rms(residual):
    """Root mean square over samples, per axis."""
    return np.sqrt(np.mean(residual**2, axis=0))


def one(folder, name, model):
    """Everything about one pair of flights."""
    train, test = (dataset(open_flight(folder / f"{name}.{k}.mcap", model).records, model) for k in ("train", "test"))
    start = time.process_time()
    found = explain(train, model)
    seconds = time.process_time() - start
    before = rms(test.measured - test.predict(model.wrench_model))
    added = with_fit(model, fit(train, model, [HIDDEN[name]]))
    after = rms(test.measured - test.predict(added.wrench_model))
    everything = rms(test.measured - test.predict(found.model.wrench_model))
    torques = ("torque_x", "torque_y", "torque_z")
    learnt = (train.measured - train.predict(model.wrench_model))[:, 3:]
    gp = fit_gp(train.commanded[::3], learnt[::3], torques, FitSettings(points=200))
    left = (test.measured - test.predict(model.wrench_model))[:, 3:] - gp.mean(test.commanded)
    worth = before > 3.0 * test.noise  # below that there is nothing to take off
    return {
        "verdict": found.verdict,
        "effects": list(found.effects),
        "groups": [list(g) for g in found.groups],
        "parameters": [
            {"effect": n, "name": p.name, "value": float(v), "std": float(s), "unit": p.unit}
            for (n, p), v, s in zip(found.fit.parameters, found.fit.theta, found.fit.std, strict=True)
        ],
        "test_rms": before.tolist(),
        "noise": test.noise.tolist(),
        "fall_with_hidden_effect": np.where(worth, 1 - after / before, np.nan).tolist(),
        "fall_with_all_named": np.where(worth, 1 - everything / before, np.nan).tolist(),
        "fall_with_gp": np.where(worth[3:], 1 - rms(left) / before[3:], np.nan).tolist(),
        "explain_cpu_seconds": seconds,
    }


def main():
    """Print the table and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DEFAULT)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if not (options.data / "ideal.train.mcap").exists():
        print(f"{options.data}: no multibody logs there; say where they are with --data")
        return
    model = model_file.load("tilt_hexarotor")
    results = {}
    print(
        "fall of rms on the unseen test flight [%], F_x F_y F_z M_x M_y M_z; "
        "-: below three times the sensor noise already"
    )
    for name in HIDDEN:
        results[name] = r = one(options.data, name, model)
        print(f"\n{name}: {r['verdict']}: {', '.join(r['effects'])}   groups {r['groups']}")
        print(f"  with the hidden effect   {percent(r['fall_with_hidden_effect'])}")
        print(f"  with all that was named  {percent(r['fall_with_all_named'])}")
        print(f"  with a torque GP                        {percent(r['fall_with_gp'])}")
        for p in r["parameters"]:
            if abs(p["value"]) > 3 * p["std"]:
                print(f"  {p['effect']}.{p['name']} = {p['value']:.4g} +- {p['std']:.1g} {p['unit']}")
        print(f"  explain took {r['explain_cpu_seconds']:.1f} s of CPU")
    if options.json:
        options.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
