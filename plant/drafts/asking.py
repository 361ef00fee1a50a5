"""What a person is asked of a vehicle: only what nothing else said."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from wrenchgap.plant.drafts.draft import Draft, Said
from wrenchgap.plant.drafts.frames import FRAMES

Ask = Callable[[str, type, str | None, Sequence[str]], str]
"""Asks a question: words, kind (float or str), default (None: an answer is needed, "": it may stay open), choices."""
WAYS = {"ccw": 1, "cw": -1}


def asked(given: dict[str, float | str | None], draft: Draft, ask: Ask) -> dict[str, float | str | None]:
    """What the user said, with answers to what neither that nor the draft has."""
    out = dict(given)
    if draft.mass is None and out["mass"] is None:
        out["mass"] = float(ask("What does it weigh, with its battery [kg]?", float, None, ()))
        tolerance = ask("How well is that known [kg]? Leave empty if not.", float, "", ())
        out["mass_tolerance"] = float(tolerance) if tolerance else None
    if not draft.rotors and out["frame"] is None:
        out["frame"] = ask("Which frame, in your autopilot's order of motors?", str, "quad_x", tuple(FRAMES))
        out["arm"] = float(ask("How far is it from the middle to a motor [m]?", float, None, ()))
    if out["radius"] is None and (not draft.rotors or any(r.radius is None for r in draft.rotors)):
        radius = ask("Radius of the rotors [m]? Leave empty for an estimate.", float, "", ())
        out["radius"] = float(radius) if radius else None
    if out["thrust_max"] is None and (draft.command is None or draft.command.thrust_max is None):
        most = ask("Thrust of one rotor at full throttle [N]? Leave empty for an estimate.", float, "", ())
        out["thrust_max"] = float(most) if most else None
    return out


def with_spins(draft: Draft, ask: Ask) -> Draft:
    """The draft with the turning of every rotor of which it was assumed, as answered: seen from above."""
    rotors = []
    for rotor in draft.rotors:
        if rotor.spin.assumed:
            usual = "ccw" if rotor.spin.value > 0 else "cw"
            x, y = rotor.position_B.value[:2]
            words = f"How does {rotor.name or 'the rotor'} at x {x:.3f} m, y {y:.3f} m turn, seen from above?"
            rotor = replace(rotor, spin=Said(WAYS[ask(words, str, usual, tuple(WAYS))], "your answer"))
        rotors.append(rotor)
    return replace(draft, rotors=tuple(rotors))
