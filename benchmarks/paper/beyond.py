"""Beyond the paper: choice of points, sparse posteriors, inputs besides the command, calibration, a learnt threshold.

Errors are rms of the torque prediction on flights that were not learnt from. Vehicles 0, 1 and 2 differ in the values
of their effects (`plants.vehicle`); the *draughty* one has a drag besides, with its centre above the centre of mass,
and flies level figure-8s at speed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.paper.flying import as_log, fly
from benchmarks.paper.plants import Plant, vehicle
from benchmarks.paper.running import Output, Report, in_parallel, main, median, table, triple
from wrenchgap.compensate import Compensator
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.identify.learning import TORQUE, alternatives, samples
from wrenchgap.learn.process import train
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess
from wrenchgap.learn.process.held_out_time import Coverage
from wrenchgap.learn.process.subsample import Kernel, subsample
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.trajectory import named

Indices = NDArray[np.intp]

VEHICLES = (0, 1, 2)
COUNTS = (50, 100, 200)
INPUTS: tuple[tuple[str, ...], ...] = ((), ("past",), ("velocity",), ("rates",), ("position",), ("past", "velocity"))
DRAG = {"linear_x": 1.5, "linear_y": 1.5, "linear_z": 1.5, "point_z": 0.06}
"""Of the draughty vehicle [N s/m, m]: a hull that sits high."""
REGIONS = 8
"""Parts of the training inputs that are left out in turn, to see what happens off the data."""


@dataclass(frozen=True)
class Case:
    """A vehicle with the log that is learnt from and unseen ones, by name."""

    plant: Plant
    training: OpenFlight
    unseen: dict[str, OpenFlight]

    def data(self, flight: OpenFlight, groups: tuple[str, ...]) -> tuple[Array, Array]:
        """Inputs (M, D) and torque mismatches (M, 3) of a flight."""
        found = samples(flight.records, self.plant.believed, groups)
        return found.inputs, found.outputs[:, 3:]

    def fit(self, settings: FitSettings) -> GaussianProcess:
        """What is learnt."""
        inputs, outputs = self.data(self.training, settings.inputs)
        return train.fit(inputs, outputs, TORQUE, settings)

    def errors(self, gp: GaussianProcess) -> dict[str, Array]:
        """Errors (M, 3) on the unseen flights."""
        found = {}
        for name, flight in self.unseen.items():
            inputs, outputs = self.data(flight, gp.settings.inputs)
            found[name] = outputs - gp.mean(inputs)
        return found


def case(name: str, number: int, quick: bool) -> Case:
    """A case by name: tilts about all axes or pitch to learn from, or the draughty vehicle at speed."""
    plant = vehicle(number)
    if name == "draughty":
        drag = make_effect(plant.truth.vehicle, "body_drag", DRAG)
        plant = replace(plant, truth=plant.truth.with_effects((*plant.truth.effects, drag)))
    learnt, others = {
        "pitch": ("pitch", ("pitch", "roll")),
        "tilts": ("multi_axis", ("figure8",)),
        "draughty": ("figure8_level", ("figure8_level",)),
    }[name]

    def flight(trajectory: str, seconds: float, excitation: float, seed: int) -> OpenFlight:
        seconds = 0.4 * seconds if quick else seconds
        asked = named(trajectory, seconds, excitation, seed)
        return as_log(fly(plant, asked, seed, name=trajectory), plant)

    unseen = {t: flight(t, 30.0, 0.0 if t != "roll" else 0.5, 60 + number) for t in others}
    return Case(plant, flight(learnt, 60.0, 1.0, number), unseen)


# --- which points, and what is behind them ---------------------------------------------------------------------------


def greedy(inputs: Array, first: GaussianProcess, count: int) -> Indices:
    """The samples with the largest variance given those chosen before: a pivoted Cholesky factor of the kernel.

    The kernel has the geometric mean of the lengthscales of a fit on medoids, as all outputs share the points. Source:
    Burt, Rasmussen and van der Wilk, JMLR 2020, section 4.
    """
    x = (inputs - first.input_mean) / first.input_scale
    kernel = Kernel(np.exp(np.log(first.lengthscales).mean(axis=0)), 1.0, 1.0)
    variance, factor, chosen = np.ones(len(x)), np.zeros((count, len(x))), []
    for k in range(count):
        pivot = int(np.argmax(variance))
        row = (kernel(x[pivot : pivot + 1], x)[0] - factor[:k, pivot] @ factor[:k]) / np.sqrt(variance[pivot] + 1e-9)
        factor[k], chosen = row, [*chosen, pivot]
        variance = np.maximum(variance - row**2, 0.0)
        variance[chosen] = -1.0
    return np.sort(np.array(chosen, dtype=np.intp))


def points(which: tuple[str, int, tuple[str, ...]], quick: bool) -> dict[str, dict[str, Array]]:
    """Unseen rms (3,) of each way to spend 50, 100 or 200 points."""
    name, number, groups = which
    given = case(name, number, quick)
    inputs, outputs = given.data(given.training, groups)
    found: dict[str, dict[str, Array]] = {}
    for count in COUNTS[:1] if quick else COUNTS:
        settings = FitSettings(points=count, restarts=0, inputs=groups)
        first = train.fit(inputs, outputs, TORQUE, settings)
        rng = np.random.default_rng(number)
        chosen = {
            "random": np.sort(rng.choice(len(inputs), min(count, len(inputs)), replace=False)),
            "greedy": greedy(inputs, first, min(count, len(inputs))),
        }
        ways = {
            "k-medoids": first,
            **{way: _on(inputs, outputs, settings, index) for way, index in chosen.items()},
            "sparse": train.fit(inputs, outputs, TORQUE, replace(settings, inference="sparse")),
        }
        for way, gp in ways.items():
            errors = next(iter(given.errors(gp).values()))  # not the roll flight, which is off the data
            found[f"{way} {count}"] = {"rms": np.sqrt(np.mean(errors**2, axis=0))}
    return found


def _on(inputs: Array, outputs: Array, settings: FitSettings, index: Indices) -> GaussianProcess:
    """A fit on the samples `index`, with scales and mean of all."""
    used = train.subsample
    train.subsample = lambda *_, **__: index  # the choice is what is under test
    try:
        return train.fit(inputs, outputs, TORQUE, settings)
    finally:
        train.subsample = used


# --- inputs besides the command ---------------------------------------------------------------------------------------


def inputs_of(which: tuple[str, int], quick: bool) -> dict[str, Any]:
    """Unseen rms (3,) with other inputs, what `learn` recommends, and coverage before and after calibration."""
    given = case(*which, quick)
    settings = FitSettings(points=40 if quick else 100, restarts=0)
    rms, before, after = {}, {}, {}
    for groups in INPUTS[:2] if quick else INPUTS:
        gp = given.fit(replace(settings, inputs=groups))
        name = ", ".join(("command", *groups))
        errors, shares = given.errors(gp), []
        rms[name] = {t: np.sqrt(np.mean(e**2, axis=0)) for t, e in errors.items()}
        for scale in (gp.sigma_scale, np.ones(3)):
            sigmas = [gp.std(given.data(f, groups)[0]) / gp.sigma_scale * scale for f in given.unseen.values()]
            shares.append(Coverage.of(np.concatenate(list(errors.values())), np.concatenate(sigmas)).within_95)
        after[name], before[name] = shares
    better = alternatives([given.training], given.plant.believed, TORQUE, settings).better
    advice = "nothing" if better is None else ", ".join((*better.settings.inputs, better.settings.inference))
    return {"rms": rms, "within_95_before": before, "within_95_after": after, "recommended": advice}


# --- a threshold from data --------------------------------------------------------------------------------------------


def threshold(number: int, quick: bool) -> dict[str, Any]:
    """Where the process stops helping: left-out regions of a pitch flight, and a roll flight that it never saw.

    `kept` is the share of what the process could take off the squared error of the roll flight, with the correction
    taken only where sigma is below a threshold.
    """
    given = case("pitch", number, quick)
    gp = given.fit(FitSettings(points=40 if quick else 100, restarts=0))
    inputs, outputs = given.data(given.training, ())
    sigma, gain = _off_the_data(gp, inputs, outputs)
    order = np.argsort(sigma)
    from_regions = float(sigma[order][int(np.argmax(np.cumsum(gain[order])))])
    half_way = float(Compensator(gp).uncertainty.threshold)
    roll, there = given.data(given.unseen["roll"], ())
    mean, std = gp.predict(roll)
    gains = np.sum((there**2 - (there - mean) ** 2) / gp.output_scale**2, axis=1)
    spread = std.max(axis=1)
    total = float(gains.sum())
    kept = {n: float(gains[spread < v].sum()) / total for n, v in (("regions", from_regions), ("half_way", half_way))}
    return {
        "largest_sigma_left_out": float(sigma.max()),
        "harmful_samples_left_out": float(np.mean(gain < 0)),
        "from_regions": from_regions,
        "half_way": half_way,
        "kept_from_regions": kept["regions"],
        "kept_half_way": kept["half_way"],
        "largest_sigma_roll": float(spread.max()),
    }


def _off_the_data(gp: GaussianProcess, inputs: Array, outputs: Array) -> tuple[Array, Array]:
    """Sigma (K,) and what the process takes off the squared error (K,), in regions that it does not know."""
    x = (inputs - gp.input_mean) / gp.input_scale
    centres = x[subsample(inputs, REGIONS)]

    def nearest(rows: Array) -> Indices:
        return np.argmin(((rows[:, None] - centres) ** 2).sum(axis=2), axis=1)

    region, of_points = nearest(x), nearest(gp.inputs)
    sigma, gain = np.empty(len(x)), np.empty(len(x))
    for k in range(REGIONS):
        known = of_points != k
        mean, std = replace(gp, inputs=gp.inputs[known], residuals=gp.residuals[known]).predict(inputs[region == k])
        there = outputs[region == k]
        sigma[region == k] = std.max(axis=1)
        gain[region == k] = np.sum((there**2 - (there - mean) ** 2) / gp.output_scale**2, axis=1)
    return sigma, gain


# --- the whole --------------------------------------------------------------------------------------------------------


def run(quick: bool, out: Output, report: Report) -> dict[str, Any]:
    """All of it, medians over the vehicles."""
    del out
    vehicles = VEHICLES[:1] if quick else VEHICLES
    groups: tuple[tuple[str, ...], ...] = ((), ("past",))
    ways = [(name, number, g) for name in ("pitch", "tilts") for g in groups for number in vehicles]
    ways = ways[:1] if quick else ways
    counted = in_parallel(partial(points, quick=quick), ways, report, "points")
    cases = [(name, number) for name in ("pitch", "tilts", "draughty") for number in vehicles]
    cases = cases[:1] if quick else cases
    looked = in_parallel(partial(inputs_of, quick=quick), cases, report, "inputs")
    thresholds = in_parallel(partial(threshold, quick=quick), vehicles, report, "thresholds")
    return {
        "points": {
            f"{name}, {', '.join(('command', *g))}": median(
                [c for c, w in zip(counted, ways, strict=True) if w[::2] == (name, g)]
            )
            for name, _, g in dict.fromkeys((n, 0, g) for n, _, g in ways)
        },
        "inputs": {
            name: {
                **{k: median([one[k] for one in of]) for k in ("rms", "within_95_before", "within_95_after")},
                "recommended": [one["recommended"] for one in of],
            }
            for name in dict.fromkeys(n for n, _ in cases)
            for of in [[one for one, (n, _) in zip(looked, cases, strict=True) if n == name]]
        },
        "threshold": median(thresholds),
    }


def tables(body: dict[str, Any]) -> str:
    """Points, inputs, calibration and threshold."""
    parts = []
    for name, found in body["points"].items():
        ways = list(dict.fromkeys(key.rsplit(" ", 1)[0] for key in found))
        counts = list(dict.fromkeys(key.rsplit(" ", 1)[1] for key in found))
        rows = [[way, *(triple(1e3 * np.array(found[f"{way} {c}"]["rms"]), 0) for c in counts)] for way in ways]
        parts.append(table([f"{name}: rms x / y / z [mNm]", *(f"{c} points" for c in counts)], rows))
    for name, found in body["inputs"].items():
        flights = list(next(iter(found["rms"].values())))
        rows = [
            [
                inputs,
                *(triple(1e3 * np.array(rms[f]), 0) for f in flights),
                *(triple(100 * np.array(found[f"within_95_{when}"][inputs]), 0) for when in ("before", "after")),
            ]
            for inputs, rms in found["rms"].items()
        ]
        advice = "; ".join(found["recommended"])
        head = [f"{name}: inputs", *(f"rms on {f} [mNm]" for f in flights), "in 1.96 sigma [%]", "calibrated [%]"]
        parts.append(f"{table(head, rows)}\n\n`learn` recommends for vehicles 0, 1, 2: {advice}.")
    one = body["threshold"]
    rows = [
        ["half way from floor to prior (default)", f"{one['half_way']:.2f}", f"{100 * one['kept_half_way']:.0f}"],
        ["where left-out regions stop gaining", f"{one['from_regions']:.2f}", f"{100 * one['kept_from_regions']:.0f}"],
    ]
    parts.append(table(["sigma_th", "[Nm]", "gain kept on an unseen roll flight [%]"], rows))
    return "\n\n".join(parts)


if __name__ == "__main__":
    main(("beyond",))
