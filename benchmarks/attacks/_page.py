"""A page of the viewer with a flight on it, a program that talks as viser's client does, a browser, a foreign page."""

from __future__ import annotations

import contextlib
import functools
import http.server
import io
import shutil
import socket
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import viser
from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

from wrenchgap import flight
from wrenchgap.learn.data.opening import open_flights
from wrenchgap.plant import model_file
from wrenchgap.plant.simulation.flight_plan import Plan, fly
from wrenchgap.replay.session.log_session import LogSession
from wrenchgap.replay.session.saving import SaveFolder
from wrenchgap.viewer.page import Page

MODEL = "tilt_hexarotor"
SECONDS = 4.0
"""Length of the flight that is shown [s]."""
GRACE = 0.7
"""How long an attacker waits for what his message does [s]."""
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [1.0, 1.0, 1.0],
    "fov": 0.75,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}
"""What viser counts as the first sign of a client."""


@functools.cache
def log() -> tuple[bytes, str]:
    """A simulated flight: the bytes of its file, and the file's name."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "private.mcap"
        flight.write(fly(Plan(model_file.load(MODEL), "multi_axis", SECONDS, 0.0, 1, None, ()), name="private"), path)
        return path.read_bytes(), path.name


@contextmanager
def shown(folder: Path, save_to: Path | None = None, *, force: bool = False) -> Iterator[Page]:
    """The page that `wrenchgap view` opens on that flight."""
    content, name = log()
    path = folder / name
    path.write_bytes(content)
    saving = None if save_to is None else SaveFolder(save_to, force=force)
    model = model_file.load(MODEL)
    page = Page(LogSession(open_flights([path], model), model, folder=saving), port=0)
    try:
        yield page
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            page.stop()


@contextmanager
def client(
    page: Page, *, token: str | None = None, host: str | None = None, origin: str | None = None
) -> Iterator[Any]:
    """A program that talks as viser's client does, with headers of its choice; the page's own token unless given."""
    token = page.gate.token if token is None else token
    where = host or f"127.0.0.1:{page.port}"
    line = socket.create_connection(("127.0.0.1", page.port))
    connection: ClientConnection = connect(
        f"ws://{where}/{token}",
        sock=line,
        open_timeout=5.0,
        origin=origin,  # type: ignore[arg-type]
        subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
        max_size=None,
    )
    with connection:
        yield connection


def refused(page: Page, **how: Any) -> bool:
    """Whether a client with these headers is kept out."""
    try:
        with client(page, **how) as connection:
            connection.recv(timeout=GRACE)
    except (WebSocketException, OSError):
        return True
    return False


def send(connection: ClientConnection, **message: Any) -> None:
    """A message as viser's client packs it."""
    connection.send(msgspec.msgpack.encode(message))


def update(connection: ClientConnection, control: Any, value: Any, name: str = "value") -> None:
    """What a client sends when a control is used."""
    send(connection, type="GuiUpdateMessage", uuid=control._impl.uuid, updates={name: value})


def asked(page: Page, path: str, **headers: str) -> tuple[int, str, Any]:
    """Status, text and headers of an answer by HTTP."""
    request = urllib.request.Request(f"http://127.0.0.1:{page.port}{path}", headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=5.0) as answer:
            return answer.status, answer.read().decode(), answer.headers
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode(), error.headers


def eventually(condition: Callable[[], bool], seconds: float = 10.0) -> bool:
    """Whether it becomes true in time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def alive(page: Page) -> bool:
    """Whether a newcomer can still drive the page."""
    before = page.cursor.time
    with client(page) as connection:
        send(connection, **CAMERA)
        target = float(page.cursor.stop if before < 1.0 else 0.0)
        eventually(lambda: bool(page.server.get_clients()))
        update(connection, page.transport.slider, page.transport.slider.max if target else page.transport.slider.min)
        return eventually(lambda: page.cursor.time != before)


@contextmanager
def chromium() -> Iterator[Any]:
    """A headless browser without a GPU."""
    from playwright.sync_api import sync_playwright

    path = next(found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name)))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def web_page(text: str) -> Iterator[str]:
    """A page of somebody else on this machine, by its address."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(text.encode())

        def log_message(self, *_: Any) -> None:
            """Says nothing."""

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()


def drained(connection: ClientConnection) -> Iterator[bytes]:
    """What has come so far."""
    with contextlib.suppress(TimeoutError):
        while True:
            got = connection.recv(timeout=0.1)
            yield got if isinstance(got, bytes) else got.encode()
