"""What `add` says of values that may stand for something else."""

from dataclasses import replace

import numpy as np

import wrenchgap as wg
from wrenchgap.replay.present.addition import alike, mixed

MODEL = wg.load_model("tilt_hexarotor")


def test_of_an_effect_that_leaves_many_times_the_noise_it_is_said_that_others_may_be_in_its_values(logs):
    """A mass in place of a centre of mass that moved leaves all of its torque; the centre of mass leaves noise."""
    (flight,) = wg.open_flights(logs.train, MODEL)
    right, wrong = (wg.add(MODEL, (name,), flight) for name in ("com_offset", "mass"))
    assert mixed(right) == []
    (said,) = mixed(wrong)
    assert "Nm are left of torque_" in said
    assert np.nanmax(wrong.trial.after / wrong.trial.noise) > 5.0
    assert said in " ".join(str(wrong).split())


def test_of_a_model_that_predicts_worse_it_is_said_to_keep_the_other(logs):
    (flight,) = wg.open_flights(logs.train, MODEL)
    better = wg.add(MODEL, ("com_offset",), flight)
    worse = replace(better, trial=replace(better.trial, change=0.5, t=-8.0))
    words = "tilt_hexarotor without it predicts these flights better: keep that model"
    assert [words in " ".join(str(one).split()) for one in (better, worse)] == [False, True]


def test_two_effects_that_do_the_same_are_said_to_be_known_together_alone(logs):
    """In hover a share of the thrust is a constant force along z; of a vehicle that turns over it is none."""
    small = wg.load_model("crazyflie")
    hover = wg.open_flights([wg.simulate(small, "hover", duration=8, seed=1)], small)
    for model, flights, same in ((small, hover, True), (MODEL, wg.open_flights(logs.train, MODEL), False)):
        found = wg.add(model, ["constant_wrench", "thrust_scale"], flights)
        said = alike(found.fit, model.vehicle)
        assert any("constant_wrench force_z and thrust_scale" in text for text in said) == same
