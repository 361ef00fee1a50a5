"""viser's server behind the gate of the page; all uses of private parts of viser are here.

viser 1.1 has no hook for who may connect or what a client may send. It serves through `websockets`, which has both:
`process_request` and `create_connection`. So while viser's server starts, its call of `serve` gets them from here. A
viser that starts otherwise, or keeps its controls elsewhere, is not served at all
(docs/decisions/0033-who-drives-the-page.md).
"""

import asyncio
import base64
import hashlib
import io
import logging
import re
import socket
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from functools import cache
from http import HTTPStatus
from pathlib import Path
from typing import Any

import numpy as np
import viser
import zstandard
from viser._messages import FileTransferPartAck
from websockets.asyncio import server as websockets
from websockets.http11 import Request, Response
from websockets.protocol import State

from wrenchgap.flight.errors import UsageError
from wrenchgap.viewer.gate import Gate, Refusal
from wrenchgap.viewer.inbox import LIMITS, Inbox

SUPPORTED = "viser>=1.1,<1.2"
DIGITS = "".join(chr(c) for c in range(0x21, 0x7F) if chr(c) not in "\"&<>'`")
"""In which viser's page packs its own script."""

_starting = threading.Lock()


def serve(host: str, port: int) -> tuple[Any, Gate, dict[str, Any]]:
    """A viser server on this host and port, or the next free one, the gate that it is behind, and its file drops.

    The last are those `viewer.file_drop.FileDrop` that take the uploads of a button, by the id of that; at first none.

    Raises UsageError where it cannot listen, and for a viser that cannot be guarded.
    """
    port = free_port(host, port)
    for name in ("websockets.server", "asyncio"):
        logging.getLogger(name).addFilter(_has_page)
    warnings.filterwarnings("ignore", "Queued a ", UserWarning)  # for a client that has left meanwhile
    gate, found = Gate(host, own_scripts()), _Controls()
    with _starting, _guarded(gate, found) as guarded, redirect_stdout(io.StringIO()):  # viser announces itself
        server = viser.ViserServer(host=host, port=port, label="wrenchgap", verbose=False)
    controls = getattr(server.gui, "_gui_input_handle_from_uuid", None)
    if not guarded or not isinstance(controls, dict):
        server.stop()
        raise UsageError(f"viser {viser.__version__}: its page cannot be guarded; install {SUPPORTED!r}")
    found.by_id = controls
    return server, gate, found.drops


def acknowledge(server: Any, button: str, transfer: str, done: int, size: int) -> None:
    """Tell the clients that so many bytes of an upload to a button arrived; viser would keep what all are told."""
    message = FileTransferPartAck(
        source_component_uuid=button, transfer_uuid=transfer, transferred_bytes=done, total_bytes=size
    )
    for client in server.get_clients().values():
        client.gui._websock_interface.queue_message(message)


def free_port(host: str, port: int, tries: int = 20) -> int:
    """`port`, or the next of `tries` ports that is free; any free one for 0. Raises UsageError without one.

    Asked beforehand, because viser waits for ever on an address that cannot be had.
    """
    reason = ""
    for candidate in [port] if port == 0 else range(port, min(port + tries, 65536)):
        try:
            family, *_, address = socket.getaddrinfo(host, candidate, type=socket.SOCK_STREAM)[0]
            with socket.socket(family, socket.SOCK_STREAM) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind(address)
                return int(probe.getsockname()[1])
        except OSError as error:
            reason = error.strerror or str(error)
    raise UsageError(f"--host {host} --port {port}: cannot listen there: {reason}; choose others")


@cache
def own_scripts() -> tuple[str, ...]:
    """The two scripts of viser's page as CSP sources: the loader that is seen, and the client that it unpacks.

    No other script runs on the page then, whatever a name in a log holds. Raises UsageError for another kind of page.
    """
    page = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text(encoding="utf-8")
    found = re.search(r'<script data-p="([^"]+)" data-ss="(\d+)" data-cs="(\d+)">(.*?)</script>', page, re.DOTALL)
    if found is None or page.count("<script") != 1:
        raise UsageError(f"viser {viser.__version__}: its page is not one script; install {SUPPORTED!r}")
    packed, styles, loader = found[1], int(found[2]), found[4]
    whole = zstandard.ZstdDecompressor().decompress(_unpacked(packed), max_output_size=styles + int(found[3]))
    return tuple(
        f"'sha256-{base64.b64encode(hashlib.sha256(code).digest()).decode()}'"
        for code in (loader.encode(), whole[styles:])
    )


