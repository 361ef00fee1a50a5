"""Document of `write`."""

from __future__ import annotations

from typing_extensions import TypedDict

from scripts.json_documents.parts import Document, Number


class AutopilotParameter(TypedDict):
    name: str
    value: float
    std: float
    before: Number
    """What was set; null where it is not known."""
    nominal: Number
    """By the model without effects."""
    effects: list[str]
    """From which it comes."""


class Write(Document):
    vehicle: str
    target: str
    parameters: list[AutopilotParameter]
    """Empty of simulators."""
    not_in_it: list[str]
    """What the target has no parameter for."""
    text: str
    """Of the file."""
