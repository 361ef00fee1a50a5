"""What a folder of data, other users of the machine, and whoever ends a command can do through its processes.

A process belongs to a command by a mark in its environment, which it inherits (/proc, Linux alone).
"""

# Long because each attack is a small program of its own, and all find the processes of a command in one way.
from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from uuid import uuid4

import psutil

from benchmarks.attacks import Attack, Outcome

AREA = "Processes, temporary files, the cluster"
MODEL = "crazyflie"
SCRIPT = (str(Path(sys.executable).with_name("wrenchgap")),)
MODULE = (sys.executable, "-m", "wrenchgap")
ONLY = ("--effects-only", "com_offset,mass,thrust_scale")
TWO = {"WRENCHGAP_CORES": "2"}
MARK = "WRENCHGAP_ATTACK"
LINGER = 2.0
"""Seconds after which no process of a command that ended may be there."""
WORKING = 60_000_000
"""Bytes of memory from which on a process has imported numpy."""
UNSAFE = ("PYTHONSAFEPATH", "PYTHONPATH")


@cache
def flight(seed: int) -> bytes:
    """A log of a short flight, simulated once."""
    import wrenchgap as wg

    asked: Any = {"duration": 5, "excitation": 1, "seed": seed, "hide": ["com_offset=x:0.0015"]}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "flight.mcap"
        wg.save_log(wg.simulate(wg.load_model(MODEL), "multi_axis", **asked), path)
        return path.read_bytes()


def flown(folder: Path, count: int = 1) -> list[str]:
    """Logs in the folder `fleet`."""
    (folder / "fleet").mkdir()
    names = [f"fleet/f{k}.mcap" for k in range(count)]
    for k, name in enumerate(names):
        (folder / name).write_bytes(flight(k))
    return names


