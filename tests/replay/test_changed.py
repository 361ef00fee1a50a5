"""`wrenchgap changed`: the command, its words, table, figure and the JSON of its schema."""

from dataclasses import replace
from functools import partial

import matplotlib.pyplot as plt
import numpy as np
import pytest

import wrenchgap as wg
from scripts.json_documents import schema
from wrenchgap.flight.check import Check, Finding
from wrenchgap.learn.changed import changed as searching
from wrenchgap.learn.changed import search
from wrenchgap.learn.changed.changed import Changed, Verdict
from wrenchgap.learn.changed.places import Place
from wrenchgap.learn.changed.sizes import Size, covariance
from wrenchgap.replay.present import changed as presented
from wrenchgap.replay.present import what_to_inspect
from wrenchgap.replay.present.documents import VERSIONS
from wrenchgap.replay.present.figures import report as drawn
from wrenchgap.replay.present.report.page import changed_page as page

MODEL = wg.load_model("tilt_hexarotor")
TRIED = ("com_offset", "mass", "rotor_thrust")


def compared(suspect, healthy):
    good, bad = wg.open_flights([healthy, suspect], MODEL)
    return wg.changed(bad, good, MODEL, names=TRIED, jobs=1)


@pytest.fixture
def unlimited(monkeypatch):
    """Without detection limits, which take most of the time."""
    monkeypatch.setattr(searching, "detection_limits", lambda *args, **how: ())


@pytest.fixture(scope="module")
def moved(logs):
    """The centre of mass moved by (-4, 7, -5) mm."""
    return compared(logs.train, logs.ideal)


@pytest.fixture(scope="module")
def same(logs):
    """Both flights have it."""
    return compared(logs.test, logs.train)


def test_a_centre_of_mass_that_moved_is_named_with_its_size(moved):
    assert moved.verdict is Verdict.CHANGED
    assert moved.firm == ("com_offset",)
    change = {p.name: p.change for p in moved.parameters}
    np.testing.assert_allclose([change[a] for a in "xyz"], [-0.004, 0.007, -0.005], atol=5e-4)
    assert "com_offset" in presented.summary(moved)


def test_what_both_flights_have_is_no_change(same):
    assert same.verdict is Verdict.NOTHING
    assert presented.summary(same).startswith("Nothing changed")
    assert what_to_inspect.sentences(same) == [what_to_inspect.NOTHING]


def test_what_is_likely_but_not_established_is_neither_nothing_nor_a_finding(same, moved):
    """89 % for a change is not nine tenths: no verdict, and no "nothing changed" either."""
    likely = replace(moved.classes[0].sets[0], weight=0.89)
    groups = (replace(moved.classes[0], sets=(likely,)),)
    torn = replace(moved, verdict=Verdict.NOTHING, firm=(), nothing=0.11, classes=groups)
    words = presented.summary(torn)
    assert words.startswith("Not established, but likely: com_offset")
    assert "nothing changed: 11 %" in words
    assert what_to_inspect.likeliest(same) is None


def test_where_means_differ_beyond_those_of_many_healthy_flights_there_is_something_to_look_at(same):
    """ "Nothing is established that asks for an inspection" stood beside a mean that differed by 33 times."""
    sides = [(role, k, 10.0 if role == "suspect" else 0.1 * k) for role in ("healthy", "suspect") for k in range(4)]
    rows = tuple(replace(same.rows[0], flight=f"{role} {k}", role=role, mean=m * same.scatter) for role, k, m in sides)
    assert same.verdict is Verdict.NOTHING
    assert what_to_inspect.sentences(replace(same, rows=rows)) == [what_to_inspect.MORE]


def test_the_place_of_a_change_that_is_not_established_is_told_above_two_standard_deviations(moved):
    """M1 was to be looked at where M3 had been cut by 1 mm: it was the largest change, of 1.4 and 1.7."""
    likely = (replace(moved.classes[0], sets=(replace(moved.classes[0].sets[0], weight=0.89),)),)
    size = Size("com_offset", "x", 0.0, 0.01, -0.03, 0.01, "m", "M<1>")
    for scatter, told in ((0.008, True), (0.018, False)):
        alone = (replace(moved.alone[0], effect="com_offset", sizes=(replace(size, scatter=scatter),)),)
        torn = replace(moved, verdict=Verdict.NOTHING, firm=(), nothing=0.11, classes=likely, alone=alone)
        assert ("a look at M<1> costs little" in what_to_inspect.sentences(torn)[0]) == told


