"""viser behind the gate: what is served is guarded, and a viser that is built otherwise is not served at all."""

import logging
import re
import socket
import urllib.error
import urllib.request
import warnings

import pytest
import viser
from websockets.asyncio import server as websockets

from wrenchgap.flight.errors import UsageError
from wrenchgap.viewer import serving
from wrenchgap.viewer.inbox import LIMITS
from wrenchgap.viewer.serving import own_scripts, serve


@pytest.fixture(autouse=True)
def websockets_serve():
    """Is what it was when a server has started, or could not."""
    before = websockets.serve
    yield
    assert websockets.serve is before


def test_the_link_opens_the_page_and_nothing_else_does():
    server, gate, _ = serve("127.0.0.1", 0)
    try:
        with urllib.request.urlopen(gate.url(server.get_port()), timeout=10) as answer:
            assert b"<html" in answer.read(2000)
            assert answer.headers["Referrer-Policy"] == "no-referrer"
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(f"http://127.0.0.1:{server.get_port()}/", timeout=10)
        for name in ("gone", 7000 * "a"):
            with pytest.raises(urllib.error.HTTPError, match="404") as refused:
                urllib.request.urlopen(gate.url(server.get_port()) + name, timeout=10)
            assert refused.value.headers["X-Frame-Options"] == "DENY"
    finally:
        server.stop()


def test_what_is_said_to_a_client_that_has_left_is_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        server, _, _ = serve("127.0.0.1", 0)
        server.stop()
        server.gui.add_html("")


def test_a_viser_that_serves_in_another_way_is_refused(monkeypatch):
    """As a release does that imports `serve` by its name."""
    monkeypatch.setattr(viser.infra.WebsockServer, "start", lambda self: setattr(self, "_stop_event", None))
    monkeypatch.setattr(viser.ViserServer, "__init__", lambda self, **options: setattr(self, "gui", None))
    monkeypatch.setattr(viser.ViserServer, "stop", lambda self: None)
    with pytest.raises(UsageError, match=r"viser .*cannot be guarded.*viser>=1\.1"):
        serve("127.0.0.1", 0)


def test_a_page_of_viser_that_is_not_one_script_is_refused(monkeypatch, tmp_path):
    page = tmp_path / "client" / "build" / "index.html"
    page.parent.mkdir(parents=True)
    page.write_text("<html><script src='other.js'></script></html>")
    monkeypatch.setattr(viser, "__file__", str(tmp_path / "__init__.py"))
    own_scripts.cache_clear()
    with pytest.raises(UsageError, match="one script"):
        own_scripts()
    own_scripts.cache_clear()


def test_viser_has_what_is_taken_from_its_private_parts():
    """Fails when a release of viser moves it: read `viewer/serving.py` again before the range of versions grows."""
    server, _, _ = serve("127.0.0.1", 0)
    try:
        button = server.gui.add_button("x")
        assert server.gui._gui_input_handle_from_uuid[button._impl.uuid] is button
    finally:
        server.stop()
    assert re.match(r"1\.1\.", viser.__version__), serving.SUPPORTED
    assert len(own_scripts()) == 2


def test_who_idles_without_the_link_takes_no_descriptors_and_keeps_nobody_out(caplog):
    """1,100 idle connections used up the file descriptors: accept stopped, with tracebacks on the terminal."""
    server, gate, _ = serve("127.0.0.1", 0)
    idle = []
    try:
        for _ in range(3 * LIMITS.handshakes):
            idle.append(socket.create_connection(("127.0.0.1", server.get_port()), timeout=5))
        with urllib.request.urlopen(gate.url(server.get_port()), timeout=5) as answer:
            assert b"<html" in answer.read(2000)
        left = 0
        for one in idle:
            one.settimeout(0.01)
            try:
                one.recv(1)
            except TimeoutError:
                left += 1
            except OSError:
                pass
        assert left <= LIMITS.handshakes
        assert not caplog.records
    finally:
        for one in idle:
            one.close()
        server.stop()


def test_a_descriptor_that_cannot_be_had_is_no_traceback(caplog):
    server, _, _ = serve("127.0.0.1", 0)
    server.stop()
    logging.getLogger("asyncio").error("socket.accept() out of system resource\nsocket: x")
    logging.getLogger("asyncio").error("another")
    assert [record.message for record in caplog.records] == ["another"]
