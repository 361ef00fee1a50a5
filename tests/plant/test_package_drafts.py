"""Parameters of RotorPy and drone-models as models: their equations by hand, the packages themselves, nasty files."""

import importlib
import importlib.util
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant.drafts.rotorpy import LONGEST, constants
from wrenchgap.plant.drafts.sources import Given, draft_of_source
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.rigid_body import unpack
from wrenchgap.plant.state import Commands
from wrenchgap.plant.targets.quantities import values_of
from wrenchgap.plant.targets.written import written
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.plant.wrench_model import about_com

RNG = np.random.default_rng(31)
DIGITS = 1e-5
"""Relative: a drafted model file has six digits."""

QUAD_PARAMS = '''"""A quadrotor, as RotorPy's own files have one."""
import numpy as np

d = 0.2  # arm

quad_params = {
    'mass': 0.6,
    'Ixx': 4e-3, 'Iyy': 5.0e-3, 'Izz': 7e-3, 'Ixy': 1e-4, 'Iyz': 0.0, 'Ixz': -2e-4,
    'num_rotors': 4,
    'rotor_radius': 0.1,
    'rotor_pos': {
        'r1': d*np.array([ 0.7, 0.7, 0.1]), 'r2': d*np.array([ 0.7,-0.7, 0]),
        'r3': d*np.array([-0.7,-0.7, 0]),   'r4': d/2*np.array([-1.2, 1.4, 0]),
    },
    'rotor_directions': np.array([1,-1,1,-1]),
    'rI': np.array([0.01, 0, -0.02]),
    'c_Dx': 0.5e-2, 'c_Dy': 0.7e-2, 'c_Dz': 1e-2,
    'k_eta': 5.5e-06, 'k_m': 1.3e-07, 'k_d': 1.2e-04, 'k_z': 2.3e-04, 'k_h': 3.4e-3, 'k_flap': 0.0,
    'tau_m': 0.04, 'rotor_speed_min': 100, 'rotor_speed_max': 1500, 'motor_noise_std': 0.0,
    'k_w': 1,
}
'''
CURVED = """
gravity_vec = [0.0, 0.0, -9.81]
mass = 0.04338
L = 0.035
J = [[25e-6, 0.0, 0.0], [0.0, 28e-6, 0.0], [0.0, 0.0, 49e-6]]
rpm2thrust = [0.0, -3.1e-7, 4.4e-10]
rpm2torque = [0.0, 1.6e-9, 2.5e-12]
rotor_dyn_coef = [14.0, 1.1e-4, 6.0, 3.2e-4]
mixing_matrix = [[-1.0, -1.0, 1.0, 1.0], [-1.0, 1.0, 1.0, -1.0], [-1.0, 1.0, -1.0, 1.0]]
drag_matrix = [[-0.0215, 0.0, 0.0], [0.0, -0.0205, 0.0], [0.0, 0.0, -0.0236]]
prop_radius = 27.5e-3
"""


def read(path, text=None, **given):
    if text is not None:
        path.write_text(text)
    return wg.draft_model(path, given=Given(**given)).model


def wrench(model, speeds, velocity_B, rates):
    """Wrenches (N, 6) about the centre of mass, in the air and level."""
    n = len(speeds)
    y = np.concatenate((np.tile([0.0, 0.0, 1000.0, 1.0, 0.0, 0.0, 0.0], (n, 1)), velocity_B, rates), axis=1)
    sent = Commands(np.zeros((n, 6)), np.zeros((n, len(speeds[0]))), speeds)
    acting = model.wrench_model
    return about_com(acting.body, acting.wrench(sent, unpack(np.zeros(n), y)))


def states(n=40):
    return RNG.normal(0.0, 4.0, (n, 3)), RNG.normal(0.0, 3.0, (n, 3))


def check_wrench(found, expected):
    """Each axis to `DIGITS` of the largest force or torque."""
    for part in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(found[:, part], expected[:, part], atol=DIGITS * np.abs(expected[:, part]).max())


