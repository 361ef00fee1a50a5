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
    def brief(self, result: Any) -> str: ...  # noqa: D102
    def by_axis(self, result: Any) -> pd.DataFrame: ...  # noqa: D102
    def by_parameter(self, result: Any) -> pd.DataFrame: ...  # noqa: D102
    def to_frame(self, result: Any) -> pd.DataFrame: ...  # noqa: D102
    def plot(self, result: Any, axes: Any) -> Any: ...  # noqa: D102
    def to_json(self, result: Any) -> dict[str, Any]: ...  # noqa: D102
    def save_page(self, result: Any, path: Path, *, force: bool) -> None: ...  # noqa: D102


class Result:
    """Base of all results: `print(result)`, `result.by_axis()`, `result.to_frame()`, `.plot()`, `.to_json()`."""

    presentation: ClassVar[Presentation]

    def __str__(self) -> str:
        return self.presentation.text(self)

    def __repr__(self) -> str:
        return self.presentation.brief(self)

    def by_axis(self) -> pd.DataFrame:
        """What it has of each axis of the wrench, by name: `found.by_axis().loc["torque_z", "rms_after"]`.

        Rows are `wrenchgap.flight.AXES`, nan where nothing was measured; `unit` is the first column. Raises UsageError
        for a result that has no such numbers.
        """
        return self.presentation.by_axis(self)

    def by_parameter(self) -> pd.DataFrame:
        """Fitted parameters by effect and name, in SI: `found.by_parameter().loc[("com_offset", "x"), "value"]`.

        Raises UsageError for a result that fits none.
        """
        return self.presentation.by_parameter(self)

    def to_frame(self) -> pd.DataFrame:
        """The numbers as a table of pandas; docs/api.md says which rows and columns."""
        return self.presentation.to_frame(self)

    def plot(self, axes: Any = None) -> Any:
        """Draw it with matplotlib, into `axes` where they are given; returns the axes."""
        return self.presentation.plot(self, axes)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, strings, lists and dicts, with the keys of docs/json.md."""
        return self.presentation.to_json(self)
