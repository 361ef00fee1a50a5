"""References: derivatives that belong together, and the figures of the paper."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import ReferenceSeries
from wrenchgap.plant.trajectory import TRAJECTORIES, Hover, Recorded, named
from wrenchgap.plant.trajectory.reference import attitude_of_thrust, check_sampled, yaw_of
from wrenchgap.plant.trajectory.shapes import Excited, FigureEight, Flat, Multisine
from wrenchgap.plant.vehicle import GRAVITY

SMOOTH = [name for name in TRAJECTORIES if name != "step"]


def stencil(values, h):
    """Fourth-order central first derivative from samples at -2h, -h, h, 2h."""
    a, b, c, d = values
    return (8.0 * (c - b) - (d - a)) / (12.0 * h)


def agree(found, expected, tolerance):
    """Everywhere but at the few instants where the quintic's third derivative jumps within the stencil."""
    difference = np.abs(found - expected).max(axis=1)
    assert np.mean(difference < tolerance) > 0.98
    assert difference.max() < 5e-3


@pytest.mark.parametrize("excitation", [0.0, 1.0])
@pytest.mark.parametrize("name", SMOOTH)
def test_rates_are_the_derivatives_of_what_they_belong_to(name, excitation):
    trajectory, h = named(name, 40.0, excitation, seed=3), 1e-3
    t = np.linspace(0.05, 39.95, 397)
    here = trajectory.at(t)
    around = [trajectory.at(t + k * h) for k in (-2, -1, 1, 2)]
    at = lambda part: [getattr(r, part) for r in around]  # noqa: E731
    agree(stencil(at("position_E"), h), here.velocity_E, 1e-8)
    agree(stencil(at("velocity_E"), h), here.acceleration_E, 1e-7)
    turns = [so3.log(so3.multiply(so3.conjugate(here.quat_ED), q)) for q in at("quat_ED")]
    agree(stencil(turns, h), here.omega_D, 1e-7)
    agree(stencil(at("omega_D"), h), here.omega_dot_D, 1e-5)


@pytest.mark.parametrize("name", SMOOTH)
def test_flights_start_and_end_at_rest(name):
    trajectory = named(name, 40.0, 0.0 if isinstance(named(name), Flat) else 1.0)
    ends = trajectory.at(np.array([0.0, trajectory.duration]))
    for part in ("velocity_E", "acceleration_E", "omega_D"):
        np.testing.assert_allclose(getattr(ends, part), 0.0, atol=1e-4)


@pytest.mark.parametrize(("name", "axis"), [("roll", 0), ("pitch", 1)])
def test_the_papers_tilt_reaches_60_deg_in_2_46_s_at_1_rad_per_s2_every_10_s(name, axis):
    trajectory = named(name, 30.0)
    t = np.arange(0.0, 30.0, 1e-3)
    r = trajectory.at(t)
    tilt = np.degrees(so3.tilt_angle(r.quat_ED))
    assert tilt.max() == pytest.approx(60.0)
    assert t[np.argmax(tilt > 59.9999)] == pytest.approx(2.46, abs=0.03)
    assert np.abs(r.omega_dot_D).max() == pytest.approx(1.0, abs=1e-4)
    assert np.all(r.omega_D[:, [k for k in range(3) if k != axis]] == 0)
    np.testing.assert_allclose(tilt[:10000], tilt[10000:20000], atol=1e-9)
    assert tilt[9999] == pytest.approx(0.0, abs=1e-9)


def test_the_figure_8_tilts_to_63_deg_and_crosses_itself():
    trajectory = FigureEight(40.0)
    t = np.arange(0.0, 40.0, 1e-2)
    r = trajectory.at(t)
    assert np.degrees(so3.tilt_angle(r.quat_ED)).max() == pytest.approx(63.0, abs=0.05)
    p = r.position_E - np.array(trajectory.position)
    np.testing.assert_allclose(np.abs(p).max(axis=0), [1.0, 0.5, 0.0], atol=1e-3)
    np.testing.assert_allclose(p[:, 1] ** 2, p[:, 0] ** 2 * (1.0 - p[:, 0] ** 2), atol=1e-12)  # Gerono's lemniscate


