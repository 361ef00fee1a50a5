"""Normalised commands and pulse widths are recognised, survive a file, and are refused where newtons are needed."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight.errors import LogError

MOTORS = "actuator_msgs/msg/Actuators"


def with_motors(logs, topic, **fields):
    time = np.arange(0, 4.0, 0.01)
    recording = logs.Recording().plain("/imu", time).plain("/odometry", time)
    columns = {name: np.outer(1.0 + 0.1 * np.sin(time), values) for name, values in fields.items()}
    return recording.series(topic, MOTORS, time, columns, stamp_s=True)


@pytest.mark.parametrize(
    ("topic", "fields", "unit"),
    [
        ("/motors", {"velocity": [500.0, 510.0]}, "rad/s"),
        ("/motors", {"normalized": [0.4, 0.5]}, "normalised"),
        ("/motors_pwm", {"velocity": [1500.0, 1400.0]}, "pwm"),
        ("/motors_normalised", {"velocity": [0.3, 0.4]}, "normalised"),
    ],
)
def test_the_unit_follows_field_and_name_and_survives_a_file(logs, loaded, tmp_path, topic, fields, unit):
    found = loaded(with_motors(logs, topic, **fields))
    assert found.actuators.unit == unit
    (values,) = fields.values()
    np.testing.assert_allclose(found.actuators.rotor_speed[0], values, rtol=1e-12)
    assert any("not rad/s" in note for note in found.notes) == (unit != "rad/s")
    again = flight.load(flight.write(found, tmp_path / "again.mcap"))
    assert again.actuators.unit == unit
    np.testing.assert_array_equal(again.actuators.rotor_speed, found.actuators.rotor_speed)


def test_a_normalised_wrench_survives_a_file(logs, loaded, tmp_path):
    time = np.arange(0, 4.0, 0.01)
    recording = logs.plain_flight()
    kind, columns = logs.PLAIN["/command/wrench"]
    recording.series("/command/wrench_normalised", kind, time, columns(time), stamp_s=True)
    recording.entries = [e for e in recording.entries if e[0] != "/command/wrench"]
    found = loaded(recording)
    assert found.commanded.unit == "normalised"
    again = flight.load(flight.write(found, tmp_path / "again.mcap"))
    assert again.commanded.unit == "normalised"
    np.testing.assert_array_equal(again.commanded.wrench_B, found.commanded.wrench_B)


def test_the_cache_keeps_the_unit(logs, tmp_path, monkeypatch):
    from wrenchgap.flight import cache

    monkeypatch.setattr(cache, "folder", lambda: tmp_path / "kept")
    path = with_motors(logs, "/motors", normalized=[0.4, 0.5]).save(tmp_path / "log.mcap")
    assert [cache.load(path).actuators.unit for _ in range(2)] == ["normalised"] * 2


def test_only_normalised_commands_are_refused_with_the_remedy(logs, loaded):
    found = loaded(with_motors(logs, "/motors", normalized=[0.4, 0.5]))
    with pytest.raises(LogError, match=r"not in SI.*\(actuators, normalised.*wrenchgap model new --from") as caught:
        flight.in_si(found)
    assert "\n" not in str(caught.value)


def test_commands_in_si_are_used_and_the_others_left_out_with_a_note(logs, loaded):
    recording = with_motors(logs, "/motors", normalized=[0.4, 0.5]).plain("/command/wrench", np.arange(0, 4.0, 0.01))
    found = loaded(recording)
    usable = flight.in_si(found)
    assert usable.actuators is None
    assert usable.commanded is found.commanded
    assert "left out" in usable.notes[-1]
    assert flight.in_si(usable) is usable


def test_a_note_and_a_refusal_describe_the_same_commands_alike(logs, loaded):
    """Motors from 0 to 1, and from -1 where they reverse, are shares of full throttle wherever they are told of."""
    found = loaded(with_motors(logs, "/motors", normalized=[0.4, 0.5]))
    words = "normalised (shares of full throttle)"
    assert words in " ".join(found.notes)
    with pytest.raises(LogError) as caught:
        flight.in_si(found)
    assert words in str(caught.value)


def test_a_flight_in_si_is_not_touched(loaded, logs):
    found = loaded(logs.plain_flight())
    assert flight.in_si(found) is found
    assert flight.in_si(replace(found, commanded=None)).commanded is None
