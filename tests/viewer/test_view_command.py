"""`wrenchgap view` as a command: what it refuses, what it says, what it serves."""

import gc
import importlib
import os
import re
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from wrenchgap._lazy import uncollected
from wrenchgap.viewer.view_state import ViewState


def test_it_serves_the_page_and_no_files_and_ends_on_ctrl_c(flown, tmp_path):
    saved = tmp_path / "saved.view.json"
    saved.write_text(ViewState(flight="another", time=5.0, zoom="10 s").to_text())
    command = [sys.executable, "-m", "wrenchgap", "view", *map(str, flown), "-m", "tilt_hexarotor", "--port", "0"]
    process = subprocess.Popen(
        [*command, "--view", str(saved)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        cwd=Path(__file__).parents[2],
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a suite in the background ignores it
        env={**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "OMP_NUM_THREADS": "1"},
    )
    try:
        assert process.stdout is not None
        url = re.search(r"http://127\.0\.0\.1:\d+/[\w-]{43}", process.stdout.readline())
        assert url is not None
        with urllib.request.urlopen(url.group(), timeout=10) as answer:
            assert b"<html" in answer.read(2000).lower()
        for path in ("/../pyproject.toml", "/%2e%2e/%2e%2e/etc/passwd", f"/{flown[0]}", "/saved.view.json"):
            with pytest.raises(urllib.error.HTTPError):
                urllib.request.urlopen(url.group() + path, timeout=10)
        process.send_signal(signal.SIGINT)
        assert process.wait(15.0) in (0, 130)
    finally:
        process.kill()
    assert list((tmp_path / "cache" / "wrenchgap").glob("*.npz")), "the logs were not kept"


def test_a_page_waits_for_no_search_and_no_process_of_its_own():
    """What only panels that are asked something need is imported then."""
    code = "import sys, wrenchgap.replay.session.log_session, wrenchgap.viewer.page"
    later = ("joblib", "scipy.special", *(f"wrenchgap.{name}" for name in ("compensate.compensator", "learn.design")))
    later += tuple(f"wrenchgap.learn.{name}" for name in ("posterior.explain", "changed.changed", "process.train"))
    said = subprocess.run(
        [sys.executable, "-c", f"{code}; print([m for m in {later} if m in sys.modules])"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert said.stdout.strip() == "[]"


def test_garbage_is_collected_again_after_imports():
    frozen = gc.get_freeze_count()
    try:
        with pytest.raises(ImportError), uncollected():
            importlib.import_module("wrenchgap.not_there" if not gc.isenabled() else "wrenchgap")
        assert gc.isenabled()
        assert gc.get_freeze_count() > frozen
    finally:
        gc.unfreeze()