def test_quad_params_fly_by_rotorpys_equations(tmp_path):
    """Folk, Paulos and Kumar, arXiv:2306.04485: each term by hand, about the centre of mass."""
    model = read(tmp_path / "quad.py", QUAD_PARAMS)
    velocity, rates = states()
    speeds = RNG.uniform(200.0, 1200.0, (len(rates), 4))
    arms = 0.2 * np.array([[0.7, 0.7, 0.1], [0.7, -0.7, 0.0], [-0.7, -0.7, 0.0], [-0.6, 0.7, 0.0]])
    at_hub = velocity[:, None] + np.cross(rates[:, None], arms)
    force = -speeds[..., None] * at_hub * [1.2e-4, 1.2e-4, 2.3e-4]
    force[..., 2] += 5.5e-6 * speeds**2 + 3.4e-3 * (at_hub[..., :2] ** 2).sum(axis=-1)
    hull = -np.linalg.norm(velocity, axis=1, keepdims=True) * velocity * [0.5e-2, 0.7e-2, 1e-2]
    torque = np.cross(arms, force).sum(axis=1)
    torque[:, 2] += 1.3e-7 * speeds**2 @ [1.0, -1.0, 1.0, -1.0]
    check_wrench(wrench(model, speeds, velocity, rates), np.hstack((force.sum(axis=1) + hull, torque)))
    vehicle, (_, rotors) = model.vehicle, model.vehicle.geometry()
    expected = [[4e-3, 1e-4, -2e-4], [1e-4, 5e-3, 0.0], [-2e-4, 0.0, 7e-3]]
    np.testing.assert_allclose(vehicle.body.inertia, expected, rtol=1e-6)
    np.testing.assert_allclose(vehicle.imu_position_B, [0.01, 0.0, -0.02])
    np.testing.assert_allclose(values_of(model, model.effects)["lag"], 0.04, rtol=1e-6)
    assert (vehicle.body.mass, set(rotors.speed_min), set(rotors.speed_max), set(rotors.radius)) == (
        0.6,
        {100.0},
        {1500.0},
        {0.1},
    )


def test_what_is_no_vehicle_is_said(tmp_path):
    (tmp_path / "quad.py").write_text(QUAD_PARAMS)
    notes = " ".join(draft_of_source(tmp_path / "quad.py", Given()).notes)
    assert "nothing of the kind: k_w." in notes  # a gain of its controller
    assert "k_flap" not in notes  # zero


def test_a_drone_flies_by_its_parabolas(tmp_path):
    """Thrust and torque of drone-models' polynomials in revolutions a minute, drag by its matrix."""
    model = read(tmp_path / "drone.toml", CURVED)
    velocity, rates = states()
    rpm = RNG.uniform(6000.0, 20000.0, (len(rates), 4))
    thrust, torque = -3.1e-7 * rpm + 4.4e-10 * rpm**2, 1.6e-9 * rpm + 2.5e-12 * rpm**2
    about_x, about_y, about_z = np.array([[-1, -1, 1, 1], [-1, 1, 1, -1], [-1, 1, -1, 1]])
    expected = np.zeros((len(rpm), 6))
    expected[:, :3] = -velocity * [0.0215, 0.0205, 0.0236]
    expected[:, 2] += thrust.sum(axis=1)
    expected[:, 3:] = np.stack((0.035 * thrust @ about_x, 0.035 * thrust @ about_y, torque @ about_z), axis=1)
    check_wrench(wrench(model, rpm * np.pi / 30.0, velocity, rates), expected)


def test_a_drones_rotors_answer_in_hover_as_its_rates_say(tmp_path):
    """dn/dt = a (u - n) + b (u^2 - n^2), for small steps about hover."""
    model = read(tmp_path / "drone.toml", CURVED)
    weight = 0.04338 * GRAVITY / 4
    hover = max(np.roots([4.4e-10, -3.1e-7, -weight]))
    steps = np.array([1.0, -1.0])
    a, b = np.array([14.0, 6.0]), np.array([1.1e-4, 3.2e-4])
    rates = (a * steps + b * ((hover + steps) ** 2 - hover**2)) / steps
    np.testing.assert_allclose(values_of(model, model.effects)["lag"], 1.0 / rates, rtol=1e-3)


