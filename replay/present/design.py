"""A designed flight: the result in words, tables, JSON, and the files that are written."""

import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchgap.flight import AXES, so3
from wrenchgap.flight.atomic import atomic, write_text
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.design.design_result import Design
from wrenchgap.learn.design.designer import SEARCH
from wrenchgap.learn.design.separability import SEPARATION, Direction, Separability
from wrenchgap.plant.history import Snapshot
from wrenchgap.plant.model_file import content_hash, tool_version
from wrenchgap.plant.trajectory import file as trajectory_file
from wrenchgap.plant.trajectory.file import TrajectoryFile
from wrenchgap.replay.present.addition import effects_json
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.notes import of_flights
from wrenchgap.replay.present.numbers import capitalised, entries, listed, separation
from wrenchgap.replay.present.tables import Line, Part, note_lines, parameters, table

ADVICE: tuple[tuple[tuple[str, ...], str], ...] = (
    (("mass", "payload"), "weigh the vehicle as it flies: scales settle the mass"),
    (
        ("coaxial_loss", "drag_torque", "rotor_gyroscopic"),
        "let the allocation run the two rotors of a pair at unequal speeds: at equal speeds a loss of the lower rotor "
        "is a loss of all thrust",
    ),
    (("thrust_scale",), "measure the thrust of a rotor on a stand, or compare flights in air of another density"),
    (("inertia",), "swing the vehicle as a pendulum on two strings: that gives its inertia without thrust"),
    (("wind",), "fly the same moves in still air"),
    (("tether",), "fly the same moves without cable or contact"),
    (("imu_misalignment", "imu_lever_arm"), "check the IMU's place and alignment on the bench"),
)

OF_ONE_PLACE = ("rotor_thrust", "tilt_offset", "arm_twist", "rotor_interference", "downwash_blockage")
"""Effects of one rotor or arm, which the allocation ties to the wrench."""
WITH_TILT = (
    "move the arms in their null space (tilt neighbours against each other while the wrench stays): a fixed "
    "allocation ties every arm to the wrench"
)
WITHOUT_TILT = (
    "exchange two propellers that turn alike and fly again: a weakness moves with a propeller, and stays with a motor "
    "or the centre of mass"
)


def design_command(names: Sequence[str], model: str, paths: Sequence[str], options: str = "") -> str:
    """The command that designs a flight to separate `names`, for the logs at `paths`.

    `options` say how to read them, with a space before them.
    """
    line = ["wrenchgap", "design", *names, "-m", model, *(["--from", *paths] if paths else [])]
    return f"{shlex.join(line)}{options} -o separate.toml"


def advice(design: Design) -> tuple[str, ...]:
    """What else separates these effects, where no reference trajectory can."""
    names, arms = set(design.expected.names), design.model.vehicle.arms
    tilting = arms is not None and bool(arms.tilts.any())
    first = (WITH_TILT if tilting else WITHOUT_TILT,) if names & set(OF_ONE_PLACE) else ()
    return (*first, *(words for about, words in ADVICE if set(about) & names))


def parts(design: Design) -> list[Part]:
    """The result, separations by direction, the assumed sizes of the effects, how the flight went on the plant."""
    out = [Line(sentence(design), "bold")]
    out += [Line(f"  instead: {words}") for words in ([] if design.separable else advice(design))]
    before = ((f"{design.baseline}:", "cosine"), ("", "separation"))
    after = (("this flight:", "cosine"), ("", "separation"), ("", "simulated"), ("separable", "on"))
    heads = (("in the", "vehicle"), ("in the", "model"), *before, *after)
    separations = table("separation of the two effects", heads, directions(design), left=2)
    return [
        *out,
        Line(),
        separations,
        parameters(sizes(design), "assumed sizes of the effects", design.model.vehicle),
        Line(f"moves: {', '.join(map(str, design.segments))}"),
        Line(f"on the simulated vehicle: {flown(design)}"),
        *note_lines(of_flights(design.flights)),
    ]


def write(design: Design, output: Path, csv: Path | None) -> None:
    """The trajectory file, and the sampled reference where it is asked for."""
    file = finished(design, output.stem)
    write_text(output, trajectory_file.dumps(file))
    if csv is not None:
        with atomic(csv) as partial:
            trajectory_file.write_csv(file, partial, design.model.controller.rate_hz)


