"""Pages that the site makes: every command and public name has an entry, links that leave `docs` are followed."""

import importlib
import logging
from types import SimpleNamespace

import pytest
from mkdocs.structure.pages import Page

from scripts import site_pages
from scripts.json_documents import schemas
from wrenchgap.replay.cli.main import COMMANDS, GROUPS


def test_every_command_has_an_entry():
    page = site_pages.commands()
    names = [c.__name__ for c in COMMANDS] + [f"{g} {c.__name__}" for g, (_, below) in GROUPS.items() for c in below]
    assert [name for name in names if f"## wrenchgap {name}\n" not in page] == []
    assert "`--validate`" in page


@pytest.mark.parametrize("command", schemas())
def test_every_key_of_a_result_has_a_row(command):
    page = site_pages.made()[f"reference/schemas/{command}.md"]
    assert [key for key in schemas()[command]["properties"] if f"\n| `{key}` | " not in page] == []
    assert page.count("| any |") <= 1  # the settings of learn and replay


def test_keys_are_shown_with_their_path_type_and_meaning():
    rows = site_pages.keys("explain").splitlines()
    assert "| `members[].rivals[].alike` | boolean | It is of the same group. |" in rows
    assert "| `rms_after` | list of 6: number or null | On held-out time. |" in rows
    assert "| `left.swing.frame` | `E`, `B` or null | In which the mode is fixed; null: neither. |" in rows
    assert "| `timing` | list: as [inspect](inspect.md) | |" in rows


@pytest.mark.parametrize("package", ["", ".flight", ".plant", ".learn", ".compensate", ".viewer"])
def test_every_public_name_has_an_entry(package):
    page = site_pages.made()[f"reference/api/wrenchgap{package}.md"]
    offered = importlib.import_module(f"wrenchgap{package}").__all__
    assert [name for name in offered if f"heading: {name}\n" not in page and f"## {name}\n" not in page] == []


def test_a_name_that_two_packages_offer_has_one_entry():
    pages = [text for name, text in site_pages.made().items() if name.startswith("reference/api/")]
    assert sum(text.count("::: wrenchgap.flight.errors.ModelError\n") for text in pages) == 1


def page_at(place: str) -> Page:
    return SimpleNamespace(file=SimpleNamespace(src_uri=place))  # type: ignore[return-value]


def test_links_that_leave_docs_lead_to_pages_of_the_site():
    text = "[a](../../plant/effects/tether.py) [b](../notation.md#units) [c](../../CONTRIBUTING.md#add-an-effect)"
    shown = site_pages.on_page_markdown(text, page_at("effects/tether.md"), None, None)
    assert shown == (
        "[a](../source/plant/effects/tether.py.md) [b](../notation.md#units) [c](../CONTRIBUTING.md#add-an-effect)"
    )
    text = "[d](docs/notation.md) [e](docs/effects/your-own.md#what)"
    shown = site_pages.on_page_markdown(text, page_at("CONTRIBUTING.md"), None, None)
    assert shown == "[d](notation.md) [e](effects/your-own.md#what)"


def test_a_link_to_a_file_that_is_gone_is_a_warning(caplog):
    with caplog.at_level(logging.WARNING):
        site_pages.on_page_markdown("[a](../plant/gone.py)", page_at("design.md"), None, None)
    assert "no such file" in caplog.text


def test_equations_become_mathml():
    shown = site_pages.math("F = m a\n\nM = p \\times F", "math", "math", {}, None)
    assert shown.count("<math") == 2
    assert "&#x000D7;" in shown
