"""Records of a flown export: what they hold, how they are found in a log, and what its C makes of them again.

`wrenchgap_record.h` in the export writes them.
"""

import hashlib
import mmap
import os
import re
import shlex
import shutil
import subprocess
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import LogError, UsageError, work_files
from wrenchgap.flight.budget import Account, Budget
from wrenchgap.flight.formats import READERS
from wrenchgap.flight.formats.reader import DoubtfulError, Reader, TableReader

HASHED = (
    "wrenchgap_compensator.c",
    "wrenchgap_compensator.h",
    "wrenchgap_tables.h",
    "wrenchgap_record.h",
    "wrenchgap_record.c",
)
"""Files that are compiled on the vehicle, whose content every record of a flight names (`export_id`)."""
EXPORT_ID = re.compile(rb'(#define WG_EXPORT ")([0-9a-f]*)"')
MAGIC = b"WGR1"
HEAD = np.dtype(
    {
        "names": ["magic", "length", "export", "real", "numbers", "wholes", "zero", "number"],
        "formats": ["S4", "<u4", "V8", "<u2", "<u2", "<u2", "<u2", "<u4"],
    }
)
LONGEST = 1 << 16
"""Bytes of a record: a state of some hundred numbers is the longest that an export has."""
INPUT = {"wrench_desired": 6, "feedback": 6, "position_E": 3, "quat_EB": 4, "velocity_E": 3, "omega_B": 3}
INPUT |= {"time": 1, "voltage": 1}
OUTPUT = {
    "wrench_cmd": 6,
    "correction": 6,
    "optimum": 6,
    "expected": 6,
    "sigma": 1,
    "estimate": 3,
    "beta": 1,
    "cost": 1,
}
"""Numbers of the fields of a `wg_input` and a `wg_output`."""
PRECISION = {8: "double", 4: "float"}


def export_id(contents: Mapping[str, bytes]) -> str:
    """Sixteen hexadecimal digits that tell this code from any other: of the SHA-256 of the files in `HASHED`.

    `contents` are their bytes, by name; the id that wrenchgap_record.h states is left out of it.
    """
    parts = (EXPORT_ID.sub(rb'\1"', contents[name]) for name in HASHED)
    return hashlib.sha256(b"".join(len(part).to_bytes(8) + part for part in parts)).hexdigest()[:16]


def record_type(real_bytes: int, numbers: int, counts: int) -> np.dtype[Any]:
    """The type of a record: bytes of a `wg_real`, and how many numbers and counts the state has."""
    real = f"<f{real_bytes}"
    fields = [(name, real, (size,) if size > 1 else ()) for name, size in (INPUT | OUTPUT).items()]
    fields += [("evaluations", "<i4", ()), ("status", "<i4", ()), ("state", real, (numbers,))]
    fields += [("counts", "<i4", (counts,)), ("sum", "<u4", ())]
    return np.dtype([*HEAD.descr, *fields])


def sizes_of(head: np.void) -> tuple[int, int, int]:
    """What `record_type` asks, of the head of a record."""
    return int(head["real"]), int(head["numbers"]), int(head["wholes"])


def read_records(path: Path, budget: Budget | str | None = None) -> tuple[list[bytes], int]:
    """Records in a log, in its order, and how many places begin like one and are none."""
    if not path.exists():
        raise LogError(f"{path}: no such file or folder")
    for careful in (False, True):
        records: list[bytes] = []
        damaged = 0
        reader = _reader(path, careful=careful)
        files = [path] if reader is None else reader.data_files()
        account = Budget.of(budget).account(path, sum(file.stat().st_size for file in files))
        try:
            for data in _pieces(path, reader, account):
                damaged += _scan(data, records, account)
        except DoubtfulError:
            continue
        break
    if not records:
        raise LogError(
            f"{path}: no record of an exported compensation in it ({damaged} damaged); log what "
            "wg_step_recorded fills, byte by byte (wrenchgap_record.h in the export)"
        )
    return records, damaged


def _reader(path: Path, *, careful: bool) -> Reader | None:
    """What reads the messages of a log; None for a file of another kind, or of tables."""
    head = b""
    if path.is_file():
        with path.open("rb") as file:
            head = file.read(64)
    kind = next((one for one in READERS if one.accepts(path, head)), None)
    return None if kind is None or issubclass(kind, TableReader) else kind(path, careful=careful)


def _pieces(path: Path, reader: Reader | None, account: Account) -> Iterator[bytes | mmap.mmap]:
    """The payloads of a log's messages; without a reader the file, whole."""
    if reader is not None:
        reader.account = account
        for batch in reader.batches(lambda channel: True):
            yield from batch.payloads if isinstance(batch.payloads, list) else batch.payloads.payloads()
    elif path.is_file() and path.stat().st_size:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as whole:
            yield whole
    else:
        raise LogError(f"{path}: is empty, or no log; expected a file with records of an exported compensation")


