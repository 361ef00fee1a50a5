"""What names, links and lists in a folder of data can make of a command that only wanted to read or write there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from time import perf_counter
from unittest import mock

from mcap.reader import make_reader
from mcap.writer import Writer

from benchmarks.attacks import Attack, Outcome
from benchmarks.attacks.outputs import MODEL, flown, run
from wrenchgap.flight.atomic import atomic
from wrenchgap.flight.errors import UsageError
from wrenchgap.replay.batch import sources
from wrenchgap.replay.batch.store import Store
from wrenchgap.replay.present.documents import claim
from wrenchgap.viewer.host import error_text
from wrenchgap.viewer.view_state import parse

AREA = "Names, links and lists"
SHELL = (
    "$(touch pwned)",
    "`touch pwned`",
    "a;id",
    "a b",
    "a\x1b]0;x\x07",
    "-rf",
    "a\\$(id)",
    "a|id",
    "~root",
    "a'b",
    "a&id",
)
LISTS = 30
MODELS = Path(__file__).parents[2] / "models"
ZSH = "_arguments '*: :(("
"""How what is offered to zsh begins."""


def _completed(folder: Path) -> Outcome:
    """Ask for completions as bash and zsh do."""
    for name in (*SHELL, "quad"):
        (folder / f"{name}.toml").touch()
    offered = []
    for shell in ("bash", "zsh"):
        words = {
            "COMP_WORDS": "wrenchgap model show ",
            "COMP_CWORD": "3",
            "_TYPER_COMPLETE_ARGS": "wrenchgap model show ",
        }
        asked = dict(os.environ, _WRENCHGAP_COMPLETE=f"complete_{shell}", **words)
        done = subprocess.run(
            [sys.executable, "-c", "from wrenchgap.__main__ import main; main()"],
            env=asked, cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        offered.append(done.stdout)
    lines = set(offered[0].splitlines())
    bad = sorted(lines - {"quad.toml", *(path.stem for path in MODELS.glob("*.toml"))})
    run = [sign for sign in "$`;|&*~\x1b" if sign in "".join(offered).replace(ZSH, "")]
    found = all("quad.toml" in said for said in offered)
    return Outcome(found and not bad and not run, f"of {len(SHELL)} such names offered: {len(bad)}; quad.toml: {found}")


def _named_by_inputs(folder: Path) -> Outcome:
    """Outputs, with --force, on files that are read because an input names them, or an option that is no log."""
    plain = (MODELS / "tilt_hexarotor.toml").read_text(encoding="utf-8")
    (folder / "m.toml").write_text(plain + '\n[command]\nunit = "normalised"\ntable = "bench.csv"\n', encoding="utf-8")
    (folder / "flight.toml").write_text("schema = 1\n[trajectory]\nduration = 3\nhome = [0, 0, 1]\n")
    (folder / "bench.csv").write_text("command,thrust\n0,0\n0.5,4\n1,11.25\n")
    (folder / "hull.xml").write_text("<mujoco><default/></mujoco>")
    run(folder, "write", MODEL, "--to", "mjcf", "-o", "made.xml")
    text = (folder / "made.xml").read_text(encoding="utf-8")
    (folder / "v.xml").write_text(text.replace("<worldbody>", '<include file="hull.xml"/><worldbody>', 1))
    log, kept = str(flown(folder)), {n: (folder / n).read_bytes() for n in ("bench.csv", "flight.toml", "hull.xml")}
    asked = (
        ("ready", log, "-m", MODEL, "--for", "flight.toml", "--json", "flight.toml"),
        ("simulate", "-m", MODEL, "-t", "flight.toml", "-o", "s.mcap", "--truth", "flight.toml"),
        ("effectiveness", "m.toml", "--csv", "bench.csv"),
        ("add", "mass", "-m", "m.toml", "--from", log, "-o", "bench.csv"),
        ("model", "new", "--from", "v.xml", "-o", "n.toml", "--json", "hull.xml"),
    )
    said = [run(folder, *words, "--force", expected=(2,)).stderr for words in asked]
    refused = sum(b"is one of the inputs" in one for one in said)
    whole = all((folder / name).read_bytes() == before for name, before in kept.items())
    return Outcome(refused == len(asked) and whole, f"{refused} of {len(asked)} refused; all files kept: {whole}")


SPACES = ("a$(touch${IFS}pwned)", "b'$(touch${IFS}pwned)'", "c;touch${IFS}pwned")


def _proposed(folder: Path) -> Outcome:
    """The options that `check` and `inspect` propose for a log of three vehicles, given to a shell as they stand."""
    with flown(folder).open("rb") as source, (folder / "log.mcap").open("wb") as target:
        writer, channels = Writer(target), dict[str, int]()
        writer.start()
        for schema, channel, message in make_reader(source).iter_messages():
            assert schema is not None
            for topic in (f"/{space}{channel.topic}" for space in SPACES):
                if topic not in channels:
                    kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[topic] = writer.register_channel(topic, channel.message_encoding, kind)
                writer.add_message(channels[topic], message.log_time, message.data, message.publish_time)
        writer.finish()
    proposed = set()
    for command in ("check", "inspect"):
        said = run(folder, command, "log.mcap", expected=(0, 3)).stdout.decode()
        proposed |= {after.split(",")[0].strip() for after in re.findall("--topic (.*)", said)}
    for words in proposed:
        subprocess.run(["sh", "-c", f"true --topic {words}"], cwd=folder, capture_output=True, check=False)
    ran = (folder / "pwned").exists()
    return Outcome(bool(proposed) and not ran, f"{len(proposed)} proposed options; something ran: {ran}")


def _globbed(folder: Path) -> Outcome:
    """A table that is Python too, called as the option that names a file with effects."""
    (folder / "--effects=a.csv").write_text("t,x=open('pwned','w'),1\n0.0,1.0,2.0\n", encoding="utf-8")
    (folder / "b.csv").write_text("t,x\n0.0,1.0\n", encoding="utf-8")
    said = run(folder, "explain", *sorted(p.name for p in folder.glob("*.csv")), "-m", MODEL, expected=(2,)).stderr
    ran = (folder / "pwned").exists()
    return Outcome(b"ending in .py" in said and not ran, f"refused in one line; it ran: {ran}")


def _lists(folder: Path) -> Outcome:
    log = folder / "one.mcap"
    log.write_bytes(b"x")
    (folder / "round.txt").write_text(f"{folder}/round.txt\n{log}\n")
    for k in range(LISTS):
        (folder / f"{k}.txt").write_text(f"{folder}/{k + 1}.txt\n" * 2)
    (folder / f"{LISTS}.txt").write_text(f"{log}\n")
    for name in "xy":
        (folder / name).symlink_to(".")
    start = perf_counter()
    found = [len(sources.logs_named([str(folder / n)])) for n in ("round.txt", "0.txt", ".", "**/*.mcap")]
    took = perf_counter() - start
    return Outcome(found == [1] * 4 and took < 2.0, f"one log found each time, {took:.2f} s in all")


def _hidden(folder: Path) -> Outcome:
    """A link where the hidden file will be, whose random name was guessed, and a target that is a link to nothing."""
    victim, shared = folder / "victim", folder / "shared"
    victim.write_text("mine")
    shared.mkdir()
    (shared / ".out.guessed.part.json").symlink_to(victim)
    guessed = mock.patch("secrets.token_hex", return_value="guessed")
    with suppress(UsageError), guessed, atomic(shared / "out.json") as partial:
        partial.write_text("new")
    (shared / "link.json").symlink_to(folder / "made")
    try:
        claim({"--json": shared / "link.json"}, force=False)
        refused = False
    except UsageError:
        refused = True
    kept = victim.read_text() == "mine" and not (shared / "out.json").is_symlink()
    return Outcome(kept and refused, f"the other file is kept: {kept}; the link to nothing is refused: {refused}")


ROW = {"key": "k", "log": "a.mcap", "status": "ok"}


def _rows_linked(folder: Path) -> Outcome:
    """A batch that goes on in a folder with links for its hidden file, its row and the vehicle's folder."""
    victim, shared = folder / "victim", folder / "shared"
    victim.write_text("mine")
    place = shared / "rows/pass=1/vehicle=alpha/date=unknown"
    place.mkdir(parents=True)
    (shared / "rows/pass=1/vehicle=bravo").symlink_to(folder)
    for name in (".k.parquet.guessed.part", ".k.guessed.part.parquet", "k.parquet"):
        (place / name).symlink_to(victim)
    refused = 0
    for vehicle in ("alpha", "bravo"):
        try:
            with mock.patch("secrets.token_hex", return_value="guessed"):
                Store(str(shared)).add(ROW, vehicle)
        except UsageError:
            refused += 1
    kept = victim.read_text() == "mine" and sorted(p.name for p in folder.iterdir()) == ["shared", "victim"]
    return Outcome(kept and refused == 2, f"the other file is kept: {kept}; refused: {refused} of 2")


