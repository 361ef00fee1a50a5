"""HTML elements as functions. Text is escaped wherever it enters; only what these functions made is taken as it is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any


class Html(str):
    """HTML that is safe as it stands."""

    __slots__ = ()


Child = str | None | Iterable["Child"]

VOID = ("img", "meta", "br", "hr")


def text(value: Any) -> Html:
    """Any value as text."""
    return value if isinstance(value, Html) else Html(escape(str(value), quote=True))


def join(children: Iterable[Child]) -> Html:
    """Children one after the other; None is left out."""
    return Html("".join(_flat(children)))


def _flat(children: Iterable[Child]) -> Iterable[str]:
    for child in children:
        if child is None:
            continue
        if isinstance(child, str):
            yield text(child)
        else:
            yield from _flat(child)


def element(name: str, /, *children: Child, **attributes: str | None) -> Html:
    """`<name attribute="value">children</name>`; a trailing underscore of an attribute's name is dropped."""
    written = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(str(value), quote=True)}"'
        for key, value in attributes.items()
        if value is not None
    )
    head = Html(f"<{name}{written}>")
    return head if name in VOID else Html(f"{head}{join(children)}</{name}>")


def paragraph(*children: Child, class_: str | None = None) -> Html:
    """A paragraph."""
    return element("p", *children, class_=class_)


def code(value: str) -> Html:
    """A piece of code in a line."""
    return element("code", value)


def block(value: str) -> Html:
    """Several lines of code."""
    return element("pre", element("code", value))


def items(values: Iterable[Child]) -> Html:
    """A list of points."""
    return element("ul", [element("li", value) for value in values])


def table(
    heads: Sequence[Child],
    rows: Sequence[Sequence[Child]],
    *,
    left: int = 1,
    texts: Sequence[int] = (),
    caption: str = "",
) -> Html:
    """A table; the first `left` columns and those of `texts` are texts, the others numbers."""

    def kind(column: int) -> str | None:
        return None if column < left or column in texts else "number"

    head = element("tr", [element("th", h, scope="col", class_=kind(k)) for k, h in enumerate(heads)])
    body = [element("tr", [element("td", v, class_=kind(k)) for k, v in enumerate(row)]) for row in rows]
    made = element(
        "table", element("caption", caption) if caption else None, element("thead", head), element("tbody", body)
    )
    return element("div", made, class_="wide")


def section(title: str, *children: Child, anchor: str) -> Html:
    """A part of the page with a heading."""
    return element("section", element("h2", title), *children, id=anchor)


def details(title: str, *children: Child) -> Html:
    """Something to unfold; open on paper."""
    return element("details", element("summary", title), *children)