def test_multi_axis_tilts_reach_70_deg_about_six_or_more_directions():
    r = named("multi_axis", 40.0).at(np.arange(0.0, 40.0, 1e-2))
    tilt = so3.tilt_angle(r.quat_ED)
    assert np.degrees(tilt).max() == pytest.approx(70.0)
    leaning = so3.matrix(r.quat_ED)[tilt > np.radians(69.9)][:, :2, 2]
    directions = np.unique(np.round(np.degrees(np.arctan2(leaning[:, 1], leaning[:, 0]))))
    assert len(directions) == 6


def test_the_step_jumps_by_40_deg_about_x_and_without_room_for_another_tilt_it_stays_level():
    r = named("step").at(np.array([0.999, 1.0]))
    np.testing.assert_allclose(np.degrees(so3.log(r.quat_ED)), [[0, 0, 0], [40, 0, 0]], atol=1e-12)
    late = named("pitch", 14.0).at(np.arange(10.0, 14.0, 0.1))
    np.testing.assert_allclose(so3.tilt_angle(late.quat_ED), 0.0, atol=1e-12)


def test_the_excitation_peaks_where_asked_spares_no_axis_and_shares_no_frequency():
    excitation = Multisine(40.0, position_peak=0.1, attitude_peak=0.12, seed=5)
    t = np.arange(0.0, 40.0, 0.005)
    e, _, _ = excitation.at(t)
    middle = e[600:-600]
    np.testing.assert_allclose(np.abs(middle).max(axis=0), [0.1] * 3 + [0.12] * 3, rtol=0.02)
    spectrum = np.abs(np.fft.rfft(e[2000:6000], axis=0))  # one whole base period of 20 s
    present = spectrum > 1e-3 * spectrum.max(axis=0)
    assert np.all(present.sum(axis=0) >= 3)
    assert present.sum(axis=1).max() == 1


def test_choosing_phases_lowers_the_crest_factor_and_seeds_repeat():
    t = np.arange(3.0, 23.0, 0.01)

    def crest(draws, seed):
        e = Multisine(40.0, seed=seed, draws=draws).at(t)[0]
        return np.abs(e).max(axis=0) / e.std(axis=0)

    assert np.mean(crest(200, 0)) < 0.9 * np.mean([crest(1, s) for s in range(8)])
    np.testing.assert_array_equal(Multisine(40.0, seed=1).at(t)[0], Multisine(40.0, seed=1).at(t)[0])
    assert not np.allclose(Multisine(40.0, seed=1).at(t)[0], Multisine(40.0, seed=2).at(t)[0])


@pytest.mark.parametrize("name", ["circle", "figure8_level"])
def test_flat_attitudes_point_the_thrust_along_acceleration_plus_gravity(name):
    r = named(name, 30.0, 1.0).at(np.linspace(0.0, 30.0, 301))
    force = r.acceleration_E + np.array([0.0, 0.0, GRAVITY])
    sideways = so3.rotate_inverse(r.quat_ED, force)[:, :2]
    np.testing.assert_allclose(sideways, 0.0, atol=1e-12)
    assert np.degrees(so3.tilt_angle(r.quat_ED)).max() > 3.0


def test_thrust_attitude_and_yaw_belong_together():
    rng = np.random.default_rng(0)
    force, yaw = rng.normal(size=(50, 3)) + np.array([0, 0, 1.5]), rng.uniform(-3.0, 3.0, 50)
    quat = attitude_of_thrust(force, yaw)
    np.testing.assert_allclose(so3.matrix(quat)[:, :, 2], force / np.linalg.norm(force, axis=1)[:, None], atol=1e-12)
    np.testing.assert_allclose(yaw_of(quat), yaw, atol=1e-12)


def series(trajectory, rate=200.0, **drop):
    """A reference as a log has it, from 7 s on."""
    r = trajectory.at(np.arange(0.0, trajectory.duration, 1.0 / rate))
    parts = {name: getattr(r, name) for name in ("velocity_E", "omega_D", "acceleration_E", "omega_dot_D")}
    return ReferenceSeries("/reference", r.time + 7.0, r.position_E, r.quat_ED, **(parts | drop))


