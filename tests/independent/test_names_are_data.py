"""Any name at all in every kind of output, read back by somebody else's parser; benchmarks/attacks/outputs.py does the
same from end to end, with logs, commands, a compiler and a browser.
"""

import csv
import io
import json
import shutil
import subprocess
import tokenize
import warnings
from html.parser import HTMLParser
from xml.etree import ElementTree

import jinja2
import pandas as pd
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from rich.console import Console

from benchmarks.attacks.outputs import NASTY
from wrenchgap._escaping import c_comment, comment, csv_cell, html_templates, json_text, markdown, printable
from wrenchgap.flight.errors import ModelError, WrenchgapError
from wrenchgap.plant import model_file
from wrenchgap.replay.present import tables
from wrenchgap.replay.present.documents import write_csv
from wrenchgap.replay.present.figures import style

COMPILER = next((c for c in ("cc", "gcc", "clang") if shutil.which(c)), None)
MEANING = st.sampled_from(
    [*"*/?\\\n\r\t\"'`$%<>[](){}!|#_-=+@:&;.~^ \x00\x1b\x9b\u202e\u2028\ud800", "??/", "*/", "www.", "://"]
)
NAMES = st.lists(st.one_of(MEANING, st.characters()), max_size=30).map("".join)


def any_name(test):
    """The test with the nasty names, and with what hypothesis makes of their parts."""
    for name in NASTY:
        test = example(name)(test)
    return given(NAMES)(test)


@any_name
def test_printable_is_one_line_that_no_terminal_obeys(name):
    shown = printable(name)
    assert all(c.isprintable() or c.isspace() for c in shown)
    assert len(shown.splitlines()) <= 1
    assert len(shown) == len(name)
    assert printable(shown) == shown
    assert str(WrenchgapError(name)).isprintable()


