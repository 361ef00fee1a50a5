"""URDF, SDF and MJCF of one vehicle become one model: masses, moments, arms and rotors computed by hand."""

import pickle
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest

from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant import model_file
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.drafts import mjcf_urdf
from wrenchgap.plant.drafts.draft import completed
from wrenchgap.plant.drafts.model_text import text_of
from wrenchgap.plant.drafts.sources import Given, draft_of_source
from wrenchgap.plant.rigid_body import unpack
from wrenchgap.plant.state import Commands

HULL, MOTOR, ARM, HEIGHT = 1.0, 0.05, 0.2, 0.03
J_HULL = (0.004, 0.005, 0.006)
SITES = ((ARM, -ARM, 1), (-ARM, ARM, 1), (ARM, ARM, -1), (-ARM, -ARM, -1))
"""x, y and turning of the rotors."""
MASS = HULL + 4 * MOTOR
CENTRE = 4 * MOTOR * HEIGHT / MASS


def inertia():
    """Point masses on a hull, about the common centre (Steiner by hand, axis by axis)."""
    own = np.array(J_HULL) + HULL * CENTRE**2 * np.array([1, 1, 0])
    up = HEIGHT - CENTRE
    return own + 4 * MOTOR * np.array([ARM**2 + up**2, ARM**2 + up**2, 2 * ARM**2])


def plugin(number, turn):
    way = "ccw" if turn > 0 else "cw"
    return f"""<plugin name="m{number}" filename="gz-sim-multicopter-motor-model-system">
      <jointName>rotor_{number}_joint</jointName><linkName>rotor_{number}</linkName>
      <turningDirection>{way}</turningDirection><maxRotVelocity>1000.0</maxRotVelocity>
      <motorConstant>8.5e-06</motorConstant><momentConstant>0.016</momentConstant>
      <motorNumber>{number}</motorNumber></plugin>"""


TINY = "<inertia ixx='1e-12' iyy='1e-12' izz='1e-12' ixy='0' ixz='0' iyz='0'/>"


def urdf(plugins=True):
    """The hull has a mesh that is not there, as meshes in package:// are."""
    xx, yy, zz = J_HULL
    parts = [
        f"""<link name="base"><inertial><mass value="{HULL}"/>
        <inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>
        <visual><geometry><mesh filename="package://nowhere/hull.stl"/></geometry></visual></link>"""
    ]
    for number, (x, y, turn) in enumerate(SITES):
        parts.append(
            f"""<link name="rotor_{number}"><inertial><mass value="{MOTOR}"/>{TINY}</inertial></link>
            <joint name="rotor_{number}_joint" type="continuous"><parent link="base"/><child link="rotor_{number}"/>
            <origin xyz="{x} {y} {HEIGHT}"/><axis xyz="0 0 1"/></joint>"""
        )
        if plugins:
            parts.append(f"<gazebo>{plugin(number, turn)}</gazebo>")
    return f"<?xml version='1.0'?><robot name='quad'>{''.join(parts)}</robot>"


def sdf():
    """The whole model is moved and turned in its world, and rotors are given in the hull's frame."""
    xx, yy, zz = J_HULL
    parts = [
        f"""<link name="base"><pose>1 2 3 0 0 0.7</pose><inertial><mass>{HULL}</mass>
        <inertia><ixx>{xx}</ixx><iyy>{yy}</iyy><izz>{zz}</izz></inertia></inertial></link>"""
    ]
    for number, (x, y, turn) in enumerate(SITES):
        parts.append(
            f"""<link name="rotor_{number}"><pose relative_to="base">{x} {y} {HEIGHT} 0 0 0</pose><inertial>
            <mass>{MOTOR}</mass><inertia><ixx>1e-12</ixx><iyy>1e-12</iyy><izz>1e-12</izz></inertia></inertial></link>
            <joint name="rotor_{number}_joint" type="revolute"><parent>base</parent><child>rotor_{number}</child>
            <axis><xyz>0 0 1</xyz><limit><lower>-1e16</lower><upper>1e16</upper></limit></axis></joint>
            {plugin(number, turn)}"""
        )
    return f"<?xml version='1.0'?><sdf version='1.9'><model name='quad'>{''.join(parts)}</model></sdf>"


