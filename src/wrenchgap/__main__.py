"""The command line: `wrenchgap`, or `python -m wrenchgap`."""

import sys

from wrenchgap import _safe_path, _signals


def main() -> None:
    """Run one command, and leave with its exit code."""
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
