"""What a file that is read may make us open: a model file, a robot description, a list of logs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.attacks import Attack, Outcome
from benchmarks.attacks.outputs import run

AREA = "What data may open"
VEHICLE = 'schema = 1\n[vehicle]\nname = "q"\nmass = 1.0\ninertia = [0.01, 0.01, 0.02]\n'
TOLD = """
import sys
from wrenchgap.flight.errors import WrenchgapError
{imports}
for line in sys.stdin.read().split(chr(0)):
    try:
        {call}
        print("taken")
    except WrenchgapError as error:
        print("refused:", error)
"""


def told(folder: Path, imports: str, call: str, texts: Sequence[str]) -> list[str]:
    """What one process says of each of these texts, a line each; it is given 30 s."""
    code, given = TOLD.format(imports=imports, call=call), "\0".join(texts)
    asked = [sys.executable, "-c", code]
    done = subprocess.run(asked, cwd=folder, input=given, capture_output=True, text=True, check=True, timeout=30)
    return done.stdout.splitlines()


def opened(folder: Path) -> Outcome:
    """What is said of a model file whose bench table is somebody else's file."""
    secret, inside, content = folder / "secret.csv", folder / "model", "root:x:0:0:hunter2\n"
    inside.mkdir()
    (inside / "link.csv").symlink_to(secret)
    os.mkfifo(inside / "fifo.csv")
    for path in (secret, inside / "own.txt", inside / "own.csv"):
        path.write_text(content, encoding="utf-8")
    (inside / "cell.csv").write_text("command,thrust\n0,hunter2\n", encoding="utf-8")
    names = [str(secret), "../secret.csv", "link.csv", "own.txt", "own.csv", "cell.csv", "fifo.csv", "/etc/passwd"]
    names += ["/dev/stdin", "file:///etc/passwd", "s3://bucket/x.csv", "C:\\\\secret.csv", "a\\u0000b.csv"]
    texts = [f'{VEHICLE}[command]\nunit = "pwm"\ntable = "{name}"\n' for name in names]
    call = "loads(line, pathlib.Path())"
    imports = "import pathlib\nfrom wrenchgap.plant.model_file import loads"
    lines = told(inside, imports, call, texts)
    (inside / "m.toml").write_text(texts[7], encoding="utf-8")
    lines.append("refused: " + run(inside, "model", "show", "m.toml", expected=(2,)).stderr.decode().strip())
    refused, printed = (
        sum(line.startswith("refused: ") for line in lines),
        any("hunter2" in x or "root:" in x for x in lines),
    )
    words = (
        f"{refused} of {len(names) + 1} refused in one line; content of the file {'printed' if printed else 'nowhere'}"
    )
    return Outcome(refused == len(lines) == len(names) + 1 and not printed, words)


def described(folder: Path) -> Outcome:
    """An MJCF that includes and names files outside its folder: their mass must not count."""
    outside, inside = folder / "outside.xml", folder / "model"
    inside.mkdir()
    body = '<body><geom type="box" size="1 1 1" mass="7"/></body>'
    outside.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>", encoding="utf-8")
    (inside / "link.xml").symlink_to(outside)
    shape = '<asset><mesh name="m" file="{}"/></asset>'
    ways = [f'<include file="{name}"/>' for name in ("../outside.xml", str(outside), "link.xml")]
    ways += [shape.format(name) for name in ("/etc/passwd", "../m.stl", "http://192.0.2.1/m.stl")]
    ways += [
        '<compiler meshdir="/etc"/>' + shape.format("passwd"),
        f'<asset><model name="n" file="{outside}"/></asset>',
    ]
    texts = [f"<mujoco>{way}<worldbody>{body}</worldbody></mujoco>" for way in ways]
    hidden = f"<!DOCTYPE a [<!ENTITY b \"><include file='{outside}'/>\">]>"
    texts.append(f"{hidden}<mujoco><worldbody>{body}</worldbody></mujoco>")
    imports = "import pathlib\nfrom wrenchgap.plant.drafts.mjcf_urdf import from_mjcf\npath = pathlib.Path('m.xml')"
    lines = told(inside, imports, "path.write_text(line); from_mjcf(path)", texts)
    refused = sum("folder of the file" in line or "DOCTYPE" in line for line in lines)
    return Outcome(refused == len(lines) == len(texts), f"{refused} of {len(texts)} refused in one line")


def parameters(folder: Path) -> Outcome:
    """A file of RotorPy's parameters with code in it, given to `model new --from`."""
    ways = ["__import__('os').system('touch ran')", "open('ran', 'w').write('x')", "[open('ran', 'w') for _ in 'a'][0]"]
    ways += [
        "(lambda: open('ran', 'w'))()",
        "f\"{open('ran', 'w')}\"",
        "9**9**9**9",
        "'a' * 10**10",
        "np.fromfile('ran')",
    ]
    texts = [f"import numpy as np\nquad_params = {{'mass': {way}}}" for way in ways]
    texts += [
        "import os\nos.system('touch ran')\nquad_params = {}",
        "def f(a=open('ran', 'w')): pass\nquad_params = {}",
    ]
    texts += ["class A:\n    open('ran', 'w')\nquad_params = {}", "quad_params = " + "-" * 60000 + "1"]
    imports = "import pathlib\nfrom wrenchgap.plant.drafts.rotorpy import from_rotorpy\npath = pathlib.Path('m.py')"
    lines = told(folder, imports, "path.write_text(line); from_rotorpy(path)", texts)
    refused, ran = sum(line.startswith("refused: ") for line in lines), (folder / "ran").exists()
    words = f"{refused} of {len(texts)} refused in one line; code in the file {'run' if ran else 'not run'}"
    return Outcome(refused == len(lines) == len(texts) and not ran, words)


def listed(folder: Path) -> Outcome:
    """A list of logs with addresses that stand for others: an index of fsspec may name any other."""
    code = "{{ cycler.__init__.__globals__.os.system('touch pwned') }}"
    index = {"version": 1, "gen": [{"key": "a.mcap", "url": code, "dimensions": {"i": {"stop": 2}}}]}
    (folder / "index.json").write_text(json.dumps(index), encoding="utf-8")
    lines = ["reference://::index.json", "simplecache::http://192.0.2.1/a.mcap", "reference://a.mcap"]
    imports = "import pathlib\nfrom wrenchgap.replay.batch.sources import logs_named\npath = pathlib.Path('logs.txt')"
    said = told(folder, imports, "path.write_text(line); logs_named(['logs.txt'])", lines)
    refused = sum("no address of one store" in line for line in said)
    ran = (folder / "pwned").exists()
    words = f"{refused} of {len(lines)} refused; code in the index {'run' if ran else 'not run'}"
    return Outcome(refused == len(lines) and not ran, words)


ATTACKS = (
    Attack(
        "a model file whose `[command] table` is /etc/passwd, `../`, a link out, a device, an address",
        "opens .csv files in its own folder only, and repeats nothing of them",
        opened,
    ),
    Attack(
        "an MJCF that includes or names files outside its folder, or hides that in a DOCTYPE; `model new --from`",
        "refused in one line, nothing outside is opened",
        described,
    ),
    Attack(
        "a file of RotorPy's parameters (.py) with calls, functions, classes, endless numbers; `model new --from`",
        "refused in one line, nothing of it is run",
        parameters,
    ),
    Attack(
        "a list of logs with chained addresses of fsspec (`reference://::index.json`); `batch`",
        "refused in one line, no index is read",
        listed,
    ),
)
