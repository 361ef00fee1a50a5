"""The field's bookkeeping: cases, judging, scores, sensors, model files. What RotorPy flies: test_field_rotorpy."""

import ast
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the tilting hexarotor's engine needs MuJoCo (a development dependency)")

from benchmarks.field import cases, hexarotor
from benchmarks.field.__main__ import main
from benchmarks.field.cases import Case
from benchmarks.field.flying import RATE, gusts
from benchmarks.field.judge import class_sets, firm_names, judged
from benchmarks.field.score import calibration, detail, page, score
from benchmarks.field.sensors import IMUS, measured
from benchmarks.field.told import Told
from benchmarks.field.vehicles import VEHICLES, vehicle
from wrenchgap import open_flights
from wrenchgap.plant import model_file
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.state import Commands


def names(*words):
    return frozenset(words)


def answer(effects=(), groups=(), verdict="effect", p=0.95, **more):
    members = [SimpleNamespace(name=e) for e in effects]
    groups = [tuple(g) for g in groups]
    fields = {"verdict": verdict, "effects": tuple(effects), "members": members, "groups": groups}
    return SimpleNamespace(**fields, confidence=lambda m: p, **more)


def told(*answers, anyway=(), near=(), amplitudes=None):
    return Told(
        tuple(tuple(frozenset(s.split()) for s in a) for a in answers), names(*anyway), names(*near), amplitudes
    )


PARCEL = ("payload", "mass com_offset")


def test_vehicles_kinds_and_sensors_that_the_issue_asks_for_are_there():
    field = list(cases.everything(cases.PUBLISHED))
    assert {c.vehicle for c in field} == set(VEHICLES)
    assert {c.flying for c in field} >= {"excited", "mission", "turbulence"}
    assert {c.imu for c in field} == set(IMUS)
    assert {len(c.effects) for c in field} == {0, 1, 2, 3, 4, 5}
    assert len({c.name for c in field}) == len(field) <= 90


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            yield node.module or ""
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names)


def test_what_flies_shares_no_code_with_what_it_judges():
    folder = Path(cases.__file__).parent
    for name in ("truth", "craft", "pilot", "flying", "engine", "sensors", "hidden", "outside", "oracle", "hexarotor"):
        ours = [m for m in imported(folder / f"{name}.py") if m.startswith("wrenchgap")]
        assert all(m.startswith("wrenchgap.flight.") for m in ours), name


def test_tuning_and_published_flights_share_no_seed():
    tuning, published = ({c.seed for c in cases.everything(s)} for s in (cases.TUNING, cases.PUBLISHED))
    assert not tuning & published


@pytest.mark.parametrize(
    ("effects", "groups", "right"),
    [
        (("payload",), (), True),
        (("com_offset", "mass"), (), True),
        (("com_offset", "thrust_scale"), (("thrust_scale", "mass"),), True),
        (("com_offset",), (), False),
        (("payload", "wind"), (), False),
        ((), (), False),
    ],
)
def test_the_true_set_may_be_said_in_other_words_but_in_full_and_alone(effects, groups, right):
    assert judged(answer(effects, groups), told(PARCEL), "one")["in_class"] is right


def test_two_forms_of_one_effect_are_one_name():
    found = judged(answer(("asymmetric_motor_lag",)), told(("motor_lag",)), "one")
    assert found["in_class"]
    assert not found["firm_wrong"]


def test_what_the_vehicle_has_anyway_neither_harms_nor_counts():
    found = judged(answer(("servo_lag",)), told(anyway=("servo_lag",)), "none")
    assert found["firm_wrong"] == found["named_beside"] == []
    assert judged(answer(("servo_lag", "payload")), told(PARCEL, anyway=("servo_lag",)), "one")["in_class"]


def test_a_confidence_speaks_for_a_name_or_its_group_and_a_firm_name_for_itself():
    grouped = {"effects": ("coaxial_loss",), "groups": (("coaxial_loss", "com_offset + mass"),)}
    stated = judged(answer(**grouped), told(PARCEL), "one")
    assert stated["stated"] == [["coaxial_loss", 0.95, True]]
    assert stated["firm_wrong"] == []
    assert stated["in_class"]
    assert judged(answer(**grouped, firm=("coaxial_loss",)), told(PARCEL), "one")["firm_wrong"] == ["coaxial_loss"]


