"""What the templates are given: images and files to save. Texts are escaped by the templates, never here."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass

from wrenchgap.replay.present.figures import style


@dataclass(frozen=True)
class Image:
    """A chart inside the page, a text for those who do not see it, and a caption."""

    src: str
    alt: str
    caption: str

    @classmethod
    def of(cls, picture: style.Picture, alt: str, caption: str, form: str = "png") -> Image:
        """A picture; a dense one as PNG, a sparse one as SVG, which stays sharp on paper."""
        stream = io.BytesIO()
        style.figure_of(picture).savefig(
            stream, format=form, dpi=110, metadata={"Date": None} if form == "svg" else None
        )
        kind = "svg+xml" if form == "svg" else form
        return cls(data_uri(stream.getvalue(), f"image/{kind}"), alt, caption)


@dataclass(frozen=True)
class Saved:
    """A text that the page shows and lets a reader save as a file."""

    name: str
    text: str

    @property
    def href(self) -> str:
        """The file inside a link."""
        return data_uri(self.text.encode(), "application/toml")


def data_uri(content: bytes, kind: str) -> str:
    """Content as an address that fetches nothing."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
