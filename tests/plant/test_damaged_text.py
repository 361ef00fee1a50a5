"""Texts that are nearly TOML: one line, whatever the parser raises, in the model file as in its [command]."""

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
