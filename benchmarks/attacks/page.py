"""Attacks on whoever looks at flights with `wrenchgap view`: who drives the page, what it writes and swallows."""

# Long because every attack on the page is here.

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import viser
from websockets.exceptions import WebSocketException

from benchmarks.attacks import Attack, Outcome
from benchmarks.attacks._page import (
    CAMERA,
    GRACE,
    alive,
    asked,
    chromium,
    client,
    drained,
    eventually,
    log,
    refused,
    send,
    shown,
    update,
    web_page,
)
from wrenchgap.replay.session.intake import Intake
from wrenchgap.replay.session.panels.effects import EffectsPanel
from wrenchgap.replay.session.panels.logs import LogsPanel, session_of
from wrenchgap.viewer.host import error_text
from wrenchgap.viewer.page import Page

AREA = "The viewer's page"

EVIL = "http://evil.example"


def foreign_origin(folder: Path) -> Outcome:
    """A browser adds Origin to every websocket; even one that has learnt the token gets nothing."""
    with shown(folder) as page:
        origins = (EVIL, "null", f"http://127.0.0.1:{page.port + 1}", f"https://127.0.0.1:{page.port}", f"{page.url}x")
        kept_out = [refused(page, origin=origin) for origin in origins]
        own = refused(page, origin=f"http://127.0.0.1:{page.port}")
        return Outcome(
            all(kept_out) and not own,
            f"{sum(kept_out)} of {len(origins)} refused; the page's own: {'refused' if own else 'connects'}",
        )


def rebound_name(folder: Path) -> Outcome:
    """DNS rebinding: evil.example is made to point to 127.0.0.1, so its page is of the same origin as ours."""
    with shown(folder) as page:
        port = page.port
        names = (f"evil.example:{port}", "evil.example", f"127.0.0.1.evil.example:{port}", f"127.0.0.1:{port + 1}", "")
        status = [asked(page, f"/{page.gate.token}/", Host=name)[0] for name in names]
        sockets = [refused(page, host=name, origin=f"http://{name}") for name in names[:3]]
        held = all(code in (400, 403) for code in status) and all(sockets)
        return Outcome(held, f"HTTP {sorted(set(status))}, websocket refused: {all(sockets)}")


def other_user(folder: Path) -> Outcome:
    """Another user of the machine reaches loopback, but has not seen the link."""
    with shown(folder) as page:
        near = page.gate.token[:-1] + ("A" if page.gate.token[-1] != "A" else "B")
        paths = (
            "/",
            "/index.html",
            f"/{near}/",
            f"//{page.gate.token}/",
            f"/x/../{page.gate.token}",
            "/%2e%2e/",
            f"/?{page.gate.token}",
        )
        found = [asked(page, path) for path in paths]
        sockets = [refused(page, token=token) for token in ("", near, page.gate.token.lower(), "%00", "x" * 5000)]
        held = all(code == 403 and page.gate.token not in text and len(text) < 200 for code, text, _ in found)
        codes = sorted({code for code, _, _ in found})
        return Outcome(
            held and all(sockets),
            f"{len(found)} paths: HTTP {codes}; {sum(sockets)} of {len(sockets)} websockets refused",
        )


def headers(folder: Path) -> Outcome:
    """What a browser needs to be told so that nobody frames the page or learns its address."""
    with shown(folder) as page:
        got = [asked(page, path)[2] for path in (f"/{page.gate.token}/", "/")]
        policy = [found["Content-Security-Policy"] for found in got]
        held = bool(
            all(found["X-Frame-Options"] == "DENY" and found["Referrer-Policy"] == "no-referrer" for found in got)
            and all(found["X-Content-Type-Options"] == "nosniff" and found["Server"] is None for found in got)
            and all("frame-ancestors 'none'" in one and "default-src 'none'" in one for one in policy)
            and "unsafe-inline" not in re.findall("script-src[^;]*", policy[0])[0]
        )
        return Outcome(
            held, "no frames, no referrer, no other sources, no inline script" if held else f"only {got[0].keys()}"
        )


