"""What an explanation leaves, in words: at which frequencies, what swings, from which rotor, on what it depends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.diagnose.residual_patterns import OneRotor, Oscillation
from wrenchgap.learn.posterior.explain import Explanation
from wrenchgap.learn.posterior.open_bands import OpenBand
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.replay.present import where

CONCENTRATED = 0.7
"""Share of the residual in the worst tenth of the time that is worth saying."""


def clue(found: Explanation) -> str:
    """Sentences on what nothing explains."""
    clues = [f"{bands_in_words(found.bands)}."] if found.bands else []
    if found.oscillation is not None:
        words = oscillation_in_words(found.oscillation)
        clues.append(f"{words[:1].upper()}{words[1:]}.")
    if found.one_rotor is not None:
        words = one_rotor_in_words(found.one_rotor, found.model.vehicle)
        clues.append(f"{words[:1].upper()}{words[1:]}.")
    if found.depends is not None and found.depends.chosen:
        inputs = " and ".join(g.label for g in found.depends.chosen[:3])
        clues.append(
            f"The residual depends on {inputs} ({100 * found.depends.explained:.0f} % of it can be predicted from them "
            "on held-out time)."
        )
    if found.concentrated > CONCENTRATED:
        clues.append(
            f"{100 * found.concentrated:.0f} % of the residual sits in a tenth of the time: see `wrenchgap where`."
        )
    return " ".join(clues)


def bands_in_words(bands: Sequence[OpenBand]) -> str:
    """One clause: on each axis the frequencies at which more than the noise is left, the loudest axis first."""
    said = []
    for axis in dict.fromkeys(b.axis for b in bands):
        own = [b for b in bands if b.axis == axis]
        low, high = min(b.low_hz for b in own), max(b.high_hz for b in own)
        times = max(b.over_noise for b in own)
        said.append(f"{AXES[axis]} at {low:.2g} to {high:.2g} Hz ({times:.2g} times the noise)")
    return f"What is named leaves more than noise in {', '.join(said)}"


def oscillation_in_words(found: Oscillation) -> str:
    """One clause."""
    where = {
        "E": "fixed in the inertial frame, as a load on a rope is",
        "B": "body-fixed",
        None: "whether it is fixed in the inertial frame, like a load on a rope, or body-fixed is not clear",
    }[found.frame]
    return (
        f"a lightly damped mode at {found.frequency_hz:.2g} Hz (damping {found.damping:.2g}, {100 * found.share:.0f} % "
        f"of the residual): {where}"
    )


def one_rotor_in_words(found: OneRotor, vehicle: Vehicle) -> str:
    """One clause."""
    rotors = " or ".join(vehicle.rotor_name(k) for k in found.rotors)
    return (
        f"{100 * found.share:.0f} % of the residual pushes where rotor {rotors} pushes, at moments that nothing logged "
        "tells: a propeller or hub that slips, a motor or its controller that stutters"
    )


def to_json(found: Explanation) -> dict[str, Any]:
    """The same for machines."""
    mode, depends, rotor = found.oscillation, found.depends, found.one_rotor
    name = found.model.vehicle.rotor_name
    return {
        "over_noise": found.left,
        "in_worst_tenth": found.concentrated,
        "bands": [{**b.__dict__, "axis": AXES[b.axis]} for b in found.bands],
        "swing": None if mode is None else {**mode.__dict__, "words": oscillation_in_words(mode)},
        "one_rotor": None if rotor is None else {"rotors": [name(k) for k in rotor.rotors], "share": rotor.share},
        "depends_on": None if depends is None else where.relevance_json(depends),
    }
