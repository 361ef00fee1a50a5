"""Effects in a session of the viewer: the error falls where it should, and every change can be undone."""

import numpy as np
import pytest

from wrenchgap.flight.errors import FitError, ModelError, UsageError
from wrenchgap.learn.data.opening import open_flight, open_flights
from wrenchgap.learn.diagnose.timing import dataset_of
from wrenchgap.learn.identify.fit import fit, with_fit
from wrenchgap.learn.identify.staircase import Basis
from wrenchgap.plant import model_file
from wrenchgap.replay.present.answer import summary
from wrenchgap.replay.present.design import sentence
from wrenchgap.replay.present.staircase import label
from wrenchgap.replay.session.log_session import LogSession
from wrenchgap.replay.session.saving import SaveFolder

MODEL = model_file.load("tilt_hexarotor")
TRUTH = (-0.004, 0.007, -0.005)


@pytest.fixture
def session(logs, tmp_path):
    return LogSession(open_flights([logs.train, logs.test], MODEL), MODEL, folder=SaveFolder(tmp_path))


def rms(staircase):
    return np.array([s.rms for s in staircase.stairs])


def same(one, other):
    return all(np.array_equal(rms(a), rms(b)) for a, b in zip(one, other, strict=True))


def test_adding_the_hidden_effect_lowers_the_held_out_error_to_the_noise(session, logs):
    """And the numbers are those of the library."""
    session.effects.add(("com_offset",), "train")
    staircases = session.effects.staircases("train")
    fitted, held_out = staircases
    assert [label(s) for s in held_out.stairs] == ["nominal", "+ com_offset"]
    assert (held_out.basis, fitted.basis) == (Basis.UNSEEN, Basis.FITTED)
    assert held_out.stairs[0].in_all > 5.0 * held_out.noise.in_all
    assert held_out.stairs[1].in_all < 1.2 * held_out.noise.in_all
    (installed,) = session.effects.installed
    assert np.all(np.abs(installed.theta - TRUTH) < 3.0 * installed.std + 1e-4)
    assert [file for file, _ in installed.provenance.logs] == ["train.mcap"]
    train, test = (dataset_of([open_flight(p, MODEL)], MODEL) for p in (logs.train, logs.test))
    fitted = with_fit(MODEL, fit(train, MODEL, ["com_offset"]))
    for data, stairs in zip((train, test), staircases, strict=True):
        for k, model in enumerate((MODEL, fitted)):
            left = data.measured - data.predict(model.wrench_model)
            assert stairs.stairs[k].rms == pytest.approx(np.sqrt(np.mean(left**2, axis=0)))
        assert stairs.stairs[1].in_all == pytest.approx(np.linalg.norm(data.weights * stairs.stairs[1].rms))
        assert stairs.noise.rms == pytest.approx(data.noise)


def test_undo_restores_the_very_same_numbers_and_redo_too(session):
    before = session.effects.staircases("train")
    scene = session.scene("train")
    session.effects.add(("com_offset",), "train")
    stairs = session.effects.staircases("train")
    assert (session.working.undoable, session.working.redoable) == ("add com_offset", "")
    assert not np.array_equal(session.scene("train").wrenches["predicted"], scene.wrenches["commanded"])
    session.effects.undo()
    assert session.working.redoable == "add com_offset"
    assert session.effects.installed == ()
    assert same(before, session.effects.staircases("train"))
    back = session.scene("train")
    assert set(back.wrenches) == set(scene.wrenches)
    assert all(np.array_equal(back.wrenches[n], w, equal_nan=True) for n, w in scene.wrenches.items())
    session.effects.redo()
    assert same(stairs, session.effects.staircases("train"))


def test_a_slider_moves_the_error_and_counts_as_one_change(session):
    session.effects.add(("com_offset",), "train")

    def error():
        return session.effects.staircases("train")[1].stairs[-1].in_all

    errors = [error()]
    for y in (0.006, 0.004, 0.002, 0.0):  # away from the 7 mm that are there
        session.effects.set_value("com_offset", "y", y)
        errors.append(error())
    assert np.all(np.diff(errors) > 0.0)
    (installed,) = session.effects.installed
    assert installed.theta[1] == 0.0
    assert installed.std is None
    assert "by hand" in installed.provenance.method
    session.effects.undo()
    assert error() == errors[0]


def test_two_effects_make_two_stairs_and_removing_takes_one_away(session):
    session.effects.add(("com_offset",), "train")
    one = session.effects.staircases("train")[1]
    session.effects.add(("inertia",), "train")
    two = session.effects.staircases("train")[1]
    assert [label(s) for s in two.stairs] == ["nominal", "+ com_offset", "+ inertia"]
    assert np.array_equal(rms(two)[:2], rms(one))
    session.effects.remove("com_offset")
    left = session.effects.staircases("train")
    assert [i.name for i in session.effects.installed] == ["inertia"]
    assert left[1].stairs[-1].in_all > 3.0 * two.stairs[-1].in_all
    session.effects.refit("train")
    assert session.working.undoable == "fit on train"


