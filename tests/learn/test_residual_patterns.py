"""A lightly damped mode is found at its frequency, and one rotor's force is that rotor's; nothing else is either."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.signal import butter, cont2discrete, lfilter
from scipy.spatial.transform import Rotation

from wrenchgap.learn.diagnose.residual_patterns import RESONANCE, answer, one_rotor, oscillation

RADIUS, HEIGHT, KAPPA = 0.30, 0.035, 0.0165
"""The tilting hexarotor: six arms every 60 deg, two rotors on each, one above the other along the tilted axis [m]."""


def push(data, arm, spin):
    """Wrench (K, 6) of one newton of a rotor: Rodrigues' rotation of the vertical about the arm's outward axis."""
    outward = np.array([np.cos(np.radians(60 * arm)), np.sin(np.radians(60 * arm)), 0.0])
    tilt = np.concatenate([r.commands.tilt[r.keep, arm] for r in data.records])
    axis = Rotation.from_rotvec(tilt[:, None] * outward).apply([0.0, 0.0, 1.0])
    torque = np.cross(RADIUS * outward, axis) - spin * KAPPA * axis
    return np.hstack((axis, torque))


def slips(data, seed):
    """Now and then half a second of less thrust [N]."""
    time = np.concatenate([r.time for r in data.records])
    rng = np.random.default_rng(seed)
    return -2.0 * np.any([(time > t) & (time < t + 0.5) for t in rng.uniform(time[0], time[-1], 8)], axis=0)


def white(data, seed):
    return np.random.default_rng(seed).standard_normal(data.measured.shape) * data.noise


@pytest.mark.parametrize(("rotor", "spin"), [(0, 1), (3, 1), (6, 1), (11, 1)])
def test_a_rotor_that_slips_is_found_with_the_one_on_its_shaft(plain, hexarotor, rotor, spin):
    arm = rotor // 2
    spins = hexarotor.vehicle.rotors.spin
    left = white(plain, rotor) + slips(plain, rotor)[:, None] * push(plain, arm, spins[rotor])
    found = one_rotor(plain, hexarotor.vehicle, left)
    assert found is not None
    assert rotor in found.rotors
    assert {k // 2 for k in found.rotors} == {arm}
    assert found.share > 0.95


def test_what_pushes_at_two_arms_is_not_one_rotors(plain, hexarotor):
    left = white(plain, 1)
    for rotor, seed in ((0, 1), (5, 2)):
        left += slips(plain, seed)[:, None] * push(plain, rotor // 2, 1.0)
    assert one_rotor(plain, hexarotor.vehicle, left) is None


@pytest.mark.parametrize("seed", range(4))
def test_gusts_do_not_hide_a_rotor_that_slips(plain, hexarotor, seed):
    """Gusts on all axes alike, a third of what the rotor makes."""
    rng = np.random.default_rng(50 + seed)
    slip = slips(plain, seed)[:, None] * push(plain, 2, hexarotor.vehicle.rotors.spin[4])
    gust = np.cumsum(rng.standard_normal(plain.measured.shape), axis=0)
    gust = (gust - gust.mean(axis=0)) / gust.std(axis=0) / plain.weights / np.sqrt(6.0)  # one newton over all axes
    gust *= np.sqrt(np.mean(np.sum((slip * plain.weights) ** 2, axis=1))) / 3.0
    found = one_rotor(plain, hexarotor.vehicle, white(plain, seed) + slip + gust)
    assert found is not None
    assert {k // 2 for k in found.rotors} == {2}
    assert 0.75 < found.share < 0.97


@pytest.mark.parametrize("seed", range(5))
def test_noise_and_gusts_are_nobodys(plain, hexarotor, seed):
    """A gust: force and torque of equal strength along every axis, changing slowly."""
    rng = np.random.default_rng(seed)
    gust = np.cumsum(rng.standard_normal(plain.measured.shape), axis=0)
    gust *= 20 * plain.noise / gust.std(axis=0)
    assert one_rotor(plain, hexarotor.vehicle, white(plain, seed)) is None
    assert one_rotor(plain, hexarotor.vehicle, white(plain, seed) + gust) is None


def test_without_rotors_or_a_torque_nothing_is_said(plain, hexarotor):
    left = slips(plain, 3)[:, None] * push(plain, 1, 1.0)
    bare = replace(hexarotor.vehicle, arms=None, rotors=None)
    assert one_rotor(plain, bare, left) is None
    blind = replace(plain, weights=np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]))
    assert one_rotor(blind, hexarotor.vehicle, left) is None


G = 9.81


class Hull:
    """A flight that obeys its model, on which something is hung. Everything at the compared samples (K,)."""

    def __init__(self, data, model):
        self.data = data
        self.said = data.predict(model.wrench_model)
        (record,) = data.records
        self.time = record.time
        self.to_E = Rotation.from_quat(record.state_kept.quat_EB, scalar_first=True)
        self.felt_B = self.said[:, :3] / model.vehicle.body.mass

    def noise(self, seed, size=1.0):
        return size * self.data.noise * np.random.default_rng(seed).normal(size=self.said.shape)

    def ringing(self, order, band, *noise):
        """Noise of this seed and size through a filter of this band [Hz]."""
        kind = "bandpass" if np.ndim(band) else "lowpass"
        b, a = butter(order, band, kind, fs=1 / np.diff(self.time).mean())
        return lfilter(b, a, self.noise(*noise), axis=0)

    def search(self, residual):
        """`oscillation` where the model leaves this residual."""
        return oscillation(replace(self.data, measured=self.said + residual), residual)

    def pendulum(self, length, mass=0.2, damping=0.1):
        """What a model with a rigid payload leaves (K, 6) of a mass on a rope, at large angles.

        With the rope's direction q, q'' = -(q' . q') q + (1 - q q^T) p / l - c q' under the pull p = g - a of the
        hanging point; the rope pulls with m (q . p + l q' . q'), a rigid mass with m p.
        """
        felt = CubicSpline(self.time, self.to_E.apply(self.felt_B))

        def rate(t, y):
            q, v, pull = y[:3], y[3:], -felt(t)
            return np.concatenate((v, -(v @ v) * q + (pull - (pull @ q) * q) / length - damping * v))

        q, v = self._integrate(rate, [0, 0, -1, 0, 0, 0])
        pull = -felt(self.time)
        tension = mass * (np.sum(q * pull, axis=1) + length * np.sum(v * v, axis=1))
        force_E = tension[:, None] * q - mass * pull
        return np.hstack((self.to_E.inv().apply(force_E), np.zeros_like(force_E)))

    def sprung(self, hz, zeta, mass=0.2):
        """What a mass on springs in the plane z = 0 of the hull adds (K, 6) to what it would add if it were fixed."""
        felt, w = CubicSpline(self.time, self.felt_B[:, :2]), 2 * np.pi * hz

        def rate(t, y):
            return np.concatenate((y[2:], -w * w * y[:2] - 2 * zeta * w * y[2:] - felt(t)))

        place, speed = self._integrate(rate, np.zeros(4))
        force, at = np.zeros((2, len(place), 3))
        force[:, :2] = mass * (w * w * place + 2 * zeta * w * speed + self.felt_B[:, :2])
        at[:, :2] = place
        return np.hstack((force, np.cross(at, -mass * self.felt_B)))

    def _integrate(self, rate, start):
        span = self.time[0], self.time[-1]
        found = solve_ivp(rate, span, np.asarray(start, float), t_eval=self.time, rtol=1e-6, atol=1e-8)
        return np.split(found.y.T, 2, axis=1)


@pytest.fixture(scope="module")
def tumbling(plain, hexarotor):
    """Tilts to 70 deg: what is fixed in the world is not fixed in the hull."""
    return Hull(plain, hexarotor)


@pytest.fixture(scope="module")
def shaken(fly, hexarotor):
    """Steps, which excite up to some hertz."""
    return Hull(fly("none", None, "steps", seed=23, seconds=25)[0], hexarotor)


def test_the_answer_is_the_oscillators_from_rest():
    """H u and s H u of another library's bilinear transform; a constant input is answered by itself and by nothing."""
    dt, zeta, w = 0.02, 0.1, 2 * np.pi * 1.3
    inputs = np.random.default_rng(4).normal(size=(300, 2)) + 5.0
    inputs[0] = 0.0
    expected = []
    for numerator in ([w**2], [w, 0.0]):
        (b,), a, _ = cont2discrete((numerator, [1.0, 2 * zeta * w, w**2]), dt, "bilinear")
        expected.append(lfilter(b, a, inputs, axis=0))
    np.testing.assert_allclose(answer(inputs, dt, 1.3, zeta), np.hstack(expected), atol=1e-10)
    still = answer(np.tile([2.0, -3.0], (50, 1)), dt, 1.3, zeta)
    np.testing.assert_allclose(still, np.tile([2.0, -3.0, 0.0, 0.0], (50, 1)), atol=1e-10)