def test_a_bias_of_the_imu_may_be_put_into_words_but_not_firmly():
    found = judged(answer(("payload", "constant_wrench")), told(PARCEL), "one")
    assert found["in_class"]
    assert found["firm_wrong"] == ["constant_wrench"]


def test_a_firm_name_is_wrong_where_it_is_not_there_and_stated_firmly():
    assert judged(answer(("wind",)), told(PARCEL), "one")["firm_wrong"] == ["wind"]
    assert judged(answer(("wind",), p=0.6), told(PARCEL), "one")["firm_wrong"] == []
    assert judged(answer(("mass",)), told((), near=("mass",)), "outside")["firm_wrong"] == []


def test_an_answer_that_says_what_is_firm_and_its_classes_is_believed():
    def one(effects, weight):
        return SimpleNamespace(effects=effects, weight=weight)

    light = SimpleNamespace(weight=0.2, sets=(one(("wind",), 0.2),))
    named = SimpleNamespace(names=("mass", "com_offset"), weight=0.3)
    heavy = SimpleNamespace(weight=0.8, sets=(one(("payload",), 0.5), named))
    found = answer(("payload",), p=0.5, firm=("payload",), classes=(light, heavy))
    assert firm_names(found) == ("payload",)
    assert list(class_sets(found)) == [names("payload"), names("mass", "com_offset")]


def test_whether_it_could_be_told_is_asked_of_the_weakest_effect():
    two = (PARCEL, ("wind",))
    assert judged(answer(), told(*two, amplitudes=(50.0, 6.0)), "several")["told"]
    assert not judged(answer(), told(*two, amplitudes=(50.0, 4.0)), "several")["told"]
    assert judged(answer(), told(*two), "several")["told"] is None


def rows():
    base = {"vehicle": "quad", "flying": "excited", "imu": "good", "cpu_per_minute": 9.0}
    good = judged(answer(("payload",)), told(PARCEL, amplitudes=(9.0,)), "one")
    bad = judged(answer(("wind",), p=0.85), told(PARCEL, amplitudes=(9.0,)), "one")
    blind = judged(answer(()), told(PARCEL, amplitudes=(2.0,)), "one")
    none = judged(answer((), verdict="nothing"), told(), "none")
    alarm = judged(answer(("mass",)), told(), "none")
    outside = judged(answer((), verdict="unknown"), told(()), "outside")
    kinds = zip((good, bad, blind, none, alarm, outside), ("one",) * 3 + ("none",) * 2 + ("outside",), strict=True)
    return [{**base, **row, "kind": kind, "case": f"case{k}"} for k, (row, kind) in enumerate(kinds)]


def test_scores_count_what_the_issue_asks_for():
    s = score([*rows(), {"case": "lost", "kind": "one", "error": "lost"}])
    assert s["true_in_class"] == {"share": 0.5, "of": 2}  # the third could not be told
    assert s["true_in_class_all"]["of"] == 3
    assert s["firm_wrong"] == s["stated_wrong"] == {"share": 0.6667, "of": 3}
    assert s["none_nothing"]["share"] == s["none_firm"]["share"] == 0.5
    assert s["outside_unknown"]["share"] == 1.0
    assert s["errors"] == ["lost"]


def test_confidence_is_compared_with_truth_bin_by_bin():
    bins = calibration([{"stated": [["a", 0.95, True], ["b", 0.93, False], ["c", 0.3, False]]}])
    assert [(b["bin"], b["names"], b["true"]) for b in bins] == [("0-50 %", 1, 0.0), ("90-100 %", 2, 0.5)]


def test_the_pages_show_every_flight_and_keep_what_was_written_by_hand():
    text, listed = page(rows(), 79, "By hand.\n"), detail(rows(), "By hand.\n")
    assert all(row["case"] in listed for row in rows())
    assert "6 of 79 flights" in text
    assert text.endswith("By hand.\n")
    assert listed.endswith("By hand.\n")


