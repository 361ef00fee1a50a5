import json
import pickle
import zipfile
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest

from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.learn.process.gp import Caution, CautionKind, FitSettings, LogSource, Provenance
from wrenchgap.learn.process.store import load, save
from wrenchgap.learn.process.train import fit


@pytest.fixture
def gp(hand_made):
    origin = Provenance("voliro_x", "ab", "nominal", 8.0, (LogSource("α.mcap", "cd"),), "0.1", "2026-01-01")
    return replace(hand_made(15), settings=FitSettings(points=15, mean="linear"), provenance=origin)


SPARSE = FitSettings(points=20, restarts=0, inputs=("past",), inference="sparse", mean="linear")


@pytest.fixture
def path(gp, tmp_path):
    """A file that holds `gp`."""
    save(gp, tmp_path / "a.gp")
    return tmp_path / "a.gp"


def same(one, other, columns):
    """Predictions are equal bit for bit."""
    query = np.random.default_rng(1).normal(size=(20, columns))
    for function in ("mean", "std", "jacobian"):
        assert getattr(one, function)(query).tobytes() == getattr(other, function)(query).tobytes()


def refused(path, message):
    with pytest.raises(FitError, match=message) as caught:
        load(path)
    assert "\n" not in str(caught.value)


def rewritten(path, change):
    """The zip at `path` with `change(name, content) -> content or None` applied to each part."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: change(name, archive.read(name)) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in parts.items():
            if content is not None:
                archive.writestr(name, content)


@pytest.mark.parametrize("kind", ["gp", "sparse"])
def test_comes_back_bit_for_bit(kind, request, tmp_path):
    made = request.getfixturevalue(kind)
    save(made, tmp_path / "a.gp")
    back = load(tmp_path / "a.gp")
    same(back, made, len(made.input_mean))
    assert (back.outputs, back.provenance, back.settings) == (made.outputs, made.provenance, made.settings)
    assert back.sigma_scale.tolist() == made.sigma_scale.tolist()
    save(back, tmp_path / "b.gp")
    assert (tmp_path / "a.gp").read_bytes() == (tmp_path / "b.gp").read_bytes()
    with np.load(tmp_path / "a.gp", allow_pickle=False) as arrays:  # numpy alone can read it
        assert arrays["lengthscales"] == pytest.approx(made.lengthscales)


def test_overwrites_only_when_told_and_a_failed_write_leaves_the_old_file(gp, tmp_path, monkeypatch):
    path = tmp_path / "a.gp"
    path.write_text("precious")
    with pytest.raises(UsageError, match="exists already"):
        save(gp, path)
    with monkeypatch.context() as full:
        full.setattr("pathlib.Path.replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left")))
        with pytest.raises(UsageError, match="No space left"):
            save(gp, path, force=True)
    assert [file.name for file in tmp_path.iterdir()] == ["a.gp"]
    assert path.read_text() == "precious"
    save(gp, path, force=True)
    assert load(path).outputs == gp.outputs
    with pytest.raises(UsageError, match="cannot be written: No such file or directory"):
        save(gp, tmp_path / "nowhere" / "a.gp")


@pytest.mark.parametrize("fraction", [0.0, 0.001, 0.3, 0.7, 0.99])
def test_cut_file_is_refused(path, fraction):
    content = path.read_bytes()
    path.write_bytes(content[: int(fraction * len(content))])
    refused(path, r"a\.gp: not a stored GP, or a damaged one")


def test_flipped_byte_is_noticed(path):
    content = bytearray(path.read_bytes())
    content[content.index(b"\x93NUMPY") + 150] ^= 1
    path.write_bytes(bytes(content))
    refused(path, "CRC")


def test_pickle_is_never_opened(path, tmp_path):
    rewritten(path, with_array("inputs", np.array([{"a": 1}], dtype=object)))
    refused(path, "damaged")
    path.write_bytes(pickle.dumps({"a": 1}))
    refused(path, "not a stored GP")


def with_metadata(**change):
    def edit(name, content):
        return json.dumps({**json.loads(content), **change}) if name == "gp.json" else content

    return edit


def with_array(which, value):
    buffer = BytesIO()
    np.save(buffer, value, allow_pickle=True)
    return lambda name, content: buffer.getvalue() if name == f"{which}.npy" else content


def without(which):
    return lambda name, content: None if name == which else content


def test_missing_file_says_how_to_make_one_and_a_folder_is_none(tmp_path):
    refused(tmp_path / "none.gp", "no such file; make one with `wrenchgap learn")
    refused(tmp_path, "is no ordinary file")


@pytest.fixture(scope="module")
def sparse():
    """A sparse process with the past of the command as input, calibrated, about which `learn` had something to say."""
    rng = np.random.default_rng(0)
    wrench = rng.normal(size=(300, 12))
    made = fit(wrench, np.sin(wrench[:, :2]), ("torque_x", "torque_z"), SPARSE)
    said = Provenance("voliro_x", warnings=(Caution(CautionKind.NOT_WORTH_IT, ("torque_z",), (0.2,), (0.19,)),))
    return replace(made, sigma_scale=np.array([1.5, 0.8]), provenance=said)


def of_format_1(name, content):
    """What this part was before sparse processes, calibration, inputs and warnings."""
    if name in ("sigma_scale.npy", "weights.npy", "whitener.npy"):
        return None
    if name != "gp.json":
        return content
    metadata = json.loads(content)
    for key in ("inputs", "inference", "calibrate"):
        del metadata["settings"][key]
    del metadata["provenance"]["warnings"]
    return json.dumps(metadata | {"format_version": 1})


def test_file_of_format_1_still_predicts_the_same(gp, path):
    rewritten(path, of_format_1)
    back = load(path)
    same(back, gp, 6)
    assert (back.sigma_scale == 1.0).all()
    assert (back.settings.inputs, back.settings.inference, back.provenance.warnings) == ((), "exact", ())
    assert back.provenance.logs == gp.provenance.logs


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        ("gp", with_metadata(format_version=99), "format version 99, this program reads 1"),
        ("gp", with_metadata(format="something"), "not a stored GP"),
        ("gp", with_metadata(settings={"colour": 1}), "missing or unknown parts"),
        ("gp", with_metadata(outputs=["torque_x", "torque_y", "thrust"]), "unknown output 'thrust'"),
        ("gp", with_metadata(outputs=5), "outputs: got 5, expected a list of names; the file is damaged"),
        ("gp", with_metadata(settings=None), "settings: got None, expected a table; the file is damaged"),
        ("gp", without("gp.json"), "a zip without gp.json"),
        ("gp", without("inputs.npy"), "missing or unknown parts"),
        ("gp", with_array("inputs", np.full((15, 6), np.nan)), "inputs holds values that are not finite"),
        ("gp", with_array("inputs", np.zeros(6)), "missing or unknown parts"),
        ("gp", with_array("noise_variance", np.array([-1.0, 1.0, 1.0])), "noise_variance must be positive"),
        ("sparse", with_array("weights", np.zeros((2, 19))), r"weights has shape \(2, 19\), expected \(2, 20\)"),
        ("sparse", with_array("sigma_scale", np.zeros(2)), "sigma_scale must be positive"),
        ("sparse", without("whitener.npy"), r"whitener has shape \(0, 0, 0\)"),
        ("sparse", with_metadata(settings={**SPARSE.__dict__, "inputs": ["weather"]}), "weather"),
        ("sparse", with_array("inputs", np.zeros((20, 9))), r"input_mean has shape \(12,\), expected \(9,\)"),
    ],
)
def test_damage_is_named(kind, change, message, request, tmp_path):
    save(request.getfixturevalue(kind), tmp_path / "a.gp")
    rewritten(tmp_path / "a.gp", change)
    refused(tmp_path / "a.gp", message)


def part(path, name, content):
    rewritten(path, lambda known, old: content if known == name else old)


def saved(values):
    stream = BytesIO()
    np.save(stream, values)
    return stream.getvalue()


def test_what_a_part_claims_is_not_believed(path):
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    part(path, "inputs.npy", b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head)
    refused(path, "not a stored GP, or a damaged one")


def test_parts_that_were_changed_are_told_by_their_sha256(gp, path):
    part(path, "residuals.npy", saved(gp.residuals * np.nextafter(1.0, 2.0)))
    refused(path, "its parts are not those that its SHA-256 is of; the file is damaged")
    save(gp, path, force=True)
    rewritten(path, with_metadata(outputs=list(reversed(gp.outputs))))
    refused(path, "its parts are not those that its SHA-256 is of")


def test_a_header_whose_keys_are_not_all_text_is_damage(path):
    head = b"{'descr': '<f8', b'fortran_order': False, 'shape': (15, 6), }"
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    part(path, "inputs.npy", b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + bytes(720))
    refused(path, "not a stored GP, or a damaged one")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.full((15, 6), 1e308), "numbers above 1e\\+100"),
        (np.full((15, 6), 1j), "double precision"),
        (np.array(["text"]), "double precision"),
        (np.full((15, 6), np.nan), "finite"),
    ],
)
def test_parts_that_hold_no_numbers_of_a_process(path, values, words):
    part(path, "inputs.npy", saved(values))
    refused(path, words)


def test_scales_that_overflow_are_refused_and_not_warned_of(path):
    part(path, "lengthscales.npy", saved(np.full((3, 6), 1e-300)))
    refused(path, "GP")


def test_a_long_complaint_of_the_zip_is_shortened(path):
    data = path.read_bytes()
    place = data.index(b"gp.json")
    path.write_bytes(data[:place] + b"\xff" * 400 + data[place + 400 :])
    with pytest.raises(FitError) as caught:
        load(path)
    assert len(str(caught.value)) < 400 + len(str(path))


@pytest.mark.parametrize(
    "entries",
    [
        {"observer_hz": "2"},
        {"observer_hz": True},
        {"observer_hz": -1.0},
        {"observer_hz": float("nan")},
        {"loop_lag": float("nan")},
        {"loop_delay": -1.0},
        {"loop_delay": "x"},
        {"lags": [-1.0] * 3},
        {"lags": [float("nan")] * 3},
        {"lags": [0.1] * 7},
        {"lags": ["a"] * 3},
        {"gains": {"a": 1}},
        {"logs": [{"name": 1, "sha256": "x"}]},
        {"warnings": [{"kind": "worse", "axes": 1, "before": [], "after": []}]},
        {"verdicts": [{"output": "torque_x", "decision": "do not", "reason": "lag", "gain": "1", "reduction": []}]},
    ],
)
def test_a_provenance_that_says_none_is_refused(path, entries):
    """A bandwidth that was text ended in an internal error, and lags that were no number were taken."""

    def change(name, content):
        if name != "gp.json":
            return content
        metadata = json.loads(content)
        metadata["provenance"] |= entries
        return json.dumps(metadata).encode()

    rewritten(path, change)
    refused(path, f"provenance.{next(iter(entries))}")
