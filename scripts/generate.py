"""Print what is generated from other source, and write it where it belongs: `make generated`.

python scripts/generate.py            # writes
python scripts/generate.py --check    # fails where a file is not what would be written
"""

import sys
from pathlib import Path

from wrenchgap.compensate import kernels
from wrenchgap.compensate.c_printer import memory_text, period_text
from wrenchgap.compensate.packing import views_module

ROOT = Path(__file__).resolve().parents[1]
FILES = {
    "compensate/generated/views.py": views_module,
    "compensate/generated/period.c": lambda: period_text(kernels),
    "compensate/generated/memory.h": memory_text,
}


def main() -> int:
    """Number of files that are not what they should be, with --check."""
    stale = 0
    for name, made in FILES.items():
        place = ROOT / name
        if "--check" not in sys.argv:
            place.write_text(made())
        elif place.read_text() != made():
            print(f"{name}: stale; run `make generated`")
            stale += 1
    return stale


if __name__ == "__main__":
    sys.exit(main())