@pytest.mark.parametrize("name", [n for n in VEHICLES if n not in ("hexa", "blind")])
def test_model_file_and_engine_believe_the_same_wrench_of_every_rotor(name):
    craft = vehicle(name)
    model = craft.model.vehicle
    body = model.body
    assert body.mass == craft.mass
    np.testing.assert_allclose(np.diag(body.inertia), craft.inertia)
    for rotor in range(craft.rotors):
        speed = np.zeros((1, craft.rotors))
        speed[0, rotor] = craft.hover_speed
        commands = Commands(np.zeros((1, 6)), tilt=np.zeros((1, len(model.geometry()[0]))), rotor_speed=speed)
        wrench = nominal_wrench(model, commands)[0]
        thrust = craft.k_eta * craft.hover_speed**2
        np.testing.assert_allclose(wrench[2:], craft.allocation()[:, rotor] * thrust, atol=1e-9)
        np.testing.assert_allclose(wrench[:2], 0.0, atol=1e-12)


def test_gusts_have_the_rms_and_the_correlation_time_that_are_asked_for():
    air = gusts(np.arange(200_000) / RATE, 1.5, 0.5, np.random.default_rng(1))
    assert air.std() == pytest.approx(1.5, rel=0.06)
    later = round(0.5 * RATE)
    assert np.mean(air[later:] * air[:-later]) / air.var() == pytest.approx(np.exp(-1.0), abs=0.06)


@pytest.fixture(scope="module")
def hovering():
    return hexarotor.flown(Case("hexa", "turbulence", "good", "none", seed=7, seconds=4.0))


def test_turbulence_moves_the_hexarotor_and_carries_its_weight(hovering):
    force = 4.0 * hovering.imu.specific_force_B[200:]
    assert force[:, 2].mean() == pytest.approx(4.0 * 9.80665, rel=0.02)
    assert hovering.imu.omega_B[200:].std() > 3 * IMUS["good"].per_sample(RATE)[0]


@pytest.mark.parametrize("grade", list(IMUS))
def test_sensors_have_the_noise_that_their_datasheet_says(hovering, grade):
    noisy = measured(hovering, grade, 3)
    added = noisy.imu.specific_force_B - hovering.imu.specific_force_B
    gyro, accelerometer = IMUS[grade].per_sample(RATE)
    assert added.std(axis=0).mean() == pytest.approx(accelerometer, rel=0.06)
    assert (noisy.imu.omega_B - hovering.imu.omega_B).std(axis=0).mean() == pytest.approx(gyro, rel=0.06)
    assert np.abs(added.mean(axis=0)).max() < 4 * IMUS[grade].accelerometer_bias + accelerometer
    assert noisy.content_hash != hovering.content_hash


@pytest.mark.slow
def test_an_interrupted_run_goes_on_where_it_was_and_the_page_follows(tmp_path, capsys):
    json_file, page_file, note_file = (tmp_path / name for name in ("field.json", "field.md", "notes.md"))
    asked = ["--seed", "7000", "--only", "hexa.turbulence.good.none", "--seconds", "6", "--jobs", "1"]
    main([*asked, "--json", str(json_file)])
    first = json.loads(json_file.read_text())
    assert [row["vehicle"] for row in first["rows"]] == ["hexa"]
    assert first["scores"]["errors"] == []
    capsys.readouterr()
    main([*asked, "--json", str(json_file), "--page", str(page_file), "--notes", str(note_file)])
    assert "hexa.turbulence" not in capsys.readouterr().out
    assert json.loads(json_file.read_text()) == first
    assert "1 of 79 flights" in page_file.read_text()
    assert first["rows"][0]["case"] in note_file.read_text()


def test_flights_are_written_for_the_command_line(tmp_path):
    main(["--seed", "7000", "--only", "hexa.mission.cheap.none", "--seconds", "3", "--logs", str(tmp_path)])
    truth = json.loads((tmp_path / "truth.json").read_text())
    (name,) = truth
    opened = open_flights(tmp_path / f"{name}.mcap", model_file.load(tmp_path / "tilt_hexarotor.toml"))
    assert truth[name]["kind"] == "none"
    assert opened[0].records
