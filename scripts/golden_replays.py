"""The kept golden results: replay and compare on flights that are simulated from a seed.

    make golden                                       # after a change that was meant: the results anew
    python scripts/golden_replays.py                  # compare; where they diverge, the first place

Kept are series of the replay (one sample in so many) and the numbers of compare, in tests/golden. The
process is drawn and not fitted, so that what is compared is the replay and not an optimiser's last digits.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scripts.golden import differences

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "tests" / "golden"
SAMPLES = 30
"""Kept of each series, about."""
DIGITS = 8
TOLERANCE = 1e-6
"""Relative."""
TOLERANCE_OF_REACH = 4.0
"""In tolerances of the search for the nearest wrench that a vehicle can make (`compensate.reach.NEAR`). Rounding, which
differs between machines, decides in which round it ends: twice the tolerance apart, and pulled inside by as much."""
TOLERANCE_OF_REPLAY = 2e-5
"""Relative to a value and to the largest of its series: the optimiser stops at mismatches of some 1e-6 of that."""
AXES = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")


@dataclass(frozen=True)
class Case:
    """A simulated flight."""

    model: str
    trajectory: str
    hidden: str


CASES = {
    "hexarotor": Case("tilt_hexarotor", "multi_axis", "com_offset=x:-0.004,y:0.007,z:-0.005"),
    "quadrotor": Case("asymmetric_quadrotor", "hover", "thrust_scale=scale:-0.08"),
}


@dataclass(frozen=True)
class Divergence:
    """The first place where two results differ: `quantity`, and `time` [s] and `sample` where it is a series."""

    case: str
    quantity: str
    golden: object
    now: object
    sample: int | None = None
    time: float | None = None

    def __str__(self) -> str:
        where = "" if self.sample is None else f" at {self.time:.4f} s (sample {self.sample})"
        return (
            f"{self.case}: first divergence: {self.quantity}{where}: golden {self.golden}, now {self.now}; "
            "after a change that was meant `make golden` renews them"
        )


def _upset(model: Any) -> dict[str, Any]:
    """Commands for demands of which many cannot be reached, with hover in between; the centre of mass is 5 mm off."""
    import wrenchgap as wg
    from wrenchgap.compensate.reach import reach_of
    from wrenchgap.plant.model import make_effect
    from wrenchgap.plant.state import State

    authority, rng = reach_of(model.vehicle).authority, np.random.default_rng(5)
    moved = model.with_effects([make_effect(model.vehicle, "com_offset", [0.005, -0.002, 0.0])])
    loop = wg.compensate.Compensator(wg.compensate.PhysicsMismatch(moved.wrench_model, AXES[3:]))
    rest = State(np.zeros(1), np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), np.zeros((1, 3)), np.zeros((1, 3)))
    hover = np.array([0, 0, 9.81 * model.vehicle.body.mass, 0, 0, 0])
    rows = []
    for size in np.tile([0.2, 1.0, 3.0, 1e6, 1e300], 3):
        for wanted in (hover + size * rng.normal(size=6) * authority, hover):
            made = loop.step(wanted, rest)
            rows.append([*(made.wrench_cmd / authority).tolist(), float(made.limited)])
    return _rounded({"shares_of_authority_and_limited": rows})


def results(name: str) -> dict[str, Any]:
    """Of one case, the series of a replay and the numbers of compare."""
    import wrenchgap as wg

    case = CASES[name]
    model = wg.load_model(case.model)
    how = {"duration": 7.0, "excitation": 1.0, "seed": 5, "hide": (case.hidden,)}
    flight = wg.simulate(model, case.trajectory, name=name, **how)  # type: ignore[arg-type]
    (opened,) = wg.open_flights([flight], model)
    replayed = wg.replay_compensation(opened, model, _process(_input(flight), model.vehicle.name))
    return {
        "upset": _upset(model),
        "replay": _series(replayed),
        "compare": _rounded(wg.compare([opened], model).to_json()["models"]),
    }


def _input(flight: Any) -> Any:
    """The wrenches (N, 6) that go into the replay."""
    return (flight.desired or flight.commanded).wrench_B


def _process(wrench: Any, vehicle: str) -> Any:
    """A process of three torques over such wrenches, drawn from a seed."""
    from wrenchgap.learn.process.gp import GaussianProcess, Provenance

    rng = np.random.default_rng(8)
    scale = np.std(wrench, axis=0) + 0.05 * np.abs(wrench).max()
    return GaussianProcess(
        outputs=AXES[3:],
        input_mean=np.mean(wrench, axis=0),
        input_scale=scale,
        output_scale=0.2 * scale[3:],
        mean_coefficients=np.zeros((3, 7)),
        inputs=rng.normal(size=(30, 6)),
        residuals=rng.normal(size=(30, 3)),
        lengthscales=rng.uniform(1.0, 3.0, size=(3, 6)),
        signal_variance=np.array([0.7, 1.5, 3.0]),
        noise_variance=np.array([0.01, 0.05, 0.2]),
        sigma_training=0.2 * scale[3:],
        mismatch_max=0.5 * scale[3:],
        provenance=Provenance(vehicle=vehicle),
    )


def _series(replayed: Any) -> dict[str, Any]:
    """One sample in so many of what the compensator did, by quantity."""
    every = max(len(replayed.time) // SAMPLES, 1)
    steps, columns = replayed.steps, {}
    for name, values in (
        ("input", replayed.wrench),
        ("correction", steps.correction),
        ("optimum", steps.optimum),
        ("measured", replayed.measured),
        ("predicted_new", replayed.predicted_new),
    ):
        columns |= {f"{name}.{axis}": values[:, k] for k, axis in enumerate(AXES) if k > 2}
    columns["beta"] = steps.beta
    kept = {name: _rounded(values[::every].tolist()) for name, values in columns.items()}
    return {"every": every, "time": _rounded(replayed.time[::every].tolist()), "series": kept}


def _rounded(value: Any) -> Any:
    """The same with numbers of `DIGITS` digits; what is no finite number is null."""
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items() if key not in ("file", "path")}
    if isinstance(value, list | tuple):
        return [_rounded(inner) for inner in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value


def divergence(name: str, golden: dict[str, Any], now: dict[str, Any]) -> Divergence | None:
    """The first place where a case diverges, the replay by time, then compare; None where it does not."""
    from wrenchgap.compensate.reach import NEAR

    series = sorted(_diverging(name, golden["replay"], now["replay"]), key=lambda found: found.sample or 0)
    if series:
        return series[0]
    for (key, old), new in zip(golden["upset"].items(), now["upset"].values(), strict=True):
        for k, (row, other) in enumerate(zip(old, new, strict=True)):
            near = TOLERANCE_OF_REACH * NEAR if row[-1] else TOLERANCE_OF_REPLAY
            if row[-1] != other[-1] or np.abs(np.subtract(row, other)).max() > near:
                return Divergence(name, f"upset.{key}", row, other, k, float(k))
    for where, old, new in differences(golden["compare"], now["compare"], TOLERANCE):
        return Divergence(name, f"compare{where}", old, new)
    return None


def _diverging(name: str, golden: dict[str, Any], now: dict[str, Any]) -> Iterator[Divergence]:
    """Of every series the first sample that differs."""
    if golden["every"] != now["every"] or len(golden["time"]) != len(now["time"]):
        yield Divergence(name, "replay: number of samples", len(golden["time"]), len(now["time"]), 0, 0.0)
        return
    for quantity, old in {"time": golden["time"], **golden["series"]}.items():
        new = now["time"] if quantity == "time" else now["series"].get(quantity)
        if new is None:
            yield Divergence(name, f"replay.{quantity}", "there", "missing", 0, golden["time"][0])
            continue
        a, b = (np.array([np.nan if v is None else v for v in values]) for values in (old, new))
        allowed = TOLERANCE_OF_REPLAY * np.maximum(np.abs(a), np.nanmax(np.abs(a), initial=1e-9))
        same = (np.isnan(a) & np.isnan(b)) | (np.abs(a - b) <= allowed)
        for k in np.flatnonzero(~same)[:1].tolist():
            yield Divergence(name, f"replay.{quantity}", old[k], new[k], k * golden["every"], golden["time"][k])


def load(name: str) -> dict[str, Any]:
    """What is kept of a case."""
    found: dict[str, Any] = json.loads((KEPT / f"{name}.json").read_text(encoding="utf-8"))
    return found


def refresh() -> None:
    """Keep the results of now."""
    KEPT.mkdir(exist_ok=True)
    for name in CASES:
        (KEPT / f"{name}.json").write_text(json.dumps(results(name)) + "\n", encoding="utf-8")
        print(f"kept {KEPT / name}.json")


def main() -> int:
    """Compare, or renew."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--refresh", action="store_true")
    if parser.parse_args().refresh:
        refresh()
        return 0
    found = [one for name in CASES if (one := divergence(name, load(name), results(name))) is not None]
    print("\n".join(map(str, found)) or "no divergence")
    return int(bool(found))


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    sys.exit(main())
