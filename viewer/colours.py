"""The colours of the page: one meaning, one colour, in the scene, in the plots and in the legend."""

from dataclasses import dataclass

Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Palette:
    """Colours of the scene and of the cursors; `spin` of rotors that turn counter-clockwise, clockwise about thrust."""

    body: Colour = (34, 150, 60)
    reference: Colour = (208, 40, 40)
    hull: Colour = (58, 62, 70)
    ghost: Colour = (120, 90, 200)
    spin: tuple[Colour, Colour] = ((70, 120, 200), (190, 130, 70))
    thrust: Colour = (120, 130, 145)
    path: Colour = (150, 155, 165)
    cursor: Colour = (208, 40, 40)
    marks: tuple[Colour, Colour] = ((0, 120, 140), (150, 60, 170))
    tick: Colour = (60, 66, 74)


PALETTE = Palette()
GAP = "rgb(233,236,239)"
"""Opaque: charts draw a straight line across what the log does not cover."""

WRENCHES: dict[str, Colour] = {
    "commanded": (240, 140, 20),
    "measured": (30, 32, 36),
    "predicted": (25, 105, 220),
    "desired": (20, 160, 150),
    "residual": (205, 30, 110),
}
OTHERS: tuple[Colour, ...] = ((150, 60, 170), (120, 140, 20), (20, 150, 190))
AXES: tuple[Colour, ...] = ((214, 60, 50), (40, 150, 70), (50, 100, 220))
"""x, y and z of what is neither commanded nor measured nor predicted."""
CYCLE: tuple[Colour, ...] = (
    *((31, 119, 180), (255, 127, 14), (44, 160, 44), (214, 39, 40), (148, 103, 189), (140, 86, 75)),
    *((227, 119, 194), (90, 90, 90), (170, 170, 30), (23, 190, 207), (60, 60, 160), (200, 100, 60)),
)


def colour_of(wrench: str) -> Colour:
    """Colour of a wrench, the same in arrows, plots and legend."""
    if wrench in WRENCHES:
        return WRENCHES[wrench]
    return OTHERS[sum(wrench.encode()) % len(OTHERS)]


def line_colours(names: tuple[str, ...]) -> tuple[Colour, ...]:
    """Colours of some lines in one plot."""
    if set(names) <= {"x", "y", "z"}:
        return tuple(AXES["xyz".index(name)] for name in names)
    return tuple(CYCLE[i % len(CYCLE)] for i in range(len(names)))


def css(colour: Colour, opacity: float = 1.0) -> str:
    """The colour as CSS text."""
    red, green, blue = colour
    return f"rgb({red},{green},{blue})" if opacity >= 1.0 else f"rgba({red},{green},{blue},{opacity:g})"