FOREIGN = """<script>
const said = [];
const name = s => said.push(s);
async function go() {{
  for (const url of {urls}) {{
    await new Promise(done => {{ const ws = new WebSocket(url, ["viser-v{version}"]);
      ws.onopen = () => {{ name("open " + url); done(); }}; ws.onerror = () => {{ name("refused"); done(); }}; }});
  }}
  try {{ await (await fetch("{page}")).text(); name("open fetch"); }} catch (e) {{ name("refused"); }}
  const frame = document.createElement("iframe"); frame.src = "{page}"; document.body.append(frame);
  await new Promise(done => {{ frame.onload = done; setTimeout(done, 3000); }});
  document.title = "done " + said.join(",");
}}
</script><body onload="go()">"""
NASTY = (
    "<img src=x onerror=\"window.pwned='img'\"><svg onload=\"window.pwned='svg'\"></svg>"
    '<iframe srcdoc="<script>parent.pwned=\'frame\'</script>"></iframe><script>window.pwned="script"</script>'
    '<object data="data:text/html,<script>parent.pwned=1</script>"></object><a href="javascript:pwned=1">x</a>'
)


def foreign_page(folder: Path) -> Outcome:
    """A real browser on a page of another origin, which knows port and even token of a running viewer."""
    with shown(folder) as page, chromium() as browser:
        urls = [f"ws://{host}:{page.port}/{t}" for host in ("127.0.0.1", "localhost") for t in ("", page.gate.token)]
        text = FOREIGN.format(urls=urls, version=viser.__version__, page=page.url)
        with web_page(text) as address:
            tab = browser.new_page()
            tab.goto(address)
            tab.wait_for_function("document.title.startsWith('done')", timeout=20_000)
            said, frames = tab.title(), [one.url for one in tab.frames[1:]]
        clients = len(page.server.get_clients())
    held = "open" not in said and clients == 0 and not any(page.gate.token in url for url in frames)
    return Outcome(held, f"{said.count('refused')} of {len(urls) + 1} ways refused, frame empty, clients {clients}")


def script_in_a_name(folder: Path) -> Outcome:
    """HTML that reached the page in spite of all escaping: the second wall is the page's policy."""
    with shown(folder) as page, chromium() as browser:
        page.gui.add_html(NASTY, order=-1.0)
        page.gui.add_markdown(NASTY, order=-1.0)
        tab = browser.new_page()
        tab.goto(page.url)
        tab.wait_for_selector("iframe", state="attached", timeout=60_000)
        tab.wait_for_timeout(1500)
        pwned, drawn = tab.evaluate("() => window.pwned ?? null"), tab.locator("text=torque x").count()
    return Outcome(pwned is None and drawn > 0, f"script that ran: {pwned or 'none'}; the page is there")


NAMES = (
    *("../outside.toml", "mine.toml", "link.toml", "dangling.toml", "pipe.toml", ".hidden.toml", "a/b.toml"),
    *("..\\outside.toml", "C:evil.toml", "nul.toml", "mine.toml\n", "a\x00.toml", "\u202etoml.exe.toml", "a b.toml"),
    *(f"{'x' * 300}.toml", "~/.toml", "authorized_keys", "%2e%2e/x.toml", "\uff0e\uff0e/x.toml"),
)
"""Of files, as a client may send them."""


def write_elsewhere(folder: Path) -> Outcome:
    """Names of files as a client may send them, links in the folder, and files that are there already."""
    start, outside = folder / "models", folder / "outside.toml"
    start.mkdir()
    outside.write_text("mine\n")
    (start / "mine.toml").write_text("mine\n")
    (start / "link.toml").symlink_to(outside)
    (start / "dangling.toml").symlink_to(folder / "made.toml")
    os.mkfifo(start / "pipe.toml")
    before = {path: path.lstat() for path in sorted(folder.rglob("*"))}
    names = (str(outside), *NAMES)
    with shown(folder, start) as page:
        del before[start]
        said: list[str] = []
        page.fail = lambda error, client=None: said.append(error_text(error))  # type: ignore[method-assign]
        panel = next(one for one in page.panels if isinstance(one, EffectsPanel))
        with client(page) as connection:
            send(connection, **CAMERA)
            eventually(lambda: bool(page.server.get_clients()))
            for name in names:
                heard = len(said)
                update(connection, panel.path, name)
                eventually(lambda name=name: panel.path.value == name, 2.0)  # type: ignore[misc]
                update(connection, panel.save, True)
                eventually(lambda heard=heard: len(said) > heard, 2.0)  # type: ignore[misc]
    after = {path: path.lstat() for path in sorted(folder.rglob("*")) if path not in (start, folder / log()[1])}
    unchanged = {p: (s.st_mtime_ns, s.st_size) for p, s in before.items()} == {
        p: (s.st_mtime_ns, s.st_size) for p, s in after.items()
    }
    telling = [words for words in said if "\n" in words or str(start) in words]  # the outer folder was typed
    return Outcome(
        unchanged and not telling and len(said) == len(names),
        f"{len(said)} of {len(names)} names refused in one line; a file was made or changed: {not unchanged}"
        + (f"; told too much: {telling[0]!r}" if telling else ""),
    )


