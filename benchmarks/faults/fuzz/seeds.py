"""Where the search begins: small valid files of every form."""

from __future__ import annotations

import tempfile
import zipfile
from pathlib import Path

from benchmarks.faults import appetites, valid

LOGS = ("mcap-unchunked", "mcap-none", "mcap-json", "mcap-protobuf", "bag-plain", "bag-bz2", "ulog", "dataflash", "csv")
SECONDS = 0.04
"""Of a log: a few messages of each topic."""
TEXTS = (
    "std_msgs/Header header\nfloat64[] position\ngeometry_msgs/Vector3 force\nstring[3] names\nfloat32[<=4] few\n",
    "lab_msgs/Inner[] many\nuint8 flag\n" + "=" * 80 + "\nMSG: lab_msgs/Inner\nfloat64 x\nlab_msgs/Thing again\n",
    "module lab_msgs { module msg { struct Thing { double first; sequence<float> more; }; }; };",
)


def write(folder: Path) -> None:
    """Seeds of every target, a folder each."""
    usual, valid.SECONDS = valid.SECONDS, SECONDS
    try:
        with tempfile.TemporaryDirectory() as place:
            made = {form: _made(form, Path(place)) for form in (*LOGS, "model", "trajectory", "gp")}
            parts = {"log": {form: made[form].read_bytes() for form in LOGS}}
            parts["log"] |= {f"appetite-{name}": seed for name, seed in appetites.seeds(Path(place) / "appetites")}
            parts["model"] = {"model": made["model"].read_bytes()}
            parts["trajectory"] = {"trajectory": made["trajectory"].read_bytes()}
            parts["process"] = {"whole": b"\xff" + made["gp"].read_bytes()} | _process_parts(made["gp"])
    finally:
        valid.SECONDS = usual
    loads = b"\x00\x00\x00\x01\x00\x00" + bytes(range(120))
    parts["definition"] = {
        f"definition{i}": bytes([flags]) + text.encode() + loads
        for i, (flags, text) in enumerate(zip((0, 1, 2), TEXTS, strict=True))
    }
    for target, files in parts.items():
        (folder / target).mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            (folder / target / name).write_bytes(content)


def _made(form: str, place: Path) -> Path:
    folder = place / form
    folder.mkdir()
    return valid.FORMS[form](folder)


def _process_parts(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: bytes([i]) + archive.read(name) for i, name in enumerate(sorted(archive.namelist()))}