def test_a_heavier_drone_has_the_same_rotors(tmp_path):
    """The curve is about hover, which goes with the mass; the rotor does not."""
    light, heavy = (read(tmp_path / "drone.toml", CURVED, mass=mass) for mass in (0.04338, 0.06))
    speeds = RNG.uniform(900.0, 2000.0, (20, 4))
    still = np.zeros((20, 3))
    check_wrench(wrench(heavy, speeds, still, still), wrench(light, speeds, still, still))
    assert heavy.vehicle.body.mass == 0.06


@pytest.fixture
def identified():
    """The Crazyflie with what RotorPy and drone-models can say, its centre of mass off the origin."""
    model = wg.load_model("crazyflie")
    body = replace(model.vehicle.body, com_B=np.array([0.001, -0.0005, 0.002]))
    model = replace(model, path=None, vehicle=replace(model.vehicle, body=body))
    values = {
        "mass": {"added": 0.002},
        "drag_torque": {"change": 0.3},
        "thrust_scale": {"scale": 0.05},
        "rotor_drag": {"coefficient": 1e-6},
    }
    return model.with_effects([make_effect(model.vehicle, name, given) for name, given in values.items()])


def returned(model, target, path):
    path.write_text(written(model, target).text)
    return read(path)


def check_same(model, again):
    """Two models with the same wrench about the centre of mass in the air, the same body, rotors and lags.

    Rates are zero where the hull has drag: it goes with the velocity of the origin, which is another one.
    """
    speeds, hull = RNG.uniform(1000.0, 2200.0, (40, 4)), any("body_drag" in one.name for one in model.effects)
    velocity, rates = (0.3 * one for one in states(len(speeds)))
    rates *= 0.0 if hull else 1.0
    of_com = velocity + np.cross(rates, model.wrench_model.body.com_B)  # which is the origin of what is read
    check_wrench(wrench(again, speeds, of_com, rates), wrench(model, speeds, velocity, rates))
    one, other = (values_of(m, m.effects) for m in (model, again))
    for name in ("mass", "inertia", "lag"):
        np.testing.assert_allclose(other[name], one[name], rtol=DIGITS, atol=1e-12, err_msg=name)
    np.testing.assert_allclose(other["hub"][:, :2], (one["hub"] - one["com"])[:, :2], atol=1e-7)
    np.testing.assert_array_equal(again.vehicle.rotors.spin, model.vehicle.rotors.spin)


@pytest.mark.parametrize("hull", [{"body_drag_areas": [1e-4, 2e-4, 3e-4]}, {}])
def test_what_is_written_for_rotorpy_reads_back_as_the_same_model(tmp_path, identified, hull):
    more = hull | {
        "axial_inflow": [8e-7],
        "translational_lift": [5e-5],
        "drag_torque_of_speed": [0.3, 1.0],
        "motor_lag": [0.05],
    }
    kept = identified.without(["drag_torque", "thrust_scale"])  # which would scale the torque of inflow, too
    model = kept.with_effects([*kept.effects, *(make_effect(kept.vehicle, *row) for row in more.items())])
    assert written(model, "rotorpy").lost == ()
    again = returned(model, "rotorpy", tmp_path / "out.py")
    check_same(model, again)
    rotors, before = again.vehicle.rotors, model.vehicle.rotors
    np.testing.assert_allclose(rotors.speed_max, before.speed_max, rtol=DIGITS)
    np.testing.assert_allclose(rotors.radius, before.radius, rtol=DIGITS)
    place = model.vehicle.imu_position_B - model.wrench_model.body.com_B
    np.testing.assert_allclose(again.vehicle.imu_position_B, place, atol=1e-7)


