"""Logs: drop them, read what `check` says of them, and make the model that all other tabs need."""

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import wrenchgap as wg
from wrenchgap.flight.errors import UsageError, WrenchgapError
from wrenchgap.plant.drafts.ardupilot import FRAMES
from wrenchgap.plant.drafts.draft import Sheet
from wrenchgap.plant.drafts.sources import Given
from wrenchgap.plant.model_file import load, shipped_models
from wrenchgap.replay.session.intake import LEAST_CUTOFF, Intake
from wrenchgap.replay.session.panels import html
from wrenchgap.viewer import markup
from wrenchgap.viewer.file_drop import FileDrop, discard
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.panel import JobControls, Panel
from wrenchgap.viewer.session import Report, Session

DROP = (
    "Drop a flight log here: .ulg (PX4), .bin (ArduPilot), .mcap, .bag, .csv, .parquet (Crazyflie, Betaflight, your "
    "own). It stays on this machine."
)
MORE = "Drop another log of the same vehicle, to compare it with, or a model file (.toml)."
SLOW = "the IMU or the commands come too slowly for more."
WHY = (
    "What is missing, how it changed, what to fly next: all need a model. A Crazyflie's can be chosen; for other "
    "vehicles the mass is required; the other fields may stay as they are where the log knows the rest."
)
NEXT = "Next: the tab Effects searches for what the model lacks; Changed compares, once there are two logs."
OF_LOG = "made from the log"
AS_LOGGED = "as in the log"
FIELDS = {
    "mass": "mass",
    "frame": "frame",
    "arm": "arm",
    "rotor-radius": "rotor radius",
    "thrust-max": "full thrust of a rotor",
    "cutoff": "low-pass",
    "accept": "accept checks",
}
"""Fields of the form, by the options of the command line that say the same."""
HERE = {
    "Give its model with -m": "Give its model below",
    "`wrenchgap inspect --details` says why": "the tab Notes says why",
    "see `wrenchgap inspect`": "see the tab Notes",
    " (`wrenchgap changed`)": ", dropped here too,",
    "`wrenchgap view` shows": "the plots show",
}
"""What else the page has in place of words of the command line."""


