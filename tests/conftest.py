"""The last line of a run says what was not run, and why; flights that several test files use are made once."""

from __future__ import annotations

import pytest

REMEDY = "no Chromium or no Playwright; run: sudo apt-get install chromium && make setup"


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """Below pytest's closing line, where nobody overlooks it: "passed" alone would hide the skipped browser tests."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None:
        return
    skipped = [report for report in reporter.stats.get("skipped", []) if "browser" in report.keywords]
    if skipped:
        reporter.write_line(f"{len(skipped)} tests in a browser were not run: {REMEDY}")
