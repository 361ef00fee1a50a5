"""A user's own effect: accepted when it is one, else refused in one line with file and line."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.errors import ModelError
from wrenchgap.plant import effects, model_file, own_effects
from wrenchgap.plant.model import make_effect

PAGE = Path(__file__).resolve().parents[2] / "docs" / "effects" / "your-own.md"
EXAMPLE = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]


@pytest.fixture(autouse=True)
def nothing_stays():
    yield
    effects.forget()


@pytest.fixture
def written(tmp_path):
    def write(text):
        (tmp_path / "mine.py").write_text(text, encoding="utf-8")
        return tmp_path / "mine.py"

    return write


def test_the_example_of_the_page_is_an_effect(written):
    before = set(effects.catalogue())
    own_effects.use([written(EXAMPLE)])
    assert set(effects.catalogue()) - before == {"field_torque"}
    assert effects.sources()["field_torque"].file == "mine.py"
    own_effects.use([])
    assert set(effects.catalogue()) == before


def test_model_file_says_what_to_pass(written, tmp_path):
    own_effects.use([written(EXAMPLE)])
    model, saved = model_file.load("tilt_hexarotor"), tmp_path / "m.toml"
    model_file.save(model.with_effects([make_effect(model.vehicle, "field_torque", {"x": 0.1, "y": 0, "z": 0})]), saved)
    again = model_file.load(saved)
    assert again.effects[0].theta.tolist() == [0.1, 0.0, 0.0]
    assert again.notes == ()
    own_effects.use([written(EXAMPLE + "\n# changed\n")])
    assert "not as it was" in model_file.load(saved).notes[0]
    effects.forget()
    with pytest.raises(ModelError, match=r"a program, .* pass that file with --effects mine\.py") as caught:
        model_file.load(saved)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("file", "proposed"),
    [("/tmp/a.py", "a.py"), ("../a.py", "a.py"), ("--force", "./--force"), ("http://x/y z.py", "'y z.py'")],
)
def test_a_model_file_leads_to_no_program_elsewhere(written, tmp_path, file, proposed):
    own_effects.use([written(EXAMPLE)])
    model, saved = model_file.load("tilt_hexarotor"), tmp_path / "m.toml"
    model_file.save(model.with_effects([make_effect(model.vehicle, "field_torque", {"x": 0.1, "y": 0, "z": 0})]), saved)
    saved.write_text(saved.read_text().replace('"mine.py"', f'"{file}"'))
    effects.forget()
    with pytest.raises(ModelError) as caught:
        model_file.load(saved)
    assert str(caught.value).endswith(f"if you trust it, pass that file with --effects {proposed}")


@pytest.mark.parametrize("name", sorted(effects.catalogue()))
def test_every_effect_of_the_catalogue_passes(name):
    """The checks ask of a user no more than of ourselves."""
    path = Path(effects.__file__).parent / f"{name}.py"
    assert own_effects._File(path, type(effects.find(name))).checked().name == name


HEAD = """import numpy as np
from dataclasses import replace
from wrenchgap.plant.effects import *
from wrenchgap.plant.effects.effect import Effect
class Mine({place}):
    name = "mine"
    excited_by = "anything"
    def parameters(self, vehicle):
        return (Parameter("k", "1", -1.0, 1.0, 0.1),)
