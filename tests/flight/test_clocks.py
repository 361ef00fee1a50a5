"""Two clocks in one log: found, mapped, reported."""

import numpy as np
import pytest

from wrenchgap.flight import inspect
from wrenchgap.flight.clocks import clock_map, relation, without_jumps

RNG = np.random.default_rng(5)


def ns(seconds, start=0):
    return start + np.round(np.asarray(seconds) * 1e9).astype(np.int64)


def test_relation_of_a_drifting_clock_under_outliers():
    log = np.arange(0, 60, 0.01)
    header = 3.0 + 0.5 * log
    header[::100] += 4.0
    found = relation(ns(log), ns(header))
    assert found.rate == pytest.approx(0.5, abs=1e-6)
    assert not found.same
    assert found.residual < 1e-6


def test_map_follows_the_edge_of_least_delay():
    sim = np.arange(0, 20, 0.01)
    delay = RNG.exponential(0.01, len(sim))
    log = np.cumsum(np.full(len(sim), 0.02)) + 0.15 * np.sin(0.5 * sim)  # a rate that breathes
    to_sim = clock_map(ns(np.maximum.accumulate(log + delay)), ns(sim))
    inner = (sim > 1) & (sim < 19)
    error = (to_sim(ns(log)) - ns(sim))[inner] * 1e-9
    assert np.percentile(np.abs(error), 95) < 0.006
    straight = np.polyval(np.polyfit(log, sim, 1), log)
    assert np.std(error) < 0.2 * np.std(straight - sim)


def test_map_and_inverse_undo_each_other():
    log = np.arange(0, 10, 0.01)
    mapped = clock_map(ns(log, 10**18), ns(0.4 * log + 0.02 * np.sin(log)))
    again = mapped.inverse(mapped(ns(log, 10**18)))
    assert np.max(np.abs(again - ns(log, 10**18))) <= 5


def bare(recording, logs, time, log_s):
    """With a command without stamps."""
    columns = {name.removeprefix("wrench."): values for name, values in logs.wrench(time).items()}
    return recording.series("/sim/command/wrench", "geometry_msgs/msg/Wrench", log_s, columns)


def test_a_flight_is_told_in_the_clock_of_its_motion(logs, loaded):
    """A simulator at half real time: odometry in its time, the command without stamps."""
    sim = np.arange(0.01, 10, 0.01)
    found = loaded(bare(logs.Recording().plain("/odometry", sim, 2.0 * sim, sim), logs, sim, 2.0 * sim))
    assert found.odometry.time[-1] - found.odometry.time[0] == pytest.approx(9.98)
    expected = np.sin(0.5 * (found.commanded.time + found.start_ns * 1e-9))
    np.testing.assert_allclose(found.commanded.wrench_B[:, 0], expected, atol=2e-3)
    slope = np.gradient(found.odometry.position_E, found.odometry.time, axis=0)[5:-5]
    np.testing.assert_allclose(slope, logs.Motion(sim).velocity_E[5:-5], atol=1e-3)
    (note,) = [note for note in found.notes if note.startswith("Two clocks")]
    assert "its clock runs at 0.5 times the log's" in note
    assert "/sim/command/wrench" in note


def test_bends_are_reported(logs, loaded):
    sim = np.arange(0.01, 20, 0.01)
    log = 2.0 * sim + 0.1 * np.sin(sim)
    found = loaded(bare(logs.Recording().plain("/odometry", sim, log, sim), logs, sim, log))
    assert any("not in a linear relation (residual" in note for note in found.notes)
    expected = np.sin(0.5 * (found.commanded.time + found.start_ns * 1e-9))
    np.testing.assert_allclose(found.commanded.wrench_B[:, 0], expected, atol=5e-3)


def test_an_offset_of_one_sensor_is_mapped_away(logs, loaded):
    time = np.arange(0, 5, 0.01)
    since_boot = time + 77.0
    found = loaded(logs.Recording().plain("/command/wrench", time).plain("/imu", time, stamp_s=since_boot))
    assert found.start_ns == pytest.approx(logs.START_NS, abs=1000)
    np.testing.assert_allclose(found.imu.time, time, atol=1e-6)
    assert any("Two clocks: /imu" in note for note in found.notes)


