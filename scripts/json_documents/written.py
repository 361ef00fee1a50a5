"""Documents of `write` and `effectiveness`."""

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


class Effectiveness(Document):
    vehicle: str
    tilt: list[float]
    """Of the arms [rad]."""
    axes: list[str]
    """Rows of `matrix`, about the centre of mass."""
    rotors: list[str]
    """Columns of `matrix`."""
    effects: list[str]
    """That change it."""
    left_out: list[str]
    """Effects with a value at its limit."""
    matrix: list[list[float]]
    """As flown, per newton of nominal thrust [1, m]."""
    matrix_std: list[list[float]]
    nominal: list[list[float]]
    achieved: list[list[float]]
    """Column k: the wrench that comes when the nominal allocation is asked for one unit of axis k."""
    achieved_std: list[list[float]]
    asked: list[str]
    """Rows of `allocation`: rotors, of those that tilt their thrust along and across its direction at rest."""
    allocation: list[list[float]]
    """Nominal thrusts to ask for, for one unit of each axis."""
    nominal_allocation: list[list[float]]
