"""What counts as silently wrong, on the page of the meaning suite."""

from benchmarks.meaning.judge import Row
from benchmarks.meaning.page import detail


def row(fault, *, found=(), firm=("motor_lag",), wrong=""):
    return Row("quad", fault, "", found, bool(found), bool(found), None, None, firm, wrong)


def test_an_answer_is_silently_wrong_where_nothing_warned():
    faults = [
        row("a", found=("frozen",), wrong="com_offset"),
        row("b", wrong="motor_lag.tau 0.05 +- 0.001"),
        row("c", found=("spikes",)),
        row("d", firm=None),
    ]
    text = detail(faults, [row("healthy")], 11)
    assert "| logs with a fault that were explained | 3 | - |" in text
    assert "| silently wrong | 1 | 0 |" in text
    assert "| wrong below a warning | 1 | - |" in text
    assert "| healthy logs that were explained, wrong of them | 1, 0 | 0 |" in text
    assert "- quad, a (frozen): com_offset" in text


def test_where_nothing_was_explained_the_page_says_nothing_of_it():
    assert "Answers" not in detail([row("d", firm=None)], [], 11)