def _scan(data: bytes | mmap.mmap, records: list[bytes], account: Account) -> int:
    """Put the records in `data` into `records`; returns how many begin like one and are none."""
    damaged, place = 0, data.find(MAGIC)
    while place >= 0:
        account.check_time()
        length = _said_length(data[place : place + HEAD.itemsize])
        record = data[place : place + length]
        whole = 0 < length == len(record)
        if whole and zlib.adler32(record[:-4]) == int.from_bytes(record[-4:], "little"):
            account.take(length, "records")
            records.append(record)
            place = data.find(MAGIC, place + length)
        else:
            damaged += 1
            place = data.find(MAGIC, place + 1)
    return damaged


def _said_length(head: bytes) -> int:
    """Bytes of the record that begins so, 0 where none does: looked at before its content is copied."""
    if len(head) < HEAD.itemsize:
        return 0
    said = np.frombuffer(head, HEAD)[0]
    length = int(said["length"])
    fits = length <= LONGEST and int(said["real"]) in PRECISION and record_type(*sizes_of(said)).itemsize == length
    return length if fits else 0


def checked_export(folder: Path) -> tuple[str, dict[str, bytes]]:
    """The id of an exported folder, whose code is as it was written, and that code."""
    if not folder.is_dir():
        raise UsageError(f"--export {folder}: no such folder; name the one that `wrenchgap export` wrote")
    missing = [name for name in HASHED if not (folder / name).is_file()]
    if missing:
        raise UsageError(
            f"--export {folder}: has no {missing[0]}; expected a folder that `wrenchgap export` wrote (older ones keep "
            "no records: export again)"
        )
    contents = {name: (folder / name).read_bytes() for name in HASHED}
    said = [match[2].decode() for match in EXPORT_ID.finditer(contents["wrenchgap_record.h"])]
    found = export_id(contents)
    if said != [found]:
        raise UsageError(
            f"--export {folder}: {', '.join(HASHED)} are not as `wrenchgap export` wrote them "
            f"({', '.join(said) or 'no id'} in wrenchgap_record.h, {found} of the code); export again"
        )
    return found, contents


def stepped(
    folder: Path,
    contents: dict[str, bytes],
    records: list[bytes],
    precision: str,
    kind: np.dtype[Any],
    at_once: int = 20_000,
) -> tuple[tuple[float, float], NDArray[np.void]]:
    """The tolerances, and what the code makes: the state after wg_reset, then every record.

    What was checked is compiled, in a folder of its own, where no other file can stand in for a header. So many
    records as `at_once`, some 30 MB, are stepped in one run of the program.
    """
    with tempfile.TemporaryDirectory(dir=work_files.folder()) as place:
        program, main = Path(place) / "flown", Path(__file__).with_name("flown.c")
        for name, content in {**contents, main.name: main.read_bytes()}.items():
            (Path(place) / name).write_bytes(content)
        sources = [str(Path(place) / name) for name in (main.name, *contents) if name.endswith(".c")]
        _run([*_compiler(), "-std=c99", "-O2", f"-DWG_{precision.upper()}", "-o", str(program), *sources, "-lm"],
             f"--export {folder}: cannot be compiled")  # fmt: skip
        wrong = f"--export {folder}: its code does not read the records"
        parts = (b"".join(records[k : k + at_once]) for k in range(0, len(records), at_once))
        answers = [_run([str(program)], wrong, part) for part in parts]
    first, second = np.frombuffer(answers[0][:16]).tolist()
    made = [np.frombuffer(answer[16:], kind) for answer in answers]
    return (first, second), np.concatenate([made[0], *(one[1:] for one in made[1:])])


def _compiler() -> list[str]:
    """The C compiler, with its options: $CC, or one of the usual names."""
    try:
        asked = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise UsageError(f"--export: CC={os.environ['CC']} in the environment: {error}; or unset it") from None
    for words in (asked, ["cc"], ["gcc"], ["clang"]):
        if words and (found := shutil.which(words[0])):
            return [found, *words[1:]]
    raise UsageError(
        "--export: no C compiler found; sudo apt-get install gcc libc6-dev, or name one with CC=/path/to/cc"
    )


def _run(words: list[str], what: str, given: bytes = b"") -> bytes:
    """What a program prints; raises UsageError, which begins with `what`, where it fails."""
    done = subprocess.run(words, input=given, capture_output=True, check=False)
    if done.returncode:
        said = next((line for line in done.stderr.decode(errors="replace").splitlines() if "error" in line), "")
        raise UsageError(f"{what}: {said or f'exit code {done.returncode}'}; export again")
    return done.stdout
