"""Commands that write, killed in the middle or on a full disk: what was there stays, or the new file is whole.

The kernel ends the command at a byte that is known beforehand, by the limit of a file's size: nothing cleans up.
"""

import json
import os
import resource
import signal
import sys
import tomllib
from pathlib import Path

import pytest

from wrenchgap import flight
from wrenchgap.replay.cli.main import app

if sys.platform != "linux":
    pytest.skip("limits and signals as on Linux", allow_module_level=True)

OLD = b"what was here before\n" * 3
HEXA = ("-m", "tilt_hexarotor")
HOVER = ("simulate", *HEXA, "-t", "hover", "--duration", "2")
COMMANDS = {
    "simulate": (*HOVER, "-o", "OUT/new.mcap", "--json", "OUT/new.json"),
    "convert": ("convert", "LOG", "-o", "OUT/new.mcap"),
    "compare": ("compare", "LOG", *HEXA, "--between", "2:6", "--figure", "OUT/new.png", "--json", "OUT/new.json"),
    "remove": ("remove", "com_offset", "-m", "IN/fitted.toml", "-o", "OUT/new.toml"),
}


@pytest.fixture(scope="module")
def inputs(logs, tmp_path_factory):
    """A log and a model with an effect; a command must leave them as they are."""
    import wrenchgap as wg
    from wrenchgap.plant.effect_values import with_values

    folder = tmp_path_factory.mktemp("in")
    (folder / "log.mcap").write_bytes(logs.test.read_bytes())
    model = wg.load_model("tilt_hexarotor")
    wg.save_model(with_values(model, ["com_offset=x:0.001,y:0,z:0"]), folder / "fitted.toml")
    return folder


def limited(words, folder, inputs, size, deadly):
    """Run a command in a process whose files end at `size` bytes; its exit code, or minus the signal that ended it."""
    places = {"LOG": str(inputs / "log.mcap"), "IN/": f"{inputs}/", "OUT/": f"{folder}/"}
    arguments = []
    for word in words:
        for name, place in places.items():
            word = word.replace(name, place) if word.startswith(name) else word
        arguments.append(word)
    child = os.fork()
    if not child:
        try:
            nowhere = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1, 2):
                os.dup2(nowhere, stream)
            os.environ["XDG_CACHE_HOME"] = os.devnull  # no kept flights: they are files too
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
            signal.signal(signal.SIGXFSZ, signal.SIG_DFL if deadly else signal.SIG_IGN)
            app([*arguments, "--force"], prog_name="wrenchgap")
        except SystemExit as done:
            os._exit(done.code or 0)
        finally:
            os._exit(1)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def whole(path):
    """Whether a file is complete, by reading it."""
    kinds = {
        ".json": lambda: json.loads(path.read_text()),
        ".toml": lambda: tomllib.loads(path.read_text()),
        ".mcap": lambda: not any("cut" in note for note in flight.load(path).notes) or 1 / 0,
        ".png": lambda: path.read_bytes().endswith(b"IEND\xaeB`\x82") or 1 / 0,
    }
    kinds[path.suffix]()
    return True


def outputs(words, folder):
    """The files that a command writes, with something in them already."""
    found = [folder / Path(word).name for word in words if word.startswith("OUT/")]
    for path in found:
        path.write_bytes(OLD)
    return found


def state(folder):
    return {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in folder.iterdir()}


def check(name, size, deadly, inputs, tmp_path):
    words, before = COMMANDS[name], state(inputs)
    targets = outputs(words, tmp_path)
    code = limited(words, tmp_path, inputs, size, deadly)
    assert state(inputs) == before
    for path in targets:
        assert path.read_bytes() == OLD or whole(path)
    assert any(path.read_bytes() == OLD for path in targets), "the limit came too late to end anything"
    return code, targets


@pytest.mark.parametrize("name", COMMANDS)
def test_killed_while_it_writes(name, inputs, tmp_path):
    code, _ = check(name, 300, True, inputs, tmp_path)
    assert code == -signal.SIGXFSZ


@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk_is_one_line_and_leaves_nothing(name, inputs, tmp_path):
    code, targets = check(name, 300, False, inputs, tmp_path)
    assert code == 2
    assert sorted(tmp_path.iterdir()) == sorted(targets)
