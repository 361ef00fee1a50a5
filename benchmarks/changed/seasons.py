"""Seasons of the tilting hexarotor: a propeller that wears, a centre of mass that moved, nothing; what `trend` says."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.hidden_effects.engine import fly
from wrenchgap import load_model, open_flights
from wrenchgap.learn.identify.trend import trend

Row = dict[str, Any]
FLIGHTS, SECONDS, MOVED = 20, 6.0, 13
"""Flights of a season, seconds of each, the flight (from 0) at which the centre of mass moved: the fourteenth."""
LOADING, ROTOR = 2e-4, 0.002
"""Scatter between flights: centre of mass [m], thrust of the wearing rotor (1)."""
WORN = 4
SEASONS: tuple[tuple[str, float], ...] = (
    ("none", 0.0),
    ("moved", 0.0012),
    ("moved", 0.002),
    ("wearing", 0.02),
    ("wearing", 0.05),
)
"""What happens, and its size: m that the centre of mass moves along y, thrust that the rotor has lost at the end."""


def season(kind: str, size: float, seed: int) -> Row:
    """Fly and follow one season."""
    rng = np.random.default_rng([seed, 67])
    model = load_model("tilt_hexarotor")
    flights = []
    for k in range(FLIGHTS):
        x, y = LOADING * rng.normal(size=2)
        y += size * (kind == "moved" and k >= MOVED)
        loss = ROTOR * rng.normal() + size * (kind == "wearing") * k / (FLIGHTS - 1)
        hidden = ({"x": float(x), "y": float(y)}, {"rotor": WORN, "loss": float(loss)})
        flight, _ = fly(("com_offset", "weak_rotor"), hidden, "train", SECONDS, seed=1000 * seed + k)
        flights.append(replace(flight, path=flight.path.with_name(f"flight{k + 1}{flight.path.suffix}")))
    start = time.process_time()
    found = trend(open_flights(flights, model), model, ("com_offset", "rotor_thrust"))
    said = [
        {
            "parameter": f"{p.effect} {p.name}",
            "verdict": str(p.course.verdict),
            "steps": [[s.flight + 1, s.size, s.low, s.high] for s in p.course.steps],
            "drift": None if p.course.drift is None else p.course.drift.slope,
        }
        for p in found.changed
    ]
    cpu = round(time.process_time() - start, 1)
    return {"season": f"{kind}.{size:g}.{seed}", "kind": kind, "size": size, "said": said, "cpu_seconds": cpu}
