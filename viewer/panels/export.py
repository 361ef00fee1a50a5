"""The tab of exports: picture, table, report, and the view, which can be opened again elsewhere."""

import csv
import io
from collections.abc import Callable, Sequence
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap._escaping import csv_cell
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.viewer import markup
from wrenchgap.viewer.colours import PALETTE, Colour
from wrenchgap.viewer.host import Host, download
from wrenchgap.viewer.inbox import LIMITS
from wrenchgap.viewer.panel import JobControls, Panel
from wrenchgap.viewer.plot_board import Board
from wrenchgap.viewer.plots import Plot
from wrenchgap.viewer.view_state import parse

SAVED = "Flight, time, marks, switches, plots and camera: save them, open them elsewhere."
Caption = tuple[Sequence[tuple[str, Colour]], Sequence[str]]
"""Rows of the legend, and sentences below it."""


class ExportPanel(Panel):
    """Export controls. A download goes only to the client that requested it."""

    def __init__(self, host: Host, board: Board, caption: Callable[[], Caption]) -> None:
        super().__init__(host)
        self._board, self._caption = board, caption
        gui, connect = host.gui, host.connect
        self._rendering = Lock()
        with host.tab("Export"):
            with gui.add_folder("download"):
                self.png = gui.add_button("PNG of the view")
                self.png.on_click(self._picture)
                self.csv = connect(gui.add_button("CSV of what is plotted", hint="in the range shown"), self._table)
                if host.session.capabilities.report is not None:
                    self.report = JobControls(host, "HTML report", self._report)
            with gui.add_folder("view"):
                gui.add_html(markup.sentences(SAVED))
                self.save = connect(gui.add_button("Save view"), self._save)
                self.open = gui.add_upload_button("Open view", mime_type="application/json")
                self.open.on_upload(host.guarded(self._uploaded))
                self.text = gui.add_text("as text", "", hint="copy it from here; paste another and press enter")
                connect(self.text, self._pasted)

    def _picture(self, event: Any) -> None:
        """Not under the page's lock: the client that renders may need the page meanwhile. One at a time."""
        if not self._rendering.acquire(blocking=False):
            return
        client = event.client

        def send(_: Any) -> None:
            scene, time = self.host.scene, self.host.cursor.time
            rows, words = self._caption()
            image = png(render, rows, [f"{scene.name}, {time:.2f} s", *words])
            download(client, f"{scene.name}_{time:.2f}s.png", image)

        try:
            height, width = client.camera.image_height, client.camera.image_width
            render = client.get_render(height, width, transport_format="png", timeout=30.0)
            self.host.guarded(send)(event)
        except (RuntimeError, TimeoutError) as error:
            self.host.notify(f"The browser gave no picture: {error}", "error", client=client)
        finally:
            self._rendering.release()

    def _table(self, event: Any) -> None:
        plots = [chart.plot for chart in self._board.charts.values()]
        view = self._board.view
        name = f"{self.host.scene.name}_{view.start:.2f}-{view.stop:.2f}s.csv"
        download(event.client, name, table(plots, view.start, view.stop).encode())

    def _report(self) -> None:
        flight, client, write = self.host.scene.name, self.report.client, self.host.session.capabilities.report
        assert write is not None
        self.report.start(
            lambda report: write(flight, report),
            lambda text: download(client, f"{flight}_report.html", text.encode()),
        )

    def _save(self, event: Any) -> None:
        view = self.host.view_of(event.client)
        self.text.value = view.to_text()
        download(event.client, f"{view.flight}_{view.time:.2f}s.view.json", view.to_text().encode())

    def _uploaded(self, event: Any) -> None:
        content = self.open.value.content
        if len(content) > LIMITS.upload:
            raise UsageError(f"{self.open.value.name}: {len(content)} bytes; a saved view has a few hundred")
        self.host.restore(parse(content.decode(errors="replace"), self.open.value.name), event.client)

    def _pasted(self, event: Any) -> None:
        if event.client_id is not None and self.text.value.strip().endswith("}"):
            self.host.restore(parse(self.text.value, "view as text"), event.client)


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
        draw.text((x + 1.3 * size, y), name, fill=PALETTE.tick, font=font)
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
