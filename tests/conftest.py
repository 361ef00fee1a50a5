"""Flights that several test files fly are flown once for all workers, long files start first, browsers share a worker.

The last line of a run says what was not run.
"""

import fcntl
import hashlib
import os
import pickle
import time
from importlib import import_module
from types import SimpleNamespace

import pytest

try:
    from xdist.scheduler import LoadFileScheduling
except ImportError:  # one process
    LoadFileScheduling = None

try:
    from hypothesis import HealthCheck, settings
except ImportError:  # test_last_line runs this file by itself
    pass
else:  # a machine that is busy with other work is no fault of the code under test
    settings.register_profile("busy", deadline=None, suppress_health_check=[HealthCheck.too_slow])
    settings.load_profile("busy")

PATIENCE = 20.0
"""Seconds after which something that should happen in another thread or process did not."""


def eventually(condition, words="", seconds=PATIENCE):
    """Poll until true and return what it gave; fails with `words` otherwise."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, words or "waited in vain"
        time.sleep(0.03)
    return found


@pytest.fixture(name="eventually", scope="session")
def _eventually():
    """The function of that name, for the modules."""
    return eventually


REMEDY = "no Chromium or no Playwright; run: sudo apt-get install chromium && make setup"

LONG_FIRST = (
    "in_browser",
    "test_readme",
    "test_changed",
    "test_learn_and_compensate",
    "test_explain",
    "test_autopilot_pages",
    "test_where",
    "test_analysis_panels",
    "test_viewer_page",
    "test_view_command",
)
"""Files that take longest: begun last, one worker would be left alone with one of them."""

if "PYTEST_XDIST_WORKER" in os.environ:  # it has one core: a search starts no further processes unless a test says so
    os.environ.setdefault("WRENCHGAP_CORES", "1")


def pytest_collection_modifyitems(items):
    """Begin with LONG_FIRST; pass --no-loadscope-reorder to xdist, or it begins with the files of most tests."""
    rank = {name: place for place, name in enumerate(LONG_FIRST)}
    items.sort(key=lambda item: min((rank[name] for name in rank if name in item.path.stem), default=len(rank)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """With `--dist loadfile`: a file's tests on one worker, and those of all files that drive a browser on one.

    A browser without a GPU takes half a minute to compile what it draws with, and two of them at once twice that.
    """
    if config.getvalue("dist") != "loadfile" or LoadFileScheduling is None:
        return None

    class BrowsersTogether(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            return "in_browser" if "in_browser" in file else str(file)

    return BrowsersTogether(config, log)


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory):
    """A folder of this run that all workers see."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    (folder / "shared").mkdir(exist_ok=True)
    return folder / "shared"


@pytest.fixture(scope="session")
def once(shared_folder):
    """`once(name, make)` is `make()`, called by the first worker that asks for that name; the others wait and read."""

    def made(name, make):
        path = shared_folder / hashlib.sha256(name.encode()).hexdigest()[:16]
        with path.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not path.exists():
                path.write_bytes(pickle.dumps(make()))
            return pickle.loads(path.read_bytes())

    return made


OFFSET = "com_offset=x:-0.004,y:0.007,z:-0.005"


def fly_logs(folder):
    """Write logs of one vehicle: train and test hide a centre-of-mass offset, ideal hides nothing."""
    import wrenchgap as wg  # here, for test_last_line runs this file without the package

    folder.mkdir()
    believed = wg.load_model("tilt_hexarotor")
    for name, trajectory, seconds, excitation, hidden in (
        ("train", "multi_axis", 14.0, 1.0, (OFFSET,)),
        ("test", "figure8", 12.0, 0.0, (OFFSET,)),
        ("ideal", "multi_axis", 12.0, 1.0, ()),
    ):
        more = {"duration": seconds, "excitation": excitation, "seed": 1, "hide": hidden}
        wg.save_log(wg.simulate(believed, trajectory, name=name, **more), folder / f"{name}.mcap")
    return folder


@pytest.fixture(scope="session")
def logs(shared_folder, once):
    """The paths `train`, `test` and `ideal` of those logs, and their `folder`; nobody writes to it."""
    folder = once("logs", lambda: fly_logs(shared_folder / "logs"))
    return SimpleNamespace(folder=folder, **{path.stem: path for path in folder.iterdir()})


@pytest.fixture(scope="module")
def without_limits():
    """`explain` and `changed` without detection limits, which take most of the time: for tests that read none."""
    with pytest.MonkeyPatch.context() as patch:
        for module in ("posterior.explain", "changed.changed"):
            patch.setattr(import_module(f"wrenchgap.learn.{module}"), "detection_limits", lambda *args, **how: ())
        yield


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    """Below pytest's closing line, where nobody overlooks it: "passed" alone would hide the skipped browser tests."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None:
        return
    reports = reporter.stats.get("skipped", [])  # a file that is skipped whole has no keywords
    skipped = [report for report in reports if "browser" in getattr(report, "keywords", ())]
    if skipped:
        reporter.write_line(f"{len(skipped)} tests in a browser were not run: {REMEDY}")