def mjcf():
    """Motors are bodies of the hull; actuators push on sites and pull their drag torque along."""
    xx, yy, zz = J_HULL
    bodies = "".join(
        f"""<body name="motor_{k}" pos="{x} {y} {HEIGHT}">
        <inertial pos="0 0 0" mass="{MOTOR}" diaginertia="1e-9 1e-9 1e-9"/><site name="s{k}"/></body>"""
        for k, (x, y, _) in enumerate(SITES)
    )
    motors = "".join(
        f'<motor name="M{k + 1}" site="s{k}" gear="0 0 1 0 0 {-0.016 * turn}" ctrllimited="true" ctrlrange="0 8.5"/>'
        for k, (_, _, turn) in enumerate(SITES)
    )
    return f"""<mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="base" pos="0 0 1" euler="0 0 30">
    <freejoint/><inertial pos="0 0 0" mass="{HULL}" diaginertia="{xx} {yy} {zz}"/>{bodies}</body></worldbody>
    <actuator>{motors}</actuator></mujoco>"""


FORMS = {"quad.urdf": urdf, "quad.sdf": sdf, "quad.xml": mjcf}


def read(tmp_path, name, text, given=None):
    path = Path(tmp_path) / name
    path.write_text(text)
    return draft_of_source(path, given or Given())


def model_of(draft):
    return model_file.loads(text_of(completed(draft), ["a test"]))


@pytest.fixture(params=FORMS)
def model(request, tmp_path):
    return model_of(read(tmp_path, request.param, FORMS[request.param]()))


def test_mass_properties_are_those_of_all_bodies(model):
    body = model.vehicle.body
    assert body.mass == pytest.approx(MASS, rel=1e-5)
    assert body.com_B == pytest.approx([0.0, 0.0, CENTRE], abs=1e-7)
    assert np.diag(body.inertia) == pytest.approx(inertia(), rel=1e-5)


def test_rotors_are_where_they_are_and_turn_as_they_do(model):
    arms, rotors = model.vehicle.geometry()
    assert arms.position_B == pytest.approx(np.array([(x, y, HEIGHT) for x, y, _ in SITES]), abs=1e-6)
    assert rotors.spin.tolist() == [turn for _, _, turn in SITES]
    assert rotors.kappa == pytest.approx(np.full(4, 0.016))
    assert not arms.tilts.any()


def test_full_thrust_and_its_torque_are_those_of_the_description(model):
    """8.5 N of the first rotor, 8.5e-6 times 1000 squared or the limit of its actuator, and 0.016 m times it."""
    _, rotors = model.vehicle.geometry()
    speeds = np.array([[rotors.speed_max[0], 0.0, 0.0, 0.0]])
    wrench = nominal_wrench(model.vehicle, Commands(np.zeros((1, 6)), np.zeros((1, 4)), speeds))[0]
    assert wrench[2] == pytest.approx(8.5, rel=1e-5)
    assert wrench[5] == pytest.approx(-0.016 * 8.5, rel=1e-5)


def test_mujoco_itself_agrees_with_the_torque_of_its_actuator(tmp_path):
    """The generalised force of the first motor on the free hull, from MuJoCo."""
    mujoco = pytest.importorskip("mujoco")
    compiled = mujoco.MjModel.from_xml_string(mjcf())
    data = mujoco.MjData(compiled)
    data.ctrl[0] = 8.5
    mujoco.mj_forward(compiled, data)
    force = data.qfrc_actuator[:6]
    assert force[2] == pytest.approx(8.5)
    assert force[5] == pytest.approx(-0.016 * 8.5)


def test_without_plugins_turning_joints_are_taken_and_what_is_assumed_is_said(tmp_path):
    draft = completed(read(tmp_path, "quad.urdf", urdf(plugins=False)))
    assert len(draft.rotors) == 4
    assert all(r.spin.assumed for r in draft.rotors)
    assert any("names no motors" in note for note in draft.notes)


def test_a_weighed_mass_scales_what_the_description_says(tmp_path):
    model = model_of(read(tmp_path, "quad.sdf", sdf(), Given(mass=2 * MASS, mass_tolerance=0.01)))
    assert model.vehicle.body.mass == pytest.approx(2 * MASS)
    assert np.diag(model.vehicle.body.inertia) == pytest.approx(2 * inertia(), rel=1e-5)
    assert model.vehicle.tolerances.mass == 0.01