class Command:
    """A command that runs in a folder, in a process group of its own as a shell starts it."""

    def __init__(self, folder: Path, *arguments: str, **env: str) -> None:
        self.mark = uuid4().hex
        clean = {name: value for name, value in os.environ.items() if name not in UNSAFE}
        clean |= TWO | {MARK: self.mark, "PYTHONDONTWRITEBYTECODE": ""} | env
        pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.PIPE}
        self.process = subprocess.Popen(arguments, cwd=folder, env=clean, text=True, process_group=0, **pipes)

    def ended(self, seconds: float = 60.0) -> tuple[int, str]:
        """Its exit code and what it said on standard error."""
        try:
            return self.process.wait(seconds), self.process.communicate()[1]
        except subprocess.TimeoutExpired:
            for number in self.family():
                os.kill(number, signal.SIGKILL)
            return self.process.wait(), f"did not end within {seconds} s"

    def family(self) -> list[int]:
        """Processes that it started, and itself, as long as they live."""
        wanted = f"{MARK}={self.mark}".encode()
        found = []
        for place in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                if wanted in (place / "environ").read_bytes().split(b"\0"):
                    found.append(int(place.name))
        return found

    def has_worker(self) -> bool:
        """Whether another process of it has imported what it works with."""
        return any(resident(number) > WORKING for number in self.family() if number != self.process.pid)

    def until(self, wanted: Callable[[], bool], seconds: float = 60.0) -> bool:
        """Wait for something, or for its end; whether it came."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and self.process.poll() is None:
            if wanted():
                return True
            time.sleep(0.05)
        return False

    def survivors(self) -> tuple[float, list[int]]:
        """How long processes of it lived on [s], and those that are there still after `LINGER`."""
        start = time.monotonic()
        while (left := self.family()) and time.monotonic() - start < LINGER:
            time.sleep(0.02)
        return time.monotonic() - start, left


# --- modules in a folder of data --------------------------------------------------------------------------------------


def trap(folder: Path, spared: Sequence[str] = ()) -> Path:
    """A module of every name of the standard library and of what is installed, each of which leaves its name in a file
    when it is run; names of that file.
    """  # noqa: D205
    mark = folder.with_name("marks.txt")
    names = {*sys.stdlib_module_names, *packages_distributions(), "sitecustomize", "usercustomize", "wrenchgap"}
    names |= {"joblib", "loky", "flight", "plant", "learn", "compensate", "viewer", "replay"}
    for name in names - set(spared):
        if name.isidentifier():
            text = f"with open({str(mark)!r}, 'a') as file: file.write(__name__ + ' ')\n"
            (folder / f"{name}.py").write_text(text, encoding="utf-8")
    return mark


def first_of_module(folder: Path) -> list[str]:
    """What Python itself imports to find the module of `-m`: nothing of ours runs before."""
    (folder / "probe.py").write_text("import sys; print(*sys.modules)", encoding="utf-8")
    found = subprocess.run([sys.executable, "-m", "probe"], cwd=folder, capture_output=True, text=True, check=True)
    return [*found.stdout.split(), "wrenchgap"]


def in_data_folder(how: Sequence[str], *asked: str, logs: int = 1, code: int = 0) -> Callable[[Path], Outcome]:
    """A command, run in the folder of its logs, with `trap` in it."""

    def run(folder: Path) -> Outcome:
        place = folder / "data"
        place.mkdir()
        names = flown(place, logs)
        mark = trap(place, first_of_module(folder) if how is MODULE else ())
        command = Command(place, *how, *(one.format(*names) for one in asked))
        if asked[0] == "view":
            command.until(lambda: "http" in (command.process.stdout.readline() if command.process.stdout else ""))
            command.process.terminate()
        found, said = command.ended()
        ran = sorted(set(mark.read_text(encoding="utf-8").split())) if mark.exists() else []
        words = f"exit code {found}; ran: {', '.join(ran[:8]) or 'none'} of {len(list(place.glob('*.py')))}"
        return Outcome(found == code and not ran, words + (f"; {said[-200:]}" if found != code else ""))

    return run


def settings_of_numba(folder: Path) -> Outcome:
    """`.numba_config.yaml` beside the logs, which says from where compiled code is unpickled."""
    (name,) = flown(folder, 1)
    (folder / ".numba_config.yaml").write_text("cache_dir: cache\n", encoding="utf-8")
    found, said = Command(folder, *SCRIPT, "check", name).ended()
    return Outcome(found == 2 and not (folder / "cache").exists(), said[-200:])


EXPLAIN = ("explain", "{0}", "-m", MODEL, *ONLY, "-q")
CHANGED = ("changed", "{0}", "--healthy", "{1}", "-m", MODEL, *ONLY, "-q")
BATCH = ("batch", "compare", "fleet", "-m", MODEL, "-o", "rows", "--workers", "1", "-q")
VIEW = ("view", "{0}", "-m", MODEL, "--port", "0")


# --- other users of the machine ---------------------------------------------------------------------------------------

SWEEP = """
import os, sys
from wrenchgap.flight import work_files
print(work_files.written(lambda file: file.write(b"mine")))
"""


def prepared(folder: Path) -> Outcome:
    """A shared folder for temporary files with folders of the name of ours: a FIFO, a link, a link to a folder."""
    shared, victim = folder / "tmp", folder / "victim"
    shared.mkdir()
    shared.chmod(0o1777)
    victim.mkdir()
    (victim / "precious.txt").write_text("mine", encoding="utf-8")
    other = 65534 if os.geteuid() == 0 else os.geteuid()
    for name in ("fifo", "link", "open"):
        (shared / f"wrenchgap-work-{name}").mkdir(mode=0o755)
    os.mkfifo(shared / "wrenchgap-work-fifo" / "in use", 0o666)
    (shared / "wrenchgap-work-link" / "in use").symlink_to(folder / "written-elsewhere")
    (shared / "wrenchgap-work-open" / "in use").write_bytes(b"")
    (shared / "wrenchgap-work-victim").symlink_to(victim)
    for path in (*shared.iterdir(), *shared.glob("*/in use")):
        os.utime(path, (0, 0), follow_symlinks=False)
        os.chown(path, other, -1, follow_symlinks=False)
    before = {str(path) for path in shared.rglob("*")}
    command = Command(folder, sys.executable, "-c", SWEEP, TMPDIR=str(shared))
    code, said = command.ended(20.0)
    left = before - {str(path) for path in shared.rglob("*")}
    elsewhere = (folder / "written-elsewhere").exists() or not (victim / "precious.txt").exists()
    own = Path(command.process.stdout.read() if command.process.stdout and not command.process.stdout.closed else "")
    words = f"exit code {code}; written elsewhere: {'yes' if elsewhere else 'no'}; of theirs removed: {len(left)} {own}"
    return Outcome(code == 0 and not elsewhere and not left, words.strip() + said[-200:])


def modes(folder: Path) -> Outcome:
    """A result that is overwritten: its permissions, and those of the file that is written meanwhile."""
    from wrenchgap.flight.atomic import atomic

    wrong, meanwhile = [], []
    for mode in (0o600, 0o640, 0o644, 0o666, 0o400):
        path = folder / f"{mode:o}.json"
        path.write_text("old", encoding="utf-8")
        path.chmod(mode)
        with atomic(path) as partial:
            partial.write_text("new", encoding="utf-8")
            if stat.S_IMODE(partial.stat().st_mode) & 0o077 & ~mode:
                meanwhile.append(f"{mode:o}")
        if stat.S_IMODE(path.stat().st_mode) != mode or path.read_text(encoding="utf-8") != "new":
            wrong.append(f"{mode:o}")
    words = (
        f"permissions changed: {', '.join(wrong) or 'none'}; read by others meanwhile: {', '.join(meanwhile) or 'none'}"
    )
    return Outcome(not wrong and not meanwhile, words)


STRANGER = """
import asyncio, sys
import distributed
from distributed.comm import connect

