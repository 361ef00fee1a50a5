"""The tables of docs/do-no-harm.md and benchmarks/notes/do-no-harm.md, written from the rows that are kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harm import parts, rows, smooth, vehicles
from benchmarks.pages import NOTES, renewed
from benchmarks.paper.methods import CUTOFFS_HZ
from benchmarks.paper.plants import believed
from benchmarks.paper.running import mrad, table
from wrenchgap.learn.identify.guard import loop_of
from wrenchgap.plant.stability import Observer, sensitivity_peak

PAGES = Path(__file__).parents[2] / "docs" / "do-no-harm.md", NOTES / "do-no-harm.md"
SWING = 5e-3
"""Above that without compensation [rad]."""
RATIO = 1.05
"""Of the late error, to that without compensation."""
LAGS, BANDWIDTHS = (0.06, 0.08, 0.1), (0.0, 0.3, 0.5, 1.0, 2.0, 3.0, 6.0)
"""Of the table of margins [s], [Hz]."""


def of_vehicles(found: dict[str, dict[str, Any]]) -> str:
    """What became of the roll steps, by kind of vehicle and training."""
    head = [
        "vehicles",
        "flights",
        "method",
        "lost",
        "swinging",
        f"late error > {RATIO:g} x",
        "worst ratio",
        "median reduction [%]",
        "outputs compensated",
    ]
    lines = []
    for kind in vehicles.KINDS:
        for training in vehicles.TRAININGS:
            some = [r for key, r in found.items() if key.split()[1:] == [kind, training]]
            lines += [_line(f"{kind}, {training} training", some, name) for name in ("GP", "combined") if some]
    return table(head, lines)


def _line(words: str, some: list[dict[str, Any]], name: str) -> list[str]:
    ratios = np.array([r[name]["late"] / r["none"]["late"] for r in some])
    swinging = sum(r[name]["swing"] > r["none"]["swing"] + SWING for r in some)
    used = sum(g > 0 for r in some for g in r["gain"])
    fall = f"{100 * (1 - np.median(ratios)):.1f}" if words.startswith("hidden") else "-"
    counts = [str(int(sum(r[name]["lost"] for r in some))), str(swinging), str(int((ratios > RATIO).sum()))]
    return [words, str(len(some)), name, *counts, f"{ratios.max():.2f}", fall, f"{used} of {3 * len(some)}"]


def of_parts(found: dict[str, dict[str, Any]]) -> str:
    """Mean attitude errors under every condition."""
    names = {"none": "none", "plain": "observer, 4 Hz", "observer": "observer, from the log", "GP": "GP"}
    names |= {"combined": "combined", **{law: f"{law}, {CUTOFFS_HZ[law]:g} Hz" for law in parts.FEEDBACK}}
    lines = []
    for key, row in found.items():
        index, trajectory = key.split()
        cells = ["lost" if row[name] is None else mrad(row[name]) for name in names]
        chosen = f"{row['hz']:.1f}, {1e3 * row['told']:.0f} ms, {row['peak']:.1f}"
        lines.append([f"{trajectory}, {parts.CONDITIONS[int(index)].name}", *cells, chosen])
    return table(["mean abs(e_R) x / y / z [mrad]", *names.values(), "observer [Hz], told, M_s"], lines)


def of_smooth(found: dict[str, dict[str, Any]]) -> str:
    """Mean attitude errors on the figure-8 after smooth training."""
    lines = []
    for key, row in found.items():
        cells = ["lost" if row[name] is None else mrad(row[name]) for name in smooth.METHODS]
        lines.append([key, *cells, ", ".join(axis.removeprefix("torque_") for axis in row["blind"]) or "-"])
    return table(["vehicle: mean abs(e_R) x / y / z [mrad]", *smooth.METHODS.values(), "blind to torques"], lines)


def of_margins() -> str:
    """Peaks of the sensitivity of the benchmark's attitude loop, by the observer's bandwidth and what it is told."""
    found = []
    for lag in LAGS:
        loop = replace(loop_of(believed()), lag=lag)
        for told, words in ((0.0, "told nothing"), (lag, "told the lag")):
            peaks = [sensitivity_peak(loop, Observer(hz, told)) for hz in BANDWIDTHS]
            cells = [f"{peak:.1f}" if np.isfinite(peak) else "unstable" for peak in peaks]
            found.append([f"{1e3 * lag:.0f} ms, {words}", *cells])
    return table(["lag", *(f"{hz:g} Hz" if hz else "no observer" for hz in BANDWIDTHS)], found)


KEPT = {"vehicles": of_vehicles, "parts": of_parts, "smooth": of_smooth}


def renew() -> None:
    """Write the pages with the tables of the rows that are kept."""
    made = {name: of(rows.kept(rows.RESULTS / f"{name}.jsonl")) for name, of in KEPT.items()} | {
        "margins": of_margins()
    }
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        own = {name: tables for name, tables in made.items() if f"<!-- /{name} -->" in text}
        page.write_text(renewed(text, own), encoding="utf-8")
