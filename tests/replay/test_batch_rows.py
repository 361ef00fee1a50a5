"""Rows that a batch has kept, damaged or put there by somebody else: one line each, and no file of a user is lost."""

import json
import os
import shutil
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import wrenchgap as wg
from wrenchgap.flight.errors import UsageError
from wrenchgap.replay.batch import driver, sources
from wrenchgap.replay.batch.fleet import trend_of_rows
from wrenchgap.replay.batch.store import Store
from wrenchgap.replay.batch.tasks import Plan, Task, model_text, work


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """Two flights, and the rows of `batch compare` and `batch explain` on them."""
    folder = tmp_path_factory.mktemp("fleet")
    (folder / "alpha").mkdir()
    for k in range(2):
        flight = wg.simulate(wg.load_model("crazyflie"), "multi_axis", duration=4, excitation=1, seed=k)
        wg.save_log(flight, folder / "alpha" / f"flight{k}.mcap")
    for command in ("compare", "explain"):
        plan = Plan(command, {"": model_text("crazyflie")}, names=("com_offset",))
        Store(str(folder / command)).claim(plan.identity)
        for task in tasks(folder, plan):
            work(task, plan, str(folder / command))
    return folder


def tasks(folder, plan):
    for source in sources.logs_named([str(folder / "alpha")]):
        (content,) = sources.identities([source])
        yield Task(source, content, plan.key(content, source.vehicle))


@pytest.fixture
def rows(done, tmp_path):
    """The rows of `batch compare`, to be damaged."""
    shutil.copytree(done / "compare", tmp_path / "out")
    return sorted((tmp_path / "out").rglob("*.parquet"))


@pytest.mark.skipif(sys.platform == "darwin", reason="its file system takes UTF-8 alone")
def test_vehicles_whose_names_are_no_utf8_are_kept_apart(done, tmp_path):
    """Every log of them failed: its row could not be written."""
    for name in (b"v\xff", b"v\xfe"):
        (tmp_path / os.fsdecode(name)).mkdir()
        shutil.copy(done / "alpha" / "flight0.mcap", tmp_path / os.fsdecode(name))
    plan, out = Plan("inspect", {}), str(tmp_path / "out")
    Store(out).claim(plan.identity)
    named = [s for s in sources.logs_named([str(tmp_path)]) if s.name.endswith(".mcap")]
    for source in named:
        work(Task(source, "", plan.key("", source.vehicle)), plan, out)
    assert [os.fsencode(row["vehicle"]) for row in Store(out).rows()] == [b"v\xfe", b"v\xff"]


def changed(path, **cells):
    table = pq.ParquetFile(path).read()
    pq.write_table(pa.Table.from_pylist([{**table.to_pylist()[0], **cells}], schema=table.schema), path)


def fitted(**entries):
    def change(path):
        changed(path, fit=json.dumps({**json.loads(pq.ParquetFile(path).read().to_pylist()[0]["fit"]), **entries}))

    return change


def made_anew(path, make):
    path.unlink()
    make(path)


DAMAGE = {
    "empty": lambda f: f.write_bytes(b""),
    "cut": lambda f: f.write_bytes(f.read_bytes()[:-100]),
    "another table": lambda f: pq.write_table(pa.table({"a": [1]}), f),
    "no row": lambda f: pq.write_table(pq.ParquetFile(f).read().slice(0, 0), f),
    "two rows": lambda f: pq.write_table(pa.concat_tables([pq.ParquetFile(f).read()] * 2), f),
    "no status": lambda f: changed(f, status=None),
    "another key": lambda f: changed(f, key="other"),
    "outside its folder": lambda f: f.rename(f.parents[2] / f.name),
    "a pipe": lambda f: made_anew(f, os.mkfifo),
    "a device": lambda f: made_anew(f, lambda path: path.symlink_to("/dev/zero")),
    "no JSON": lambda f: changed(f, fit="{"),
    "JSON without end": lambda f: changed(f, fit="[" * 100_000),
    "a list": lambda f: changed(f, fit="[1]"),
    "a value too few": fitted(theta=[1.0]),
    "text": fitted(theta=["a", "b", "c"]),
    "not finite": fitted(theta=[float("nan")] * 3),
    "beyond all numbers": fitted(theta=[10**400, 1, 1]),
    "huge": fitted(theta=[1e300] * 3),
    "negative deviation": fitted(std=[-1.0] * 3),
    "unknown effect": fitted(effects=["no_such"]),
    "time as text": fitted(start_ns="x"),
    "a time beyond all": fitted(start_ns=10**40),
    "no cutoff": fitted(cutoff_hz=None),
    "noise of one axis": fitted(noise=[1.0]),
    "limits that are none": fitted(at_bound=5),
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", DAMAGE)
def test_a_row_that_is_none_is_refused_in_one_line(rows, refused, name):
    """They were internal errors, an abort, or a hang."""
    DAMAGE[name](rows[0])
    line = refused("trend", rows[0].parents[4], "-m", "crazyflie")
    assert "out" in line


def test_folders_and_runs_that_are_none_are_refused_in_one_line(rows, refused):
    out = rows[0].parents[4]
    for content in ("[]", "[" * 100_000, "\0"):
        (out / "run.json").write_text(content)
        assert "run.json" in refused("trend", out, "-m", "crazyflie")
    made_anew(out / "run.json", os.mkfifo)
    with pytest.raises(UsageError, match=r"run\.json is no ordinary file"):
        Store(str(out)).identity()


def test_again_does_those_logs_once_more_whose_row_cannot_be_read(rows, done):
    rows[0].write_bytes(b"")
    out = Store(str(rows[0].parents[4]))
    assert [one.path for one in out.unreadable(list(out.done().values()))] == [str(rows[0])]
    with pytest.raises(UsageError, match="--again"):
        out.rows()
    plan = Plan("compare", {"": model_text("crazyflie")}, names=("com_offset",))
    with (
        pytest.importorskip("distributed").LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
        ) as cluster,
        driver.client(cluster.scheduler_address) as client,
    ):
        found = sources.logs_named([str(done / "alpha")])
        outcome = driver.run(client, found, plan, out, lambda *said: None, again=True)
    assert (len(outcome.rows), outcome.before) == (1, 1)
    assert len(out.rows()) == 2


