"""Stepwise choice of effects by what they do on held-out time: the search of `learn.identify.calibrate`."""

from collections.abc import Sequence

import numpy as np

from wrenchgap.flight.arguments import Progress
from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Array, Mask
from wrenchgap.learn.data.blocks import Contrast, contrast, significant
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.identify.fit import Fit, fit, held_out
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model


def of_actuators(name: str) -> bool:
    """Whether it is how actuators follow in time, which is all that is trimmed of commands."""
    return find(name).place == "commands"


class Stepwise:
    """One search. Afterwards `fit` is that of what was chosen; `t` (of all that were tried), `single` (help within
    flights only), `stuck` (end at a limit) and `unsure` (may be nothing) say why others were not.
    """  # noqa: D205

    def __init__(self, data: Dataset, model: Model, report: Progress, following: Sequence[int]) -> None:
        self.data, self.model, self.report = data, model, report
        self.following = data.measured_axes & np.isin(np.arange(6), following)
        self.fit = fit(data, model, ())
        self.given = self.left = held_out(data, model, (), self.fit)
        self.t: dict[str, float] = {}
        self.single: set[str] = set()
        self.stuck: set[str] = set()
        self.unsure: set[str] = set()
        self.superfluous: set[str] = set()
        self.steps = 0

    def chosen(self, names: Sequence[str]) -> tuple[str, ...]:
        """The effects that help, in the order in which they were found."""
        kept: list[str] = []
        ahead = list(names)
        while (best := self._best(kept, ahead)) is not None:
            ahead = [n for n in ahead if n != best]
            self._refit([*kept, best])
            kept = self._pruned([*kept, best])
            while self.fit.stuck:  # it goes for good, and what it replaced is tried again; so may others that it held
                self.stuck |= self.fit.stuck
                kept = [name for name in kept if name not in self.stuck]
                ahead += [name for name in names if name in self.superfluous and name not in ahead]
                self.superfluous.clear()
                self._refit(kept)
        self.unsure = {name for name in kept if not significant(self.fit.from_nothing(name))}
        if self.unsure:  # beside which no other could take what they explain
            kept = [name for name in kept if name not in self.unsure]
            self._refit(kept)
        return tuple(kept)

    def _refit(self, kept: Sequence[str]) -> None:
        self.fit = fit(self.data, self.model, kept, start=self.fit)
        self.left = held_out(self.data, self.model, kept, self.fit)

    def _best(self, kept: Sequence[str], ahead: Sequence[str]) -> str | None:
        """The effect that helps most beside those that are kept, None where none does."""
        found: list[tuple[float, str]] = []
        for name in ahead:
            self.steps += 1
            self.report(0.9 * (1.0 - 0.97**self.steps), f"trying {name}")
            try:
                one = fit(self.data, self.model, [*kept, name], base=self.fit)
            except FitError:
                continue
            if one.stuck:
                self.stuck.add(name)
                continue
            self.stuck.discard(name)
            left = held_out(self.data, self.model, [*kept, name], one, exact=False)
            gain = self._contrast(name, self.left, left)
            self.t[name] = gain.t
            if not significant(gain.t):
                continue
            if self._holds(name, one, kept):
                self.single.discard(name)
                found.append((gain.difference, name))
            else:
                self.single.add(name)
        return max(found)[1] if found else None

    def _axes(self, name: str) -> Mask:
        """On which an effect is judged (6,)."""
        return self.following if of_actuators(name) else self.data.measured_axes

    def _contrast(self, name: str, before: Array, after: Array) -> Contrast:
        worse, better = (self.data.evidence(self.given, each) for each in (before, after))
        return contrast(self.data, worse, better, axes=self._axes(name))

    def _holds(self, name: str, one: Fit, kept: Sequence[str]) -> bool:
        """Whether it helps on whole flights that were left out, on most of them and in sum; true of one flight."""
        flight = self.data.flight
        if flight.max() == 0:
            return True
        known, gains = self._axes(name), []
        before = held_out(self.data, self.model, kept, self.fit, groups=flight)
        after = held_out(self.data, self.model, [*kept, name], one, groups=flight)
        before, after = (self.data.evidence(self.given, left) for left in (before, after))
        for f in range(int(flight.max()) + 1):  # by how much the mean square falls, each axis in its own scale
            old, new = (np.mean(r[flight == f][:, known] ** 2, axis=0) for r in (before, after))
            gains.append(float(np.sum((old - new) / np.maximum(np.sqrt(old * new), 1e-30))))
        return sum(gains) > 0.0 and 2 * sum(g > 0.0 for g in gains) > len(gains)

    def _pruned(self, kept: list[str]) -> list[str]:
        """Without what the last one made superfluous: what replaces it has to be one that may stay itself."""
        for name in kept[:-1]:
            rest = [n for n in kept if n != name]
            one = fit(self.data, self.model, rest, start=self.fit)
            gain = self._contrast(name, held_out(self.data, self.model, rest, one), self.left)
            self.t[name] = gain.t
            admissible = not one.stuck and significant(one.from_nothing(kept[-1]))
            if admissible and not significant(gain.t):
                self.superfluous.add(name)
                self._refit(rest)
                return self._pruned(rest)
        return kept
