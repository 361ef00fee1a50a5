"""INDI and L1 adaptive augmentation as corrections of the commanded wrench: what others fly, to compare with.

With the wrench W_made = A(W_cmd) + d that acts, A the actuators and d what the model does not know, both command
W_cmd = W_des - d_hat and differ in how they find d_hat. Forces are estimated in E, where wind and payloads are
constant, torques in B.

**INDI** (`INDI`). The angular acceleration from the gyroscope and the specific force from the accelerometer, through a
second-order low-pass H, against the command through the same H and a model A_o of the actuators:

    W_cmd = H A_o W_cmd + M (a_wanted - H a) + gyroscopic,      M = diag(m, J)

With W_des = M a_wanted + gyroscopic and W_meas = M a + gyroscopic (`plant.wrench_model.measured_wrench`) that is

    d_hat = H (W_meas - A_o W_cmd)

H acts on the difference, so that it is the same in both by construction, and with A_o = A it leaves H d: nothing where
nothing is missing. An error of A_o closes a loop, 1 + H (A - A_o) = 0. Without lag and with an unknown delay T, a
Butterworth H of w = 2 pi f bears T < 1.777 / w. Sources: Smeur, Chu, de Croon, "Adaptive incremental nonlinear dynamic
inversion for attitude control of micro air vehicles", JGCD 39 (3), 2016, section III; Tal and Karaman, "Accurate
tracking of aggressive quadrotor trajectories using incremental nonlinear dynamic inversion and differential flatness",
IEEE TCST 29 (3), 2021 (CDC 2018), for the specific force in E.

**L1** (`L1`). A predictor of x = (velocity of the centre of mass in E, body rates), whose error x~ = x_hat - x is put
on the estimate every period T, and a first-order low-pass C of cut-off f before it is commanded:

    x_hat' = gravity and gyroscopic + M^-1 (W_cmd + sigma) - a x~,     A_s = -a I
    sigma  = -M Phi^-1 e^(-a T) x~,     Phi = (1 - e^(-a T)) / a,      d_hat = C sigma

Of a constant d it finds e^(-a T) d, by the next period: a = 1 / s leaves 0.5 % at 200 Hz, 5 / s 2.5 %. It knows no
actuators: their lag tau gives tau s^2 + s + 2 pi f, as for an observer that is not told (`compensate.observer`), and a
delay T is borne below a quarter of 1 / f. Sources: Hovakimyan and Cao, L1 Adaptive Control Theory, SIAM 2010, section
3.3; Wu, Cheng, Ackerman, Gahlawat, Lakshmanan, Zhao, Hovakimyan, "L1 adaptive augmentation for geometric tracking
control of quadrotors", ICRA 2022. Theirs corrects the thrust and the torques; here all that the vehicle makes.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from wrenchgap.compensate.compensator import Result, plausible, wrench_of
from wrenchgap.compensate.observer import Combined, check_cutoff, lags
from wrenchgap.compensate.reach import reach_of
from wrenchgap.compensate.tables import IMPLAUSIBLE
from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.filters import butterworth
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.controller import pushes_along_z_only
from wrenchgap.plant.state import Motion, State
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import cross, measured_wrench

INDI_HZ, L1_HZ = 8.0, 1.0
"""Cut-offs [Hz] unless another is given: Smeur's 50 rad/s; that of the observer among the baselines."""


