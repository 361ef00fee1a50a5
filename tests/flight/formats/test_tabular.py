"""Tables with a header become flights, in the units that the header states; nothing is guessed in silence."""

import warnings

import numpy as np
import pandas as pd
import pyarrow
import pyarrow.parquet
import pytest

from wrenchgap import flight
from wrenchgap.flight.budget import BudgetError
from wrenchgap.flight.errors import LogError


def columns(logs, time, degrees=False):
    motion, out = logs.Motion(time), {}
    for i, axis in enumerate("xyz"):
        rate = motion.omega_B[:, i]
        out |= {f"gyro_{axis} [deg/s]": np.degrees(rate)} if degrees else {f"gyro_{axis}": rate}
        out[f"acc_{axis}"] = motion.specific_force_B[:, i]
        out[f"pos_{axis}"] = motion.position_E[:, i]
        out[f"v{axis}"] = motion.velocity_E[:, i]
    out |= {f"q{axis}": motion.quat_EB[:, i] for i, axis in enumerate("wxyz")}
    return out | {f"motor_{i + 1}": 500.0 + i + 0.0 * time for i in (2, 0, 1)}  # in no order


@pytest.fixture
def time():
    return np.arange(0, 4.0, 0.01)


def agrees(found, logs, time):
    motion = logs.Motion(time)
    np.testing.assert_allclose(found.imu.time, time, atol=1e-7)
    np.testing.assert_allclose(found.imu.omega_B, motion.omega_B, atol=1e-9)
    np.testing.assert_allclose(found.imu.specific_force_B, motion.specific_force_B, atol=1e-9)
    np.testing.assert_allclose(found.odometry.quat_EB, motion.quat_EB, atol=1e-9)
    np.testing.assert_allclose(found.odometry.velocity_E, motion.velocity_E, atol=1e-9)
    np.testing.assert_allclose(found.actuators.rotor_speed[0], [500.0, 501.0, 502.0])


@pytest.mark.parametrize(("name", "scale"), [("t", 1.0), ("time [ms]", 1e3), ("timestamp_us", 1e6), ("TimeNS", 1e9)])
@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_times_and_rates_in_their_units(logs, time, tmp_path, name, scale, form):
    frame = pd.DataFrame({name: time * scale} | columns(logs, time, degrees=True))
    path = tmp_path / f"log.{form}"
    frame.to_csv(path, index=False) if form == "csv" else frame.to_parquet(path)
    agrees(flight.load(path), logs, time)