def test_what_is_written_for_drone_models_reads_back_as_the_same_model(tmp_path, identified):
    more = {
        "body_drag": [0.01, 0.02, 0.03, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        "thrust_curve": [-0.1, 0.05],
        "asymmetric_motor_lag": [0.03, 0.06],
    }
    kept = identified.without(["rotor_drag"])
    model = kept.with_effects([*kept.effects, *(make_effect(kept.vehicle, *row) for row in more.items())])
    assert written(model, "drone-models").lost == ()
    again = returned(model, "drone-models", tmp_path / "out.toml")
    check_same(model, again)


@pytest.mark.parametrize(("target", "name"), [("rotorpy", "out.py"), ("drone-models", "out.toml")])
def test_rotors_without_a_lag_read_back_without_one(tmp_path, identified, target, name):
    """Both packages need a time constant; the one that stands for none is none again."""
    again = returned(identified, target, tmp_path / name)
    assert not any("lag" in one.name for one in again.effects)


def test_a_torque_of_another_shape_than_the_thrust_is_written(tmp_path):
    model = read(tmp_path / "drone.toml", CURVED)
    again = tomllib.loads(written(model, "drone-models").text)
    for key, value in {"rpm2thrust": [0.0, -3.1e-7, 4.4e-10], "rpm2torque": [0.0, 1.6e-9, 2.5e-12]}.items():
        at = 15000.0 ** np.arange(3)
        np.testing.assert_allclose(again[key] * at, value * at, atol=2e-5 * np.dot(value, at))


# -- what the packages ship, by the packages themselves --

ROTORPY = ("crazyflie", "crazyfliebrushless", "hummingbird", "px4_sihsim_quadx")
DRONES = ("cf2x_L250", "cf2x_P250", "cf2x_T350", "cf21B_500")


@pytest.mark.parametrize("name", ROTORPY)
def test_rotorpys_own_vehicles_have_its_wrench(name):
    multirotor = pytest.importorskip("rotorpy.vehicles.multirotor")
    own = importlib.import_module(f"rotorpy.vehicles.{name}_params")
    model, simulated = read(Path(own.__file__)), multirotor.Multirotor(own.quad_params)
    velocity, rates = states()
    speeds = own.quad_params["rotor_speed_max"] * RNG.uniform(0.2, 0.9, (len(rates), 4))
    rows = [simulated.compute_body_wrench(w, s, v) for w, s, v in zip(rates, speeds, velocity, strict=True)]
    check_wrench(wrench(model, speeds, velocity, rates), np.array([np.concatenate(row) for row in rows]))
    again = {}
    exec(written(model, "rotorpy").text, again)  # a module of Python, for RotorPy to import
    for key, value in again["quad_params"].items():
        if isinstance(value, float) and key in own.quad_params:
            assert value == pytest.approx(own.quad_params[key], rel=2e-5, abs=1e-12), key


@pytest.mark.parametrize("name", DRONES)
def test_drone_models_own_drones_have_their_parabolas(name):
    found = importlib.util.find_spec("drone_models")
    if found is None:
        pytest.skip("drone-models is not installed")
    path = Path(found.origin).parent / "data" / "params.toml"
    told, model = tomllib.loads(path.read_text())[name], read(path, name=name)
    rpm, still = RNG.uniform(8000.0, 22000.0, (40, 4)), np.zeros((40, 3))
    thrust, torque = (np.polynomial.polynomial.polyval(rpm, told[key]) for key in ("rpm2thrust", "rpm2torque"))
    about = np.array(told["mixing_matrix"])
    expected = np.zeros((40, 6))
    expected[:, 2] = thrust.sum(axis=1)
    expected[:, 3:] = np.hstack((told["L"] * thrust @ about[:2].T, torque @ about[2:].T))
    check_wrench(wrench(model, rpm * np.pi / 30.0, still, still), expected)
    assert model.vehicle.name == name


# -- what is refused --

HARMFUL = (
    "import os\nquad_params = {'mass': os.system('touch ran')}",
    "quad_params = {'mass': __import__('os').system('touch ran')}",
    "quad_params = {'mass': open('ran', 'w').write('x')}",
    "import numpy as np\nquad_params = {'mass': np.fromfile('ran')}",
    "import numpy as np\nquad_params = np.array([open('ran', 'w').write('x')])",
    "from numpy import *\nquad_params = {}",
    "import numpy.f2py as np\nquad_params = {}",
    "class A:\n    open('ran', 'w')\nquad_params = {}",
    "def f(): pass\nquad_params = {}",
    "quad_params = {**{'mass': 1.0}}",
    'quad_params = {f\'{open("ran", "w")}\': 1.0}',
    "quad_params = [open('ran', 'w') for _ in range(1)]",
    "quad_params = (x := 1.0)",
    "quad_params = dict(mass=1.0)",
    "quad_params = {'mass': 9**9**9**9}",
    "quad_params = {'mass': 1e308*10}",
    "quad_params = {'mass': 1/0}",
    "quad_params = {'mass': True}",
    "quad_params = {'mass': mass}",
    "quad_params = {'mass': 'a'*1000000}",
    "quad_params = {'mass': [1.0]*1000000}",
    "import numpy as np\nquad_params = {'mass': np.array([1.0, 2.0])*np.array([1.0])}",
    "import numpy as np\nquad_params = {'mass': np.array(['1.0'])}",
    "import numpy as np\nquad_params = {'mass': np.array([1.0], dtype='O')}",
    "import numpy as np\nquad_params = {'mass': np.array([[1.0], [1.0, 2.0]])}",
    "np = 1.0\nquad_params = {'mass': np.array([1.0])}",
    "quad_params = {'mass': 1.0, 'mass': 2.0}",
    "quad_params['mass'] = 1.0",
    "quad_params = {'mass': 1.0}; del quad_params",
    "a = b = 1.0",
)


@pytest.mark.parametrize("text", HARMFUL)
def test_python_is_read_and_never_run(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "nasty.py"
    path.write_text(text)
    with pytest.raises(ModelError, match=r"^nasty.py, line \d: got .*nothing is run: write the number there") as said:
        constants(path)
    assert "\n" not in str(said.value)
    assert len(str(said.value)) < 400
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("quad_params = {", "line 1: is not Python"),
        ("a = '\0'", "is not Python"),
        ("a = " + "-" * 50000 + "1", "."),
        ("a = " + "1+" * 30000 + "1", "."),
        ("a = " + "[" * 5000, "line 1: is not Python"),
        ("a = " + "9" * 5000, "line 1: is not Python"),
        ("a = 1.0\n" * LONGEST, "is longer than"),
        ("\x89PNG\x00", "."),
        ("a = '\\d'\nb = c", "line 2: got 'b = c'"),
    ],
)
def test_what_is_no_python_is_one_line(tmp_path, recwarn, text, words):
    (tmp_path / "nasty.py").write_text(text)
    with pytest.raises(ModelError, match=words) as said:
        constants(tmp_path / "nasty.py")
    assert "\n" not in str(said.value)
    assert len(str(said.value)) < 400
    assert not recwarn.list


