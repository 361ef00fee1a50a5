"""What every analysis returns: frozen data that know how to print, tabulate and draw themselves.

A result holds numbers, enums and typed reasons. How these read is decided in one package, `wrenchgap.replay.present`,
which lies far above; a result asks it by name, and only when somebody prints, tabulates or draws.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

PRESENTATION = "wrenchgap.replay.present"


class Result:
    """Base of all results: `print(result)`, `result.to_frame()`, `result.plot()`, `result.to_json()`."""

    def __str__(self) -> str:
        return str(_presentation().text(self))

    __repr__ = __str__

    def to_frame(self) -> pd.DataFrame:
        """The numbers as a table of pandas; docs/api.md says which rows and columns."""
        found: pd.DataFrame = _presentation().to_frame(self)
        return found

    def plot(self, axes: Any = None) -> Any:
        """Draw it with matplotlib, into `axes` where they are given; returns the axes."""
        return _presentation().plot(self, axes)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, strings, lists and dicts, with the keys of docs/json.md."""
        found: dict[str, Any] = _presentation().to_json(self)
        return found


def _presentation() -> Any:
    return import_module(PRESENTATION)