@pytest.mark.parametrize("length", [0.3, 0.7])
def test_a_pendulum_is_found_at_its_frequency_and_in_the_world(tumbling, length):
    found = tumbling.search(tumbling.pendulum(length) + tumbling.noise(0))
    assert found.frame == "E"
    assert found.frequency_hz == pytest.approx(np.sqrt(G / length) / (2 * np.pi), rel=0.05)
    assert found.damping < 0.1
    assert found.share > 0.6


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_a_pendulum_that_leaves_less_than_the_noise_is_found(tumbling, seed):
    load = tumbling.pendulum(0.7)
    load *= 0.8 * tumbling.data.noise[:3].mean() / load[:, :3].std(axis=0).max()
    found = tumbling.search(load + tumbling.noise(20 + seed))
    assert found.frame != "B"
    assert found.frequency_hz == pytest.approx(np.sqrt(G / 0.7) / (2 * np.pi), rel=0.1)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 6))])
def test_noise_that_is_louder_than_was_thought_does_not_swing(tumbling, shaken, seed):
    """By more than half of its power on every axis."""
    assert tumbling.search(tumbling.noise(30 + seed, 1.3)) is None
    assert shaken.search(shaken.noise(40 + seed, 1.3)) is None


def test_the_rest_of_the_residual_does_not_hide_a_pendulum(tumbling):
    """Twice the sensor noise, and slow forces that have nothing to do with it."""
    wind = tumbling.ringing(2, 0.2, 2, 10.0)
    found = tumbling.search(tumbling.pendulum(0.7) + wind + tumbling.noise(3, 2.0))
    assert found.frequency_hz == pytest.approx(np.sqrt(G / 0.7) / (2 * np.pi), rel=0.05)


