"""Archives of plain numbers, as numpy writes them, in files that somebody else may have made: no code, no surprise."""

import lzma
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST = 2**28
"""Bytes of all parts together: a few bytes of a zip may unfold to any number. 1,000 points and six outputs of a process
are 50 MB, the evidence of all effects on six axes is 13 MB."""
DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, tokenize.TokenError),
    *(EOFError, ValueError, RuntimeError, OverflowError, SyntaxError, MemoryError, OSError),
)
"""What zipfile, numpy and json raise of a file that is none."""


def check_sizes(archive: zipfile.ZipFile, parts: dict[str, int]) -> None:
    """Raise ValueError where all parts claim more than `LARGEST`, one more than it may, or one comes twice."""
    sizes = {part.filename: part.file_size for part in archive.infolist()}
    if len(sizes) < len(archive.infolist()):
        raise ValueError("a part comes twice")
    if sum(sizes.values()) > LARGEST:
        raise ValueError(f"its parts claim {sum(sizes.values())} bytes")
    for name, most in parts.items():
        if sizes.get(name, 0) > most:
            raise ValueError(f"{name} claims {sizes[name]} bytes")


def numbers(
    archive: zipfile.ZipFile, name: str, kinds: Sequence[str] = ("<f8",), largest: float = 1e100
) -> NDArray[Any]:
    """The array of a part, of one of these types: an object would be a pickle, which is code. Raises ValueError.

    No stored number is above `largest`: products of two must not overflow.
    """
    try:
        found = np.load(BytesIO(archive.read(name)), allow_pickle=False)
    except (ValueError, TypeError) as error:  # a header whose keys cannot be sorted, say
        raise ValueError(f"{name} holds objects" if "pickle" in str(error) else f"{name}: {line(error)}") from None
    if not isinstance(found, np.ndarray) or all(found.dtype != np.dtype(kind) for kind in kinds):
        raise ValueError(
            f"{name} holds no numbers in {'double precision' if kinds == ('<f8',) else ' or '.join(kinds)}"
        )
    if found.dtype.kind == "f" and np.abs(found).max(initial=0.0) > largest:
        raise ValueError(f"{name} holds numbers above {largest:g}")
    return found


def line(error: Exception) -> str:
    """What an error says, in one line."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 120 else f"{text[:120]}..."
