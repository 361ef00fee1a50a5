"""`discover`: laws, their search and its false alarms, and the file of a law.

Nothing here is flown by the code that is tested: the quadrotor of `tests/independent` has laws of its own.
"""

import shlex
from dataclasses import replace
from html import unescape
from types import SimpleNamespace

import jsonschema
import numpy as np
import pytest

import wrenchgap as wg
from scripts.json_documents import schema
from tests.independent import flown_quadrotor as engine
from wrenchgap.flight import so3
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.discover.atoms import Atom, Term, atoms, constants
from wrenchgap.learn.discover.discover import Outcome
from wrenchgap.learn.discover.evidence import Evidence, distinct, surrogate_residuals
from wrenchgap.learn.discover.law_file import evaluator, source
from wrenchgap.learn.discover.quantities import Unit
from wrenchgap.learn.discover.residual import Residual, loaded, renamed
from wrenchgap.plant import model_file
from wrenchgap.plant.actuation import actuation
from wrenchgap.plant.effects.effect import Context
from wrenchgap.plant.state import Commands, State
from wrenchgap.replay.present.discovery import to_json, what_next
from wrenchgap.replay.present.documents import document
from wrenchgap.replay.session.panels.effects import LawControls

TILTING = model_file.load("tilt_hexarotor").vehicle
QUADROTOR = engine.MODEL.vehicle


def moving(vehicle, n=5):
    """A state in motion, and what rotors do there."""
    rng = np.random.default_rng(3)
    arms, rotors = vehicle.geometry()
    quat = so3.exp(rng.normal(0.0, 0.4, (n, 3)))
    state = State(
        np.linspace(1.0, 9.0, n),
        rng.normal(size=(n, 3)),
        quat,
        2.0 * rng.normal(size=(n, 3)),
        rng.normal(size=(n, 3)),
        np.full(n, 15.0),
    )
    tilt = 0.3 * rng.normal(size=(n, len(arms))) * arms.tilts
    commands = Commands(np.zeros((n, 6)), tilt, 600.0 + 50.0 * rng.normal(size=(n, len(rotors))))
    return actuation(vehicle, commands), Context(vehicle, state), state


def made(vehicle, name):
    """The wrenches (N, 6) of an atom's terms at coefficients of one."""
    act, context, _ = moving(vehicle)
    rotors = np.hstack((np.einsum("nr,nrk->nk", act.thrust, act.normal_B), np.zeros((5, 3))))
    atom = next(a for a in atoms(vehicle) if a.name == name)
    return atom, evaluator(constants(vehicle, 15.0))([atom], act, rotors, context)[0], act, context


def test_names_of_laws_are_different_and_say_what_python_takes():
    for vehicle in (TILTING, QUADROTOR):
        names = [a.name for a in atoms(vehicle)]
        assert len(set(names)) == len(names) > 300
        assert all(name.isidentifier() and name == name.lower() for name in names)


def test_a_force_along_the_velocity_is_parallel_to_it_and_grows_with_its_power():
    atom, (wrench,), _, context = made(TILTING, "force_v_speed_half")
    v = context.velocity_through_air_B
    speed = np.linalg.norm(v, axis=1)
    assert np.allclose(wrench[:, :3], v * np.sqrt(speed)[:, None], rtol=1e-6)
    assert np.allclose(wrench[:, 3:], np.cross(TILTING.body.com_B, wrench[:, :3]))
    assert atom.terms[0].unit == "N s^1.5/m^1.5"  # newtons over (m/s)^1.5


def test_a_share_of_all_thrusts_pushes_at_the_rotors():
    _, (wrench,), act, context = made(TILTING, "rotors_t_i_v_2")
    share = np.sum(context.velocity_through_air_B**2, axis=1)[:, None, None]
    forces = act.thrust[:, :, None] * act.normal_B * share
    assert np.allclose(wrench[:, :3], forces.sum(axis=1), rtol=1e-6)
    assert np.allclose(wrench[:, 3:], np.cross(act.hub_B, forces).sum(axis=1), rtol=1e-6)


def test_what_pulls_in_the_world_pulls_there_whatever_the_attitude():
    _, terms, _, context = made(TILTING, "force_world")
    for axis, wrench in enumerate(terms):
        assert np.allclose(so3.rotate(context.state.quat_EB, wrench[:, :3]), np.eye(3)[axis], atol=1e-9)


