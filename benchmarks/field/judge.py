"""One flight flown, explained and judged; a row of plain values.

What is read from an answer: `verdict`, `members` with their confidence, and, where the `Explanation` has them, `firm`
(names) and `classes` (each with `weight` and `sets`, each set with `effects` or `names`). Without them a name is firm
from `FIRM` confidence on, and the class is what the members and their groups make together.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from itertools import islice, product
from typing import Any

import numpy as np

from benchmarks.field import hexarotor
from benchmarks.field.cases import Case
from benchmarks.field.told import AIRS, BIASED, BIASES, Names, Told, families
from wrenchgap import explain, open_flights
from wrenchgap.flight.flight import Flight
from wrenchgap.learn import Explanation
from wrenchgap.plant import model_file
from wrenchgap.plant.effects import family
from wrenchgap.plant.model import Model

Row = dict[str, Any]
TELL = 5.0
"""Amplitude over its standard deviation from which a regression with the true laws can tell an effect."""
FIRM = 0.8
"""Stated confidence from which a name counts as firm where the answer does not say which are."""
TOGETHER = " + "
"""Between names that stand in one another's place only together."""
MOST_SETS = 4096
"""Sets of names that are written out from groups."""


def run(case: Case) -> Row:
    """Fly, explain, judge."""
    flight, told, model = flown(case)
    start = time.process_time()
    found = explain(open_flights(flight, model), model, jobs=1)
    seconds = time.process_time() - start
    return {
        "case": case.name,
        "vehicle": case.vehicle,
        "flying": case.flying,
        "imu": case.imu,
        "kind": case.kind,
        "hidden": list(case.effects),
        "amplitudes": None if told.amplitudes is None else list(told.amplitudes),
        **judged(found, told, case.kind),
        "cpu_per_minute": seconds * 60.0 / case.seconds,
        "left": found.left,
        "rms_before": np.nan_to_num(found.rms_before).tolist(),
        "rms_after": np.nan_to_num(found.rms_after).tolist(),
        "noise": np.nan_to_num(found.noise).tolist(),
    }


def flown(case: Case) -> tuple[Flight, Told, Model]:
    """The flight, what was there, and the model file that its user has."""
    if case.vehicle == "hexa":
        lists = tuple(hexarotor.answers(e) for e in case.effects)
        near = frozenset(name for e in case.effects for name in hexarotor.near(e))
        anyway = families({*hexarotor.HAS_ANYWAY, *BIASED[case.imu], *(AIRS if case.flying == "turbulence" else ())})
        told = Told(tuple(tuple(families(s) for s in sets) for sets in lists), anyway, families(near), None)
        return hexarotor.flown(case), told, model_file.load("tilt_hexarotor")
    from benchmarks.field import quadrotor  # needs RotorPy

    return quadrotor.flown(case)


def judged(found: Explanation, told: Told, kind: str) -> Row:
    """What the scores need to know of an answer.

    `in_class`: some set of the answer's heaviest class says everything that was hidden and nothing else (but what is
    there `anyway`, and the IMU's bias). `firm_wrong`: firm names that are neither hidden, nor there anyway, nor near;
    where firm is what was stated with confidence, that was of the name or its group. `told`: whether a regression with
    the true laws could tell each hidden effect.
    """
    sets = list(islice(class_sets(found), MOST_SETS))
    accepted = told.anyway | told.near | frozenset(n for sets in told.answers for s in sets for n in s)
    choices = product(*told.answers) if all(told.answers) else ()
    truths = [t for choice in choices for t in in_fewer_words(frozenset().union(*choice))]
    firm, groups = firm_names(found), spoken(found)
    listed = getattr(found, "firm", None) is not None
    wrong = [n for n in firm if not (families((n,)) if listed else groups[n]) & accepted]
    return {
        "verdict": str(found.verdict),
        "effects": list(found.effects),
        "groups": [list(g) for g in found.groups],
        "firm": list(firm),
        "firm_wrong": wrong,
        "named_beside": [name for name in found.effects if family(name) not in told.anyway],
        "in_class": None if kind in ("none", "outside") else any(says(s, truths, told.anyway) for s in sets),
        "told": None if told.amplitudes is None or not told.answers else min(told.amplitudes) >= TELL,
        "stated": [[name, p, bool(groups[name] & accepted)] for name, p in confidences(found)],
    }


def in_fewer_words(truth: Names) -> list[Names]:
    """The truth, and with a payload for it and the masses beside it: a mass or a centre of mass beside a payload makes
    another payload of it, whose four parameters are exactly those.
    """  # noqa: D205
    masses = {"mass", "com_offset"}
    return [truth, truth - masses] if "payload" in truth and truth & masses else [truth]


def says(named: Names, truths: Iterable[Names], anyway: Names) -> bool:
    """Whether a set of names is one of the truths, with no more than what is there anyway and an IMU's bias."""
    return any(truth <= named and named - truth <= anyway | frozenset(BIASES) for truth in truths)


def class_sets(found: Explanation) -> Iterator[Names]:
    """Sets of families in the answer's heaviest class."""
    classes = getattr(found, "classes", None)
    if classes:
        heaviest = max(classes, key=lambda c: c.weight)
        yield from (families(getattr(s, "effects", None) or s.names) for s in heaviest.sets)
        return
    groups = {g[0]: g for g in found.groups}
    for choice in product(*(groups.get(m, (m,)) for m in found.effects)):
        yield families(name for words in choice for name in words.split(TOGETHER))


def spoken(found: Explanation) -> dict[str, Names]:
    """By member: the families that its confidence speaks for, its own and its group's."""
    groups = {g[0]: g for g in found.groups}
    return {m: families(n for words in groups.get(m, (m,)) for n in words.split(TOGETHER)) for m in found.effects}


def firm_names(found: Explanation) -> tuple[str, ...]:
    """Names that the answer stands for."""
    firm = getattr(found, "firm", None)
    if firm is not None:
        return tuple(firm)
    return tuple(name for name, p in confidences(found) if p >= FIRM)


def confidences(found: Explanation) -> list[tuple[str, float]]:
    """(name, stated confidence) of every member."""
    return [(m.name, float(found.confidence(m))) for m in found.members]
