"""Whether flights that are compared are of one vehicle, and their commands logged in one form."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.autopilot import other_vehicle
from wrenchgap.flight.errors import LogError
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.plant.model import Model


@dataclass(frozen=True)
class SameVehicle:
    """From when on two flights are not of one vehicle, or not logged alike."""

    thrust: float = 1.6
    """Ratio of their commanded thrusts."""
    form: float = 1.4
    """Ratio of how far the commanded thrust varies next to the measured one: speeds that are squared have 2, real
    flights of one vehicle up to 1.25, damaged ones among them."""
    alike: float = 0.6
    """Correlation of commanded and measured thrust above which one follows the other: gusts lower it."""
    above_noise: float = 2.0
    """Ratio of what varies to the accelerometer's noise, above which it is seen."""


SAME = SameVehicle()


def refuse_other_vehicle(one: OpenFlight, others: Sequence[OpenFlight], kind: str, model: Model) -> None:
    """Raise LogError for a flight that is of another vehicle than others, which are called `kind` in words, or of which
    the commands are logged in another form (as thrust and not as speed, say), unless "vehicles" is accepted of it.
    """  # noqa: D205
    if "vehicles" in one.accept:
        return
    how = other_vehicle(one.flight.autopilot, (f.flight.autopilot for f in others))
    if how:
        raise LogError(
            f"{one.flight.path.name}: of another vehicle than {kind}: {how}; expected flights of one; where the "
            "autopilot alone was exchanged, say --accept vehicles"
        )
    own, usual = _thrust(one), float(np.median([_thrust(f) for f in others]))
    if not 1.0 / SAME.thrust < own / max(usual, 1e-9) < SAME.thrust:
        raise LogError(
            f"{one.flight.path.name}: flies at a commanded thrust of {own:.3g} N, {kind} at {usual:.3g} N; expected "
            f"flights of one vehicle ({model.vehicle.name}); where it carries so much, say --accept vehicles"
        )
    gain, gains = thrust_gain(one), [g for f in others if (g := thrust_gain(f)) is not None]
    ratio = 1.0 if gain is None or not gains else gain / float(np.median(gains))
    if not 1.0 / SAME.form < ratio < SAME.form:
        raise LogError(
            f"{one.flight.path.name}: its commanded thrust varies {ratio:.2g} times as much next to the measured one "
            f"as that of {kind}; expected motor commands in one form: these look logged as another power of the speed; "
            "map them with --topic rotor_speed=..., or say --accept vehicles"
        )


def thrust_gain(flight: OpenFlight) -> float | None:
    """Standard deviation of the commanded force along z over that of the measured one; None where they do not follow
    each other above noise.
    """  # noqa: D205
    commanded, measured = (
        np.concatenate([part - part.mean() for part in parts])
        for parts in zip(*((r.commanded[:, 2], r.measured[:, 2]) for r in flight.records), strict=True)
    )
    spread = float(measured.std())
    noise = float(np.mean([r.noise[2] for r in flight.records]))
    if not (np.isfinite(noise) and spread > SAME.above_noise * noise and commanded.std() > 0.0):
        return None
    alike = float(np.mean(commanded * measured)) / (float(commanded.std()) * spread)
    return float(commanded.std()) / spread if alike > SAME.alike else None


def _thrust(flight: OpenFlight) -> float:
    """Median size of the commanded force [N]."""
    return float(np.median(np.concatenate([np.linalg.norm(r.commanded[:, :3], axis=1) for r in flight.records])))
