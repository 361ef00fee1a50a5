"""Batches: rows of every log, resumed runs, failures as rows, object stores, Dask; bad input in one line."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight import work_files
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant import model_file
from wrenchgap.replay.batch import driver, sources, tasks
from wrenchgap.replay.batch.store import Store
from wrenchgap.replay.batch.tasks import Plan, Task, model_text, work
from wrenchgap.replay.batch.words import median_rms

distributed = pytest.importorskip("distributed")
HIDDEN = {"alpha": ("crazyflie", "com_offset=x:0.0015"), "bravo": ("tilt_hexarotor", "com_offset=x:0.004")}
MODELS = ("-m", "crazyflie", "-m", "bravo=tilt_hexarotor")


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Three flights of one vehicle and two of another; one log is cut off and one is there twice."""
    folder = tmp_path_factory.mktemp("fleet")
    for vehicle, (model, hide) in HIDDEN.items():
        (folder / vehicle).mkdir()
        for k in range(3 if vehicle == "alpha" else 2):
            flight = wg.simulate(wg.load_model(model), "multi_axis", duration=4, excitation=1, seed=k, hide=[hide])
            wg.save_log(flight, folder / vehicle / f"flight{k}.mcap")
    whole = (folder / "alpha" / "flight0.mcap").read_bytes()
    (folder / "alpha" / "cut.mcap").write_bytes(whole[: len(whole) // 8])
    shutil.copy(folder / "alpha" / "flight1.mcap", folder / "alpha" / "twice.mcap")
    return folder


@pytest.fixture(scope="module")
def cluster():
    """A scheduler and a worker in this process, so that workers see its memory:// files."""
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    ) as found:
        yield found


@pytest.fixture
def batch(result_of, cluster, logs):
    """`batch("inspect", ...)` on the logs; returns the JSON."""

    def wrapped(command, *options, names=None):
        return result_of(
            "batch", command, *(names or [logs]), *options, "--scheduler", cluster.scheduler_address, "--force"
        )

    return wrapped


def test_every_log_is_a_row_and_a_failure_has_its_reason(batch, tmp_path):
    body = batch("inspect", "-o", tmp_path / "out")
    assert (body["schema"], body["command"], body["logs"]) == ("wrenchgap.batch/1", "inspect", 6)
    assert [one["log"].rpartition("/")[2] for one in body["same"]] == ["twice.mcap"]
    assert {r["vehicle"] for r in body["rows"]} == {"alpha", "bravo"}
    assert {r["date"] for r in body["rows"] if r["status"] == "ok"} == {"2023-11-14"}
    rows = Store(str(tmp_path / "out")).rows(columns=["log", "status", "reason", "result"])
    [cut] = [r for r in rows if r["log"].endswith("cut.mcap")]
    if cut["status"] == "failed":
        assert "\n" not in cut["reason"]
        assert "cut.mcap" in cut["reason"]
    good = next(r for r in rows if r["log"].endswith("flight0.mcap"))
    assert json.loads(good["result"])["sha256"]


def test_a_run_goes_on_where_it_was_and_rows_are_named_by_content(batch, tmp_path, logs):
    out = tmp_path / "out"
    first = batch("compare", *MODELS, "-o", out, names=[logs / "alpha" / "flight0.mcap"])
    assert (first["done_now"], first["done_before"]) == (1, 0)
    more = batch("compare", *MODELS, "-o", out, names=[logs / "alpha"])
    assert (more["done_now"], more["done_before"]) == (3, 1)
    again = batch("compare", *MODELS, "-o", out, names=[logs / "alpha"])
    assert (again["done_now"], again["done_before"], again["failed"]) == (0, 4, 1)
    assert again["rows"] == more["rows"]
    tried = batch("compare", *MODELS, "-o", out, "--again", names=[logs / "alpha"])
    assert (tried["done_now"], tried["failed"]) == (1, 1)


def test_compare_has_the_numbers_of_compare_and_trend_follows_its_rows(batch, result_of, refused, tmp_path, logs):
    out = tmp_path / "out"
    body = batch("compare", *MODELS, "--fit", "com_offset", "-o", out)
    row = next(r for r in body["rows"] if r["log"].endswith("alpha/flight1.mcap"))
    direct = result_of("compare", logs / "alpha" / "flight1.mcap", "-m", "crazyflie")
    np.testing.assert_array_equal(row["rms"], direct["models"][-1]["rms"])
    paths = [logs / "alpha" / f"flight{k}.mcap" for k in range(3)]
    (tmp_path / "result.json").unlink()
    apart = result_of("trend", *paths, "-m", "crazyflie", "--fit", "com_offset")
    (tmp_path / "result.json").unlink()
    found = result_of("trend", out, "-m", "crazyflie", "--vehicle", "alpha")
    assert found["flights"] == ["flight0", "flight1", "flight2"]
    line = refused("trend", out, "-m", "crazyflie", "--vehicle", "alpha", "--cutoff", "5")
    assert "--cutoff 5.0: does nothing with rows of `batch compare`" in line
    for a, b in zip(apart["parameters"], found["parameters"], strict=True):
        np.testing.assert_allclose(a["values"], b["values"], rtol=1e-9)
        np.testing.assert_allclose(a["std"], b["std"], rtol=1e-9)


def test_what_no_flight_measured_has_no_median():
    """Force by its measured axes, 3-4-5 triangles; no torque was measured, and none of it is no torque of zero."""
    rows = [{"rms": [3.0 * k, None, 4.0 * k, None, None, None]} for k in (1.0, 3.0)]
    force, torque = median_rms([*rows, {"rms": None}], "rms")
    assert force == pytest.approx(10.0)
    assert np.isnan(torque)


def test_explain_ranks_every_vehicle_on_its_own_flights(batch, tmp_path):
    names = "com_offset,mass,thrust_scale,motor_lag"
    body = batch("explain", *MODELS, "--effects-only", names, "-o", tmp_path / "out")
    assert [r["vehicle"] for r in body["rankings"]] == ["alpha", "bravo"]
    for one, size in zip(body["rankings"], (0.0015, 0.004), strict=True):
        assert one["effects"][0]["effect"] == "com_offset"
        value = next(v for v in one["sets"][0]["values"] if (v["effect"], v["name"]) == ("com_offset", "x"))
        assert value["value"] == pytest.approx(size, rel=0.1)
    assert [r["held_out"] for r in body["rankings"]] == [True, False]


def test_a_flight_in_two_logs_counts_once_in_a_ranking(batch, tmp_path, logs):
    """Cut short it has other bytes; the whole one is taken, whatever the names say."""
    fleet = tmp_path / "bravo"
    shutil.copytree(logs / "bravo", fleet)
    whole = (fleet / "flight0.mcap").read_bytes()
    (fleet / "a_part.mcap").write_bytes(whole[: 9 * len(whole) // 10])
    body = batch(
        "explain", "-m", "tilt_hexarotor", "--effects-only", "com_offset", "-o", tmp_path / "out", names=[fleet]
    )
    (one,) = body["rankings"]
    assert one["repeats"] == [{"log": str(fleet / "a_part.mcap"), "as": str(fleet / "flight0.mcap")}]
    assert len(one["flights"]) == 2
    assert not one["held_out"]  # of two flights


def test_logs_of_an_object_store_are_read_and_rows_written_there(batch, logs):
    import fsspec

    store = fsspec.filesystem("memory")
    for path in sorted((logs / "alpha").glob("*.mcap")):
        store.pipe_file(f"/bucket/alpha/{path.name}", path.read_bytes())
    body = batch("compare", "-m", "crazyflie", "-o", "memory://results/run", names=["memory://bucket/alpha/*.mcap"])
    assert (body["logs"], body["failed"]) == (4, 1)
    assert store.find("/results/run/rows")
    again = batch("compare", "-m", "crazyflie", "-o", "memory://results/run", names=["memory://bucket"])
    assert again["done_now"] == 0
    [failure] = again["failures"]
    assert "memory://bucket/alpha/cut.mcap" in failure["reason"]


def test_lists_globs_and_folders_name_the_same_logs(logs, tmp_path):
    listed = tmp_path / "flights.txt"
    listed.write_text("# healthy\n" + "\n".join(map(str, sorted(logs.glob("*/*.mcap")))), encoding="utf-8")
    by_folder = sources.logs_named([str(logs)])
    assert sources.logs_named([str(listed)]) == by_folder == sources.logs_named([f"{logs}/*/*.mcap"])
    assert {s.vehicle for s in sources.logs_named([str(logs)], "mine")} == {"mine"}


def test_a_name_with_brackets_is_the_log_of_that_name(logs, tmp_path):
    """As browsers number copies; not what it would stand for as a pattern."""
    content = sorted(logs.glob("*/*.mcap"))[0].read_bytes()
    folder = tmp_path / "day[2]"
    folder.mkdir()
    for name in ("log[1].mcap", "log1.mcap"):
        (folder / name).write_bytes(content)
    assert [s.name for s in sources.logs_named([str(folder / "log[1].mcap")])] == ["log[1].mcap"]
    assert [s.name for s in sources.logs_named([f"{folder}/*.mcap"])] == ["log1.mcap", "log[1].mcap"]
    assert [s.name for s in sources.logs_named([f"{folder}/log[1-3].mcap"])] == ["log1.mcap"]
    with pytest.raises(UsageError, match="no logs found"):
        sources.logs_named([str(folder / "missing.mcap")])


def test_a_model_in_a_folder_with_an_equals_sign_is_of_all_vehicles(tmp_path):
    folder = tmp_path / "date=2026-11-22"
    folder.mkdir()
    path = folder / "quad.toml"
    shutil.copy(model_file.find_model("crazyflie"), path)
    assert [*tasks.models_by_vehicle([str(path)])] == [""]
    assert [*tasks.models_by_vehicle([f"big={path}"])] == ["big"]


@pytest.mark.timeout(30)
def test_lists_and_links_that_lead_back_are_followed_once(logs, tmp_path, monkeypatch):
    """A list that names itself, thirty lists that name the next one twice, links to their own folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "round.txt").write_text(f"round.txt\n{logs}\n")
    assert sources.logs_named(["round.txt"]) == sources.logs_named([str(logs)])
    for k in range(30):
        (tmp_path / f"{k}.txt").write_text(f"{k + 1}.txt\n" * 2)
    (tmp_path / "30.txt").write_text(f"{logs}\n")
    assert sources.logs_named(["0.txt"]) == sources.logs_named([str(logs)])
    folder = tmp_path / "links"
    folder.mkdir()
    (folder / "one.mcap").write_bytes(b"x")
    for name in "xy":
        (folder / name).symlink_to(".")
    assert [s.name for s in sources.logs_named([str(folder)])] == ["one.mcap"]
    assert {s.name for s in sources.logs_named([f"{folder}/**/*.mcap"])} == {"one.mcap"}


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("a**b/*.mcap", r"^a\*\*b/\*.mcap: "),
        ("a\0b.txt", "is no name that a file can have"),
        ("LONG", "one.mcap: its vehicle's name is too long for a folder; say a shorter one, --vehicle NAME"),
    ],
)
def test_a_line_of_a_list_that_names_nothing_is_one_line(line, said, tmp_path):
    """The last one ended a batch where its first row was written."""
    folder = tmp_path / ("\u00e4" * 100)
    folder.mkdir()
    (folder / "one.mcap").write_bytes(b"x")
    (tmp_path / "flights.txt").write_text(line.replace("LONG", str(folder)), encoding="utf-8")
    with pytest.raises(UsageError, match=said):
        sources.logs_named([str(tmp_path / "flights.txt")])


def test_an_etag_stands_for_the_content():
    tagged, copied = (sources.Source(f"s3://bucket/a/{name}.mcap", "a", 10, "abc") for name in "bc")
    here = SimpleNamespace(map=lambda made, chunks, pure: list(map(made, chunks)), gather=list)
    (task,), same = driver._tasks(here, [tagged, copied], Plan("inspect", {}))
    assert (task.content, same) == ("etag:abc", {copied.url: tagged.url})


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("batch inspect EMPTY -o out", "no logs found"),
        ("batch inspect gone -o out", "gone: no such file"),
        ("batch inspect LOGS -o EMPTY/../full", "is not empty and holds no run"),
        ("batch inspect LOGS -o out --scheduler tcp://127.0.0.1:9", "no Dask scheduler answers"),
        ("batch inspect LOGS -o out --memory nan", "--memory nan: expected a size, such as 2GB, or auto"),
        ("batch inspect LOGS -o out --memory=-1", "--memory -1: expected a size"),
        ("batch inspect LOGS -o out --memory 1MB", "give those of this machine more memory with --memory"),
        ("batch inspect LOGS -o out --scheduler tcp://h:1 --workers 2", "leave out --workers"),
        ("batch inspect s3://bucket/flights -o out", "pip install 'wrenchgap[s3]'"),
        ("batch inspect abc://bucket/flights -o out", "abc"),
        ("batch inspect memory://nothing -o out", "no such file or folder"),
        ("batch compare LOGS -m crazyflie -m tilt_hexarotor -o out", "all vehicles have a model already"),
        ("batch compare LOGS -o out", "--model"),
        ("batch explain LOGS -m crazyflie --effects-only witchcraft -o out", "witchcraft"),
        ("trend LOGS -m crazyflie", "cut.mcap"),
    ],
)
def test_bad_input_is_one_line(refused, logs, tmp_path, monkeypatch, arguments, words):
    monkeypatch.setattr(driver, "PATIENCE", 1.0)
    monkeypatch.setitem(sys.modules, "s3fs", None)
    (tmp_path / "empty").mkdir()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "note.txt").write_text("mine", encoding="utf-8")
    places = {"LOGS": str(logs / "alpha"), "EMPTY": str(tmp_path / "empty")}
    line = refused(*(places.get(a, a.replace("EMPTY", places["EMPTY"])) for a in arguments.split()))
    assert words in line


@pytest.mark.parametrize("said", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"], ids=["silent", "another server"])
def test_what_listens_and_is_no_scheduler_is_one_line(refused, logs, tmp_path, monkeypatch, said):
    """Dask waits for ever for the first, and takes the answer of the second for the size of a message."""
    monkeypatch.setattr(driver, "PATIENCE", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        line_to: list[socket.socket] = []

        def answer():
            line_to.append(server.accept()[0])
            line_to[0].sendall(said)

        threading.Thread(target=answer, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        line = refused("batch", "inspect", logs, "-o", tmp_path / "out", "--scheduler", address)
        assert f"{address}: no Dask scheduler answers" in line
        line_to[0].close()


def test_the_output_of_another_run_is_left_alone(batch, refused, cluster, logs, tmp_path):
    out = tmp_path / "out"
    batch("inspect", "-o", out)
    line = refused("batch", "compare", logs, "-m", "crazyflie", "-o", out)
    assert "holds another run (its command" in line
    assert "rows of `batch inspect`" in refused("trend", out, "-m", "crazyflie")


def test_a_second_run_into_one_folder_is_refused_while_the_first_lives(batch, refused, cluster, logs, tmp_path):
    out = tmp_path / "out"
    batch("inspect", "-o", out)
    code = (
        "import sys\nfrom wrenchgap.replay.batch.store import Store\n"
        "with Store(sys.argv[1]).alone():\n    print(1, flush=True)\n    input()"
    )
    with subprocess.Popen([sys.executable, "-c", code, out], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout.readline() == b"1\n"
        line = refused("batch", "inspect", logs, "-o", out, "--scheduler", cluster.scheduler_address)
        assert f"--output {out}: another `wrenchgap batch` writes there now" in line
        other.kill()
    assert batch("inspect", "-o", out)["done_before"] == 6


def test_a_store_that_lets_nobody_in_is_one_line(monkeypatch):
    class NoCredentialsError(Exception):
        pass

    with pytest.raises(UsageError, match="check the credentials"), sources.reached("s3://bucket"):
        raise NoCredentialsError("Unable to locate credentials")
    with pytest.raises(UsageError, match=r"^out: no access; choose another folder"), sources.reached("out"):
        raise PermissionError(13, "Permission denied")


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"pip install 'wrenchgap\[batch\]'"):
        driver.dask_distributed()


def test_help_does_not_import_dask():
    slow = "{'dask', 'distributed', 'fsspec'}"
    code = f"import sys; from wrenchgap.replay.cli import main; assert not {slow} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_a_worker_that_is_killed_loses_no_log(logs, tmp_path):
    """Two processes; one is killed when the first log is done. Every log is a row, with the numbers of no Dask."""
    plan = Plan("compare", {"": model_text("crazyflie"), "bravo": model_text("tilt_hexarotor")})
    lossy, alone = Store(str(tmp_path / "lossy")), Store(str(tmp_path / "alone"))
    for store in (lossy, alone):
        store.claim(plan.identity)
    found = [s for s in sources.logs_named([str(logs)]) if s.name != "twice.mcap"]
    killed = []
    with driver.client(workers=2) as client:
        # what Dask would sample of each worker's stacks is kept for an hour: memory that grows with the logs
        sampled = client.run(lambda: __import__("dask").config.get("distributed.worker.profile.enabled"))
        assert set(sampled.values()) == {False}

        def tell(done, total, failed, log):
            if done == 1:
                killed.append(next(iter(client.cluster.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        outcome = driver.run(client, found, plan, lossy, tell)
    assert killed
    assert len(outcome.rows) == len(found) == 6
    for source in found:
        (content,) = sources.identities([source])
        work(Task(source, content, plan.key(content, source.vehicle)), plan, alone.url)
    told = [[(r["key"], r["status"], r["rms"]) for r in store.rows()] for store in (lossy, alone)]
    assert told[0] == told[1]


@pytest.mark.slow
def test_a_log_that_ends_its_worker_is_a_failed_row_and_costs_no_other(monkeypatch):
    """One worker: all that it holds, the plan too, is gone with it; four times, until Dask gives the log up."""

    def reading(task, plan, output):
        if task.source.url == "bad":
            os.kill(os.getpid(), signal.SIGKILL)
        return {"log": task.source.url, "status": "ok"}

    monkeypatch.setattr(driver, "work", reading)
    monkeypatch.setattr(driver, "failed", lambda task, plan, output, why: {"log": task.source.url, "status": why})
    names = ["a", "b", "bad", "c", "d"]
    todo = [Task(SimpleNamespace(url=name), name, name) for name in names]
    with driver.client(workers=1) as client:
        rows = {r["log"]: r["status"] for r in driver._worked(client, todo, Plan("compare", {}), Store("unused"))}
    assert "died" in rows.pop("bad")
    assert rows == dict.fromkeys("abcd", "ok")


def test_a_worker_has_the_bench_table_and_keeps_the_model_where_it_is_removed(tmp_path, monkeypatch):
    """It does not see the folder of the model file; its own goes with it, or after kill -9 with another process."""
    (tmp_path / "bench.csv").write_text("command,thrust\n0,0\n0.5,0.04\n1,0.15\n")
    head, _, tail = model_text("crazyflie").text.partition("\n[command]")
    rest = tail[tail.index("\n[") :]
    own = tmp_path / "own.toml"
    own.write_text(f'{head}\n[command]\nunit = "normalised"\ntable = "bench.csv"\n{rest}')
    asked = []
    monkeypatch.setattr(tasks.wg, "load_model", lambda path, load=wg.load_model: asked.append(path) or load(path))
    text = model_text(str(own))
    (tmp_path / "bench.csv").unlink()
    model = tasks.model_of(text)
    speeds = model.command.speeds(np.full((1, 4), 0.5), None, model.vehicle)
    np.testing.assert_allclose(model.vehicle.rotors.c_f * speeds**2, 0.04)
    assert asked[-1].is_relative_to(work_files.folder())


def test_changed_asks_every_log_against_the_healthy_ones(batch, tmp_path, logs):
    suspect, healthy = logs / "alpha" / "flight2.mcap", [logs / "alpha" / f"flight{k}.mcap" for k in (0, 1)]
    options = ("--healthy", *healthy, "-m", "crazyflie", "--effects-only", "com_offset,mass", "-o", tmp_path / "out")
    body = batch("changed", *options, names=[suspect])
    assert (body["logs"], body["failed"]) == (1, 0)
    assert body["rows"][0]["verdict"] == "nothing"


def test_each_log_is_explained_by_itself_where_that_is_asked_for(batch, tmp_path, logs):
    options = ("-m", "crazyflie", "--effects-only", "com_offset,mass", "--each", "--passes", 1, "-o", tmp_path / "out")
    body = batch("explain", *options, names=[logs / "alpha" / "flight0.mcap"])
    assert body["rows"][0]["verdict"] == "effect"
    [row] = Store(str(tmp_path / "out")).rows(columns=["key", "log", "result"])
    assert json.loads(row["result"])["members"][0]["effect"] == "com_offset"
