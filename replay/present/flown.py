"""A flight of an exported compensation beside what its C makes of the same states and inputs."""

from typing import Any

import numpy as np

from wrenchgap.replay.export.flown import FlownExport, in_short
from wrenchgap.replay.present.numbers import entries
from wrenchgap.replay.present.tables import Line, Part, note_lines, table


def summary(found: FlownExport) -> str:
    """The answer in one sentence."""
    count, wrong, cut = len(found), int(np.sum(~found.agrees)), int(np.sum(~found.continues & found.ordered))
    if found.proved:
        return (
            f"Proved: every one of {count:,} recorded periods is what the export {found.export} makes of its state and "
            f"input, {int(np.sum(found.identical)):,} of them to the last bit."
        )
    parts = [f"{wrong:,} of {count:,} recorded periods are not what the export {found.export} makes"] if wrong else []
    parts += [f"the state was changed from outside before {cut:,} of {count:,} periods"] if cut else []
    if back := int(np.sum(~found.ordered)):
        parts.append(
            f"{back:,} of {count:,} records repeat a number or go back without wg_reset, so that nothing tells which "
            "period was before (count `number` up by one in each period)"
        )
    return f"Not proved: {' and '.join(parts)}."


def parts(found: FlownExport, most: int = 10) -> list[Part]:
    """The answer, how far apart, and the first `most` periods that do not agree."""
    out: list[Part] = [Line(summary(found), "bold" if found.proved else "bold red")]
    out.append(
        Line(
            f"largest difference {found.apart.max():.3g} N or Nm, tolerance {found.tolerance:.3g} ({found.precision} "
            f"precision); of the state {found.state_apart:.3g} beyond that; starts after wg_reset: "
            f"{int(np.sum(found.begins))}"
        )
    )
    rows = [
        (str(d.number), f"{d.time:.3f}", d.quantity, f"{d.flown:.9g}", f"{d.made:.9g}", d.status_flown, d.status_made)
        for d in found.deviations(most)
    ]
    if rows:
        heads = ("period", "time [s]", "quantity", "flown", "the export makes", "status flown", "status made")
        out.append(table("the first periods that do not agree", heads, rows))
    out.append(table("status", ("", "periods"), [(name, str(n)) for name, n in found.statuses.items()]))
    return [*out, *note_lines(warnings(found), "warning")]


def warnings(found: FlownExport) -> list[str]:
    """What the records do not cover."""
    said = []
    if found.lost:
        said.append(
            f"{found.lost} periods between the first and the last record are not recorded: nothing is said of them"
        )
    if found.repeated:
        said.append(f"{found.repeated} records that repeat others byte for byte were left out")
    if not found.begins[0]:
        said.append(
            f"the log begins with period {found.flown['number'][0]}, not with the state of wg_reset: nothing is said "
            "of what was before"
        )
    if found.damaged:
        said.append(f"damaged or cut records: {found.damaged}")
    if found.others:
        said.append(f"{sum(found.others.values())} records of other exports were left out: {in_short(found.others)}")
    return said


def to_json(found: FlownExport) -> dict[str, Any]:
    """See docs/json.md."""
    return {
        **entries(found, "proved", "export", "precision", "tolerance", "lost", "damaged", "repeated", "statuses"),
        "summary": summary(found),
        "records": len(found),
        "identical": int(np.sum(found.identical)),
        "agree": int(np.sum(found.agrees)),
        "state_changed": int(np.sum(~found.continues & found.ordered)),
        "out_of_order": int(np.sum(~found.ordered)),
        "largest_difference": float(found.apart.max()),
        "largest_difference_of_state": found.state_apart,
        "starts": int(np.sum(found.begins)),
        "other_exports": dict(found.others),
        "deviations": [d._asdict() for d in found.deviations(10)],
        "warnings": warnings(found),
    }


def frame(found: FlownExport) -> dict[str, Any]:
    """One row a record."""
    record = {name: found.flown[name] for name in ("number", "time", "status")}
    return {**record, **entries(found, "identical", "agrees", "continues", "difference=apart")}
