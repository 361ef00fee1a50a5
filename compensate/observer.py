"""A momentum observer of disturbances, alone (`DisturbanceObserver`) or behind a feed-forward (`Combined`).

With angular momentum L = J omega and Euler's equation L' + omega x L = M_cmd + d, the estimate

    d_hat = k [L - integral (M_cmd - omega x L + d_hat) dt],        d_hat' = k (d - d_hat)

follows the disturbance d as a first-order low-pass of bandwidth k, without differentiating the gyro (De Luca and
Mattone, ICRA 2003; on multirotors Tomic, Ott and Haddadin, RA-L 2017). It needs no model of the mismatch. It lags
behind disturbances that change faster than k, and raising k feeds back noise and the delay of the actuators. With a
feed-forward the known mismatch is compensated, and the observer takes the rest:

    W_des - d_hat  ->  feed-forward (effects, process, gate)  ->  W_cmd
    d_hat = k [L - integral (H(M_asked) - omega x L + d_hat) dt],        L = J omega, M_asked = torque of W_des - d_hat

The feed-forward commands M_asked and assumes that the vehicle makes it. The observer estimates by how much it does not:
what the gate withholds, what was not learnt, what a bound cut off. So the gate acts on the process alone.

H is the assumed lag and delay of the vehicle. An observer that assumes the true ones has d_hat = Q d with the low-pass
Q of bandwidth k, and no loop around it (internal model control; Morari and Zafiriou, Robust Process Control, 1989,
chapter 2). What it does not assume of them counts as a disturbance: a lag tau that it works against, and a loop with
the characteristic polynomial tau s^2 + s + k, damping 1 / (2 sqrt(k tau)). That makes the vehicle follow faster, and
bounds k, which comes from the log (`learn.identify.observer`). A delay cannot be worked against.
"""

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from wrenchgap.compensate import kernels
from wrenchgap.compensate.compensator import Compensator, Result, largest_correction, plausible, wrench_of
from wrenchgap.compensate.lbfgs import NotCompiled
from wrenchgap.compensate.physics import HORIZON_MAX
from wrenchgap.compensate.reach import reach_of
from wrenchgap.compensate.tables import IMPLAUSIBLE, Observed, Observer
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.mismatch import KnowsItsData, output_indices
from wrenchgap.plant.state import State
from wrenchgap.plant.vehicle import Vehicle


def check_cutoff(dt: float, hz: float, who: str, what: str) -> None:
    """Raise UsageError for a period [s] and a cut-off [Hz] that are not positive, or too large together."""
    if not (math.isfinite(dt) and dt > 0 and 0.0 < 2.0 * math.pi * hz * dt <= 1.0):
        raise UsageError(
            f"{who}: got dt {dt} s and {what} of {hz} Hz, expected positive numbers and at most "
            f"{1.0 / (2.0 * math.pi * dt) if dt > 0 else math.nan:.3g} Hz for this period"
        )


def lags(lag: float | Array, delay: float, count: int, who: str) -> Array:
    """A lag for each of so many axes [s]. Raises UsageError for one that is none, and for a `delay` that is none."""
    each = np.broadcast_to(np.asarray(lag, dtype=float), count).copy()
    if not (np.isfinite(each).all() and (each >= 0).all() and 0 <= delay <= HORIZON_MAX):
        raise UsageError(
            f"{who}: got lag {each.tolist()} s and delay {delay} s, expected zero or more, and a delay of "
            f"{HORIZON_MAX:g} s at most"
        )
    return each