def write_nowhere(folder: Path) -> Outcome:
    """Without --save-to the page writes no file: it offers a download."""
    with shown(folder) as page:
        before, here = sorted(folder.rglob("*")), sorted(Path.cwd().iterdir())
        panel = next(one for one in page.panels if isinstance(one, EffectsPanel))
        with client(page) as connection:
            send(connection, **CAMERA)
            eventually(lambda: bool(page.server.get_clients()))
            update(connection, panel.path, "mine.toml")
            update(connection, panel.save, True)
            time.sleep(GRACE)
            got = b"".join(drained(connection))
        unchanged = before == sorted(folder.rglob("*")) and here == sorted(Path.cwd().iterdir())
    held = unchanged and panel.save.label == "Download model"
    return Outcome(held, f"a file was written: {not unchanged}; the client was sent {len(got)} bytes")


def odd_values(folder: Path) -> Outcome:
    """To every control of the page: what is no option, no number, out of range, of another type, or no value."""
    values = [
        "no such option",
        "",
        -1,
        1e300,
        float("nan"),
        float("inf"),
        None,
        [],
        {},
        [1e9] * 3,
        b"\xff",
        2**63,
        "x" * 200_000,
    ]
    attributes = (
        "update_cb",
        "removed",
        "sync_cb",
        "uuid",
        "props",
        "gui_api",
        "is_button",
        "visible",
        "options",
        "nonsense",
    )
    errors = io.StringIO()
    with contextlib.redirect_stderr(errors), shown(folder) as page:
        controls = dict(page.server.gui._gui_input_handle_from_uuid)
        had = {uuid: (repr(one.value), one._impl.update_cb, one._impl.removed) for uuid, one in controls.items()}
        with client(page) as connection:
            send(connection, **CAMERA)
            eventually(lambda: bool(page.server.get_clients()))
            for k, control in enumerate(controls.values()):
                for value in values:
                    if not (isinstance(value, str) and isinstance(control, viser.GuiTextHandle)):
                        update(connection, control, value)
                for name in attributes if k % 8 == 0 else ():
                    update(connection, control, [], name)
            send(connection, type="GuiUpdateMessage", uuid="no such control", updates={"value": 1})
            sent = len(controls) * len(values) + len(controls) // 8 * len(attributes)
            connection.ping().wait(20.0)
            settled(page)
        strange = [
            uuid
            for uuid, one in controls.items()
            if uuid in page.server.gui._gui_input_handle_from_uuid
            and (
                one._impl.update_cb is not had[uuid][1]
                or one._impl.removed != had[uuid][2]
                or not admissible(one, had[uuid][0])
            )
        ]
        lives = alive(page)
    held = not strange and lives and "Traceback" not in errors.getvalue()
    return Outcome(held, f"{sent} values to {len(controls)} controls: {len(strange)} taken over, page alive: {lives}")


def admissible(control: Any, before: str) -> bool:
    """Whether a control still has what it had, or what it offers."""
    match control:
        case viser.GuiNumberHandle():  # without bounds, a finite number is a value like another
            return bool(np.isfinite(control.value)) and abs(control.value) <= 1e12
        case viser.GuiSliderHandle():
            return bool(control.min <= control.value <= control.max)
    return repr(control.value) == before


def settled(page: Page) -> None:
    """Wait until what was sent has been read and done."""
    eventually(lambda: page.server._thread_executor._work_queue.empty(), 20.0)
    with page.lock:
        pass


