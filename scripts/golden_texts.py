"""The kept texts: what commands print, word by word, in tests/golden/texts.

    make golden                                 # after a change that was meant: the texts anew
    python -m scripts.golden_texts              # compare; the first line that differs of each

The commands run in one folder, in this order, on flights that are simulated from a seed. Words are compared to the
letter; numbers by their value, since machines differ in the last digits of a fit; spaces and rules of tables not at
all, since they follow the numbers' widths.
"""

from __future__ import annotations

import argparse
import difflib
import math
import os
import re
import shlex
import sys
import tempfile
from contextlib import chdir
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "tests" / "golden" / "texts"
TOLERANCE = 0.02
"""Of a number, relative: fits end within a fifth of that on other machines, what is shown has two or three digits."""

HIDDEN = "--hide com_offset=x:-0.004,y:0.007,z:-0.005"
HEXAROTOR, QUADROTOR = "simulate -m tilt_hexarotor --trajectory", "simulate -m asymmetric_quadrotor --trajectory"
PREPARE = (
    f"{HEXAROTOR} multi_axis -o train.mcap --duration 12 --excitation 1 --seed 1 {HIDDEN}",
    f"{HEXAROTOR} figure8 -o test.mcap --duration 10 --seed 1 {HIDDEN}",
    f"{HEXAROTOR} multi_axis -o ideal.mcap --duration 10 --excitation 1 --seed 1",
    f"{QUADROTOR} hover -o hover.mcap --duration 15 --seed 2",
    f"{QUADROTOR} hover -o cut.mcap --duration 15 --seed 3 --hide rotor_thrust=rotor_1:-0.2",
)
"""Flights that are not asked about."""
COMMANDS = {
    "check": "check hover.mcap",
    "check-two-logs": "check hover.mcap cut.mcap --details",
    "inspect": "inspect train.mcap -m tilt_hexarotor",
    "compare": "compare train.mcap test.mcap -m tilt_hexarotor --by-flight",
    "where": "where train.mcap -m tilt_hexarotor",
    "explain": "explain train.mcap -m tilt_hexarotor --validate test.mcap --details",
    "explain-nothing-missing": "explain ideal.mcap -m tilt_hexarotor --injections 0",
    "explain-hover": "explain cut.mcap -m asymmetric_quadrotor --injections 0",
    "discover-nothing": "discover ideal.mcap -m tilt_hexarotor",
    "changed": "changed cut.mcap --healthy hover.mcap -m asymmetric_quadrotor --details",
    "calibrate": "calibrate train.mcap -m tilt_hexarotor -o calibrated.toml",
    "add": "add com_offset -m tilt_hexarotor --from train.mcap -o fitted.toml",
    "compare-against": "compare test.mcap -m tilt_hexarotor --against fitted.toml",
    "predict": "predict test.mcap -m tilt_hexarotor --against fitted.toml",
    "ready": "ready test.mcap -m fitted.toml --for hover --payload 0.2",
    "history": "history fitted.toml",
    "model-show": "model show fitted.toml",
    "effectiveness": "effectiveness fitted.toml",
    "write": "write fitted.toml --to px4",
    "remove": "remove com_offset -m fitted.toml -o without.toml",
    "trend": "trend train.mcap test.mcap ideal.mcap -m tilt_hexarotor --fit com_offset,mass",
    "learn": "learn train.mcap -m tilt_hexarotor -o residual.gp --points 60 --validate test.mcap",
    "replay": "replay test.mcap -m tilt_hexarotor --gp residual.gp -o replayed.mcap",
    "counterfactual": "counterfactual test.mcap -m tilt_hexarotor --gp residual.gp -o flown.mcap --duration 5",
    "export": "export residual.gp -m tilt_hexarotor -o compensation",
    "design": "design com_offset mass -m tilt_hexarotor -o flight.toml --duration 10",
    "convert": "convert hover.mcap -o converted",
    "bad-input": "explain nowhere.mcap -m tilt_hexarotor",
    "bad-option": "compare train.mcap -m tilt_hexarotor --cutoff -3",
}
"""By the name of the text."""

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
DECORATION = re.compile(r"[─━═┄╌┈│┃╭╮╰╯├┤┬┴┼╷╵╶╴┏┓┗┛┡┩╇╈╋╎\s]+|-{2,}")
PROGRESS = re.compile(r"\w+: +\d+ % ")
"""Lines of progress, which come by the clock."""
MASKED = (
    (re.compile(r"\b\d+(?:\.\d+)? ?(?:ms|s) (?:a step|of processor time)"), "TIME"),
    (re.compile(r"(?<=solve time mean / p99 / max) .* ms(?=,)"), "TIME"),
    (re.compile(r"\b20\d\d-\d\d-\d\d(?:[T ][\d:.]+Z?)?"), "DATE"),
    (re.compile(r"\b[0-9a-f]{12,64}\b"), "HASH"),
)


