"""Checks the documentation: every relative link and heading that it points to exists, every Python example runs.

Examples are the fenced blocks marked `python`; those of one page run in order, as one program, in an empty folder.
A block marked `python no-run` is only compiled.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
NOT_OURS = {"build", "dist", "site", "demo-output", "node_modules"}

LINK = re.compile(r"!?\[[^\]]*\]\(\s*<?([^)\s>]+)>?[^)]*\)")
HEADING = re.compile(r"^#{1,6}\s+(.*?)\s*#*$", re.MULTILINE)
FENCE = re.compile(r"^(```+|~~~+)(.*?)\n(.*?)^\1\s*$", re.MULTILINE | re.DOTALL)
CODE_SPAN = re.compile(r"`[^`\n]*`")


def pages(root: Path = ROOT) -> list[Path]:
    """Every Markdown page of the project."""
    found = sorted(root.rglob("*.md"))
    return [p for p in found if not any(s.startswith(".") or s in NOT_OURS for s in p.relative_to(root).parts)]


def broken_links(root: Path = ROOT) -> list[str]:
    """One line for each relative link whose file or heading does not exist."""
    return [problem for page in pages(root) for problem in _broken_links_of(page, root)]


def _broken_links_of(page: Path, root: Path) -> Iterator[str]:
    text = CODE_SPAN.sub("", FENCE.sub("", page.read_text(encoding="utf-8")))
    for target in LINK.findall(text):
        if re.match(r"[a-z][a-z0-9+.-]*:", target):
            continue
        path, _, heading = target.partition("#")
        place = (page.parent / path) if path else page
        if not place.exists():
            yield f"{page.relative_to(root)}: link to {target}: no such file"
        elif heading and place.suffix == ".md" and heading not in anchors(place):
            yield f"{page.relative_to(root)}: link to {target}: no such heading; there are: {', '.join(anchors(place))}"


def anchors(page: Path) -> list[str]:
    """Names under which the headings of a page can be linked to (GitHub's rule)."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    plain = [re.sub(r"[^\w\- ]", "", heading.lower()) for heading in HEADING.findall(text)]
    return [heading.replace(" ", "-") for heading in plain]


def example(page: Path) -> str:
    """The Python examples of a page as one program, with the page's own line numbers; empty if it has none."""
    text = page.read_text(encoding="utf-8")
    program, lines = "", 0
    for block in FENCE.finditer(text):
        language, *options = block[2].split() or [""]
        if language != "python":
            continue
        start = text.count("\n", 0, block.start(3))
        code = block[3]
        if "no-run" in options:
            compile(code, f"{page}:{start + 1}", "exec")
            continue
        program += "\n" * (start - lines) + code
        lines = start + code.count("\n")
    return program


def failing_examples(root: Path = ROOT) -> list[str]:
    """One entry for each page whose examples do not run."""
    return [problem for page in pages(root) for problem in _failures_of(page, root)]


def _failures_of(page: Path, root: Path) -> Iterator[str]:
    name = str(page.relative_to(root))
    try:
        program = example(page)
    except SyntaxError as error:
        yield f"{name}: {error}"
        return
    if not program:
        return
    runner = f"exec(compile({program!r}, {name!r}, 'exec'), {{'__name__': '__main__'}})"
    with tempfile.TemporaryDirectory() as empty:
        run = subprocess.run([sys.executable, "-c", runner], cwd=empty, capture_output=True, text=True, check=False)
    if run.returncode:
        yield f"{name}: example fails\n{run.stderr.rstrip()}"


def main() -> int:
    """Prints what is wrong; the exit status says whether anything is."""
    problems = broken_links() + failing_examples()
    for problem in problems:
        print(problem, file=sys.stderr)
    print(f"{len(pages())} pages, {len(problems)} problems")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
