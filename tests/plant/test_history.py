"""Versions of a model file: kept in the file, chained by content, honest about changes by hand."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchgap.flight.errors import ModelError
from wrenchgap.plant import history, model_file
from wrenchgap.plant.effects.effect import Source
from wrenchgap.plant.history import Change, Outcome, Trial, Value
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.wrench_model import Provenance

TRIAL = Trial(np.full(6, 0.4), np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.04]), np.full(6, 0.01), -0.65, 12.3)


GIVEN = model_file.load("tilt_hexarotor")


def step(parent, names, path, trial=None):
    """The parent with exactly these effects as the next version, written and read again."""
    values = {"com_offset": [0.004, 0.0, 0.0], "servo_lag": [0.05], "mass": [0.1]}
    new = parent.with_effects([make_effect(parent.vehicle, n, values[n]) for n in names])
    made = model_file.next_version(parent, new, command=f"with {names}", path=path, flights=[("a", "1")], trial=trial)
    model_file.save(made, path, force=True)
    return model_file.load(path)


def test_a_file_without_history_has_none():
    assert GIVEN.history == ()
    assert not model_file.changed_since(GIVEN)
    assert "[[history]]" not in model_file.dumps(GIVEN)


def test_chain_survives_in_the_file(tmp_path):
    first = step(GIVEN, ["com_offset"], tmp_path / "a.toml", TRIAL)
    second = step(first, ["com_offset", "servo_lag"], tmp_path / "b.toml")
    (tmp_path / "a.toml").unlink()
    third = step(second, ["servo_lag"], tmp_path / "c.toml")
    versions = third.history
    assert [v.number for v in versions] == [1, 2, 3, 4]
    assert [v.names for v in versions] == [(), ("com_offset",), ("com_offset", "servo_lag"), ("servo_lag",)]
    assert [v.parent for v in versions] == ["", *(v.content for v in versions[:-1])]
    assert versions[0].content == model_file.content_hash(GIVEN)
    assert versions[0].command == history.GIVEN
    assert versions[1].flights == (("a", "1"),)
    np.testing.assert_allclose(versions[1].trial.after, TRIAL.after)
    np.testing.assert_allclose(versions[1].trial.rms_reduction, [0.75, 0.5, 0.25, 0.0, -0.25, 0.9])
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", versions[3].date)
    last = history.changes(versions[2], versions[3])
    assert [e.effect for e in last.removed] == ["com_offset"]
    assert last.added == ()


def test_history_is_no_part_of_the_content(tmp_path):
    """A GP knows its model by content: the same vehicle and effects are the same model, however they came about."""
    back = step(step(GIVEN, ["com_offset"], tmp_path / "a.toml"), [], tmp_path / "b.toml")
    assert len(back.history) == 3
    assert model_file.content_hash(back) == model_file.content_hash(GIVEN)


def test_a_change_by_hand_is_noticed_and_becomes_a_version(tmp_path):
    path = tmp_path / "a.toml"
    model = step(GIVEN, ["com_offset"], path)
    assert not model_file.changed_since(model)
    path.write_text(re.sub(r"value = 0\.004\b", "value = 0.005", path.read_text(), count=1))
    edited = model_file.load(path)
    assert model_file.changed_since(edited)
    after = step(edited, ["com_offset"], tmp_path / "b.toml")
    assert [v.command for v in after.history][2] == history.BY_HAND
    (moved,) = history.changes(*after.history[1:3]).moved
    assert (moved.effect, moved.before.value, moved.after.value) == ("com_offset", 0.004, 0.005)
    assert not model_file.changed_since(after)


@pytest.mark.parametrize(("before", "after", "sigmas"), [(0.3, 0.4, pytest.approx(2.0)), (None, None, None)])
def test_sigmas_are_those_of_the_difference(before, after, sigmas):
    assert Change("e", Value("x", 1.0, before, "m"), Value("x", 2.0, after, "m")).sigmas == sigmas


def test_order_in_which_effects_came(tmp_path):
    first = step(GIVEN, ["servo_lag"], tmp_path / "a.toml")
    second = step(first, ["com_offset", "servo_lag"], tmp_path / "b.toml")
    assert history.order_of_addition(second.history, ["com_offset", "mass", "servo_lag"]) == (
        "mass",
        "servo_lag",
        "com_offset",
    )


def test_odd_names_and_the_source_of_an_own_effect_survive():
    source = Provenance(source=Source("mine.py", "0" * 64))
    effect = replace(make_effect(GIVEN.vehicle, "mass", [0.1]), provenance=source)
    made = GIVEN.with_effects([effect])
    made = model_file.next_version(GIVEN, made, command='say "a\\b"', path=Path('q"uote.toml'))
    again = model_file.loads(model_file.dumps(made))
    assert again.history[-1].command == 'say "a\\b"'
    assert again.history[-1].file == 'q"uote.toml'
    assert again.effects[0].provenance.source == source.source


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("version = 2", "version = 'two'", "history"),
        ("before = [", "before = [1.0, ", "held_out.before"),
        ("content = ", "contents = ", "contents: is not a known key; did you mean 'content'"),
    ],
)
def test_a_damaged_history_is_named(tmp_path, old, new, message):
    step(GIVEN, ["com_offset"], tmp_path / "a.toml", TRIAL)
    head, mark, tail = (tmp_path / "a.toml").read_text().partition("version = 2")
    with pytest.raises(ModelError, match=message):
        model_file.loads(head + (mark + tail).replace(old, new, 1))


@pytest.mark.parametrize(
    ("sentence", "change", "t", "outcome"),
    [
        ("better: error energy -65 %, t 12.3", -0.65, 12.3, Outcome.BETTER),
        ("worse: error energy +8 %, t -4.0", 0.08, -4.0, Outcome.WORSE),
        ("no clear change: error energy -0 %, t 0.7", 0.0, 0.7, Outcome.UNCLEAR),
    ],
)
def test_the_sentence_of_earlier_files_is_read_as_numbers(tmp_path, sentence, change, t, outcome):
    step(GIVEN, ["com_offset"], tmp_path / "a.toml", TRIAL)
    text = (tmp_path / "a.toml").read_text()
    assert "change = -0.65\nt = 12.3\n" in text
    trial = model_file.loads(text.replace("change = -0.65\nt = 12.3", f'verdict = "{sentence}"')).history[-1].trial
    assert (trial.change, trial.t, trial.outcome) == (change, t, outcome)
    with pytest.raises(ModelError, match=r"held_out: verdict: got 'much better'"):
        model_file.loads(text.replace("change = -0.65\nt = 12.3", 'verdict = "much better"'))
