"""Effectiveness of rotors as flown: what is asked for and what comes, by axis and by rotor."""

from typing import Any

import numpy as np

from wrenchgap.flight.flight import AXES
from wrenchgap.plant.effectiveness import ROUNDING, Effectiveness
from wrenchgap.plant.targets.quantities import Quantity
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.numbers import entries, number
from wrenchgap.replay.present.tables import Line, Part, note_lines, table

SURE = 3.0
"""Standard deviations from which a difference is told."""
LEAST_ARM = 1e-4
"""[m]: shorter arms of a force are told in the table alone."""
LEGEND = "asked of each rotor: one newton of its nominal thrust, about hover; torques about the centre of mass"


def parts(found: Effectiveness) -> list[Part]:
    """The answer, each rotor's part, the corrected allocation."""
    return [*brief(found), _by_rotor(found), Line(LEGEND, "dim"), Line(), _allocation(found)]


def brief(found: Effectiveness) -> list[Part]:
    """What of the asked wrench comes, in words and as a table."""
    left = [f"{name} is left out: at a limit of what is plausible, so its law is wrong" for name in found.left_out]
    lines = [Line(sentence, "bold") for sentence in sentences(found)]
    return [*lines, *note_lines(left, "warning"), Line(), _achieved(found)]


def sentences(found: Effectiveness) -> list[str]:
    """The answer: shares of what is asked, the largest cross-coupling, rotors that differ."""
    axes = controllable_axes(found)
    told = ", ".join(f"{AXES[k]} {_share(found.achieved, k, k)}" for k in axes)
    angles = np.degrees(found.tilt[found.vehicle.geometry()[0].tilts])
    at = f" at {', '.join(f'{a:.0f}' for a in np.unique(angles))} deg" if angles.size and angles.any() else ""
    out = [f"{found.vehicle.name}{at}: allocated nominally, this much of what is asked for comes: {told}."]
    crossed = [(i, k) for group in (axes[axes < 3], axes[axes > 2]) for i in group for k in group if i != k]
    if crossed:
        i, k = max(crossed, key=lambda pair: abs(float(found.achieved.value[pair])))
        value, std = float(found.achieved.value[i, k]), float(found.achieved.std[i, k])
        if abs(value) > max(SURE * std, 0.005):
            out.append(f"{AXES[k]} makes {_per_cent(abs(value), std)} of itself as {AXES[i]}, most of all pairs.")
    arms = [(i, k) for i in axes[axes > 2] for k in axes[axes < 3]]
    if arms:
        i, k = max(arms, key=lambda pair: abs(float(found.achieved.value[pair])))
        value, std = float(found.achieved.value[i, k]), float(found.achieved.std[i, k])
        if abs(value) > max(SURE * std, LEAST_ARM):
            arm = f"{number(1e3 * value)} +-{number(1e3 * std, 2)} mm"
            out.append(f"Force makes torque: one newton of {AXES[k]} makes {AXES[i]} by an arm of {arm}.")
    weak = []
    for r, name in enumerate(rotor_names(found)):
        part, std = _of_rotor(found, r)
        if abs(part - 1.0) > max(SURE * std, 0.005):
            weak.append(f"{name} {_per_cent(part, std)}")
    if weak:
        out.append(f"Thrust over what is asked of it: {', '.join(weak)}.")
    if not found.matrix.by:
        why = "no effect of the model changes what rotors make"
        if found.left_out:
            names = ", ".join(found.left_out)
            why = f"{names} is left out, at a limit of what is plausible: what rotors make is not known"
        out = [f"{found.vehicle.name}: {why}; this is the nominal matrix."]
    return out


def controllable_axes(found: Effectiveness) -> Any:
    """Axes that the vehicle can make."""
    return np.flatnonzero(np.diag(found.achieved.nominal) > 0.5)


def allocation_rows(found: Effectiveness) -> list[str]:
    """What the rows of the allocation ask for: thrusts of rotors, of those that tilt along and across them at rest."""
    names = rotor_names(found)
    if len(names) == len(found.allocation.value):
        return names
    arms, rotors = found.vehicle.geometry()
    across = [f"{name} across" for name, arm in zip(names, rotors.arm, strict=True) if arms.tilts[arm]]
    return [*(f"{name} along" for name in names), *across]


def _share(achieved: Quantity, i: int, k: int) -> str:
    return _per_cent(float(achieved.value[i, k]), float(achieved.std[i, k]))


def _per_cent(value: float, std: float) -> str:
    return f"{100.0 * value:.0f} %" if std < ROUNDING else f"{100.0 * value:.0f} +-{number(100.0 * std, 2)} %"


def _of_rotor(found: Effectiveness, r: int) -> tuple[float, float]:
    """The force of a rotor along its nominal force, over that, and its standard deviation."""
    nominal = found.matrix.nominal[:3, r]
    size = float(nominal @ nominal)
    along = nominal * found.matrix.value[:3, r]
    return float(along.sum() / size), float(np.linalg.norm(nominal * found.matrix.std[:3, r]) / size)


