"""What a search over sets of effects decides by: one list, for `explain`, `changed` and fleets.

What half and twice of each does to answers is measured: docs/search-settings.md.
"""

from dataclasses import dataclass

from wrenchgap.flight.arguments import check_types
from wrenchgap.flight.errors import UsageError

SHARES = ("leak", "doubt", "fit_counts", "firm", "otherwise", "certain", "at_limit", "rough")


@dataclass(frozen=True)
class SearchSettings:
    """Numbers of the likelihood, of the search, and of what is said of its result."""

    # The likelihood: learn.posterior.spectrum, learn.posterior.score
    block: float = 2.5
    """Length of the blocks of time [s]: longer than a vehicle answers, short enough that there are many."""
    sensors_worth: float = 2.0
    """Values that the sensors' own spectrum is worth as the prior of the noise's."""
    price: float = 3.0
    """Log odds against every further effect of a set."""
    shown: float = 2.0
    """Values that count for each block, band and axis of what exceeds the sensors' noise: what errs there errs the same
    way in every coefficient."""
    leak: float = 0.02
    """Share of force, or of torque, that any cause has on axes on which its law has none: axes are never quite square,
    vehicles never quite symmetric."""
    doubt: float = 0.3
    """Share of what laws may be off by that counts where a set fits to the noise; else all of it."""
    loud: float = 5.0
    """Mean square of a block, over the median of the blocks, beyond which its weight falls: a hand, a gust."""
    structure: float = 2.5
    """Rms over that of the sensors from which on what is left is no noise: a disturbance where commands answer it, else
    something that no set explains."""

    # The search: learn.posterior.subset_search, learn.posterior.posterior; larger ones cost time
    beam: int = 7
    """Best sets that are changed further in each round."""
    promising: int = 5
    """Effects that are tried in the place of another, or beside the others."""
    weighed: int = 30
    """Best sets that are scored with the noise unknown, and weighed."""
    contenders: int = 6
    """Sets that are linearised anew in one round."""
    behind: float = 15.0
    """Log odds behind the best set up to which another may turn out better when both are linearised anew."""
    far_behind: float = 200.0
    """The same of the plainest sets, and those with another effect in moving air: a bend may hide them."""
    plainest: int = 3
    """So many of the plainest sets: those that are best if fits count `fit_counts`."""
    fit_counts: float = 0.2
    """Share of a fit that counts where the bend of effects may have taken the rest."""
    moved: float = 5.0
    """Log odds by which straight lines are wrong of a set, from which on the search is repeated around it; up to which
    behind the heaviest set one with another effect in the place of one is looked at."""

    # What is said: learn.posterior.scored_sets, learn.posterior.posterior
    firm: float = 0.9
    """Share of the weight from which on a name is firm."""
    otherwise: float = 0.05
    """Share of its class from which on a set keeps the names that it lacks from being firm."""
    certain: float = 0.98
    """Largest probability that is stated: no catalogue is complete."""
    indistinct: float = 3.0
    """Difference of two predictions, in standard errors, that flights cannot show."""
    at_limit: float = 0.6
    """Trust in an effect that others push to the limit of what is plausible: something else is pushing."""
    evident: float = 1.5
    """Evidence (sum over axes of log of rms ratios) from which on such an effect is named all the same."""
    rough: float = 0.05
    """Accuracy beyond which the form of a law is an assumption."""
    off: float = 3.0
    """Such a law may have made what another member makes up to so many times its accuracy."""

    def __post_init__(self) -> None:
        check_types(type(self), vars(self))
        for name, value in vars(self).items():
            most = 1.0 if name in SHARES else 1e12  # beyond which squares are no numbers
            if not 0.0 < value <= most:
                raise UsageError(f"SearchSettings: {name}: got {value:g}; expected more than 0 and at most {most:g}")


DEFAULT = SearchSettings()
"""Of `explain` and fleets."""
CHANGES = SearchSettings(behind=12.0, indistinct=2.0)
"""Of `changed`."""
