"""Thrust over a command that is no rotor speed."""

import numpy as np
import pytest

from wrenchgap.plant.model import make_effect
from wrenchgap.plant.wrench_model import WrenchModel

HOVER_SIGNAL = 0.55
"""Normalised command at which the curves below carry the vehicle."""
COMMANDS = np.linspace(0.4, 1.4, 11)
"""Relative to hover's."""


def lift(bench, commands, *effects, volts=25.0):
    """Thrust of all rotors relative to the weight, at commands relative to hover's, with (name, values) as effects."""
    model = WrenchModel(bench.vehicle, tuple(make_effect(bench.vehicle, *e) for e in effects))
    x = bench.state(volts=volts)
    return np.array([model.wrench(bench.commands(0.0, bench.hover * s), x)[0, 2] for s in commands]) / bench.weight


def signal_curve(share, commands, gain=1.0):
    """f u^2 + (1 - f) u, scaled to carry the vehicle at the hover signal; `gain` times the command."""
    u = HOVER_SIGNAL * np.asarray(commands) * gain
    at_hover = share * HOVER_SIGNAL**2 + (1 - share) * HOVER_SIGNAL
    return (share * u**2 + (1 - share) * u) / at_hover


def as_in_the_page(share):
    """Slope and curvature of that curve, docs/effects/thrust_curve.md."""
    curvature = -(1 - share) / (1 - share + share * HOVER_SIGNAL)
    return {"slope": curvature / 2, "curvature": curvature}


@pytest.mark.parametrize("share", [0.0, 0.3, 0.65, 1.0])
def test_is_the_curve_of_px4_and_ardupilot(bench, share):
    curve = lift(bench, COMMANDS, ("thrust_curve", as_in_the_page(share)))
    np.testing.assert_allclose(curve, signal_curve(share, COMMANDS), atol=1e-12)


def test_is_a_dead_band(bench):
    ratio = 0.15 / HOVER_SIGNAL
    values = {"slope": ratio / (1 - ratio), "curvature": (1 - ratio) ** -2 - 1}
    expected = ((COMMANDS - ratio) / (1 - ratio)) ** 2
    np.testing.assert_allclose(lift(bench, COMMANDS, ("thrust_curve", values)), expected, atol=1e-12)


def test_is_another_power_near_hover(bench):
    near = np.linspace(0.7, 1.3, 7)
    curve = lift(bench, near, ("thrust_curve", {"slope": -0.25, "curvature": -0.625}))
    np.testing.assert_allclose(curve, near**1.5, atol=0.003)


def test_with_a_level_it_is_any_parabola(bench):
    """The level is thrust_scale's, so three numbers have one answer each."""
    a, b, c = 0.12, -0.3, 1.06
    level = a + b + c - 1
    curve = {"slope": (b + 2 * c) / (a + b + c) / 2 - 1, "curvature": c / (a + b + c) - 1}
    both = lift(bench, COMMANDS, ("thrust_curve", curve), ("thrust_scale", {"scale": level}))
    np.testing.assert_allclose(both, a + b * COMMANDS + c * COMMANDS**2, atol=1e-12)


@pytest.mark.parametrize("volts", [25.0, 24.0, 23.25])
def test_with_battery_sag_it_is_a_curve_over_voltage_too(bench, volts):
    """A motor gets u V: with the voltage the command counts for less. Sag is the elasticity of thrust at hover."""
    near, share = np.linspace(0.8, 1.2, 5), 0.3
    values = as_in_the_page(share)
    k = 2 * (1 + values["slope"])
    sag = ("battery_sag", {"sensitivity": k, "per_volt": k / 25.0})
    both = lift(bench, near, ("thrust_curve", values), sag, volts=volts)
    np.testing.assert_allclose(both, signal_curve(share, near, volts / 25.0), atol=0.007)


def test_slope_is_the_gain_of_torque_at_hover_and_leaves_the_force(bench):
    """Rolled by speeds that differ a little, at the hover thrust of the mean."""
    step = np.where(bench.vehicle.rotors.arm < 3, 1.0, -1.0)
    u = bench.commands(0.0, bench.hover * (1 + 1e-4 * step))
    nominal = bench.model().wrench(u, bench.state())[0]
    added = bench.added("thrust_curve", {"slope": 0.2}, u)
    assert abs(nominal[4]) > 1e-4
    assert added[4] / nominal[4] == pytest.approx(0.2, rel=1e-6)
    assert added[2] == pytest.approx(0.0, abs=1e-9)


def test_rotor_at_rest_makes_nothing_and_none_pulls(bench):
    for values in ({"slope": -0.6, "curvature": -1.2}, {"slope": 0.6, "curvature": 0.0}):
        curve = lift(bench, np.linspace(0.0, 1.5, 301), ("thrust_curve", values))
        assert curve[0] == 0.0
        assert curve.min() >= 0.0
        assert np.abs(np.diff(curve)).max() < 0.03  # no jump


def test_needs_no_voltage(bench):
    x = bench.state()
    without = type(x)(x.time, x.position_E, x.quat_EB, x.velocity_E, x.omega_B)
    model = bench.model("thrust_curve", {"slope": 0.2, "curvature": 0.1})
    u = bench.commands(0.0, 1.2 * bench.hover)
    np.testing.assert_array_equal(model.wrench(u, without), model.wrench(u, x))
