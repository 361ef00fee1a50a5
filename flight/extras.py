"""Packages that one feature alone needs: the extras of pyproject.toml, imported where that feature begins."""

from collections.abc import Iterator
from contextlib import contextmanager

from wrenchgap.flight.errors import UsageError

EXTRAS = {
    **dict.fromkeys(("pandas", "pyarrow"), "tables"),
    **dict.fromkeys(("viser", "websockets", "msgspec", "PIL"), "viewer"),
    **dict.fromkeys(("dask", "distributed", "fsspec", "cryptography"), "batch"),
    "ruptures": "trend",
    "mujoco": "mujoco",
    "pyulog": "px4",
    "google": "protobuf",
}
"""The extra that installs each package, by the name that is imported."""


@contextmanager
def needed_for(what: str, error: type[Exception] = UsageError, extra: str = "") -> Iterator[None]:
    """For imports of an extra's packages: `error` with the command that installs them if one is missing.

    `what` is the subject of the message, as in "PX4 .ulg logs"; `extra` is named in place of the one in `EXTRAS`.
    """
    try:
        yield
    except ImportError as missing:
        name = missing.name or ""
        found = EXTRAS.get(name.partition(".")[0])
        if found is None:
            raise
        raise error(
            f"{what} need {name}, which is not installed; pip install 'wrenchgap[{extra or found}]'"
        ) from missing
