"""Ready: whether to fly a trajectory with the model as it stands, after the flight that is shown."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import wrenchgap as wg
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.trajectory import TRAJECTORIES
from wrenchgap.replay.session.panels import html
from wrenchgap.replay.session.worker import worker_result
from wrenchgap.replay.session.working_model import WorkingModel
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.panel import JobControls, Panel
from wrenchgap.viewer.session import Report, Scene

if TYPE_CHECKING:
    from wrenchgap.replay.readiness import Readiness


class ReadyPanel(Panel):
    """Conditions of the flight to come, and what `wrenchgap ready` says of it."""

    def __init__(self, host: Host, working: WorkingModel) -> None:
        super().__init__(host)
        self.working = working
        gui = host.gui
        with host.tab("Ready"):
            self.trajectory = gui.add_dropdown("to fly", tuple(TRAJECTORIES), initial_value="hover")
            self.payload = gui.add_number("payload [kg]", 0.0, min=0.0, step=0.05, hint="at the centre of mass")
            self.wind = gui.add_number("wind [m/s]", 0.0, min=0.0, max=50.0, step=1.0, hint="steady, from any side")
            hint = "with which it will hover; 0: as in this flight"
            self.voltage = gui.add_number("battery [V]", 0.0, min=0.0, max=1000.0, step=0.1, hint=hint)
            hint = "What it takes of rotors and arms, by the model as it stands and what it leaves of this flight."
            self.work = JobControls(host, "Go or no go?", self._ask, hint)
            self.answer = gui.add_html("")
        host.command("Ask whether to fly", self._ask)

    def opened(self, scene: Scene) -> None:
        """Another flight, or another model: what was said is not said of it."""
        self.answer.content = ""

    def _ask(self) -> None:
        with self.working.lock:
            model, flight = self.working.model, self.working.flight(self.host.scene.name)
        if not model.vehicle.has_rotors:
            raise UsageError("the model has no rotors: nothing can be said of what they have to give")
        name, asked = self.trajectory.value, {"payload": self.payload.value, "wind": self.wind.value}
        if self.voltage.value > 0.0:
            asked["voltage"] = self.voltage.value

        def ready(report: Report) -> Any:

            return worker_result(lambda tell: wg.ready(flight, model, name, **asked, progress=tell), report)

        def done(found: Readiness) -> None:
            from wrenchgap.replay.present import readiness as words  # here: the page stands before it is there

            self.answer.content = html.render("ready", sentences=words.summary(found), found=found)

        self.work.start(ready, done)
