"""Residuals made by hand land in the right bins; noise lands nowhere."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.measurement import derivative, low_pass
from wrenchgap.learn.diagnose.failure_map import failure_map
from wrenchgap.learn.diagnose.quantities import quantities


def noise(data, rng):
    """Filtered sensor noise (K, 6): white in the force, differentiated in the torque, sized as the records say."""
    out = []
    for r in data.records:
        raw = low_pass(rng.standard_normal((len(r.state.time) + 400, 6)), r.dt, r.cutoff_hz)[200:-200]
        raw[:, 3:] = derivative(raw[:, 3:], r.dt)
        kept = raw[r.keep]
        out.append(kept / kept.std(axis=0) * r.noise)
    return np.concatenate(out)


def quantity(data, name):
    return next(q.values for q in quantities(data)[0] if q.name == name)


def test_a_torque_that_depends_on_heading_lands_there(turning):
    residual = noise(turning, np.random.default_rng(0))
    residual[:, 5] += 0.1 * np.sin(np.radians(quantity(turning, "heading")))
    first = failure_map(turning, residual).dependences[0]
    assert (first.name, first.significant) == ("heading", True)
    assert first.of_mean > 0.7
    assert int(np.argmax(first.axes_mean)) == 5
    b = first.binned
    sectors = np.isfinite(b.low)
    # mean of 0.1 sin over a sector of 45 deg: 0.1 sin(centre) sinc(22.5 deg), if all of it was flown equally long
    centre = np.radians(0.5 * (b.low + b.high)[sectors])
    assert b.mean[sectors, 5] == pytest.approx(0.1 * np.sin(centre) * np.sinc(22.5 / 180), abs=0.025)


def test_an_error_at_large_tilt_sits_there(tumbling):
    """Nothing but noise below 50 deg: all of the error above the noise is in the bins above."""
    residual = noise(tumbling, np.random.default_rng(1))
    phase = np.sign(np.sin(2 * np.pi * 0.9 * np.concatenate([r.time for r in tumbling.records])))
    residual[:, 0] += np.where(quantity(tumbling, "tilt") > 50, 0.8 * phase, 0.0)  # no mean, only size
    found = failure_map(tumbling, residual)
    first, grid = found.dependences[0], found.grid
    assert first.name == "tilt"
    assert first.of_size > max(0.5, 2 * first.of_mean)
    b = first.binned
    assert b.whole_share[b.low > 49].sum() > 0.6
    assert b.whole_share[b.high < 50].sum() < 0.1
    assert b.time_share[b.low > 49].sum() < 0.5
    assert (grid.x, grid.y) == ("tilt", "direction")
    rows = 0.5 * (grid.x_edges[1:] + grid.x_edges[:-1])
    assert np.nanmin(grid.force[rows > 57]) > 3 * np.nanmax(grid.force[rows < 43])


def test_bins_account_for_every_sample(tumbling):
    rng = np.random.default_rng(2)
    residual = noise(tumbling, rng) + rng.standard_normal(6)
    for d in failure_map(tumbling, residual, permutations=20).dependences:
        b = d.binned
        assert b.samples.sum() == len(residual)
        assert b.time_share.sum() == pytest.approx(1)
        assert b.share.sum(axis=0) == pytest.approx(np.ones(6))
        assert b.whole_share.sum() == pytest.approx(1)
        assert (b.samples @ b.rms**2) / len(residual) == pytest.approx(np.mean(residual**2, axis=0))
        assert (b.samples @ b.mean) / len(residual) == pytest.approx(residual.mean(axis=0))
        assert b.noise == pytest.approx(np.broadcast_to(tumbling.noise, b.noise.shape))
        if not d.circular:
            assert b.samples.min() > 0.9 * b.samples.max()


def alarms(data, residuals):
    """In how many of the residuals a quantity other than time is significant."""
    maps = [failure_map(data, z, permutations=200, seed=k) for k, z in enumerate(residuals)]
    return sum(any(d.name != "time" for d in found.significant) for found in maps)


def test_noise_goes_with_nothing(tumbling):
    """p is corrected for all quantities: one flight in a hundred may cry wolf, two in twenty are one in 60."""
    rng = np.random.default_rng(3)
    assert alarms(tumbling, [noise(tumbling, rng) for _ in range(20)]) <= 1


def test_slow_drift_does_not_pass_for_other_quantities(tumbling):
    """A residual coloured over half a second, which a test of single samples would see everywhere."""
    rng = np.random.default_rng(4)
    kept = np.exp(-tumbling.records[0].dt * tumbling.records[0].keep.step / 0.5)
    drifts = [lfilter([1.0], [1.0, -kept], rng.standard_normal(tumbling.measured.shape), axis=0) for _ in range(20)]
    assert alarms(tumbling, drifts) <= 2


def test_an_offset_between_flights_is_no_dependence(fly, hexarotor):
    """An accelerometer's bias differs from flight to flight, and so do height and heading."""
    parts = [fly("none", None, name, seconds=20, seed=4)[0] for name in ("turn", "train")]
    records = [replace(r, flight=str(k)) for k, p in enumerate(parts) for r in p.records]
    both = dataset(records, hexarotor)
    residual = noise(both, np.random.default_rng(5))
    residual[:, :3] += np.where(both.flight[:, None] == 0, 0.1, -0.1)
    assert failure_map(both, residual).significant == ()


def test_a_manoeuvre_as_long_as_a_block_is_seen(turning):
    """Shuffling blocks alone would leave a period of 2 s in place."""
    record = turning.records[0]
    wave = np.sin(np.pi * record.time)
    state = replace(record.state_kept, omega_B=np.outer(wave, [0, 0, 1]))
    residual = noise(turning, np.random.default_rng(6))
    residual[:, 5] += 0.01 * wave
    found = failure_map(replace(turning, records=(replace(record, state_kept=state),)), residual)
    assert "rate_z" in {d.name for d in found.significant}


def test_a_log_without_pose_is_mapped_by_what_it_has(turning, hexarotor):
    bare = dataset([replace(r, has_pose=False) for r in turning.records], hexarotor)
    found = failure_map(bare, noise(bare, np.random.default_rng(7)), permutations=20)
    assert {"tilt", "height", "voltage"} <= set(found.lacking)
    assert (found.grid.x, found.grid.y) == ("thrust", "rate")
