"""The printer of the compiled step: what it says is what Python says, and what it does not know it refuses."""

import importlib.util
import shutil
import subprocess

import numpy as np
import pytest

from scripts.c_printer import Printer, Unprintable

HEAD = """
import math
from wrenchgap.compensate.tables import Six
LIMIT = 2.5
MOST = 3
def printed(function):
    return function
"""
SAYS = '''
@printed
def inner(x: Six, by: float) -> float:
    """Sum of what is positive, less what is not; by a factor."""
    total = 0.0
    for i in range(6):
        if x[i] > 0.0 and not x[i] > LIMIT:
            total += x[i]
        elif x[i] <= -1.0 or (x[i] > 2.0 and by > 1.0):
            continue
        else:
            total -= -x[i] - (by - x[i])
    return total / (by * 2.0)

@printed
def outer(x: Six) -> float:
    """Everything."""
    best = 0.0
    for turn in range(MOST, 0, -1):
        if turn == 2:
            break
        x[turn] = x[turn] * x[turn] - x[0]
        best = inner(x, x[turn]) if x[turn] > best else math.sqrt(abs(x[0]))
    return best - (x[1] - x[2]) * LIMIT
'''


def module_of(text, tmp_path, name="written"):
    place = tmp_path / f"{name}.py"
    place.write_text(HEAD + text)
    spec = importlib.util.spec_from_file_location(name, place)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


@pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler")
def test_c_gives_what_python_gives(tmp_path):
    made = module_of(SAYS, tmp_path)
    printer = Printer(made)
    main = """
int main(void) {
    wg_real x[6];
    while (scanf("%lf %lf %lf %lf %lf %lf", x, x + 1, x + 2, x + 3, x + 4, x + 5) == 6)
        printf("%.17g\\n", wg_outer(x));
    return 0;
}
"""
    head = "#include <math.h>\n#include <stdio.h>\ntypedef double wg_real;\n#define WG(x) x\n"
    head += "#define wg_sqrt sqrt\n#define wg_fabs fabs\n"
    (tmp_path / "t.c").write_text(head + printer.constants() + "\n" + printer.text() + main)
    words = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-o", tmp_path / "t", tmp_path / "t.c", "-lm"]
    subprocess.run([str(w) for w in words], check=True)
    rows = np.random.default_rng(0).normal(size=(200, 6)) * 2.0
    text = "\n".join(" ".join(map(repr, row.tolist())) for row in rows)
    said = subprocess.run([str(tmp_path / "t")], input=text, capture_output=True, text=True, check=True).stdout
    wanted = [made.outer(row.copy()) for row in rows]
    assert np.array(said.split(), dtype=float) == pytest.approx(wanted, rel=1e-12)
    assert len({round(w, 6) for w in wanted}) > 100


def test_what_is_not_written_to_is_const(tmp_path):
    """Through calls, too."""
    printer = Printer(module_of(SAYS, tmp_path))
    assert printer.signature("inner") == "static wg_real wg_inner(const wg_real *x, wg_real by)"
    assert printer.signature("outer") == "static wg_real wg_outer(wg_real *x)"


@pytest.mark.parametrize(
    "line",
    [
        "a, b = 1.0, 2.0",
        "while x[0] > 0.0: x[0] -= 1.0",
        "a = [1.0, 2.0]",
        "a = x[0] < x[1] < x[2]",
        "a = 1.0 if x[0] > 0.0 else 0",
        "a = unheard_of(x)",
        "for v in x: x[0] = v",
        "a = f'{x[0]}'",
        "with x: pass",
    ],
)
def test_what_c_has_no_words_for_is_refused_with_its_line(tmp_path, line):
    text = f'@printed\ndef odd(x: Six) -> None:\n    """Odd."""\n    {line}\n'
    with pytest.raises(Unprintable, match="line 11"):
        Printer(module_of(text, tmp_path, "odd")).text()
