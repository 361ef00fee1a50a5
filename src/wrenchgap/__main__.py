"""The command line: `wrenchgap`, or `python -m wrenchgap`."""

import atexit
import os
import sys
from contextlib import suppress
from pathlib import Path

from wrenchgap import _safe_path, _signals

LEAST = 7 * 10**8
"""Bytes of address space that `compare` needs with one thread of BLAS: it passes with 0.65 GB."""


OBEYED = ".numba_config.yaml"
"""What numba reads of the working folder whenever it compiles."""


def open_streams() -> None:
    """Give standard streams that are closed (`>&-`) their descriptors back, before another file takes them."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115


def working_folder() -> None:
    """Leave with one line where the working folder is gone, as relative paths mean nothing then; and where it holds
    settings of numba, which would read compiled code where they say, and run it: files beside data are data.
    """  # noqa: D205
    try:
        Path.cwd()
        said = f"its {OBEYED} would be obeyed; take it away, or" if os.path.lexists(OBEYED) else ""
    except OSError as error:
        said = f"{error.strerror};"
    if said:
        sys.stderr.write(f"wrenchgap: the working folder cannot be used: {said} go to another one\n")
        sys.exit(2)


def address_space() -> None:
    """Leave with one line where the limit of address space is too small: OpenBLAS waits for ever for memory then.

    Of each thread it takes 80 MB more; where there is a limit it has one, unless the user says otherwise.
    """
    try:
        import resource
    except ImportError:  # Windows
        return
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if limit < LEAST:
        sys.stderr.write(
            f"wrenchgap: the limit of address space is {limit // 1024} kB; expected {LEAST // 1024} kB at least; raise "
            "it, `ulimit -v unlimited`\n"
        )
        sys.exit(2)


def main() -> None:
    """Run one command, and end the process with its exit code.

    The interpreter is not taken down: threads that wait for other processes, or compiled code, may still run, and what
    they meet while it goes crashes now and then. What is registered first for the end of a process runs last.
    """
    open_streams()
    codes: list[int] = []
    atexit.register(end, codes)
    try:
        _signals.catch()
        working_folder()
        address_space()
        os.environ.pop("SOURCE_DATE_EPOCH", None)  # nothing here obeys it, and numpy.f2py fails where it is no number
        _safe_path.leave_working_folder()
        from wrenchgap.replay.cli.main import main as command_line  # long: not before signals are caught

        command_line()
    except SystemExit as error:
        codes.append(error.code if isinstance(error.code, int) else int(error.code is not None))
    except BaseException as error:  # while modules were imported
        if (interrupt := _signals.interrupt_of(error)) is None:
            raise
        sys.stderr.write("wrenchgap: interrupted\n")
        codes.append(getattr(interrupt, "code", 130))
    else:
        codes.append(0)
    if codes[0] > 128:  # by a signal, which is said: a cluster that was half up complains of its own end
        sys.stderr = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    _signals.leave()


def end(codes: list[int]) -> None:
    """End the process with the exit code in this list, if there is one, once its output is written."""
    if not codes:
        return
    code = codes[0]
    try:
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of our output, e.g. `head`, has seen enough
        pass
    except OSError as error:
        if code == 0:  # else it has been said
            sys.stderr.write(f"wrenchgap: the output could not be written: {error.strerror}\n")
            code = 2
    with suppress(OSError):
        sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