def printed(folder: Path) -> dict[str, str]:
    """What each command prints, and its exit code, run one after another in `folder`."""
    from typer.testing import CliRunner

    from wrenchgap.replay.cli.main import app

    runner, texts = CliRunner(), {}
    environment = {"COLUMNS": "120", "TERM": "dumb", "NO_COLOR": "1"}
    before = {name: os.environ.get(name) for name in environment}
    os.environ.update(environment)
    try:
        with chdir(folder):
            for words in PREPARE:
                done = runner.invoke(app, shlex.split(words), prog_name="wrenchgap")
                assert done.exit_code == 0, f"{words}\n{done.output}"
            for name, words in COMMANDS.items():
                done = runner.invoke(app, shlex.split(words), prog_name="wrenchgap")
                text = done.output.replace(str(folder), "FOLDER")
                lines = [line.rstrip() for line in text.splitlines() if not PROGRESS.match(line)]
                texts[name] = f"$ wrenchgap {words}\n" + "\n".join(lines) + f"\n[exit code {done.exit_code}]\n"
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
    return texts


def difference(kept: str, now: str) -> str | None:
    """The lines in which two texts differ as a unified diff; None where they say the same."""
    before, after = (_lines(text) for text in (kept, now))
    if len(before) == len(after) and all(map(_same, before, after)):
        return None
    return "\n".join(difflib.unified_diff(before, after, "kept", "now", lineterm="", n=1))


def _lines(text: str) -> list[str]:
    for pattern, name in MASKED:
        text = pattern.sub(name, text)
    plain = (DECORATION.sub(" ", line).strip() for line in text.splitlines())
    return [line for line in plain if line]


def _same(before: str, after: str) -> bool:
    """Whether two lines have the same words and, within TOLERANCE and a unit of their last digit, the same numbers."""
    if NUMBER.sub("#", before) != NUMBER.sub("#", after):
        return False
    pairs = zip(NUMBER.findall(before), NUMBER.findall(after), strict=True)
    return all(
        math.isclose(float(a), float(b), rel_tol=TOLERANCE, abs_tol=1.01 * max(_unit(a), _unit(b))) for a, b in pairs
    )


def _unit(number: str) -> float:
    """The value of a one in the last digit that is shown; of a whole number nothing, for it may count things."""
    mantissa, _, exponent = number.partition("e")
    decimals = len(mantissa.partition(".")[2])
    return float(f"1e{int(exponent or 0) - decimals}") if decimals or exponent else 0.0


def main() -> int:
    """Compare, or keep anew."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--refresh", action="store_true", help="write tests/golden/texts anew")
    refresh = parser.parse_args().refresh
    with tempfile.TemporaryDirectory() as folder:
        texts = printed(Path(folder))
    if refresh:
        KEPT.mkdir(exist_ok=True)
        for path in KEPT.glob("*.txt"):
            path.unlink()
        for name, text in texts.items():
            (KEPT / f"{name}.txt").write_text(text, encoding="utf-8")
        return 0
    found = {name: difference((KEPT / f"{name}.txt").read_text(encoding="utf-8"), text) for name, text in texts.items()}
    for name, lines in found.items():
        print(f"{name}: the same" if lines is None else f"{name}:\n{lines}\n")
    return int(any(found.values()))


if __name__ == "__main__":
    sys.exit(main())