def test_the_wake_of_the_arms_beside():
    _, (wrench,), act, _ = made(TILTING, "wake_cos")
    arms, rotors = TILTING.geometry()
    azimuth = np.arctan2(arms.position_B[:, 1], arms.position_B[:, 0])
    expected = np.zeros((5, 3))
    for i in range(len(rotors)):
        for j in range(len(arms)):
            apart = np.abs((azimuth[j] - azimuth[rotors.arm[i]] + np.pi) % (2 * np.pi) - np.pi)
            if 0.1 < apart < 1.1:  # 60 degrees
                other = act.thrust[:, np.flatnonzero(rotors.arm == j)[0]]
                size = act.thrust[:, i] * other * np.cos(act.tilt[:, rotors.arm[i]] - act.tilt[:, j])
                expected += size[:, None] * act.normal_B[:, i]
    assert np.allclose(wrench[:, :3], expected)


def test_a_law_that_needs_no_pose_says_so_and_one_that_does_says_that():
    by_name = {a.name: a for a in atoms(TILTING)}
    assert by_name["force_v"].needs("pose")
    assert by_name["force_v"].needs("air")
    assert not by_name["torque_w"].needs("pose")
    assert by_name["tilt_rate_torque"].needs("rates")


@pytest.mark.parametrize(
    ("unit", "text"),
    [
        ((1, 0, 0, 0), "N"),
        ((1, -1, 1, 0), "N s/m"),
        ((0, 0, 0, 0), "1"),
        ((-1, 0, 0, 0), "1/N"),
        ((1, 1, 2, 0), "N m s^2"),
    ],
)
def test_units_are_written_as_engineers_write_them(unit, text):
    assert str(Unit(*unit)) == text


@pytest.mark.parametrize("vehicle", [TILTING, QUADROTOR])
def test_every_law_is_a_file_that_passes_the_checks_of_own_effects(vehicle):
    every = atoms(vehicle)
    text = source(every, constants(vehicle, 15.0), [("v", -3.0, 3.0), ("time", 0.0, 40.0)])
    assert len(loaded(text)) == len(every)
    assert "np.clip(context.velocity_through_air_B, -3, 3)" in text


def test_surrogates_have_the_spectrum_and_nothing_of_the_moment():
    class Stretch:
        dt_kept = 0.025

        def __len__(self):
            return 800

    class Data:
        records = (Stretch(),)
        by_record = Dataset.by_record

    left = np.cumsum(np.random.default_rng(1).normal(size=(800, 6)), axis=0)
    left -= left.mean(axis=0)
    found = surrogate_residuals(Data(), left, 40, seed=0)
    power = np.abs(np.fft.rfft(left, axis=0))
    assert np.allclose(np.abs(np.fft.rfft(found, axis=0)), power[:, :, None], atol=1e-6 * power.max())
    straight = [np.corrcoef(found[:, 0, k], left[:, 0])[0, 1] for k in range(40)]
    assert np.median(np.abs(straight)) < 0.7


def yaw_torque(t, position, velocity, R, omega, thrust):
    return np.zeros(3), np.array([0.0, 0.0, 0.04 * np.sin(4.0 * np.arctan2(R[1, 0], R[0, 0]))])


@pytest.fixture(scope="module")
def hidden():
    cases = [
        engine.Case(n, excited=1.0, seed=s, seconds=34.0, fast=2.0, law=yaw_torque) for n, s in (("a", 21), ("b", 22))
    ]
    return wg.open_flights(engine.fly(cases), engine.MODEL)


@pytest.fixture(scope="module")
def found(hidden):
    return wg.discover(hidden[0], engine.MODEL, validate=hidden[1])


def test_a_torque_that_turns_with_four_times_the_heading_is_found(found):
    assert found.outcome is Outcome.LAW
    law = found.laws[0]
    assert law.name == "law_torque_z_heading4"
    assert law.causes == ("heading",)
    sine, cosine = law.coefficients
    assert sine.value == pytest.approx(0.04, abs=3.0 * sine.std)
    assert sine.std < 0.004
    assert abs(cosine.value) < 0.004
    assert law.p_value <= 0.05
    assert law.gain > law.null_quantile


def test_most_of_what_was_left_goes_on_a_flight_that_was_not_fitted(found):
    assert found.held_out == "flights that were not fitted"
    assert found.energy_reduction > 0.8
    assert found.rms_after[5] < 0.3 * found.rms_before[5]


