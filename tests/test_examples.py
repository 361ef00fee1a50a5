"""The numbered examples run and do what they say."""

import runpy
from pathlib import Path

EXAMPLES = Path(__file__).parent.parent / "examples"


def test_missing_effect_is_named_and_the_error_falls():
    program = runpy.run_path(str(EXAMPLES / "01_name_the_missing_effect.py"))
    assert program["main"]() < 0.1


def test_examples_are_numbered():
    names = sorted(path.name for path in EXAMPLES.glob("*.py"))
    assert [name[:2] for name in names] == [f"{k:02d}" for k in range(1, len(names) + 1)]