async def ask(address, security):
    comm = await connect(address, timeout=3, **({} if security is None else security.get_connection_args("client")))
    await comm.write({"op": "identity", "reply": True})
    print("GOT IN", address, await comm.read())

async def main():
    own = distributed.Security.temporary()
    asked = [f"{scheme}://{one}" for one in sys.argv[1:] for scheme in ("tcp", "tls")]
    tasks = [asyncio.wait_for(ask(one, own if one.startswith("tls") else None), 6) for one in asked]
    for one, what in zip(asked, await asyncio.gather(*tasks, return_exceptions=True)):
        if what is not None:
            print("refused", one, type(what).__name__)

asyncio.run(main())
"""


def resident(number: int) -> int:
    """Memory of a process [bytes]; none of one that is gone."""
    with suppress(psutil.Error):
        return int(psutil.Process(number).memory_info().rss)
    return 0


def listening(pids: Sequence[int]) -> set[tuple[str, int]]:
    """Addresses and ports on which these processes listen."""
    found = set()
    for number in pids:
        with suppress(psutil.Error):
            for one in psutil.Process(number).net_connections("inet"):
                if one.status == psutil.CONN_LISTEN:
                    found.add((one.laddr.ip, one.laddr.port))
    return found


OPEN = """
import sys
from wrenchgap.replay.batch import driver
with driver.client(workers=1) as client:
    print("ready", flush=True)
    sys.stdin.readline()
    print(client.submit(abs, -7).result(), flush=True)
"""


def cluster(folder: Path) -> Outcome:
    """Another process of this machine asks the scheduler, the nanny and the worker to run something."""
    command = Command(folder, sys.executable, "-c", OPEN)
    assert command.process.stdout is not None
    assert command.process.stdin is not None
    command.process.stdout.readline()
    ports = listening(command.family())
    outside = sorted(f"{ip}:{port}" for ip, port in ports if not ip.startswith("127."))
    addresses = [f"127.0.0.1:{port}" for _, port in sorted(ports)]
    asked = subprocess.run([sys.executable, "-c", STRANGER, *addresses], capture_output=True, text=True, check=False)
    inside, refused = asked.stdout.count("GOT IN"), asked.stdout.count("refused")
    command.process.stdin.write("\n")
    command.process.stdin.flush()
    works = command.process.stdout.readline().strip() == "7"
    command.ended()
    words = f"{len(ports)} ports, on other interfaces: {', '.join(outside) or 'none'}; strangers let in: {inside} of "
    held = works and len(ports) >= 4 and not outside and refused == 2 * len(ports)
    return Outcome(held, words + f"{inside + refused}" + ("" if works else "; the cluster itself did not work"))


# --- whoever ends a command -------------------------------------------------------------------------------------------

COMPUTES = """
import numpy as np, sys
from wrenchgap.learn.worker import Workers
def compute():
    a = np.random.default_rng(0).normal(size=(1500, 1500))
    while True:
        a = a @ a / 1e3
def sleep():
    import time
    time.sleep(600)
