"""A designed flight in words, in plain types, in its file and as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.blocks import INDISTINCT
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.design.designer import Design
from wrenchgap.learn.design.manoeuvres import Limits
from wrenchgap.learn.design.separability import LEAST_SHARE, Direction, Separability
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import content_hash, tool_version
from wrenchgap.plant.trajectory_file import TrajectoryFile
from wrenchgap.replay.present.documents import atomic, claim
from wrenchgap.replay.present.wrench_figure import LABELS, PREDICTED

Array = NDArray[np.float64]

MOST_PANELS = 4
"""How many directions a figure shows, the hardest first."""


def parse_room(text: str | None, limits: Limits) -> tuple[float, float, float]:
    """`"4,4,3"` as three lengths [m]; UsageError on anything else."""
    if text is None:
        return limits.room
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--room {text}: expected three lengths in metres, e.g. --room 4,4,3") from None
    return x, y, z


def sentence(design: Design) -> str:
    """The result in plain words."""
    names = " and ".join(design.expected.names)
    hard = design.expected.worst
    least = f"at least {INDISTINCT:g} is needed"
    if design.separable:
        before = design.before.separation
        found = min(design.simulated(d.truth, d.imitator) for d in design.expected.counting)
        was = "it cannot tell them apart" if not design.before.separable else "it can tell them apart already"
        return (
            f"This flight of {design.trajectory.duration:g} s tells {names} apart: expected separation "
            f"{design.expected.separation:.1f}, simulated {found:.1f} ({least}). "
            f"{design.baseline[:1].upper()}{design.baseline[1:]}: {_separation(before)}; {was}."
        )
    if design.expected.separable:
        return (
            f"The best flight found should tell {names} apart (expected separation {design.expected.separation:.1f}), "
            f"but fits to the simulated flights do not confirm it ({least}); do not rely on it."
        )
    return (
        f"No reference trajectory within these limits tells {names} apart: {_reason(hard)}. "
        f"Expected separation of the best flight found: {hard.separation:.1f} ({least})."
    )


def _reason(direction: Direction) -> str:
    """Why a direction cannot be told."""
    if not np.any(direction.added > 0):
        return f"{direction.truth} of this size does not show at all"
    if direction.share < LEAST_SHARE:
        return (
            f"{direction.imitator} can imitate all but {100 * direction.share:.1f} % of what {direction.truth} adds "
            f"(cosine {direction.cosine:.3f})"
        )
    return f"what {direction.imitator} leaves of {direction.truth} is lost in the noise"


def next_flight(names: Sequence[str], source: str, logs: Sequence[str | Path] = ()) -> str:
    """The command that designs a flight to tell `names` apart, for the result of `explain`."""
    given = f" --from {' '.join(map(str, logs))}" if logs else ""
    return f"wrenchgap design {' '.join(names)} -m {source}{given} -o separate.toml"


def directions(design: Design) -> list[tuple[str, ...]]:
    """Rows for a table: truth, imitator, separations before, expected and simulated, imitated share, where it shows."""
    before = {(d.truth, d.imitator): d for d in design.before.directions}
    rows: list[tuple[str, ...]] = []
    for d in design.expected.directions:
        old = before[d.truth, d.imitator]
        telling = f"{AXES[d.telling]}, {d.left[d.telling] / d.noise[d.telling]:.1f} x noise" if d.told else "-"
        rows.append(
            (
                d.truth,
                d.imitator if d.counts else f"{d.imitator} (richer)",
                _cosine(old.cosine),
                _separation(old.separation),
                _cosine(d.cosine),
                _separation(d.separation),
                _separation(design.simulated(d.truth, d.imitator)),
                telling,
            )
        )
    return rows


def _separation(value: float) -> str:
    """Beyond a hundred no digit says anything."""
    return f"{value:.1f}" if value < 100.0 else "> 100"


def _cosine(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "-"


def flown(design: Design) -> str:
    """How the flight went on the plant, in one line."""
    most = {name: max(getattr(f, name) for f in design.flown) for name in ("tilt_max", "speed_max", "rotor_max")}
    error = max(f.position_error for f in design.flown)
    parts = [f"tilt to {np.degrees(most['tilt_max']):.0f} deg", f"{most['speed_max']:.2f} m/s"]
    if most["rotor_max"] > 0:
        parts.append(f"rotors to {100 * most['rotor_max']:.0f} % of their speed")
    return ", ".join([*parts, f"within {100 * error:.1f} cm of the reference"])


def sizes(design: Design, model: Model) -> list[tuple[str, str, float, float | None, str]]:
    """(effect, parameter, value, std, unit) of the effects as they were assumed."""
    return [
        (e.name, p.name, float(v), None, p.unit)
        for e in design.effects
        for p, v in zip(e.effect.parameters(model.vehicle), e.theta, strict=True)
    ]


def finished(design: Design, model: Model, flights: Sequence[OpenFlight], name: str) -> TrajectoryFile:
    """The file to write: the trajectory, and what it is for."""
    before = {(d.truth, d.imitator): d for d in design.before.directions}
    purpose = {
        "separates": list(design.expected.names),
        "made_by": f"wrenchgap {tool_version()} design",
        "model": model.name,
        "model_sha256": content_hash(model),
        "logs": [f.flight.path.name for f in flights],
        "manoeuvres": [str(s) for s in design.segments],
        "before": design.baseline,
        "expected": [
            {
                "truth": d.truth,
                "imitator": d.imitator,
                "separation": round(d.separation, 2),
                "separation_before": round(before[d.truth, d.imitator].separation, 2),
                "separation_simulated": round(design.simulated(d.truth, d.imitator), 2),
            }
            for d in design.expected.directions
        ],
    }
    return TrajectoryFile(name, design.trajectory, model.vehicle.name, purpose)


def to_json(design: Design, model: Model) -> dict[str, Any]:
    """The body of the `design` schema."""
    limits = design.limits
    return {
        "effects": [
            {
                "effect": e.name,
                "parameters": [
                    {"name": p.name, "value": float(v), "unit": p.unit}
                    for p, v in zip(e.effect.parameters(model.vehicle), e.theta, strict=True)
                ],
            }
            for e in design.effects
        ],
        "separable": design.separable,
        "summary": sentence(design),
        "advice": [] if design.separable else list(design.advice),
        "axes": list(AXES),
        "baseline": design.baseline,
        "before": _separability(design.before, design, simulated=False),
        "expected": _separability(design.expected, design, simulated=True),
        "manoeuvres": [
            {"name": s.name, "vigour": s.vigour, "azimuth_deg": np.degrees(s.azimuth)} for s in design.segments
        ],
        "duration_s": design.trajectory.duration,
        "limits": {"room_m": list(limits.room), "tilt_deg": np.degrees(limits.tilt), "speed_m_s": limits.speed},
        "flown": [
            {
                "truth": f.truth,
                "tilt_max_deg": np.degrees(f.tilt_max),
                "speed_max_m_s": f.speed_max,
                "rotor_max": f.rotor_max,
                "position_error_max_m": f.position_error,
                "attitude_error_max_deg": np.degrees(f.attitude_error),
            }
            for f in design.flown
        ],
        "tried": design.tried,
        "least_separation": INDISTINCT,
    }


def _separability(found: Separability, design: Design, *, simulated: bool) -> dict[str, Any]:
    listed = []
    for d in found.directions:
        entry = {
            "truth": d.truth,
            "imitator": d.imitator,
            "counts": d.counts,
            "told": d.told,
            "cosine": d.cosine,
            "share_left": d.share,
            "evidence": d.evidence,
            "separation": d.separation,
            "added_rms": d.added,
            "left_rms": d.left,
            "noise": d.noise,
        }
        if simulated:
            entry["separation_simulated"] = design.simulated(d.truth, d.imitator)
        listed.append(entry)
    return {
        "seconds": found.seconds,
        "separation": found.separation,
        "separable": found.separable,
        "directions": listed,
    }


def figure(design: Design, path: Path, *, force: bool = False) -> None:
    """The reference; below, for each direction, what the truth adds and its imitation on the axis that tells most."""
    claim({"--figure": path}, force=force)
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    shown = sorted(design.expected.directions, key=lambda d: d.merit)[:MOST_PANELS]
    panels, axes = plt.subplots(
        2 + len(shown), 1, figsize=(11, 2.2 * (2 + len(shown))), layout="constrained", sharex=True
    )
    _reference(axes[0], axes[1], design)
    for panel, d in zip(axes[2:], shown, strict=True):
        added, imitated = (part[:, d.telling] for part in d.traces)
        cut = 0.5 * (design.trajectory.duration - design.expected.seconds)  # what the filter needs at either end
        time = np.linspace(cut, design.trajectory.duration - cut, len(added))
        panel.plot(time, added, color="black", lw=1.1, label=f"{d.truth} adds")
        panel.plot(time, imitated, color=PREDICTED[1], lw=1.1, label=f"best that {d.imitator} can do")
        panel.fill_between(time, added, imitated, color=PREDICTED[1], alpha=0.15, lw=0)
        panel.set_ylabel(LABELS[d.telling])
        panel.set_title(
            f"{d.truth} or {d.imitator}: separation {d.separation:.1f} expected, "
            f"{design.simulated(d.truth, d.imitator):.1f} simulated",
            loc="left",
            fontsize=10,
        )
    for panel in axes:
        panel.grid(alpha=0.3)
        panel.margins(x=0.01)
        panel.legend(loc="upper right", fontsize=8, frameon=False, ncols=3)
    axes[-1].set_xlabel("time [s]")
    panels.suptitle(f"{', '.join(map(str, design.segments))}", x=0.01, ha="left", fontsize=11)
    try:
        with atomic(path) as partial:
            panels.savefig(partial, dpi=110, format="png")
    finally:
        plt.close(panels)


def _reference(place: Any, attitude: Any, design: Design) -> None:
    """Position; tilt, heading and speed of the reference."""
    r = design.trajectory.at(np.linspace(0.0, design.trajectory.duration, 1500))
    for axis, colour in zip(range(3), PREDICTED, strict=False):
        place.plot(r.time, r.position_E[:, axis], color=colour, lw=1.1, label="xyz"[axis])
    place.set_ylabel("position [m]")
    heading = so3.rotate(r.quat_ED, np.array([1.0, 0.0, 0.0]))
    turned = np.degrees(np.unwrap(np.arctan2(heading[:, 1], heading[:, 0])))
    attitude.plot(r.time, np.degrees(so3.tilt_angle(r.quat_ED)), color=PREDICTED[0], lw=1.1, label="tilt")
    attitude.plot(r.time, turned, color=PREDICTED[2], lw=1.1, label="direction of body x")
    attitude.set_ylabel("[deg]")
