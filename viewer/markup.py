"""HTML for the panels: tables, heat cells, bars. What comes from outside is escaped here; sizes fit a control panel."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

BOX = "padding:0 10px 8px 10px;font-size:12px;line-height:1.35"
HEAT = ((255, 255, 255), (255, 233, 190), (250, 160, 90), (214, 60, 50), (110, 10, 40))
"""Colours from nothing to the most, evenly spaced."""
COLD = ((255, 255, 255), (205, 226, 243), (120, 175, 220), (50, 110, 180), (15, 45, 110))
"""The same for what is negative."""


def text(value: object) -> str:
    """Plain text, safe inside HTML and its attributes."""
    return html.escape(str(value), quote=True)


def box(*parts: str) -> str:
    """Parts below each other with the panel's margins and letters."""
    return f'<div style="{BOX}">{"".join(parts)}</div>'


def paragraph(content: str, *, colour: str = "inherit", bold: bool = False) -> str:
    """A paragraph; `content` is HTML."""
    return f'<p style="margin:4px 0;color:{colour};font-weight:{600 if bold else 400}">{content}</p>'


def heading(content: str) -> str:
    """A small heading; `content` is HTML."""
    return f'<div style="margin:10px 0 3px 0;font-weight:600">{content}</div>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1, lead: Sequence[str] = ()) -> str:
    """A table; cells are HTML, the first `left` columns lean left and may wrap. `lead` are styles of the rows."""

    def line(cells: Sequence[str], tag: str, style: str) -> str:
        out = "".join(
            f'<{tag} style="padding:2px 3px;font-weight:inherit;'
            f"{'text-align:left' if k < left else 'text-align:right;white-space:nowrap'};"
            f'border-bottom:1px solid rgba(128,128,128,0.25);vertical-align:top">{cell}</{tag}>'
            for k, cell in enumerate(cells)
        )
        return f'<tr style="{style}">{out}</tr>'

    styles = lead or [""] * len(rows)
    body = "".join(line(row, "td", style) for row, style in zip(rows, styles, strict=True))
    title = line(head, "th", "font-weight:600;color:#666") if any(head) else ""
    return f'<table style="border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums">{title}{body}</table>'


def heat(share: float) -> tuple[str, str]:
    """Background and letters (CSS colours) for 0 (nothing) to 1 (the most), or to -1."""
    scale = HEAT if share >= 0.0 else COLD
    at = min(abs(float(share)), 1.0) * (len(scale) - 1)
    k = min(int(at), len(scale) - 2)
    low, high = np.array(scale[k]), np.array(scale[k + 1])
    red, green, blue = (int(c) for c in np.round(low + (at - k) * (high - low)))
    dark = 0.3 * red + 0.6 * green + 0.1 * blue < 150
    return f"rgb({red},{green},{blue})", "#fff" if dark else "#222"


def bar(parts: Sequence[tuple[float, str, str]], *, height: int = 12) -> str:
    """Parts of a whole beside each other: (share of the full width, colour, what it is, as HTML)."""
    pieces = "".join(
        f'<span title="{words}" style="display:inline-block;height:{height}px;width:{100 * share:.2f}%;'
        f'background:{colour}"></span>'
        for share, colour, words in parts
        if share > 0.0
    )
    back = "background:rgba(128,128,128,0.12)"
    return f'<div style="width:100%;{back};white-space:nowrap;font-size:0;line-height:0">{pieces}</div>'


def wide(pixels: int) -> str:
    """An empty head that keeps a column at least so wide."""
    return f'<span style="display:inline-block;width:{pixels}px"></span>'


def swatch(colour: str, words: str) -> str:
    """An entry of a legend."""
    square = f'<span style="display:inline-block;width:9px;height:9px;background:{colour};margin-right:3px"></span>'
    return f'<span style="margin-right:10px;white-space:nowrap">{square}{text(words)}</span>'


def number(value: float, digits: int = 3) -> str:
    """So many significant digits, without an exponent where a reader expects none."""
    if not np.isfinite(value):
        return "-"
    if value == 0.0:
        return "0"
    decimals = digits - 1 - int(np.floor(np.log10(abs(value))))
    return f"{value:.{decimals}f}" if 0 <= decimals <= 6 else f"{value:.{digits}g}"


def percent(share: float) -> str:
    """A share in per cent, as HTML; one decimal where it is small."""
    return f"{100 * share:.0f}&nbsp;%" if abs(share) >= 0.095 or share == 0 else f"{100 * share:.1f}&nbsp;%"
