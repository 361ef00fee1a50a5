"""Logs that lack half of themselves, or whose columns are others than they say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.attacks import Attack, Outcome
from benchmarks.attacks.sensors import MODEL, SECONDS, flown
from wrenchgap import check, explain, load_model, open_flights, save_log, simulate
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Flight
from wrenchgap.plant.model import Model
from wrenchgap.replay.present.health import answer

AREA = "Logs that lie"


def exchanged(folder: Path) -> Outcome:
    """Two columns of the tilt angles in each other's place, beside the wrench that was commanded."""
    flight = flown()
    assert flight.actuators is not None
    tilt = flight.actuators.tilt[:, [1, 0, 2, 3, 4, 5]]
    log = save_log(replace(flight, actuators=replace(flight.actuators, tilt=tilt)), folder / "log.mcap")
    try:
        open_flights(log, load_model(MODEL))
    except LogError as error:
        return Outcome("columns of the log are exchanged" in str(error), f"refused: {str(error)[:160]}")
    return Outcome(False, "was opened")


def further(folder: Path) -> Outcome:
    """Tilt angles logged as 0.95 of what they are."""
    flight, model = flown(2.0 * SECONDS), load_model(MODEL)
    assert flight.actuators is not None
    arms = replace(flight.actuators, tilt=0.95 * flight.actuators.tilt)
    log = save_log(replace(flight, actuators=arms, commanded=None, desired=None), folder / "log.mcap")
    found = explain(open_flights(log, model), model, jobs=1)
    return Outcome(found.firm == ("tilt_scale",), f"firm: {', '.join(found.firm) or 'nothing'}; {found.verdict}")


def halved(folder: Path) -> Outcome:
    """A log of which half is gone."""
    path = save_log(flown(2.0 * SECONDS), folder / "log.mcap")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    words = " ".join(text for text, _ in answer(check(path)))
    return Outcome("cut short" in words, words[:200])


def refused(name: str, change: Callable[[Flight, Model], tuple[Flight, Model]]) -> Callable[[Path], Outcome]:
    """A log of the crazyflie and a model, changed, which the check `name` shall refuse."""

    def tried(folder: Path) -> Outcome:
        model = load_model("crazyflie")
        flight, other = change(simulate(model, "multi_axis", duration=SECONDS, excitation=1.0, seed=3), model)
        log = save_log(flight, folder / "log.mcap")
        try:
            open_flights(log, other)
        except LogError as error:
            return Outcome(f": {name}: " in str(error), f"refused: {str(error)[:160]}")
        return Outcome(False, "was opened")

    return tried


def _bench(flight: Flight, model: Model) -> tuple[Flight, Model]:
    assert flight.imu is not None
    rng, count = np.random.default_rng(1), len(flight.imu.time)
    still = rng.normal(0.0, 1e-3, (count, 3)), rng.normal((0.0, 0.0, 9.81), 0.05, (count, 3))
    return replace(
        flight, imu=replace(flight.imu, omega_B=still[0], specific_force_B=still[1]), odometry=None, commanded=None
    ), model


def _pasted(flight: Flight, model: Model) -> tuple[Flight, Model]:
    assert flight.imu is not None
    half = len(flight.imu.time) // 2
    names = ("omega_B", "specific_force_B")
    twice = {n: np.concatenate([v[:half], v[:half], v[2 * half :]]) for n in names for v in [getattr(flight.imu, n)]}
    return replace(flight, imu=replace(flight.imu, **twice)), model


def _light(flight: Flight, model: Model) -> tuple[Flight, Model]:
    body = replace(model.vehicle.body, inertia=0.2 * model.vehicle.body.inertia)
    return flight, replace(model, vehicle=replace(model.vehicle, body=body))


def _shifted(flight: Flight, model: Model) -> tuple[Flight, Model]:
    arms = model.vehicle.arms
    assert arms is not None
    places = replace(arms, position_B=np.roll(arms.position_B, 1, axis=0))
    return replace(flight, commanded=None, desired=None), replace(model, vehicle=replace(model.vehicle, arms=places))


ATTACKS = (
    Attack("the motors of a flight on a bench, with an IMU at rest", "refused: motion", refused("motion", _bench)),
    Attack("half of a flight pasted in again", "refused: repeated", refused("repeated", _pasted)),
    Attack("a model with a fifth of the inertia", "refused: inertia", refused("inertia", _light)),
    Attack(
        "a model whose arms are one place on, no commanded wrench",
        "refused: rotors",
        refused("rotors", _shifted),
    ),
    Attack(
        "two columns of tilt angles exchanged, beside the commanded wrench",
        "refused: actuation",
        exchanged,
    ),
    Attack(
        "all tilt angles logged at 0.95 of what they are",
        "tilt_scale is firm, and nothing else",
        further,
    ),
    Attack(
        "a log of which half is gone",
        "said in the first lines of `check`",
        halved,
    ),
)
