"""A part of the damaged files: each is read or refused in one line; the published page is that of its rows."""

import json
from pathlib import Path

import pytest

from benchmarks.faults import page
from benchmarks.faults.cases import Case
from benchmarks.faults.fuzz import seeds
from benchmarks.faults.fuzz.seeds import LOGS
from benchmarks.faults.opening import Opened, Outcome, judged
from benchmarks.faults.valid import FORMS
from benchmarks.faults.workers import Row, rows

ROOT = Path(__file__).resolve().parents[2]
OF_EACH = 8
"""The first files of each form, out of the published ones."""


@pytest.mark.slow
def test_damaged_files_of_every_form_are_read_or_refused_in_one_line():
    found = list(rows([Case(form, number) for form in FORMS for number in range(OF_EACH)]))
    assert [row for row in found if row.outcome == Outcome.FAULT] == []
    outcomes = {row.outcome for row in found}
    assert {Outcome.WHOLE, Outcome.RECOVERED, Outcome.REFUSED} <= outcomes
    assert len(found) == OF_EACH * len(FORMS) >= 200


@pytest.mark.parametrize("form", ["ulog", "gp", "folder-sqlite3"])
def test_a_case_is_always_the_same_file(form, tmp_path):
    made = []
    for attempt in ("one", "other"):
        (tmp_path / attempt / "valid").mkdir(parents=True)
        (tmp_path / attempt / "case").mkdir()
        valid = FORMS[form](tmp_path / attempt / "valid")
        path, damage = Case(form, 41).make(valid, tmp_path / attempt / "case")
        files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
        made.append((damage, [p.name for p in files], [p.read_bytes() for p in files if p.suffix != ".db3"]))
    assert made[0] == made[1]


@pytest.mark.parametrize(
    ("form", "number", "kind"),
    [
        ("parameters", 79, "parameters"),  # a page of zeros was quoted whole
        ("trajectory", 103, "trajectory"),  # a list where the kind of a move belongs
        ("mcap-json", 370, "for model"),  # a topic of thousands of letters
    ],
)
def test_what_was_once_a_fault_is_refused_in_one_line(form, number, kind, tmp_path):
    (tmp_path / "valid").mkdir()
    (tmp_path / "case").mkdir()
    path, _ = Case(form, number).make(FORMS[form](tmp_path / "valid"), tmp_path / "case")
    outcome, said = judged(kind, path, Opened("", 0, frozenset()))
    assert outcome is Outcome.REFUSED, said
    assert path.name in said


def test_the_published_page_is_that_of_the_published_run():
    result = json.loads((ROOT / "docs/faults.json").read_text(encoding="utf-8"))
    text = (ROOT / "docs/reliability.md").read_text(encoding="utf-8")
    assert page.section(result) in text
    assert page.with_section(text, result) == text
    assert (ROOT / "benchmarks/notes/faults.md").read_text(encoding="utf-8") == page.detail(result)
    assert set(result["forms"]) == set(FORMS)
    assert result["files"] == sum(counts["files"] for counts in result["forms"].values())
    assert result["faults"] == []


def test_a_section_takes_the_place_of_an_older_one_and_leaves_the_rest():
    result = page.summary(
        [Row("ulog", 0, "flip_bits", "whole", "", 0.1), Row("gp", 1, "gp_part", "refused", "no", 0.2)]
    )
    text = page.with_section("# Page\n\n## Before\n\nwords\n", result)
    assert text.startswith("# Page\n\n## Before\n\nwords\n\n## Damaged files\n")
    behind = f"{text}\n## Behind\n\nmore\n"
    assert page.with_section(behind, result) == behind
    assert "| all logs | 1 | 1 | 0 |" in text
    assert "| ulog | 1 | 1 | 0 |" in page.detail(result)


def test_seeds_of_the_fuzzer_are_sound_logs_and_small_ones_with_large_appetites(tmp_path):
    seeds.write(tmp_path)
    names = [place.name for place in (tmp_path / "log").iterdir()]
    assert {form for form in LOGS if form not in names} == set()
    assert sum(name.startswith("appetite-") for name in names) > 15
    assert all(any(place.iterdir()) for place in tmp_path.iterdir())
