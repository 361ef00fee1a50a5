"""Names the physical effect that a flying vehicle's model is missing, from its flight logs.

    from wrenchgap import load_model, open_flights, explain, add, compare

    model = load_model("tilt_hexarotor")
    train, test = open_flights(["train.mcap", "test.mcap"], model)
    found = explain(train, model)
    print(found)
    compare(test, model, add(model, found)).plot()

Every name here is described in docs/api.md. The packages `flight`, `plant`, `learn`, `compensate` and `viewer` offer
the parts; what they do not list is not public.
"""

import sys

if sys.argv[:1] == ["-m"] and "wrenchgap" in sys.orig_argv and not sys.flags.safe_path:
    del sys.path[0]  # the working folder, in which `python -m wrenchgap` looks for every module: its files are data

from typing import TYPE_CHECKING

from wrenchgap._lazy import names_of

__getattr__, __all__ = names_of(
    __name__,
    {
        "wrenchgap.flight.errors": ("FitError", "LogError", "ModelError", "UsageError", "WrenchgapError"),
        "wrenchgap.replay.api": (
            "ReadOptions",
            "add",
            "compare",
            "compensator",
            "counterfactual",
            "design",
            "explain",
            "inspect",
            "learn_gp",
            "load_gp",
            "load_model",
            "open_flights",
            "replay_compensation",
            "report",
            "save_gp",
            "save_log",
            "save_model",
            "simulate",
            "where",
        ),
        "wrenchgap.replay.between_flights": ("changed", "trend"),
        "wrenchgap.replay.modelling": ("Given", "calibrate", "draft_model", "save_draft"),
        "wrenchgap.replay.onboard": ("combined", "export_compensator", "prove_flown"),
    },
)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if TYPE_CHECKING:
    from wrenchgap.flight.errors import FitError as FitError
    from wrenchgap.flight.errors import LogError as LogError
    from wrenchgap.flight.errors import ModelError as ModelError
    from wrenchgap.flight.errors import UsageError as UsageError
    from wrenchgap.flight.errors import WrenchgapError as WrenchgapError
    from wrenchgap.replay.api import ReadOptions as ReadOptions
    from wrenchgap.replay.api import add as add
    from wrenchgap.replay.api import compare as compare
    from wrenchgap.replay.api import compensator as compensator
    from wrenchgap.replay.api import counterfactual as counterfactual
    from wrenchgap.replay.api import design as design
    from wrenchgap.replay.api import explain as explain
    from wrenchgap.replay.api import inspect as inspect
    from wrenchgap.replay.api import learn_gp as learn_gp
    from wrenchgap.replay.api import load_gp as load_gp
    from wrenchgap.replay.api import load_model as load_model
    from wrenchgap.replay.api import open_flights as open_flights
    from wrenchgap.replay.api import replay_compensation as replay_compensation
    from wrenchgap.replay.api import report as report
    from wrenchgap.replay.api import save_gp as save_gp
    from wrenchgap.replay.api import save_log as save_log
    from wrenchgap.replay.api import save_model as save_model
    from wrenchgap.replay.api import simulate as simulate
    from wrenchgap.replay.api import where as where
    from wrenchgap.replay.between_flights import changed as changed
    from wrenchgap.replay.between_flights import trend as trend
    from wrenchgap.replay.modelling import Given as Given
    from wrenchgap.replay.modelling import calibrate as calibrate
    from wrenchgap.replay.modelling import draft_model as draft_model
    from wrenchgap.replay.modelling import save_draft as save_draft
    from wrenchgap.replay.onboard import combined as combined
    from wrenchgap.replay.onboard import export_compensator as export_compensator
    from wrenchgap.replay.onboard import prove_flown as prove_flown
