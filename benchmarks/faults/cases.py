"""Which damage each form gets; a case is a form and a number, and always the same file."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.faults import autopilot, structured, written
from benchmarks.faults.mutations import ANY, in_folder
from benchmarks.faults.valid import FORMS, LOGS

SEED = 12
FILES_OF_LOGS, FILES_OF_OTHERS = 450, 1500
"""Of each form, in the whole run."""
Fault = Callable[[Path, np.random.Generator], None]
NEWER = ("crazyflie-usd",)
ORDER = (*sorted(FORMS.keys() - set(NEWER)), *NEWER)
"""Forms by their seeds; those that came later are last, so that the files of the others stay what they are."""

KNOWING: dict[str, tuple[Fault, ...]] = {
    **{form: structured.MCAP for form in FORMS if form.startswith("mcap")},
    **{form: structured.BAG for form in FORMS if form.startswith("bag")},
    "db3": structured.DB3,
    "folder-sqlite3": structured.FOLDER,
    "folder-mcap": (structured.metadata,),
    "folder-zstd": (structured.metadata,),
    "ulog": autopilot.ULOG,
    "dataflash": autopilot.DATAFLASH,
    "crazyflie-usd": autopilot.CRAZYFLIE_USD,
    "csv": written.CSV,
    "parquet": written.PARQUET,
    "model": written.TOML,
    "mapping": (*written.TOML, written.bench),
    "trajectory": written.TOML,
    "gp": (*written.GP * 12, written.gp_bomb),
    "parameters": (),
    "sdf": written.XML,
    "urdf": written.XML,
    "mjcf": written.XML,
}
"""Damage that knows the form."""


def files_of(form: str) -> int:
    """Files of a form, in the whole run."""
    return FILES_OF_LOGS if form in LOGS else FILES_OF_OTHERS


def _as_folder(path: Path, rng: np.random.Generator) -> None:
    """A folder of the name, empty or with something in it."""
    data = path.read_bytes()
    path.unlink()
    path.mkdir()
    for name in ("a.mcap", "notes.txt", "b.bag")[: int(rng.integers(4))]:
        (path / name).write_bytes(data if rng.random() < 0.5 else b"")


def _as_zip(path: Path, rng: np.random.Generator) -> None:
    """The file in a zip of its name."""
    data = path.read_bytes()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(zipfile.ZipInfo(path.name), data)


def _of_another_form(path: Path, rng: np.random.Generator) -> None:
    """The beginning of the file, and then another form."""
    other = ORDER[int(rng.integers(len(ORDER) - len(NEWER)))]
    folder = path.with_name("other")
    folder.mkdir()
    made = FORMS[other](folder)
    files = [made] if made.is_file() else sorted(made.iterdir())
    start = path.read_bytes()[: int(rng.choice([0, 8, 64, 5000]))]
    path.write_bytes(start + files[0].read_bytes())
    shutil.rmtree(folder)


def _plain(content: bytes) -> Fault:
    def made(path: Path, rng: np.random.Generator) -> None:
        path.write_bytes(content)

    made.__name__ = f"content {content[:12]!r}"
    return made


def _head_alone(path: Path, rng: np.random.Generator) -> None:
    """The magic bytes, and noise or nothing behind them."""
    path.write_bytes(
        path.read_bytes()[: int(rng.choice([4, 8, 13, 16, 64]))] + rng.bytes(int(rng.choice([0, 1, 100, 9000])))
    )


OTHER_FILES: tuple[Fault, ...] = (
    *(_plain(b""), _plain(b"\n"), _plain(b"\0" * 4096), _plain(b"this is a text file\n"), _plain(b"\xff" * 300)),
    *(_as_folder, _as_zip, _of_another_form, _head_alone, _head_alone),
)
"""What is no damaged file of the form but no file of the form at all."""


@dataclass(frozen=True)
class Case:
    """One damaged file: the `number`-th of a form."""

    form: str
    number: int

    def fault(self) -> tuple[str, np.random.Generator]:
        """What is done to it, and the numbers that it is done with."""
        rng = np.random.default_rng([SEED, ORDER.index(self.form), self.number])
        draw, knowing = rng.random(), KNOWING[self.form]
        if draw < 0.06:
            return "other", rng
        return ("knowing" if knowing and draw < 0.5 else "bytes"), rng

    def make(self, valid: Path, folder: Path) -> tuple[Path, str]:
        """The damaged copy of a valid file or folder, and what was done to it."""
        path = folder / valid.name
        if valid.is_dir():
            shutil.copytree(valid, path)
        else:
            shutil.copytree(valid.parent, folder, dirs_exist_ok=True)
        kind, rng = self.fault()
        if kind == "bytes" or (kind == "other" and path.is_dir()):
            change = ANY[int(rng.integers(len(ANY)))]
            in_folder(path, change, rng)
            return path, change.__name__
        chosen = OTHER_FILES if kind == "other" else KNOWING[self.form]
        fault = chosen[int(rng.integers(len(chosen)))]
        fault(path, rng)
        return path, fault.__name__.strip("_")
