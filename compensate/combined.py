"""Feed-forward and feedback in one object: what is known is compensated, and an observer takes what that leaves.

    W_des - d_hat  ->  feed-forward (effects, process, gate)  ->  W_cmd
    d_hat = k [L - integral (H(M_asked) - omega x L + d_hat) dt],        L = J omega, M_asked = torque of W_des - d_hat

The feed-forward is asked for M_asked and believes that the vehicle will make it. The observer (momentum observer, see
`compensate.observer`) estimates by how much it does not: what the gate withholds, what nobody has learnt, what ran into
a bound. So the gate acts on the process alone.

H is the lag and delay that the vehicle is taken to have. An observer that is told the true ones has d_hat = Q d with
the low-pass Q of bandwidth k, and no loop around it (internal model control; Morari and Zafiriou, Robust Process
Control, 1989, chapter 2). What it is not told of them counts as a disturbance: a lag tau that it works against, and a
loop with the characteristic polynomial tau s^2 + s + k, damping 1 / (2 sqrt(k tau)). That makes the vehicle follow
faster, and bounds k, which comes from the log (`learn.identify.observer`). A delay cannot be worked against.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from wrenchgap.compensate.compensator import REACH, Compensator, Result, wrench_of
from wrenchgap.compensate.not_compiled import NotCompiled
from wrenchgap.compensate.physics import HORIZON_MAX
from wrenchgap.compensate.reach import reach_of
from wrenchgap.compensate.step_row import IMPLAUSIBLE, plausible
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.effects.lag import LagMemory, first_order
from wrenchgap.plant.mismatch import KnowsItsData, output_indices
from wrenchgap.plant.state import State
from wrenchgap.plant.vehicle import Vehicle

JUMP = 4.0
"""Torque, in authorities, beyond which a change of the rate is no motion: the vehicle itself makes one, from one
limit to the other two; what hits it for a period is then not learnt, and the period after it is."""


class Combined:
    """Steps like `Compensator`.

    feedforward   what is known; None: the observer alone
    bandwidth_hz  of the observer, k / (2 pi), at most 1 / (2 pi dt)
    lag, delay    with which the torque follows [s]: lag one number, or one for each axis (3,)
    torque_max    (3,) largest estimate [Nm]; by default three times the largest mismatch that the process has seen, and
                  half of the vehicle's authority, which is never exceeded, on axes where there is none

    Asked for and commanded is what the vehicle can make (`compensate.reach`). The estimate is held, and nothing else is
    remembered, over a period in which it cannot, over one without numbers, and over one whose change of rate would take
    `JUMP` authorities: no vehicle turns like that, but a sensor that fails reads so.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        dt: float,
        bandwidth_hz: float,
        feedforward: Compensator | None = None,
        *,
        lag: float | Array = 0.0,
        delay: float = 0.0,
        torque_max: ArrayLike | None = None,
    ) -> None:
        if not (math.isfinite(dt) and dt > 0 and 0 < 2.0 * math.pi * bandwidth_hz * dt <= 1.0):
            raise UsageError(
                f"combined: got dt {dt} s and an observer of {bandwidth_hz} Hz, expected positive numbers and at most "
                f"{1.0 / (2.0 * math.pi * dt) if dt > 0 else math.nan:.3g} Hz for this period"
            )
        bound = _bounds(feedforward) if torque_max is None else np.asarray(torque_max, dtype=float)
        if bound.shape not in ((), (3,)) or not (bound >= 0).all():
            raise UsageError(f"combined: got torque_max {bound.tolist()} Nm, expected three numbers, each zero or more")
        self.lag = np.broadcast_to(np.asarray(lag, dtype=float), 3).copy()
        if not (np.isfinite(self.lag).all() and (self.lag >= 0).all() and 0 <= delay <= HORIZON_MAX):
            raise UsageError(
                f"combined: got lag {self.lag.tolist()} s and delay {delay} s, expected zero or more, and a delay of "
                f"{HORIZON_MAX:g} s at most"
            )
        self.inertia, self.dt, self.delay = vehicle.body.inertia, dt, delay
        self.gain, self.feedforward = 2.0 * math.pi * bandwidth_hz, feedforward
        self.reach = reach_of(vehicle)
        self.torque_max = np.minimum(bound, self.reach.correction_max[3:])
        self.reset()

    @property
    def bandwidth_hz(self) -> float:
        """Of the observer."""
        return self.gain / (2.0 * math.pi)

    without_observer = ""
    """See `Compensator`: there is one."""

    @property
    def correction_max(self) -> Array:
        """Largest correction (6,) by feed-forward and estimate [N, Nm]."""
        ahead = np.zeros(len(AXES)) if self.feedforward is None else self.feedforward.correction_max
        return np.asarray(ahead + np.concatenate((np.zeros(3), self.torque_max)))

    @property
    def not_compiled(self) -> NotCompiled | None:
        """Of the feed-forward."""
        return None if self.feedforward is None else self.feedforward.not_compiled

    @property
    def estimate(self) -> Array:
        """Torque (3,) [Nm] by which the vehicle does not make what was asked for, at the last step."""
        return self._estimate.copy()

    def reset(self) -> None:
        """Forget the past."""
        self._integral: Array | None = None
        self._estimate = np.zeros(3)
        self._asked: deque[Array] = deque(maxlen=math.ceil(self.delay / self.dt) + 2)
        self._memory: list[LagMemory | None] = [None] * 3
        if self.feedforward is not None:
            self.feedforward.reset()

    def step(self, wrench_des: ArrayLike, state: State | None = None) -> Result:
        """Command for the desired wrench (6,) in this state (N = 1).

        Raises UsageError without a state, and on anything but finite numbers; the next step goes on with the estimate.
        """
        try:
            return self._step(wrench_of(wrench_des), state)
        except BaseException:
            self._hold()
            raise

    def _step(self, wrench: Array, state: State | None) -> Result:
        if state is None:
            raise UsageError("an observer needs the state: step(wrench_des, state)")
        omega = state.omega_B[0]
        if not np.isfinite(omega).all():
            raise UsageError(f"combined: rates {omega.tolist()} are not finite")
        if self.feedforward is not None:
            self.feedforward.check_voltage(state)
        known = plausible(state)
        if known:
            self._observe(omega)
        observed = np.concatenate((np.zeros(3), self._estimate))
        asked, limited = self.reach.nearest(wrench - observed)
        if not known:
            self._hold()
            return Result(asked, -observed, -observed, 0.0, 1.0, math.nan, 0, False, limited, IMPLAUSIBLE)
        self._asked.append(asked[3:].copy())
        if self.feedforward is None:
            made = Result(asked, -observed, -observed, 0.0, 0.0, 0.0, 0, True)
        else:
            made = self.feedforward.step(asked, state)
            made = replace(made, correction=made.correction - observed, optimum=made.optimum - observed)
        if limited or made.limited or not math.isfinite(made.cost):
            self._hold()
        return replace(made, limited=limited or made.limited)

    def _hold(self) -> None:
        """What the vehicle does in this period is not known: the estimate stays, and nothing else is remembered."""
        self._integral, self._memory = None, [None] * 3
        self._asked.clear()
        if self.feedforward is not None:
            self.feedforward.forget()

    def _observe(self, omega: Array) -> None:
        """The estimate from the rate (3,), within its bounds."""
        momentum = self.inertia @ omega
        if self._integral is not None:
            turning = np.cross(omega, momentum)
            estimate = self.gain * (momentum - self._integral - self.dt * (self._followed() - turning + self._estimate))
            torque = self._estimate + (estimate - self._estimate) / (self.gain * self.dt)
            if not np.all(np.abs(torque) <= JUMP * self.reach.authority[3:]):
                self._integral, self._memory = None, [None] * 3
                return
            self._estimate = np.clip(estimate, -self.torque_max, self.torque_max)
        # An integral beyond the bounds would wind up.
        self._integral = momentum - self._estimate / self.gain

    def _followed(self) -> Array:
        """H(M_asked): the torque (3,) that the vehicle is believed to have made over the last period."""
        back = self.delay / self.dt
        whole, part = int(back), back - int(back)
        past = [self._asked[max(len(self._asked) - 1 - whole - more, 0)] for more in (0, 1)]
        late = (1.0 - part) * past[0] + part * past[1]
        found = np.empty(3)
        for k in range(3):
            value, self._memory[k] = first_order(late[None, [k]], float(self.lag[k]), self.dt, self._memory[k])
            found[k] = value[0, 0]
        return found


def _bounds(feedforward: Compensator | None) -> Array:
    """Largest estimate (3,)."""
    bound = np.full(len(AXES), np.inf)
    model = None if feedforward is None else feedforward.model
    if model is not None and isinstance(model, KnowsItsData):
        bound[output_indices(model.outputs)] = REACH * model.mismatch_max
    return np.asarray(bound[3:])
