"""Rotors and arms under the names that the user gave them, in sentences and tables; parameter names stay in JSON."""

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

import wrenchgap as wg
from wrenchgap.plant.history import Value
from wrenchgap.plant.model import make_effect
from wrenchgap.replay.present import addition
from wrenchgap.replay.present.numbers import label, parameters_in_words


@pytest.fixture(scope="module")
def model():
    shipped = wg.load_model("asymmetric_quadrotor")
    vehicle = replace(shipped.vehicle, rotor_names=("front", "", "M$3_4$", "[red]"))
    return replace(shipped, vehicle=vehicle).with_effects(
        [make_effect(vehicle, "rotor_thrust", {"rotor_0": -0.02, "rotor_1": -0.01, "rotor_3": -0.05})]
    )


def printed(part):
    console = Console(width=120, highlight=False)
    with console.capture() as caught:
        console.print(part)
    return caught.get()


def test_a_table_gives_the_name_and_the_parameter(model):
    text = printed(addition.model_table(model))
    assert "front (rotor_0)" in text
    assert "[red] (rotor_3)" in text  # no markup
    assert "rotor_1 (" not in text


def test_a_sentence_gives_the_name_alone(model):
    values = [Value("rotor_0", -0.02, 0.001, "1"), Value("rotor_1", -0.01, 0.001, "1")]
    assert parameters_in_words(values, model.vehicle) == "front -0.0200, rotor_1 -0.0100"
    assert parameters_in_words(values[:1], model.vehicle).startswith("front -0.0200 +-")
    assert parameters_in_words(values) == "rotor_0 -0.0200, rotor_1 -0.0100"


def test_json_keeps_the_parameters(model):
    (effect,) = addition.effects_json(model.snapshot)
    assert [v.name for v in effect["parameters"]] == [f"rotor_{r}" for r in range(4)]
    np.testing.assert_allclose(effect["parameters"][3].value, -0.05)


def test_a_parameter_of_no_rotor_keeps_its_name(model):
    assert label("scale", model.vehicle) == "scale"
    assert label("rotor_1", model.vehicle) == "rotor_1"