@any_name
def test_a_name_in_a_comment_of_c_neither_ends_nor_joins_it(name):
    text = f" {c_comment(name)} "
    assert not [mark for mark in ("*/", "/*", "??", "\n", "\r", "\\ \n") if mark in f"{text}\n".rstrip("\n")]
    assert not c_comment(name).rstrip().endswith("\\")


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_comments_of_names_compile_to_nothing(tmp_path):
    names = [*NASTY, *(a + b for a in NASTY[:12] for b in ("*", "/", "?", "\\"))]
    lines = [f"/* {c_comment(name)} */\n/* of {c_comment(name)}, and\n * {c_comment(name)} */" for name in names]
    (tmp_path / "names.c").write_text("\n".join([*lines, "extern int one;"]) + "\n", encoding="utf-8")
    for flags in (["-std=c99"], ["-std=c99", "-trigraphs"], ["-std=gnu11"]):
        asked = [COMPILER, *flags, "-Wall", "-Wextra", "-Werror", "-pedantic", "-c", "names.c"]
        done = subprocess.run(asked, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert subprocess.run(["nm", "names.o"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout == ""


@any_name
@example("a---><b>")
@example(r"x coding:unicode_escape \nopen()#")
def test_a_name_in_a_comment_of_xml_or_python_is_no_element_and_no_encoding(name):
    assert [*ElementTree.fromstring(f"<!-- {comment(name)} -->\n<sdf/>").iter()][1:] == []
    source = f"# {comment(name)}\nimport os\n".encode()
    assert tokenize.detect_encoding(io.BytesIO(source).readline)[0] == "utf-8"
    assert len(source.splitlines()) == 2


READ = MarkdownIt("gfm-like", {"linkify": False, "html": True})


@any_name
def test_a_name_in_markdown_is_text(name):
    escaped = markdown(name)
    shown = [
        kind
        for block in READ.parse(f"# of {escaped}\n\n| a |\n|---|\n| of {escaped} |\n")
        for kind in block.children or ()
    ]
    assert {kind.type for kind in shown} <= {"text", "text_special"}, escaped
    text = "".join(kind.content for kind in READ.parse(f"# of {escaped} .")[1].children)
    assert text.split() == f"of {printable(name)} .".split()
    assert "www." not in escaped.lower()


class Read(HTMLParser):
    """Elements and texts of a page."""

    def __init__(self):
        super().__init__()
        self.tags, self.texts = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, [key for key, _ in attrs]))
        self.texts += [value for _, value in attrs]

    def handle_data(self, data):
        self.texts.append(data)


TEMPLATE = html_templates(jinja2.DictLoader({"t": '<p title="{{ name }}">{{ name }}</p>'})).get_template("t")


@any_name
def test_a_name_in_html_is_text(name):
    page = Read()
    page.feed(TEMPLATE.render(name=name))
    page.close()
    shown = printable(name, lines=True)
    assert page.tags == [("p", ["title"])]
    assert page.texts[0] == shown
    assert "".join(page.texts[1:]) == shown


@any_name
def test_a_name_in_json_is_that_name(name):
    text = json_text({name: [name, 1.5, None]}, indent=1)
    whole = "".join("\N{REPLACEMENT CHARACTER}" if "\ud800" <= c <= "\udfff" else c for c in name)
    assert json.loads(text) == {whole: [whole, 1.5, None]}
    assert text.replace("\n", "").isprintable()
    text.encode()


def test_a_number_that_json_does_not_have_is_refused():
    with pytest.raises(ValueError, match="JSON"):
        json_text(float("nan"))


@any_name
def test_a_name_in_csv_is_a_cell_and_no_formula(name):
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([[csv_cell(name), "1"]] * 2)
    rows = list(csv.reader(io.StringIO(out.getvalue())))
    assert rows == [[csv_cell(name), "1"]] * 2
    assert csv_cell(name).replace("'", "") == printable(name).replace("'", "")
    assert not any(part.lstrip().startswith(("=", "+", "-", "@")) for part in csv_cell(name).split(";")[1:])
    assert not (csv_cell(name).startswith(("=", "@")) and len(name) > 1)


def test_numbers_of_a_table_are_left_alone_and_texts_are_not(tmp_path):
    frame = pd.DataFrame({"flight": ["=1+1", "-"], "=x": [-1.5, float("nan")], "note": ["-2.5", None]})
    write_csv(frame, tmp_path / "out.csv")
    assert (tmp_path / "out.csv").read_text() == "flight,'=x,note\n'=1+1,-1.5,-2.5\n-,,\n"


def printed(*parts):
    """In colour, as on a terminal, and without what rich says by it."""
    out = io.StringIO()
    console = Console(file=out, width=20_000, force_terminal=True, color_system="standard", highlight=False)
    for part in parts:
        tables.show(console, part)
    return out.getvalue()


@any_name
def test_a_name_on_a_terminal_is_one_line_without_markup(name):
    line = printed(tables.Line(name))
    assert line.rstrip("\n") == printable(name).rstrip(" ") or line.rstrip() == printable(name).rstrip()
    table = printed(tables.table(name, ("head", name), [(name, 1)]))
    found = table.replace("\x1b[1m", "").replace("\x1b[0m", "").replace("\x1b[22m", "")
    assert all(c == "\n" or c.isprintable() or c.isspace() for c in found)
    assert printable(name[:1000]).strip() in found, "of what is longer its beginning"


@pytest.mark.parametrize("form", ["png", "svg"])
@pytest.mark.parametrize("names", [NASTY[start : start + 8] for start in range(0, len(NASTY), 8)])
def test_names_in_figures_are_no_formulae_and_leave_room(names, form):
    def draw(panel):
        for name in names:
            panel.plot([0.0, 8.0], [1.0, 2.0], label=name)
        panel.set_xticks(range(len(names)), [style.shortened(name, 12) for name in names])
        panel.set_yscale("log")
        panel.set_ylabel(names[-1])
        panel.legend()

    figure = style.figure_of(style.Picture((), (12.0, 8.0), draw, title=" ".join(names)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure.savefig(io.BytesIO(), format=form)
    assert figure.axes[0].get_yticklabels()[0].get_text().startswith("$"), "powers of ten stay formulae"


@pytest.mark.parametrize("name", ["a\nb", "\x1b[31m", "a\x00", "\u202e", "", " ", "x" * 201])
def test_a_vehicle_has_a_name_of_one_printable_line(name):
    text = f"schema = 1\n[vehicle]\nname = {json.dumps(name)}\nmass = 1.0\ninertia = [0.01, 0.01, 0.02]\n"
    with pytest.raises(ModelError, match=r"vehicle\.name: .*expected a name: printable text of one line") as refused:
        model_file.loads(text)
    assert str(refused.value).isprintable()
