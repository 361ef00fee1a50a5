"""The C of an exported folder, checked, compiled and stepped from the records of a flight."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import UsageError
from wrenchgap.replay.export.records import EXPORT_ID, HASHED, export_id

AT_ONCE = 20_000
"""Records that are stepped in one run of the program: some 30 MB."""


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
    folder: Path, contents: dict[str, bytes], records: list[bytes], precision: str, kind: np.dtype[Any]
) -> tuple[tuple[float, float], NDArray[np.void]]:
    """The tolerances, and what the code makes: the state after wg_reset, then every record.

    What was checked is compiled, in a folder of its own, where no other file can stand in for a header.
    """
    with tempfile.TemporaryDirectory(prefix="wrenchgap-") as place:
        program, main = Path(place) / "flown", Path(__file__).with_name("flown.c")
        for name, content in {**contents, main.name: main.read_bytes()}.items():
            (Path(place) / name).write_bytes(content)
        sources = [str(Path(place) / name) for name in (main.name, *contents) if name.endswith(".c")]
        _run([*_compiler(), "-std=c99", "-O2", f"-DWG_{precision.upper()}", "-o", str(program), *sources, "-lm"],
             f"--export {folder}: cannot be compiled")  # fmt: skip
        answers = [_run([str(program)], f"--export {folder}: its code does not read the records", b"".join(part))
                   for part in _parts(records)]  # fmt: skip
    tolerances = np.frombuffer(answers[0][:16])
    made = [np.frombuffer(answer[16:], kind) for answer in answers]
    together = np.concatenate([made[0], *(one[1:] for one in made[1:])])
    return (float(tolerances[0]), float(tolerances[1])), together


def _parts(records: list[bytes]) -> Iterable[list[bytes]]:
    return (records[k : k + AT_ONCE] for k in range(0, len(records), AT_ONCE))


def _compiler() -> list[str]:
    """The C compiler, with its options: $CC, or one of the usual names."""
    asked = shlex.split(os.environ.get("CC", ""))
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
