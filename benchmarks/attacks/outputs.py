"""Names are data: of vehicles, topics and files, in every output.

`NASTY` goes through all of them. What is looked at is what came out: symbols of compiled C, control characters of a
terminal, parsed JSON and CSV, a page in Chromium that ran nothing and asked nobody.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.attacks import Attack, Outcome

AREA = "Names are data"
MODEL = "tilt_hexarotor"
SCRIPTS = (
    "<script>window.pwned=1</script>",
    '<iframe srcdoc="<script>parent.pwned=1</script>"></iframe>',
    "<img src=x onerror=window.pwned=1>",
    '"><svg onload=window.pwned=1>',
    "[a](javascript:window.pwned=1)",
    "![x](http://192.0.2.1/x.png)",
    "{window.pwned=1}",
    "{{7*7}}",
    "</title></style><script>window.pwned=1</script>",
)
"""What a page must not run, nor fetch (192.0.2.0/24 is nobody's)."""
NASTY = (
    *SCRIPTS,
    "x */ int pwn(void){return 1;} /*",
    "x ??/",
    "x \\",
    "x \\\n*/ int pwn(void){return 1;} /*",
    '"; system("x"); //',
    "$(shell touch pwned) ${pwned} `touch pwned`",
    "%n%s%d",
    "\x1b]0;pwned\x07\x1b[31m",
    "\x9b31m",
    "\u202epwned",
    "a\x00b",
    "a\r\nok   everything is fine",
    "\ud800",
    "$\\frac",
    "$x$",
    "=cmd|' /C calc'!A1",
    "+1+1",
    "x; =cmd|' /C calc'!A1",
    "@SUM(1)",
    "[bold red]x[/] [link=http://192.0.2.1]y[/link] :bomb:",
    "| a | b |",
    "../../pwned",
    "x" * 5000,
    "",
)
"""Names that mean something to somebody."""
COMMAND = (sys.executable, "-m", "wrenchgap")


def run(folder: Path, *arguments: str, expected: Sequence[int] = (0,)) -> subprocess.CompletedProcess[bytes]:
    """One command, in this folder; an unexpected exit code is an error."""
    wide = os.environ | {"COLUMNS": "200"}
    done = subprocess.run([*COMMAND, *arguments], cwd=folder, env=wide, capture_output=True, check=False)
    if done.returncode not in expected:
        raise RuntimeError(f"{arguments[0]}: exit code {done.returncode}: {done.stderr.decode(errors='replace')[:300]}")
    return done


def flown(folder: Path, seconds: int = 3, *more: str) -> Path:
    """A log of a simulated flight."""
    asked = ("-m", MODEL, "-t", "multi_axis", "--duration", str(seconds), *more, "-o", "plain.mcap", "-q")
    run(folder, "simulate", *asked)
    return folder / "plain.mcap"


def encodable(name: str) -> str:
    """As a topic or a path may have it."""
    return name.encode(errors="replace").decode()


def renamed(plain: Path, path: Path, names: Sequence[str] = NASTY) -> Path:
    """The same messages, each topic with a name behind its own (the longest shortened), and topics of every name."""
    from mcap.reader import make_reader
    from mcap.writer import Writer

    with plain.open("rb") as source, path.open("wb") as target:
        writer = Writer(target)
        writer.start()
        channels: dict[str, int] = {}
        for schema, channel, message in make_reader(source).iter_messages():
            if channel.topic not in channels:
                assert schema is not None
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                name = encodable(names[len(channels) % len(names)])[:200]
                channels[channel.topic] = writer.register_channel(
                    f"{channel.topic}/{name}", channel.message_encoding, number
                )
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        for name in map(encodable, names):
            other = writer.register_schema(name, "ros2msg", b"float64 x")
            writer.add_message(writer.register_channel(f"/{name}", "cdr", other), 10**9, b"\0\1\0\0" + bytes(8), 10**9)
        writer.finish()
    return path


def file_name(name: str) -> str:
    """Of a log."""
    return f"{name}.mcap"


def controls(output: bytes) -> list[str]:
    """What a terminal would obey, in what is printed to none."""
    return sorted({c for c in output.decode() if c != "\n" and not c.isprintable()})


def terminal(folder: Path) -> Outcome:
    """Topics, types and a file of nasty names, printed."""
    name = file_name("\x1b]0;pwned\x07 \u202e\x9b \udcff [bold]x a\nb")
    log = renamed(flown(folder), folder / name)
    said = b""
    for asked in (
        ("inspect", log.name, "-m", MODEL),
        ("inspect", log.name, "--details"),
        ("compare", log.name, "-m", MODEL),
    ):
        done = run(folder, *asked, expected=(0, 2, 3))
        said += done.stdout + done.stderr
    said += run(folder, "inspect", f"{name}.gone", "--unknown\x1b[31m", expected=(2,)).stderr
    found, forged = controls(said), b"\nok   everything" in said
    marked = b"[link=http://192.0.2.1]" in said
    words = [f"control characters: {' '.join(map(repr, found)) or 'none'}"]
    words += [f"markup {'printed as it is' if marked else 'obeyed'}", *(["a line was forged"] if forged else [])]
    return Outcome(not found and marked and not forged, "; ".join(words))


def tables(folder: Path) -> Outcome:
    """JSON and CSV of a flight and topics with nasty names."""
    log = renamed(flown(folder), folder / file_name("=cmd|calc!A1 \x1b \udcff"))
    run(folder, "compare", log.name, "-m", MODEL, "--csv", "out.csv", "--json", "out.json", "-q", expected=(0, 2, 3))
    run(folder, "inspect", log.name, "--json", "inspect.json", "-q", expected=(0, 3))
    texts = [(folder / name).read_text(encoding="utf-8") for name in ("out.json", "inspect.json")]
    for text in texts:
        json.loads(text, parse_constant=lambda word: (_ for _ in ()).throw(ValueError(word)))
    topics = {t["topic"] for t in json.loads(texts[1])["logs"][0]["topics"]}
    kept = sum(f"/{encodable(name)}" in topics for name in NASTY)
    with (folder / "out.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    formulae = sum(cell[:1] in ("=", "@", "+") for row in rows for cell in row)
    negative = sum(cell.startswith("-") and float(cell) < 0.0 for row in rows[1:] for cell in row)
    whole = len({len(row) for row in rows}) == 1 and negative > 0 and rows[1][0].startswith("'=cmd")
    raw = [c for text in texts for c in text if c != "\n" and not c.isprintable()]
    words = f"{kept} of {len(NASTY)} topics read back from JSON as they were; {formulae} cells a formula"
    return Outcome(kept == len(NASTY) and not formulae and whole and not raw, words)


def exported(folder: Path) -> Outcome:
    """A vehicle of all nasty names at once."""
    compiler = next((c for c in ("cc", "gcc", "clang") if shutil.which(c)), None)
    if compiler is None:
        return Outcome(False, "no C compiler here")
    symbols = []
    for number, name in enumerate(("innocent", " ".join(encodable(name)[:200] for name in NASTY))):
        place = folder / str(number)
        place.mkdir()
        for file, text in files_of(name).items():
            (place / file).write_text(text, encoding="utf-8")
        flags = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O0", "-DWG_DOUBLE", "-c")
        done = subprocess.run(
            [compiler, *flags, "wrenchgap_compensator.c"], cwd=place, capture_output=True, text=True, check=False
        )
        if done.returncode:
            return Outcome(False, f"{name[:20]}: {done.stderr[:200]}")
        listed = subprocess.run(
            ["nm", "wrenchgap_compensator.o"], cwd=place, capture_output=True, text=True, check=True
        )
        symbols.append([line.split()[-2:] for line in listed.stdout.splitlines()])
    build = [(folder / "0" / n).read_bytes() == (folder / "1" / n).read_bytes() for n in ("Makefile", "CMakeLists.txt")]
    same = symbols[0] == symbols[1]
    words = f"compiled without a warning; {len(symbols[1])} symbols, {'the same' if same else 'others'}"
    return Outcome(
        same and all(build), f"{words}; Makefile and CMakeLists.txt {'the same' if all(build) else 'others'}"
    )


def files_of(name: str) -> dict[str, str]:
    """The export of a model of an effect, with this name of the vehicle and of its file."""
    from wrenchgap.plant import model_file
    from wrenchgap.plant.model import make_effect
    from wrenchgap.replay.export.export import export_compensator

    model = model_file.load(MODEL)
    vehicle = replace(model.vehicle, name=name)
    model = replace(model, vehicle=vehicle).with_effects(
        [make_effect(vehicle, "com_offset", dict.fromkeys("xyz", 0.01))]
    )
    return export_compensator(None, model, names=(name, "-"), command=f"wrenchgap export -m '{name}'").files


@contextmanager
def chromium() -> Iterator[Any]:
    """A headless browser."""
    from playwright.sync_api import sync_playwright

    path = next(p for name in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(name)))
    flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=flags)
        yield browser
        browser.close()


