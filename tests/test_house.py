"""The house keeps its own rules: layers, no circles, lengths, versions, links, a page for every effect."""

import ast
import contextlib
import importlib
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import grimp
import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

from scripts import check_docs, effects_index

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("flight", "plant", "learn", "compensate", "viewer", "replay")
PROGRAMS = ("benchmarks", "scripts", "examples")


def text_of(path):
    return (ROOT / path).read_text(encoding="utf-8")


PROJECT = tomllib.loads(text_of("pyproject.toml"))["project"]
LONGEST_FUNCTION, LONGEST_FILE = 60, 350
"""Lines. What is longer holds a comment that begins with REASON and says why."""
REASON = "# Long because"


def sources(*folders):
    return [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]


def test_every_folder_with_sources_is_a_package():
    folders = {source.parent for source in sources(*PACKAGES)}
    assert not [str(folder) for folder in folders if not (folder / "__init__.py").exists()]


def too_long(source):
    """Names of functions above their length, "" for the file itself, and their lines; those with a reason left out."""
    lines = source.splitlines()
    if len(lines) > LONGEST_FILE and not any(line.startswith(REASON) for line in lines):
        yield "", len(lines)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = lines[node.lineno - 1 : node.end_lineno]
            if len(body) > LONGEST_FUNCTION and not any(line.strip().startswith(REASON) for line in body):
                yield node.name, len(body)


def test_functions_and_files_are_short_or_say_why_not():
    found = {
        (f"{path.relative_to(ROOT)}::{name}" if name else str(path.relative_to(ROOT))): lines
        for path in sources(*PACKAGES, *PROGRAMS)
        for name, lines in too_long(path.read_text(encoding="utf-8"))
    }
    new = [f"{name}: {lines} lines" for name, lines in found.items()]
    assert not new, f"shorten, or say why in a comment `{REASON} ...`:\n" + "\n".join(new)


def test_what_is_long_is_noticed_unless_it_says_why():
    function = "def long():\n" + "    pass\n" * LONGEST_FUNCTION
    assert list(too_long(function)) == [("long", LONGEST_FUNCTION + 1)]
    assert list(too_long(function.replace("pass", f"{REASON} so.\n    pass", 1))) == []
    assert list(too_long("pass\n" * LONGEST_FILE)) == []
    assert list(too_long("pass\n" * (LONGEST_FILE + 1))) == [("", LONGEST_FILE + 1)]


def test_no_import_circle_not_even_for_types_alone():
    graph = grimp.build_graph("wrenchgap", cache_dir=None)
    modules = sorted(graph.modules)
    imports = np.array([[other in graph.find_modules_directly_imported_by(m) for other in modules] for m in modules])
    _, circle = connected_components(imports, connection="strong")
    members = [[m for m, k in zip(modules, circle, strict=True) if k == label] for label in np.unique(circle)]
    assert [names for names in members if len(names) > 1] == []


def lint_imports(root):
    """Import-linter on the tree at `root`, with that tree's configuration."""
    run = "from importlinter.cli import lint_imports_command as run; run()"
    code = f"import sys; sys.path.insert(0, {str(root / 'src')!r}); {run}"
    command, wide = [sys.executable, "-c", code, "--no-cache"], os.environ | {"COLUMNS": "200"}
    return subprocess.run(command, cwd=root, env=wide, capture_output=True, text=True, check=False)


def test_imports_go_down_only():
    run = lint_imports(ROOT)
    assert run.returncode == 0, run.stdout


UPWARDS_OR_SIDEWAYS = (
    ("flight", "wrenchgap.plant"),
    ("plant", "wrenchgap.learn"),
    ("learn", "wrenchgap.compensate"),
    ("viewer", "wrenchgap.learn"),
    ("learn.data", "wrenchgap.learn.process"),
    ("replay.compensation", "wrenchgap.replay.counterfactual"),
    ("replay.counterfactual", "wrenchgap.replay.present"),
    ("learn.identify", "rich"),
    ("replay.session", "typer"),
)


