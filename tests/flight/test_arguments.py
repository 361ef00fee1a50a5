"""Arguments of another type than a public function takes are one clear line, which names function and argument."""

import inspect
import pickle
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.compensate import Settings
from wrenchgap.flight.arguments import check_arguments
from wrenchgap.flight.errors import UsageError
from wrenchgap.learn import SearchSettings
from wrenchgap.learn.design.manoeuvres import Limits
from wrenchgap.learn.process.gp import FitSettings

FUNCTIONS = [one for name in sorted(wg.__all__) if inspect.isfunction(one := getattr(wg, name))]


@check_arguments
def fly(
    path: str | Path,
    *others: str,
    hz: float = 8.0,
    count: int = 1,
    names: Sequence[str] = (),
    values: Mapping[str, float] | None = None,
    between: tuple[float, float] | None = None,
    kind: Literal["a", "b"] = "a",
    force: bool = False,
    told: Callable[[float], None] | None = None,
    **more: Any,
) -> str:
    """Says that it has flown."""
    return "flown"


def test_what_fits_passes():
    assert fly(Path("a"), "b", hz=np.float32(3), count=np.int64(2), names=["x"], values={"x": 1}) == "flown"
    assert (
        fly("a", hz=5, between=[1, 2], kind="b", force=np.bool_(True), told=print, names=(n for n in "ab")) == "flown"
    )
    assert fly("a", between=np.array([1.0, 2.0]), weather=3) == "flown"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"hz": "8"}, "fly: hz: got str '8'; expected float"),
        ({"hz": True}, "fly: hz: got bool True; expected float"),
        ({"count": 1.5}, "fly: count: got float 1.5; expected int"),
        ({"names": "mass"}, r"fly: names: got str 'mass'; expected Sequence\[str\]"),
        ({"names": ["mass", 3]}, r"fly: names: got list \['mass', 3\]"),
        ({"values": {"x": "1"}}, r"fly: values: got dict {'x': '1'}; expected Mapping\[str, float\] \| None"),
        ({"between": 3.0}, "fly: between: got float 3.0"),
        ({"between": (1.0, 2.0, 3.0)}, r"fly: between: got tuple \(1.0, 2.0, 3.0\); expected tuple\[float, float\]"),
        ({"between": [1.0]}, "fly: between: got list"),
        ({"between": (1.0, "2")}, "fly: between: got tuple"),
        ({"count": -1}, "fly: count: got -1; expected a whole number that is not negative"),
        ({"kind": "c"}, "fly: kind: got str 'c'; expected Literal"),
        ({"told": 3}, "fly: told: got int 3"),
    ],
)
def test_what_does_not_fit_is_named(given, said):
    with pytest.raises(UsageError, match=said):
        fly("a", **given)


def test_the_first_argument_and_repeated_ones_are_looked_at_too():
    with pytest.raises(UsageError, match=r"fly: path: got NoneType None; expected str \| Path"):
        fly(None)
    with pytest.raises(UsageError, match="fly: others: got int 3; expected str"):
        fly("a", "b", 3)


def test_a_missing_argument_stays_what_python_says_of_it():
    with pytest.raises(TypeError, match=r"fly\(\) missing 1 required positional argument: 'path'"):
        fly()


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda one: one.__name__)
def test_every_public_function_looks_at_its_first_argument(function):
    _, *others = [p for p in inspect.signature(function).parameters.values() if p.default is p.empty]
    given = [None for p in others if p.kind is p.POSITIONAL_OR_KEYWORD]
    with pytest.raises(UsageError, match=rf"^{function.__name__}: \w+: got ellipsis Ellipsis; expected"):
        function(..., *given)
    assert pickle.loads(pickle.dumps(function)) is function


@pytest.mark.parametrize(
    ("settings", "name"),
    [(Settings, "dt"), (FitSettings, "points"), (SearchSettings, "block"), (Limits, "tilt"), (wg.Given, "mass")],
)
def test_settings_look_at_their_fields(settings, name):
    with pytest.raises(UsageError, match=f"{settings.__name__}: {name}: got str '1'; expected"):
        settings(**{name: "1"})


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("firm", float("nan"), "firm: got nan; expected more than 0 and at most 1"),
        ("otherwise", 1.5, "otherwise: got 1.5"),
        ("block", 0.0, "block: got 0; expected more than 0 and at most 1e"),
        ("structure", float("inf"), "structure: got inf"),
        ("beam", 0, "beam: got 0"),
    ],
)
def test_a_search_decides_by_positive_numbers(name, value, said):
    """With others, an answer was given all the same, or the error of a formula."""
    with pytest.raises(UsageError, match=f"SearchSettings: {said}"):
        SearchSettings(**{name: value})


def test_a_mean_that_there_is_not_is_refused_with_those_that_there_are():
    with pytest.raises(
        UsageError, match=r"FitSettings: mean: got str 'cubic'; expected .*'zero', 'constant', 'linear'"
    ):
        FitSettings(mean="cubic")


def test_options_of_reading_are_looked_at_where_they_enter():
    model = wg.load_model("crazyflie")
    for option, value in {
        "cutoff_hz": "8",
        "keep": "saturation",
        "shifts": {"imu": "0.1"},
        "between": ("1", "2"),
    }.items():
        with pytest.raises(UsageError, match=f"ReadOptions: {option}: got "):
            wg.open_flights("gone.mcap", model, **{option: value})