def test_values_are_those_of_python(tmp_path):
    (tmp_path / "a.py").write_text(
        "import numpy\nimport numpy as np\nd = -2\ne = d/4 + 1\n"
        "a = {'x': [1, 2.5], 'y': 'text', 'z': e*numpy.array([[1, 2], [3, 4]]), 'w': (+1, -d),\n"
        "     'v': np.array([4.0])/d}\n"
    )
    found = constants(tmp_path / "a.py")["a"]
    assert (found["x"], found["y"], found["w"]) == ([1.0, 2.5], "text", [1.0, 2.0])
    np.testing.assert_array_equal(found["z"], 0.5 * np.array([[1.0, 2.0], [3.0, 4.0]]))
    np.testing.assert_array_equal(found["v"], [-2.0])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("'mass': 0.6,", "", "quad.py: quad_params.mass: is missing"),
        ("'mass': 0.6", "'mass': -0.6", "quad.py: quad_params.mass: got -0.6, expected a positive number"),
        ("'mass': 0.6", "'mass': '0.6'", "quad_params.mass: got '0.6'"),
        ("d*np.array([ 0.7,-0.7, 0])", "d*np.array([ 0.7,-0.7])", "quad_params.rotor_pos.r2: got .*expected three"),
        ("'num_rotors': 4", "'num_rotors': 6", "num_rotors is 6, rotor_pos has 4, rotor_directions 4"),
        ("[1,-1,1,-1]", "[1,-1,1,0]", "expected 1 or -1 for each rotor"),
        ("'rotor_speed_min': 100", "'rotor_speed_min': 1600", "expected less than rotor_speed_max"),
        ("'tau_m': 0.04", "'tau_m': 40", "quad.py: effects.* got 40, expected 0 to 3 s"),
        ("'Izz': 7e-3", "'Izz': 7", "quad.py: vehicle.inertia: no body has the principal moments"),
        ("'mass': 0.6", "'mass': 600.0", "quad.py: with 600 kg the rotors would carry"),
        ("quad_params = ", "params = ", "quad.py: assigns no dict quad_params"),
        ("quad_params = {", "quad_params = 3\nother = {", "quad.py: assigns no dict quad_params"),
    ],
)
def test_a_wrong_number_of_rotorpy_is_named(tmp_path, old, new, words):
    assert old in QUAD_PARAMS
    with pytest.raises(ModelError, match=words):
        read(tmp_path / "quad.py", QUAD_PARAMS.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mass = 0.04338", "", "drone.toml.mass: is missing"),
        ("rpm2thrust = [0.0, -3.1e-7, 4.4e-10]", "rpm2thrust = [0.0, 4.4e-10]", "rpm2thrust: got .* expected three"),
        ("4.4e-10]", "-4.4e-10]", "rpm2thrust: no speed makes 0.1064 N, a rotor's share of the weight"),
        ("[-1.0, 1.0, -1.0, 1.0]]", "[-1.0, 1.0, -1.0]]", "mixing_matrix: expected as many numbers in each row"),
        ("[[-0.0215", "[[0.0215", "drag_matrix: expected nothing positive"),
        ("14.0, 1.1e-4", "-14.0, 0.0", "rotor_dyn_coef: in hover rotors answer at -14 1/s"),
        ("J = ", "J_inv = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\nJ = ", "J_inv: is not the inverse of J"),
        ("rpm2torque = [0.0, 1.6e-9", "rpm2torque = [0.0, -1.6e-5", "rpm2torque: got .* expected a positive torque"),
        ("rpm2thrust", "rpm_to_thrust", "drone.toml: has no rpm2thrust"),
        ("mass = ", "mass == ", "drone.toml: is not TOML"),
    ],
)
def test_a_wrong_number_of_drone_models_is_named(tmp_path, old, new, words):
    assert old in CURVED
    with pytest.raises(ModelError, match=words):
        read(tmp_path / "drone.toml", CURVED.replace(old, new))


def test_one_of_several_drones_is_asked_for(tmp_path):
    path = tmp_path / "params.toml"
    both = "".join(f"[{name}]\n{CURVED.replace('0.04338', mass)}" for name, mass in (("a", "0.04"), ("b", "0.05")))
    with pytest.raises(UsageError, match="has 2 drones; say --name with one of a, b"):
        read(path, both)
    with pytest.raises(UsageError, match="none called c; say --name with one of a, b"):
        read(path, name="c")
    assert (read(path, name="b").vehicle.name, read(path, name="b").vehicle.body.mass) == ("b", 0.05)
    model = wg.load_model("crazyflie")
    with pytest.raises(UsageError, match="is a model file already; say -m"):
        read(wg.save_model(model, tmp_path / "model.toml").path)
    with pytest.raises(UsageError, match="says where its rotors are; leave --frame and --arm out"):
        read(path, name="b", frame="quad_x", arm=0.2)
