"""Offsets between the topics of a log: as sentences, as a table, as JSON, and what to do about them.

Reported before any physics, and never acted on: whether an offset is a clock, a link or an actuator is for the user to
say (`--shift`) or for `explain` to weigh (`command_delay`, `servo_lag`, `motor_lag`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.markup import escape
from rich.table import Table

from wrenchgap.flight.derivative import angular_velocity, smooth
from wrenchgap.flight.flight import Flight, OdometrySeries
from wrenchgap.flight.offsets import (
    EVERYWHERE,
    Intervals,
    Offset,
    Part,
    controller_offset,
    sensor_offsets,
    tracking_offsets,
)
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.response import FEEDBACK, Response, responses
from wrenchgap.plant.model import Model
from wrenchgap.replay.present.tables import table

Array = NDArray[np.float64]

MATTERS = 0.05
"""Error of an effect that reads the odometry at which an offset is worth a warning: half of the 10 % to which
parameters are wanted. A velocity that is late by d is off by d times the acceleration, relative to the speed; a force
that is fixed in E, turned by an attitude that is late, is off by d times the rate."""
DRIFTS = 2e-3
"""Change of an offset over a flight that is worth a warning [s]: one sample at 500 Hz."""
UNLIKE = 2e-3
"""Difference between the lags of attitude and velocity beyond which one shift cannot undo both [s]."""
DEAF = 3
"""Axes on which commands mostly answer to the motion, from which on lags and delays are not asked for."""
IDLE_SPEED, IDLE_RATE = 0.05, 0.02
"""Slower motion [m/s, rad/s] drives no effect, and no error of one."""


@dataclass(frozen=True)
class Timing:
    """Offsets of one flight. `sensors` between IMU and odometry, `tracking` of the odometry behind the reference,
    `controller` of the commanded behind the desired wrench, `responses` of the vehicle behind its commands.

    `worth` (one for each of `sensors`) is the error that the offset makes in an effect driven by the odometry, as a
    share of that effect; None where it is not the odometry that is late. `duration` [s].
    """  # noqa: D205

    flight: str
    duration: float
    sensors: tuple[Offset, ...]
    worth: tuple[float | None, ...]
    tracking: tuple[Offset, ...] = ()
    controller: Offset | None = None
    responses: tuple[Response, ...] = ()

    @property
    def offsets(self) -> tuple[Offset, ...]:
        """All offsets, responses last."""
        one = () if self.controller is None else (self.controller,)
        return (*self.sensors, *self.tracking, *one, *(r.offset for r in self.responses))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should act on, each with what to do."""
        return (*self._sensor_warnings(), *self._drift_warnings(), *_response_warnings(self.responses))

    def _sensor_warnings(self) -> list[str]:
        rows = [(o, w) for o, w in zip(self.sensors, self.worth, strict=True) if w is not None and o.certain]
        if not any(w > MATTERS for _, w in rows):
            return []
        weight = np.array([1.0 / max(o.std or 0.0, 1e-6) ** 2 for o, _ in rows])
        seconds = np.array([o.seconds for o, _ in rows], dtype=float)
        mean = float(weight @ seconds / weight.sum())
        found = [
            f"The odometry {'lags' if mean > 0 else 'leads'} the IMU by {1e3 * abs(mean):.1f} ms: effects that are "
            "driven by speed or attitude come out up to "
            f"{100 * max(w for _, w in rows):.0f} % wrong. Read it with --shift odometry={-mean:.4f}."
        ]
        if float(np.ptp(seconds)) > UNLIKE:
            parts = ", ".join(f"{o.second} {1e3 * (o.seconds or 0.0):+.1f} ms" for o, _ in rows)
            found.append(f"Not all of it is late by as much ({parts}): an estimator's filter rather than a clock.")
        return found

    def _drift_warnings(self) -> list[str]:
        found = []
        for o in (*self.sensors, *(r.offset for r in self.responses)):
            if o.drifts and abs(o.drift or 0.0) * self.duration > DRIFTS:
                found.append(
                    f"{o.second} against {o.first}: the offset moves by {_per_minute(o.drift)} +- "
                    f"{_per_minute(o.drift_std, sign=False)} ms/min: two clocks; record both with one."
                )
        return found

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, strings, lists and dicts; seconds."""
        rows = zip(self.sensors, self.worth, strict=True)
        return {
            "sensors": [{**_offset_json(o), "effect_error": w} for o, w in rows],
            "tracking": [_offset_json(o) for o in self.tracking],
            "controller": None if self.controller is None else _offset_json(self.controller),
            "responses": [
                {
                    **_offset_json(r.offset),
                    "axis": r.axis,
                    "shape": r.shape,
                    "lag": r.lag,
                    "leaves": r.leaves,
                    "residual": r.residual,
                    "noise": r.noise,
                    "matters": r.matters,
                }
                for r in self.responses
            ],
            "warnings": list(self.warnings),
            "words": sentences(self),
        }


def timing(flight: Flight, within: Intervals = EVERYWHERE, answers: tuple[Response, ...] = ()) -> Timing:
    """Offsets between the topics of a flight, without knowing the vehicle."""
    sensors = sensor_offsets(flight, within)
    ends = [(s.time[0], s.time[-1]) for s in flight.series().values()]
    duration = float(max(b for _, b in ends) - min(a for a, _ in ends)) if ends else 0.0
    worth = tuple(_worth(o, flight.odometry) if flight.imu is not None else None for o in sensors)
    return Timing(
        flight.name,
        duration,
        sensors,
        worth,
        tracking_offsets(flight, within),
        controller_offset(flight, within),
        answers,
    )


def timing_of(opened: OpenFlight, model: Model) -> Timing:
    """Offsets between the topics of a flight while it is in the air, and of the response behind its commands."""
    flown = [(float(r.time[0]), float(r.time[-1])) for r in opened.records]
    return timing(opened.flight, flown, responses(opened.flight, model.vehicle, opened.records))


def _worth(offset: Offset, odometry: OdometrySeries | None) -> float | None:
    """What the offset of odometry behind IMU costs an effect that is driven by the odometry."""
    if odometry is None or offset.seconds is None or offset.same:
        return None
    if offset.first == "gyroscope" and offset.second == "odometry attitude":
        return abs(offset.seconds) * _rate(odometry)
    if offset.first == "accelerometer" and odometry.velocity_E is not None:
        speed = _rms(odometry.velocity_E)
        change = _rms(smooth(odometry.time, odometry.velocity_E, derivative=1))
        return abs(offset.seconds) * change / speed if speed > IDLE_SPEED else 0.0
    return None


def _rate(odometry: OdometrySeries) -> float:
    """Rms rate of the attitude [rad/s], zero where it hardly moves."""
    rate = _rms(angular_velocity(odometry.time, odometry.quat_EB))
    return rate if rate > IDLE_RATE else 0.0


def _rms(vectors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


LAGS = ("servo_lag", "motor_lag", "command_delay", "backlash")
"""Effects that show in when, not in how much: where commands answer to the motion they cannot be told from that."""


def barred(timings: Sequence[Timing]) -> dict[str, str]:
    """Effects of time that these flights must not be asked about, with the reason; none where one flight is sound."""
    reasons = []
    for found in timings:
        deaf = [r.axis for r in found.responses if r.offset.problem == FEEDBACK]
        if len(deaf) < DEAF:
            return {}
        reasons.append(f"{found.flight}: on {', '.join(deaf)} {FEEDBACK}; a lag found there would be the controller's")
    return dict.fromkeys(LAGS, reasons[0]) if reasons else {}


def _response_warnings(found: Sequence[Response]) -> list[str]:
    out = []
    late = [r for r in found if r.matters]
    if late:
        listed = ", ".join(f"{r.axis} {_milliseconds(r.offset)} ms ({_forms(r)})" for r in late)
        out.append(
            f"Commands take effect late: {listed}. Not removed: it may be servo_lag, motor_lag, command_delay or the "
            "clocks of commands and IMU, and `explain` weighs the first three."
        )
    deaf = [r.axis for r in found if r.offset.problem == FEEDBACK]
    if deaf:
        out.append(
            f"On {', '.join(deaf)} the commands mostly answer to the motion: neither lag nor delay can be seen there, "
            "and one that is fitted there would be the controller's own phase. Fly with more excitation."
        )
    return out


def _forms(response: Response) -> str:
    return {"delay": "a delay", "lag": "a lag", "either": "a lag or a delay"}[response.shape or "either"]


def sentences(found: Timing) -> list[str]:
    """Every offset in words."""
    return [sentence(o) for o in found.offsets]


def sentence(offset: Offset) -> str:
    """One offset in words, e.g. "odometry attitude lags gyroscope by 12.3 +- 0.4 ms"."""
    if offset.seconds is None:
        return f"{offset.second} against {offset.first}: cannot be estimated: {offset.problem}"
    if offset.same:
        return f"{offset.second} and {offset.first} are the same series"
    if not offset.certain:
        return f"{offset.second} and {offset.first} go together: {_milliseconds(offset)} ms"
    verb = "lags" if offset.seconds > 0 else "leads"
    return f"{offset.second} {verb} {offset.first} by {_milliseconds(offset, absolute=True)} ms"


def _milliseconds(offset: Offset, absolute: bool = False) -> str:
    """Value and standard deviation in ms, both with the digits that the latter allows."""
    assert offset.seconds is not None
    assert offset.std is not None
    digits = int(np.clip(np.ceil(-np.log10(max(1e3 * offset.std, 1e-3)) + 0.3), 0, 2))
    value = abs(offset.seconds) if absolute else offset.seconds
    return f"{1e3 * value:.{digits}f} +- {1e3 * max(offset.std, 0.5e-3 * 10.0**-digits):.{digits}f}"


def _per_minute(slope: float | None, sign: bool = True) -> str:
    return f"{6e4 * (slope or 0.0):{'+' if sign else ''}.2g}"


def offsets_table(found: Timing) -> Table:
    """All offsets, one a row; what cannot be estimated is listed below by `problems`."""
    heads = ("", "behind", "by [ms]", "drift [ms/min]", "heard at [Hz]", "form", "worth")
    out = table(f"timing of {found.flight}", *heads, left=2)
    worth = dict(zip(map(id, found.sensors), found.worth, strict=True))
    forms = {id(r.offset): r for r in found.responses}
    for o in found.offsets:
        if o.seconds is None:
            continue
        response = forms.get(id(o))
        out.add_row(
            escape(o.second),
            escape(o.first),
            "same series" if o.same else _milliseconds(o),
            "-" if o.drift is None or o.same else f"{_per_minute(o.drift)} +- {_per_minute(o.drift_std, sign=False)}",
            f"{o.lowest_hz:.1f}-{o.highest_hz:.1f}",
            "-"
            if response is None
            else "either"
            if response.shape == "either"
            else _forms(response).removeprefix("a "),
            _worth_words(worth.get(id(o)), response),
            style="" if o.certain else "dim",
        )
    return out


def _worth_words(worth: float | None, response: Response | None) -> str:
    if worth is not None:
        return f"{100 * worth:.1f} %"
    if response is not None and response.leaves is not None and response.noise:
        return f"{response.leaves / response.noise:.0f} x noise"
    return "-"


LEGEND = (
    "behind by: positive where it is stamped later   form: what a response that is late looks like   worth: error of "
    "effects that are driven by the odometry; error that a model without the lag is left with"
)


def problems(found: Timing) -> list[str]:
    """What cannot be estimated, by reason."""
    reasons: dict[str, list[str]] = {}
    for o in found.offsets:
        if o.problem:
            same = o.second.removeprefix("measured ") == o.first.removeprefix("commanded ")
            reasons.setdefault(o.problem, []).append(
                f"response on {o.second.removeprefix('measured ')}" if same else f"{o.second} against {o.first}"
            )
    return [f"{', '.join(names)}: {reason}" for reason, names in reasons.items()]


def _offset_json(offset: Offset) -> dict[str, Any]:
    def parts(listed: Sequence[Part]) -> list[dict[str, Any]]:
        return [{"name": p.name, "seconds": p.seconds, "std": p.std} for p in listed]

    return {
        "first": offset.first,
        "second": offset.second,
        "seconds": offset.seconds,
        "std": offset.std,
        "interval_95": offset.interval,
        "drift": offset.drift,
        "drift_std": offset.drift_std,
        "halves": parts(offset.halves),
        "axes": parts(offset.axes),
        "bands": parts(offset.bands),
        "coherence": offset.coherence,
        "lowest_hz": offset.lowest_hz,
        "highest_hz": offset.highest_hz,
        "blocks": offset.blocks,
        "problem": offset.problem,
    }
