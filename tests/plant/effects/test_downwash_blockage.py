"""A wake over the neighbours' booms."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.integrate import quad

from wrenchgap.plant.actuation import actuation
from wrenchgap.plant.effects import find
from wrenchgap.plant.effects.effect import Context
from wrenchgap.plant.vehicle import Arms, Rotors, Vehicle


def blocked(bench, tilt, loss=0.2):
    """Share of thrust that each arm loses, (6,)."""
    u = bench.commands(tilt)
    act = actuation(bench.vehicle, u)
    left = find("downwash_blockage").apply(act, np.array([loss]), Context(bench.vehicle, bench.state()))
    return 1 - (left / act.thrust)[0, ::2]


def test_level_rotors_blow_at_nothing(bench):
    np.testing.assert_allclose(blocked(bench, 0.0), 0, atol=1e-12)


@pytest.mark.parametrize(("tilt", "side"), [(np.pi / 2, 1.0), (-np.pi / 2, -1.0), (1.0, 1.0)])
def test_blockage_is_the_integral_over_the_booms_downstream(bench, tilt, side):
    """Arm 0 lies along x; tilted by +90 deg it thrusts along -y, so its wake leaves along +y, over arms 1 and 2."""
    hub, R, loss = np.array([bench.length, 0, 0]), bench.vehicle.rotors.radius[0], 0.2
    wake = np.array([0, side * abs(np.sin(tilt)), -np.cos(tilt)])

    def density(s, along):
        apart = s * along - hub
        return np.exp(-np.sum(np.cross(wake, apart) ** 2) / R**2) if wake @ apart > 0 else 0.0

    booms = [np.array([np.cos(a), np.sin(a), 0]) for a in np.deg2rad([60, 120, 180, 240, 300])]
    expected = loss / R * sum(quad(density, 0, bench.length, args=(boom,))[0] for boom in booms)
    only_first = np.where(np.arange(6) == 0, tilt, 0.0)
    lost = blocked(bench, only_first, loss)
    assert lost[0] == pytest.approx(expected, rel=0.05)
    np.testing.assert_allclose(lost[1:], 0, atol=1e-12)


def test_wake_blows_away_from_the_thrust(bench):
    """Of two arms, at 0 and 60 deg: the first blows at the second when it thrusts towards -y, not towards +y."""
    arms, rotors = bench.vehicle.geometry()
    first = {f.name: getattr(arms, f.name)[:2] for f in fields(Arms)}
    four = {f.name: getattr(rotors, f.name)[:4] for f in fields(Rotors)}
    pair = Vehicle("pair", bench.body, Arms(**first), Rotors(**four), np.zeros(3))
    for tilt, blocked_one in ((np.pi / 2, True), (-np.pi / 2, False)):
        u = bench.commands([tilt, 0.0], vehicle=pair)
        thrusts_along_y = bench.model(vehicle=pair).wrench(u, bench.state())[0, 1]
        assert (thrusts_along_y < 0) == blocked_one
        left = find("downwash_blockage").apply(actuation(pair, u), np.array([0.2]), Context(pair, bench.state()))
        assert (left[0, 0] < actuation(pair, u).thrust[0, 0]) == blocked_one


def test_tilting_further_blocks_more(bench):
    shares = np.array([blocked(bench, t).sum() for t in np.linspace(0, np.pi / 2, 10)])
    assert np.all(np.diff(shares) > 0)
    assert 0.001 < shares[-1] / 6 < 0.05
