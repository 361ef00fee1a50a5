"""Other processes: answers, news, errors, death, idleness; and how they and a command end."""

import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.attacks import processes as attacks
from wrenchgap import _safe_path
from wrenchgap.flight.errors import UsageError
from wrenchgap.learn import parallel, worker
from wrenchgap.learn.worker import WorkerDied, Workers, tell

if sys.platform != "linux":
    pytest.skip("/proc, as on Linux", allow_module_level=True)


@pytest.fixture
def one():
    found = Workers(1)
    yield found
    found.end()


def test_answers_news_and_errors_come_back(one):
    heard = []

    def work():
        tell("half")
        print("is no answer")
        return os.getpid()

    assert one.submit(work, heard.append).result() != os.getpid()
    assert heard == ["half"]
    with pytest.raises(KeyError, match="why"):
        one.submit(lambda: {}["why"]).result()
    with pytest.raises(RuntimeError, match="pickle"):
        one.submit(lambda: (k for k in "ab")).result()
    assert one.submit(os.getpid).result() != os.getpid()


def test_one_that_died_or_rested_too_long_or_grew_is_replaced(one, monkeypatch):
    with pytest.raises(WorkerDied):
        one.submit(lambda: os._exit(1)).result()
    pids = [one.submit(os.getpid).result()]
    monkeypatch.setattr(worker, "IDLE_SECONDS", 0.0)
    pids.append(one.submit(os.getpid).result())
    monkeypatch.undo()
    one.submit(lambda: setattr(worker_there(), "GROWN", -1)).result()
    pids.append(one.submit(os.getpid).result())
    assert len(set(pids)) == 3


def test_one_whose_answer_nobody_reads_any_more_ends_without_a_word():
    """As where its command has ended meanwhile, or was killed."""
    command = [sys.executable, "-c", worker.START, *_safe_path.absolute(sys.path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        pickle.dump(pickle.dumps(os.getpid), process.stdin)
        process.stdin.flush()
        assert process.stderr.read() == b""
        assert process.wait(timeout=60) == 0


def worker_there():
    return sys.modules["wrenchgap.learn.worker"]


def test_cores_are_bounded_by_the_environment_and_the_container(tmp_path, monkeypatch):
    monkeypatch.delenv(parallel.CORES, raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)))
    monkeypatch.setattr(parallel, "QUOTA", tmp_path / "cpu.max")
    assert parallel.cores() == 8
    (tmp_path / "cpu.max").write_text("max 100000")
    assert parallel.cores() == 8
    (tmp_path / "cpu.max").write_text("250000 100000")
    assert parallel.cores() == 3
    monkeypatch.setenv(parallel.CORES, "2")
    assert parallel.cores() == 2
    for wrong in ("abc", "0", "-1", "2.5", "9" * 5000):
        monkeypatch.setenv(parallel.CORES, wrong)
        with pytest.raises(UsageError, match=r"WRENCHGAP_CORES=.* in the environment: expected a number of cores"):
            parallel.cores()


def test_no_relative_folder_is_on_the_path_of_a_child(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", "here", "/there"]))
    assert _safe_path.environment()["PYTHONPATH"] == "/there"
    assert _safe_path.environment()["PYTHONSAFEPATH"] == "1"


@pytest.mark.slow
@pytest.mark.parametrize(("number", "group"), attacks.MOMENTS)
def test_explain_is_ended_at_any_moment(tmp_path, number, group):
    [name] = attacks.flown(tmp_path)
    asked = [word.format(name) for word in attacks.EXPLAIN]
    start = time.monotonic()
    code, said = attacks.Command(tmp_path, *attacks.SCRIPT, *asked).ended()
    assert code == 0, said
    whole = time.monotonic() - start
    for moment in np.random.default_rng(number).uniform(0.1, 1.0, 8) * whole:
        command = attacks.Command(tmp_path, *attacks.SCRIPT, *asked)
        time.sleep(moment)
        assert attacks.signalled(command, number, group=group, any_moment=True) == "", (
            f"after {moment:.2f} of {whole:.2f} s"
        )


@pytest.mark.skipif(not hasattr(os, "fork"), reason="ended from outside where there is a fork")
def test_a_command_inside_one_long_call_into_c_is_ended_from_outside(tmp_path):
    code = "from wrenchgap import _signals; _signals.OUTSIDE = 0.3; _signals.catch(); "
    code += "from itertools import chain; inside = map(lambda _: print('in C', flush=True) or 0, [0]); "
    code += "sum(chain(inside, range(10**13)))"  # hours that hold Python's lock
    command = attacks.Command(tmp_path, sys.executable, "-c", code)
    assert command.process.stdout.readline() == "in C\n"
    time.sleep(0.2)  # between two of its instructions Python would still hear of it
    command.process.send_signal(signal.SIGTERM)
    assert command.process.wait(timeout=10) == -signal.SIGKILL


SHUTDOWN = """
import builtins, ctypes, sys
from wrenchgap import __main__

class Crash:
    def __del__(self):
        ctypes.string_at(0)

builtins.crash = Crash()
sys.argv = ["wrenchgap", *sys.argv[1:]]
__main__.main()
"""


@pytest.mark.parametrize(("asked", "code"), [("--help", 0), ("nothing-of-this-name", 2)])
def test_a_command_ends_without_taking_its_interpreter_down(tmp_path, asked, code):
    """What is still alive in it then, threads and compiled code, may crash."""
    command = attacks.Command(tmp_path, sys.executable, "-c", SHUTDOWN, asked)
    said = command.process.stdout.read()
    assert command.process.wait(timeout=60) == code
    assert code or "explain" in said  # written to its end


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_output_that_cannot_be_written_is_said_once(tmp_path, unbuffered):
    """By the write itself, or by the last flush as well."""
    env = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    with Path("/dev/full").open("wb") as full:
        command = [sys.executable, "-c", SHUTDOWN, "--help"]
        done = subprocess.run(
            command, cwd=tmp_path, env=env, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60
        )
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1


def test_an_ignored_interrupt_stays_ignored(tmp_path):
    code = "import signal; from wrenchgap import _signals; _signals.catch(); "
    code += "print(signal.getsignal(signal.SIGINT) == signal.SIG_IGN)"
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        command = attacks.Command(tmp_path, sys.executable, "-c", code)
    finally:
        signal.signal(signal.SIGINT, before)
    assert "True" in command.process.stdout.read()
    assert command.ended()[0] == 0


@pytest.mark.parametrize(("program", "plain"), [("/usr/bin/wrenchgap", True), ("/home/me/season.py", False)])
def test_ctrl_c_while_a_command_is_imported_is_no_traceback_and_a_program_of_others_keeps_its_own(program, plain):
    code = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "  # a job in the background
    code += f"sys.argv[0] = {program!r}; import wrenchgap; "
    code += "print(signal.getsignal(signal.SIGINT) is signal.SIG_DFL)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(plain)


def test_what_libraries_complain_of_after_a_signal_is_not_printed():
    """A cluster of `batch` that was half up when SIGTERM came ended with sixty lines of its own."""
    code = "import atexit, signal, sys; import wrenchgap.__main__ as m; import wrenchgap.replay.cli.main as cli\n"
    code += "def work():\n    atexit.register(lambda: 1 / 0)\n    signal.raise_signal(signal.SIGTERM)\n"
    code += "cli.TyperGroup.invoke = lambda *a: work()\n"
    code += "sys.argv = ['wrenchgap', 'history', 'x']\nm.main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (143, "wrenchgap: interrupted; nothing was left half-written\n")
