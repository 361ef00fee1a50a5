"""Flying the window of a recording, period by period: what inference and re-flight share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.learn.data.recording import Recording
from wrenchgap.plant.rigid_body import RigidBody, pack, unpack
from wrenchgap.plant.simulate import loss_of_control
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.wrench_model import WrenchModel

Array = NDArray[np.float64]
Report = Callable[[float, str], None]
"""Called with the fraction done (0 to 1) and what is being done."""


@dataclass(frozen=True)
class Flown:
    """K periods of a flight: states at their beginning, what was sent, total wrench (K, 6) and disturbance about O.

    `stopped` says why the flight ended early, empty where it did not.
    """

    state: State
    commands: Commands
    wrench: Array
    disturbance: Array
    stopped: str = ""


def integrate(
    plant: WrenchModel,
    r: Recording,
    memory: dict[str, Any] | None,
    command: Callable[[int, State], Commands],
    disturbance: Callable[[int, State], Array],
    progress: Report | None,
    watch: bool = False,
) -> Flown:
    """Fly the window of a recording from its initial state.

    With `watch` the flight ends where control is lost, unless it was lost there in the recorded flight too.
    """
    start, dt, first = r.motion.state, r.dt, r.first
    body = RigidBody(plant.body)
    y = pack(start.take(slice(first, first + 1)))
    rows: list[tuple[float, ...]] = []
    sent: list[Commands] = []
    wrenches, disturbances = np.zeros((r.count, 6)), np.zeros((r.count, 6))
    stopped = ""
    for k in range(r.count):
        time = float(r.time[first + k])
        now = unpack(time, y, None if start.voltage is None else start.voltage[first + k : first + k + 1])
        if watch:
            stopped = _lost(r, first + k, now)
            if stopped:
                break
        u = command(k, now)
        made, memory = plant.actuate(u, now, dt, memory)
        disturbances[k] = disturbance(k, now)
        wrenches[k] = made[0] + disturbances[k]
        rows.append(y)
        sent.append(u)
        y = body.step(y, wrenches[k], dt)
        if progress is not None and k % 200 == 0:
            progress(k / r.count, "")
    table, n = np.array(rows).reshape(-1, 13), len(rows)
    voltage = None if start.voltage is None else start.voltage[first : first + n]
    state = State(r.time[first : first + n], table[:, :3], table[:, 3:7], table[:, 7:10], table[:, 10:], voltage)
    return Flown(state, Commands.joined(sent), wrenches[:n], disturbances[:n], stopped)


def _lost(r: Recording, k: int, now: State) -> str:
    """Why the re-flight ends here, or nothing. Where the recorded flight had lost control, so may this one."""
    asked = r.reference.sample(k)
    reason = loss_of_control(now, asked)
    finite = bool(np.all(np.isfinite(now.position_E)) and np.all(np.isfinite(now.omega_B)))
    if not reason or (finite and loss_of_control(r.motion.state.take(slice(k, k + 1)), asked)):
        return ""
    return f"control was lost at {float(now.time[0]):.2f} s: {reason}; the re-flight ends there"