def test_an_atom_that_is_another_one_here_is_told_as_its_like():
    """Also when they become the same behind what a name, or a law found before, can say."""
    rng = np.random.default_rng(3)
    a, b, c = rng.normal(size=(3, 200))
    laws = {n: Atom(n, n, (Term(n, "", "", 1.0),)) for n in "abcd"}
    X = np.stack((a, b, 2.0 * a + 0.01 * c, c - b), axis=1)
    none, cell = np.zeros(0, int), np.zeros(200, int)
    on = Evidence(
        tuple(laws.values()), tuple(slice(k, k + 1) for k in range(4)), X, a, X[:, :0], cell, cell, cell, none, none
    )
    first = distinct(on)
    assert [x.name for x in first.atoms] == ["a", "b", "d"]
    assert first.same == {"a": (laws["c"],)}
    free_of_c = first.X - np.outer(c, c @ first.X) / (c @ c)
    second = distinct(replace(first, X=free_of_c))
    assert [x.name for x in second.atoms] == ["a", "b"]
    assert second.same == {"a": (laws["c"],), "b": (laws["d"],)}


@pytest.mark.parametrize(
    ("k", "name", "feeds"), [(1.0, "torque_w", True), (-1.0, "torque_w", False), (1.0, "torque_z_heading4", False)]
)
def test_a_torque_along_the_rates_that_never_takes_energy_is_no_law_of_theirs(hidden, k, name, feeds):
    """M . omega = k |omega|^2: damping has k < 0, and with k > 0 something else (a gust) turns the vehicle. A torque by
    the heading has its energy from elsewhere.
    """
    data = dataset(hidden[0].records, engine.MODEL)
    omega = np.concatenate([r.state_kept.omega_B for r in data.records])
    (atom,) = [a for a in atoms(QUADROTOR) if a.name == name]
    on = SimpleNamespace(data=data, given=engine.MODEL)
    blind = SimpleNamespace(
        data=replace(data, records=[replace(r, has_pose=False) for r in data.records]), given=on.given
    )
    for one in (on, blind):  # a torque's power needs no velocity
        assert Residual.feeding(one, atom, np.hstack((0.0 * omega, k * omega))) is feeds
    assert not Residual.feeding(on, atom, np.hstack((0.0 * omega, np.cross(omega, [0.0, 0.0, 1.0]))))


def test_the_file_of_a_law_is_an_effect_that_is_added(found, hidden):
    from wrenchgap.plant import effects

    with effects.registered(loaded(found.source)):
        fitted = wg.add(engine.MODEL, ["law_torque_z_heading4", *found.explanation.effects], hidden[0])
        errors = wg.compare(hidden[1], fitted, ahead=False).to_frame()
    assert len(errors)
    assert "law_torque_z_heading4" not in effects.catalogue()


def test_a_law_that_is_an_effect_already_is_found_by_another_name(found):
    """Flights are searched again with `--effects law.py`: its name is taken, which ended the search with an error."""
    from wrenchgap.plant import effects

    names = [a.name for a in atoms(QUADROTOR)]
    with effects.registered(loaded(found.source)):
        again = renamed(atoms(QUADROTOR))
        (new,) = [a for a, name in zip(again, names, strict=True) if a.name != name]
        assert new.name == "torque_z_heading4_again"
        with effects.registered(loaded(source([new], constants(QUADROTOR, 15.0), []))):
            assert {"law_torque_z_heading4", "law_torque_z_heading4_again"} <= set(effects.catalogue())
    assert [a.name for a in renamed(atoms(QUADROTOR))] == names


def test_a_coefficient_in_seconds_is_no_time_that_stamps_blur(hidden):
    """M = k T (e_z x v) has k in seconds: a sample's period over sqrt(12) is no error of it."""
    from wrenchgap.plant import effects

    laws = [a for a in atoms(QUADROTOR) if a.name == "torque_e_z_cross_v_thrust"]
    assert laws[0].terms[0].unit == "s"
    with effects.registered(loaded(source(laws, constants(QUADROTOR, 15.0), []))):
        fitted = wg.add(engine.MODEL, ["law_torque_e_z_cross_v_thrust", "body_drag", "motor_lag"], hidden[0])
    (law,) = [e for e in fitted.model.effects if e.name.startswith("law_")]
    assert law.std[0] < 0.2 / engine.RATE / np.sqrt(12.0)


def test_the_document_is_what_the_schema_says(found):
    made = document("discover", to_json(found))
    jsonschema.validate(made, schema("discover", strict=True))
    assert "sin 4 psi" in made["summary"][0]


@pytest.mark.slow
def test_a_flight_with_nothing_hidden_has_no_law():
    flight = engine.fly([engine.Case("nothing", excited=1.0, seed=23, seconds=34.0, fast=2.0)])
    found = wg.discover(wg.open_flights(flight, engine.MODEL), engine.MODEL)
    assert found.outcome is not Outcome.LAW
    assert not found.source


