"""Sets linearised anew where they fit best together, and the search repeated around them.

Straight lines that were taken of each candidate by itself say little of a set in which a lag is large: what is late of
the others changes, and the lag itself bends.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.blocks import LEAST_EVIDENCE
from wrenchgap.learn.parallel import each
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.score import Keys, Scorer
from wrenchgap.learn.posterior.sets import Contender, search
from wrenchgap.learn.posterior.table import Ground
from wrenchgap.learn.posterior.together import Noise, alongside, linearised_together, spectrum_of, together
from wrenchgap.plant.effects import find

BENT = 5.0
"""Log odds by which a set that is linearised anew differs, from which on the search is repeated around it."""
DOUBTED = 0.25
"""Share of the least evidence for a name from which on a member is asked for with the rest linearised anew."""


def linearised(on: Ground, linear: Scorer, sets: Sequence[Keys], jobs: int) -> list[Contender | None]:
    """`linearised_together` of these sets, by `jobs` processes."""
    bare = {c: linear.spectrum.columns[c].bare() for c in dict.fromkeys(c for k in sets for c in k)}
    lines = {k: ([bare[c] for c in k], [linear(k).theta[c] for c in k]) for k in sets}
    by_name = {" | ".join(k): k for k in sets}
    noise = Noise(linear.reference, linear.spectrum.factors)

    def work(name: str) -> Contender | None:
        columns, theta = lines[by_name[name]]
        return linearised_together(on, columns, theta, noise)

    return list(each(work, list(by_name), jobs, (on.data.root, on.model)))


def likeliest(anew: dict[Keys, Contender | None]) -> Contender | None:
    """Of the sets that were linearised anew."""
    known = [c for c in anew.values() if c is not None]
    return max(known, key=lambda c: c.scored.log_probability, default=None)


def bent(linear: Scorer, contender: Contender) -> bool:
    """Whether a set that was linearised anew is likelier, or less likely, than straight lines had it."""
    return abs(contender.scored.log_probability - linear(contender.keys).log_probability) > BENT


def near(keys: Keys, centre: Keys) -> bool:
    """Whether columns that were linearised in a set hold in another: it has its lags and delays, behind which all were;
    of a set without any it lacks one member at most, and has two of them.
    """  # noqa: D205
    if late := set(of_time(centre)):
        return late <= set(keys)
    missing, shared = set(centre) - set(keys), set(centre) & set(keys)
    return len(missing) <= 1 and len(shared) >= 2


def holds(keys: Keys, centre: Keys, scorer: Scorer, anew: dict[Keys, Contender | None]) -> bool:
    """Whether straight lines around a set may be trusted without the member of it that another set lacks: not where the
    rest, linearised anew, turned out less likely than they had it.
    """  # noqa: D205
    rest = tuple(k for k in centre if k in keys)
    found = anew.get(rest) if len(rest) < len(centre) else None
    return found is None or found.scored.log_probability > scorer(rest).log_probability - BENT


def around(on: Ground, linear: Scorer, centre: Contender, jobs: int) -> Scorer:
    """The search again, with the members of a set linearised where they fit best together, at the same noise. Beside a
    lag all others are linearised anew, too: what comes late of them is not what they are beside none.
    """  # noqa: D205
    on.data.forget()
    columns = linear.spectrum.columns
    bare = {k: c.bare() for k, c in columns.items()}
    members = [bare[k] for k in centre.keys]
    theta = [centre.scored.theta[k] for k in centre.keys]
    moved = {c.key: c.put_away() for c in together(on, members, theta)}
    if of_time(centre.keys):
        others = [k for k in columns if k not in centre.keys and k not in of_time(columns)]

        def work(key: str) -> Column | None:
            try:
                return alongside(on, members, theta, bare[key])
            except (ModelError, np.linalg.LinAlgError):  # an inertia that no body has, say
                return None

        moved |= {c.key: c.put_away() for c in each(work, others, jobs, (on.data.root, on.model)) if c is not None}
    on.data.forget()
    spectrum = spectrum_of(on, [moved.get(k, c) for k, c in columns.items()])
    spectrum.calm(linear.spectrum.factors)
    scorer = Scorer(spectrum, linear.reference)
    search(scorer, jobs=jobs)
    scorer(centre.keys)
    return scorer


def doubtful(heavy: Contender) -> list[Keys]:
    """A set without each of the members that it hardly needs, as far as straight lines can tell."""
    columns = {" + ".join(p.names): p for p in heavy.parts}
    doubted = [k for k in heavy.keys if DOUBTED * LEAST_EVIDENCE < columns[k].evidence <= LEAST_EVIDENCE]
    return [rest for gone in doubted if (rest := tuple(k for k in heavy.keys if k != gone))]


def with_rests(
    on: Ground, linear: Scorer, heavy: Sequence[Contender], anew: dict[Keys, Contender | None], jobs: int
) -> dict[str, Array]:
    """Take into heavy sets, the heaviest first, what they leave without each of their members, as it is where those
    rests were linearised anew: straight lines of lags, far from where they were taken, can bend into what the member
    did. Where a set's own rest was not, by as much more as of the heaviest whose was. `anew` has them then; returns
    those factors by member (`Contender.bends`).
    """  # noqa: D205
    rests = {keys: c.left for keys, c in anew.items() if c is not None}
    bends: dict[str, Array] = {}
    noise = Noise(linear.reference, linear.spectrum.factors)
    columns = {k: linear.spectrum.columns[k].bare() for k in dict.fromkeys(k for c in heavy for k in c.keys)}

    def again(sets: Sequence[Contender], known: Mapping[str, Array]) -> None:
        by_name = {" | ".join(c.keys): c for c in sets}

        def work(name: str) -> Contender | None:
            c = by_name[name]
            theta = [c.scored.theta[k] for k in c.keys]
            return linearised_together(on, [columns[k] for k in c.keys], theta, noise, rests, known)

        found = each(work, list(by_name), jobs, (on.data.root, on.model))
        anew.update((c.keys, new) for c, new in zip(sets, found, strict=True) if new is not None)

    mine = [c for c in heavy if c.keys in anew and asked(c, rests, bends, own=True)]
    again(mine, {})
    for c in reversed(mine):
        bends |= (anew[c.keys] or c).bends
    done = {c.keys for c in mine}
    theirs = [c for c in heavy if c.keys in anew and c.keys not in done and asked(c, rests, bends, own=False)]
    again(theirs, dict(bends))
    return bends


def asked(heavy: Contender, rests: Mapping[Keys, Array], bends: Mapping[str, Array], *, own: bool) -> bool:
    """Whether more is known of a doubtful member of a set: its own rest, or, not `own`, how that of another bends."""
    for rest in doubtful(heavy):
        gone = next(k for k in heavy.keys if k not in rest)
        if (rest in rests) if own else (rest not in rests and gone in bends):
            return True
    return False


def of_time(columns: Iterable[str]) -> list[str]:
    """Lags and delays: far from straight lines, so that they are tried in each other's place."""
    return [k for k in columns if all(find(n).place == "commands" for n in k.split(" + "))]