"""
WRENCH = HEAD.format(place="WrenchEffect") + "    def apply(self, actuation, wrench_B, theta, context):\n        "
BODY = HEAD.format(place="BodyEffect") + "    def apply(self, body, theta):\n        "
COMMAND = HEAD.format(place="CommandEffect") + "    def apply(self, commands, theta, context, dt, memory):\n        "


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("x = 1\ny = = 2\n", 2, "is not Python"),
        ("x = " + "+".join(["1"] * 100_000), 1, "recursion"),
        ("x = " + "-" * 200_000 + "1", 1, "too deeply nested"),
        ("x = 1\nimport nothing_like_this\n", 2, "ModuleNotFoundError"),
        ("x = 1\n\ny = x / 0\n", 3, "ZeroDivisionError"),
        ("raise SystemExit(3)\n", 1, "SystemExit"),
        ("x = 1\n", 1, "defines no effect"),
        (HEAD.format(place="Effect"), 5, "subclass one of"),
        (HEAD.format(place="WrenchEffect"), 5, "lacks the method 'apply'"),
        (WRENCH.replace('"mine"', '"com_offset"') + "return theta[0] * wrench_B", 5, "exists already"),
        (WRENCH.replace('    name = "mine"\n', "") + "return theta[0] * wrench_B", 5, "no valid 'name'"),
        (WRENCH.replace('"anything"', "3") + "return theta[0] * wrench_B", 5, "no valid 'excited_by'"),
        (WRENCH.replace("(Parameter(", "[Parameter(").replace("0.1),)", "0.1)]") + "return 0 * wrench_B", 8, "tuple"),
        (WRENCH.replace("0.1),)", "0.0),)") + "return theta[0] * wrench_B", 8, "scale"),
        (WRENCH.replace('"1"', "None") + "return theta[0] * wrench_B", 8, "got unit None, expected one short line"),
        (WRENCH.replace('"1"', '"N\\n"') + "return theta[0] * wrench_B", 8, "expected one short line"),
        (WRENCH.replace("1.0, 0.1", "10**400, 0.1") + "return theta[0] * wrench_B", 8, r"of a size up to 1e\+12"),
        (WRENCH.replace("1.0, 0.1", "1.0, 1e-300") + "return theta[0] * wrench_B", 8, "expected 1e-15 at least"),
        (
            WRENCH.replace("    def par", "    confused_with = 'mass'\n    def par") + "return 0 * wrench_B",
            5,
            "tuple of names",
        ),
        (WRENCH + "raise SystemExit(0)", 11, "SystemExit"),
        (WRENCH.replace("-1.0, 1.0", "0.5, 1.0") + "return theta[0] * wrench_B", 8, "start"),
        (WRENCH.replace('"k"', '"k.x"') + "return theta[0] * wrench_B", 8, "names a parameter"),
        (WRENCH + "return (1 + theta[0]) * wrench_B", 10, "zero must mean no effect"),
        (WRENCH + "return theta[0] * wrench_B[:, :3]", 10, r"shape \(6, 3\), expected \(6, 6\)"),
        (WRENCH + "return [1, 2]", 10, "returned list, expected an array"),
        (WRENCH + "return theta[0] * wrench_B / 0", 10, "not finite|zero must mean"),
        (WRENCH + "return theta[1] * wrench_B", 11, "IndexError"),
        (WRENCH + "wrench_B *= 2; return 0 * wrench_B", 10, "changes its arguments"),
        (WRENCH + "return theta[0] * np.cumsum(wrench_B, axis=0)", 10, "one sample at a time"),
        (BODY + "return body.mass", 10, "returned float, expected Body"),
        (COMMAND + "return commands", 10, r"expected \(Commands, memory\)"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(written, text, line, message):
    path = written(text)
    with pytest.raises(ModelError, match=message) as caught:
        own_effects.use([path])
    said = str(caught.value)
    assert "\n" not in said
    assert said.startswith(f"{path}:{line}: ")
    assert "mine" not in effects.catalogue()


def test_an_effect_that_is_no_number_later_is_named(written, tmp_path):
    """What a division gives for one sample of many."""
    body = "return np.where(np.arange(len(wrench_B))[:, None] > 99, np.nan, theta[0] * wrench_B)"
    own_effects.use([written(WRENCH + body)])
    model = model_file.load("tilt_hexarotor")
    flights = wg.open_flights(wg.simulate(model, "multi_axis", duration=5, excitation=1), model)
    with pytest.raises(ModelError, match="effect mine: what it adds is not finite"):
        wg.add(model, ["mine"], flights)


def test_a_model_that_could_not_be_read_again_is_not_written(tmp_path):
    """The file that stands there stays."""
    model, saved = model_file.load("tilt_hexarotor"), tmp_path / "m.toml"
    model_file.save(model, saved)
    before = saved.read_bytes()
    unsure = replace(make_effect(model.vehicle, "mass", {"added": 0.1}), std=np.array([np.nan]))
    with pytest.raises(ModelError, match=r"m\.toml: not written, since it could not be read again: .*std"):
        model_file.save(model.with_effects([unsure]), saved, force=True)
    assert saved.read_bytes() == before


def test_a_log_with_the_name_of_an_option_is_not_run(tmp_path):
    log = tmp_path / "--effects=a.csv"  # what `explain *.csv` is given by the shell
    log.write_text("t,x=open('pwned','w'),1\n0.0,1.0,2.0\n")
    with pytest.raises(ModelError, match=r"no such file ending in \.py"):
        own_effects.use([log])


def test_missing_file_and_the_same_file_twice(written, tmp_path):
    with pytest.raises(ModelError, match="no such file"):
        own_effects.use([tmp_path / "gone.py"])
    path = written(WRENCH + "return theta[0] * wrench_B")
    with pytest.raises(ModelError, match="exists already"):
        own_effects.use([path, path])


def test_abstract_bases_and_helpers_are_no_effects(written):
    base = WRENCH.replace('class Mine(WrenchEffect):\n    name = "mine"', "class Base(WrenchEffect):")
    text = base.split("    def apply")[0] + (
        'class Mine(Base):\n    name = "mine"\n    def apply(self, actuation, wrench_B, theta, context):\n'
        "        return theta[0] * wrench_B\n"
    )
    own_effects.use([written(text)])
    assert "mine" in effects.catalogue()


def test_an_error_of_later_is_blamed_on_the_file(written):
    body = "if len(wrench_B) == 3:\n            raise KeyError('three')\n        return theta[0] * wrench_B"
    path = written(WRENCH + body)
    own_effects.use([path])
    with pytest.raises(KeyError) as caught:
        effects.find("mine").apply(None, np.zeros((3, 6)), np.zeros(1), None)
    assert own_effects.blame(caught.value).startswith(f"{path}:12: KeyError")
    assert own_effects.blame(ValueError("ours")) is None
