"""A trend in words, as JSON, as a table, as a picture and as a page; and what the command refuses."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt

import wrenchgap as wg
from wrenchgap.learn.identify.steps_and_drift import course
from wrenchgap.plant.model import make_effect
from wrenchgap.replay.present.documents import VERSIONS
from wrenchgap.replay.present.report.page import trend_page as page
from wrenchgap.replay.present.report.page import vehicle_marks
from wrenchgap.replay.present.trend import brief, notes, sentence, summary, to_json

HEXA = "tilt_hexarotor"
SPIKY = "<b>M$3</b>"


@pytest.fixture(scope="module")
def season(tmp_path_factory):
    """Five flights of 4 s; from the fourth on the centre of mass is 3 mm to the left."""
    folder = tmp_path_factory.mktemp("season")
    model, rng = wg.load_model(HEXA), np.random.default_rng(0)
    for k in range(5):
        y = 0.003 * (k >= 3) + 1e-4 * rng.normal()
        flight = wg.simulate(
            model, "multi_axis", duration=4, excitation=1, seed=k, hide=[f"com_offset=x:0.001,y:{y:.6f}"]
        )
        wg.save_log(flight, folder / f"flight{k}.mcap")
    return sorted(folder.glob("*.mcap"))


@pytest.fixture(scope="module")
def found(season):
    """With names for two rotors that no writer of a page expects."""
    model = wg.load_model(HEXA)
    model = replace(model, vehicle=replace(model.vehicle, rotor_names=("M1", "M2", SPIKY, *[""] * 9)))
    return wg.trend(wg.open_flights(season, model), model)


@pytest.fixture(scope="module")
def weak(found):
    """The same flights as if the third rotor had lost 5 % at the fourth."""
    base = found.parameters[0]
    values = np.array([0.0, 1e-4, -1e-4, -0.05, -0.0501])
    own = np.full(5, 1e-4)
    rotor = replace(base, effect="rotor_thrust", name="rotor_2", values=values, std=own, errors=own)
    return replace(found, parameters=(replace(rotor, course=course(values, own)),))


def test_a_step_is_told_with_flight_size_interval_and_t(found):
    (told, look) = summary(found)
    assert told.startswith(("com_offset y steps: +3.0 mm", "com_offset y steps: +2.9 mm"))
    assert "from flight 4 (flight3) on, 95 % interval" in told
    assert look == "Look at: centre of mass."
    assert "com_offset y [m]" in str(found)


def test_a_rotor_is_called_as_the_user_calls_it(weak):
    assert sentence(weak.parameters[0], weak).startswith(f"rotor_thrust {SPIKY} steps: -5.0 %")
    assert summary(weak)[-1] == f"Look at: {SPIKY}."
    (told,) = to_json(weak)["parameters"]
    assert (told["name"], told["where"]) == ("rotor_2", SPIKY)
    marks, moved = vehicle_marks(weak)
    assert marks == {"rotor_2": "rotor_thrust -0.050"}
    assert moved is None


def test_json_is_what_the_page_promises(found, season):
    body = json.loads(json.dumps(found.to_json()))
    assert VERSIONS["trend"] == 2
    assert body["verdict"] == "changed"
    assert body["flights"] == [path.stem for path in season]
    moved = next(p for p in body["parameters"] if (p["effect"], p["name"]) == ("com_offset", "y"))
    (step,) = moved["steps"]
    assert (step["flight"], step["index"]) == ("flight3", 3)
    assert step["low"] < step["size"] < step["high"]
    assert len(moved["values"]) == len(moved["std"]) == len(moved["errors"]) == len(moved["level"]) == 5
    assert np.shape(body["rms"]) == (5, 6)
    assert body["inspect"] == ["centre of mass"]


def test_few_flights_say_so(season):
    model = wg.load_model(HEXA)
    few = wg.trend(wg.open_flights(season[2:4], model), model, ["com_offset"])
    assert summary(few) == ["2 flights: nothing can be said about steps and drifts; 4 or more are needed."]
    assert to_json(few)["verdict"] == "few"


def test_the_table_has_every_value(found):
    frame = found.to_frame()
    assert len(frame) == 5 * len(found.parameters)
    y = frame[(frame["effect"] == "com_offset") & (frame["parameter"] == "y")]
    assert y["segment"].tolist() == [0, 0, 0, 1, 1]
    np.testing.assert_allclose(y["value"], found.changed[0].values)


def test_the_picture_shows_every_value_and_the_step(found):
    axes = np.ravel(found.plot())
    shown = [p for p in found.parameters if str(p.course.verdict) != "open"]
    assert len(axes) == len(shown)
    at = [(p.effect, p.name) for p in shown].index(("com_offset", "y"))
    dots = next(line for line in axes[at].lines if line.get_marker() == "o")
    np.testing.assert_allclose(dots.get_ydata(), shown[at].values)
    dashed = [line for line in axes[at].lines if line.get_linestyle() == "--"]
    assert [line.get_xdata()[0] for line in dashed] == [3.5]  # between the third flight and the fourth
    assert any(text.get_text().startswith("+3") and text.get_text().endswith(" mm") for text in axes[at].texts)
    plt.close("all")


def test_the_page_escapes_names_and_shows_the_vehicle(weak):
    text = page(weak, "wrenchgap trend <x>")
    assert "&lt;b&gt;M$3&lt;/b&gt;" in text
    assert SPIKY not in text
    assert "The vehicle from above" in text
    assert "wrenchgap trend &lt;x&gt;" in text
    assert all(f.flight.content_hash in text for f in weak.flights)


def test_what_was_not_fitted_is_said(season):
    """The model has an effect that needs a voltage, and one that does not."""
    model = wg.load_model(HEXA)
    effects = [
        make_effect(model.vehicle, "battery_sag", [2.0, 0.08]),
        make_effect(model.vehicle, "com_offset", [0.0] * 3),
    ]
    opened = wg.open_flights(season[:2], model)
    found = wg.trend(opened, model.with_effects(effects))
    assert found.effects == ("com_offset",)
    stays = wg.trend(opened, model.with_effects(effects), ["com_offset"])
    np.testing.assert_allclose(stays.parameters[0].values, found.parameters[0].values)
    assert any("battery_sag is not fitted: flight0: needs the battery voltage" in text for text in notes(found))


def test_the_command_writes_everything(season, run, tmp_path):
    files = {"--figure": "a.png", "--table": "a.parquet", "--page": "a.html", "--json": "a.json"}
    done = run("trend", *season, "-m", HEXA, "--fit", "com_offset", *(w for pair in files.items() for w in pair))
    assert done.exit_code == 0, done.output
    assert "com_offset y steps" in " ".join(done.stdout.split())
    body = json.loads((tmp_path / "a.json").read_text())
    assert body["schema"] == "wrenchgap.trend/2"
    assert body["effects"] == ["com_offset"]
    table = pd.read_parquet(tmp_path / "a.parquet")
    assert table["value"].tolist() == [v for p in body["parameters"] for v in p["values"]]
    assert "--fit com_offset" in (tmp_path / "a.html").read_text()
    assert (tmp_path / "a.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["--fit", "gremlins"], "'gremlins' is not in the catalogue"),
        (["--fit", "battery_sag"], "flight0: effect battery_sag: needs the battery voltage"),
        (["--table", "x.csv"], "--table x.csv: the table is a Parquet file; expected a name that ends in .parquet"),
        (["--page", "x.pdf"], "--page x.pdf: the page is a web page; expected a name that ends in .html"),
        (["--figure", "gone/x.png"], "the folder gone does not exist"),
        (["--between", "9:1"], "T0 before T1"),
    ],
)
def test_bad_input_gets_one_line(more, says, season, refused, tmp_path):
    assert says in refused("trend", *season[:2], "-m", HEXA, *more)
    assert list(tmp_path.iterdir()) == []


def test_one_flight_and_one_flight_twice_are_refused(season, refused):
    assert "got 1 flight, expected two or more" in refused("trend", season[0], "-m", HEXA)
    assert "is the same flight" in refused("trend", season[0], season[0], "-m", HEXA)


def test_flights_at_the_same_time_are_asked_about(found):
    """One flight that two loggers recorded counts twice: by the calendars of their clocks, where they have any."""

    def span(start):
        return int(1e9 * start), int(1e9 * start + 20e9)

    def with_starts(*starts):
        flights = [
            replace(one, flight=replace(one.flight, start_ns=int(1e9 * start)), span=span(start))
            for one, start in zip(found.flights, starts, strict=True)
        ]
        return "\n".join(str(part) for part in brief(replace(found, flights=tuple(flights))))

    days = [1.7e9 + 1e5 * k for k in range(len(found.flights))]
    assert "at the same time" not in with_starts(*days)
    assert "at the same time" not in with_starts(*(3.0 * k for k in range(len(days))))
    assert "at the same time" not in with_starts(*[days[0]] * len(days))  # a simulator's
    days[1] = days[0] + 15.0
    first, second = found.names[:2]
    assert f"By their clocks {first} and {second} were flown at the same time" in with_starts(*days)
