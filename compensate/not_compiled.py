"""Why a compensator is slow; a file of its own, since `replay.present` reports it without compiling anything."""

from dataclasses import dataclass


@dataclass(frozen=True)
class NotCompiled:
    """A compensator steps plain models with L-BFGS, tens of times as slow, because of `reason`."""

    reason: str
