"""Licences of all that `pip install wrenchgap` installs, from the packages' own metadata; part of `make check`.

    python scripts/licences.py          # fails for a licence that is not accepted, or where docs/licences.md is stale
    python scripts/licences.py --page   # writes docs/licences.md

A required package under the GPL or the AGPL would put whoever passes wrenchgap on under it. Extras are for who
installs them.
"""

from __future__ import annotations

import argparse
import re
import sys
from importlib.metadata import Distribution, PackageNotFoundError, distribution, requires
from pathlib import Path

from packaging.requirements import Requirement

PAGE = Path(__file__).parents[1] / "docs" / "licences.md"
ACCEPTED = (
    """
0BSD, any-OSI, Apache-2.0, Apache-2.0 WITH LLVM-exception, BSD, BSD-2-Clause, BSD-3-Clause, CC0-1.0, ISC, MIT, MIT-CMU,
MPL-2.0, PSF-2.0, Zlib
""".replace("\n", " ")
    .strip()
    .split(", ")
)
"""SPDX identifiers; MPL-2.0 asks for the source of its own files alone, and `BSD` is what classifiers say of both
kinds."""
CLASSIFIERS = {
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
}
NOTES = {
    "nlopt": "the package is MIT; of the library within, the L-BFGS of L. Luksan is LGPL-2.1-or-later: it is imported, "
    "not copied or changed",
    "apsw": "any licence that the OSI has approved",
}
EXTRAS = ("tables", "viewer", "trend")
HEAD = """# Licences of what is required

Made by `python scripts/licences.py --page` from the metadata of the packages that
`pip install 'wrenchgap[{extras}]'` installs on Linux; versions are those of `requirements.lock`. `make check` fails
where this page is out of date, or where a licence is none of those accepted: {accepted}.

| package | licence | note |
|---|---|---|
"""


def required(name: str, found: dict[str, Distribution]) -> None:
    """Put a package and all that it requires here into `found`, without extras."""
    key = re.sub(r"[-_.]+", "-", name).lower()
    if key in found:
        return
    found[key] = distribution(name)
    for line in found[key].requires or []:
        wanted = Requirement(line)
        if wanted.marker is None or wanted.marker.evaluate({"extra": ""}):
            required(wanted.name, found)


def licence(package: Distribution) -> str:
    """What the metadata say, as SPDX where they do: the expression, a short text, or the classifiers."""
    about = package.metadata
    expression = about.get("License-Expression")
    if expression:
        return str(expression)
    said = [
        CLASSIFIERS.get(c.split(" :: ")[-1], c) for c in about.get_all("Classifier") or [] if c.startswith("License ::")
    ]
    text = str(about.get("License") or "").strip()
    return text if text and accepted(text) else " AND ".join(said) or "unknown"


def accepted(expression: str) -> bool:
    """Whether all parts of an expression are, or one of those that it leaves the choice of."""
    choices = re.split(r"\s+OR\s+", expression.strip("()"))
    return any(all(p.strip("() ") in ACCEPTED for p in re.split(r"\s+AND\s+", choice)) for choice in choices)


def main() -> int:
    """Print what is wrong; 1 where something is."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--page", action="store_true", help="write docs/licences.md")
    asked = parser.parse_args()
    found: dict[str, Distribution] = {}
    for line in requires("wrenchgap") or []:
        wanted = Requirement(line)
        if wanted.marker is None or any(wanted.marker.evaluate({"extra": extra}) for extra in ("", *EXTRAS)):
            try:
                required(wanted.name, found)
            except PackageNotFoundError as error:
                print(f"licences: {error}: is not installed; run: make setup")
                return 1
    said = {name: licence(package) for name, package in sorted(found.items())}
    rows = [f"| {name} | {text} | {NOTES.get(name, '')} |" for name, text in said.items()]
    page = HEAD.format(accepted=", ".join(ACCEPTED), extras=",".join(EXTRAS)) + "\n".join(rows) + "\n"
    if asked.page:
        PAGE.write_text(page, encoding="utf-8")
    wrong = [f"licences: {name}: {text} is not accepted; replace it, or say why in scripts/licences.py"
             for name, text in said.items() if not accepted(text)]  # fmt: skip
    if not PAGE.exists() or PAGE.read_text(encoding="utf-8") != page:
        wrong.append("licences: docs/licences.md is out of date; run: python scripts/licences.py --page")
    print("\n".join(wrong) or f"licences: {len(said)} required packages, all accepted")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
