"""Documents of `write`, `effectiveness` and `ready`."""

from __future__ import annotations

from typing import Literal

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


class AllocationMargins(TypedDict):
    demands: int
    """That the vehicle can make: from hover to the end of its reach, in directions of chance."""
    null_space: int
    """Its dimension: unknowns that are free once a wrench is made."""
    largest_margin: float
    """Mean of the smallest margin of a rotor, as a share of half its range (of its thrust where the arm tilts)."""
    pseudo_inverse: float
    pseudo_inverse_beyond: float
    """Share of the demands that the pseudo-inverse cannot make within the limits."""


class AllocationLeft(TypedDict):
    nominal: list[float]
    """What the model makes beyond demands of careful flight, rms of force [N] and torque [Nm]."""
    corrected: list[float]


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
    left: AllocationLeft | None
    """Of the nominal and the corrected allocation; null as `margins`."""
    margins: AllocationMargins | None
    """Of the allocation with the largest margin; null for a vehicle that cannot hover as flown."""
    folder: str | None
    """Where the allocation was written."""


class Authority(TypedDict):
    part: str
    used: str
    """`thrust`, `tilt` or `tilt rate`."""
    needs: list[float]
    """Share of what the part has: 5th, 50th and 95th percentile."""
    nominal: float
    probability: float
    """That it needs no more than 0.9 of it."""


class LoopMargins(TypedDict):
    axis: str
    nominal: list[Number]
    """Phase [deg] and gain [dB]; null where there is none."""
    phase: list[Number]
    """5th, 50th and 95th percentile [deg]."""
    gain: list[Number]
    """The same [dB]."""
    probability: float
    """That both are large enough."""
    half: float
    """That half of them is left."""
    factor: Number
    """By which to multiply the gains; null where less gain does not help."""


class Beyond(TypedDict):
    quantity: str
    unit: str
    maximum: float
    """On the flights."""
    percentile: float
    """Largest along the trajectory."""


class Uncertain(TypedDict):
    effect: str
    parameter: str
    value: float
    std: float
    share: float
    """Of the scatter of what the weakest part needs."""


class Contradiction(TypedDict):
    effect: str
    parameter: str
    change: float
    """What the flights show, less what the model has."""
    std: float
    unit: str


class WeakRotor(TypedDict):
    rotor: str
    lost: float
    """Share of its thrust."""


class Ready(Document):
    summary: list[str]
    vehicle: str
    decision: Literal["go", "go with care", "no go"]
    trajectory: str
    duration: float
    """[s]"""
    payload: float
    """[kg]"""
    wind: float
    """[m/s]"""
    feels_wind: bool
    """Whether the model has a drag."""
    voltage: Number
    """[V]; null where it was not given and the model does not depend on it."""
    feels_voltage: bool
    """Whether the model depends on it."""
    flights: list[str]
    crashed: list[str]
    """Flights that ended in a crash or a loss of control: then it is no go."""
    contradicted: list[Contradiction]
    """Delays and thrusts of rotors that the flights show to be others than the model's."""
    weakened: list[WeakRotor]
    """Rotors that the model says have lost a tenth of their thrust, or more; the worst first."""
    authority: list[Authority]
    """The weakest part first."""
    loops: list[LoopMargins]
    """Empty where the gains that flew are not known."""
    gains: Literal["model", "PX4", "PX4, no lag in the model", "ArduPilot", "ArduPilot, no lag in the model", "unknown"]
    """Whose gains flew: those of the model file, or of the autopilot's parameters, then upper bounds without a lag."""
    beyond: list[Beyond]
    """In what the trajectory goes further than the flights."""
    first: list[Uncertain]
    """What to check on the bench, that on which most depends first."""
    known: bool
    """Whether any value of the model has a standard deviation."""
    below: float
    """Share of the draws in which a rotor would have to push less than it can: no part has authority there."""
    analysed: float
    """Of flight [s]."""
    unseen: float
    """Share of the scatter of the weakest part that goes with a constant disturbance, which so much flight does not
    tell from slow gusts."""
    designed_for: str
    """The vehicle that a file of `design` names; empty for the name of a trajectory."""
    notes: list[str]
