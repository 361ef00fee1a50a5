"""From flights to models: measured wrench, residuals, parameters of effects, Gaussian processes.

data       flights opened, filtered, stacked, cut into blocks of time; predictions and their errors
process    Gaussian processes of what a model leaves
diagnose   timing, where a model fails and what its error depends on
identify   effects fitted, added, tested on flights that were not fitted
posterior  which sets of effects are missing, how sure that is, what would settle it
design     flights that separate effects
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wrenchgap._lazy import callable_as, names_of

callable_as(__name__, "wrenchgap.replay.api", "learn_gp")
__getattr__, __all__ = names_of(
    __name__,
    {
        "wrenchgap.learn.data.comparison": ("Comparison",),
        "wrenchgap.learn.data.errors": ("Errors",),
        "wrenchgap.learn.data.opening": ("OpenFlight",),
        "wrenchgap.learn.design.design_result": ("Design",),
        "wrenchgap.learn.design.manoeuvres": ("Limits",),
        "wrenchgap.learn.diagnose.model_checks": ("LogReport",),
        "wrenchgap.learn.diagnose.where": ("Where",),
        "wrenchgap.learn.identify.add": ("Addition",),
        "wrenchgap.learn.posterior.explain": ("Explanation", "Verdict"),
        "wrenchgap.learn.identify.learning": ("Learnt",),
        "wrenchgap.learn.identify.trend": ("Trend",),
        "wrenchgap.learn.process.gp": ("FitSettings", "GaussianProcess"),
    },
)

if TYPE_CHECKING:
    from wrenchgap.learn.data.comparison import Comparison as Comparison
    from wrenchgap.learn.data.errors import Errors as Errors
    from wrenchgap.learn.data.opening import OpenFlight as OpenFlight
    from wrenchgap.learn.design.design_result import Design as Design
    from wrenchgap.learn.design.manoeuvres import Limits as Limits
    from wrenchgap.learn.diagnose.model_checks import LogReport as LogReport
    from wrenchgap.learn.diagnose.where import Where as Where
    from wrenchgap.learn.identify.add import Addition as Addition
    from wrenchgap.learn.identify.learning import Learnt as Learnt
    from wrenchgap.learn.identify.trend import Trend as Trend
    from wrenchgap.learn.posterior.explain import Explanation as Explanation
    from wrenchgap.learn.posterior.explain import Verdict as Verdict
    from wrenchgap.learn.process.gp import FitSettings as FitSettings
    from wrenchgap.learn.process.gp import GaussianProcess as GaussianProcess
