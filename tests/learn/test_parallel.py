"""Work by several processes gives what work by one gives."""

import os
import re
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchgap.flight import work_files
from wrenchgap.flight.errors import FitError, ModelError
from wrenchgap.learn import parallel
from wrenchgap.learn.data.candidates import candidates
from wrenchgap.learn.parallel import each
from wrenchgap.learn.posterior.explain import search_dataset
from wrenchgap.plant import own_effects
from wrenchgap.plant.effects import find


def test_answers_come_in_the_order_of_the_questions():
    items = [f"{k}" for k in range(20)]
    assert list(each(lambda text: 2 * text, items, 3)) == list(each(lambda text: 2 * text, items, 1))
    assert list(each(str.upper, [], 3)) == []


def test_other_processes_do_a_part_of_the_work_and_stay_for_the_next():
    def who(_):
        time.sleep(0.3)
        return os.getpid()

    tries = (set(each(who, list("abcdefgh"), 2)) for _ in range(30))  # a busy machine takes its time to start a process
    first = next(found for found in tries if len(found) == 2)
    assert set(each(who, list("abcdefgh"), 2)) == first
    assert set(each(lambda _: os.getpid(), ["a", "b", "c"], 1)) == {os.getpid()}


def test_what_waits_behind_a_long_item_of_a_worker_is_done_here():
    parent = os.getpid()

    def who(name):
        if os.getpid() != parent and name == "long":
            time.sleep(2.0)
        elif os.getpid() == parent:
            time.sleep(0.1)
        return os.getpid()

    list(each(who, ["a", "b", "c", "d"], 2))  # a worker is there
    *others, long = each(who, ["left", "behind it", "long"], 2)
    assert long != parent
    assert others == [parent, parent]


def test_nobody_waits_for_a_worker_that_has_yet_to_start():
    parallel._workers(1).end()
    assert set(each(lambda _: os.getpid(), list("abc"), 2)) == {os.getpid()}


def test_an_item_is_claimed_once_and_left_over_by_others(tmp_path):
    question = str(tmp_path / "question")
    assert parallel._claim(parallel._place(question, 1))
    left = parallel.deque([0, 1, 2])
    assert [parallel._claimed(question, left) for _ in range(3)] == [0, 2, None]
    assert not parallel._claim(parallel._place(question, 2))


def test_items_go_where_they_were_done_before():
    large = Large(values=np.arange(4.0))

    def who(shared):
        return lambda name: (time.sleep(0.05), os.getpid(), shared.values.size)[1]

    names = [str(k) for k in range(12)]
    for _ in range(2):
        found = dict(zip(names, each(who(large), names, 2, shared=[large]), strict=True))
        assert parallel._here[id(large)] == {name for name, process in found.items() if process == os.getpid()}
    key = id(large)
    del large
    assert key not in parallel._here


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_in_the_work_is_the_callers(jobs):
    def fail(text):
        raise ValueError(text)

    with pytest.raises(ValueError, match="why"):
        list(each(fail, ["why", "why"], jobs))
    assert list(each(str.upper, ["a", "b"], jobs)) == ["A", "B"]


def test_a_worker_that_dies_is_told_and_the_next_call_has_others():
    parent = os.getpid()

    def die(_):
        if os.getpid() != parent:
            os._exit(1)
        time.sleep(1.0)

    with pytest.raises(FitError, match="died"):
        list(each(die, list("abcdefgh"), 2))
    assert list(each(str.upper, ["a", "b"], 2)) == ["A", "B"]


class Large(SimpleNamespace):
    """Can be weakly referenced."""


def part_of(large):
    return lambda name: (time.sleep(0.05), os.getpid(), id(large), large.values[int(name)])[1:]


