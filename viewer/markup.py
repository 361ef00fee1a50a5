"""HTML of the panels, from `templates/`, which escape all text; sizes fit a control panel."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader

from wrenchgap._escaping import html_templates

TEMPLATES = Path(__file__).parent / "templates"


def render(template: str, **values: Any) -> str:
    """HTML of a template; a missing value is an error."""
    return environment().get_template(f"{template}.html").render(**values)


def sentences(*lines: str, look: str = "", under: str = "") -> str:
    """Sentences as HTML, folded away `under` a heading; the page shows no Markdown, where viser takes HTML in a name
    for its own.
    """  # noqa: D205
    return render("sentences", lines=lines, look=look, under=under)


def style() -> str:
    """The style sheet of all of them, as HTML."""
    return f"<style>{(TEMPLATES / 'page.css').read_text(encoding='utf-8')}</style>"


def banner(warnings: Sequence[str]) -> str:
    """The warnings of the checks of a flight, for the top of the page; empty without any."""
    return render("banner", warnings=list(warnings)) if warnings else ""


@cache
def environment(*folders: Path) -> Environment:
    """Templates of some folders, and those of the viewer."""
    return html_templates(FileSystemLoader([*folders, TEMPLATES]))
