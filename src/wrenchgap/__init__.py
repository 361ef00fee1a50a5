"""Names the physical effect that a flying vehicle's model is missing, from its flight logs.

    from wrenchgap import load_model, open_flights, explain, add, compare

    model = load_model("tilt_hexarotor")
    train, test = open_flights(["train.mcap", "test.mcap"], model)
    found = explain(train, model)
    print(found)
    compare(test, model, add(model, found)).plot()

Every name is listed in `__init__.pyi` and described in docs/api.md. The packages `flight`, `plant`, `learn`,
`compensate` and `viewer` offer the parts; what they do not list is not public.
"""

import sys

if sys.argv[:1] == ["-m"] and "wrenchgap" in sys.orig_argv and not sys.flags.safe_path:
    del sys.path[0]  # the working folder, in which `python -m wrenchgap` looks for every module: its files are data

import signal  # not before: the working folder may have a file of that name

if (
    "".join(sys.argv[:1]).endswith(("/wrenchgap", "\\wrenchgap.exe"))
    and signal.getsignal(signal.SIGINT) is signal.default_int_handler
):
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # of the command, until `_signals.catch`: Ctrl-C is no traceback

import lazy_loader

from wrenchgap.flight.result import Result
from wrenchgap.replay import present

Result.presentation = present
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