class Combined:
    """Steps like `Compensator`.

    feedforward   what is known; None: the observer alone
    bandwidth_hz  of the observer, k / (2 pi), at most 1 / (2 pi dt)
    lag, delay    with which the torque follows [s]: lag one number, or one for each axis (3,)
    torque_max    (3,) largest estimate [Nm]; by default three times the largest mismatch that the process has seen, and
                  half of the vehicle's authority, which is never exceeded, on axes where there is none

    Asked for and commanded is what the vehicle can make (`compensate.reach`). The estimate is held, and nothing else is
    remembered, over a period in which it cannot, over one without numbers, and over one whose change of rate would take
    `jump` authorities: no vehicle turns like that, but a sensor that fails reads so. Where the vehicle could make the
    demand alone, the estimate gives up what stood in the way: else it would make every demand unreachable for ever.
    """

    jump: ClassVar[float] = 4.0
    """Torque, in authorities, beyond which a change of the rate is a sensor fault: the vehicle makes one, and two from
    one limit to the other. An impact that lasts a period is not learnt; the period after it is."""

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
        check_cutoff(dt, bandwidth_hz, "combined", "an observer")
        bound = _bounds(feedforward) if torque_max is None else np.asarray(torque_max, dtype=float)
        if bound.shape not in ((), (3,)) or not (bound >= 0).all():
            raise UsageError(f"combined: got torque_max {bound.tolist()} Nm, expected three numbers, each zero or more")
        self.lag = lags(lag, delay, 3, "combined")
        self.inertia, self.dt, self.delay = vehicle.body.inertia, dt, delay
        self.gain, self.feedforward = 2.0 * math.pi * bandwidth_hz, feedforward
        self.reach = reach_of(vehicle)
        self.torque_max = np.minimum(bound, self.reach.correction_max[3:])
        self.table = self._table()
        self.reset()

    def _table(self) -> Observer:
        """Constants as the compiled observer takes them."""
        back = self.delay / self.dt
        lags = np.where(self.lag > 0.0, self.lag, 1.0)
        a = np.where(self.lag > 0.0, np.exp(-self.dt / lags), 0.0)
        q = np.where(self.lag > 0.0, (1.0 - a) * lags / self.dt, 0.0)
        return Observer(
            inertia=np.array(self.inertia, dtype=float),
            torque_max=self.torque_max,
            jump=self.jump * self.reach.authority[3:],
            follow_a=a,
            follow_b0=q - a,
            follow_b1=1.0 - q,
            gain=self.gain,
            dt=self.dt,
            late_part=back - int(back),
            late=int(back),
        )

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
        """Torque (3,) [Nm] by which the vehicle missed the demand at the last step."""
        return self._observed.estimate.copy()

    def reset(self) -> None:
        """Forget the past."""
        vectors = {name: np.zeros(3) for name in Observed._fields}
        flags = {name: np.zeros(1) for name in ("watching", "asking", "following")}
        self._observed = Observed(**vectors | flags | {"asked": np.zeros((math.ceil(self.delay / self.dt) + 2, 3))})
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
            kernels.observe(self.table, self._observed, np.array(omega))
        observed = np.concatenate((np.zeros(3), self._observed.estimate))
        demand, limited = self.reach.nearest(wrench - observed)
        if not known:
            self._hold()
            return Result(demand, -observed, -observed, 0.0, 1.0, math.nan, 0, False, limited, IMPLAUSIBLE)
        result = Result(demand, -observed, -observed, 0.0, 0.0, 0.0, 0, True)
        if self.feedforward is not None:
            result = self.feedforward.step(demand, state)
        if limited or result.limited:
            correction = np.zeros(len(AXES)) if self.feedforward is None else result.correction
            self.reach.take_back(self._observed, wrench, result.wrench_cmd, correction)
        elif math.isfinite(result.cost):
            kernels.remember_asked(self._observed, np.array(demand[3:]))
        else:
            self._hold()
        if limited and self.feedforward is not None:
            self.feedforward.forget()
        if self.feedforward is not None:
            result = replace(result, correction=result.correction - observed, optimum=result.optimum - observed)
        return replace(result, limited=limited or result.limited)

    def _hold(self) -> None:
        """What the vehicle does in this period is not known: the estimate stays, and nothing else is remembered."""
        kernels.stop_watching(self._observed)
        if self.feedforward is not None:
            self.feedforward.forget()


def _bounds(feedforward: Compensator | None) -> Array:
    """Largest estimate (3,)."""
    bound = np.full(len(AXES), np.inf)
    model = None if feedforward is None else feedforward.model
    if model is not None and isinstance(model, KnowsItsData):
        bound[output_indices(model.outputs)] = largest_correction(model)
    return np.asarray(bound[3:])


class DisturbanceObserver(Combined):
    """`Combined` without a feed-forward and without an assumed lag: steps like `Compensator`, and corrects the torques.

    dt            period at which `step` is called [s]
    bandwidth_hz  k / (2 pi), at most 1 / (2 pi dt): beyond that the discrete estimate overshoots by itself
    """

    def __init__(self, vehicle: Vehicle, dt: float, bandwidth_hz: float = 1.0) -> None:
        if not (math.isfinite(dt) and dt > 0 and math.isfinite(bandwidth_hz) and bandwidth_hz > 0):
            raise UsageError(f"observer: dt {dt} s and bandwidth {bandwidth_hz} Hz must be positive")
        if 2.0 * math.pi * bandwidth_hz * dt > 1.0:
            raise UsageError(
                f"observer: bandwidth {bandwidth_hz:g} Hz is too much for steps of {dt:g} s; expected at most "
                f"{1.0 / (2.0 * math.pi * dt):.3g} Hz"
            )
        super().__init__(vehicle, dt, bandwidth_hz)
