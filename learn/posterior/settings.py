"""What a search over sets of effects decides by: one list, for `explain`, `changed` and fleets.

What half and twice of each does to answers is measured: docs/search-settings.md.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """Numbers of the likelihood, of the search, and of what is said of its result.

    Those of the likelihood (`learn.posterior.spectrum`, `learn.posterior.score`):

    block           length of the blocks of time [s]: longer than a vehicle answers, short enough that there are many
    sensors_worth   values that the sensors' own spectrum is worth as the prior of the noise's
    price           log odds against every further effect of a set
    shown           values that count for each block, band and axis of what exceeds the sensors' noise: what errs there
                    errs the same way in every coefficient
    leak            share of force, or of torque, that any cause has on axes on which its law has none: axes are never
                    quite square, vehicles never quite symmetric
    doubt           share of what laws may be off by that counts where a set fits to the noise; else all of it
    loud            mean square of a block, over the median of the blocks, beyond which its weight falls: a hand, a gust
    structure       rms over that of the sensors from which on what is left is no noise: a disturbance where commands
                    answer it, else something that no set explains

    Those of the search (`learn.posterior.subset_search`, `learn.posterior.posterior`), where larger ones cost time:

    beam            best sets that are changed further in each round
    promising       effects that are tried in the place of another, or beside the others
    weighed         best sets that are scored with the noise unknown, and weighed
    contenders      sets that are linearised anew in one round
    behind          log odds behind the best set up to which another may turn out better when both are linearised anew
    far_behind      the same of the plainest sets, and those with another effect in moving air: a bend may hide them
    plainest        of the plainest sets, so many; plain are those that are best if fits count `fit_counts`
    fit_counts      share of a fit that counts where the bend of effects may have taken the rest
    moved           log odds by which straight lines are wrong of a set, from which on the search is repeated around it;
                    up to which behind the heaviest set one with another effect in the place of one is looked at

    Those of what is said (`learn.posterior.scored_sets`, `learn.posterior.equivalence_classes`):

    firm            share of the weight from which on a name is firm
    otherwise       share of its class from which on a set keeps the names that it lacks from being firm
    certain         largest probability that is stated: no catalogue is complete
    indistinct      difference of two predictions, in standard errors, that flights cannot show
    at_limit        trust in an effect that others push to the limit of what is plausible: something else is pushing
    evident         evidence (sum over axes of log of rms ratios) from which on such an effect is named all the same
    rough           accuracy beyond which the form of a law is an assumption
    off             such a law may have made what another member makes up to so many times its accuracy
    """

    block: float = 2.5
    sensors_worth: float = 2.0
    price: float = 3.0
    shown: float = 2.0
    leak: float = 0.02
    doubt: float = 0.3
    loud: float = 5.0
    structure: float = 2.5
    beam: int = 7
    promising: int = 5
    weighed: int = 30
    contenders: int = 6
    behind: float = 15.0
    far_behind: float = 200.0
    plainest: int = 3
    fit_counts: float = 0.2
    moved: float = 5.0
    firm: float = 0.9
    otherwise: float = 0.05
    certain: float = 0.98
    indistinct: float = 3.0
    at_limit: float = 0.6
    evident: float = 1.5
    rough: float = 0.05
    off: float = 3.0


DEFAULT = SearchSettings()
"""Of `explain` and fleets."""
CHANGES = SearchSettings(behind=12.0, indistinct=2.0)
"""Of `changed`."""