def sentence(design: Design) -> str:
    """The result in plain words."""
    names = " and ".join(design.expected.names)
    hard = design.expected.worst
    least = f"at least {SIGNIFICANCE.indistinct:g} is needed"
    if design.separable:
        before = design.before.separation
        found = min(design.simulated(d.truth, d.imitator) for d in design.expected.counting)
        was = _before(design.before)
        return (
            f"This flight of {design.trajectory.duration:g} s separates {names}: expected separation "
            f"{design.expected.separation:.1f}, simulated {found:.1f} ({least}). "
            f"{capitalised(design.baseline)}: {separation(before)}; {was}."
        )
    if design.expected.separable:
        return (
            f"The best flight found should separate {names} (expected separation {design.expected.separation:.1f}), "
            f"but fits to the simulated flights do not confirm it ({least}); do not rely on it."
        )
    pairs = [f"{one} from {other}" for one, other in design.alike]
    said = f"No reference trajectory within these limits separates {listed(pairs, 4, last=', or ')}: {_reason(hard)}."
    if len(pairs) < math.comb(len(design.expected.names), 2):
        said += " The other pairs are separated by the best flight found (`--anyway` writes it)."
    if hard.separation >= SIGNIFICANCE.indistinct:  # by its share, not by the noise
        return said
    return f"{said} Expected separation of the best flight found: {hard.separation:.1f} ({least})."


def _before(before: Separability) -> str:
    """Whether the effects were told apart already: by what they do, or one of them as the simpler alone."""
    if not before.separable:
        return "they are indistinguishable there"
    alike = next((d for d in before.directions if not d.told), None)
    if alike is None:
        return "they are separable there already"
    return f"but what {alike.truth} does there {alike.imitator} does as well: it is named as the simpler one, if at all"


def _reason(direction: Direction) -> str:
    if not np.any(direction.added > 0):
        return f"{direction.truth} of this size changes nothing that is measured"
    if direction.share < SEPARATION.least_share:
        return (
            f"{direction.imitator} can imitate all but {100 * direction.share:.1f} % of what {direction.truth} adds "
            f"(cosine {direction.cosine:.3f})"
        )
    return f"what {direction.imitator} leaves of {direction.truth} is below the noise"


def directions(design: Design) -> list[tuple[str, ...]]:
    """Rows for a table: truth, imitator, separations before, expected and simulated, imitated share, where it shows."""
    rows: list[tuple[str, ...]] = []
    for d, old in _pairs(design):
        telling = f"{AXES[d.telling]}, {d.left[d.telling] / d.noise[d.telling]:.1f} x noise" if d.told else "-"
        cosines = (f"{one.cosine:.3f}" if np.isfinite(one.cosine) else "-" for one in (old, d))
        before, after = zip(cosines, (separation(old.separation), separation(d.separation)), strict=True)
        imitator = d.imitator if d.counts else f"{d.imitator} (richer)"
        rows.append((d.truth, imitator, *before, *after, separation(design.simulated(d.truth, d.imitator)), telling))
    return rows


def _pairs(design: Design) -> list[tuple[Direction, Direction]]:
    """Each direction as expected of the flight, and as it was before."""
    before = {(d.truth, d.imitator): d for d in design.before.directions}
    return [(d, before[d.truth, d.imitator]) for d in design.expected.directions]


def flown(design: Design) -> str:
    """How the flight went on the plant, in one line."""
    most = {name: max(getattr(f, name) for f in design.flown) for name in ("tilt_max", "speed_max", "rotor_max")}
    error = max(f.position_error for f in design.flown)
    parts = [f"tilt to {np.degrees(most['tilt_max']):.0f} deg", f"{most['speed_max']:.2f} m/s"]
    if most["rotor_max"] > 0:
        parts.append(f"rotors to {100 * most['rotor_max']:.0f} % of their speed")
    return ", ".join([*parts, f"within {100 * error:.1f} cm of the reference"])


def sizes(design: Design) -> list[Snapshot]:
    """The effects as they were assumed."""
    assumed = tuple(replace(e, std=None) for e in design.effects)
    return list(replace(design.model, effects=assumed).snapshot)


def finished(design: Design, name: str) -> TrajectoryFile:
    """The file to write: the trajectory, and what it is for."""
    model = design.model
    purpose = {
        "separates": list(design.expected.names),
        "made_by": f"wrenchgap {tool_version()} design",
        "model": model.name,
        "model_sha256": content_hash(model),
        "logs": [f.flight.path.name for f in design.flights],
        "manoeuvres": [str(s) for s in design.segments],
        "before": design.baseline,
        "expected": [
            {
                "truth": d.truth,
                "imitator": d.imitator,
                "separation": round(d.separation, 2),
                "separation_before": round(before.separation, 2),
                "separation_simulated": round(design.simulated(d.truth, d.imitator), 2),
            }
            for d, before in _pairs(design)
        ],
    }
    return TrajectoryFile(name, design.trajectory, model.vehicle.name, purpose)


def to_json(design: Design) -> dict[str, Any]:
    """The body of the `design` schema."""
    limits = design.limits
    flown = ("truth", "speed_max_m_s=speed_max", "rotor_max", "position_error_max_m=position_error")
    return {
        "effects": effects_json(sizes(design)),
        "separable": design.separable,
        "summary": sentence(design),
        "advice": [] if design.separable else list(advice(design)),
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
                **entries(f, *flown),
                "tilt_max_deg": np.degrees(f.tilt_max),
                "attitude_error_max_deg": np.degrees(f.attitude_error),
            }
            for f in design.flown
        ],
        "tried": design.tried,
        "least_separation": SIGNIFICANCE.indistinct,
        "notes": of_flights(design.flights),
    }