INJECTED = """() => ({pwned: window.pwned ?? 0, elements: [...document.querySelectorAll(
    'iframe, [onerror], [onload], a[href^="javascript:"], img[src*="192.0.2"]')].length})"""


def looked_at(url: str, ready: Callable[[Any], None]) -> Outcome:
    """A page in a browser: whether anything of a name ran, became an element, or asked another machine."""
    asked: list[str] = []
    with chromium() as browser:
        tab = browser.new_page(viewport={"width": 1120, "height": 620})
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(url)
        ready(tab)
        tab.wait_for_timeout(1500)
        found, text = tab.evaluate(INJECTED), tab.inner_text("body")
    own = ("file:", "data:", "blob:", "http://localhost:", "http://127.0.0.1:", "ws://localhost:", "ws://127.0.0.1:")
    others = [u for u in asked if not u.startswith(own)]
    seen = sum(name in text for name in SCRIPTS)
    words = (
        f"{seen} names readable on it; script that ran: {found['pwned']}, elements from names: {found['elements']}, "
    )
    held = not found["pwned"] and not found["elements"] and not others and seen > 0
    return Outcome(held, words + f"requests elsewhere: {len(others)}")


def page(folder: Path) -> Outcome:
    """The page of `view`: a log, its topics, its notes and its warnings with nasty names."""
    from wrenchgap.learn.data.opening import open_flights
    from wrenchgap.plant import model_file
    from wrenchgap.replay.session.log_session import LogSession
    from wrenchgap.viewer.page import Page
    from wrenchgap.viewer.session import Scene

    class Noted(LogSession):
        """Says all names as notes and as warnings too."""

        def scene(self, *arguments: Any) -> Scene:
            return replace(super().scene(*arguments), notes=NASTY, warnings=NASTY)

    log = renamed(flown(folder), folder / file_name("<img src=x onerror=window.pwned=1>"))
    model = model_file.load(MODEL)
    named = replace(model, vehicle=replace(model.vehicle, name=SCRIPTS[0]))
    session = Noted(open_flights([log], named), named)
    shown = Page(session, port=0)

    def ready(tab: Any) -> None:
        tab.wait_for_selector("canvas", timeout=90_000)
        tab.wait_for_selector("text=torque x", timeout=90_000)
        for name in ("Notes", "Effects", "Failure", "Export", "Notes"):
            if tab.get_by_role("tab", name=name).count():
                tab.get_by_role("tab", name=name).first.click()
                tab.wait_for_timeout(300)
        shown.notify(" ".join(SCRIPTS))

    try:
        return looked_at(shown.url, ready)
    finally:
        shown.stop()