def test_an_arm_on_a_hinge_tilts(tmp_path):
    """A hinge with limits along x between hull and rotor."""
    text = urdf().replace("</robot>", "")
    text += (
        """<link name="arm"><inertial><mass value="0.1"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0"
    iyz="0"/></inertial></link><joint name="tilt" type="revolute"><parent link="base"/><child link="arm"/>
    <origin xyz="0.3 0 0"/><axis xyz="1 0 0"/><limit lower="-1.0" upper="1.2" effort="1" velocity="1"/></joint>
    <link name="rotor_4"><inertial><mass value="0.05"/><inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0"
    iyz="0"/></inertial></link><joint name="rotor_4_joint" type="continuous"><parent link="arm"/><child link="rotor_4"/>
    <axis xyz="0 0 1"/></joint>"""
        + f"<gazebo>{plugin(4, 1)}</gazebo></robot>"
    )
    arms, _ = model_of(read(tmp_path, "quad.urdf", text)).vehicle.geometry()
    assert arms.tilts.tolist() == [False, False, False, False, True]
    assert arms.axis_B[4] == pytest.approx([1.0, 0.0, 0.0])
    assert (arms.tilt_min[4], arms.tilt_max[4]) == pytest.approx((-1.0, 1.2), abs=1e-5)


def test_coaxial_rotors_share_an_arm(tmp_path):
    x, y, _ = SITES[0]
    below = f"""<link name="rotor_4"><inertial><mass value="0.05"/>{TINY}</inertial></link>
    <joint name="rotor_4_joint" type="continuous"><parent link="base"/><child link="rotor_4"/>
    <origin xyz="{x} {y} {HEIGHT - 0.1}"/><axis xyz="0 0 1"/></joint>"""
    text = (
        urdf().replace("</robot>", "")
        + below
        + f"<gazebo>{plugin(0, -1).replace('rotor_0', 'rotor_4')}</gazebo></robot>"
    )
    arms, rotors = model_of(read(tmp_path, "quad.urdf", text)).vehicle.geometry()
    assert len(arms) == 4
    assert rotors.arm.tolist() == [0, 0, 1, 2, 3]
    assert rotors.offset[:2] == pytest.approx([0.05, -0.05], abs=1e-6)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.urdf", "<robot", "a.urdf: is not XML"),
        ("a.xml", "<html/>", "begins with <html>, expected <robot>"),
        ("a.urdf", "<robot name='x'><link name='a'/><link name='b'/></robot>", "got 2 root links"),
        ("a.sdf", "<sdf version='1.9'><world name='w'/></sdf>", "holds no <model>"),
        (
            "a.sdf",
            sdf().replace(f"<mass>{HULL}</mass>", "<mass>heavy</mass>"),
            "link base: mass: got 'heavy', expected 1",
        ),
        ("a.sdf", sdf().replace("<parent>base</parent>", "<parent>nix</parent>", 1), "hang on no joint from base"),
        ("a.sdf", sdf().replace('relative_to="base"', 'relative_to="nix"', 1), "the frame 'nix' is not there"),
        ("a.xml", "<mujoco><worldbody><body><geom size='0'/></body></worldbody></mujoco>", "MuJoCo cannot compile it"),
        ("a.urdf", urdf().replace(f'value="{MOTOR}"', 'value="-0.2"', 1), "mass value: got -0.2, expected none"),
        ("a.sdf", sdf().replace(">ccw<", ">CCW<", 1), "turningDirection: got 'CCW', expected ccw or cw"),
        ("a.sdf", re.sub("(?<=<motorConstant>)", "O", sdf(), count=1), "motorConstant: got 'O.*', expected a positive"),
        ("a.xml", "<mujoco><worldbody/></mujoco>", "has no body that could fly"),
    ],
)
def test_what_is_broken_is_told_in_one_line(tmp_path, name, text, message):
    with pytest.raises(ModelError, match=message) as caught:
        completed(read(tmp_path, name, text))
    assert "\n" not in str(caught.value)


def test_a_hull_without_rotors_is_refused(tmp_path):
    text = "<sdf version='1.9'><model name='box'><link name='base'/></model></sdf>"
    with pytest.raises(ModelError, match="no rotors found among 1 bodies"):
        read(tmp_path, "a.sdf", text)


