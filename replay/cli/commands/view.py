"""`wrenchgap view`: flights in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli.options import (
    Between,
    Logs,
    ModelOption,
    OwnEffects,
    Quiet,
    Shift,
    Topics,
    complete_models,
    many,
    parse_between,
    parse_shifts,
    parse_topics,
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("view", cls=many("--against"))(view)


def view(
    logs: Logs,
    model: ModelOption,
    gp: Annotated[Path | None, typer.Option("--gp", metavar="GP", help="A GP of `wrenchgap learn`, on MODEL.")] = None,
    against: Annotated[
        list[str] | None,
        typer.Option(
            "--against",
            metavar="MODEL2...",
            help="Other models, to show what they predict.",
            autocompletion=complete_models,
        ),
    ] = None,
    saved: Annotated[
        Path | None,
        typer.Option("--view", metavar="FILE", help="Open a view that was saved on the page; of another log as well."),
    ] = None,
    host: Annotated[str, typer.Option(help="Address to listen on; the default is this machine only.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on; the next free one if taken.")] = 8080,
    browser: Annotated[bool, typer.Option("--browser", help="Open the page in the default browser.")] = False,
    topic: Topics = None,
    shift: Shift = None,
    between: Between = None,
    own: OwnEffects = None,
    quiet: Quiet = False,
) -> None:
    """Show flights on a page: the vehicle in 3D, plots over one time, where the model fails and which effects it lacks.

    The first log is shown first; the others are one choice away, and are flights to test on. Everybody who opens the
    page sees the same, from where they like.

    Example: `wrenchgap view train.mcap test.mcap -m tilt_hexarotor --gp torque.gp`
    """
    import threading
    import webbrowser

    from wrenchgap.flight import cache
    from wrenchgap.learn.process import store
    from wrenchgap.plant import model_file
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.session.log_session import LogSession
    from wrenchgap.viewer.page import Page, exposed
    from wrenchgap.viewer.view_state import read

    printer = Printer(quiet)
    opening = read(saved) if saved is not None else None
    base = model_file.load(model)
    others = [model_file.load(other) for other in against or ()]
    process = store.load(gp) if gp is not None else None
    with progress("opening", quiet) as report:
        report(0.0, "reading logs")
        session = LogSession(
            logs,
            base,
            process,
            topics=parse_topics(topic),
            between=parse_between(between),
            shifts=parse_shifts(shift),
            load=cache.load,
            against=others,
            gp_name="GP" if gp is None else gp.name,
        )
        report(0.8, "starting the page")
        page = Page(session, host, port)
    if opening is not None:
        page.restore(opening)
    if exposed(host):
        printer.notes([f"the page listens on {host}: everybody who reaches this machine can use it."], "warning")
    printer.line(f"{', '.join(session.flights)}: {page.url}   (Ctrl-C to stop)")
    if browser:
        webbrowser.open(page.url)
    try:
        threading.Event().wait()
    finally:
        page.stop()
