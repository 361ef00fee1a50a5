"""Speeds that stop at one value below the model's limit are asked about; full throttle is a limit that all know."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.flight import ActuatorSeries, Flight
from wrenchgap.learn.data.checks.impossible_commands import without_impossible_commands

MODEL = wg.load_model("crazyflie")
TOP = float(MODEL.vehicle.rotors.speed_max.max())


@pytest.mark.parametrize(("share", "asked"), [(0.8, True), (1.0, False)])
def test_which_speed_is_full_throttle_the_model_says(share, asked):
    time = np.arange(0.0, 20.0, 0.01)
    waves = np.stack([np.sin(2.0 * np.pi * f * time + 5.0 * f) for f in (0.3, 0.8, 1.7, 2.9)], axis=1)
    speeds = np.minimum(TOP * (0.7 + 0.4 * waves), share * TOP)
    sent = ActuatorSeries("/motors", time, np.zeros((len(time), 0)), np.maximum(speeds, 0.3 * TOP))
    _, found = without_impossible_commands(Flight("f", "f.mcap", "0" * 64, 0, actuators=sent), MODEL)
    assert [check.name for check in found] == ["clipped"] * asked
    normalised = replace(sent, unit="normalised")
    _, found = without_impossible_commands(Flight("f", "f.mcap", "0" * 64, 0, actuators=normalised), MODEL)
    assert not found
