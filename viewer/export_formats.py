"""What leaves the page: a picture of the scene with its legend, and the plotted lines as a table."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap._escaping import csv_cell
from wrenchgap.flight.flight import Array
from wrenchgap.viewer.colours import Colour
from wrenchgap.viewer.plots import Plot

TEXT: Colour = (60, 66, 74)


def png(render: NDArray[Any], rows: Sequence[tuple[str, Colour]], words: Sequence[str]) -> bytes:
    """A rendered scene (H, W, 3 or 4) as PNG on white, with a legend in its upper left corner and `words` below it."""
    from PIL import Image, ImageDraw, ImageFont  # here: the page need not wait for it

    scene = Image.fromarray(np.asarray(render, dtype=np.uint8)).convert("RGBA")
    picture = Image.new("RGBA", scene.size, (255, 255, 255, 255))
    picture.alpha_composite(scene)
    draw = ImageDraw.Draw(picture)
    size = max(12, round(scene.height / 48))
    font = ImageFont.load_default(size)
    x, y, line = round(0.9 * size), round(0.8 * size), round(1.45 * size)
    for name, colour in rows:
        draw.rounded_rectangle((x, y + 0.2 * size, x + 0.85 * size, y + 1.05 * size), radius=0.2 * size, fill=colour)
        draw.text((x + 1.3 * size, y), name, fill=TEXT, font=font)
        y += line
    small = ImageFont.load_default(max(11, round(0.8 * size)))
    for text in words:
        draw.text((x, y + 0.2 * size), text, fill=(130, 138, 148), font=small)
        y += round(1.15 * size)
    out = io.BytesIO()
    picture.convert("RGB").save(out, "PNG", optimize=True)
    return out.getvalue()


def table(plots: Sequence[Plot], start: float, stop: float) -> str:
    """The lines of some plots between two times as CSV, at the times at which they are known.

    One row per time of any line; a cell is empty where its line has no sample then. Headers are title, line, unit.
    """
    columns: list[tuple[str, Array, Array]] = []
    for plot in plots:
        rows = (plot.time >= start) & (plot.time <= stop)
        for line in plot.lines:
            name = plot.title if line.name == plot.title else f"{plot.title} {line.name}"
            unit = f" [{plot.unit}]" if plot.unit else ""
            columns.append((f"{name}{unit}", plot.time[rows], line.values[rows]))
            if line.sigma is not None:
                columns.append((f"{name} sigma{unit}", plot.time[rows], line.sigma[rows]))
    times = np.unique(np.concatenate([np.zeros(0), *(time for _, time, _ in columns)]))
    cells = np.full((len(times), len(columns)), np.nan)
    for i, (_, time, values) in enumerate(columns):
        cells[np.searchsorted(times, time), i] = values
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["time [s]", *(csv_cell(name) for name, _, _ in columns)])
    for moment, row in zip(times, cells, strict=True):
        writer.writerow([f"{moment:.6f}", *("" if not np.isfinite(v) else f"{v:.9g}" for v in row)])
    return out.getvalue()
