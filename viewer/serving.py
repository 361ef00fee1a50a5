"""Where the page listens: one server on one address, this machine's own unless told otherwise. It serves no files."""

from __future__ import annotations

import io
import socket
from contextlib import redirect_stdout
from typing import Any

import viser

from wrenchgap.flight.errors import UsageError

LOOPBACK = ("127.0.0.1", "localhost", "::1")
PORTS = 20
"""Ports that are tried, one after the other."""


def exposed(host: str) -> bool:
    """Whether other machines could reach a page that is bound to this address."""
    return host not in LOOPBACK


def free_port(host: str, port: int) -> int:
    """`port`, or the next one of a few that nobody listens on; any free one for 0. Raises UsageError without one.

    Asked beforehand, because viser waits for ever on an address that cannot be had.
    """
    reason = ""
    for candidate in [port] if port == 0 else range(port, min(port + PORTS, 65536)):
        try:
            family, *_, address = socket.getaddrinfo(host, candidate, type=socket.SOCK_STREAM)[0]
            with socket.socket(family, socket.SOCK_STREAM) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind(address)
                return int(probe.getsockname()[1])
        except OSError as error:
            reason = error.strerror or str(error)
    raise UsageError(f"--host {host} --port {port}: cannot listen there: {reason}; choose others")


def serve(host: str, port: int) -> Any:
    """A viser server on this host and port, or the next free one."""
    port = free_port(host, port)
    with redirect_stdout(io.StringIO()):  # viser announces itself
        return viser.ViserServer(host=host, port=port, label="wrenchgap", verbose=False)
