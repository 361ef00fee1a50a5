"""A view that was saved is the view that is opened; whatever else is offered gets one clear line."""

import json
from time import process_time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchgap.flight.errors import UsageError
from wrenchgap.viewer.host import error_text
from wrenchgap.viewer.scene_drawing import Shown
from wrenchgap.viewer.view_state import ViewState, parse

times = st.floats(-1e6, 1e6)
points = st.tuples(times, times, times)
switches = st.builds(
    Shown,
    force=st.booleans(),
    frames=st.booleans(),
    hidden=st.frozensets(st.text(max_size=8), max_size=3),
    along=st.text(max_size=12),
    spacing=st.floats(0.01, 60.0),
    follow=st.booleans(),
    factors=st.tuples(*[st.floats(0.1, 10.0)] * 3),
)


@given(
    st.builds(
        ViewState,
        flight=st.none() | st.text(max_size=20),
        time=st.none() | times,
        marks=st.dictionaries(st.sampled_from(["A", "B"]), times),
        loop=st.booleans(),
        zoom=st.none() | st.text(max_size=5),
        shown=switches,
        channels=st.lists(st.text(max_size=20), max_size=3).map(tuple),
        ghost_shift=times,
        camera=st.none() | st.tuples(points, points).filter(lambda pair: pair[0] != pair[1]),
    )
)
def test_what_is_saved_is_what_is_opened(view):
    assert parse(view.to_text()) == view


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"time": "noon"}, "time: got 'noon', expected a number"),
        ({"time": True}, "expected a number"),
        ({"marks": {"C": 1.0}}, "numbers for A and B"),
        ({"camera": {"position": [0, 0, 1]}}, "position and look_at"),
        ({"camera": {"position": [0, 0, 1], "look_at": [0, 0, 1]}}, "position and look_at"),
        ({"shown": {"force": 1}}, "shown.force: got 1, expected true or false"),
        ({"shown": {"factors": [1.0, 0.0, 1.0]}}, "three positive numbers"),
        ({"channels": "all"}, "a list of at most"),
        ({"colour": "red"}, "colour: is not a known key"),
        ({"schema": "wrenchgap.compare/1"}, "expected 'wrenchgap.view/1'"),
    ],
)
def test_what_is_no_view_is_told_in_one_line(change, words):
    document = json.loads(ViewState().to_text()) | change
    with pytest.raises(UsageError, match="saved view") as told:
        parse(json.dumps(document))
    assert words in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("text", ["", "nonsense", "[1, 2]", "{", "null", "[" * 100_000])
def test_nonsense_is_told_too(text):
    with pytest.raises(UsageError, match="saved view"):
        parse(text)


def test_a_long_value_is_quoted_in_part_and_told_at_once():
    """A text of a megabyte that looks like a path at every second character took hours to shorten, under the lock."""
    nasty = json.dumps({"schema": "/!" * 500_000})
    with pytest.raises(UsageError) as caught:
        parse(nasty)
    assert len(str(caught.value)) < 300
    started = process_time()
    assert len(error_text(UsageError("/!" * 500_000))) <= 1000
    assert process_time() - started < 1.0
