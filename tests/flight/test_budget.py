"""What reading may take: texts of a budget, defaults, and that readers ask before they allocate."""

import numpy as np
import pytest
from mcap.reader import make_reader

import wrenchgap as wg
from benchmarks.faults.appetites import made
from wrenchgap import flight
from wrenchgap.flight.budget import LIMITS, Account, Budget, BudgetError
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.formats.decode import dotted_names
from wrenchgap.flight.formats.mcap import time_range


def test_a_text_says_memory_time_or_both():
    assert Budget.of("8GB,2min") == Budget(8e9, 120.0)
    assert Budget.of("120 s") == Budget(None, 120.0)
    assert Budget.of(None) == Budget()


@pytest.mark.parametrize("text", ["", "8", "GB", "8GB,9GB", "-1GB", "0s", "nan s", "8 parsecs"])
def test_another_text_is_refused_with_an_example(text):
    with pytest.raises(UsageError, match=r"--budget 8GB,120s|say it once"):
        Budget.of(text)


def test_defaults_grow_with_the_file(tmp_path):
    small, large = (Budget().account(tmp_path, size) for size in (1000, 10**10))
    assert small.memory <= LIMITS.memory * 1.001
    assert small.memory <= large.memory <= LIMITS.most_memory
    assert small.seconds == pytest.approx(LIMITS.seconds, rel=0.01)
    assert large.seconds > 1000.0


def test_an_account_says_what_which_limit_and_which_option(tmp_path):
    account = Budget(1e9).account(tmp_path / "a.mcap", 0)
    account.take(6e8, "messages")
    with pytest.raises(
        BudgetError, match=r"a\.mcap: a chunk would take 500 MB.*600 MB are taken.*1 GB.*--budget 1.38GB"
    ):
        account.ask(5e8, "a chunk")
    account.take(4e8, "messages")  # what was refused was not taken


def test_time_is_over(tmp_path):
    account = Budget(seconds=1e-9).account(tmp_path / "a.mcap", 0)
    sum(np.arange(1000.0))
    with pytest.raises(BudgetError, match=r"a\.mcap: .*processor time.*--budget"):
        account.check_time()


@pytest.mark.parametrize("name", ["ulog-nested", "mcap-json", "mcap-imus", "bag-bz2", "db3-topics", "csv-columns"])
def test_every_reader_asks_its_budget(name, tmp_path):
    with pytest.raises(BudgetError, match="--budget"):
        flight.inspect(made(name, tmp_path, seed=True), budget="1kB")


def test_nested_formats_are_counted_before_they_are_laid_out(tmp_path):
    with pytest.raises(BudgetError, match="fields of deep"):
        flight.inspect(made("ulog-nested", tmp_path), budget="50MB")


def test_texts_of_parquet_are_counted_before_they_are_written_out(tmp_path):
    with pytest.raises(BudgetError, match="texts of column note"):
        flight.inspect(made("parquet-text", tmp_path))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("ulog-long-name", "360,001 fields"),
        ("parquet-bytes", "table of 4 rows"),
        ("mcap-long-key", "decoded messages"),
        ("mcap-fan", "decoded messages"),
    ],
)
def test_what_few_bytes_unfold_to_is_counted_before_it_is_there(name, said, tmp_path):
    with pytest.raises(BudgetError, match=said):
        flight.inspect(made(name, tmp_path), budget="100MB")


def test_long_names_are_not_repeated_for_all_that_is_below_them():
    names = dotted_names(
        "outer", lambda k: [("a" * 800_000, "inner")] if k == "outer" else [("x", None)] * 1990, 2, 2000
    )
    assert sum(map(len, names)) <= LIMITS.names_letters


@pytest.mark.parametrize(("name", "said"), [("db3-generated", "computed"), ("bag-view", "no tables")])
def test_a_database_whose_messages_are_not_in_the_file_is_refused(name, said, tmp_path):
    with pytest.raises(flight.LogError, match=said):
        flight.inspect(made(name, tmp_path))


def test_the_time_of_a_file_is_read_off_its_summary_and_no_chunk_unfolded_for_it(tmp_path):
    for path in sorted(made("folder-footer", tmp_path).iterdir()):
        with path.open("rb") as file:
            assert time_range(file, Account(path)) is None
    path = tmp_path / "f.mcap"
    wg.save_log(wg.simulate(wg.load_model("crazyflie"), "hover", duration=1.0), path)
    with path.open("rb") as file, path.open("rb") as again:
        stated = make_reader(again).get_summary().statistics
        assert time_range(file, Account(path)) == (stated.message_start_time, stated.message_end_time)


def test_a_type_without_numbers_is_refused_before_its_fields_are_counted(tmp_path):
    with pytest.raises(BudgetError, match="the fields of one message"):
        flight.inspect(made("mcap-empty-types", tmp_path), budget="100MB")


@pytest.mark.parametrize("name", ["mcap-parentheses", "mcap-constants", "mcap-open-quotes", "bag-metadata"])
def test_what_took_hours_to_parse_is_looked_at_at_once(name, tmp_path):
    assert flight.inspect(made(name, tmp_path), budget="10s").topics


def test_hundreds_of_instances_are_left_out_and_said(tmp_path):
    with pytest.raises(flight.LogError, match="IMU numbers 100,000 instances"):
        flight.inspect(made("dataflash-instances", tmp_path))