def test_of_more_changes_at_once_than_are_likely_none_is_firm(logs, moved, monkeypatch, unlimited):
    """The same change, were one already more than can be believed at once."""
    monkeypatch.setattr(searching, "AT_ONCE", 0)
    monkeypatch.setattr(presented, "AT_ONCE", 0)
    again = compared(logs.train, logs.ideal)
    assert again.verdict is Verdict.CHANGED
    assert again.names == moved.names
    assert again.firm == ()
    words = presented.summary(again)
    assert words.startswith("Something changed, and no likely cause fits: it would take com_offset at once.")
    assert "No single effect is firm" in words
    assert "confidence" not in words


def test_what_is_still_far_from_where_it_was_linearised_is_not_firm(logs, moved, monkeypatch, unlimited):
    """Straight lines from another point are no proof, however well they fit."""
    monkeypatch.setattr(searching, "weigh", partial(search.weigh, rounds=1))
    monkeypatch.setattr(search, "FAR", 1e-6)
    again = compared(logs.train, logs.ideal)
    assert again.verdict is Verdict.CHANGED
    assert again.firm == ()
    monkeypatch.setattr(search, "FAR", 1e6)
    assert compared(logs.train, logs.ideal).firm == moved.firm


def test_of_one_healthy_flight_a_change_has_to_be_larger(logs, moved, monkeypatch, unlimited):
    """One flight and two typical ones are two degrees of freedom, of which one in twenty is beyond 2.92, not 1.64."""
    assert moved.clear == pytest.approx(2.920, abs=1e-3)
    three = (*moved.rows, *(replace(one, flight=f"{one.flight}{k}") for one in moved.rows for k in (2, 3)))
    assert replace(moved, rows=three).clear == pytest.approx(2.132, abs=1e-3)
    sizes = searching.sizes
    for deviations, firm in ((2.8, ()), (3.0, ("com_offset",))):

        def unsure(*args, deviations=deviations):
            return tuple(replace(one, std=0.0, scatter=abs(one.change) / deviations) for one in sizes(*args))

        monkeypatch.setattr(searching, "sizes", unsure)
        again = compared(logs.train, logs.ideal)
        assert again.firm == firm
        words = presented.summary(again)
        assert words.startswith("Changed: " if firm else "Perhaps changed: ")
        assert ("1 healthy flight does not say how much flights differ" in words) is not bool(firm)
        assert ("confidence" in words) is bool(firm)
        first, *rest = again.classes
        like = replace(first, sets=(first.sets[0], replace(first.sets[0], names=("payload",))))
        words = presented.summary(replace(again, classes=(like, *rest)))
        assert "Indistinguishable on these flights: payload" in words
        assert words.startswith("Changed: " if firm else "Perhaps changed: ")


def test_what_leaves_more_than_any_healthy_flight_is_said_to_be_no_effect(moved):
    """The nearest one is told, as what it is."""
    loud = replace(moved, verdict=Verdict.UNKNOWN, firm=(), louder=("force_z",))
    words = presented.summary(loud)
    assert "on force_z, and no effect of the catalogue says what" in words
    assert words.endswith("Nearest, and not established: com_offset.")
    nameless = replace(loud, names=("constant_wrench",), louder=())
    assert presented.summary(nameless) == "Something changed, and no effect of the catalogue says what."


def test_an_imu_that_came_more_slowly_is_said_where_more_is_left(moved):
    """A fifth of the samples on the suspect flight; where nothing more is left than on healthy ones, no matter."""

    def slower(one, factor):
        imu = one.flight.imu
        return replace(one, flight=replace(one.flight, imu=replace(imu, time=factor * imu.time)))

    flights = [slower(one, 5.0 if one.records[0].flight in moved.suspect else 1.0) for one in moved.flights]
    loud = replace(moved, verdict=Verdict.UNKNOWN, firm=(), louder=("torque_x",), flights=tuple(flights))
    words = presented.summary(loud)
    assert words.startswith("Not compared on torque_x, where the suspect flights leave far more: their IMU came at ")
    assert what_to_inspect.sentences(replace(loud, parameters=())) == [what_to_inspect.LOG_ALIKE]
    assert presented.what_next(loud, ["a"], "m")[0].text.startswith("next: fly again: ")
    assert what_to_inspect.unlike_rates(moved) == ""
    assert presented.summary(replace(moved, flights=tuple(flights))) == presented.summary(moved)


