"""Mismatch models as a compensator puts them together: one that is the same at every instant, and two in one."""

from __future__ import annotations

from dataclasses import dataclass

from wrenchgap.compensate.lbfgs import linearisation
from wrenchgap.flight.flight import Array
from wrenchgap.plant.mismatch import MismatchModel
from wrenchgap.plant.state import State


@dataclass(frozen=True)
class Fixed:
    """A model that depends on the command alone, as a `Follower`."""

    model: MismatchModel

    def here(self, state: State | None, /) -> MismatchModel:
        """See `plant.mismatch.Follower`."""
        return self.model

    def sent(self, wrench_cmd: Array, /) -> None:
        """See `plant.mismatch.Follower`."""


@dataclass(frozen=True)
class Sum:
    """Two mismatch models on top of each other; only the second is uncertain."""

    physics: MismatchModel
    process: MismatchModel

    @property
    def outputs(self) -> tuple[str, ...]:
        """Those of both."""
        return self.process.outputs

    def mean(self, wrench_cmd: Array, /) -> Array:
        """See `plant.mismatch.MismatchModel`."""
        return self.physics.mean(wrench_cmd) + self.process.mean(wrench_cmd)

    def std(self, wrench_cmd: Array, /) -> Array:
        """Of the process alone."""
        return self.process.std(wrench_cmd)

    def jacobian(self, wrench_cmd: Array, /) -> Array:
        """See `plant.mismatch.MismatchModel`."""
        return self.physics.jacobian(wrench_cmd) + self.process.jacobian(wrench_cmd)

    def mean_and_jacobian(self, wrench_cmd: Array, /) -> tuple[Array, Array]:
        """See `plant.mismatch.Linearises`."""
        (mean, slope), (more, steeper) = (linearisation(m)(wrench_cmd) for m in (self.physics, self.process))
        return mean + more, slope + steeper
