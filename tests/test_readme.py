"""Commands of the README and of the first analysis, run as written, in an empty folder: four minutes (`make slow`)."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = "".join((ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/start/first-analysis.md"))
LINES = "\n".join(re.findall(r"```sh\n(.*?)```", PAGES, re.DOTALL)).splitlines()
COMMANDS = [shlex.split(line, comments=True) for line in LINES if line.strip()]


def test_make_targets_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = [words[1] for words in COMMANDS if words[0] == "make"]
    assert targets == ["demo", "test"]
    for target in targets:
        assert re.search(rf"^{target}: setup ##", makefile, re.MULTILINE)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_commands_run_as_written(tmp_path):
    wrenchgap = [words for words in COMMANDS if words[0] == "wrenchgap"]
    assert len(wrenchgap) >= 10
    assert len(wrenchgap) + 2 == len(COMMANDS)
    source = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    for words in wrenchgap:
        command = [sys.executable, "-m", "wrenchgap", *words[1:]]
        done = subprocess.run(command, cwd=tmp_path, env=source, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{shlex.join(words)}: {done.stderr}"
        if words[1] == "explain":
            assert re.search(r"Explained by com_offset .* and arm_twist ", " ".join(done.stdout.split()))
        if words[1] == "learn":
            assert "no advantage" not in " ".join((done.stdout + done.stderr).split())
    for file in ("fitted.toml", "fitted.png", "rest.gp", "replayed.mcap", "replayed.csv", "reflown.mcap"):
        assert (tmp_path / file).stat().st_size > 0
