"""Trajectory files: what is written is what is read, and what is wrong is said in one line."""

import csv
import tracemalloc

import numpy as np
import pytest

from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.trajectory.file import COLUMNS, TrajectoryFile, dumps, load, loads, write_csv
from wrenchgap.plant.trajectory.maneuvers import Moves, Shake, Shift, Swing, Tilt, Turn

MOVES = (
    Tilt(0.5, 6.0, np.radians(55.27), np.radians(30.0), 1.8),
    Turn(1.0, 8.0, np.radians(360.0)),
    Shift(7.0, 2.0, (0.0, 0.0, -0.5), 0.9),
    Swing(2.0, 7.0, (0.5, 0.0, 0.1), 2.5, np.radians(90.0), 1.5),
    Shake(2.0, 7.0, 0.02, np.radians(3.0), 0.3, 2.0, ("x", "yaw"), 1.0, 4),
)
FILE = TrajectoryFile("one", Moves(10.0, (0.0, 0.1, 1.5), MOVES), "hexa", {"separates": ["a", "b"]})


def test_what_is_written_is_read_and_flies_the_same():
    text = dumps(FILE)
    again = loads(text)
    assert again.trajectory.moves[1:4] == MOVES[1:4]
    assert (again.name, again.vehicle, again.purpose) == (FILE.name, FILE.vehicle, FILE.purpose)
    before, after = (file.trajectory.at(np.linspace(0.0, 10.0, 500)) for file in (FILE, again))
    for part in ("position_E", "quat_ED", "acceleration_E", "omega_dot_D"):
        np.testing.assert_allclose(getattr(after, part), getattr(before, part), atol=1e-9)
    assert dumps(again) == text
    assert loads(dumps(again)).trajectory == again.trajectory
    leaning = Moves(10.0, (0.0, 0.0, 1.0), (MOVES[3],), follows_thrust=True)
    assert loads(dumps(TrajectoryFile("x", leaning))).trajectory.follows_thrust


def test_the_table_holds_the_reference(tmp_path):
    write_csv(FILE, tmp_path / "f.csv", 50.0)
    with (tmp_path / "f.csv").open(encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    assert tuple(rows[0]) == COLUMNS
    values = np.array(rows[1:], dtype=float)
    assert len(values) == 501
    velocity = np.gradient(values[:, 1:4], values[:, 0], axis=0)[5:-5]
    np.testing.assert_allclose(velocity, values[5:-5, 8:11], atol=2e-2)
    np.testing.assert_allclose(np.linalg.norm(values[:, 4:8], axis=1), 1.0, atol=1e-8)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("schema = 1", "schema = 7", "schema: got 7, this version of wrenchgap reads 1"),
        ("angle_deg = 55.27", "angle_dg = 55.27", r"moves\[0\] \(tilt\).angle_dg: .* did you mean 'angle_deg'"),
        ('kind = "turn"', 'kind = "tun"', r"moves\[1\].kind: got 'tun', available: tilt, turn"),
        ('attitude = "free"', 'attitude = "loose"', "expected one of free, thrust"),
        ("ramp = 1.8", "ramp = nan", r"ramp: got nan, expected a finite number"),
        ("ramp = 1.8", "ramp = 4.0", r"moves\[0\]: tilt: ramp is 4 s"),
        ("ramp = 1.8", "ramp = 1e-9", r"moves\[0\]: tilt: ramp is 1e-09 s; .* expected 0.1 to 3 s"),
        ("period = 2.5", "period = 1e-300", r"moves\[3\]: swing: period is 1e-300 s, expected 0.1 s or longer"),
        ("duration = 8.0", "duration = 1e-300", r"moves\[1\]: turn: .* lasts 0.1 s or longer"),
        ("high_hz = 2.0", "high_hz = 1e6", r"moves\[4\]: shake: the band is 0.3 to 1e\+06 Hz; .* 20 Hz at most"),
        ("[trajectory]", "[vehicle]", "is a model file, not a trajectory"),
        ("schema = 1", "schema = ", "is not TOML"),
    ],
)
def test_a_bad_file_is_told_in_one_line_with_its_name(tmp_path, old, new, words):
    path = tmp_path / "bad.toml"
    text = dumps(FILE)
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(UsageError, match=words) as error:
        load(path)
    assert str(error.value).startswith("bad.toml: ")
    assert "\n" not in str(error.value)
    with pytest.raises(UsageError, match="cannot be read as a trajectory file: No such file"):
        load(tmp_path / "gone.toml")


def test_many_moves_and_many_harmonics_are_refused_before_they_take_memory():
    with pytest.raises(UsageError, match=r"moves: got 501, expected at most 500"):
        loads(dumps(TrajectoryFile("x", Moves(10.0, (0.0, 0.0, 1.0), (Turn(0.0, 1.0, 1.0),) * 501))))
    shakes = tuple(Shake(0.0, 10.0, 0.01, 0.0, 0.1, 20.0, ("x",), seed=k) for k in range(12))
    with pytest.raises(UsageError, match=r"moves\[10\] \(shake\): .* harmonics, expected at most 4,000"):
        loads(dumps(TrajectoryFile("x", Moves(10.0, (0.0, 0.0, 1.0), shakes))))


def test_memory_does_not_grow_with_the_number_of_moves():
    """The sum is that of the moves one by one; of each the arrays are gone before the next is made."""
    time = np.linspace(0.0, 20.0, 20_000)
    sums = Moves(20.0, (0.0, 0.0, 0.0), (Shift(0.0, 20.0, (1.0, 0.0, 0.0)),) * 200)
    one = Moves(20.0, (0.0, 0.0, 0.0), sums.moves[:1]).at(time).position_E  # kernels are compiled from here on
    tracemalloc.start()
    position = sums.at(time).position_E
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_allclose(position, 200.0 * one)
    assert peak < 100 * position.nbytes  # 600, if all are kept