@pytest.mark.parametrize(
    ("name", "message"), [("a.xacro", "expand it first"), ("a.png", "says nothing of its vehicle")]
)
def test_other_files_are_refused_with_the_remedy(tmp_path, name, message):
    (tmp_path / name).write_text("")
    with pytest.raises(UsageError, match=message):
        draft_of_source(tmp_path / name, Given())


def test_a_proposed_command_takes_no_file_for_an_option(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("-oquad.xacro").write_text("")
    with pytest.raises(UsageError, match=r"`xacro \./-oquad\.xacro > FILE\.urdf`"):
        draft_of_source(Path("-oquad.xacro"), Given())


@pytest.mark.parametrize("name", ["quad.urdf", "quad.sdf"])
@pytest.mark.parametrize("number", ["nan", "inf", "1e308"])
def test_a_number_that_is_none_is_refused_by_name(name, number, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = FORMS[name]()
    mass = f'mass value="{MOTOR}"' if name.endswith("urdf") else f"<mass>{MOTOR}</mass>"
    assert mass in text
    (tmp_path / name).write_text(text.replace(mass, mass.replace(str(MOTOR), number), 1))
    with pytest.raises(ModelError) as caught:
        draft_of_source(tmp_path / name, Given())
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == [name]  # MuJoCo by itself writes MUJOCO_LOG.TXT here


def test_a_motor_without_a_number_is_still_a_motor(tmp_path):
    text = urdf().replace("<motorNumber>0<", "<motorNumber>nan<")
    (tmp_path / "quad.urdf").write_text(text)
    assert len(draft_of_source(tmp_path / "quad.urdf", Given()).rotors) == 4


@pytest.mark.parametrize("name", ["quad.sdf", "quad.xml"])
def test_a_name_in_a_description_is_no_line_of_the_model_file(tmp_path, name):
    forged = "&#10;[command]&#10;table = &quot;/etc/passwd&quot;&#10;#&#x9b;"
    text = FORMS[name]().replace('name="M1"', f'name="M1{forged}"').replace('name="quad"', f'name="quad{forged}"')
    model = model_of(read(tmp_path, name, text))
    assert model.command is None
    assert all(c == "\n" or c.isprintable() for c in model.text)


def test_a_description_may_name_files_of_its_own_folder(tmp_path):
    hull = f'<inertial pos="0 0 0" mass="{HULL}"'
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "hull.xml").write_text(f"<mujoco>{hull} diaginertia='0.01 0.01 0.02'/></mujoco>")
    start = mjcf().index(hull)
    whole = mjcf()
    included = whole[:start] + '<include file="parts/hull.xml"/>' + whole[whole.index("/>", start) + 2 :]
    assert model_of(read(tmp_path, "quad.xml", included)).vehicle.body.mass == pytest.approx(
        model_of(read(tmp_path, "whole.xml", whole)).vehicle.body.mass
    )
    (tmp_path / "linked").symlink_to(tmp_path)
    assert model_of(read(tmp_path / "linked", "quad.xml", included)).vehicle.body.mass > 0.0


def test_a_description_without_end_is_refused(tmp_path):
    """300 million copies kept MuJoCo, and so the command, for minutes; 3,000 chained frames ended in a traceback."""
    body = '<body><freejoint/><geom size="0.1"/></body>'
    endless = f'<mujoco><worldbody><replicate count="300000000">{body}</replicate></worldbody></mujoco>'
    with pytest.raises(ModelError, match="repeats bodies 300,000,000 times"):
        read(tmp_path, "quad.xml", endless)
    frames = "".join(
        f'<frame name="f{k}" attached_to="f{k + 1}"/>' if k < 3000 else f'<frame name="f{k}"/>' for k in range(3001)
    )
    chained = sdf().replace("</model>", f"{frames}</model>")
    assert chained != sdf()
    with pytest.raises(ModelError, match="frames stand on one another"):
        read(tmp_path, "quad.sdf", chained)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ('<size nuserdata="1500000000"/>', "could not allocate|does not compile it within|unknown exception"),
        ('<asset><texture name="t" type="2d" builtin="checker" width="60000" height="60000"/></asset>', "allocate"),
        ('<asset><model name="n" file="quad.xml"/></asset><worldbody><attach model="n" prefix="p"/></worldbody>', ""),
        ('<worldbody><replicate count="+200000"><geom size="0.1"/></replicate></worldbody>', "repeats bodies 200,000"),
        ("<a>" * 1500 + "</a>" * 1500, "more than 200 deep"),
    ],
)
def test_a_line_that_asks_for_any_size_is_refused(tmp_path, more, said):
    """They took 11 GB and minutes, or ended the process: MuJoCo compiles elsewhere, within limits."""
    with pytest.raises(ModelError, match=f"(?i){said}"):
        read(tmp_path, "quad.xml", mjcf().replace("</mujoco>", f"{more}</mujoco>"))


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGIO there")
def test_who_compiles_ends_with_who_asked(tmp_path, eventually):
    """However it ended, and whatever MuJoCo is doing: a hundred million keyframes take it minutes."""
    path = tmp_path / "quad.xml"
    path.write_text(mjcf().replace("</mujoco>", '<size nkey="100000000"/></mujoco>'))
    command = [sys.executable, "-c", mjcf_urdf.START, *sys.path]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        pickle.dump((path, None, 2_000_000_000, 60), process.stdin)
        process.stdin.flush()
        eventually(lambda: sum(psutil.Process(process.pid).cpu_times()[:2]) > 4.0, "it compiles nothing", 60.0)
        process.stdin.close()
        assert process.wait(5.0) == -signal.SIGIO


