"""Quantities mean what they say: sides, headings, and reasons for what a log lacks."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.diagnose.quantities import NO_ARMS, NO_POSE, NO_VOLTAGE, heading, input_groups, quantities


def posed(data, hexarotor, rotation):
    """The first record with another attitude throughout."""
    record = data.records[0]
    quat = np.broadcast_to(rotation.as_quat(scalar_first=True), (len(record), 4)).copy()
    other = rotation * Rotation.from_rotvec([0.1, 0.2, 0.1])  # nothing is sorted by what does not move
    quat[0] = other.as_quat(scalar_first=True)
    return dataset([replace(record, state_kept=replace(record.state_kept, quat_EB=quat))], hexarotor)


@pytest.mark.parametrize(("euler", "side"), [((0, 40, 0), 0), ((-40, 0, 0), 90), ((0, -40, 0), 180), ((40, 0, 0), -90)])
@pytest.mark.parametrize("yaw", [0.0, 130.0])
def test_side_that_is_down_is_the_bodys_own(turning, hexarotor, euler, side, yaw):
    """Nose down is 0, left side down 90 deg, wherever the vehicle heads."""
    rotation = Rotation.from_euler("z", yaw, degrees=True) * Rotation.from_euler("xyz", euler, degrees=True)
    found, _ = quantities(posed(turning, hexarotor, rotation))
    by_name = {q.name: q.values[-1] for q in found}
    assert abs((by_name["direction"] - side + 180) % 360 - 180) < 1e-6
    assert by_name["tilt"] == pytest.approx(40)


@pytest.mark.parametrize("tilt", [0.0, 50.0, 110.0])
@pytest.mark.parametrize("yaw", [-170.0, -20.0, 100.0])
def test_heading_does_not_depend_on_tilt(tilt, yaw):
    """However far it leans about a horizontal axis, it heads where it headed."""
    lean = Rotation.from_rotvec(np.radians(tilt) * np.array([0.6, -0.8, 0.0]))
    quat = (lean * Rotation.from_euler("z", yaw, degrees=True)).as_quat(scalar_first=True)
    assert np.degrees(heading(np.array([quat, -quat]))) == pytest.approx(yaw)


def test_level_flight_has_no_side(turning, hexarotor):
    data = posed(turning, hexarotor, Rotation.from_euler("y", 1.0, degrees=True))
    found, lacking = quantities(data)
    assert np.degrees(2 * np.arccos(data.records[0].state_kept.quat_EB[0, 0])) > 3  # it leaned at one sample only
    assert "direction" in lacking
    assert "tilt" in {q.name for q in found}


def test_what_a_log_lacks_is_said(turning, hexarotor):
    (r,) = turning.records
    bare = replace(r, has_pose=False, has_voltage=False, commands=replace(r.commands, tilt=None))
    data = dataset([bare], hexarotor)
    found, lacking = quantities(data)
    assert lacking["tilt"] == lacking["height"] == lacking["speed"] == NO_POSE
    assert lacking["voltage"] == NO_VOLTAGE
    assert lacking["arm_rate"] == NO_ARMS
    assert {q.name for q in found} == {"thrust", "rate", "rate_x", "rate_y", "rate_z", "time"}
    groups, missing = input_groups(data)
    assert {g.name for g in groups} == {"command", "command_rate", "rates", "time"}
    assert set(missing) == {"velocity", "attitude", "heading", "height", "arm_rates", "voltage"}


def test_rates_are_derivatives_of_what_they_are_rates_of(turning):
    """A ramp of force has its slope as rate."""
    record = turning.records[0]
    slope = np.array([0.5, -1.0, 2.0, 0.1, 0.0, -0.3])
    ramp = slope * record.state.time[:, None]
    data = replace(turning, records=(replace(record, commands=replace(record.commands, wrench_B=ramp)),))
    groups = {g.name: g.values for g in input_groups(data)[0]}
    middle = slice(len(record) // 4, -len(record) // 4)
    assert groups["command_rate"][middle] == pytest.approx(np.broadcast_to(slope, groups["command_rate"][middle].shape))
