"""What the commands say about timing, and `--shift` on the command line."""

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.diagnose import timing
from wrenchgap.plant import model_file
from wrenchgap.replay.cli.options import parse_shifts

LATE = 0.15


@pytest.fixture(scope="module")
def late(logs, tmp_path_factory):
    """The ideal log with an odometry that is stamped 150 ms late."""
    path = tmp_path_factory.mktemp("late") / "late.mcap"
    return flight.write(flight.shifted(flight.load(logs.ideal), {"odometry": LATE}), path)


def test_inspect_says_by_how_much_the_odometry_lags(late, result_of, run):
    said = run("inspect", late, "-m", "tilt_hexarotor").output
    assert "The odometry lags the IMU by" in " ".join(said.split())
    body = result_of("inspect", late, "-m", "tilt_hexarotor")["logs"][0]["timing"]
    attitude = body["sensors"][0]
    assert (attitude["first"], attitude["second"]) == ("gyroscope", "odometry attitude")
    assert abs(attitude["seconds"] - LATE) < max(3 * attitude["std"], 1e-3)
    assert attitude["effect_error"] > timing.MATTERS
    assert {r["axis"] for r in body["responses"]} == set(flight.AXES)


def test_the_advice_undoes_the_offset(late, logs, result_of):
    warnings = result_of("inspect", late, "-m", "tilt_hexarotor")["logs"][0]["timing"]["warnings"]
    option = next(w for w in warnings if "--shift" in w).split("--shift ")[1].rstrip(".")
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
    model = model_file.load("tilt_hexarotor")
    straight, moved = open_flight(logs.ideal, model), open_flight(late, model, shifts={"odometry": -LATE})
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
