"""From flights to models: measured wrench, residuals, parameters of effects, Gaussian processes.

data       flights opened, filtered, stacked, cut into blocks of time; predictions and their errors
process    Gaussian processes of what a model leaves
diagnose   timing, where a model fails and what its error depends on
identify   effects fitted, added, tested on flights that were not fitted
posterior  which sets of effects are missing, how sure that is, what would settle it
design     flights that separate effects
"""

import lazy_loader

from wrenchgap._lazy import callable_as

callable_as(__name__, "learn_gp")
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