@pytest.mark.parametrize("hz", [0.7, 1.5])
def test_a_mass_on_springs_is_found_at_its_frequency_and_in_the_hull_or_said_to_be_unclear(shaken, hz):
    found = shaken.search(shaken.sprung(hz, 0.02) + shaken.noise(1))
    assert found.frame != "E"
    assert found.frequency_hz == pytest.approx(hz, rel=0.05)
    assert found.damping == pytest.approx(0.02, abs=0.02)
    assert found.share > 0.6


def test_without_a_pose_only_the_hull_can_be_asked(tumbling):
    residual = tumbling.pendulum(0.7) + tumbling.noise(0)
    blind = replace(tumbling.data, records=tuple(replace(r, has_pose=False) for r in tumbling.data.records))
    found = oscillation(replace(blind, measured=tumbling.said + residual), residual)
    assert found is None or found.frame == "B"


@pytest.mark.filterwarnings("error")
def test_an_axis_whose_sensor_has_no_noise_is_left_out_without_a_division_by_zero(shaken):
    """A damaged uSD log whose gyroscope stands still: `discover` and `explain` printed numpy's warning."""
    residual = shaken.sprung(1.5, 0.02) + shaken.noise(1)
    still = tuple(replace(r, noise=np.where(np.arange(6) == 4, 0.0, r.noise)) for r in shaken.data.records)
    found = oscillation(replace(shaken.data, records=still, measured=shaken.said + residual), residual)
    assert found is not None
    assert np.isfinite([found.share, found.significance]).all()


def test_a_mass_too_damped_to_swing_does_not(shaken):
    """The same mass on the same springs in oil."""
    assert shaken.search(shaken.sprung(1.5, 0.02) + shaken.noise(1)) is not None
    assert shaken.search(shaken.sprung(1.5, 1.0) + shaken.noise(1)) is None


def test_noise_does_not_swing(tumbling):
    """White, and white through a narrow band at 1 Hz, which rings but does not answer the motion."""
    ringing = tumbling.ringing(1, (0.9, 1.1), 0, 25.0)
    assert np.all(ringing.std(axis=0) > 2 * tumbling.data.noise)
    assert tumbling.search(tumbling.noise(0, 3.0)) is None
    assert tumbling.search(ringing + tumbling.noise(10)) is None


@pytest.mark.parametrize(("seed", "tau"), [(0, 0.05), (1, 0.25)])
def test_a_lag_does_not_swing(shaken, seed, tau):
    part = 1 - np.exp(-np.diff(shaken.time).mean() / tau)
    late = lfilter([part], [1, part - 1], shaken.said - shaken.said[0], axis=0) + shaken.said[0]
    residual = late - shaken.said + shaken.noise(seed)
    assert np.all(residual.std(axis=0) > 3 * shaken.data.noise)
    assert shaken.search(residual) is None


def test_a_function_of_the_command_does_not_swing(shaken):
    """Any bend in the thrust curve, coupled over the axes at random."""
    mix = np.random.default_rng(0).normal(size=(6, 6))
    z = (shaken.said - shaken.said.mean(axis=0)) / shaken.said.std(axis=0) @ mix
    assert shaken.search(10 * shaken.data.noise * (np.tanh(z) + 0.05 * z**2) + shaken.noise(0)) is None


def test_a_swing_too_small_to_mention_is_not_mentioned(tumbling):
    """Beside five times more of something else it is 4 % of what is left."""
    wind, load = tumbling.ringing(2, 0.2, 2), tumbling.pendulum(0.7)
    wind *= 5 * load[:, :3].std() / wind[:, :3].std()
    assert tumbling.search(load + tumbling.noise(0)).share > RESONANCE.least_share
    assert tumbling.search(load + wind + tumbling.noise(0)) is None