@pytest.mark.parametrize("encoding", ["nosuch", "idna", "utf-7"])
def test_an_encoding_that_nobody_reads_is_said(tmp_path, encoding):
    with pytest.raises(ModelError, match="is not XML"):
        read(tmp_path, "quad.urdf", f'<?xml version="1.0" encoding="{encoding}"?>{urdf()}')


def gazebo(up=0.0125, down=0.025, drag=8e-5):
    said = f"<timeConstantUp>{up}</timeConstantUp><timeConstantDown>{down}</timeConstantDown>"
    said += f"<rotorDragCoefficient>{drag}</rotorDragCoefficient></plugin>"
    return urdf().replace("</plugin>", said)


def test_the_lag_and_the_drag_of_motors_are_effects(tmp_path):
    """Gazebo: the speed follows with a time constant, and -|omega| c v_t pulls at each rotor."""
    model = model_of(read(tmp_path, "quad.urdf", gazebo()))
    values = {one.name: one.theta.tolist() for one in model.effects}
    assert values == {"asymmetric_motor_lag": [0.0125, 0.025], "rotor_drag": [8e-5]}
    speeds, moving = (
        np.full((1, 4), 600.0),
        np.array([[0.0, 0.0, 10.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0]]),
    )
    felt = model.wrench_model.wrench(Commands(np.zeros((1, 6)), np.zeros((1, 4)), speeds), unpack(np.zeros(1), moving))
    assert felt[0, 0] == pytest.approx(-4 * 600.0 * 8e-5 * 2.0, rel=1e-6)


def test_filtered_actuators_lag(tmp_path):
    text = mjcf().replace("<motor ", '<general dyntype="filterexact" dynprm="0.03" ')
    [lag] = model_of(read(tmp_path, "quad.xml", text)).effects
    assert (lag.name, lag.theta.tolist()) == ("motor_lag", [0.03])
    assert model_of(read(tmp_path, "quad.xml", mjcf())).effects == ()


@pytest.mark.parametrize(
    ("said", "words", "kept"),
    [
        ({"drag": 0.1}, "rotorDragCoefficient 0.1 is left out", {"asymmetric_motor_lag"}),
        ({"up": 20.0}, "rotors that take 20 s to follow are not believed", {"rotor_drag"}),
    ],
)
def test_a_copied_number_that_belongs_to_another_vehicle_is_left_out(tmp_path, said, words, kept):
    draft = read(tmp_path, "quad.urdf", gazebo(**said))
    assert any(words in note for note in draft.notes)
    assert {one.name for one in model_of(draft).effects} == kept


def test_motors_that_differ_are_averaged(tmp_path):
    text = gazebo().replace("<timeConstantUp>0.0125<", "<timeConstantUp>0.0325<", 1)
    draft = read(tmp_path, "quad.urdf", text)
    assert any("timeConstantUp of motors differ" in note for note in draft.notes)
    assert model_of(draft).effects[0].theta.tolist() == pytest.approx([0.0175, 0.025])


def test_a_frame_that_is_typed_has_no_effects_of_other_rotors(tmp_path):
    assert model_of(read(tmp_path, "quad.urdf", gazebo(), Given(frame="quad_x", arm=0.2))).effects == ()