def report(folder: Path) -> Outcome:
    """The report of a log of a nasty name."""
    log = renamed(
        flown(folder, 12, "--excitation", "1", "--hide", "com_offset=x:-0.004,y:0.007,z:0"),
        folder / file_name("<img src=x onerror=window.pwned=1>$x$"),
    )
    run(folder, "report", log.name, "-m", MODEL, "-o", "report.html", "-q", expected=(0, 2))
    return looked_at((folder / "report.html").as_uri(), lambda tab: None)


ATTACKS = (
    Attack(
        "a vehicle, a model file and a command with names that end a comment, join lines, call make; `export`",
        "compiles with -Wall -Wextra -Werror; symbols, Makefile and CMakeLists.txt of an innocent name",
        exported,
    ),
    Attack(
        "topics, types and a file with escape sequences, C1 controls, bidi overrides, line breaks, rich's markup; "
        "`inspect`, `compare`, errors",
        "no control character but line breaks of our own, no markup obeyed",
        terminal,
        slow=True,
    ),
    Attack(
        "the same names in JSON and CSV, a file called `=cmd|...`",
        "strict JSON with the same names; CSV parses, no text is a formula, numbers stay numbers",
        tables,
        slow=True,
    ),
    Attack(
        "topics, notes, warnings, a file and a vehicle with scripts, frames, links, pictures; the page of `view`",
        "nothing runs, no element comes of a name, no request leaves the machine",
        page,
        slow=True,
        browser=True,
    ),
    Attack(
        "the same names in the HTML report",
        "nothing runs, no element comes of a name, no request leaves the machine",
        report,
        slow=True,
        browser=True,
    ),
)
