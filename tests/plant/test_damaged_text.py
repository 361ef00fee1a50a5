"""Texts that are nearly TOML: one line, whatever the parser raises, in the model file as in its [command]."""

import time
from pathlib import Path

import pytest

from wrenchgap.flight.errors import ModelError
from wrenchgap.plant import model_file
from wrenchgap.plant.reader import toml

ROOT = Path(__file__).resolve().parents[2]
PLAIN = (ROOT / "models/crazyflie.toml").read_text(encoding="utf-8")
BROKEN = {
    "a key twice": "a = 1\na = 2\n",
    "a table twice": "[a]\n[a]\n",
    "a key twice in a list of tables": "[[arms]]\nrotors = [{ spin = 1 }]\nrotors = [{ spin = 1 }]\n",
    "lists without end": "a = " + "[" * 5000 + "]" * 5000,
    "no end": "a = [1, 2",
    "no TOML": "\x00\x01 = =",
}


@pytest.mark.parametrize("name", BROKEN)
def test_it_is_said_to_be_no_toml(name, tmp_path):
    with pytest.raises(ModelError, match="is not TOML"):
        toml(BROKEN[name])
    for extra in ("", "\n[command]\nunit = 'pwm'\ntable = 'bench.csv'\n"):
        path = tmp_path / "model.toml"
        path.write_text(PLAIN + extra + BROKEN[name], encoding="utf-8")
        with pytest.raises(ModelError, match=r"is not TOML|not a known key") as caught:
            model_file.load(path)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 400


SLOW = {
    "keys of one table, eight deep": "".join(f"a.b.c.d.e.f.g.k{i} = 1\n" for i in range(9_000)),
    "a key without end": "a." * 120_000 + "a = 1",
    "one of quoted parts, behind a string that ends in the same line": 't={s="""\n\'""", ' + "'a b'." * 40_000 + "a=1}",
    "a list": "a = [" + "1," * 120_000 + "]",
    "3,000 arms": "[[vehicle.arms]]\nazimuth_deg = 1\nlength = 0.2\n[[vehicle.arms.rotors]]\nspin = 1\n" * 3000,
    "more than is read": "a = 1\n" * 50_000,
}


@pytest.mark.parametrize("name", SLOW)
def test_what_would_keep_a_parser_busy_is_refused_in_seconds(name, tmp_path):
    began, path = time.process_time(), tmp_path / "model.toml"
    path.write_text(PLAIN.partition("[[vehicle.arms]]")[0] + SLOW[name], encoding="utf-8")
    with pytest.raises(
        ModelError,
        match=r"not a known key|a key within 50 others|3,000 arms or rotors|is longer than 262,144 characters",
    ):
        model_file.load(path)
    assert time.process_time() - began < 6.0