def test_one_foreign_clock_for_all_needs_no_map(logs, loaded):
    time = np.arange(0.01, 5, 0.01)
    found = loaded(logs.Recording().plain("/command/wrench", time, 3 * time, time).plain("/imu", time, 3 * time, time))
    np.testing.assert_allclose(found.commanded.time, found.imu.time, atol=1e-9)
    np.testing.assert_allclose(found.imu.time, time - time[0], atol=1e-9)


def clock_checks(recording, path):
    return [(c.level, c.words) for c in inspect(recording.save(path / "log.mcap")).checks if c.name == "clock"]


@pytest.mark.parametrize("rate", [1.0, 3.0])
def test_one_autopilot_that_counts_from_its_start_is_one_clock(rate, logs, loaded, tmp_path):
    """Every topic bears the stamps of one clock: nothing is mapped, and nothing is warned of."""
    time = np.arange(0.01, 10, 0.01)
    recording = logs.Recording()
    for topic in ("/command/wrench", "/imu", "/odometry"):
        late = np.maximum.accumulate(rate * time + RNG.exponential(0.01, len(time)))
        recording.plain(topic, time, late, 77.0 + time)
    found = loaded(recording)
    assert not any("Two clocks" in note for note in found.notes)
    np.testing.assert_allclose(found.imu.time, time - time[0], atol=1e-9)
    ((level, words),) = clock_checks(recording, tmp_path)
    assert level == "ok"
    assert "one clock" in words


def test_messages_that_arrive_in_bursts_have_no_rate_of_their_own(logs, loaded, tmp_path):
    """A radio that sends every 0.5 to 0.9 s: in 4 s of log that tilts the line of the arrivals by 4 per cent."""
    recording, time = logs.Recording(), np.arange(0.01, 4, 0.01)
    for topic, every in (("/imu", 0.5), ("/command/wrench", 0.7), ("/odometry", 0.9)):
        arrived = np.maximum.accumulate(np.ceil(time / every) * every)
        recording.plain(topic, time, arrived, logs.START_NS * 1e-9 + time)
    found = loaded(recording)
    assert not any("Two clocks" in note for note in found.notes)
    for series in (found.imu, found.commanded, found.odometry):
        np.testing.assert_allclose(series.time, time - time[0], atol=1e-6)
    assert all("a slow link" in words for _, words in clock_checks(recording, tmp_path))


def test_transport_delay_is_no_second_clock(logs, loaded):
    time = np.arange(0, 5, 0.01)
    late = np.sort(time + 0.03 + RNG.exponential(0.005, len(time)))
    found = loaded(logs.Recording().plain("/imu", time, late, logs.START_NS * 1e-9 + time))
    np.testing.assert_allclose(found.imu.time, time, atol=1e-6)
    assert not any("clock" in note for note in found.notes)


def test_empty_headers_fall_back_to_log_time(logs, loaded):
    time = np.arange(0, 5, 0.01)
    found = loaded(logs.Recording().plain("/imu", time, stamp_s=None))
    np.testing.assert_allclose(found.imu.time, time, atol=1e-9)
    assert any("Log time is used for /imu" in note for note in found.notes)


def test_stamps_that_are_the_log_times_are_the_fit_of_almost_the_same():
    """One nanosecond apart in one place, everything is fitted: rate, offset and residual go on without a step."""
    log = 1_700_000_000_000_000_000 + np.cumsum(np.random.default_rng(3).integers(1_000_000, 9_000_000, 5000))
    almost = log.copy()
    almost[2500] += 1
    same, fitted = relation(log, log.copy()), relation(log, almost)
    assert (same.rate, same.offset, same.residual) == (1.0, 0.0, 0.0)
    assert fitted.rate == pytest.approx(1.0, abs=1e-12)
    assert fitted.residual < 1e-9
    assert np.array_equal(without_jumps(log, log.copy())[0], log)
    assert without_jumps(log, log.copy())[1] == without_jumps(log, almost)[1] == ()