class LogsPanel(Panel):
    """Dropped logs are checked at once; the model comes from the log and this form, or is a shipped one."""

    def __init__(self, host: Host, intake: Intake) -> None:
        super().__init__(host)
        self.intake = intake
        gui, there, made = host.gui, bool(intake.logs), intake.model is not None
        with host.tab("Logs"):
            self.drop = FileDrop(host, MORE if there else DROP, intake.dropped, self._received)
            self.work = JobControls(host, "Check again", lambda: self._run(self.work, _again))
            self.work.button.visible = there
            if there and made:
                gui.add_html(markup.sentences(NEXT))
            self.answer = gui.add_html(self._answer("lines"))
            with gui.add_folder("Another model" if made else "Model", visible=there, expand_by_default=not made):
                self._form()
            if intake.model is not None and intake.cutoff_hz < intake.options.low_pass_hz(intake.model):
                gui.add_html(markup.sentences(f"Wrenches pass a low-pass of {intake.cutoff_hz:g} Hz: {SLOW}"))
            self.sheet = gui.add_html(self._sheet())
            gui.add_html(self._answer("rows"))
            self._leave_out(there)

    def _leave_out(self, there: bool) -> None:
        """For a log that was dropped by mistake."""
        self.names = [f"{k}: {path.name}" for k, path in enumerate(self.intake.logs, 1)]
        self.which = self.host.gui.add_dropdown("leave out", tuple(self.names) or ("",), visible=there)
        self.leave = JobControls(self.host, "Leave it out", lambda: self._run(self.leave, self._without))
        self.leave.button.visible = there

    def _without(self, now: Intake, report: Report) -> Intake:
        left_out = self.names.index(self.which.value)
        return now.with_logs([path for k, path in enumerate(now.logs) if k != left_out], report)

    def _form(self) -> None:
        """Which model, with what was said of it before; sizes only where it is made here."""
        from wrenchgap.replay.present.health import shipped_for  # here: the page stands before it is there

        host, intake, gui, given = self.host, self.intake, self.host.gui, self.intake.given
        gui.add_html(markup.sentences(WHY))
        known = shipped_for(intake.health.logs) if intake.health is not None and intake.model is None else ""
        self.source = gui.add_dropdown("model", (OF_LOG, *shipped_models()), initial_value=known or OF_LOG)
        host.connect(self.source, lambda _: self._ask_sizes())
        self.mass = _number(gui, "mass [kg]", given.mass, "with battery, as it flew")
        self.frame = gui.add_dropdown("frame", (AS_LOGGED, *FRAMES), initial_value=given.frame or AS_LOGGED)
        self.arm = _number(gui, "arm [m]", given.arm, "from the middle to a motor; 0: as in the log")
        hint = "0: estimated from the distance between rotors"
        self.radius = _number(gui, "rotor radius [m]", given.radius, hint)
        hint = "0: from hover, as the log shows it"
        self.thrust = _number(gui, "full thrust of a rotor [N]", given.thrust_max, hint)
        hint = "of wrenches; as the slowest of IMU and commands allows, 8 at most"
        self.cutoff = gui.add_number(
            "low-pass [Hz]", intake.cutoff_hz, min=LEAST_CUTOFF, max=100.0, step=0.1, hint=hint
        )
        hint = "checks of the logs that may be bad, with commas between"
        self.accept = gui.add_text("accept checks", ", ".join(intake.options.accept), hint=hint)
        self.preview = gui.add_html("")
        for field in (self.frame, self.arm, self.radius):
            host.connect(field, lambda _: self._draw())
        label = "Make the model, open the flights"
        self.make = JobControls(host, label, lambda: self._run(self.make, self._modelled))
        self._ask_sizes()

    def _ask_sizes(self) -> None:
        for field in (self.mass, self.frame, self.arm, self.radius, self.thrust):
            field.visible = self.source.value == OF_LOG
        self._draw()

    def _given(self) -> Given:
        """What the form says of the vehicle."""
        frame = None if self.frame.value == AS_LOGGED else self.frame.value
        lengths = (self.arm.value or None, self.radius.value or None, self.thrust.value or None)
        return Given(None, self.mass.value or None, None, frame, *lengths)

    def _draw(self) -> None:
        """The vehicle from above, where frame and arm of the form say where its rotors are; the mass is not drawn."""
        given = self._given()
        self.preview.content = ""
        if self.source.value == OF_LOG and given.frame and given.arm:
            with suppress(WrenchgapError):  # what makes the model says what is wrong
                sheet = wg.draft_model(None, given=replace(given, mass=given.mass or 1.0))
                self.preview.content = html.render("sheet", lines=(), assumed=(), drawn=_from_above(sheet))

    def _received(self, path: Path) -> None:
        self._run(self.work, lambda now, report: now.with_file(path, report), path)

    def _modelled(self, now: Intake, report: Report) -> Intake:
        report(0.0, "making the model")
        accepted = tuple(name.strip() for name in self.accept.value.split(",") if name.strip())
        now = replace(now, options=now.options.changed(cutoff_hz=self.cutoff.value, accept=accepted))
        if self.source.value != OF_LOG:
            return now.with_model(load(self.source.value), report)
        if not self.mass.value:
            raise UsageError("mass: weigh the vehicle with its battery and say how many kilograms it has")
        return now.drafted(self._given(), report)

    def _run(self, controls: JobControls, change: Callable[[Intake, Report], Intake], came: Path | None = None) -> None:
        """Change logs or model beside the page, which then shows what there is; where that fails nothing changes.

        What `came` and is no log of it in the end, is removed. One thing at a time: another one would be lost.
        """
        if self.work.running or self.make.running or self.leave.running:
            again = "click again" if came is None else f"drop {came.name} again"
            raise UsageError(f"the page is at work; {again} when that has ended")

        def work(report: Report) -> Session:
            kept: tuple[Path, ...] = ()
            working, now = getattr(self.host.session, "working", None), self.intake
            if working is not None:  # with effects that were added meanwhile
                now = replace(now, model=working.model, saved=working.saved)
            try:
                made = change(now, report)
                session = session_of(made, report)
                if working is not None and (new := getattr(session, "working", None)) is not None:
                    new.keep_found(working)
                kept = made.logs
            except WrenchgapError as error:
                raise type(error)(of_page(str(error))) from None
            finally:
                if came is not None and came not in kept:
                    discard(came)
            return session

        def late(_: Session) -> None:
            if came is not None:
                discard(came)

        controls.start(work, self.host.replace, late, then_gone=True)

    def _answer(self, part: Literal["lines", "rows"]) -> str:
        """What `check` says of all logs: its sentences, or its table."""
        from wrenchgap.replay.present import health  # here: the page stands before it is there

        found = self.intake.health
        if found is None:
            return ""
        if part == "lines":
            return html.render("answer", lines=[(of_page(text), look) for text, look in health.answer(found)[:-1]])
        return html.render("check", head=[log.name for log in found.logs], rows=health.overview(found).cells)

    def _sheet(self) -> str:
        """What was understood of the vehicle, drawn, and what was assumed."""
        from wrenchgap.replay.present import model as words

        if (sheet := self.intake.sheet) is None:
            return ""
        assumed = [*sheet.assumed, *sheet.notes]
        return html.render("sheet", lines=words.overview(sheet.model), assumed=assumed, drawn=_from_above(sheet))


def _from_above(sheet: Sheet) -> str:
    """A picture of the vehicle, as an address that fetches nothing."""
    from wrenchgap.replay.present import model as words
    from wrenchgap.replay.present.report.sections import Image

    return Image.of(words.picture(sheet), "the vehicle from above", "", form="svg").src


def _again(now: Intake, report: Report) -> Intake:
    return now.with_logs(now.logs, report)


def session_of(intake: Intake, report: Report) -> Session:
    """What the page shows of these logs now, with the tab that takes more of them."""
    return intake.session(report, partial(LogsPanel, intake=intake))


def of_page(text: str) -> str:
    """Words of the command line as those of this page: its fields for options, its tabs for commands."""
    for said, here in HERE.items():
        text = text.replace(said, here)
    named = r"--([a-z-]+)(?: [A-Z]+\b)?"  # with what stands for a value in a usage
    return re.sub(named, lambda m: f'"{FIELDS[m[1]]}"' if m[1] in FIELDS else m[0], text)


def _number(gui: Any, label: str, value: float | None, hint: str) -> Any:
    """A field for a size; 0 says nothing."""
    return gui.add_number(label, value or 0.0, min=0.0, max=1000.0, step=0.001, hint=hint)