@pytest.mark.parametrize(("scale", "unit"), [(1.0, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_a_time_without_a_unit_is_read_by_its_step_and_a_note_says_so(logs, time, tmp_path, scale, unit):
    path = tmp_path / "log.csv"
    pd.DataFrame({"time": np.round(time * scale, 6)} | columns(logs, time)).to_csv(path, index=False)
    found = flight.load(path)
    agrees(found, logs, time)
    assert any("no unit" in note and f"time_{unit}" in note for note in found.notes)


@pytest.mark.parametrize("first", [1.7e9, 1.7e12, 1.7e15, 1.7e18])
def test_times_since_1970(logs, time, tmp_path, first):
    path = tmp_path / "log.csv"
    stamps = np.round(first * (1.0 + time / 1.7e9)).astype(np.int64) if first > 2e9 else first + time
    pd.DataFrame({"time": stamps} | columns(logs, time)).to_csv(path, index=False)
    found = flight.load(path)
    assert abs(found.start_ns - 1.7e18) < 1e9
    np.testing.assert_allclose(found.imu.time[-1], time[-1], atol=1e-3)


def test_dates_semicolons_commas_comments_and_a_byte_order_mark(logs, time, tmp_path):
    frame = pd.DataFrame({"timestamp": pd.to_datetime(time, unit="s", origin="2024-05-01")} | columns(logs, time))
    path = tmp_path / "log.csv"
    text = frame.to_csv(index=False, sep=";", decimal=",")
    path.write_text("﻿# flown on Monday, by hand\n" + text, encoding="utf-8")
    agrees(flight.load(path), logs, time)


def test_dates_that_no_count_of_nanoseconds_reaches_are_left_out(logs, time, tmp_path):
    dates = pd.to_datetime(time, unit="s", origin="2024-05-01").astype(str).to_numpy(dtype=object)
    dates[5], dates[9] = "0001-01-25", "9999-12-31"
    path = tmp_path / "log.csv"
    pd.DataFrame({"timestamp": dates} | columns(logs, time)).to_csv(path, index=False)
    found = flight.load(path)
    np.testing.assert_allclose(found.imu.time, np.delete(time, [5, 9]), atol=1e-7)
    assert any("2 row(s)" in note and "no time" in note for note in found.notes)


def test_dates_of_several_forms_are_read_and_nothing_stands_on_the_screen(logs, time, tmp_path):
    dates = pd.to_datetime(time, unit="s", origin="2024-05-01").astype(str).to_numpy(dtype=object)
    dates[0], dates[1] = "no date", "1 May 2024 00:00:00.01"
    path = tmp_path / "log.csv"
    pd.DataFrame({"timestamp": dates} | columns(logs, time)).to_csv(path, index=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = flight.load(path)
    assert len(found.imu.time) > 0


def test_numbers_beyond_all_sense_put_nothing_on_the_screen(logs, time, tmp_path):
    table = pd.DataFrame({"time_us": time * 1e6} | columns(logs, time))
    table.loc[390:, "time_us"] = -1e308
    table.loc[:300, ["acc_x", "acc_z"]] = -1e308
    table.to_csv(tmp_path / "log.csv", index=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = flight.inspect(tmp_path / "log.csv")
    assert any("10 row(s) of log.csv have no time" in note for note in found.notes)


def test_rows_whose_times_have_decimal_commas_are_not_left_out_of_a_flight(logs, time, tmp_path):
    """Every third row is: what is left would be another flight. One such row is damage, and is counted."""
    frame = pd.DataFrame({"t": time} | columns(logs, time)).astype({"t": object})
    path = tmp_path / "log.csv"
    frame.loc[5, "t"] = "0,05"
    frame.to_csv(path, index=False)
    assert any("1 row(s) of log.csv have no time" in note for note in flight.load(path).notes)
    frame.loc[1::3, "t"] = "0,01"
    frame.to_csv(path, index=False)
    with pytest.raises(flight.LogError, match=r"134 of 400 rows have no time: column t of row 2 is '0,01', 12.34"):
        flight.load(path)


def test_topics_of_different_rates_share_a_table_with_empty_cells(logs, time, tmp_path):
    frame = pd.DataFrame({"t_s": time} | columns(logs, time))
    slow = [name for name in frame if name.startswith(("pos", "q", "v"))]
    frame.loc[np.arange(len(frame)) % 5 != 0, slow] = np.nan
    path = tmp_path / "log.csv"
    frame.to_csv(path, index=False)
    found = flight.load(path)
    assert len(found.imu.time) == 400
    assert len(found.odometry.time) == 80
    assert not found.odometry.dropped


def test_mapping_by_hand(logs, time, tmp_path):
    given = columns(logs, time)
    renamed = {"t": time} | {f"c{i}_{'abcdefghijklmnopqrst'[i]}": values for i, values in enumerate(given.values())}
    path = tmp_path / "log.csv"
    pd.DataFrame(renamed).to_csv(path, index=False)
    order = list(given)
    place = [order.index(f"{kind}_{axis}") for kind in ("gyro", "acc") for axis in "xyz"]
    found = flight.load(path, {"imu": f"/table.data[{','.join(map(str, place))}]"})
    np.testing.assert_allclose(found.imu.omega_B, logs.Motion(time).omega_B, atol=1e-9)


def test_roll_pitch_and_yaw(time, tmp_path):
    frame = pd.DataFrame({"t_s": time, "roll_deg": 0.0 * time, "pitch_deg": 0 * time, "yaw_deg": 90.0 + 0 * time})
    for axis in "xyz":
        frame[axis] = np.sin(time)
    path = tmp_path / "log.csv"
    frame.to_csv(path, index=False)
    nose = flight.so3.rotate(flight.load(path).odometry.quat_EB[0], np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(nose, [0.0, 1.0, 0.0], atol=1e-9)


def test_normalised_and_pwm_commands(time, tmp_path):
    for name, value, unit in (("motor", 0.4, "normalised"), ("pwm", 1500.0, "pwm"), ("motor", 400.0, "rad/s")):
        path = tmp_path / "log.csv"
        pd.DataFrame({"t": time} | {f"{name}_{i}": value + 0 * time for i in range(4)}).to_csv(path, index=False)
        assert flight.load(path).actuators.unit == unit


def test_damaged_cells_lines_and_times_are_counted(logs, time, tmp_path):
    path = tmp_path / "log.csv"
    pd.DataFrame({"t": time} | columns(logs, time)).to_csv(path, index=False)
    lines = path.read_text().splitlines()
    lines[50] = lines[50].replace(lines[50].split(",")[3], "oops", 1)
    lines[60] += ",1,2,3"
    lines[70] = "," + lines[70].split(",", 1)[1]
    lines[80], lines[90] = lines[90], lines[80]
    path.write_text("\n".join(lines)[:-30])
    notes = " ".join(flight.load(path).notes)
    for words in ("hold no number", "more cells than the header", "have no time", "put in order"):
        assert words in notes, words


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"1,2,3\n4,5,6\n", "no header line"),
        (b"a,b,c\n1,2,3\n", "no column of times"),
        (b",".join(b"column_%d" % k for k in range(500)) + b"\n1\n", "column_11 and 488 more"),
        (b"time,gyro_x\n", "holds no message"),
        (b"PAR1garbage", "not a readable Parquet"),
        (b"time,a\n" + bytes(range(128, 256)), "1 of 1 rows have no time"),
    ],
)
def test_no_flight_in_one_line(content, words, tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(LogError, match=words) as caught:
        flight.load(path)
    assert "\n" not in str(caught.value)


def test_a_delimiter_at_the_end_of_each_line_moves_no_column(logs, time, tmp_path):
    path = tmp_path / "ends.csv"
    text = pd.DataFrame({"time [s]": time} | columns(logs, time)).to_csv(index=False)
    first, *rest = text.splitlines()
    path.write_text("\n".join([first, *(f"{line}," for line in rest)]), encoding="utf-8")
    agrees(flight.load(path), logs, time)


def test_rows_with_a_name_that_the_header_does_not_have_are_read_as_R_writes_them(logs, time, tmp_path):
    path = tmp_path / "rows.csv"
    frame = pd.DataFrame({"time [s]": time} | columns(logs, time))
    frame.to_csv(path, index_label=False)
    agrees(flight.load(path), logs, time)
    text = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([text[0], *(f"{line},1" for line in text[1:])]), encoding="utf-8")
    with pytest.raises(LogError, match="rows have 2 cells more than the header"):
        flight.load(path)


def test_words_with_delimiters_in_all_rows_move_no_column(logs, time, tmp_path):
    path = tmp_path / "words.csv"
    pd.DataFrame({"time [s]": time, "note": "hover, calm"} | columns(logs, time)).to_csv(path, index=False)
    agrees(flight.load(path), logs, time)


def test_columns_of_one_name_are_told_apart(logs, time, tmp_path):
    """Of a column `index` beside an index that has no name, as pandas writes both; and of a thousand alike, at once."""
    table = {"time": time, "index": time, "__index_level_0__": 2.0 * time} | columns(logs, time)
    path = tmp_path / "two.parquet"
    pyarrow.parquet.write_table(pyarrow.table(table), path)
    found = flight.load(path)
    agrees(found, logs, time)
    many = tmp_path / "many.csv"
    frame = pd.DataFrame({"time [s]": time} | columns(logs, time))
    alike = pd.DataFrame(np.ones((len(time), 500)), columns=["x"] * 500)
    pd.concat([frame, alike], axis=1).to_csv(many, index=False)
    agrees(flight.load(many), logs, time)


def test_bytes_that_are_no_text_hold_no_numbers(logs, time, tmp_path):
    path = tmp_path / "bytes.parquet"
    odd = pyarrow.array([b"\xff\xfe"] * len(time), pyarrow.binary())
    pyarrow.parquet.write_table(pyarrow.table({"time": time, "blob": odd} | columns(logs, time)), path)
    agrees(flight.load(path), logs, time)


def test_a_whole_number_that_no_float_holds_is_no_number(tmp_path):
    big = "9" * 400
    rows = "".join(f"{0.01 * i},{big if i == 3 else 1}\n" for i in range(50))
    (tmp_path / "log.csv").write_text("time_s,gyro_x\n" + rows)
    found = flight.inspect(tmp_path / "log.csv")
    assert [topic.count for topic in found.topics] == [50]


def test_dates_of_no_form_are_read_within_the_budget(tmp_path):
    rows = "".join(f"2026-11-24 10:{i % 60}:{i % 60}.{i} PM +00:00 (x),1\n" for i in range(20_000))
    (tmp_path / "log.csv").write_text("time,gyro_x\n" + rows)
    with pytest.raises(BudgetError, match="--budget"):
        flight.inspect(tmp_path / "log.csv", budget="0.2s")


def test_speeds_in_two_units_are_refused(logs, time, tmp_path):
    """Of a column in pulses beside one in rpm the pulses were speeds, and nobody said so."""
    table = pd.DataFrame({"t": time} | {k: v for k, v in columns(logs, time).items() if not k.startswith("motor")})
    table = table.assign(**{"motor_1 [rpm]": 5000.0, "motor_2 [us]": 1500.0})
    table.to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(LogError, match=r"'motor_2 \[us\]' is in pwm, others of rotor in rpm; write one unit"):
        flight.load(tmp_path / "log.csv")


ODD = {
    "empty": b"{}",
    "list": b"[]",
    "an index that is not there": b'{"index_columns":["nothing"],"columns":[],"column_indexes":[]}',
    "brackets without end": b'{"index_columns":[],"column_indexes":[],"columns":' + 100_000 * b"[",
    "numbers": b'{"index_columns":[],"columns":7,"column_indexes":5}',
    "a type that is none": b'{"index_columns":[],"column_indexes":[],"columns":[{"name":"t","field_name":"t",'
    b'"pandas_type":"spam","numpy_type":"spam","metadata":null}]}',
}


@pytest.mark.parametrize("words", ODD.values(), ids=list(ODD))
def test_what_a_parquet_file_says_of_pandas_decides_nothing(logs, time, tmp_path, words):
    table = pyarrow.table({"t": time} | columns(logs, time)).replace_schema_metadata({b"pandas": words})
    pyarrow.parquet.write_table(table, tmp_path / "log.parquet")
    agrees(flight.load(tmp_path / "log.parquet"), logs, time)


def test_a_column_of_lists_of_words_holds_no_numbers(logs, time, tmp_path):
    plain = (
        {"t": time}
        | columns(logs, time)
        | {"names": [["a", "b"]] * len(time), "ragged": [[1.0]] + [[]] * (len(time) - 1)}
    )
    pyarrow.parquet.write_table(pyarrow.table(plain), tmp_path / "log.parquet")
    agrees(flight.load(tmp_path / "log.parquet"), logs, time)


def test_a_line_without_end_is_refused_before_it_is_read(tmp_path):
    """A gigabyte took seven."""
    path = tmp_path / "flight.csv"
    with path.open("wb") as file:
        file.write(b"time,gyro_x,gyro_y,gyro_z\n0.0," + b"1" * 2_000_000)
    with pytest.raises(BudgetError, match="a line of 2,000,004 letters would take"):
        flight.load(path, budget="10MB,60s")
