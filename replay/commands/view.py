"""`wrenchgap view`: flights in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from replay.options import Logs, ModelOption, OwnEffects, Quiet, Topics, parse_topics


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("view")(view)


def view(
    logs: Logs,
    model: ModelOption,
    gp: Annotated[Path | None, typer.Option("--gp", metavar="GP", help="A GP of `wrenchgap learn`.")] = None,
    host: Annotated[str, typer.Option(help="Address to listen on; the default is this machine only.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on; the next free one if taken.")] = 8080,
    topic: Topics = None,
    own: OwnEffects = None,
    quiet: Quiet = False,
) -> None:
    """Show flights on a page: the vehicle as it flew, wrenches as arrows and plots, a slider for time.

    Example: `wrenchgap view test.mcap -m tilt_hexarotor --gp torque.gp`
    """
    import threading

    from learn import store
    from plant import model_file
    from replay.console import Printer, progress
    from replay.session import LogSession
    from viewer.page import Page, exposed

    printer = Printer(quiet)
    base = model_file.load(model)
    process = store.load(gp) if gp is not None else None
    with progress("opening", quiet) as report:
        report(0.0, "reading logs")
        session = LogSession(logs, base, process, topics=parse_topics(topic))
        report(0.8, "starting the page")
        page = Page(session, host, port)
    if exposed(host):
        printer.notes([f"the page listens on {host}: everybody who reaches this machine can see it."], "warning")
    printer.line(f"{', '.join(session.flights)}: {page.url}   (Ctrl-C to stop)")
    try:
        threading.Event().wait()
    finally:
        page.stop()
