"""What every analysis returns: frozen data that know how to print, tabulate and draw themselves.

A result holds numbers, enums and typed reasons. How these read is decided far above, in `wrenchgap.replay.present`,
which `import wrenchgap` registers here as `Result.presentation`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Protocol

if TYPE_CHECKING:
    from pathlib import Path

    import pandas as pd


class Presentation(Protocol):
    """How results of every class read; `wrenchgap.replay.present` is one."""

    def text(self, result: Any) -> str: ...  # noqa: D102
    def to_frame(self, result: Any) -> pd.DataFrame: ...  # noqa: D102
    def plot(self, result: Any, axes: Any) -> Any: ...  # noqa: D102
    def to_json(self, result: Any) -> dict[str, Any]: ...  # noqa: D102
    def save_page(self, result: Any, path: Path, *, force: bool) -> None: ...  # noqa: D102


class Result:
    """Base of all results: `print(result)`, `result.to_frame()`, `result.plot()`, `result.to_json()`."""

    presentation: ClassVar[Presentation]

    def __str__(self) -> str:
        return self.presentation.text(self)

    __repr__ = __str__

    def to_frame(self) -> pd.DataFrame:
        """The numbers as a table of pandas; docs/api.md says which rows and columns."""
        return self.presentation.to_frame(self)

    def plot(self, axes: Any = None) -> Any:
        """Draw it with matplotlib, into `axes` where they are given; returns the axes."""
        return self.presentation.plot(self, axes)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, strings, lists and dicts, with the keys of docs/json.md."""
        return self.presentation.to_json(self)