def test_a_change_without_any_parameter_offers_no_exchange(moved):
    """What changed has no number: neither a rotor nor anything else got stronger."""
    bare = replace(moved, verdict=Verdict.UNKNOWN, firm=(), louder=("torque_x",), parameters=())
    assert what_to_inspect.exchanged(bare) == ""
    assert presented.what_next(bare, ["a"], "m")[0].text.startswith("next: mend it")


@pytest.mark.parametrize(("change", "offered"), [(-0.13, False), (0.19, True)])
def test_no_exchange_is_offered_where_a_rotor_got_weaker(moved, change, offered):
    """Were the sides exchanged, it would lift more on the suspect flights; however near these are to the model."""
    near = {"healthy": 12.0, "suspect": 5.0}
    rows = tuple(replace(r, mean=np.array([0, 0, 0, 0, near[r.role], 0]) * moved.scatter) for r in moved.rows)
    rotor = replace(moved.parameters[0], effect="rotor_thrust", name="rotor_0", healthy=0.0, suspect=change)
    found = replace(moved, rows=rows, parameters=(rotor,))
    assert (what_to_inspect.exchanged(found) != "") == offered


@pytest.mark.parametrize(("healthy", "suspect", "asked"), [(12.0, 5.0, True), (5.0, 12.0, False), (6.0, 5.0, False)])
def test_healthy_flights_that_are_farther_from_the_model_may_be_the_suspect_ones(moved, healthy, suspect, asked):
    """Mean torques, in what flights differ by: twice as far, the right way round, and alike."""
    far = {"healthy": healthy, "suspect": suspect}
    rows = tuple(replace(r, mean=np.array([0, 0, 0, 0, far[r.role], 0]) * moved.scatter) for r in moved.rows)
    assert {r.role for r in rows} == {"healthy", "suspect"}
    found = replace(moved, rows=rows)
    assert (what_to_inspect.exchanged(found) != "") == asked
    (line,) = presented.what_next(found, ["a"], "m")
    assert line.text.startswith("next, if the sides were exchanged: ") == asked
    chance = tuple(replace(p, scatter=10.0 * abs(p.change)) for p in found.parameters)
    open_one = replace(found, firm=(), parameters=chance)
    assert ("are the two sides exchanged?" in presented.summary(open_one)) == asked
    if not asked:
        assert presented.what_next(found, ["a"], "m")[0].text.startswith("next: mend it")
        assert presented.what_next(open_one, ["a"], "m")[0].text.startswith("next: fly again: "), "nothing to mend yet"


def test_a_constant_change_without_a_name_says_its_axis_and_what_to_inspect(moved):
    """A yaw torque that was nil, at 8 standard deviations; beside it a force that is chance."""
    axes = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")
    empty = Size("constant_wrench", "", 0.0, 1e-3, 0.0, 1e-3, "N", "")
    sizes = tuple(replace(empty, name=axis, unit="N" if k < 3 else "Nm") for k, axis in enumerate(axes))
    yaw = replace(sizes[5], healthy=1e-6, suspect=-2.4e-4, scatter=2.8e-5, std=9.5e-6)
    found = replace(
        moved, verdict=Verdict.UNKNOWN, firm=(), louder=(), names=("constant_wrench",), parameters=(*sizes[:5], yaw)
    )
    assert presented.summary(found).startswith("Changed: torque_z by -0.24 mNm (8.2 standard deviations).")
    (words,) = what_to_inspect.sentences(found)
    assert "a yaw bias of -0.24 mNm: look for a twisted motor mount or arm" in words
    assert "force" not in words
    weight = found.model.vehicle.body.mass * 9.80665
    lift = replace(sizes[2], suspect=0.1 * weight)
    (words,) = what_to_inspect.sentences(replace(found, parameters=(lift, yaw)))
    assert "10 % more thrust than commanded: look at the battery" in words


def test_it_begins_with_what_changed_and_what_to_inspect_and_tabulates(moved):
    text = str(moved)
    assert "one healthy flight" in text
    first, second = text.splitlines()[:2]
    assert first.startswith("Changed: com_offset")
    assert second.startswith("Inspect the battery and what is mounted: the centre of mass has moved")
    frame = moved.to_frame()
    assert set(frame.effect) <= set(TRIED)
    assert frame[frame.named].effect.unique().tolist() == ["com_offset"]


