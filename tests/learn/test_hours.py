"""Hours of log are worked on piece by piece; what comes out does not depend on the pieces."""

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight import memory, stamps
from wrenchgap.learn.data import measurement
from wrenchgap.learn.data import phases as saturation
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.learn.diagnose.timing import timing_of
from wrenchgap.plant import actuation
from wrenchgap.plant.wrench_model import WrenchModel


def arrays(record, model):
    """Everything of a record, and what the model predicts."""
    yield from (record.time, record.measured, record.commanded, record.noise, record.commands.wrench_B)
    yield from (record.commands.tilt, record.commands.rotor_speed, record.state_kept.omega_B, record.state.quat_EB)
    yield Predictor("model", WrenchModel(model.vehicle)).predict(record, model.vehicle.body)


def opened(name, flight, monkeypatch, piece):
    model = wg.load_model(name)
    with monkeypatch.context() as patch:
        if piece:
            for module in (stamps, measurement):
                patch.setattr(module, "PIECE", piece)
            for module in (actuation, memory, saturation):
                patch.setattr(module, "HOURS", piece)
            patch.setattr(memory, "SMALL", 1)
        found = open_flight(flight, model)
        offsets = [o.seconds for o in timing_of(found, model).offsets]
        return found, list(arrays(found.records[0], model)), np.array(offsets, dtype=float)


@pytest.mark.parametrize("name", ["tilt_hexarotor", "crazyflie"])
@pytest.mark.parametrize("piece", [333, 1000])
def test_pieces_do_not_show(monkeypatch, name, piece):
    flight = wg.simulate(wg.load_model(name), "hover", duration=10.0, excitation=1.0, seed=3)
    whole, numbers, offsets = opened(name, flight, monkeypatch, 0)
    parts, others, moved = opened(name, flight, monkeypatch, piece)
    assert memory._is_mapped(parts.samples[0].omega_B)
    assert not memory._is_mapped(whole.records[0].measured)
    assert parts.phases == whole.phases
    assert parts.left_out == whole.left_out
    for number, other in zip(numbers, others, strict=True):
        np.testing.assert_allclose(other, number, rtol=1e-10, atol=1e-12 * np.nanmax(np.abs(number), initial=0.0))
    np.testing.assert_allclose(moved, offsets, atol=1e-9)


def test_sizes_of_what_is_missing_are_the_same_column_by_column(monkeypatch):
    missing = np.random.default_rng(2).standard_normal((2000, 6))
    whole = saturation._sizes(missing, 0.01, 8.0)
    monkeypatch.setattr(saturation, "HOURS", 1000)
    for size, other in zip(whole, saturation._sizes(missing, 0.01, 8.0), strict=True):
        np.testing.assert_allclose(other, size, rtol=1e-12)
        assert size.shape == (2000,)
        assert size.max() > 0.5


def test_every_row_is_in_one_piece(monkeypatch):
    monkeypatch.setattr(stamps, "PIECE", 7)
    for count in (0, 1, 6, 7, 8, 50):
        rows = np.concatenate([np.arange(count)[piece] for piece in stamps.pieces(count)])
        np.testing.assert_array_equal(rows, np.arange(count))
