"""Access to the page: checked for every request and every websocket handshake, before viser sees it.

Three locks, each enough against most of what tries (docs/decisions/0033-who-drives-the-page.md):

Host        names this page, so that a web page whose name was made to point here (DNS rebinding) gets nothing
Origin      is absent (no browser) or this page's own, so that no other web page connects
token       256 random bits, the first part of the path: other users of the machine, or of the network, do not know it
"""

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass, field
from http import HTTPStatus

LOOPBACK = ("127.0.0.1", "localhost", "::1")
ANYWHERE = {"": "127.0.0.1", "0": "127.0.0.1", "0.0.0.0": "127.0.0.1", "::": "::1"}
"""Addresses that stand for all of a machine's, and that of this machine by which each is reached."""
HEADERS = {
    "X-Frame-Options": "DENY",  # no other page shows this one in a frame, for clicks to be stolen
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the token is in the address
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Of every answer."""


@dataclass(frozen=True)
class Refusal:
    """The refusal of a request: an HTTP status and one line."""

    status: HTTPStatus
    words: str


@dataclass(frozen=True)
class Gate:
    """Whether a request may pass, for a page that listens on `host`; `scripts` are its own, as sources of a CSP."""

    host: str
    scripts: tuple[str, ...] = ()
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)

    def url(self, port: int, name: str | None = None) -> str:
        """The link to the page, for a browser on this machine; under another name where one is given."""
        return f"http://{_address(name or self.name, port)}/{self.token}/"

    @property
    def name(self) -> str:
        """By which this machine reaches the page."""
        return ANYWHERE.get(self.host, self.host)

    def passes(self, path: str, hosts: Sequence[str], origins: Sequence[str], port: int) -> str | Refusal:
        """The path behind the token, or the refusal. `hosts` and `origins` are all values of these headers."""
        if len(hosts) != 1 or not self._is_mine(hosts[0].lower(), port):
            where = f"{_address(self.name, port)} or {_address('localhost', port)}"
            return Refusal(HTTPStatus.FORBIDDEN, f"Host is not this page; open it as {where}, in a tunnel too.")
        if len(origins) > 1 or any(origin.lower() != f"http://{hosts[0].lower()}" for origin in origins):
            return Refusal(HTTPStatus.FORBIDDEN, "Origin is another page; only this page may connect to itself.")
        _, _, behind = path.partition("?")[0].partition("/")
        token, _, wanted = behind.partition("/")
        if not hmac.compare_digest(token.encode("utf-8", "replace"), self.token.encode()):
            return Refusal(HTTPStatus.FORBIDDEN, "Open this page through the link that `wrenchgap view` printed.")
        return f"/{wanted}"

    def headers(self, host: str) -> dict[str, str]:
        """Of every answer to a request for `host`, which has passed: the page loads nothing from elsewhere."""
        policy = {
            "default-src": "'none'",
            "script-src": " ".join((*self.scripts, "'unsafe-eval'")),  # viser's sorter of splats is compiled so
            "worker-src": "blob: data:",
            "style-src": "'unsafe-inline'",
            "img-src": "blob: data:",
            "font-src": "data:",
            "connect-src": f"'self' ws://{host} blob: data:",
            "base-uri": "'none'",
            "form-action": "'none'",
            "frame-ancestors": "'none'",
        }
        return {**HEADERS, "Content-Security-Policy": "; ".join(" ".join(item) for item in policy.items())}

    def _is_mine(self, host: str, port: int) -> bool:
        names = {*LOOPBACK, self.host.lower()}
        if self.host in ANYWHERE:
            names.add(socket.gethostname().lower())
            names.add(_literal(host, port))  # an address cannot be rebound, only a name
        return host in {_address(name, port) for name in names if name}


def exposed(host: str) -> bool:
    """Whether other machines could reach a page that is bound to this address."""
    return host not in LOOPBACK


def _address(name: str, port: int) -> str:
    """The address as a browser writes it in the Host header."""
    name = f"[{name}]" if ":" in name else name
    return name if port == 80 else f"{name}:{port}"


def _literal(host: str, port: int) -> str:
    """The IP address in a Host header, empty where it has a name."""
    bare = host.removesuffix(f":{port}").removeprefix("[").removesuffix("]")
    try:
        return str(ipaddress.ip_address(bare))
    except ValueError:
        return ""