def test_many_parameters_on_few_flights_are_rows_with_the_same_values(moved):
    (by_flight,), (turned,) = presented.by_flight(moved), presented.by_flight(moved, wide=1)
    heads, by_parameter = ([str(column.header) for column in one.columns] for one in (by_flight, turned))
    rows, of_parameter = ([[str(cell) for cell in row] for row in one.cells] for one in (by_flight, turned))
    assert heads[2:] == [f"com_offset {axis} [m]" for axis in "xyz"]
    assert by_parameter[3:] == [f"{flight} ({role})" for flight, role, *_ in rows]
    assert [r[:3] for r in of_parameter] == [["com_offset", axis, "m"] for axis in "xyz"]
    assert [r[3:] for r in of_parameter] == [[r[2 + k] for r in rows] for k in range(3)]


def test_the_side_that_is_inspected_is_where_it_moved(moved):
    """x -4 mm, y +7 mm: back left."""
    assert "back left (" in what_to_inspect.sentences(moved)[0]


def test_json_has_no_keys_but_those_of_its_schema(moved):
    assert VERSIONS["changed"] == 1
    body = moved.to_json()
    assert set(body) <= set(schema("changed")["properties"])
    words = {"effect", "name", "healthy", "scatter", "suspect", "std", "unit", "significance", "where"}
    assert all(set(p) == words for p in body["parameters"])
    assert body["odd"] == []
    for row in body["by_flight"]:
        assert set(row) == {"flight", "role", "mean", "rms", "values"}


def test_the_picture_marks_what_moved(moved, same):
    marks, arrow = drawn.vehicle_marks(moved)
    assert marks == {"com": "moved"}
    np.testing.assert_allclose(arrow, [-0.004, 0.007, -0.005], atol=5e-4)
    assert drawn.vehicle_marks(same) == ({}, None)
    axes = moved.plot()
    assert np.size(axes) == 3
    plt.close("all")


def rotor(found, *odds):
    """The answer as if single rotors of a vehicle with names had changed, with these probabilities."""
    names = tuple(f"M{k + 1}" for k in range(12))
    model = replace(found.model, vehicle=replace(found.model.vehicle, rotor_names=names))
    size = Size("rotor_thrust", "rotor_2", 0.0, 0.01, -0.12, 0.005, "1", "M3")
    places = tuple(Place("rotor_thrust", f"rotor_{k + 2}", names[k + 2], p) for k, p in enumerate(odds))
    return replace(found, model=model, names=("rotor_thrust",), parameters=(size,), places=places)


def test_a_rotor_is_called_by_its_name(moved):
    found = rotor(moved, 0.97, 0.02)
    assert what_to_inspect.sentences(found)[0].startswith("Inspect M3 (front left, upper rotor): its propeller")
    assert "rotor_thrust of M3 by -12.0 +- 1.1 %" in presented.summary(found)
    assert list(drawn.vehicle_marks(found)[0]) == ["rotor_2"]


def test_where_it_is_open_which_rotor_all_likely_ones_are_named(moved):
    (said, *_) = what_to_inspect.sentences(rotor(moved, 0.6, 0.38, 0.02))
    assert said.startswith("Inspect M3 (front left, upper rotor, 60 %) or M4 (front left, lower rotor, 38 %): ")


def test_significance_is_over_scatter_and_deviation_together():
    size = Size("mass", "added", 0.1, 0.03, 0.2, 0.04, "kg", "")
    assert size.change == pytest.approx(0.1)
    assert size.significance == pytest.approx(0.1 / 0.05)


def test_the_command_writes_what_the_function_finds(logs, result_of, tmp_path):
    result = result_of(
        *("changed", logs.train, "--healthy", logs.ideal, "-m", "tilt_hexarotor"),
        *("--effects-only", "com_offset,mass", "--figure", "c.png"),
    )
    assert result["schema"] == "wrenchgap.changed/1"
    assert [i["role"] for i in result["inputs"]] == ["healthy", "suspect", "model"]
    assert result["verdict"] == "changed"
    assert result["firm"] == ["com_offset"]
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(("healthy", "between"), [("train", "2:4"), ("test", "7:9")])
def test_two_seconds_tell_where_the_centre_of_mass_went(healthy, between, logs, result_of):
    """Means over blocks that short were taken to be exact: a drag was named, or nothing, some scatter was nan."""
    result = result_of(
        *("changed", logs.ideal, "--healthy", logs.folder / f"{healthy}.mcap", "--between", between),
        *("-m", "tilt_hexarotor", "--effects-only", "com_offset,rotational_drag,accelerometer_bias,thrust_scale"),
    )
    assert result["firm"] == ["com_offset"]
    values = [p for one in result["alone"] for p in one["parameters"]]
    change = {p["name"]: p["suspect"] - p["healthy"] for p in values if p["effect"] == "com_offset"}
    assert [change[a] for a in "xyz"] == pytest.approx([0.004, -0.007, 0.005], abs=0.0015)
    assert all(p["scatter"] is not None and p["significance"] is not None for p in values)