def test_a_link_in_the_place_of_a_hidden_file_or_a_folder_leads_nowhere(rows, tmp_path):
    """A batch that went on in a folder of somebody else's wrote rows over any file that he named."""
    store, own = Store(str(rows[0].parents[4])), tmp_path / "own"
    own.mkdir()
    (own / "mine").write_text("mine")
    row = {**store.rows()[0], "status": "ok"}
    row.pop("vehicle"), row.pop("date")
    for hidden in (f".{rows[0].name}.{os.getpid()}.part", f".{rows[0].stem}.{os.getpid()}.part.parquet"):
        (rows[0].parent / hidden).symlink_to(own / "mine")
    store.add(row, "alpha")
    assert (own / "mine").read_text() == "mine"
    shutil.rmtree(rows[0].parents[1])
    rows[0].parents[1].symlink_to(own)
    with pytest.raises(UsageError, match="is a link or a file; expected a folder"):
        store.add(row, "alpha")
    assert [p.name for p in own.iterdir()] == ["mine"]


def test_evidence_that_is_none_is_refused_in_one_line(done, tmp_path):
    """An empty one ended in "interrupted", exit code 130, where nobody interrupted."""
    from wrenchgap.replay.batch.fleet import rankings

    shutil.copytree(done / "explain", tmp_path / "out")
    path = next((tmp_path / "out").rglob("*.parquet"))
    store = Store(str(tmp_path / "out"))
    rankings(store, list(store.done()), 1)
    for content in (None, b"", b"x" * 100):
        changed(path, evidence=content)
        with pytest.raises(UsageError, match=rf"{path.name}: the evidence that is kept there cannot be read"):
            rankings(store, list(store.done()), 1)
    assert [one.key for one in store.unreadable(list(store.done().values()))] == [path.stem]


def test_the_end_of_a_file_is_no_interruption(capsys, monkeypatch):
    from wrenchgap.replay.cli import main

    monkeypatch.setenv("WRENCHGAP_DEBUG", "1")
    error = main.typer.Abort()
    error.__cause__ = EOFError()
    assert main.report(error) == 1
    assert "interrupted" not in capsys.readouterr().err
    assert np.isfinite(main.report(main.typer.Abort()))


def test_a_row_whose_lists_are_millions_long_is_refused_before_they_are_unfolded(rows):
    """Runs of equal numbers are a few bytes in a Parquet file."""
    changed(rows[0], noise=[0.0] * 1_000_000)
    assert rows[0].stat().st_size < 20_000
    with pytest.raises(UsageError, match=r"1,000,0.. values"):
        Store(str(rows[0].parents[4])).rows()


@pytest.mark.parametrize(("epoch", "order"), [(0, ["flight0", "flight1"]), (1_700_000_000, ["flight1", "flight0"])])
def test_a_trend_is_in_the_order_of_clocks_only_where_they_know_the_day(rows, epoch, order):
    """Seconds since power-on put a flight of the fourth day before one of the first: a step was told, backwards."""
    for k, path in enumerate(rows):
        start = (epoch + 20 - 10 * k) * 10**9
        fitted(start_ns=start, span=[start, start + 4 * 10**9])(path)
    found = trend_of_rows(Store(str(rows[0].parents[4])), wg.load_model("crazyflie"))
    names = {json.loads(pq.ParquetFile(p).read().to_pylist()[0]["fit"])["name"]: k for k, p in enumerate(rows)}
    first, second = (order if names["flight0"] == 0 else order[::-1]) if epoch else order
    assert list(found.names) == [first, second]
    assert any("order of their logs' names" in note for note in found.notes) == (epoch == 0)


def test_a_flight_under_two_names_counts_once_in_a_trend(rows, done):
    samples = list(range(100))
    for path in rows:
        fitted(signature=samples)(path)
    with pytest.raises(UsageError, match="all logs are of one flight"):
        trend_of_rows(Store(str(rows[0].parents[4])), wg.load_model("crazyflie"))


def test_rows_know_their_flights_again_by_samples(rows):
    texts = [json.loads(pq.ParquetFile(path).read().to_pylist()[0]["fit"]) for path in rows]
    assert all(len(text["signature"]) >= 100 for text in texts)
    assert not set(texts[0]["signature"]) & set(texts[1]["signature"])


def test_rows_below_the_folder_of_the_logs_are_no_logs(done):
    """A batch that wrote there took its own rows for flights of new vehicles, and more with every run."""
    assert list(done.rglob("*.parquet"))
    assert [one.name for one in sources.logs_named([str(done)])] == ["flight0.mcap", "flight1.mcap"]
    with pytest.raises(UsageError, match="no logs found"):
        sources.logs_named([f"{done}/compare/rows/**/*.parquet"])