class Feedback:
    """What `INDI` and `L1` share; steps like `Compensator`, with the state.

    vehicle     whose mass, inertia and reach count
    dt          period at which `step` is called [s]
    cutoff_hz   of the low-pass, at most 1 / (2 pi dt)

    The correction is at most half of the vehicle's authority on each axis, the command what the vehicle can make
    (`compensate.reach`); axes that a vehicle with parallel rotors does not push along are left alone. The estimate is
    held over a period whose state is none, or that would take more than `Combined.jump` authorities: a sensor fault.
    What is compared with the measurement is what was sent, so that nothing winds up at a limit.
    """

    name = "feedback"
    without_observer = ""
    not_compiled = None
    """See `Compensator`."""

    def __init__(self, vehicle: Vehicle, dt: float, cutoff_hz: float) -> None:
        check_cutoff(dt, cutoff_hz, self.name, "a cut-off")
        self.body, self.dt, self.cutoff_hz = vehicle.body, dt, cutoff_hz
        self.reach = reach_of(vehicle)
        self.bound, self.jump = self.reach.correction_max, Combined.jump * self.reach.authority
        lateral = 0.0 if pushes_along_z_only(vehicle) else 1.0
        self.makes = np.array([lateral, lateral, 1.0, 1.0, 1.0, 1.0])
        self.reset()

    @property
    def correction_max(self) -> Array:
        """Largest correction (6,) [N, Nm]."""
        return np.asarray(self.bound * self.makes)

    def reset(self) -> None:
        """Forget the past."""
        self._estimate = np.zeros(len(AXES))
        """d_hat (6,): force in E [N], torque in B [Nm]."""
        self._correction = np.zeros(len(AXES))
        self._sent = np.zeros(len(AXES))
        self._before: State | None = None

    def step(self, wrench_des: ArrayLike, state: State | None = None) -> Result:
        """Command for the desired wrench (6,) in this state (N = 1).

        Raises UsageError without a state, and on anything but finite numbers; the next step goes on with the estimate.
        """
        try:
            wrench = wrench_of(wrench_des)
            if state is None:
                raise UsageError(f"{self.name} needs the state: step(wrench_des, state)")
            known = plausible(state)
            if known:
                self._look(state)
        except BaseException:
            self._before = None
            raise
        self._before = state if known else None
        self._sent, limited = self.reach.nearest(wrench + self._correction)
        given, trouble = self._correction.copy(), "" if known else IMPLAUSIBLE
        return Result(self._sent, given, given, 0.0, 0.0, 0.0 if known else math.nan, 0, known, limited, trouble)

    def _look(self, state: State) -> None:
        """The estimate and the correction in this state."""
        if self._before is None:
            self._begin(state)
        else:
            self._learn(self._before, state)
        d_B = np.concatenate((so3.rotate_inverse(state.quat_EB[0], self._estimate[:3]), self._estimate[3:]))
        self._correction = -np.clip(d_B, -self.correction_max, self.correction_max)

    def _begin(self, state: State) -> None:
        """Nothing is known of the period before this state."""
        raise NotImplementedError

    def _learn(self, before: State, state: State) -> None:
        """Renew the estimate; `_sent` acted between these states."""
        raise NotImplementedError

    def _believed(self, missing_B: Array, quat_EB: Array) -> tuple[Array, Array]:
        """A wrench (6,) in B as bounded, its force in E; and which of its numbers no fault of a sensor made."""
        fine = np.abs(missing_B) <= self.jump
        parts = np.clip(missing_B, -self.bound, self.bound)
        inside = np.repeat([fine[:3].all(), fine[3:].all()], 3)
        return np.concatenate((so3.rotate(quat_EB, parts[:3]), parts[3:])), inside


class INDI(Feedback):
    """Incremental nonlinear dynamic inversion; see the module.

    cutoff_hz   of the second-order Butterworth low-pass of measurement and command
    lag, delay  of the actuators as they are modelled [s]: lag one number, or one for each axis (6,)

    Forces are corrected where `State.specific_force_B` is known, torques always.
    """

    name = "INDI"

    def __init__(
        self, vehicle: Vehicle, dt: float, cutoff_hz: float = INDI_HZ, *, lag: float | Array = 0.0, delay: float = 0.0
    ) -> None:
        self.lag, self.delay = lags(lag, delay, len(AXES), self.name), delay
        super().__init__(vehicle, dt, cutoff_hz)
        tau = np.where(self.lag > 0.0, self.lag, 1.0)
        self._follow = np.where(self.lag > 0.0, np.exp(-dt / tau), 0.0)
        self._mean = np.where(self.lag > 0.0, tau / dt * (1.0 - self._follow), 0.0)
        self._section = butterworth(cutoff_hz, 1.0 / dt)

    def reset(self) -> None:
        """Forget the past."""
        super().reset()
        self._memory = np.zeros((2, len(AXES)))  # of H
        self._commands: list[Array] = []  # of the delay, the newest first
        self._lagged = np.zeros(len(AXES))

    def made(self, sent: Array) -> Array:
        """Mean (6,) over the period of A_o: what the command `sent` and those before it are taken to make.

        Of a command u that is held, a lag x' = (u - x) / tau has the mean u + (x - u) tau / dt (1 - e^(-dt / tau)).
        """
        whole = int(self.delay / self.dt)
        if not self._commands:
            self._commands, self._lagged = [sent] * (whole + 2), sent.copy()
        self._commands = [sent, *self._commands[:-1]]
        part = self.delay / self.dt - whole
        u = (1.0 - part) * self._commands[whole] + part * self._commands[whole + 1]
        off, self._lagged = self._lagged - u, u + (self._lagged - u) * self._follow
        return np.asarray(u + off * self._mean)

    def _begin(self, state: State) -> None:
        self._commands = []

    def _learn(self, before: State, state: State) -> None:
        rates = 0.5 * (before.omega_B + state.omega_B)
        specific = np.full((1, 3), np.nan) if state.specific_force_B is None else state.specific_force_B
        motion = Motion(rates, (state.omega_B - before.omega_B) / self.dt, specific)
        missing = measured_wrench(self.body, motion)[0] - self.made(self._sent)
        x, known = self._believed(missing, state.quat_EB[0])
        b, a = self._section[:3], self._section[3:]
        y = b[0] * x + self._memory[0]
        memory = np.array([b[1] * x - a[1] * y + self._memory[1], b[2] * x - a[2] * y])
        self._memory = np.where(known, memory, self._memory)
        self._estimate = np.where(known, y, self._estimate)


