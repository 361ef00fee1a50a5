"""How long the viewer takes: to the first picture, per move of the cursor, while playing; what a thousand loops cost.

python -m benchmarks.viewer_speed [--browser] [--loops N]

Targets on two cores: from the command to the first picture 10 s on a ten-minute log that was never opened, 3
s on one that was (`flight.cache`); a move of the cursor 50 ms at the server; 30 updates a second while playing; memory
flat. With --browser the picture is waited for in a headless Chromium, which
here draws and compiles its shaders on the CPU; without it, for the page to be ready to be loaded.
"""

from __future__ import annotations

import argparse
import gc
import os
import re
import select
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from wrenchgap import flight
from wrenchgap.learn.data.opening import open_flights
from wrenchgap.plant import model_file
from wrenchgap.plant.simulation.flight_plan import Plan, fly
from wrenchgap.replay.session.log_session import LogSession
from wrenchgap.viewer.page import Page

MODEL = "tilt_hexarotor"
NEW, KNOWN, MOVE, RATE, GROWTH = 10.0, 3.0, 0.050, 30.0, 8.0
"""Targets [s], [s], [s], [1/s], and megabytes that a thousand loops may leave behind."""


def main() -> int:
    """Measure, print, and return how many targets were missed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--browser", action="store_true", help="wait for the picture in a headless Chromium")
    parser.add_argument("--loops", type=int, default=1000)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        long = log(Path(folder), "ten_minutes", 600.0)
        short = log(Path(folder), "one_minute", 60.0)
        os.environ["XDG_CACHE_HOME"] = folder
        verdicts = [
            first_picture(long, chosen.browser, "new", NEW),
            first_picture(long, chosen.browser, "known", KNOWN),
        ]
        page = opened(long)
        try:
            verdicts += [moves(page, "whole flight"), moves(page, "10 s"), bytes_per_move(page), playing(page)]
        finally:
            page.stop()
        verdicts.append(loops(short, chosen.loops))
    return verdicts.count(False)


def log(folder: Path, name: str, seconds: float) -> Path:
    """A simulated flight as a log on disk."""
    path = folder / f"{name}.mcap"
    flight.write(fly(Plan(model_file.load(MODEL), "multi_axis", seconds, 0.0, 1, None, ()), name=name), path)
    print(f"{name}: {path.stat().st_size / 1e6:.0f} MB")
    return path


def said(what: str, value: float, unit: str, target: float, *, least: bool = False) -> bool:
    """Print a figure beside its target."""
    good = value >= target if least else value <= target
    print(
        f"{what:50s} {value:9.2f} {unit:10s} target {'>=' if least else '<='} {target:g}  {'ok' if good else 'MISSED'}"
    )
    return good


def first_picture(path: Path, browser: bool, state: str, target: float) -> bool:
    """From the command to the picture, or to the page that can be loaded; beside it the command's processor time."""
    begin = time.monotonic()
    command = [sys.executable, "-m", "wrenchgap", "view", str(path), "-m", MODEL, "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        url = ""
        while not url:
            ready, _, _ = select.select([process.stdout], [], [], 60.0)
            line = process.stdout.readline() if ready else ""
            assert line, "the command ended without a page"
            found = re.search(r"http://\S+", line)
            url = found.group() if found else ""
        served = time.monotonic() - begin
        print(f"processor time of the command until its page, {state}: {processor_time(process.pid):.2f} s")
        if not browser:
            return said(f"command to page, {state} ten-minute log", served, "s", target)
        return said(f"command to first picture, {state} ten-minute log", served + pictured(url), "s", target)
    finally:
        process.terminate()
        process.wait(10.0)


def processor_time(process: int) -> float:
    """Seconds that a process has taken of the cores so far, its children's left out."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def pictured(url: str) -> float:
    """Seconds from asking for a page to a vehicle and plots on it; the browser itself runs already."""
    from playwright.sync_api import sync_playwright

    flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=flags)
        tab = chromium.new_page(viewport={"width": 1400, "height": 860})
        begin = time.monotonic()
        tab.goto(url)
        tab.wait_for_function("window.__viserMutable?.nodeRefFromName['/world/body']", timeout=60_000)
        tab.wait_for_function("Object.keys(window.__viserTestpoints?.uplots ?? {}).length > 2", timeout=60_000)
        took = time.monotonic() - begin
        chromium.close()
    return took


def moves(page: Page, zoom: str) -> bool:
    """Time of a move of the cursor at the server, the slowest of twenty."""
    page.transport.zoom.value = zoom
    random = np.random.default_rng(1)
    times = []
    for at in random.uniform(page.cursor.start, page.cursor.stop, 400):
        begin = time.perf_counter()
        page.cursor.go(float(at))
        times.append(time.perf_counter() - begin)
    return said(f"move of the cursor, plots show {zoom}, 95 %", 1e3 * float(np.percentile(times, 95)), "ms", 1e3 * MOVE)


def bytes_per_move(page: Page) -> bool:
    """What one move sends to every client."""
    page.transport.zoom.value = "whole flight"
    buffer: Any = page.server._websock_server.get_message_buffer()
    sent: list[int] = []
    push = buffer.push

    def counted(message: Any, *rest: Any) -> Any:
        sent.append(len(str(message.as_serializable_dict() if hasattr(message, "as_serializable_dict") else message)))
        return push(message, *rest)

    buffer.push = counted
    page.cursor.go(page.cursor.start + 100.0)
    buffer.push = push
    return said("sent by one move of the cursor, about", sum(sent) / 1e3, "kB", 100.0)


def playing(page: Page, seconds: float = 5.0) -> bool:
    """Updates a second while the flight plays."""
    count = 0

    def counted(_: float) -> None:
        nonlocal count
        count += 1

    page.cursor.listeners.append(counted)
    page.transport.playing(True)
    begin = time.monotonic()
    time.sleep(seconds)
    rate = count / (time.monotonic() - begin)
    page.transport.playing(False)
    page.cursor.listeners.remove(counted)
    return said("updates while playing", rate, "per second", 0.95 * RATE, least=True)


def opened(path: Path) -> Page:
    """The page of one log."""
    model = model_file.load(MODEL)
    return Page(LogSession(open_flights([path], model), model), port=0)


def loops(path: Path, number: int) -> bool:
    """Megabytes that many loops over a second of flight leave behind, after as many as warm everything up."""
    page = opened(path)
    try:
        page.transport.set_marks({"A": 10.0, "B": 11.0}, True)

        def turn(times: int) -> None:
            for _ in range(times):
                page.cursor.go(10.0)
                for _ in range(10):
                    page.cursor.advance(0.1)

        turn(max(number // 10, 1))
        before = resident()
        turn(number)
        return said(f"memory left by {number} loops", resident() - before, "MB", GROWTH)
    finally:
        page.stop()


def resident() -> float:
    """Megabytes in memory."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


if __name__ == "__main__":
    sys.exit(main())