def test_no_data_make_a_parameter_less_certain_than_its_prior():
    scale = np.array([0.1, 2.0])
    sure = np.array([[300.0, 20.0], [20.0, 5.0]])
    np.testing.assert_allclose(covariance(sure, scale), np.linalg.inv(sure + np.diag(scale**-2.0)))
    lost = covariance(np.array([[-1e9, 3.0], [4.0, 0.0]]), scale)
    assert np.all(np.diag(lost) <= scale**2 * (1.0 + 1e-12))
    assert np.all(np.linalg.eigvalsh(lost) > 0.0)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("LOG --healthy LOG", "same flight"),
        ("LOG --healthy gone.mcap", "gone.mcap"),
        ("LOG", "--healthy"),
        ("LOG --healthy OTHER --effects-only witchcraft", "witchcraft"),
    ],
)
def test_bad_input_is_one_line(logs, refused, words, says):
    names = {"LOG": logs.train, "OTHER": logs.ideal}
    arguments = [names.get(w, w) for w in words.split()]
    assert says in refused("changed", *arguments, "-m", "tilt_hexarotor")


def test_the_result_is_public():
    assert wg.changed.__doc__
    assert issubclass(Changed, object)


def test_the_page_says_what_changed_where_to_look_and_how_to_repeat_it(moved):
    text = page(moved, "wrenchgap changed <x>")
    assert presented.summary(moved).split(",")[0] in text
    assert what_to_inspect.sentences(moved)[0] in text
    assert "wrenchgap changed &lt;x&gt;" in text
    assert "<svg" in text or "image/svg" in text
    assert all(f.flight.content_hash in text for f in moved.flights)
    for heading in ("Changes.", "Each change by itself.", "Mean residual of the given model by flight, signed."):
        assert heading in text


def test_a_page_of_nothing_has_no_table_of_changes(same):
    text = page(same)
    assert "Nothing changed" in text
    assert "Changes." not in text


def test_the_page_begins_with_what_the_checks_warn_of(moved):
    """As docs/checks.md says of every output: before any number."""
    said = Finding("bad", Check("gaps", "warn", "imu: 3 gap(s)."))
    first, *others = moved.flights
    warned = replace(first, notes=(*first.notes, said))
    text = page(replace(moved, flights=(warned, *others)))
    assert text.index("check: gaps: bad: imu: 3 gap(s).") < text.index("<figure")
    assert "check: gaps" not in page(moved)


def test_footnotes_are_separated():
    assert "   " not in presented.SIZES_LEGEND + presented.ALONE_LEGEND


@pytest.mark.parametrize(("weight", "begins"), [(0.95, "Changed: "), (0.6, "Perhaps changed: ")])
def test_of_a_class_that_is_not_certain_nothing_is_said_to_have_changed(moved, weight, begins):
    """Two sets that these flights cannot tell apart, with most of the weight or with half of it."""
    one = moved.classes[0].sets[0]
    alike = tuple(replace(one, names=names, weight=0.5 * weight) for names in (("com_offset",), ("mass", "com_offset")))
    found = replace(moved, firm=(), classes=(replace(moved.classes[0], sets=alike, weight=weight),))
    assert presented.summary(found).startswith(begins)


def test_a_part_is_told_with_its_place_unless_its_name_says_it():
    """Forward is x, left is y: the second arm of six is 60 deg to the left of the front."""
    vehicle = MODEL.vehicle
    assert what_to_inspect.located(vehicle, "rotor_2") == "M3 (front left, upper rotor)"
    assert what_to_inspect.located(vehicle, "arm_3") == "arm_3 (back)"
    assert what_to_inspect.located(vehicle, "x") == "x"
    named = replace(vehicle, arm_names=tuple(f"arm {k} at the back" for k in range(6)))
    assert what_to_inspect.located(named, "arm_3") == "arm 3 at the back"