def test_the_next_command_adds_what_was_named_with_the_law_and_quotes_what_users_call_things(found):
    options = " --shift imu=0.02 --effects own.py"
    (line, *_) = what_next(found, "my model.toml", ["a; b.mcap"], "law.py", options, " --effects own.py")
    words = shlex.split(line.text)
    names = words[words.index("add") + 1 : words.index("-m")]
    assert names == [*found.explanation.effects, *(law.name for law in found.laws)]
    assert "my model.toml" in words
    assert "a; b.mcap" in words
    assert "imu=0.02" in words  # else it would fit other numbers
    assert [words[k + 1] for k, word in enumerate(words) if word == "--effects"] == ["own.py", "law.py"]


def test_without_a_law_or_its_file_there_is_a_next_command_too(found):
    (line,) = what_next(found, "m.toml", ["a.mcap"], None)
    assert line.text == "next: wrenchgap discover -m m.toml a.mcap -o law.py"
    (line,) = what_next(replace(found, laws=()), "m.toml", ["a.mcap"], "law.py", " --cutoff 7")
    assert line.text == "next: wrenchgap where -m m.toml a.mcap --cutoff 7"


def test_the_page_shows_the_law_and_what_it_leaves(found):
    controls = SimpleNamespace(answer=SimpleNamespace(content=""), save=SimpleNamespace(visible=False), source="")
    LawControls._found(controls, found)
    assert found.laws[0].formula in unescape(controls.answer.content)
    assert controls.answer.content.count('<img src="data:image/svg+xml') == 1
    assert controls.save.visible
    LawControls._found(controls, replace(found, laws=(), source=""))
    assert "<img" not in controls.answer.content
    assert not controls.save.visible


def test_every_coefficient_has_the_unit_that_makes_newtons():
    """In other units of force, length, time and voltage every law makes the same wrench: dimensional analysis."""
    for vehicle in (TILTING, QUADROTOR):
        every = atoms(vehicle)
        scales = {"N": 3.0, "m": 0.7, "s": 1.9, "V": 1.3}
        first, second = (terms_in(vehicle, every, by) for by in ({}, scales))
        for atom, one, other in zip(every, first, second, strict=True):
            for term, a, b in zip(atom.terms, one, other, strict=True):
                k = np.prod([scales[symbol] ** p for symbol, p in powers_of(term.unit)])
                newtons = np.repeat([scales["N"], scales["N"] * scales["m"]], 3)
                assert np.allclose(k * b, newtons * a, rtol=1e-6, atol=1e-9 * np.abs(a).max()), atom.name


def powers_of(unit):
    """Symbols and powers of a unit as it is written: "N s^1.5/m^1.5"."""
    over, *under = unit.split("/")
    for sign, parts in ((1.0, over.split()), (-1.0, under)):
        for part in parts:
            symbol, _, p = part.partition("^")
            if symbol != "1":
                yield symbol, sign * float(p or 1.0)


def terms_in(vehicle, every, by):
    """The wrenches of all terms, everything measured in units that are so many times smaller."""
    N, m, s, volt = (by.get(symbol, 1.0) for symbol in ("N", "m", "s", "V"))
    act, context, state = moving(vehicle)
    thrust = N * act.thrust
    actuation = SimpleNamespace(
        thrust=thrust,
        normal_B=act.normal_B,
        hub_B=m * act.hub_B,
        tilt=act.tilt,
        tilt_rate=np.cos(act.tilt) / s,
        tilt_acceleration=np.sin(3.0 * act.tilt) / s**2,
    )
    moved = replace(
        state,
        time=s * state.time,
        position_E=m * state.position_E,
        velocity_E=m / s * state.velocity_E,
        omega_B=state.omega_B / s,
        voltage=volt * np.linspace(14.0, 16.0, len(state.time)),
    )
    arms, rotors = vehicle.geometry()
    measured = SimpleNamespace(
        body=SimpleNamespace(com_B=m * np.array([0.01, -0.02, 0.03])),
        rotors=rotors,
        arms=SimpleNamespace(position_B=m * arms.position_B, axis_B=arms.axis_B),
    )
    seen = SimpleNamespace(vehicle=measured, state=moved, velocity_through_air_B=m / s * context.velocity_through_air_B)
    wrench = np.hstack((N * np.sin(np.arange(15.0)).reshape(5, 3), N * m * np.cos(np.arange(15.0)).reshape(5, 3)))
    numbers = {"SPAN": repr(m * 0.3), "VOLTS": repr(volt * 15.0)}
    return evaluator(numbers)(every, actuation, wrench, seen)
