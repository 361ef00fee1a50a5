"""What commands print is what they printed, word by word; a change that was meant renews it with `make golden`."""

import pytest

from scripts import golden_texts as golden


@pytest.fixture(scope="module")
def texts(tmp_path_factory):
    """What each command prints now."""
    return golden.printed(tmp_path_factory.mktemp("texts"))


@pytest.mark.slow
@pytest.mark.parametrize("name", golden.COMMANDS)
def test_a_command_prints_what_it_printed(name, texts):
    kept = (golden.KEPT / f"{name}.txt").read_text(encoding="utf-8")
    lines = golden.difference(kept, texts[name])
    assert lines is None, f"{name}: after a change that was meant, `make golden` renews it\n{lines}"


def test_words_count_to_the_letter_and_numbers_by_their_value():
    kept = "Changed: rotor_thrust by -17.6 %\n\n a    1.234e-05   3 of 12\n ─────\n"
    assert golden.difference(kept, kept) is None
    assert golden.difference(kept, "Changed: rotor_thrust by -17.5 %\n a  1.240e-05  3 of 12\n") is None
    assert "-19.6" in golden.difference(kept, kept.replace("17.6", "19.6"))
    assert "fell" in golden.difference(kept, kept.replace("Changed", "fell"))
    assert "4 of 12" in golden.difference(kept, kept.replace("3 of", "4 of"))
    assert golden.difference(kept, kept + "more\n") is not None
