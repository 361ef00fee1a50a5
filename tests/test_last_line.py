"""What a run of the tests says last, where no browser can be driven."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

INNER = """
import pytest
@pytest.mark.browser
@pytest.mark.parametrize("k", range(3))
def test_page(k): pytest.skip("no Chromium") if {skip} else None
def test_other(): pytest.skip("another reason") if {skip} else None
def test_here(): pass
"""


@pytest.mark.parametrize(("skip", "workers"), [(True, ("-p", "xdist.plugin", "-n", "1")), (False, ())])
def test_skipped_browser_tests_are_counted_below_the_closing_line(tmp_path, skip, workers):
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = browser: as here\naddopts = -q\n")
    (tmp_path / "test_inner.py").write_text(INNER.format(skip=skip))
    (tmp_path / "test_whole.py").write_text("import pytest\npytest.importorskip('nobody_has_this')\n")
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *workers]
    quick = os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}  # plugins not used here take seconds
    run = subprocess.run(command, cwd=tmp_path, env=quick, capture_output=True, text=True, check=True)
    *_, before, last = run.stdout.splitlines()
    if skip:
        assert "1 passed, 5 skipped in" in before
        assert last.startswith("3 tests in a browser were not run")
        assert "apt-get install chromium" in last
    else:
        assert "5 passed, 1 skipped in" in last
