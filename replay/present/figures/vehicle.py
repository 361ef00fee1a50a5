"""Top view of a vehicle: arms, rotors with their radius, direction of turn and name, IMU, centre of mass; marked parts.

Seen from above (from +z of the body): x, forward, is up, y is to the left. Axes are those of the body, (y, x), in
metres, the former growing to the left; so what is drawn at (y, x) sits there. Rotors are where they are at zero tilt.
Parts are called as parameters call them: `rotor_2`, `arm_1`, and besides `com` and `imu`.
"""

from collections.abc import Mapping
from textwrap import fill
from typing import Any

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.replay.present.figures import style

ARM, ROTOR = "0.45", "0.85"
"""Colours of parts that are not marked."""
WIDE, HIGH = 1.9, 1.35
"""Half the width and half the height of the picture, in half the vehicle's size."""
INNER = {"com": (-1.0, 0.0), "imu": (1.0, 0.0)}
"""On which side (x, y) words on parts in the middle stand: behind and in front."""
ALIKE = 1e-6
"""Distance [m] below which two rotors are drawn as one above the other."""


def picture(
    vehicle: Vehicle, marked: Mapping[str, str] | None = None, *, moved_B: Array | None = None
) -> style.Picture:
    """The top view; `marked` are parts to highlight, with a few words on each, `moved_B` (3,) [m] as in `draw`."""
    return style.Picture((), (8.4, 6.2), lambda panel: draw(panel, vehicle, marked, moved_B=moved_B), vehicle.name)


def draw(
    panel: Any, vehicle: Vehicle, marked: Mapping[str, str] | None = None, *, moved_B: Array | None = None
) -> None:
    """The top view in a panel.

    `marked` are parts to highlight with a few words on each ("rotor_2": "thrust -8 %"). `moved_B` (3,) [m], in B, is by
    how much the centre of mass moved: an arrow shows its direction, not its size. Raises UsageError for a part that the
    vehicle does not have.
    """
    marks = dict(marked or {})
    places = parts(vehicle)
    for name in marks:
        if name not in places:
            raise UsageError(f"top view of {vehicle.name}: got the part {name!r}, expected one of {', '.join(places)}")
    half = _half(vehicle)
    _arms(panel, vehicle, marks)
    _rotors(panel, vehicle, marks)
    _body(panel, vehicle, marks, half, moved_B)
    for name, words in marks.items():
        text = f"{called(vehicle, name)}: {words}" if words else called(vehicle, name)
        _words(panel, places[name], text, half, INNER.get(name))
    panel.set_aspect("equal")
    panel.set_xlim(WIDE * half, -WIDE * half)
    panel.set_ylim(-WIDE * half, WIDE * half)  # for the same SI prefix on both
    style.labelled(panel, "body y, to the left", "m", "x")
    style.labelled(panel, "body x, forward", "m")
    panel.set_ylim(-HIGH * half, HIGH * half)
    style.grid(panel)
    panel.grid(alpha=0.12)


def called(vehicle: Vehicle, part: str) -> str:
    """A part in words, by the user's name where it has one."""
    return {"com": "centre of mass", "imu": "IMU"}.get(part) or vehicle.called(part)


def parts(vehicle: Vehicle) -> dict[str, Array]:
    """Every part that can be marked and its place (3,) [m] in B."""
    found = {"com": vehicle.body.com_B, "imu": vehicle.imu_position_B}
    if vehicle.arms is not None:
        found |= {f"arm_{i}": p for i, p in enumerate(vehicle.arms.position_B)}
        found |= {f"rotor_{r}": p for r, p in enumerate(hubs(vehicle))}
    return found


def hubs(vehicle: Vehicle) -> Array:
    """Places of the rotors (R, 3) [m] in B at zero tilt: p_arm + offset n_0 (`plant.vehicle`)."""
    arms, rotors = vehicle.geometry()
    return np.asarray(arms.position_B[rotors.arm] + rotors.offset[:, None] * arms.normal_B[rotors.arm])


def _half(vehicle: Vehicle) -> float:
    """Half the size of what is drawn [m]."""
    if vehicle.rotors is None:
        return max(2.0 * float(np.abs([vehicle.body.com_B, vehicle.imu_position_B]).max()), 0.1)
    return float(np.max(np.linalg.norm(hubs(vehicle)[:, :2], axis=1) + vehicle.rotors.radius))


def _colour(name: str, marks: Mapping[str, str], usual: str) -> str:
    return style.WARNING if name in marks else usual


def _arms(panel: Any, vehicle: Vehicle, marks: Mapping[str, str]) -> None:
    """A line from O to each hub point, with the arm's name."""
    if vehicle.arms is None:
        return
    for i, (x, y, _) in enumerate(vehicle.arms.position_B):
        name = f"arm_{i}"
        look = {"color": _colour(name, marks, ARM), "lw": 5.0 if name in marks else 3.0, "solid_capstyle": "round"}
        panel.plot([0.0, y], [0.0, x], zorder=1.5, gid=name, **look)
        if vehicle.named("arm", i) or name in marks:
            _name(panel, 0.42 * y, 0.42 * x, vehicle.arm_name(i), _colour(name, marks, "0.3"))


