"""Documents of `compare` and `where`."""

from __future__ import annotations

from typing import Literal

from typing_extensions import TypedDict

from scripts.json_documents.parts import Document, Number, Six


class FlightErrors(TypedDict):
    flight: str
    mean_abs: Six
    std_abs: Six
    rms: Six
    max_abs: Six
    mean: Six


class Stretch(TypedDict):
    flight: str
    start: float
    stop: float
    rms: Six
    axis: str
    tilt_deg: Number
    force: Number
    rate: Number
    speed: Number


class ModelErrors(TypedDict):
    name: str
    mean_abs: Six
    std_abs: Six
    rms: Six
    max_abs: Six
    mean: Six
    fall_of_rms: Six
    per_flight: list[FlightErrors]
    worst: list[Stretch]


class FlightMean(TypedDict):
    flight: str
    model: str
    mean: Six
    rms: Six


class Comparison(TypedDict):
    axes: list[str]
    flights: list[str]
    models: list[ModelErrors]
    by_flight: list[FlightMean]
    noise: Six
    unmeasured: list[str]
    samples: int
    cutoff_hz: float
    notes: list[str]


class Compare(Document, Comparison):
    pass


class Budget(TypedDict):
    mean_square: dict[str, Six]
    whole_shares: dict[str, Number]
    process_source: Literal["fitted", "given", "none"]


class Bins(TypedDict):
    low: list[Number]
    high: list[Number]
    samples: list[int]
    time_share: list[Number]
    whole_rms: list[Number]
    whole_noise: list[Number]
    whole_share: list[Number]
    mean: list[Six]
    rms: list[Six]
    noise: list[Six]
    share: list[Six]


class Dependence(TypedDict):
    quantity: str
    label: str
    unit: str
    of_mean: Number
    of_size: Number
    axes_mean: Six
    p: Number
    significant: bool
    axes: list[str]
    bins: Bins


class Grid(TypedDict):
    x: str
    y: str
    x_label: str
    y_label: str
    x_edges: list[Number]
    y_edges: list[Number]
    samples: list[list[int]]
    force: list[list[Number]]
    torque: list[list[Number]]
    mean: list[list[Six]]


class LackingQuantity(TypedDict):
    quantity: str
    reason: str


class LackingInput(TypedDict):
    input: str
    reason: str


class FailureMap(TypedDict):
    quantities: list[Dependence]
    grid: Grid | None
    lacking: list[LackingQuantity]


class Autocorrelation(TypedDict):
    axis: str
    lags: list[Number]
    value: list[Number]
    expected: list[Number]
    band: list[Number]
    worst: Number
    p: Number
    white: bool


class Peak(TypedDict):
    axis: str
    input: str
    band: Number
    lag: Number
    peak: Number
    p: Number
    outside: bool


class Correlation(Peak):
    lags: list[Number]
    value: list[Number]


class Whiteness(TypedDict):
    autocorrelation: list[Autocorrelation]
    strongest: list[Correlation]
    peaks: list[Peak]


class InputGroup(TypedDict):
    name: str
    label: str
    columns: list[str]
    alone: Number
    lost: Number
    alone_axes: Six
    lost_axes: Six
    significance: Number
    step: int
    chosen: bool


class Relevance(TypedDict):
    groups: list[InputGroup]
    explained: Number
    explained_axes: Six
    lacking: list[LackingInput]


class WhereBody(TypedDict):
    axes: list[str]
    model: str
    flights: list[str]
    seconds: float
    samples: int
    cutoff_hz: float
    rms: Six
    noise: Six
    unmeasured: list[str]
    budget: Budget
    failure_map: FailureMap
    whiteness: Whiteness
    relevance: Relevance
    worst: list[Stretch]
    summary: list[str]
    notes: list[str]


class Where(Document, WhereBody):
    pass