futures = [Workers(1).submit(work) for work in (compute, sleep)]
print("ready", flush=True)
futures[0].result()
"""


def killed_at_work(folder: Path) -> Outcome:
    """Kill -9 of a process whose workers are in the middle of a multiplication, and asleep."""
    command = Command(folder, sys.executable, "-c", COMPUTES)
    assert command.process.stdout is not None
    command.process.stdout.readline()
    time.sleep(1.0)
    there = len(command.family()) - 1
    command.process.kill()
    command.process.wait()
    lived, left = command.survivors()
    words = f"{there} workers; the last ended after {lived:.1f} s; left: {len(left)}"
    for number in left:
        os.kill(number, signal.SIGKILL)
    return Outcome(there == 2 and not left, words)


def signalled(command: Command, number: int, *, group: bool = False, any_moment: bool = False) -> str:
    """What is wrong when a command gets a signal now; nothing where it ends as it should, or had ended before.

    At `any_moment` it may be done and leaving, when the signal itself ends it: 128 + number for a shell too.
    """
    if command.process.poll() is None:
        with suppress(ProcessLookupError):
            (os.killpg if group else os.kill)(command.process.pid, number)
    start = time.monotonic()
    code, said = command.ended(20.0)
    took = time.monotonic() - start
    _, left = command.survivors()
    for one in left:
        os.kill(one, signal.SIGKILL)
    good = (0, -number) if number == signal.SIGKILL else (0, 128 + number, *(-number,) * any_moment)
    wrong = [f"exit code {code}"] * (code not in good) + [f"{len(left)} processes left"] * bool(left)
    wrong += ["a traceback"] * ("Traceback" in said or "Exception ignored" in said) + [f"{took:.0f} s"] * (took > 10.0)
    return ", ".join(wrong) and f"{signal.Signals(number).name}: {', '.join(wrong)}: {said[-300:]}"


MOMENTS = ((signal.SIGTERM, False), (signal.SIGINT, True), (signal.SIGKILL, False))
"""SIGTERM to the process, Ctrl-C to its process group as by a terminal, kill -9."""


def ended_while_workers_work(*asked: str, logs: int = 1) -> Callable[[Path], Outcome]:
    """SIGTERM, Ctrl-C and kill -9 when the workers of a command are there."""

    def run(folder: Path) -> Outcome:
        names, wrong = flown(folder, logs), []
        for number, group in MOMENTS:
            command = Command(folder, *SCRIPT, *(one.format(*names) for one in asked), "--force")
            if not command.until(command.has_worker):
                wrong.append("no worker came")
            wrong.append(signalled(command, number, group=group))
        bad = [one for one in wrong if one]
        return Outcome(not bad, "; ".join(bad) or "exit codes 143, 130 and -9; no traceback; no process left")

    return run


ATTACKS = (
    Attack(
        "a data folder with a module of every name of the standard library and of what is installed; `explain`",
        "none of them runs",
        in_data_folder(SCRIPT, *EXPLAIN),
    ),
    Attack(
        "the same; `python -m wrenchgap changed`",
        "none runs but those that Python itself imports to find `wrenchgap`",
        in_data_folder(MODULE, *CHANGED, logs=2),
    ),
    Attack("settings of numba in that folder", "refused in one line, nothing is compiled into it", settings_of_numba),
    Attack("the same; `batch compare`", "none of them runs", in_data_folder(SCRIPT, *BATCH), slow=True),
    Attack(
        "folders of another user in the shared folder of temporary files, named as ours, with a FIFO, a link to a file "
        "and a link to a folder",
        "no hang, nothing written or removed elsewhere, theirs stay",
        prepared,
    ),
    Attack("overwriting files of mode 600 to 666", "the mode stays; nobody else reads the new one earlier", modes),
    Attack(
        "another user's process asks scheduler, nanny and worker of `batch` to run something, with and without TLS",
        "all listen on loopback alone and let nobody in",
        cluster,
        slow=True,
    ),
    Attack(
        "kill -9 of a process whose workers compute",
        f"no worker lives for more than {LINGER:.0f} s",
        killed_at_work,
    ),
    Attack(
        "SIGTERM, Ctrl-C and kill -9 while workers of `explain` work",
        f"exit code 143 or 130, no traceback, no process after {LINGER:.0f} s",
        ended_while_workers_work(*EXPLAIN),
        slow=True,
    ),
)
