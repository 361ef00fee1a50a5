"""The one family of errors that a user may meet.

Every message says what is wrong, where, what was found and expected, and what to do. The command line prints it as
one line and exits with code 2; a library user catches `WrenchgapError`.
"""

import difflib
from collections.abc import Iterable
from itertools import islice

from wrenchgap._escaping import printable

LONGEST = 2000
"""Characters of a message: a file may hold a name of a million."""


class WrenchgapError(Exception):
    """Base of everything that wrenchgap raises on purpose: one line of printable text, whatever a file holds."""

    def __init__(self, said: object = "") -> None:
        text, half = printable(" ".join(str(said).split())), LONGEST // 2 - 3
        super().__init__(text if len(text) <= LONGEST else f"{text[:half]} ... {text[-half:]}")


class LogError(WrenchgapError):
    """A log that cannot be read, or lacks what was asked of it."""


class ModelError(WrenchgapError):
    """A model file, vehicle or effect that is not usable as given."""


class FitError(WrenchgapError):
    """Data from which the asked-for quantity cannot be estimated, or a fitted model that does not belong here."""


class UsageError(WrenchgapError):
    """A command or call whose arguments contradict each other."""


def meant(word: str, known: Iterable[str]) -> str:
    """The nearest of the known words as a question with a space before it; empty where none is near."""
    short = [one for one in islice(known, 1000) if len(one) < 100]  # of a file's names, which may be any
    near = difflib.get_close_matches(word[:100], short, 1)
    return f" (did you mean {near[0]!r}?)" if near else ""