def _unpacked(text: str) -> bytes:
    """Five digits to the base 88 are four bytes; of fewer digits at the end, one less."""
    digits = np.zeros(128, dtype=np.int64)
    digits[[ord(c) for c in DIGITS]] = np.arange(len(DIGITS))
    rest = len(text) % 5
    values = digits[np.frombuffer(text.encode("ascii"), dtype=np.uint8)]
    whole = values[: len(values) - rest].reshape(-1, 5) @ (88 ** np.arange(4, -1, -1))
    last = int(values[len(values) - rest :] @ (88 ** np.arange(rest - 1, -1, -1))) if rest else 0
    return whole.astype(">u4").tobytes() + (last.to_bytes(rest - 1, "big") if rest else b"")


class _Controls:
    """The controls of a page by id, once there is one, and those that are drops for files."""

    by_id: dict[str, Any] | None = None

    def __init__(self) -> None:
        self.drops: dict[str, Any] = {}

    def __call__(self, uuid: str) -> Any:
        return None if self.by_id is None else self.by_id.get(uuid)


class _Connection(websockets.ServerConnection):
    """Connection of one client; viser gets the messages that its inbox admits."""

    def __init__(self, *given: Any, inbox: Inbox, **options: Any) -> None:
        super().__init__(*given, **options)
        self._inbox = inbox

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        strangers = [one for one in self.server.handlers if one.state is not State.OPEN]
        for oldest in strangers[: -LIMITS.handshakes]:  # not the newest: who idles keeps nobody out
            oldest.transport.abort()

    async def recv(self, decode: bool | None = None) -> Any:
        while True:
            raw = await super().recv(decode)
            await asyncio.sleep(self._inbox.wait())
            if self._inbox.admits(raw):
                return raw


@contextmanager
def _guarded(gate: Gate, controls: _Controls) -> Iterator[list[bool]]:
    """While this lasts, a server that viser starts is behind the gate; the list gets an entry when one was."""
    original, guarded = websockets.serve, []

    def serving(handler: Any, *where: Any, process_request: Any, **options: Any) -> Any:
        if not handler.__module__.startswith("viser."):
            return original(handler, *where, process_request=process_request, **options)
        guarded.append(True)
        options |= {
            "process_request": _checked(gate, process_request),
            "create_connection": lambda *given, **more: _Connection(
                *given, inbox=Inbox(controls, controls.drops), **more
            ),
            "compression": None,  # bytes that were sent are those that arrive
            "max_size": LIMITS.message,
            "max_queue": LIMITS.queued,
            "server_header": None,
        }
        return original(handler, *where, **options)

    websockets.serve = serving  # type: ignore[assignment, misc]
    try:
        yield guarded
    finally:
        websockets.serve = original  # type: ignore[misc]


def _checked(gate: Gate, answer: Callable[..., Response | None]) -> Callable[..., Response | None]:
    """Viser's answer to a request, if that passes the gate; None lets a websocket open."""

    def process(connection: websockets.ServerConnection, request: Request) -> Response | None:
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        passed = gate.passes(request.path, hosts, origins, connection.local_address[1])
        if not isinstance(passed, Refusal) and len(connection.server.connections) >= LIMITS.pages:
            passed = Refusal(HTTPStatus.SERVICE_UNAVAILABLE, f"{LIMITS.pages} pages are open; close one first.")
        if isinstance(passed, Refusal):
            response: Response | None = connection.respond(passed.status, f"{passed.words}\n")
            headers = gate.headers("")
        else:
            try:
                response = answer(connection, replace(request, path=passed))
            except OSError:  # a name that no file can have
                response = connection.respond(HTTPStatus.NOT_FOUND, "There is no such file.\n")
            headers = gate.headers(hosts[0])
        if response is not None:
            for name, value in headers.items():
                response.headers[name] = value
        return response

    return process


def _has_page(record: logging.LogRecord) -> bool:
    """Whether a log record is not about a connection without a page: anybody who reaches the port causes such records.

    What is no GET, e.g. `curl -I` or a port scan, is refused; without a free file descriptor, accept waits a second.
    """
    return not record.getMessage().startswith(("opening handshake failed", "socket.accept() out of system resource"))