def test_an_import_upwards_or_sideways_is_noticed(tmp_path):
    """In a copy of the packages, linked under src/wrenchgap as in the repository, with the configuration."""
    for folder in ("src", *PACKAGES, "models"):
        shutil.copytree(ROOT / folder, tmp_path / folder, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for low, high in UPWARDS_OR_SIDEWAYS:
        with (tmp_path / low.replace(".", "/") / "spoilt.py").open("a") as spoilt:
            spoilt.write(f"import {high}\n")
    run = lint_imports(tmp_path)
    assert run.returncode == 1
    missed = [(low, high) for low, high in UPWARDS_OR_SIDEWAYS if f"wrenchgap.{low}.spoilt -> {high}" not in run.stdout]
    assert not missed, run.stdout


def test_changelog_begins_with_the_version_of_the_project():
    newest = re.search(r"^## \[(\d[^\]]*)\]", text_of("CHANGELOG.md"), re.MULTILINE)
    assert newest[1] == PROJECT["version"]


def test_lock_pins_every_dependency():
    extras = PROJECT["optional-dependencies"]
    (every,) = extras["all"]  # wrenchgap[...]: all extras that are installed to develop
    asked = PROJECT["dependencies"] + extras["dev"]
    asked += [line for extra in every.partition("[")[2].rstrip("]").split(",") for line in extras[extra]]
    names = {re.split(r"[<>=!~;\[ ]", line)[0].lower().replace("_", "-") for line in asked} - {"wrenchgap"}
    assert names - set(re.findall(r"^([a-z0-9][a-z0-9.-]*)==", text_of("requirements.lock"), re.MULTILINE)) == set()


def test_every_public_name_is_in_the_page_of_the_api():
    page = text_of("docs/api.md")
    for name in ("wrenchgap", *(f"wrenchgap.{package}" for package in PACKAGES[:-1])):
        module = importlib.import_module(name)
        assert all(hasattr(module, public) for public in module.__all__), name
        assert [public for public in module.__all__ if f"`{public}`" not in page] == [], name


def test_the_score_in_the_readme_is_that_of_the_page_which_the_benchmark_writes():
    share, count = re.search(r"could be told \|[^|]*\| (\d+ %) \| (\d+) \|", text_of("docs/field.md")).groups()
    assert f"{share} of the {count} flights that could tell it" in text_of("README.md")


def exists(name):
    """A module, something in one, or a field of a class in one."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        with contextlib.suppress(ImportError):
            found = importlib.import_module(".".join(parts[:k]))
            for part in parts[k:]:
                if part in getattr(found, "__annotations__", {}):
                    return True
                found = getattr(found, part, None)
            return found is not None
    return False


def test_every_module_and_function_that_the_source_names_exists():
    text = "".join(path.read_text(encoding="utf-8") for path in sources(*PACKAGES))
    named = set(re.findall(rf"`((?:{'|'.join(PACKAGES)})\.[\w.]+)`", text))
    assert len(named) > 150
    assert sorted(name for name in named if not exists(f"wrenchgap.{name}")) == []


@pytest.mark.parametrize("page", sorted((ROOT / "docs/theory").glob("*.md")), ids=lambda page: page.stem)
def test_every_function_that_a_theory_page_names_exists(page):
    named = re.findall(r"`((?:flight|plant|learn|compensate|replay)\.[\w.]+)`", page.read_text(encoding="utf-8"))
    assert len(named) >= 10
    assert [name for name in named if not exists(f"wrenchgap.{name}")] == []


TO_WRITE = {"flight/formats/jsonl.py", "replay/session/panels/battery.py", "tests/viewer/test_battery_panel.py"}
"""Files of examples, which their pages ask the reader to write."""


def test_every_file_that_a_page_names_exists():
    """Decisions also tell of what was there before; capitals (NAME, FORMAT) stand for what the reader chooses."""
    pages = [p for p in (ROOT / "docs").rglob("*.md") if p.parent.name != "decisions"]
    named = set()
    for page in (*pages, ROOT / "README.md", ROOT / "CONTRIBUTING.md"):
        folders = "|".join((*PACKAGES, *PROGRAMS, "tests"))
        named |= set(re.findall(rf"`((?:{folders})/[\w./-]+)`", page.read_text(encoding="utf-8")))
    written = {path for path in named if not re.search(r"[A-Z]{4}", path)} - TO_WRITE
    assert len(written) > 60
    assert sorted(p for p in written if not ((ROOT / p).exists() or (ROOT / f"{p}.py").exists())) == []


def test_links_of_the_documentation_lead_somewhere():
    assert check_docs.broken_links() == []


@pytest.mark.slow
def test_examples_of_the_documentation_run():
    assert check_docs.failing_examples() == []


def test_a_dead_link_a_dead_heading_and_a_failing_example_are_noticed(tmp_path):
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


def test_every_effect_has_a_page_and_the_index_is_fresh():
    assert effects_index.missing_pages() == []
    assert text_of("docs/effects/README.md") == effects_index.index(), "run make docs"
    assert text_of(effects_index.CHECKS) == effects_index.checks(), "run make docs"
    assert [p for p in effects_index.COUNTED if text_of(p) != effects_index.counted(p)] == [], "run make docs"
    assert all(f"[{len(effects_index.catalogue())} effects]" in text_of(p) for p in effects_index.COUNTED)


WRITERS = {
    r"(from|import) rich\b": ("replay/present/tables.py", "replay/present/__init__.py", "replay/cli/requests.py"),
    r"\bMarkup\b|\|\s*safe\b|autoescape false": (),
    r"add_markdown": (),
    r"\bEnvironment\(": ("replay/export/export.py",),
    r"csv\.writer|to_csv": ("replay/present/documents.py", "viewer/panels/export.py", "plant/trajectory/file.py"),
    r"set_parse_math|parse_math=": ("replay/present/figures/style.py",),
}
"""Who alone may write a kind of output, so that a name is escaped in one place (`wrenchgap._escaping`)."""


def test_each_kind_of_output_has_its_writers():
    found = set()
    for pattern, writers in WRITERS.items():
        for path in sources(*PACKAGES) + sorted(p for f in PACKAGES for p in (ROOT / f).rglob("*.html*")):
            if str(path.relative_to(ROOT)) not in writers and re.search(pattern, path.read_text(encoding="utf-8")):
                found.add((pattern, str(path.relative_to(ROOT))))
    assert not found
