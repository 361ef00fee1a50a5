"""Why a compensator is slow: apart, because sentences about it are told where nothing is compensated."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NotCompiled:
    """A compensator steps plain models with L-BFGS, tens of times as slow, because of `reason`."""

    reason: str
