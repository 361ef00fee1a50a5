"""Allocation: what rotors make of what is asked of them by the model as it stands, and the corrected allocation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from wrenchgap.flight.errors import UsageError
from wrenchgap.replay.session.panels import html
from wrenchgap.replay.session.worker import worker_result
from wrenchgap.replay.session.working_model import WorkingModel
from wrenchgap.viewer.host import Host, download
from wrenchgap.viewer.panel import JobControls, Panel
from wrenchgap.viewer.session import Report, Scene

if TYPE_CHECKING:
    from wrenchgap.plant.effectiveness import Effectiveness
    from wrenchgap.replay.export.allocation import AllocationExport


class AllocationPanel(Panel):
    """What `wrenchgap effectiveness` says of the model, and the files of its corrected allocation."""

    def __init__(self, host: Host, working: WorkingModel) -> None:
        super().__init__(host)
        self.working = working
        self.made: AllocationExport | None = None
        gui = host.gui
        with host.tab("Allocation"):
            hint = "Force and torque per newton asked of each rotor, as flown and nominal, by the model as it stands."
            self.work = JobControls(host, "What do the rotors make?", self._ask, hint)
            self.answer = gui.add_html("")
            self.file = gui.add_dropdown("file", ("-",), visible=False, hint="See docs/effectiveness.md.")
            self.get = host.connect(gui.add_button("Download", visible=False, color="gray"), self._downloaded)
        host.command("Ask what the rotors make as flown", self._ask)

    def opened(self, scene: Scene) -> None:
        """Another flight, or another model: what was said is not said of it."""
        self.answer.content = ""
        self._offer(None)

    def _offer(self, made: AllocationExport | None) -> None:
        self.made = made
        self.file.visible = self.get.visible = made is not None
        if made is not None:
            self.file.options = tuple(made.files)

    def _ask(self) -> None:
        with self.working.lock:
            model = self.working.model
        if not model.vehicle.has_rotors:
            raise UsageError("the model has no rotors: nothing can be said of what they make")

        def found(report: Report) -> Any:
            from wrenchgap.replay.export.allocation import effectiveness_and_allocation  # here: the page stands before

            return worker_result(lambda tell: effectiveness_and_allocation(model), report)

        def done(result: tuple[Effectiveness, AllocationExport | str]) -> None:
            from wrenchgap.replay.present import allocation, effectiveness  # here: the page stands before it is there

            matrix, made = result
            said = [*effectiveness.sentences(matrix)]
            said += [made] if isinstance(made, str) else allocation.sentences(made)
            rows = effectiveness.by_rotor(matrix)
            self.answer.content = html.render("allocation", sentences=said, heads=rows[0], rows=rows[1])
            self._offer(None if isinstance(made, str) else made)

        self.work.start(found, done)

    def _downloaded(self, event: Any) -> None:
        if self.made is not None:
            download(event.client, self.file.value, self.made.files[self.file.value].encode())
