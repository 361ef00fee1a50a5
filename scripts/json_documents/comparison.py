"""Documents of `compare`, `predict` and `where`."""

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
    """Measured minus predicted, with its sign."""


class Stretch(TypedDict):
    flight: str
    start: float
    stop: float
    rms: Six
    axis: str
    """Of the largest error."""
    tilt_deg: Number
    """Median, as are `force`, `rate` and `speed`."""
    force: Number
    rate: Number
    speed: Number


class ModelErrors(TypedDict):
    name: str
    """`nominal` (the vehicle without effects), the model if it has effects, each `--against`, `<model>+GP`."""
    mean_abs: Six
    """Of the absolute error over all flights, as are `std_abs`, `rms` and `max_abs`."""
    std_abs: Six
    rms: Six
    max_abs: Six
    mean: Six
    """Measured minus predicted, with its sign."""
    fall_of_rms: Six
    """RMS reduction against the nominal model, 1 - after / before."""
    per_flight: list[FlightErrors]
    worst: list[Stretch]
    """Stretches of about 1 s, worst first."""


class FlightMean(TypedDict):
    flight: str
    model: str
    mean: Six
    rms: Six


class Quantity(TypedDict):
    name: str
    unit: str


class PredictionErrors(TypedDict):
    name: str
    """`constant velocity`, then as in `compare`."""
    mae: list[list[Number]]
    """By horizon and quantity: mean of the length of the error."""
    rmse: list[list[Number]]
    limit: list[list[Number]] | None
    """What 95 % of predictions should be off by at most."""
    within: list[list[Number]] | None
    """Share of predictions that are."""


class OpenLoop(TypedDict):
    summary: list[str]
    flights: list[str]
    starts: int
    """Predictions."""
    horizons_s: list[float]
    quantities: list[Quantity]
    models: list[PredictionErrors]
    notes: list[str]


class Comparison(TypedDict):
    axes: list[str]
    flights: list[str]
    models: list[ModelErrors]
    by_flight: list[FlightMean]
    """What `--by-flight` prints."""
    noise: Six
    """Rms of the sensor noise behind the filter: about the rms of a perfect model."""
    unmeasured: list[str]
    """Axes that were not measured (docs/logs.md); in lists of six they are null."""
    samples: int
    cutoff_hz: float
    """Of the filter."""
    ahead: OpenLoop | None
    """As `predict`, of the same models; null where the log has no odometry or is too short."""
    notes: list[str]


class Compare(Document, Comparison):
    pass


class Predict(Document, OpenLoop):
    pass


class Budget(TypedDict):
    mean_square: dict[str, Six]
    """`nominal` and its parts `noise`, `physics` (reduction by the effects), `process`, `unexplained`, which
    add up to it.
    """
    whole_shares: dict[str, Number]
    """Of all axes together."""
    process_source: Literal["fitted", "given", "none"]


class Bins(TypedDict):
    low: list[Number]
    """This and the other lists are over bins."""
    high: list[Number]
    """With `low` in the quantity's unit; null for samples at which the quantity has no meaning, a bin that
    comes last.
    """
    samples: list[int]
    time_share: list[Number]
    """Share of the time."""
    whole_rms: list[Number]
    """All axes on the common scale [N], as are `whole_noise` and `whole_share`."""
    whole_noise: list[Number]
    whole_share: list[Number]
    mean: list[Six]
    """By axis, as are `rms`, `noise` and `share`."""
    rms: list[Six]
    noise: list[Six]
    share: list[Six]


class Dependence(TypedDict):
    quantity: str
    label: str
    unit: str
    of_mean: Number
    """Share of the mean error, beyond chance."""
    of_size: Number
    """Share of the error's size, beyond chance."""
    axes_mean: Six
    """`of_mean` by axis."""
    p: Number
    """Corrected for all quantities and axes."""
    significant: bool
    axes: list[str]
    """Those significant alone."""
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
    """Rms over the two quantities."""
    torque: list[list[Number]]
    """Rms over the two quantities."""
    mean: list[list[Six]]


class LackingQuantity(TypedDict):
    quantity: str
    reason: str


class LackingInput(TypedDict):
    input: str
    reason: str


class FailureMap(TypedDict):
    quantities: list[Dependence]
    """What the error depends on, ranked."""
    grid: Grid | None
    """Two quantities together."""
    lacking: list[LackingQuantity]


class Autocorrelation(TypedDict):
    axis: str
    lags: list[Number]
    value: list[Number]
    expected: list[Number]
    """Of filtered sensor noise."""
    band: list[Number]
    """Half width of the chance band about it."""
    worst: Number
    """Lag [s] furthest outside."""
    p: Number
    """Chance of that in noise, for all lags together."""
    white: bool
    """Filtered sensor noise would look like it."""


class Peak(TypedDict):
    axis: str
    input: str
    band: Number
    """Half width that unrelated series exceed once in a hundred logs, anywhere."""
    lag: Number
    """At which the correlation is largest [s]."""
    peak: Number
    """The correlation there."""
    p: Number
    outside: bool


class Correlation(Peak):
    lags: list[Number]
    """Positive: the residual follows the input."""
    value: list[Number]


class Whiteness(TypedDict):
    autocorrelation: list[Autocorrelation]
    strongest: list[Correlation]
    """The strongest cross-correlation of each axis, with its curve."""
    peaks: list[Peak]
    """All pairs, without curves."""


class InputGroup(TypedDict):
    name: str
    label: str
    columns: list[str]
    alone: Number
    """Share that it explains alone."""
    lost: Number
    """Share that is lost when it is left out."""
    alone_axes: Six
    lost_axes: Six
    significance: Number
    """Paired t of `lost`."""
    step: int
    """At which it was chosen; 0 if it was not."""
    chosen: bool


class Relevance(TypedDict):
    groups: list[InputGroup]
    explained: Number
    """By the chosen groups together."""
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