def garbage(folder: Path) -> Outcome:
    """Random bytes, half messages, unknown types, text, and real types with fields of any kind."""
    rng, errors = np.random.default_rng(27), io.StringIO()
    kinds = [kind for kind in dir(viser._messages) if kind.endswith("Message")] + [
        "FileTransferPart",
        "__class__",
        "Message",
    ]
    with contextlib.redirect_stderr(errors), shown(folder) as page:
        with client(page) as connection:
            send(connection, **CAMERA)
            for k in range(600):
                fields = {
                    str(rng.choice(["uuid", "updates", "name", "value", "payload"])): [None, -1, "x", b"x", [], {}][
                        k % 6
                    ]
                    for _ in range(3)
                }
                connection.send(rng.bytes(int(rng.integers(0, 200))))
                send(connection, type=str(rng.choice(kinds)), **fields)
                if k % 50 == 0:
                    connection.send("text")
                    connection.send(b"\x91" * 5000)
            answered = connection.ping().wait(20.0)
        lives = alive(page)
    said = errors.getvalue()
    return Outcome(
        bool(answered) and lives and "Traceback" not in said,
        f"1200 messages; the client is still served: {answered}; page alive: {lives}",
    )


def flood(folder: Path) -> Outcome:
    """Ten thousand clicks in one go, on what takes the page's time: a slider that is dragged, and searches."""
    with shown(folder) as page:
        panel = next(one for one in page.panels if isinstance(one, EffectsPanel))
        process = psutil.Process()
        with client(page) as connection:
            send(connection, **CAMERA)
            eventually(lambda: bool(page.server.get_clients()))
            before, most, longest = process.memory_info().rss, 0, 0
            stop = time.monotonic() + 4.0

            def push() -> None:
                with contextlib.suppress(WebSocketException, OSError):
                    for k in range(10_000):
                        update(connection, page.transport.zoom, ["5 s", "2 s"][k % 2] if k % 2 else "whole flight")
                        update(connection, panel.refit, True)

            sender = threading.Thread(target=push, daemon=True)
            sender.start()
            while time.monotonic() < stop:
                most = max(most, process.num_threads())
                longest = max(longest, page.server._thread_executor._work_queue.qsize())
                time.sleep(0.05)
            connection.close()
        sender.join(5.0)
        grown = (process.memory_info().rss - before) / 1e6
        begin = time.monotonic()
        lives = alive(page)
        waited = time.monotonic() - begin
    held = lives and waited < 5.0 and grown < 200.0 and longest < 100
    return Outcome(
        held,
        f"at most {longest} waited in the queue, {grown:.0f} MB more; another client was served after {waited:.1f} s",
    )


def large_uploads(folder: Path) -> Outcome:
    """Uploads that say one size and have another, many at once, and a message of 100 MB."""
    with shown(folder) as page:
        button = next(
            one
            for one in page.server.gui._gui_input_handle_from_uuid.values()
            if isinstance(one, viser.GuiUploadButtonHandle)
        )
        process, source = psutil.Process(), button._impl.uuid
        before = process.memory_info().rss
        with client(page) as connection:
            send(connection, **CAMERA)
            for k in range(60):
                begin = {"type": "FileTransferStartUpload", "source_component_uuid": source, "transfer_uuid": str(k)}
                begin |= {
                    "filename": "../../x",
                    "mime_type": "x",
                    "part_count": 16 if k % 2 else 10**9,
                    "size_bytes": 10**6 if k % 2 else 10**12,
                }
                send(connection, **begin)
                for part in range(3):
                    send(
                        connection,
                        type="FileTransferPart",
                        source_component_uuid=source,
                        transfer_uuid=str(k),
                        part_index=part,
                        content=b"x" * 900_000,
                    )
            connection.ping().wait(20.0)
            kept = sum(
                len(p) for s in page.server.gui._current_file_upload_states.values() for p in s["parts"].values()
            )
        closed = False
        with contextlib.suppress(OSError), client(page) as connection:
            try:
                connection.send(b"\x00" * 100_000_000)
                while True:  # what came before the end is in the way
                    connection.recv(timeout=5.0)
            except (WebSocketException, OSError):
                closed = True
        grown = (process.memory_info().rss - before) / 1e6
        lives = alive(page)
    return Outcome(
        kept <= 4_000_000 and closed and lives,
        f"{kept / 1e6:.1f} MB kept of 160 sent; the large message ends its sender; {grown:.0f} MB more, his included",
    )


