"""Flights of the independent engine (MuJoCo), which shares no formula with the code under test."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.measurement import prepare
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant import model_file


@pytest.fixture(scope="session")
def hexarotor():
    return model_file.load("tilt_hexarotor")


@pytest.fixture(scope="session")
def fly(hexarotor, once):
    """Dataset of a flight with a hidden effect: fly("com_offset", size, "train", seed=..., seconds=...)."""
    from benchmarks.hidden_effects import engine

    cache = {}

    def made(*args, **kwargs):
        key = f"engine.fly {args!r} {sorted(kwargs.items())!r}"
        if key not in cache:
            found, truth = once(key, lambda: engine.fly(*args, **kwargs))
            records = [prepare(s, hexarotor.vehicle) for s in flight.uniform(found)]
            cache[key] = (dataset(records, hexarotor), truth)
        return cache[key]

    return made


@pytest.fixture(scope="session")
def plain(fly):
    """Nothing hidden, 25 s."""
    return fly("none", None, "train", seed=23, seconds=25)[0]


@pytest.fixture(scope="session")
def tumbling(fly):
    """Nothing hidden, 40 s, tilts to 70 deg."""
    return fly("none", None, "train", seconds=40, seed=5)[0]


@pytest.fixture(scope="session")
def turning(fly):
    """Nothing hidden, through all headings."""
    return fly("none", None, "turn", seconds=30, seed=31)[0]


def hidden(fly, effect, keys, **flight):
    """Dataset of a flight with `effect`, and the true values of its parameters."""
    data, truth = fly(effect, None, "train", **flight)
    return SimpleNamespace(data=data, values=np.array([truth.parameters[effect][key] for key in keys]))


@pytest.fixture(scope="session")
def offset(fly):
    return hidden(fly, "com_offset", "xyz", seed=21, seconds=25)


@pytest.fixture(scope="session")
def payload(fly):
    return hidden(fly, "payload", ("mass", "x", "y", "z"), seed=3, seconds=20)


@pytest.fixture(scope="session")
def hand_made():
    """A process of three torques whose parts are drawn, not fitted."""

    def made(count=40, linear=True):
        rng = np.random.default_rng(0)
        return GaussianProcess(
            outputs=("torque_x", "torque_y", "torque_z"),
            input_mean=np.array([1.0, -2.0, 39.0, 0.1, 0.0, -0.1]),
            input_scale=np.array([8.0, 7.0, 5.0, 0.3, 0.4, 0.2]),
            output_scale=np.array([0.2, 0.3, 0.5]),
            mean_coefficients=rng.normal(size=(3, 7)) * linear,
            inputs=rng.normal(size=(count, 6)),
            residuals=rng.normal(size=(count, 3)),
            lengthscales=rng.uniform(0.8, 4, size=(3, 6)),
            signal_variance=np.array([0.7, 1.5, 3.0]),
            noise_variance=np.array([0.01, 0.05, 0.2]),
            sigma_training=np.full(3, 0.1),
            mismatch_max=np.ones(3),
        )

    return made
