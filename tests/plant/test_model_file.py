"""Model files: read whole, wrong keys named, comments kept, effects round-tripped."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant import model_file
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.effects import catalogue
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.plant.wrench_model import Provenance

TEXT = """# my vehicle
schema = 1
[vehicle]
name = "mine"
mass = 2.0            # weighed on Tuesday
inertia = [0.02, 0.02, 0.04]
[vehicle.arm]
length = 0.2
[vehicle.rotor]
c_f = 8e-6
kappa = 0.016
radius = 0.1
speed_max = 1100.0
[[vehicle.arms]]
azimuth_deg = 45.0
rotors = [{ spin = 1 }]
[[vehicle.arms]]
azimuth_deg = 135.0
rotors = [{ spin = -1 }]
[[vehicle.arms]]
azimuth_deg = 225.0
rotors = [{ spin = 1 }]
[[vehicle.arms]]
position = [0.15, -0.14, 0.0]
tilts = false
rotors = [{ spin = -1, c_f = 9e-6 }]
"""


def test_reads_geometry_and_defaults():
    vehicle = model_file.loads(TEXT).vehicle
    np.testing.assert_allclose(vehicle.arms.position_B[0], 0.2 * np.array([np.sqrt(0.5), np.sqrt(0.5), 0]))
    np.testing.assert_allclose(vehicle.arms.position_B[3], [0.15, -0.14, 0])
    assert vehicle.arms.tilts.tolist() == [True, True, True, False]
    assert vehicle.rotors.c_f.tolist() == [8e-6, 8e-6, 8e-6, 9e-6]
    assert vehicle.rotors.speed_min.tolist() == [0.0] * 4


def test_wrench_only_vehicle_needs_no_arms():
    vehicle = model_file.loads("schema = 1\n[vehicle]\nname = 'w'\nmass = 1.0\ninertia = [1.0, 1.0, 1.0]\n").vehicle
    assert not vehicle.has_rotors
    with pytest.raises(ModelError, match="arms"):
        vehicle.geometry()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass = 2.0 ", "mass = -2.0 ", "mass"),
        ("mass = 2.0 ", "mass = nan ", "vehicle.mass"),
        ("mass = 2.0 ", "", "vehicle.mass: is missing"),
        ("schema = 1", "schema = 7", "schema"),
        ("inertia = [0.02, 0.02, 0.04]", "inertia = [0.02, -0.02, 0.04]", "inertia"),
        ("spin = 1 }]", "spin = 2 }]", "spin"),
        ("c_f = 8e-6", "c_f = 0", "c_f"),
        ("[vehicle]\n", "[vehicle\n", "TOML"),
        ("length = 0.2", "", "length"),
        ("radius = 0.1", "radius = -0.1", r"vehicle\.rotor\.radius: got -0\.1, expected a positive number"),
        ("spin = -1, c_f", "spin = -1, cf", r"vehicle\.arms\[3\]\.rotors\[0\]\.cf: .* did you mean 'c_f'"),
        ("tilts = false", "tilt_axis = [0, 0, 0]", r"vehicle\.arms\[3\]\.tilt_axis: has no direction"),
        ("0.02, 0.02, 0.04]", "0.02, 0.02, 0.09]", r"vehicle\.inertia: no body has"),
    ],
)
def test_says_what_is_wrong_in_one_line(old, new, message):
    assert old in TEXT
    with pytest.raises(ModelError, match=message) as caught:
        model_file.loads(TEXT.replace(old, new, 1))
    assert "\n" not in str(caught.value)


def test_unknown_names_list_the_known_ones():
    with pytest.raises(ModelError, match=r"vehicle\.wings.*mass"):
        model_file.loads(TEXT.replace("mass = 2.0", "wings = 2\nmass = 2.0", 1))
    with pytest.raises(ModelError, match=r"'gremlins'.*com_offset"):
        model_file.loads(TEXT + "[[effects]]\nname = 'gremlins'\n[effects.parameters]\nx = 1.0\n")
    with pytest.raises(ModelError, match="tilt_hexarotor"):
        model_file.load("no_such_vehicle")


def test_effects_survive_a_round_trip_with_comments(tmp_path):
    model = model_file.loads(TEXT)
    effect = make_effect(model.vehicle, "com_offset", {"x": 0.001, "z": -0.0025})
    source = Provenance((("flight one.mcap", "ab" * 32),), "2026-11-21T00:00:00Z", "0.1.0", 'joint "fit"')
    effect = replace(effect, std=np.array([1e-4, 2e-4, 3e-4]), provenance=source)
    saved = model_file.save(model.with_effects([effect]), tmp_path / "m.toml")
    text = (tmp_path / "m.toml").read_text()
    assert "# weighed on Tuesday" in text
    again = model_file.load(tmp_path / "m.toml")
    assert again.effects[0].name == "com_offset"
    np.testing.assert_allclose(again.effects[0].theta, [0.001, 0, -0.0025])
    np.testing.assert_allclose(again.effects[0].std, [1e-4, 2e-4, 3e-4])
    assert again.effects[0].provenance == source
    assert model_file.content_hash(again) == model_file.content_hash(saved)
    assert model_file.dumps(again.without(["com_offset"])).strip() == TEXT.strip()


def test_model_made_in_code_can_be_written():
    shipped = model_file.load("tilt_hexarotor")
    again = model_file.loads(model_file.dumps(replace(shipped, text="")))
    np.testing.assert_allclose(again.vehicle.arms.axis_B, shipped.vehicle.arms.axis_B, atol=1e-12)
    np.testing.assert_allclose(again.vehicle.rotors.spin, shipped.vehicle.rotors.spin)
    assert again.controller == shipped.controller
    assert dict(again.topics) == dict(shipped.topics)


def test_never_overwrites_without_force(tmp_path):
    path = tmp_path / "m.toml"
    path.write_text("precious")
    model = model_file.loads(TEXT)
    with pytest.raises(UsageError, match="--force"):
        model_file.save(model, path)
    assert path.read_text() == "precious"
    model_file.save(model, path, force=True)
    assert "precious" not in path.read_text()
    assert [p.name for p in tmp_path.iterdir()] == ["m.toml"]


@pytest.mark.parametrize("name", model_file.shipped_models())
def test_shipped_models_are_usable(name):
    model = model_file.load(name)
    assert model.vehicle.body.mass > 0
    if model.vehicle.has_rotors:
        hover = np.array([[0, 0, model.vehicle.body.mass * GRAVITY, 0, 0, 0]])
        _, saturation = Allocation(model.vehicle).allocate(hover)
        assert saturation.rotor_speed == 0


def test_two_effects_of_one_name_and_removing_what_is_not_there_are_refused():
    model = model_file.loads(TEXT)
    effect = make_effect(model.vehicle, "com_offset", [0, 0, 0.001])
    with pytest.raises(ModelError, match="twice"):
        model.with_effects([effect, effect])
    with pytest.raises(ModelError, match="none"):
        model.without(["com_offset"])


def named(text=TEXT):
    """The second rotor and the last arm have names."""
    text = text.replace("rotors = [{ spin = -1 }]", 'rotors = [{ name = "M3", spin = -1 }]', 1)
    return text.replace("tilts = false", 'tilts = false\nname = "rear right"', 1)


def test_rotors_and_arms_are_called_as_the_user_calls_them():
    vehicle = model_file.loads(named()).vehicle
    assert [vehicle.rotor_name(r) for r in range(4)] == ["rotor_0", "M3", "rotor_2", "rotor_3"]
    assert [vehicle.arm_name(i) for i in range(4)] == ["arm_0", "arm_1", "arm_2", "rear right"]
    assert [vehicle.called(name) for name in ("rotor_1", "arm_3", "rotor_2", "twist", "rotor_9")] == [
        *("M3", "rear right", "rotor_2", "twist", "rotor_9")
    ]


def test_without_names_rotors_are_called_as_autopilots_count():
    vehicle = model_file.loads(TEXT).vehicle
    assert (vehicle.rotor_name(1), vehicle.arm_name(0), vehicle.called("rotor_1")) == ("M2", "arm_0", "M2")
    assert (vehicle.rotor_names, vehicle.arm_names) == ((), ())


def test_names_survive_writing():
    model = model_file.loads(named())
    for text in (model_file.dumps(model), model_file.dumps(replace(model, text=""))):
        again = model_file.loads(text).vehicle
        assert (again.rotor_names, again.arm_names) == (("", "M3", "", ""), ("", "", "", "rear right"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"M3"', '""', r"vehicle\.arms\[1\]\.rotors\[0\]\.name: got '', expected a name: printable text"),
        ('"M3"', '"  "', "expected a name"),
        ('"M3"', '"M\\n3"', "expected a name"),
        ('"M3"', "3", "got 3, expected a name"),
        ('"rear right"', '"M3"', r"arms\[1\]\.rotors\[0\] and arms\[3\] are both called 'M3'"),
        ('"M3"', '"rotor_0"', "are both called 'rotor_0'"),
        ("{ spin = 1 }", '{ name = "M3", spin = 1 }', "are both called 'M3'"),
    ],
)
def test_a_name_that_names_nothing_is_refused(old, new, message):
    assert old in named()
    with pytest.raises(ModelError, match=message) as caught:
        model_file.loads(named().replace(old, new, 1))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("c_f = 7.2e-6", "c_f = 1e-320"), "expected a positive number, from 1e-15"),
        (("c_f = 7.2e-6", "c_f = 1e300"), "expected a positive number, from 1e-15"),
        (("c_f = 7.2e-6", "c_f = 1e11"), "its full thrust, c_f speed_max"),
        (("inertia = [0.1035, 0.1045, 0.1914]", "inertia = [1e-300, 1e-300, 1e-300]"), "a principal moment is 1e-300"),
        (("mass = 4.0", "mass = 1e308"), "expected a positive number, from 1e-15"),
    ],
)
def test_numbers_that_no_vehicle_has_are_refused(tmp_path, change, words):
    """They ended as commands that were no numbers."""
    text = (Path(__file__).parents[2] / "models" / "tilt_hexarotor.toml").read_text()
    assert change[0] in text
    (tmp_path / "odd.toml").write_text(text.replace(*change))
    with pytest.raises(ModelError, match=words):
        model_file.load(tmp_path / "odd.toml")


def with_effect(name, parameters):
    return f'{TEXT}\n[[effects]]\nname = "{name}"\n[effects.parameters]\n{parameters}\n'


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        ("mass", 'added = { value = 10.0, unit = "g" }', r"added\.unit: got 'g', expected 'kg' \(mass\)"),
        (
            "mass",
            "added = { value = 0.1, std = -1.0 }",
            r"added\.std: got -1\.0, expected a number that is not negative",
        ),
        ("motor_lag", "tau = -0.1", r"tau\.value: got -0\.1, expected 0 to 3 s \(motor_lag on this vehicle\)"),
        ("command_delay", "delay = { value = 1e5 }", r"delay\.value: got 100000, expected 0 to 2 s \(command_delay"),
    ],
)
def test_a_parameter_has_its_unit_and_a_size_that_a_vehicle_has(name, parameters, words):
    """Millimetres were read as metres, and a delay of a day took the memory of the machine."""
    with pytest.raises(ModelError, match=r"^effects\[0\]\.parameters\." + words):
        model_file.loads(with_effect(name, parameters))


def test_every_value_within_its_range_is_read_as_a_tolerance_is():
    """Also where the file knows a number more closely since."""
    vehicle = model_file.loads(TEXT).vehicle
    told = TEXT.replace("mass = 2.0 ", "mass = { value = 2.0, tolerance = 1e-3 } ")
    for name, effect in catalogue().items():
        try:
            known = effect.parameters(vehicle)
        except ModelError:  # needs another vehicle
            continue
        for values in ([p.low for p in known], [p.high for p in known], [0.0] * len(known)):
            model = model_file.loads(told).with_effects((make_effect(vehicle, name, values),))
            assert model_file.loads(model_file.dumps(model)).effect(name).theta == pytest.approx(values)


def test_a_mark_of_byte_order_is_no_key(tmp_path):
    """Notepad writes one."""
    (tmp_path / "bom.toml").write_text(TEXT, encoding="utf-8-sig")
    assert model_file.load(tmp_path / "bom.toml").text == TEXT


def test_json_is_said_to_be_json():
    with pytest.raises(ModelError, match="is not TOML: it looks like JSON"):
        model_file.loads('{"schema": 1}')


@pytest.mark.parametrize("moments", ["[1e308, 1e308, 1e308]", "[nan, 1.0, 1.0]"])
def test_moments_that_are_no_numbers_are_said_to_be_none(moments):
    with pytest.raises(ModelError, match=r"expected three finite numbers .* of a size up to 1e12"):
        model_file.loads(TEXT.replace("[0.02, 0.02, 0.04]", moments))