def test_one_flight_is_judged_on_time_that_was_not_fitted(logs):
    session = LogSession(open_flights([logs.train], MODEL), MODEL)
    session.effects.add(("com_offset",), "train")
    here, blocks = session.effects.staircases("train")
    assert blocks.basis is Basis.HELD_OUT
    assert blocks.stairs[-1].in_all < 1.3 * blocks.noise.in_all
    assert here.stairs[-1].in_all <= 1.2 * blocks.stairs[-1].in_all
    session.effects.set_value("com_offset", "y", 0.0)  # nothing was fitted that a block could be left out of
    assert len(session.effects.staircases("train")) == 1


def test_search_beside_the_page_names_the_hidden_effect_and_says_how_far_it_is(logs):
    session, told = LogSession(open_flights([logs.train], MODEL, between=(1.0, 7.0)), MODEL), []
    ranking = session.effects.explain("train", lambda share, words: told.append(words))
    assert ranking.verdict == "effect"
    assert ranking.effects[0] == "com_offset"
    assert ranking.confidence(ranking.members[0]) > 0.9
    assert ranking.ranking[0].name == "com_offset"
    assert "com_offset" in summary(ranking)
    assert any("trying com_offset" in words for words in told)
    assert session.effects.installed == ()  # a search changes nothing


def test_cancelling_a_search_ends_it_at_once(session):
    def report(share, words):
        if "trying" in words:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        session.effects.explain("train", report)


def test_saved_model_says_what_was_done_and_is_never_overwritten_unasked(session, tmp_path):
    path = tmp_path / "fitted.toml"
    assert session.effects.add(("com_offset",), "train").startswith("added com_offset: on held-out time better: error")
    session.effects.add(("inertia",), "train")
    session.effects.remove("inertia")
    assert not session.working.saved
    assert "version 4" in session.effects.save(path.name)
    assert session.working.saved
    read = model_file.load(path)
    commands = [v.command.split("wrenchgap view: ")[1] for v in read.history[1:]]
    assert commands == ["add com_offset", "add inertia", "remove inertia"]
    assert read.history[1].trial is not None
    assert [e.name for e in read.effects] == ["com_offset"]
    assert not model_file.changed_since(read)
    text = path.read_text()
    session.effects.undo()
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(UsageError, match="exists already and was not written by this page"):
        session.effects.save("mine.toml")
    assert (tmp_path / "mine.toml").read_text() == text
    assert model_file.loads(session.effects.model_text(path.name)).history[-1].number == 3
    session.effects.save(path.name)  # its own
    assert [e.name for e in model_file.load(path).effects] == ["com_offset", "inertia"]


@pytest.mark.parametrize("name", ["", "model.txt", ".toml", "../model.toml", "/tmp/model.toml", "nowhere/model.toml"])
def test_a_page_writes_into_its_own_folder_only(session, tmp_path, name):
    for attempt in (session.effects.save, session.effects.model_text):
        with pytest.raises(UsageError, match=r"expected a file name that ends in \.toml"):
            attempt(name)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_is_refused_in_one_line(session):
    edit = session.effects
    for error, words, attempt in (
        (ModelError, "catalogue", lambda: edit.add(("gremlins",), "train")),
        (FitError, "voltage", lambda: edit.add(("battery_sag",), "train")),
        (ModelError, "has no effect", lambda: edit.remove("com_offset")),
        (UsageError, "nothing to undo", edit.undo),
        (UsageError, "nothing to redo", edit.redo),
        (UsageError, "add one first", lambda: edit.refit("train")),
    ):
        with pytest.raises(error, match=words):
            attempt()
    edit.add(("com_offset",), "train")
    for axis, value, words in (("x", 2.0, "plausible"), ("x", np.nan, "plausible"), ("w", 0.0, "no parameter")):
        with pytest.raises(ModelError, match=words):
            edit.set_value("com_offset", axis, value)
    assert session.working.undoable == "add com_offset"  # none of this changed anything


@pytest.mark.slow
def test_next_flight_is_drawn_within_the_room_and_says_what_it_separates(session):
    names = ("com_offset", "constant_wrench")
    found = session.effects.next_flight(names, "train", lambda *_: None, seconds=8.0)  # a short one is found sooner
    assert found.separable
    assert all(effect.name in sentence(found) for effect in found.effects)
    position_E = found.trajectory.at(np.linspace(0.0, found.trajectory.duration, 600)).position_E
    assert np.all(np.abs(position_E[:, :2]) < 4.0)
    assert np.ptp(position_E, axis=0).max() < 5.0
    assert "[[moves]]" in session.effects.trajectory_text(found)
