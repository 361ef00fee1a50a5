"""What `add` says of values that may stand for something else."""

import numpy as np

import wrenchgap as wg
from wrenchgap.replay.present.addition import mixed

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