def _separability(found: Separability, design: Design, *, simulated: bool) -> dict[str, Any]:
    names = ("truth", "imitator", "counts", "told", "cosine", "share_left=share", "evidence", "separation")
    listed = [entries(d, *names, "added_rms=added", "left_rms=left", "noise") for d in found.directions]
    if simulated:
        for entry in listed:
            entry["separation_simulated"] = design.simulated(entry["truth"], entry["imitator"])
    return {**entries(found, "seconds", "separation", "separable"), "directions": listed}


def frame(design: Design) -> list[dict[str, Any]]:
    """One row for each direction: truth, imitator, separation before, expected and simulated, cosine."""
    return [
        {
            **entries(d, "truth", "imitator", "counts"),
            "before": before.separation,
            "expected": d.separation,
            "simulated": design.simulated(d.truth, d.imitator),
            "cosine": d.cosine,
        }
        for d, before in _pairs(design)
    ]


def picture(design: Design) -> style.Picture:
    """Five panels of the reference and one for each direction.

    Axes are (5 + D, 1): position x, y, z, tilt and heading of the reference over time, then the D directions ("if it is
    this and the model has that"), at most four, the hardest first. Dashed lines part the manoeuvres.
    """
    count = len(_shown(design))
    size, heights = (11.0, 1.3 * 5 + 2.1 * count + 0.6), [1.0] * 5 + [1.7] * count
    title = f"reference of {design.trajectory.duration:g} s that separates {' and '.join(design.expected.names)}"
    return style.Picture((5 + count, 1), size, lambda axes: _draw(design, axes), title, heights, share=True)


def _shown(design: Design, most: int = 4) -> list[Direction]:
    return sorted(design.expected.directions, key=lambda d: d.merit)[:most]


def _draw(design: Design, axes: Any) -> None:
    panels = axes[:, 0]
    _reference(panels[:5], design)
    for panel, direction in zip(panels[5:], _shown(design), strict=True):
        _direction(panel, design, direction)
    style.over_time(axes)
    starts = np.linspace(SEARCH.rest, design.trajectory.duration - SEARCH.rest, len(design.segments) + 1)
    for start, segment in zip(starts, design.segments, strict=False):
        place = {"xycoords": ("data", "axes fraction"), "va": "bottom"}
        panels[0].annotate(str(segment), (start, 1.02), **place, fontsize=style.SMALL)
    for panel in panels:
        for start in starts:
            panel.axvline(start, color="0.6", lw=0.7, ls="--", zorder=0)


def _reference(panels: Any, design: Design) -> None:
    """Position, tilt, and the heading as it turns on past 180 deg."""
    r = design.trajectory.at(np.linspace(0.0, design.trajectory.duration, 1500))
    nose = so3.rotate(r.quat_ED, np.array([1.0, 0.0, 0.0]))
    heading = np.degrees(np.unwrap(np.arctan2(nose[:, 1], nose[:, 0])))
    tilt = np.degrees(so3.tilt_angle(r.quat_ED))
    named = [*((axis, "m", r.position_E[:, k]) for k, axis in enumerate("xyz")), ("tilt", "deg", tilt)]
    for panel, (name, unit, values) in zip(panels, [*named, ("heading", "deg", heading)], strict=True):
        panel.plot(r.time, values, color=style.MEASURED, lw=1.1)
        middle, half = 0.5 * float(values.max() + values.min()), 0.55 * float(np.ptp(values))
        least = 0.05 if unit == "m" else 2.0  # a flat line is flat, not a scale of nanometres
        panel.set_ylim(middle - max(half, least), middle + max(half, least))
        style.labelled(panel, name, unit)


def _direction(panel: Any, design: Design, d: Direction) -> None:
    """What the truth adds and its imitation, on the axis that tells most; the filter has cut either end."""
    added, imitated = (part[:, d.telling] for part in d.traces)
    cut = 0.5 * (design.trajectory.duration - design.expected.seconds)
    time = np.linspace(cut, design.trajectory.duration - cut, len(added))
    panel.plot(time, added, color=style.MEASURED, lw=1.1, label=f"{d.truth} adds")
    panel.plot(time, imitated, color=style.MODELS[1], lw=1.1, label=f"best imitation by {d.imitator}")
    look = {"color": style.MODELS[1], "alpha": 0.2, "lw": 0}
    panel.fill_between(time, added, imitated, **look, label="difference that separates them")
    style.band(panel, [cut, design.trajectory.duration - cut], float(d.noise[d.telling]), "± 1 sigma of the noise")
    style.labelled(panel, *style.QUANTITIES[d.telling])
    found = f"separation {d.separation:.1f} expected, {design.simulated(d.truth, d.imitator):.1f} simulated"
    panel.set_title(f"{d.truth} or {d.imitator}? {found}", loc="left", fontsize=style.USUAL, pad=18)
    style.legend(panel)