def test_what_is_shared_is_written_once_and_goes_with_its_owner():
    parallel._workers(1).submit(partial(parallel.begin, ())).result()  # it is there, whatever else the machine does
    large = Large(values=np.arange(1e5))
    items = [str(k) for k in range(10)]
    found = [answer for _ in range(3) for answer in each(part_of(large), items, 2, shared=[large])]
    assert [value for *_, value in found] == 3 * [float(k) for k in range(10)]
    identities = {(process, identity) for process, identity, _ in found}
    assert len(identities) == len({process for process, _ in identities}) == 2  # every process has kept its own
    file = Path(parallel._files[id(large)])
    assert file.stat().st_size > large.values.nbytes
    del large
    assert not file.exists()


WRITES = """
import os, sys, time
from wrenchgap.flight import work_files
print(work_files.written(lambda file: file.write(b"large")), flush=True)
sys.stdin.readline()
"""


def test_files_go_with_their_process_and_those_of_one_that_was_killed_with_the_next(tmp_path, monkeypatch):
    def writer():
        env = os.environ | {"TMPDIR": str(tmp_path)}
        return subprocess.Popen(
            [sys.executable, "-c", WRITES], env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    killed, living = writer(), writer()
    left, kept = (Path(process.stdout.readline().strip()) for process in (killed, living))
    assert left.read_bytes() == kept.read_bytes() == b"large"
    killed.kill()
    killed.communicate()
    assert left.exists()
    work_files.sweep(tmp_path)  # it is young
    assert left.exists()
    monkeypatch.setattr(work_files, "YOUNG", -1.0)
    work_files.sweep(tmp_path)
    assert not left.parent.exists()
    assert kept.exists()  # its process lives
    living.communicate("\n")
    assert not list(tmp_path.iterdir())


AT_ONCE = """
import threading
from wrenchgap.flight import work_files
made = work_files.tempfile.mkdtemp
meet = threading.Barrier(2)
def slow(**more):
    meet.wait()
    return made(**more)
work_files.tempfile.mkdtemp = slow
threads = [threading.Thread(target=work_files.folder) for _ in range(2)]
[t.start() for t in threads] and [t.join() for t in threads]
"""


def test_threads_that_ask_for_the_first_folder_at_once_lose_no_lock(tmp_path):
    """Two jobs of the page that begin together: one lock was lost, and the end of the process said a traceback."""
    env = os.environ | {"TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", AT_ONCE], env=env, capture_output=True, text=True, check=True)
    assert not done.stderr
    assert not list(tmp_path.iterdir())


PAGE = Path(__file__).resolve().parents[2] / "docs" / "effects" / "your-own.md"
EXAMPLE = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]


def test_own_effects_are_those_of_the_workers_too(tmp_path):
    (tmp_path / "mine.py").write_text(EXAMPLE)
    parent, names = os.getpid(), ["field_torque"] * 12

    def broken(name):
        if os.getpid() != parent:
            find(name).apply(None, None, None, None)
        time.sleep(0.5)

    try:
        own_effects.use([tmp_path / "mine.py"])
        found = list(each(lambda name: (find(name).name, find(name)), names, 2))
        assert {name for name, _ in found} == {"field_torque"}
        assert all(type(effect) is type(find("field_torque")) for _, effect in found)
        with pytest.raises(ModelError, match=r"mine\.py:\d+: \w+Error"):
            list(each(broken, names, 2))
    finally:
        own_effects.use([])


def test_explain_finds_the_same_on_two_cores(offset, hexarotor):
    names = ("com_offset", "mass", "servo_lag")
    chosen = candidates(offset.data.records, hexarotor, names)
    one, two = (search_dataset(offset.data, hexarotor, chosen, jobs=jobs) for jobs in (1, 2))
    assert one.effects == two.effects
    np.testing.assert_array_equal(one.fit.theta, two.fit.theta)
    np.testing.assert_array_equal(one.rms_after, two.rms_after)
    for a, b in zip(one.members, two.members, strict=True):
        assert (a.share, a.significance) == (b.share, b.significance)
        rivals_a, rivals_b = ([(r.name, r.separation, r.cosine) for r in m.rivals] for m in (a, b))
        assert rivals_a == rivals_b