def _rotors(panel: Any, vehicle: Vehicle, marks: Mapping[str, str]) -> None:
    """A disc for each rotor, an arrow the way it turns, its name; of two above each other the lower one is dashed."""
    if vehicle.rotors is None or vehicle.arms is None:
        return
    from matplotlib.patches import Circle

    places, seen = hubs(vehicle), turns(vehicle)
    for r, (x, y, z) in enumerate(places):
        beside = np.flatnonzero(np.linalg.norm(places[:, :2] - (x, y), axis=1) < ALIKE)
        above = [int(k) for k in beside if places[k, 2] > z + ALIKE]
        name, radius = f"rotor_{r}", float(vehicle.rotors.radius[r])
        colour = _colour(name, marks, ROTOR)
        look = {"alpha": 0.35, "ls": "--" if above else "-", "lw": 1.2, "zorder": 2 + 0.1 * (not above)}
        panel.add_patch(
            Circle((y, x), radius, facecolor=colour, edgecolor=_colour(name, marks, "0.3"), gid=name, **look)
        )
        _turn(panel, (x, y), 0.78 * radius * 0.8 ** len(above), seen[r], _colour(name, marks, "0.3"))
        lower = len(beside) > 1 and bool(above)
        lift = (0.0 if len(beside) == 1 else -0.22 if lower else 0.22) * radius
        words = f"{vehicle.rotor_name(r)} (below)" if lower else vehicle.rotor_name(r)
        _name(panel, y, x + lift, words, _colour(name, marks, "black"))


def turns(vehicle: Vehicle) -> Array:
    """How each rotor turns as seen from above (R,): +1 counter-clockwise, -1 clockwise.

    `spin` is about the thrust, which may point down.
    """
    arms, rotors = vehicle.geometry()
    return np.asarray(rotors.spin * np.where(arms.normal_B[rotors.arm, 2] < 0.0, -1.0, 1.0))


def _turn(panel: Any, hub: tuple[float, float], radius: float, turn: float, colour: str) -> None:
    """An arc with a head, about a hub (x, y) in B; angles from x towards y, which is counter-clockwise from above."""
    angle = np.radians(-90.0 + turn * np.linspace(0.0, 250.0, 40) + (0.0 if turn > 0 else 180.0))
    x, y = hub[0] + radius * np.cos(angle), hub[1] + radius * np.sin(angle)
    panel.plot(y[:-2], x[:-2], color=colour, lw=1.0, zorder=3)
    head = {"arrowstyle": "-|>", "color": colour, "lw": 1.0, "shrinkA": 0.0, "shrinkB": 0.0}
    panel.annotate("", (y[-1], x[-1]), (y[-3], x[-3]), arrowprops=head, zorder=3)


def _body(panel: Any, vehicle: Vehicle, marks: Mapping[str, str], half: float, moved_B: Array | None) -> None:
    """Forward, the centre of mass and where it went, the IMU."""
    forward = {"arrowstyle": "-|>", "color": "black", "lw": 1.4, "mutation_scale": 14}
    panel.annotate("", (0.0, 0.42 * half), (0.0, 0.0), arrowprops=forward, zorder=4)
    _name(panel, 0.0, 0.47 * half, "forward", "black")
    (cx, cy, _), (ix, iy, _) = vehicle.body.com_B, vehicle.imu_position_B
    panel.plot([cy], [cx], "o", color=_colour("com", marks, "black"), ms=6.0, gid="com", zorder=5)
    panel.plot([iy], [ix], "s", color=_colour("imu", marks, "tab:blue"), ms=5.0, mfc="none", gid="imu", zorder=5)
    if vehicle.rotors is None:
        _name(panel, 0.0, -0.6 * half, "the model file has no arms and rotors", "0.35")
    if moved_B is None or not np.any(moved_B[:2]):
        return
    way = np.asarray(moved_B[:2]) / np.linalg.norm(moved_B[:2])
    arrow = {"arrowstyle": "-|>", "color": style.WARNING, "lw": 2.0, "mutation_scale": 16}
    end = (cy + 0.5 * half * way[1], cx + 0.5 * half * way[0])
    panel.annotate("", end, (cy, cx), arrowprops=arrow, zorder=6)


def _name(panel: Any, y: float, x: float, text: str, colour: str) -> None:
    """A name on the drawing, without markup."""
    from matplotlib.patheffects import withStroke

    look = {"ha": "center", "va": "center", "fontsize": style.SMALL, "color": colour}
    panel.text(y, x, text, zorder=7, path_effects=[withStroke(linewidth=2.5, foreground="white")], **look)


def _words(panel: Any, place: Array, text: str, half: float, side: tuple[float, float] | None) -> None:
    """Words on a marked part outside the vehicle, on the side (x, y) or where the part is, with a line to it.

    To the left and right they begin and end at the picture's edge, so that they never reach the numbers of the axes.
    """
    x, y = float(place[0]), float(place[1])
    length = float(np.hypot(x, y))
    out = np.array(side) if side is not None else np.array([x, y]) / max(length, ALIKE)
    at = 1.12 * half * out
    beside = abs(out[1]) > 0.3
    edge = float(np.sign(out[1]) * 0.97 * WIDE * half) if beside else float(at[1])
    panel.annotate(
        fill(text, 18 if beside else 28, break_long_words=False),
        (y, x),
        (edge, float(at[0])),
        arrowprops={"arrowstyle": "-", "color": style.WARNING, "lw": 0.8},
        fontsize=style.USUAL,
        color=style.WARNING,
        ha="center" if not beside else "left" if out[1] > 0.0 else "right",
        va="bottom" if out[0] >= 0 else "top",
        zorder=8,
    )
