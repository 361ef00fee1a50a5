"""Forms of one effect compete as one name; and what was flown with other formulas is found again.

Flights of the independent engine, into which each hidden effect is put here: a power of the thrust, speeds stepped by
Euler at the engine's own rate, lift that fades exponentially with height.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from wrenchgap.learn.data.candidates import Candidates, candidates
from wrenchgap.learn.data.errors import energy
from wrenchgap.learn.identify.fit import fit, held_out
from wrenchgap.learn.posterior.explain import search_dataset
from wrenchgap.plant.effects import families
from wrenchgap.plant.model import make_effect

USUAL = ("servo_lag", "arm_reaction")
"""What every flight of the engine has besides."""


@pytest.fixture
def hide(monkeypatch):
    """Puts a way to change thrusts or speeds into the engine's list of hidden effects, under a name."""
    from benchmarks.hidden_effects.hidden import HIDDEN, Hidden

    def put(name, *, thrust=None, speed=None):
        @dataclass
        class Put(Hidden):
            @classmethod
            def draw(cls, size, rng):
                return cls()

            def start(self, world):
                self._speed = None

            def thrust(self, world, given):
                return given if thrust is None else thrust(world, given)

            def command(self, world, tilt, sent):
                if speed is None:
                    return tilt, sent
                before = sent if self._speed is None else self._speed
                self._speed = speed(before, sent, world.step)
                return tilt, self._speed

        monkeypatch.setitem(HIDDEN, name, Put)
        return name

    return put


def fitted(flown, model, *names):
    """Values of the last effect, fitted together with the others and the usual ones; and its held-out energy."""
    data, _ = flown
    every = (*USUAL, *names)
    found = fit(data, model, every)
    left = energy(held_out(data, model, every, found), data.weights)
    return np.array([v.value for v in found.values(names[-1])]), left


def test_thrust_that_goes_with_another_power_is_a_curve(fly, hide, hexarotor):
    """T ~ u^1.6, right at hover: slope -0.2, curvature 1.6 * 0.6 / 2 - 1."""
    from benchmarks.hidden_effects.hidden import HOVER_THRUST

    power = hide("power", thrust=lambda world, T: HOVER_THRUST * (T / HOVER_THRUST) ** 0.8)
    flown = fly(power, 1.0, "train", seconds=20, seed=41)
    (slope, curvature), left = fitted(flown, hexarotor, "thrust_curve")
    assert slope == pytest.approx(-0.2, abs=0.03)
    assert curvature == pytest.approx(-0.52, abs=0.15)
    _, level_only = fitted(flown, hexarotor, "thrust_scale")
    assert left < 0.5 * level_only


def test_rotors_slower_down_than_up_are_told_from_one_time_constant(fly, hide, hexarotor):
    def switched(before, sent, step):
        return before + step * (sent - before) / np.where(sent > before, 0.03, 0.09)

    flown = fly(hide("switched", speed=switched), 1.0, "train", seconds=20, seed=42)
    (up, down), left = fitted(flown, hexarotor, "asymmetric_motor_lag")
    (one,), alone = fitted(flown, hexarotor, "motor_lag")
    assert up == pytest.approx(0.03, abs=0.006)
    assert down == pytest.approx(0.09, abs=0.012)
    assert up < one < down
    assert left < 0.9 * alone


@pytest.mark.parametrize(
    "own", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["each hub's height", "one height"]
)
def test_the_form_of_the_ground_effect_that_was_flown_is_named(fly, hide, hexarotor, own):
    from benchmarks.hidden_effects.hidden import RADIUS

    def lifted(world, T):
        z = world.hubs_E[:, 2] if own else world.hubs_E[:, 2].mean()
        return T * (1 + 0.3 * np.exp(-np.maximum(z, 0.0) / (2 * RADIUS)))

    data, _ = fly(hide(f"ground {own}", thrust=lifted), 1.0, "low", seconds=20, seed=43)
    names = (*families()["ground_effect"], "thrust_scale", "mass", *USUAL)
    found = search_dataset(data, hexarotor, Candidates(names, ()), limits_of=())
    forms = [m.name for m in found.members if m.name in families()["ground_effect"]]
    assert forms == ["ground_effect" if own else "ground_effect_one_height"]
    (member,) = (m for m in found.members if m.name in forms)
    assert "ground_effect" in found.firm  # the name of the family, whichever form
    assert not {r.name for r in member.alike} & set(families()["ground_effect"])  # and is no second name


def test_what_the_model_has_in_one_form_is_not_tried_in_another(plain, hexarotor):
    values = {"area_x": 0.1}
    model = replace(hexarotor, effects=(make_effect(hexarotor.vehicle, "body_drag_areas", values),))
    assert "body_drag" not in candidates(plain.records, model).tried
    assert "body_drag_areas" in candidates(plain.records, model).tried  # as a change of its values
    assert {"body_drag", "body_drag_areas"} <= {
        *candidates(plain.records, hexarotor).tried,
        *(u.effect for u in candidates(plain.records, hexarotor).untried),
    }
