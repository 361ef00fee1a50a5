"""The command line: `wrenchgap`, or `python -m wrenchgap`."""

import os
import sys
from pathlib import Path

from wrenchgap import _safe_path, _signals


def open_streams() -> None:
    """Give standard streams that are closed (`>&-`) their descriptors back, before another file takes them."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115


def main() -> None:
    """Run one command, and leave with its exit code."""
    open_streams()
    _signals.catch()
    _safe_path.leave_working_folder()
    try:
        from wrenchgap.replay.cli.main import main as command_line  # long: not before signals are caught

        command_line()
    except KeyboardInterrupt as error:  # while modules were imported
        sys.stderr.write("wrenchgap: interrupted\n")
        sys.exit(getattr(error, "code", 130))
    finally:
        _signals.leave()


if __name__ == "__main__":
    main()