def test_a_recorded_reference_flies_the_same_again():
    original = named("figure8", 20.0, 1.0)
    again = Recorded(series(original))
    t = np.linspace(0.0, again.duration, 777)
    np.testing.assert_allclose(again.at(t).position_E, original.at(t).position_E, atol=1e-4)
    np.testing.assert_allclose(so3.tilt_angle(again.at(t).quat_ED), so3.tilt_angle(original.at(t).quat_ED), atol=1e-4)


@pytest.mark.parametrize(
    "missing", [("acceleration_E", "omega_dot_D"), ("velocity_E", "omega_D", "acceleration_E", "omega_dot_D")]
)
def test_derivatives_that_a_log_lacks_are_found_to_second_order(missing):
    original = named("figure8", 20.0, 1.0)

    def worst(rate):
        log = series(original, rate, **dict.fromkeys(missing))
        found, true = (t.at(log.time[5:-5] - 7.0) for t in (Recorded(log), original))
        return max(np.abs(getattr(found, p) - getattr(true, p)).max() for p in ("acceleration_E", "omega_dot_D"))

    coarse, fine = worst(100.0), worst(200.0)
    assert fine < 0.1
    assert coarse / fine == pytest.approx(4.0, abs=0.6)


def test_a_corner_of_a_recorded_reference_is_not_an_acceleration():
    log = series(Excited(Hover(10.0), Multisine(10.0)), acceleration_E=None, omega_dot_D=None)
    omega = log.omega_D.copy()
    omega[1000:] += [2.0, 0.0, 0.0]
    omega[400] = 0.0
    smooth, cornered = (Recorded(made).at(log.time - 7.0).omega_dot_D for made in (log, replace(log, omega_D=omega)))
    difference = np.abs(cornered - smooth)
    assert difference.max() < 3.0  # rad/s^2, where the jump of 2 rad/s in 5 ms would have made 400
    assert (difference.max(axis=1) > 1e-9).sum() <= 5


def test_the_amplitude_of_the_figure_8_solves_its_equation():
    """Independent of the bisection: the tilt along the curve with this amplitude has its maximum at 63 deg."""
    f = np.linspace(0.0, 2 * np.pi, 100001)
    largest = lambda c: np.arccos(np.min(np.cos(c * np.sin(2 * f)) * np.cos(c * np.sin(f)))) - np.radians(63.0)  # noqa: E731
    assert FigureEight(40.0).amplitude == pytest.approx(brentq(largest, 0.1, 1.3), abs=1e-5)


def test_every_registered_trajectory_builds_with_its_default_length_and_no_other_does():
    for name, (_, length, line) in TRAJECTORIES.items():
        assert named(name).duration == length
        assert line
    with pytest.raises(UsageError, match=r"'loop'.*hover, pitch"):
        named("loop")
    with pytest.raises(UsageError, match="expected a positive number"):
        named("hover", -1.0)


def test_a_reference_that_its_samples_do_not_show_is_refused():
    """A jump of 1 mm too much, an oscillation that is the same at each sample, and what is no number; all else is not,
    also where the attitude follows a thrust whose jerk jumps.
    """
    time = np.arange(0.0, 6.0, 0.02)
    for name in SMOOTH:
        trajectory = named(name, 6.0, 1.0)
        check_sampled(trajectory.at(time), name)
        check_sampled((trajectory if isinstance(trajectory, Flat) else Flat(trajectory)).at(time), name)
    still = named("hover", 6.0).at(time)
    check_sampled(still.sample(0), "one")
    jump, lost = still.position_E.copy(), still.position_E.copy()
    jump[150:, 0] += 0.011
    lost[7] = np.nan
    fast = np.tile([0.1 * 2.0 * np.pi / 0.02, 0.0, 0.0], (len(time), 1))  # of 0.1 m at 50 Hz, through the middle
    force = np.tile([0.1 * (2.0 * np.pi / 0.02) ** 2, 0.0, 0.0], (len(time), 1))  # at the end
    for wrong in (
        replace(still, position_E=jump),
        replace(still, position_E=lost),
        replace(still, velocity_E=fast),
        replace(still, acceleration_E=force),
        replace(still, omega_D=fast),
        named("step", 6.0).at(time),
    ):
        with pytest.raises(UsageError, match=r"x: jumps, or moves too fast to be sampled at 50 Hz, at \d"):
            check_sampled(wrong, "x")
