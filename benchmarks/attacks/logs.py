"""Logs that lack half of themselves, or whose columns are others than they say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from benchmarks.attacks import Attack, Outcome
from benchmarks.attacks.sensors import MODEL, SECONDS, flown
from wrenchgap import check, explain, load_model, open_flights, save_log
from wrenchgap.flight.errors import LogError
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


ATTACKS = (
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