def _rows_damaged(folder: Path) -> Outcome:
    """Rows that are empty, cut, another table, a pipe, a device."""
    store = Store(str(folder))
    store.add(ROW, "alpha")
    (path,) = folder.rglob("*.parquet")
    good = path.read_bytes()
    makes: dict[str, Callable[[], object]] = {
        "empty": lambda: path.write_bytes(b""),
        "cut": lambda: path.write_bytes(good[: len(good) // 2]),
        "garbage": lambda: path.write_bytes(b"PAR1" * 1000),
        "pipe": lambda: os.mkfifo(path),
        "device": lambda: path.symlink_to("/dev/zero"),
    }
    start, refused = perf_counter(), []
    for name, make in makes.items():
        path.unlink()
        make()
        try:
            store.rows()
        except UsageError as error:
            refused += [name] if "\n" not in str(error) and path.name in str(error) else []
    took = perf_counter() - start
    return Outcome(len(refused) == len(makes) and took < 2.0, f"{len(refused)} of {len(makes)} refused, {took:.2f} s")


def _pasted(_: Path) -> Outcome:
    start = perf_counter()
    try:
        parse('{"schema": "' + "/!" * 500_000 + '"}')
        said = ""
    except UsageError as error:
        said = error_text(error)
    took = perf_counter() - start
    return Outcome(0 < len(said) < 500 and took < 2.0, f"refused in {len(said)} characters and {took:.2f} s")


ATTACKS = (
    Attack("model files whose names a shell would run; TAB behind `wrenchgap model show`", "not offered", _completed),
    Attack(
        "topics that a shell would run; the options that `check` and `inspect` propose, pasted into one",
        "one word each",
        _proposed,
    ),
    Attack("a table called `--effects=a.csv` that is Python too; `explain *.csv`", "not run", _globbed),
    Attack(
        "`batch` on a list that names itself, on thirty lists that name the next twice, on links to their own folder",
        "each is gone through once, 2 s",
        _lists,
    ),
    Attack(
        "a trajectory, a bench table that the model file names, an MJCF's include as the output, with --force",
        "refused, each is kept",
        _named_by_inputs,
        slow=True,
    ),
    Attack(
        "a link in the place of the hidden file of an output, an output that is a link to nothing",
        "nothing behind a link is written; refused",
        _hidden,
    ),
    Attack(
        "a folder of `batch` with links in the place of a row, of its hidden file and of a vehicle's folder",
        "nothing behind a link is written; refused",
        _rows_linked,
    ),
    Attack(
        "rows of `batch` that are empty, cut, garbage, a pipe, /dev/zero",
        "each refused in one line that names it, 2 s",
        _rows_damaged,
    ),
    Attack("a view of 1 MB pasted into the page, a path at every second character", "one line in 2 s", _pasted),
)
