"""The reader of files: what is right is read as it is, what is wrong is told in one line with its place."""

import os
from dataclasses import dataclass, field

import numpy as np
import pytest

from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant import own_effects
from wrenchgap.plant.reader import (
    Flag,
    Number,
    Positive,
    Table,
    Text,
    Vector,
    check_schema,
    partial,
    read,
    text_of,
    toml,
    values_of,
)


class Wheel(Table):
    radius: Positive
    place: Vector = (0.0, 0.0, 0.0)


class Cart(Table):
    name: Text
    brakes: Flag = True
    wheels: tuple[Wheel, ...] = ()
    load: dict[str, Number] = {}  # noqa: RUF012 (pydantic copies it)


@dataclass(frozen=True)
class Arm:
    angle: float
    ramp: float = 2.0
    axes: tuple[str, ...] = ("x",)
    seed: int = field(default=0)


def test_what_is_right_is_read():
    cart = read(Cart, {"name": "a", "wheels": [{"radius": 1, "place": [1, 2, 3]}], "load": {"corn": 2}})
    assert (cart.name, cart.brakes, cart.wheels[0].place, cart.load) == ("a", True, (1.0, 2.0, 3.0), {"corn": 2.0})


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({}, "cart.name: is missing; see the page"),
        ({"nam": "a"}, "cart.nam: is not a known key; did you mean 'name'?"),
        ({"name": "a", "colour": 1}, "cart.colour: is not a known key; expected one of: brakes, load, name, wheels"),
        ({"name": 3}, "cart.name: got 3, expected text"),
        ({"name": "a", "brakes": 1}, "cart.brakes: got 1, expected true or false"),
        ({"name": "a", "load": 4}, "cart.load: got 4, expected a table [cart.load]"),
        (
            {"name": "a", "load": {"corn": "much"}},
            "cart.load.corn: got 'much', expected a finite number, of a size up to 1e12",
        ),
        ({"name": "a", "wheels": {"radius": 1}}, "cart.wheels: got {'radius': 1}, expected tables [[cart.wheels]]"),
        ({"name": "a", "wheels": [{"radius": 1}, 2]}, "cart.wheels[1]: got 2, expected a table [cart.wheels[1]]"),
        (
            {"name": "a", "wheels": [{"radius": -1}]},
            "cart.wheels[0].radius: got -1, expected a positive number, from 1e-15 to 1e12",
        ),
        (
            {"name": "a", "wheels": [{"radius": True}]},
            "cart.wheels[0].radius: got True, expected a positive number, from 1e-15 to 1e12",
        ),
        (
            {"name": "a", "wheels": [{"radius": 1, "place": [0, float("nan"), 0]}]},
            "cart.wheels[0].place: got [0, nan, 0], expected three finite numbers, of a size up to 1e12",
        ),
    ],
)
def test_what_is_wrong_is_told_with_its_place(values, line):
    with pytest.raises(ModelError) as caught:
        read(Cart, values, where="cart", page="the page")
    assert str(caught.value) == line


def test_a_long_value_is_cut_and_the_error_is_of_the_asked_for_kind():
    with pytest.raises(UsageError, match=r"^name: got \['x', 'x', .*\.\.\., expected text$") as caught:
        read(Cart, {"name": ["x"] * 99}, error=UsageError)
    assert len(str(caught.value)) < 120


def test_fields_of_a_dataclass_are_keys():
    given = values_of(Arm, {"angle_deg": 90.0, "axes": ["y", "z"]}, where="arm", degrees=("angle",))
    assert given == {"angle": np.pi / 2, "axes": ("y", "z")}
    with pytest.raises(ModelError, match=r"^arm\.angle_deg: is missing$"):
        values_of(Arm, {"ramp": 1.0}, where="arm", degrees=("angle",))
    with pytest.raises(ModelError, match=r"^arm\.seed: got 0\.5, expected a whole number$"):
        values_of(Arm, {"angle": 1.0, "seed": 0.5}, where="arm")


def test_defaults_need_nothing_but_are_checked():
    read(partial(Wheel), {})
    with pytest.raises(ModelError, match="radius: got 0, expected a positive number"):
        read(partial(Wheel), {"radius": 0})


@pytest.mark.timeout(20)
def test_a_pipe_is_not_waited_for(tmp_path):
    """`view --view PIPE` and `--effects PIPE` hung, `--effects /dev/zero` read until memory ended."""
    os.mkfifo(tmp_path / "pipe.py")
    (tmp_path / "zero.py").symlink_to("/dev/zero")
    for path in (tmp_path / "pipe.py", tmp_path / "zero.py"):
        with pytest.raises(ModelError, match="cannot be read as a list: it is no ordinary file"):
            text_of(path, "as a list")
        with pytest.raises(ModelError, match="cannot be read as --effects: it is no ordinary file"):
            own_effects.load(path)


@pytest.mark.parametrize("number", ["0x" + "f" * 5000, "0b" + "1" * 20000])
def test_a_number_of_thousands_of_digits_is_refused_in_one_line(number):
    with pytest.raises(ModelError, match="more than 64 bits"):
        toml(f"schema = {number}")


def test_an_error_is_short_whatever_a_file_holds():
    with pytest.raises(ModelError) as error:
        check_schema({"schema": "A" * 1_000_000}, 1)
    assert len(str(error.value)) <= 2000
    assert str(error.value).endswith("this version of wrenchgap reads 1")
