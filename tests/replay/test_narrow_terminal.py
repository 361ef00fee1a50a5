"""On a narrow terminal sentences are broken where it ends, commands to copy and numbers of tables are not."""

import pytest

from wrenchgap.replay.cli.requests import console
from wrenchgap.replay.present.tables import Line, show, table

SENTENCE = "Nothing is missing that the catalogue could name here, and " * 4
COMMAND = f"next: wrenchgap explain {'/a/very/long/folder' * 6}/flight.mcap -m my_vehicle.toml"


@pytest.fixture
def lines(monkeypatch):
    def printed(part, columns):
        monkeypatch.setenv("COLUMNS", str(columns))
        out = console()
        with out.capture() as caught:
            show(out, part)
        return caught.get().rstrip().split("\n")

    return printed


@pytest.mark.parametrize("columns", [70, 100, 160])
def test_sentences_end_where_the_terminal_does(lines, columns):
    found = lines(Line(SENTENCE), columns)
    assert len(found) > 1
    assert columns - len("catalogue") - 2 < max(map(len, found)) <= columns
    assert " ".join(line.strip() for line in found) == SENTENCE.strip()


def test_a_command_to_copy_stays_in_one_piece(lines):
    assert lines(Line(COMMAND), 70) == [COMMAND]


@pytest.mark.timeout(10)
@pytest.mark.parametrize("name", ["/" + "a" * 10**7, "/" + "a" * 500 + " b" * 10**6])
def test_of_a_name_of_megabytes_a_table_shows_the_beginning(lines, name):
    found = "".join(lines(table("", [("topic in", name), "messages"], [[name, 1]]), 100))
    assert 1400 < found.count("a") + found.count("b") < 2100


def test_numbers_of_a_table_are_not_broken(lines):
    heads = [f"column {k} [Nm]" for k in range(8)]
    rows = [["0.123 +- 0.001"] * 8]
    assert lines(table("numbers", heads, rows), 70) == lines(table("numbers", heads, rows), 120)
