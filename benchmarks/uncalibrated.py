"""What `explain` says of real Crazyflies with the shipped model, as it is and with a thrust that counts as exact.

    python -m benchmarks.uncalibrated FOLDER [--tolerances 0 1]

FOLDER holds flights named as CrazyPAD names them (`benchmarks.real_defects`). Nobody calibrated the model for them, so
that its thrust and its yaw trim are off; of a rotor that is not in a flight's name nothing is wrong. Printed is in how
many flights what was said, firm or not, for each factor of the model's tolerances of thrust and thrust axes; at zero
both count as exact.
"""

import argparse
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import wrenchgap as wg
from benchmarks.real_defects import case_of
from wrenchgap.learn import Explanation
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.plant.model import Model
from wrenchgap.replay.present.numbers import user_name


def with_tolerances(model: Model, factor: float) -> Model:
    """The model with its tolerances of thrust and thrust axes times a factor; none at zero."""
    told = model.vehicle.tolerances
    scaled = [None if not (factor and value) else factor * value for value in (told.thrust, told.thrust_axis)]
    tolerances = replace(told, thrust=scaled[0], thrust_axis=scaled[1])
    return replace(model, vehicle=replace(model.vehicle, tolerances=tolerances))


def said(found: Explanation, case: str) -> set[str]:
    """What counts of one answer."""
    firm = {f"{name} firm" for name in found.firm}
    names = {n for known in found.classes for one in known.sets for n in one.names}
    out = firm | ({"rotor_thrust in the answer"} if "rotor_thrust" in names else set())
    values = found.fit.values("rotor_thrust") if "rotor_thrust firm" in firm else ()
    named = re.findall(r"M\d", case) if case.startswith(("cut", "tape")) else []
    weak = {user_name(v.name, found.model.vehicle).split()[0] for v in values if v.value < -SIGNIFICANCE.alone * v.std}
    if weak - set(named):
        out.add("a whole rotor is firm")
    return out


def main() -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tolerances", type=float, nargs="+", default=(0.0, 1.0))
    options = parser.parse_args()
    model = wg.load_model("crazyflie")
    paths = sorted(options.folder.glob("*.mcap"))
    for factor in options.tolerances:
        own = with_tolerances(model, factor)
        kinds: dict[str, Counter[str]] = {"cut": Counter(), "others": Counter()}
        for path in paths:
            case = case_of(path)
            found = wg.explain(wg.open_flights(path, own), own, injections=0)
            kinds["cut" if case.startswith("cut") else "others"].update(said(found, case))
        for kind, counts in kinds.items():
            count = sum(case_of(path).startswith("cut") == (kind == "cut") for path in paths)
            listed = "; ".join(f"{what} {number}" for what, number in sorted(counts.items()))
            print(f"tolerances times {factor:g}, {count} flights, {kind}: {listed}", flush=True)


if __name__ == "__main__":
    main()
