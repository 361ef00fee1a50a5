"""Which components of the command a flight shows the effect of.

In slow flight the measured torque is near zero whatever is commanded, since the command is there to cancel the
disturbance. Then z = -W_cmd fits every sample, a process learns the slope -1, and I + dmu/dW, which is to be inverted,
is singular (docs/paper.md, 6). Held-out time cannot see it: there the same holds. What can see it is how much of the
command reaches the measurement. With the covariances P of what the physics expects of the commands and M of what was
measured, less the sensors' noise,

    M v = lambda P v                              (generalised eigenvalues, v^T P v = 1)

lambda is the share of the expected variance that was measured along v: near 1 where the command turned the vehicle, 0
where it only cancelled something. Along a v with lambda below `CANCELLED`, and along one where the command hardly
exceeds the noise, the flight does not show how the wrench depends on the command. There the process does not look at
the command (`FitSettings.blind`): the dependence is that of the physics, a newton metre commanded is one more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from wrenchgap.flight.flight import Array

CANCELLED = 0.1
"""Share of the variance: a third of the amplitude."""
ABOVE_NOISE = 3.0
PART = 0.2
"""Share of a component's variance along a direction from which on the component is part of it."""


def unshown(command: Array, expected: Array, measured: Array, noise: Array) -> NDArray[np.bool_]:
    """Which components (L,) of the command the flight does not show the effect of.

    Of consecutive samples (M, L) of the same components: the command, the wrench that the physics expects of it, and
    the measured one, whose white noise has the standard deviation `noise` (L,). All in [N, Nm].
    """
    scale = np.sqrt(command.var(axis=0) + noise**2) + 1e-12
    command, expected, measured = ((part - part.mean(axis=0)) / scale for part in (command, expected, measured))
    floor = (noise / scale) ** 2
    P = np.atleast_2d(np.cov(expected.T)) + np.diag(1e-2 * floor + 1e-12)
    M = np.atleast_2d(np.cov(measured.T)) - np.diag(floor)
    shares, directions = eigh(M, P)
    quiet = ABOVE_NOISE**2 * np.einsum("lk,l,lk->k", directions, floor, directions) > 1.0
    along = expected @ directions
    spread = np.maximum(command.std(axis=0), 1e-12)
    part = (command.T @ along / len(command) / (spread[:, None] * np.maximum(along.std(axis=0), 1e-12))) ** 2
    hidden = (part > PART) & ((shares < CANCELLED) | quiet)
    return np.asarray(hidden.any(axis=1) | (command.std(axis=0) ** 2 < ABOVE_NOISE**2 * floor))
