"""What `learn` says of each output in the end: compensate, do not, or what is needed to tell."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Decision(StrEnum):
    """Whether an output of a process is to be flown."""

    COMPENSATE = "compensate"
    DO_NOT = "do not"
    NEEDS = "needs"


class Reason(StrEnum):
    """Why."""

    HELPS = "helps"  # held-out time supports it
    NOTHING = "nothing"  # the residual is not above the sensors' noise, or too small to count
    LAG = "lag"  # the residual is a lag of the vehicle, which no function of the command can correct
    WORSE = "worse"  # on unseen flights the process increases the error
    INPUTS = "inputs"  # there is a residual, and the command does not determine it
    EXCITATION = "excitation"  # there is one, and the flight does not show what it depends on
    LONGER = "longer"  # the flights are too short to hold time out


@dataclass(frozen=True)
class Verdict:
    """Of one output.

    gain       what the process is multiplied by, 0 to 1
    reduction  of the residual's rms on held-out time, with the ends of its 95 % interval; empty where nothing was
               held out
    """

    output: str
    decision: Decision
    reason: Reason
    gain: float
    reduction: tuple[float, ...]
