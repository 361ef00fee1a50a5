"""The text of the model file of a completed draft: every number has a comment with its source."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import tomlkit

from wrenchgap._escaping import printable
from wrenchgap.plant.drafts.draft import TYPICAL, Draft, EffectDraft, RotorDraft, Sourced
from wrenchgap.plant.model_file.writing import toml_value
from wrenchgap.plant.reader import BOUNDS

GRANTED = (
    ("thrust_tolerance", TYPICAL.thrust_std, "another battery and air change the thrust of all rotors; calibrate"),
    ("thrust_axis_tolerance_deg", TYPICAL.thrust_axis_std, "how motors sit in their mounts: a yaw trim"),
)
"""What a draft by throttle says of how well it is known."""
SHARED = ("c_f", "kappa", "radius", "speed_min", "speed_max")
"""Numbers that rotors usually have in common."""


def text_of(draft: Draft, headline: Sequence[str]) -> str:
    """TOML of a completed draft; `headline` are lines for its top."""
    top = [f"# {printable(line)}" for line in headline]
    cutoff = [] if draft.cutoff_hz is None else [_line("cutoff_hz", draft.cutoff_hz)]
    lines = [*top, "schema = 1", *cutoff, "", "[vehicle]", f"name = {_text(draft.name)}"]
    lines += [_line(key, getattr(draft, key)) for key in ("mass", "inertia", "com", "imu_position")]
    if draft.command is not None:  # where commands are throttle, thrust is known from one hover, or a data sheet
        lines += [_line(key, Sourced(std, words, assumed=True)) for key, std, words in GRANTED]
    lines += ["", *_shared(draft.rotors)]
    for group in _arms(draft.rotors):
        lines += ["", *_arm(draft.rotors, group)]
    if draft.command is not None:
        lines += ["", "[command]", *(_line(key, sourced) for key, sourced in draft.command.keys.items())]
        if (full := draft.command.thrust_max) is not None:
            lines += [_line("thrust_max", full), f"source = {_text(full.source)}"]
    if draft.topics:
        lines += ["", "[topics]", *(f"{role} = {_text(topic)}" for role, topic in draft.topics.items())]
    for effect in draft.effects:
        lines += ["", *_effect(effect)]
    return "\n".join(lines) + "\n"


def _effect(effect: EffectDraft) -> list[str]:
    """[[effects]]; a rewrite of the file keeps the source of its values, and no comments."""
    values = [f"{name} = {toml_value(value)}" for name, value in effect.values.items()]
    provenance = ["[effects.provenance]", f"method = {_text(effect.source)}"]
    return ["[[effects]]", f"name = {_text(effect.name)}", "[effects.parameters]", *values, *provenance]


def _text(value: str) -> str:
    return str(tomlkit.string(printable(value)[: BOUNDS.name]).as_string())


_value = partial(toml_value, digits=6)


def _line(key: str, sourced: Sourced) -> str:
    value = _value(sourced.value)
    if sourced.tolerance is not None:
        value = f"{{ value = {value}, tolerance = {_value(sourced.tolerance)} }}"
    return _commented(f"{key} = {value}", _words(sourced))


def _commented(entry: str, words: str, column: int = 58) -> str:
    return entry.ljust(column) + f"  # {words}"


def _words(sourced: Sourced) -> str:
    return printable(f"ASSUMED: {sourced.source}" if sourced.assumed else sourced.source)


def _alike(rotors: Sequence[RotorDraft], key: str) -> bool:
    return len({_value(getattr(r, key).value) for r in rotors}) == 1


def _said(rotors: Sequence[RotorDraft]) -> list[str]:
    """The numbers of `SHARED` that all rotors have."""
    return [key for key in SHARED if all(getattr(r, key) is not None for r in rotors)]


def _shared(rotors: Sequence[RotorDraft]) -> list[str]:
    """[vehicle.arm] and [vehicle.rotor]: the common values."""
    lines = [] if any(r.tilt for r in rotors) else ["[vehicle.arm]", "tilts = false", ""]
    common = [_line(key, getattr(rotors[0], key)) for key in _said(rotors) if _alike(rotors, key)]
    return [*lines, "[vehicle.rotor]", *common] if common else lines


def _arms(rotors: Sequence[RotorDraft]) -> list[list[int]]:
    """Rotors by arm, in their order: consecutive coaxial rotors share one."""
    groups: list[list[int]] = []
    for r, rotor in enumerate(rotors):
        if groups and _coaxial(rotors[groups[-1][-1]], rotor):
            groups[-1].append(r)
        else:
            groups.append([r])
    return groups


def _coaxial(first: RotorDraft, second: RotorDraft, tolerance: float = 1e-6) -> bool:
    """Whether one rotor is above the other, to a tolerance [m]."""
    away = np.subtract(second.position_B.value, first.position_B.value)
    along = np.asarray(first.direction_B.value)
    same = np.linalg.norm(np.subtract(second.direction_B.value, along)) < tolerance
    height = float(away @ along)
    return bool(same and abs(height) > tolerance and np.linalg.norm(away - height * along) < tolerance)


def _arm(rotors: Sequence[RotorDraft], group: Sequence[int]) -> list[str]:
    """[[vehicle.arms]] of the rotors `group`; the hub point is in their middle."""
    first = rotors[group[0]]
    hubs = np.array([rotors[r].position_B.value for r in group])
    middle, along = hubs.mean(axis=0), np.asarray(first.direction_B.value)
    lines = ["[[vehicle.arms]]", _line("position", replace(first.position_B, value=middle + 0.0))]
    if not np.allclose(along, (0.0, 0.0, 1.0)):
        lines.append(_line("thrust_direction", first.direction_B))
    if first.tilt is not None:
        limits = (("min", first.tilt.low), ("max", first.tilt.high))
        lines.append(f"tilt_axis = {_value(first.tilt.axis_B)}")
        lines += [f"tilt_{end}_deg = {_value(np.degrees(angle))}" for end, angle in limits if np.isfinite(angle)]
    else:
        lines += ["tilts = false"] if any(r.tilt for r in rotors) else []
        lines += ["tilt_axis = [1.0, 0.0, 0.0]"] if np.hypot(*middle[:2]) <= 1e-9 else []
    own = [key for key in _said(rotors) if not _alike(rotors, key)]
    rows = []
    for r, hub in zip(group, hubs, strict=True):
        rotor, offset = rotors[r], float((hub - middle) @ along)
        row = [f"name = {_text(rotor.name)}"] if rotor.name else []
        row += [f"spin = {int(rotor.spin.value)}", *([f"offset = {_value(offset)}"] if abs(offset) > 1e-6 else [])]
        rows.append(", ".join([*row, *(f"{key} = {_value(getattr(rotor, key).value)}" for key in own)]))
    words = "; ".join([f"spin: {_words(first.spin)}", *(f"{key}: {_words(getattr(first, key))}" for key in own)])
    if len(rows) == 1:
        return [*lines, _commented(f"rotors = [{{ {rows[0]} }}]", words)]
    return [*lines, f"rotors = [  # {words}", *(f"  {{ {row} }}," for row in rows), "]"]
