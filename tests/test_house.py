"""The house keeps its own rules: layers, docstrings, versions, links, a page for every effect."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from scripts import check_docs, effects_index

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("flight", "plant", "learn", "compensate", "viewer", "replay")
SOURCES = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_module_says_what_it_is(source: Path) -> None:
    assert ast.get_docstring(ast.parse(source.read_text(encoding="utf-8")))


def test_every_folder_with_sources_is_a_package() -> None:
    folders = {source.parent for source in SOURCES}
    assert not [str(folder) for folder in folders if not (folder / "__init__.py").exists()]


def lint_imports(root: Path) -> subprocess.CompletedProcess[str]:
    """Import-linter on the tree at `root`, with that tree's configuration."""
    run = "from importlinter.cli import lint_imports_command as run; run()"
    code = f"import sys; sys.path.insert(0, {str(root)!r}); {run}"
    command = [sys.executable, "-c", code, "--no-cache"]
    return subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The packages and the configuration, to be spoilt."""
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def test_imports_go_down_only() -> None:
    run = lint_imports(ROOT)
    assert run.returncode == 0, run.stdout


@pytest.mark.parametrize(
    ("low", "high"), [("flight", "plant"), ("plant", "learn"), ("learn", "compensate"), ("viewer", "learn")]
)
def test_an_import_upwards_or_sideways_is_noticed(copy: Path, low: str, high: str) -> None:
    (copy / low / "spoilt.py").write_text(f"import {high}\n")
    run = lint_imports(copy)
    assert run.returncode == 1
    assert f"{low}.spoilt -> {high}" in run.stdout


def test_changelog_begins_with_the_version_of_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    newest = re.search(r"^## \[(\d[^\]]*)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert newest is not None
    assert newest[1] == project["version"]


def test_lock_pins_every_dependency() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    asked = project["dependencies"] + project["optional-dependencies"]["dev"]
    names = {re.split(r"[<>=!~;\[ ]", line)[0].lower().replace("_", "-") for line in asked}
    lock = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    pinned = set(re.findall(r"^([a-z0-9][a-z0-9.-]*)==", lock, re.MULTILINE))
    assert names - pinned == set()


def test_links_of_the_documentation_lead_somewhere() -> None:
    assert check_docs.broken_links() == []


def test_examples_of_the_documentation_run() -> None:
    assert check_docs.failing_examples() == []


def test_a_dead_link_a_dead_heading_and_a_failing_example_are_noticed(tmp_path: Path) -> None:
    (tmp_path / "good.md").write_text(
        "# One heading, two words\n\n[web](https://example.org) [self](#one-heading-two-words)\n"
    )
    (tmp_path / "bad.md").write_text(
        "[a](good.md#one-heading-two-words) [b](gone.md) [c](good.md#gone) `[not](a-link.md)`\n\n"
        "```python\nx = 1\n```\n\ntext\n\n```python\nassert x == 2\n```\n\n```text\n[not](a-link.md)\n```\n"
    )
    links = check_docs.broken_links(tmp_path)
    assert [line.split(": ")[1] for line in links] == ["link to gone.md", "link to good.md#gone"]
    (failure,) = check_docs.failing_examples(tmp_path)
    assert 'File "bad.md", line 10' in failure


def test_every_effect_has_a_page_and_the_index_is_fresh() -> None:
    assert effects_index.missing_pages() == []
    written = (ROOT / "docs" / "effects" / "README.md").read_text(encoding="utf-8")
    assert written == effects_index.index(), "run make docs"
