"""Parts that the documents of several commands share.

A number is None where it was not finite; `NotRequired` is a key that only some options bring.
"""

from __future__ import annotations

from typing import Annotated, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

Number = float | None
Three = Annotated[list[Number], Field(min_length=3, max_length=3)]
Six = Annotated[list[Number], Field(min_length=6, max_length=6)]
Level = Literal["ok", "warn", "bad"]


class Input(TypedDict):
    role: str
    file: str
    sha256: str
    shift_s: NotRequired[dict[str, float]]
    vehicle: NotRequired[str | None]


class Check(TypedDict):
    flight: NotRequired[str]
    name: str
    level: Level
    words: str
    mend: str | None
    accepted: bool


class LeftOut(TypedDict):
    flight: NotRequired[str]
    start: Number
    stop: Number
    why: str


class Head(TypedDict):
    schema: str
    version: str
    inputs: list[Input]
    notes: NotRequired[list[str]]
    checks: NotRequired[list[Check]]


class Document(Head):
    left_out: NotRequired[list[LeftOut]]


class Value(TypedDict):
    name: str
    value: Number
    std: NotRequired[Number]
    unit: str


class Fitted(TypedDict):
    effect: str
    parameters: list[Value]


class HeldOut(TypedDict):
    rms_before: Six
    rms_after: Six
    noise: Six
    fall: Six
    verdict: str
    outcome: Literal["better", "worse", "unclear"]
    change: Number
    t: Number


class Loop(TypedDict):
    lag_s: float
    delay_s: float
    gains: NotRequired[str]


class Observer(TypedDict):
    hz: Number
    lag_s: Number
    sensitivity_peak: Number
    left: Number
    loop: Loop
    summary: str


class Absorbed(TypedDict):
    effect: str
    cosine: Number
    share: Number
    significance: Number
    named: bool
    parameters: list[Value]


class Absorption(TypedDict):
    effects: list[str]
    summary: str
    tried: list[Absorbed]


class Untried(TypedDict):
    effect: str
    lack: str
    reason: str


class Part(TypedDict):
    name: str
    seconds: Number
    std: Number


class Offset(TypedDict):
    first: str
    second: str
    seconds: Number
    std: Number
    drift: Number
    drift_std: Number
    coherence: Number
    lowest_hz: Number
    highest_hz: Number
    interval_95: Number
    halves: list[Part]
    axes: list[Part]
    bands: list[Part]
    blocks: int
    problem: str | None


class SensorOffset(Offset):
    effect_error: Number


class Response(Offset):
    axis: str
    shape: Literal["delay", "lag", "either"] | None
    lag: Number
    leaves: Number
    residual: Number
    noise: Number
    matters: bool


class Timing(TypedDict):
    sensors: list[SensorOffset]
    tracking: list[Offset]
    controller: Offset | None
    responses: list[Response]
    warnings: list[str]
    words: list[str]
