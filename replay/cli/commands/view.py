"""`wrenchgap view`: flights in the browser."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from socket import gethostname
from typing import Annotated, Any

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Omit, Run
from wrenchgap.replay.cli.values import usage_error


def view(
    reading: o.Reading,
    run: Annotated[Run, Omit("json", "force")],
    logs: o.SomeLogs = None,
    model: o.OptionalModel = None,
    gp: o.GpOption = None,
    against: o.Against = None,
    saved: Annotated[
        Path | None, o.option("FILE", "Open a view that was saved on the page; of another log as well.", "--view")
    ] = None,
    host: Annotated[str, typer.Option(help="Address to listen on; the default is this machine only.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on; the next free one if taken.")] = 8080,
    save_to: Annotated[
        Path | None,
        o.option(
            "FOLDER",
            "Folder into which the page may write models and trajectories; without it the browser downloads them.",
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="With --save-to: the page may replace files that it did not write.")
    ] = False,
    browser: Annotated[bool, typer.Option("--browser", help="Open the page in the default browser.")] = False,
) -> None:
    """Show flights on a page: the vehicle in 3D, plots over one time, where the model fails and which effects it lacks.

    The first log is shown first; the others are one choice away, and are flights to test on. Everybody who opens the
    page sees the same state, with a camera of their own. Without a model, or without logs, the page begins with what
    `wrenchgap check` says: logs are dropped there, and a form makes the model.

    Example: `wrenchgap view train.mcap test.mcap -m tilt_hexarotor --gp torque.gp`
    """
    # Long because typer reads the options from the signature, one a line.
    import threading

    from wrenchgap._lazy import uncollected
    from wrenchgap.flight.extras import needed_for

    with uncollected(), needed_for("pages in the browser"):
        from wrenchgap.flight import cache
        from wrenchgap.learn.process.predictors import cutoff_of
        from wrenchgap.replay.session.intake import Intake
        from wrenchgap.replay.session.log_session import LogSession
        from wrenchgap.replay.session.panels.logs import session_of
        from wrenchgap.replay.session.saving import SaveFolder
        from wrenchgap.viewer.gate import ANYWHERE, exposed
        from wrenchgap.viewer.page import Page
        from wrenchgap.viewer.session import Session
        from wrenchgap.viewer.view_state import read

    if force and save_to is None:
        raise usage_error("--force: the page writes no files; name a folder for them, --save-to FOLDER")
    folder = None if save_to is None else SaveFolder(save_to, force=force)
    opening = None if saved is None else read(saved)
    base, others, process = None if model is None else run.model(model), list(map(run.model, against or ())), run.gp(gp)
    options = reading.options.changed(cutoff_hz=reading.options.cutoff_hz or cutoff_of(process))
    session: Session
    with run.progress("opening") as report:
        if logs and base is not None:
            flights = run.open(options, logs, base, load=cache.load)[0]
            name = "GP" if gp is None else gp.name
            more: dict[str, Any] = {"gp_name": name, "against": others, "folder": folder, "budget": options.budget}
            session = LogSession(flights, base, process, **more)
        elif given := [f"--{k}" for k, v in {"gp": gp, "against": against, "view": saved}.items() if v]:
            raise usage_error(f"{', '.join(given)}: needs logs and a model; give them with LOG... and -m MODEL")
        else:
            intake = Intake(model=base, options=options, save_to=folder)
            session = session_of(intake.with_logs(logs or (), report), report)
        report(0.8, "starting the page")
        page = Page(session, host, port)
    if opening is not None:
        page.restore(opening)
    if exposed(host):
        words = (
            f"the page listens on {host}: whoever has its link and reaches this machine can drive it, and nothing on "
        )
        run.notes(
            [f"{words}the way is encrypted; `ssh -L {page.port}:localhost:{page.port}` needs no --host."], "warning"
        )
    what = ", ".join(session.flights) if logs else "drop a log"
    run.line(f"{what}: {page.url}   (Ctrl-C to stop)")
    if host in ANYWHERE:
        run.line(f"from other machines: {page.gate.url(page.port, gethostname())}")
    with opened(page.url) if browser else nullcontext():
        try:
            threading.Event().wait()
        finally:
            page.stop()


@contextmanager
def opened(url: str) -> Iterator[None]:
    """The default browser at `url`, by way of a file that only this user reads, as Jupyter does it.

    What a browser is started with, every user of the machine sees in the list of processes.
    """
    import html
    import tempfile
    import webbrowser

    with tempfile.NamedTemporaryFile("w", prefix="wrenchgap-", suffix=".html", encoding="utf-8") as redirect:
        redirect.write(f'<!doctype html><meta http-equiv="refresh" content="0;url={html.escape(url)}">')
        redirect.flush()
        webbrowser.open(Path(redirect.name).as_uri())
        yield