def dropped_logs(folder: Path) -> Outcome:
    """Files that are no logs, unfinished ones, and pieces of one byte, to the place where a page takes logs."""
    page = Page(session_of(Intake(), lambda share, words: None), port=0)
    try:
        panel = next(one for one in page.panels if isinstance(one, LogsPanel))
        source, dropped = panel.drop.button._impl.uuid, panel.intake.dropped
        told = page.server._websock_server.get_message_buffer().message_from_id
        with client(page) as connection:
            send(connection, **CAMERA)
            for k in range(300):
                names = {"source_component_uuid": source, "transfer_uuid": str(k)}
                begin = {
                    "filename": f"{k}.ulg",
                    "mime_type": "x",
                    "part_count": 9,
                    "size_bytes": (0, 9, 10**6 + k)[k % 3],
                }
                send(connection, type="FileTransferStartUpload", **names, **begin)
                for part in range(9):
                    send(connection, type="FileTransferPart", **names, part_index=part, content=b"x")
            lives = eventually(lambda: panel.drop._size == 10**6 + 299, 40.0) and alive(page)
        eventually(lambda: len(list(dropped.iterdir())) <= 1)
        left, kept = len(list(dropped.iterdir())), len(told)
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            page.stop()
    return Outcome(lives and left <= 1 and kept < 500, f"{left} kept on the disk; {kept} messages kept; alive: {lives}")


def share_tunnel(folder: Path) -> Outcome:
    """Viser opens a tunnel to share.viser.studio for any client that asks: a loopback page on the internet."""
    with shown(folder) as page:
        asked_for: list[int] = []
        page.server.request_share_url = lambda: asked_for.append(1)
        with client(page) as connection:
            send(connection, **CAMERA)
            send(connection, type="ShareUrlRequest")
            send(connection, type="ShareUrlDisconnect")
            connection.ping().wait(5.0)
            time.sleep(GRACE)
    return Outcome(not asked_for, "no tunnel" if not asked_for else "a tunnel was asked for")


def link_in_processes(folder: Path) -> Outcome:
    """`--browser` starts a browser, and every user of the machine sees with which arguments."""
    from unittest.mock import patch

    from wrenchgap.replay.cli.commands.view import opened

    url = "http://127.0.0.1:8080/secret-token/"
    with patch("webbrowser.open") as started, opened(url):
        argument = str(started.call_args.args[0])
        path = Path(argument.removeprefix("file://"))
        private, leads = path.stat().st_mode & 0o077 == 0, url in path.read_text()
    held = "secret" not in argument and private and leads and (not path.exists() or sys.platform == "win32")
    said = "a file that only the user reads, removed at the end" if held else argument
    return Outcome(held, f"the argument of the browser: {said}")


ATTACKS = (
    Attack("a page of another origin connects, with the right token", "refused", foreign_origin),
    Attack("DNS rebinding: a foreign name that points to 127.0.0.1", "refused", rebound_name),
    Attack("another user of the machine asks loopback, without the link", "refused, and told nothing", other_user),
    Attack(
        "a page in a frame; its address in Referer; script of a name", "forbidden to the browser by headers", headers
    ),
    Attack(
        "Chromium on a foreign page with port and token: websocket, fetch, frame",
        "no way in",
        foreign_page,
        browser=True,
        slow=True,
    ),
    Attack(
        "HTML with script that reached the page unescaped",
        "the browser runs none of it",
        script_in_a_name,
        browser=True,
        slow=True,
    ),
    Attack(
        "names of files that lead elsewhere, links, a pipe, a file of the user",
        "refused in one line, no file touched",
        write_elsewhere,
    ),
    Attack("`Save model` without --save-to", "no file is written, the browser downloads it", write_nowhere),
    Attack(
        "odd values to every control, and to attributes that are no value",
        "no control takes them, no traceback",
        odd_values,
    ),
    Attack("random bytes and messages of any kind", "dropped; sender and others are served", garbage),
    Attack(
        "20,000 clicks at once, half of them on `Fit all again`",
        "queue below 100, 200 MB, others served in 5 s",
        flood,
        slow=True,
    ),
    Attack(
        "uploads that say one size and have another; a message of 100 MB",
        "4 MB kept; the sender is disconnected",
        large_uploads,
    ),
    Attack(
        "300 files that are no logs, are not finished or come in pieces of one byte, to the place for logs",
        "no more than the one on its way is kept, 500 messages; the page is alive",
        dropped_logs,
        slow=True,
    ),
    Attack("a client asks for viser's public tunnel", "none is opened", share_tunnel),
    Attack("the link in the list of processes, `--browser`", "not there", link_in_processes),
)
