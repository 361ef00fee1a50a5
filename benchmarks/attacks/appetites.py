"""Small files with large appetites: `inspect` in a process of its own, its peak memory and its processor time."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from importlib import resources
from pathlib import Path

from benchmarks.attacks import Attack, Outcome
from benchmarks.faults.appetites import made

AREA = "Small files, large appetites"
MODEL = "tilt_hexarotor"
COMMAND = (sys.executable, "-m", "wrenchgap")


MEASURED = """
import json, resource, subprocess, sys
done = subprocess.run(sys.argv[1:], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
peak = used.ru_maxrss / (1024 if sys.platform == "darwin" else 1)
text = done.stdout[:100_000].decode(errors="replace")
print(json.dumps([done.returncode, text, peak * 1024 / 1e6, used.ru_utime + used.ru_stime]))
"""
"""Between this process and the one that is measured: Linux counts the memory of whoever starts a process as its own."""


def inspected(path: Path, *options: str) -> tuple[int, str, float, float]:
    """Exit code, output, peak memory [MB] and processor time [s] of `inspect`."""
    return measured("inspect", str(path), *options)


def measured(*asked: str) -> tuple[int, str, float, float]:
    """The same of any command."""
    words = [sys.executable, "-c", MEASURED, *COMMAND, *asked]
    code, text, memory, time = json.loads(subprocess.run(words, capture_output=True, check=True).stdout)
    return code, text, memory, time


def appetite(name: str, refusal: str, megabytes: float, seconds: float) -> Callable[[Path], Outcome]:
    """Whether `inspect` refuses such a file in one line that says `refusal`, or reads it where that is empty."""

    def run(folder: Path) -> Outcome:
        code, text, memory, time = inspected(made(name, folder))
        right = code == 2 and text.count("\n") == 1 and refusal in text if refusal else code in (0, 3)
        words = f"{'refused in one line' if refusal else 'read'}, {memory:,.0f} MB, {time:.1f} s"
        return Outcome(
            right and memory < megabytes and time < seconds, words if right else f"exit {code}: {text[:200]}"
        )

    return run


def raised(folder: Path) -> Outcome:
    """The option lets a log through that its budget refuses."""
    path = made("mcap-json", folder, seed=True)
    less, said, _, _ = inspected(path, "--budget", "1kB")
    more, _, _, _ = inspected(path, "--budget", "1GB,60s")
    return Outcome(less == 2 and "--budget" in said and more in (0, 3), f"exit {less} with 1kB, {more} with 1GB")


def columns_without_end(folder: Path) -> Outcome:
    """A model file names columns of a topic that no array has."""
    model = folder / "vehicle.toml"
    plain = (resources.files("wrenchgap.models") / "tilt_hexarotor.toml").read_text(encoding="utf-8")
    model.write_text(plain.replace('imu = "/imu"', 'imu = "/imu[0:99999999999]"'), encoding="utf-8")
    code, text, memory, time = inspected(made("mcap-json", folder, seed=True), "-m", str(model))
    right = code == 2 and text.count("\n") == 1 and "[0:99999999999]" in text
    words = f"refused in one line, {memory:,.0f} MB, {time:.1f} s" if right else f"exit {code}: {text[:200]}"
    return Outcome(right and memory < 500 and time < 10, words)


def greedy_model(more: str, refusal: str, output: str, *asked: str) -> Callable[[Path], Outcome]:
    """A model file with `more` at its end, and a command that reads it."""

    def run(folder: Path) -> Outcome:
        model = folder / "vehicle.toml"
        plain = (resources.files("wrenchgap.models") / "tilt_hexarotor.toml").read_text(encoding="utf-8")
        model.write_text(plain + more, encoding="utf-8")
        code, text, memory, time = measured(*asked, "-m", str(model), "-o", str(folder / output))
        right = code == 2 and text.count("\n") == 1 and refusal in text
        words = f"refused in one line, {memory:,.0f} MB, {time:.1f} s" if right else f"exit {code}: {text[:200]}"
        return Outcome(right and memory < 500 and time < 10, words)

    return run


def greedy_trajectories(folder: Path) -> Outcome:
    """Trajectory files of at most 0.3 MB whose motion takes gigabytes, minutes, or divides by nearly nothing."""
    head = "schema = 1\n[trajectory]\nduration = 600\nhome = [0, 0, 1]\n"
    move = '[[moves]]\nkind = "{}"\nstart = 0\nduration = 600\n'
    shake = move.format("shake") + "size = 1e-6\nangle_deg = 0\nlow_hz = 0.1\nhigh_hz = {}\nseed = {}\n"
    texts = {
        "20 Hz at most": shake.format(1e6, 0),
        "at most 4,000": "".join(shake.format(19, k) for k in range(400)),
        "at most 500": (move.format("turn") + "angle_deg = 1\n") * 3000,
        "expected 0.1 to": move.format("shift") + "by = [1e9, 0, 0]\nramp = 1e-300\n",
        "0.1 s or longer": move.format("swing") + "by = [1, 0, 0]\nperiod = 1e-300\n",
    }
    refused, most, longest = 0, 0.0, 0.0
    for words, moves in texts.items():
        (folder / "t.toml").write_text(head + moves, encoding="utf-8")
        output = str(folder / "o.mcap")
        code, text, memory, time = measured("simulate", "-m", MODEL, "-t", str(folder / "t.toml"), "-o", output)
        refused += code == 2 and text.count("\n") == 1 and words in text
        most, longest = max(most, memory), max(longest, time)
    said = f"{refused} of {len(texts)} refused in one line, {most:,.0f} MB, {longest:.1f} s at most"
    return Outcome(refused == len(texts) and most < 500 and longest < 20, said)


def greedy_descriptions(folder: Path) -> Outcome:
    """MJCF and URDF of a few lines that take gigabytes or minutes, crash their compiler, or are too deep to walk."""
    body = '<body name="v"><freejoint/><geom size="0.1"/>{}</body>'
    lines = (
        '<size nuserdata="1500000000"/>',
        '<size memory="100G"/>',
        '<asset><texture name="t" type="2d" builtin="checker" width="60000" height="60000"/></asset>',
        '<asset><mesh name="m" builtin="cone" params="100000000 1"/></asset>',
        '<asset><model name="n" file="v.xml"/></asset><worldbody><attach model="n" prefix="p"/></worldbody>',
        '<worldbody><replicate count="+200000"><geom size="0.1"/></replicate></worldbody>',
        f"<worldbody>{'<body>' * 2000}{'</body>' * 2000}</worldbody>",
    )
    texts = [f"<mujoco><worldbody>{body.format('')}</worldbody>{line}</mujoco>" for line in lines]
    texts.append(f'<robot name="r">{"<link>" * 1500}{"</link>" * 1500}</robot>')
    texts.append('<?xml version="1.0" encoding="idna"?><robot name="r"><link name="l"/></robot>')
    refused, most, longest = 0, 0.0, 0.0
    for text in texts:
        (folder / "v.xml").write_text(text, encoding="utf-8")
        asked = ("model", "new", "--from", str(folder / "v.xml"), "-o", str(folder / "o.toml"))
        code, said, memory, time = measured(*asked)
        refused += code == 2 and said.count("\n") == 1 and "Traceback" not in said
        most, longest = max(most, memory), max(longest, time)
    words = f"{refused} of {len(texts)} refused in one line, {most:,.0f} MB, {longest:.1f} s at most"
    return Outcome(refused == len(texts) and most < 2500 and longest < 40, words)


OPTION, COMPUTED = "--budget", "computed"
CASES: tuple[tuple[str, str, str, float, float], ...] = (
    (
        "ulog-nested",
        "a ULog of 3 kB whose format holds 500 formats of 300 numbers, subscribed to 300 times",
        OPTION,
        1500,
        15,
    ),
    ("ulog-long-name", "a ULog of 60 kB with 360,000 numbers in a field of 60,000 letters", OPTION, 1500, 15),
    ("ulog-beyond", "a ULog of 0.1 MB whose last definition claims to be longer than the file", "damaged", 500, 10),
    ("parquet-rows", "a Parquet file of 1.6 MB with 50,000,000 rows", OPTION, 500, 10),
    ("parquet-text", "a Parquet file of 0.3 MB that holds a text of 100,000 letters 100,000 times", OPTION, 500, 10),
    (
        "parquet-page",
        "a Parquet file whose page says that it has 2,147,483,647 bytes and values",
        "not a readable Parquet table",
        500,
        10,
    ),
    ("mcap-arrays", "an MCAP file of 0.1 MB with 300 messages of 1,000,000 numbers", OPTION, 2000, 20),
    ("mcap-chunks", "an MCAP file of 2.3 MB with 100 chunks of 240 MB", OPTION, 2000, 30),
    ("mcap-json", "an MCAP file of 6 MB in JSON, every message with a key of its own", OPTION, 2500, 20),
    ("bag-bz2", "a bag of 6 kB with a chunk of 0.8 GB", OPTION, 1500, 10),
    ("db3-generated", "a .db3 of 28 kB whose messages of 900 MB are made when they are read", COMPUTED, 1000, 10),
    ("csv-commas", "a CSV table with a header of 50,000,000 commas", OPTION, 1000, 10),
    ("csv-header", "a CSV table with a header of 100,000,000 letters", "", 2000, 20),
    ("csv-columns", "a CSV table of 100,000 columns", "", 1000, 30),
    ("csv-alike", "a CSV table of 100,000 columns of one name", "", 1000, 30),
    ("parquet-bytes", "a Parquet file of 0.1 MB with four rows of 150 MB", OPTION, 500, 10),
    (
        "mcap-long-key",
        "an MCAP file of 1.6 MB with 60,000 numbers in JSON below a name of 100,000 letters",
        OPTION,
        2500,
        20,
    ),
    (
        "mcap-long-name",
        "an MCAP file of 0.8 MB whose schema has 1,990 names below one of 800,000 letters",
        "",
        500,
        10,
    ),
    (
        "mcap-fan",
        "an MCAP file of 0.4 MB whose protobuf type holds 20,000 flags and itself 8 times, 4 deep",
        OPTION,
        2000,
        20,
    ),
    (
        "mcap-open-quotes",
        "an MCAP file of 0.1 MB whose definition in IDL opens 40,000 texts and closes none",
        "",
        500,
        10,
    ),
    (
        "mcap-empty-types",
        "an MCAP file of 31 kB whose type has 300 fields of 300 fields ..., six deep",
        OPTION,
        2000,
        20,
    ),
    ("mcap-parentheses", "an MCAP file of 0.3 kB with a constant of IDL in 14 parentheses", "", 500, 10),
    ("mcap-constants", "an MCAP file of 2 kB with 40 constants of IDL, each the square of the last", "", 500, 10),
    ("folder-footer", "a folder of two MCAP files of 0.1 MB whose summary is a chunk of 4 GB", "no message", 1000, 10),
    ("bag-view", "a folder of two .db3 of 8 kB whose messages are a view without end", "no tables", 500, 10),
    ("bag-metadata", "a bag whose metadata.yaml has 300,000 empty lines", "", 500, 10),
    ("mcap-channels", "an MCAP file of 65,534 channels", "", 1000, 30),
)
SLOW = frozenset({"mcap-arrays", "mcap-chunks", "csv-columns", "csv-alike", "mcap-channels", "parquet-rows", "bag-bz2"})
ATTACKS = (
    *(
        Attack(
            f"{what}; `inspect`",
            f"{f'refused in one line that says {refusal}' if refusal else 'read'}; {megabytes:,.0f} MB, "
            f"{seconds:.0f} s of processor time",
            appetite(name, refusal, megabytes, seconds),
            slow=name in SLOW,
        )
        for name, what, refusal, megabytes, seconds in CASES
    ),
    Attack(
        "a model file whose topic has 99,999,999,999 columns; `inspect -m`",
        "refused in one line that says which; 500 MB, 10 s of processor time",
        columns_without_end,
    ),
    Attack(
        "descriptions of a few lines with 1.5e9 numbers, 1e8 faces, themselves, 200,000 copies; `model new --from`",
        "refused in one line each; 2,500 MB, 40 s of processor time",
        greedy_descriptions,
        slow=True,
    ),
    Attack(
        "a model file with a controller at 200 Hz and an IMU at 1,000,003 Hz; `simulate`",
        "refused in one line that says steps; 500 MB, 10 s of processor time",
        greedy_model("\n[sensors]\nimu_rate_hz = 1000003\n", "steps", "out.mcap", "simulate", "-t", "hover"),
    ),
    Attack(
        "a model file of 0.8 MB; `add --value`",
        "refused in one line that says characters; 500 MB, 10 s of processor time",
        greedy_model("# x\n" * 200_000, "characters", "out.toml", "add", "--value", "mass=added:0.1"),
    ),
    Attack(
        "trajectory files: a shake up to 1 MHz, 400 shakes, 3,000 turns, a ramp and a period of 1e-300 s; `simulate`",
        "each refused in one line; 500 MB, 20 s of processor time",
        greedy_trajectories,
        slow=True,
    ),
    Attack("a log that its budget refuses, with `--budget 1GB,60s`", "refused before, read then", raised),
)
