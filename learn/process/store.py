"""Fitted Gaussian processes on disk: one zip of plain arrays and JSON, no pickle.

    gp.json         format, version, output names, settings, provenance, SHA-256 of all of it
    NAME.npy        one per array field of `GaussianProcess`

The same GP always gives the same bytes. `numpy.load` opens the arrays too. The SHA-256 tells a file that was damaged or
changed by hand, and no file that was made to deceive.
"""

import hashlib
import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, replace
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from wrenchgap.flight.atomic import atomic
from wrenchgap.flight.errors import FitError, ModelError, UsageError
from wrenchgap.learn.data.archive import DAMAGED, check_sizes, line, numbers
from wrenchgap.learn.process.gp import Caution, CautionKind, FitSettings, GaussianProcess, Provenance
from wrenchgap.plant.reader import Integer, Names, Table, Text, expected, read

FORMAT = "wrenchgap Gaussian process"
VERSION = 5
READABLE = range(1, VERSION + 1)
METADATA = "gp.json"
LARGEST_METADATA = 2**22
"""Bytes of gp.json; that of a process is some 10 kB."""


def save(gp: GaussianProcess, path: Path | str, *, force: bool = False) -> None:
    """Write `gp` to `path`, all of it or nothing. Raises UsageError where the file exists and `force` is not given."""
    path = Path(path)
    if path.exists() and not force:
        raise UsageError(f"{path}: exists already; choose another name or overwrite it with --force")
    with atomic(path) as partial:
        partial.write_bytes(_bytes(gp))


def load(path: Path | str) -> GaussianProcess:
    """Read what `save` wrote. Raises FitError, in one line, on anything else."""
    path = Path(path)
    if path.exists() and not path.is_file():
        raise FitError(f"{path}: is no ordinary file; give a file made by `wrenchgap learn`")
    try:
        with zipfile.ZipFile(path) as archive:
            check_sizes(archive, {METADATA: LARGEST_METADATA})
            metadata = _metadata(archive, path)
            stored_arrays = [n for n in archive.namelist() if n.endswith(".npy")]
            arrays = {Path(n).stem: numbers(archive, n) for n in stored_arrays}
            whole = _sha256(metadata, {n: archive.read(n) for n in stored_arrays})
    except FileNotFoundError:
        raise FitError(f"{path}: no such file; make one with `wrenchgap learn LOG -m MODEL -o {path.name}`") from None
    except OSError as error:
        raise FitError(f"{path}: cannot be read: {error.strerror or error}") from None
    except DAMAGED as error:
        raise FitError(f"{path}: not a stored GP, or a damaged one ({line(error)}); learn it again") from None
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            stored = read(StoredProcess, metadata, error=FitError)
            lists = {name: tuple(stored.settings.get(name, ())) for name in ("inputs", "blind")}
            made = GaussianProcess(
                outputs=stored.outputs,
                settings=FitSettings(**{**stored.settings, **lists}),
                provenance=_provenance(stored.provenance, stored.format_version, len(stored.outputs)),
                **arrays,
            )
            if stored.format_version >= 5 and stored.sha256 != whole:
                raise FitError("its parts are not those that its SHA-256 is of")
            return made
    except (FitError, ModelError, UsageError) as error:
        raise FitError(f"{path}: {error}; the file is damaged, learn it again") from None
    except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise FitError(f"{path}: a stored GP with missing or unknown parts ({line(error)}); learn it again") from None


def _bytes(gp: GaussianProcess) -> bytes:
    metadata = {
        "format": FORMAT,
        "format_version": VERSION,
        "outputs": list(gp.outputs),
        "settings": asdict(gp.settings),
        "provenance": asdict(gp.provenance),
    }
    parts = {}
    for name in gp.array_shapes():
        buffer = BytesIO()
        np.save(buffer, getattr(gp, name).astype("<f8"), allow_pickle=False)
        parts[f"{name}.npy"] = buffer.getvalue()
    metadata["sha256"] = _sha256(metadata, parts)
    parts = {METADATA: json.dumps(metadata, indent=1, sort_keys=True).encode(), **parts}
    whole = BytesIO()
    with zipfile.ZipFile(whole, "w") as archive:
        for name, content in parts.items():
            archive.writestr(zipfile.ZipInfo(name), content)
    return whole.getvalue()


def _sha256(metadata: Mapping[str, Any], arrays: Mapping[str, bytes]) -> str:
    """Of what is in gp.json without the sum itself, and of the arrays by their names."""
    said = {key: value for key, value in metadata.items() if key != "sha256"}
    found = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
    for name in sorted(arrays):
        found.update(name.encode() + b"\0" + hashlib.sha256(arrays[name]).digest())
    return found.hexdigest()


def _metadata(archive: zipfile.ZipFile, path: Path) -> dict[str, Any]:
    if METADATA not in archive.namelist():
        raise FitError(f"{path}: a zip without {METADATA}, so not a stored GP; give a file made by `wrenchgap learn`")
    metadata = json.loads(archive.read(METADATA))
    if not isinstance(metadata, dict) or metadata.get("format") != FORMAT:
        raise FitError(f"{path}: not a stored GP; give a file made by `wrenchgap learn`")
    if metadata.get("format_version") not in READABLE:
        raise FitError(
            f"{path}: stored GP of format version {metadata.get('format_version')}, this program reads "
            f"{', '.join(map(str, READABLE))}; learn it again"
        )
    return metadata


Parts = Annotated[dict[str, Any], expected("a table")]


class StoredProcess(Table):
    """What is in gp.json."""

    format: Text
    format_version: Integer
    outputs: Names
    settings: Parts
    provenance: Parts
    sha256: Text = ""


def _provenance(entries: dict[str, Any], version: int, outputs: int) -> Provenance:
    said = [asdict(Caution(CautionKind.SAID, text=w)) if isinstance(w, str) else w for w in entries.get("warnings", ())]
    found = read(Provenance, {**entries, "warnings": said}, where="provenance", error=FitError)
    if len(found.lags) not in (0, outputs):
        raise FitError(f"provenance.lags: got {len(found.lags)}, expected one for each of {outputs} outputs")
    # before version 4 the bandwidth of the observer did not keep the margin of the whole loop: it is forgotten
    return found if version >= 4 else replace(found, observer_hz=None)
