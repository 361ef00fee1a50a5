"""A corrected allocation: what it allows for, and the margin of the weakest rotor that its choice keeps."""

from typing import Any

import numpy as np

from wrenchgap.compensate.allocator import SETTINGS
from wrenchgap.replay.export.allocation import AllocationExport
from wrenchgap.replay.present.numbers import entries, number, share
from wrenchgap.replay.present.tables import Line, Part

CHECK = (
    "Not beside a compensation of the same effects, which would correct them twice; hover low and short with it first."
)


def parts(made: AllocationExport) -> list[Part]:
    """What is left of demands, the margins, and what to see to."""
    *said, check = sentences(made)
    return [*map(Line, said), Line(check, "dim")]


def sentences(made: AllocationExport) -> list[str]:
    """The same in sentences."""
    return [*([left(made)] if made.effects else []), summary(made), CHECK]


def left(made: AllocationExport) -> str:
    """What the model leaves of demands, in one sentence."""
    nominal, corrected = (
        " and ".join(f"{number(v, 2) if v > SETTINGS.rounding else 0} {u}" for v, u in zip(x, ("N", "Nm"), strict=True))
        for x in (made.left.nominal, made.left.corrected)
    )
    return f"By the model, the nominal allocation is off by {nominal} rms, the corrected one by {corrected}."


def summary(made: AllocationExport) -> str:
    """The gain of the null space in one sentence."""
    found = made.margins
    if found.spare == 0:
        return "No null space: one set of thrusts makes a wrench, so the corrected allocation has no margin to choose."
    beyond = float(np.mean(found.plain < 0.0))
    cannot = f", which cannot make {share(beyond)} of them" if beyond else ""
    return (
        f"Null space of {found.spare}, used for margin: over {len(found.best)} demands that the vehicle can make, the "
        f"weakest rotor keeps {share(float(found.best.mean()))} of its range free on average, with the pseudo-inverse "
        f"{share(float(found.plain.mean()))}{cannot}."
    )


def to_json(made: AllocationExport) -> dict[str, Any]:
    """See docs/json.md."""
    found = made.margins
    return {
        **entries(made, "vehicle=model.vehicle.name", "effects", "precision"),
        "files": sorted(made.files),
        "left": entries(made.left, "nominal", "corrected"),
        "margins": {
            "demands": len(found.best),
            "null_space": found.spare,
            "largest_margin": float(found.best.mean()),
            "pseudo_inverse": float(found.plain.mean()),
            "pseudo_inverse_beyond": float(np.mean(found.plain < 0.0)),
        },
    }


def frame(made: AllocationExport) -> dict[str, Any]:
    """One row for each demand."""
    return {"largest_margin": made.margins.best, "pseudo_inverse": made.margins.plain}