def _cell(value: float, std: float) -> str:
    return number(value) if std <= ROUNDING * abs(value) else f"{number(value)} +-{number(std, 1)}"


def _achieved(found: Effectiveness) -> Any:
    axes = controllable_axes(found)
    rows = [
        (
            f"one of {AXES[k]}",
            *(_cell(float(found.achieved.value[i, k]), float(found.achieved.std[i, k])) for i in axes),
        )
        for k in axes
    ]
    return table("what comes when the nominal allocation is asked for", ("", *(AXES[i] for i in axes)), rows)


def rotor_names(found: Effectiveness) -> list[str]:
    """Names of the rotors that the model file has."""
    return [found.vehicle.rotor_name(r) for r in range(found.matrix.value.shape[1])]


def acted_axes(found: Effectiveness) -> Any:
    """Axes on which a rotor acts, nominally or as flown."""
    return np.flatnonzero(np.abs(found.matrix.nominal).max(axis=1) + np.abs(found.matrix.value).max(axis=1) > 1e-9)


def by_rotor(found: Effectiveness) -> tuple[list[str], list[tuple[str, list[list[float]]]]]:
    """Axes on which a rotor acts, and of each rotor its name and, by axis, value, standard deviation, nominal value."""
    axes = acted_axes(found)
    parts = np.stack([found.matrix.value, found.matrix.std, found.matrix.nominal])[:, axes].T
    return [AXES[k] for k in axes], list(zip(rotor_names(found), parts.tolist(), strict=True))


def _by_rotor(found: Effectiveness) -> Any:
    axes, rotors = by_rotor(found)
    rows = []
    for name, cells in rotors:
        rows.append((name, "as flown", *(_cell(value, std) for value, std, _ in cells)))
        rows.append(("", "nominal", *(_cell(nominal, 0.0) for *_, nominal in cells)))
    return table("effectiveness of each rotor [1, m]", ("", "", *axes), rows, left=2)


def _allocation(found: Effectiveness) -> Any:
    axes = controllable_axes(found)
    rows = [
        (name, *(number(float(values[k])) for k in axes))
        for name, values in zip(allocation_rows(found), found.allocation.value, strict=True)
    ]
    heads = ("", *(f"{AXES[k]} [{'1' if k < 3 else '1/m'}]" for k in axes))
    return table("corrected allocation: nominal thrust [N] to ask of each rotor", heads, rows)


def to_json(found: Effectiveness) -> dict[str, Any]:
    """See docs/json.md."""
    sizes = ("matrix=matrix.value", "matrix_std=matrix.std", "nominal=matrix.nominal")
    achieved = ("achieved=achieved.value", "achieved_std=achieved.std")
    return {
        **entries(found, "vehicle=vehicle.name", "tilt"),
        "axes": list(AXES),
        "rotors": rotor_names(found),
        **entries(found, "effects=matrix.by", "left_out", *sizes, *achieved),
        "asked": allocation_rows(found),
        **entries(found, "allocation=allocation.value", "nominal_allocation=allocation.nominal"),
    }


def frame(found: Effectiveness) -> list[dict[str, Any]]:
    """One row for each rotor and axis."""
    return [
        {
            "rotor": name,
            "axis": axis,
            "flown": float(found.matrix.value[k, r]),
            "std": float(found.matrix.std[k, r]),
            "nominal": float(found.matrix.nominal[k, r]),
        }
        for r, name in enumerate(rotor_names(found))
        for k, axis in enumerate(AXES)
    ]


def picture(found: Effectiveness) -> style.Picture:
    """Axes (1, K): a panel for each axis that a rotor acts on, a pair of bars for each rotor, nominal and as flown."""
    axes = acted_axes(found)
    title = f"{found.vehicle.name}: wrench per newton asked of each rotor, about hover"
    size = (max(3.0 * len(axes), 6.0), 1.2 + 0.3 * found.matrix.value.shape[1])
    return style.Picture((1, len(axes)), size, lambda panels: _draw(found, axes, panels), title=title)


def _draw(found: Effectiveness, axes: Any, panels: Any) -> None:
    names = rotor_names(found)
    places = np.arange(len(names))
    for k, panel in zip(axes, np.ravel(panels), strict=True):
        panel.barh(places - 0.2, found.matrix.nominal[k], 0.36, color="0.7", label="nominal")
        error = found.matrix.std[k]
        panel.barh(places + 0.2, found.matrix.value[k], 0.36, xerr=error, color="C0", ecolor="black", label="as flown")
        panel.set_yticks(places, names)
        panel.invert_yaxis()
        style.labelled(panel, AXES[k], "1" if k < 3 else "m", "x")
    style.grid(panels)
    style.legend(*np.ravel(panels)[:1])
