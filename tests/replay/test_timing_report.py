"""What the commands say about timing, and `--shift` and `--between` on the command line."""

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.diagnose import timing
from wrenchgap.plant import model_file
from wrenchgap.replay.cli.values import parse_between, parse_shifts

MODEL = model_file.load("tilt_hexarotor")
LATE = 0.15


@pytest.fixture(scope="module")
def late(logs, tmp_path_factory):
    """The ideal log with an odometry that is stamped 150 ms late."""
    path = tmp_path_factory.mktemp("late") / "late.mcap"
    return flight.write(flight.shifted(flight.load(logs.ideal), {"odometry": LATE}), path)


def test_inspect_says_by_how_much_the_odometry_lags_and_its_advice_undoes_it(late, logs, result_of, run):
    said = run("inspect", late, "-m", "tilt_hexarotor").output
    assert "The odometry lags the IMU by" in " ".join(said.split())
    body = result_of("inspect", late, "-m", "tilt_hexarotor")["logs"][0]["timing"]
    attitude = body["sensors"][0]
    assert (attitude["first"], attitude["second"]) == ("gyroscope", "odometry attitude")
    assert abs(attitude["seconds"] - LATE) < max(3 * attitude["std"], 1e-3)
    assert attitude["effect_error"] > timing.TIMING.matters
    assert {r["axis"] for r in body["responses"]} == set(flight.AXES)

    option = next(w for w in body["warnings"] if "--shift" in w).split("--shift ")[1].rstrip(".")
    again = result_of("inspect", late, "-m", "tilt_hexarotor", "--shift", option)["logs"][0]
    assert abs(again["timing"]["sensors"][0]["seconds"]) < 2e-3
    assert again["shift_s"] == {"odometry": pytest.approx(-LATE, abs=2e-3)}
    assert not any("--shift" in w for w in again["timing"]["warnings"])
    assert not any("odometry" in w for w in result_of("inspect", logs.ideal)["logs"][0]["timing"]["warnings"])


def test_a_shift_is_on_record_in_every_result(late, result_of):
    result = result_of("compare", late, "-m", "tilt_hexarotor", "--shift", f"odometry={-LATE}")
    assert result["inputs"][0]["shift_s"] == {"odometry": -LATE}
    assert any("moved by -150 ms" in note for note in result["notes"])
    assert "shift_s" not in result_of("compare", late, "-m", "tilt_hexarotor")["inputs"][0]


def test_a_shifted_log_is_the_log_as_it_was(late, logs):
    straight, moved = open_flight(logs.ideal, MODEL), open_flight(late, MODEL, shifts={"odometry": -LATE})
    a, b = straight.records[0], moved.records[0]
    rows = np.searchsorted(a.time, b.time[[5, -5]])
    assert a.time[rows] == pytest.approx(b.time[[5, -5]])
    np.testing.assert_allclose(b.state_kept.quat_EB[5], a.state_kept.quat_EB[rows[0]], atol=1e-6)


@pytest.mark.parametrize("text", ["odometry", "=0.1", "odometry=", "odometry=12ms", "odometry=nan"])
def test_a_shift_that_is_not_understood_or_given_twice_is_refused(text):
    with pytest.raises(UsageError, match="ROLE=SECONDS"):
        parse_shifts([text])
    with pytest.raises(UsageError, match="given twice"):
        parse_shifts(["imu=0.1", "imu=0.2"])


def test_only_the_part_between_the_times_is_used(logs):
    whole, part = open_flight(logs.test, MODEL), open_flight(logs.test, MODEL, between=(3.0, 9.0))
    time = part.records[0].time
    assert time[0] >= 3.0
    assert time[-1] <= 9.0
    rows = np.searchsorted(whole.records[0].time, time[5:-5])
    near = whole.records[0].time[np.minimum(rows, len(whole.records[0]) - 1)]
    assert np.abs(near - time[5:-5]).max() < 0.03


@pytest.mark.parametrize(
    ("text", "expected"), [("5:40", (5.0, 40.0)), (":40", (-np.inf, 40.0)), ("5:", (5.0, np.inf)), (None, None)]
)
def test_either_side_may_be_left_open(text, expected):
    assert parse_between(text and [text]) == (expected and (expected,))


@pytest.mark.parametrize("text", ["5", "a:b", "9:3", "3:3", "nan:4", ""])
def test_anything_else_is_refused(text):
    with pytest.raises(UsageError, match="T0:T1"):
        parse_between([text])