class L1(Feedback):
    """L1 adaptive augmentation with piecewise-constant adaptation; see the module.

    cutoff_hz  of the first-order low-pass C of the control law
    gain       a [1/s], the predictor's gain A_s = -a I; adaptation is at the period `dt`

    Needs the velocity; no accelerometer.
    """

    name = "L1"

    def __init__(self, vehicle: Vehicle, dt: float, cutoff_hz: float = L1_HZ, *, gain: float = 1.0) -> None:
        super().__init__(vehicle, dt, cutoff_hz)
        if not 0.0 < gain * dt <= 1.0:
            raise UsageError(f"L1: got a predictor gain of {gain} / s, expected a positive number, at most 1 / dt")
        self.gain = gain
        inertia = np.zeros((6, 6))
        inertia[:3, :3], inertia[3:, 3:] = self.body.mass * np.eye(3), self.body.inertia
        self._mobility = np.linalg.inv(inertia)
        rate = gain / (math.exp(gain * dt) - 1.0)  # Phi^-1 e^(-a T)
        self._adapt, self._from_sigma = -rate * inertia, -self._mobility / rate
        self._smooth = 1.0 - math.exp(-2.0 * math.pi * cutoff_hz * dt)

    def reset(self) -> None:
        """Forget the past."""
        super().reset()
        self._sigma = np.zeros(len(AXES))
        self._error: Array = np.zeros(len(AXES))  # x~
        self._x = np.zeros(len(AXES))

    def _measured(self, state: State) -> Array:
        """X (6,): velocity of the centre of mass in E [m/s], body rates [rad/s]."""
        quat, omega = state.quat_EB[0], state.omega_B[0]
        return np.concatenate((state.velocity_E[0] + so3.rotate(quat, cross(omega, self.body.com_B)), omega))

    def _begin(self, state: State) -> None:
        """The predictor starts where the vehicle is, less what its estimate is made of."""
        self._x = self._measured(state)
        self._error = self._from_sigma @ self._sigma

    def _learn(self, before: State, state: State) -> None:
        now, omega = self._measured(state), 0.5 * (before.omega_B + state.omega_B)[0]
        force_E = 0.5 * (so3.rotate(before.quat_EB[0], self._sent[:3]) + so3.rotate(state.quat_EB[0], self._sent[:3]))
        turning = cross(omega, self.body.inertia @ omega)
        acting = np.concatenate((force_E, self._sent[3:] - turning)) + self._sigma
        acceleration = self._mobility @ acting - np.array([0.0, 0.0, GRAVITY, 0.0, 0.0, 0.0]) - self.gain * self._error
        error = self._x + self._error + self.dt * acceleration - now
        wanted = self._adapt @ error
        in_B = np.concatenate((so3.rotate_inverse(state.quat_EB[0], wanted[:3]), wanted[3:]))
        sigma, known = self._believed(in_B, state.quat_EB[0])
        self._x = now
        self._sigma = np.where(known, sigma, self._sigma)
        self._error = self._from_sigma @ self._sigma
        self._estimate = self._estimate + np.where(known, self._smooth * (self._sigma - self._estimate), 0.0)
