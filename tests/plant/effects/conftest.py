"""The bench on which effects are tested: the tilting hexarotor, states and commands, what an effect adds."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wrenchgap.flight.flight import GRAVITY
from wrenchgap.flight.so3 import exp, multiply, rotate, rotate_inverse
from wrenchgap.plant import model_file
from wrenchgap.plant.effects import find
from wrenchgap.plant.effects.effect import Context
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.state import Actuation, Commands, Rates, State
from wrenchgap.plant.wrench_model import WrenchModel


class Bench:
    """Six arms of 0.3 m from +x on, each with an upper and a lower rotor; hovers level at `hover` [rad/s]."""

    dt = 0.005
    vehicle = model_file.load("tilt_hexarotor").vehicle
    body = vehicle.body
    weight = body.mass * GRAVITY
    length = float(vehicle.arms.position_B[0, 0])
    c_f, kappa = float(vehicle.rotors.c_f[0]), float(vehicle.rotors.kappa[0])
    hover = float(np.sqrt(weight / (12 * c_f)))
    turned = exp(np.array([0.5, -0.8, 1.1]))
    """An attitude like any other."""

    def state(self, count=1, *, position=(0, 0, 0), velocity=(0, 0, 0), omega=(0, 0, 0), quat=(1, 0, 0, 0), volts=22.0):
        def tile(v):
            return np.tile(np.asarray(v, dtype=float), (count, 1))

        time = np.arange(count) * self.dt
        return State(time, tile(position), tile(quat), tile(velocity), tile(omega), np.full(count, float(volts)))

    def leaning(self, velocity_B=(0, 0, 0)):
        """In the attitude `turned`."""
        return self.state(quat=self.turned, velocity=rotate(self.turned, np.array(velocity_B, dtype=float)))

    def commands(self, tilt=0.0, speed=None, *, vehicle=None):
        """One sample; hovering by default."""
        arms, rotors = (vehicle or self.vehicle).geometry()
        speed = np.asarray(self.hover if speed is None else speed, dtype=float)
        tilt = np.broadcast_to(np.asarray(tilt, dtype=float), (1, len(arms)))
        return Commands(np.zeros((1, 6)), tilt, np.broadcast_to(speed, (1, len(rotors))))

    def wandering(self, count, seed=0):
        """Smooth commands around hover."""
        rng = np.random.default_rng(seed)
        t = np.arange(count)[:, None] * self.dt
        tilt = 0.5 * np.sin(2 * np.pi * rng.uniform(0.3, 2, 6) * t + rng.uniform(0, 6, 6))
        speed = 680 + 80 * np.sin(2 * np.pi * rng.uniform(0.3, 3, 12) * t + rng.uniform(0, 6, 12))
        return Commands(rng.normal(size=(1, 6)) * np.sin(t), tilt, speed)

    def moving(self, seed):
        """A random attitude, velocity and body rate, and tilt angles with speeds equal within each pair."""
        rng = np.random.default_rng(seed)
        x = self.state(quat=exp(rng.normal(size=3)), velocity=rng.normal(size=3) * 2, omega=rng.normal(size=3))
        return x, self.commands(rng.uniform(-1.5, 1.5, 6), np.repeat(rng.uniform(400, 900, 6), 2))

    def only(self, rotor, speed=None):
        """Speeds with one rotor running."""
        return np.where(np.arange(12) == rotor, self.hover if speed is None else speed, 0.0)

    def model(self, name=None, values=(), vehicle=None):
        """The nominal model, or that with one effect."""
        vehicle = vehicle or self.vehicle
        return WrenchModel(vehicle, () if name is None else (make_effect(vehicle, name, values),))

    def added(self, name, values, u=None, x=None):
        """What the effect adds to the wrench about O, (6,), in one sample."""
        u, x = u or self.commands(), x or self.state()
        return (self.model(name, values).actuate(u, x, self.dt)[0] - self.model().actuate(u, x, self.dt)[0])[0]

    @staticmethod
    def power(W, x):
        """Power [W] of a wrench about O on the moving body."""
        return float(W[:3] @ rotate_inverse(x.quat_EB, x.velocity_E)[0] + W[3:] @ x.omega_B[0])

    def lag(self, name, tau):
        """Wandering commands behind a lag, and before it."""
        u = self.wandering(200)
        return self.model(name, {"tau": tau}).command(u, self.state(200), self.dt)[0], u

    def solved_lag(self, signal, tau):
        """First-order lag by a general ODE solver, on the signal as straight lines between samples."""
        t = np.arange(len(signal)) * self.dt

        def rate(s, y):
            return (np.interp(s, t, signal) - y) / tau

        return solve_ivp(rate, (0, t[-1]), signal[:1], t_eval=t, max_step=self.dt / 2, rtol=1e-9, atol=1e-11).y[0]


@pytest.fixture(scope="session")
def bench():
    return Bench()


class Tumbling:
    """A free body in which arms and rotors move against each other, nothing but one effect acting."""

    def __init__(self, bench):
        self.bench = bench

    @staticmethod
    def arm_angles(t):
        """Tilt (6,), its rate and acceleration at time t."""
        amplitude, rate = np.array([0.8, -0.5, 0.3, 0.9, -0.2, 0.6]), np.array([2.0, 3.0, 1.5, 2.5, 4.0, 1.0])
        s, c = np.sin(rate * t), np.cos(rate * t)
        return amplitude * (1 - c), amplitude * rate * s, amplitude * rate**2 * c

    @staticmethod
    def rotor_speeds(t):
        """Speeds (12,) and their rates, unequal within pairs."""
        amplitude, rate = np.linspace(20, 250, 12), np.linspace(1, 4, 12)
        return 600 + amplitude * np.sin(rate * t), amplitude * rate * np.cos(rate * t)

    def inside(self, t, J_rotor, J_arm):
        """Angular momentum (3,) that rotors and arms have relative to the body."""
        alpha, dalpha, _ = self.arm_angles(t)
        speed, _ = self.rotor_speeds(t)
        h = np.zeros(3)
        for i, azimuth in enumerate(np.deg2rad(60.0 * np.arange(6))):
            a = np.array([np.cos(azimuth), np.sin(azimuth), 0])
            n = np.cos(alpha[i]) * np.array([0, 0, 1]) + np.sin(alpha[i]) * np.cross(a, [0, 0, 1])
            for r in (2 * i, 2 * i + 1):
                h += self.bench.vehicle.rotors.spin[r] * J_rotor * speed[r] * n
            h += J_arm * dalpha[i] * a
        return h

    def conserves(self, name, omega_0, J_rotor=0.0, J_arm=0.0):
        """Total angular momentum in E is what it was, although the parts have pushed the body about."""
        vehicle, J, inertia = self.bench.vehicle, self.bench.body.inertia, np.array([J_rotor or J_arm])

        def rate(t, y):
            quat, omega = y[:4], y[4:]
            alpha, dalpha, d2alpha = self.arm_angles(t)
            speed, dspeed = self.rotor_speeds(t)
            rates = Rates(dalpha[None], d2alpha[None], dspeed[None])
            act = Actuation(vehicle, alpha[None], speed[None], np.zeros((1, 12)), rates)
            x = self.bench.state(quat=quat, omega=omega)
            M = find(name).apply(act, np.zeros((1, 6)), inertia, Context(vehicle, x))[0]
            assert not M[:3].any()
            domega = np.linalg.solve(J, M[3:] - np.cross(omega, J @ omega))
            return np.concatenate((0.5 * multiply(quat, np.append(0.0, omega)), domega))

        y = solve_ivp(rate, (0, 1.5), [1, 0, 0, 0, *omega_0], rtol=1e-8, atol=1e-10).y[:, -1]
        quat, omega = y[:4] / np.linalg.norm(y[:4]), y[4:]
        assert np.linalg.norm(omega - omega_0) > 0.05
        end = rotate(quat, J @ omega + self.inside(1.5, J_rotor, J_arm))
        np.testing.assert_allclose(end, J @ np.array(omega_0) + self.inside(0.0, J_rotor, J_arm), atol=1e-6)


@pytest.fixture(scope="session")
def tumbling(bench):
    return Tumbling(bench)
