"""What an exported step costs: operations at worst and usually, and memory."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from wrenchgap.compensate.fast import Plan, compensation_of, sizes_of
from wrenchgap.compensate.kernels import PULLS, ROUNDS
from wrenchgap.compensate.tables import Room, layout
from wrenchgap.replay.export.c_lines import Code, Counts

KINDS = ("add", "multiply", "divide", "sqrt", "exp", "trig", "other")
"""Operations, in the order of the tables; `exp` counts logarithms too, `trig` sine, cosine and atan2, `other`
comparisons, absolute values and signs."""


@dataclass(frozen=True)
class Cost:
    """Operations (`KINDS`) of a step `at_worst` and as it went in the recorded steps (`usual`), and bytes.

    tables    constants, in read-only memory
    memory    a `wg_memory`
    stack     upper bound: the room of a period, and every number of the longest piece of physics at once
    evaluations_usual, evaluations_worst   of the model in a step
    """

    at_worst: dict[str, int]
    usual: dict[str, int]
    evaluations_usual: float
    evaluations_worst: int
    tables: int
    memory: int
    stack: int


@dataclass(frozen=True)
class Pieces:
    """The generated functions; None without physics."""

    fixed: Code | None
    moving: Code | None
    sent: Code | None


def evaluations(plan: Plan) -> tuple[int, int]:
    """Evaluations of the physics alone, and of everything, in one step at worst: two searches and zero each."""
    both = plan.gate.has_process and plan.gate.has_physics
    each = 2 * plan.gate.most + 1
    return (each if both else 0), each


def _scaled(counts: Counts, factor: float) -> Counts:
    return Counter({kind: round(number * factor) for kind, number in counts.items()})


def _process(plan: Plan) -> tuple[Counts, Counts]:
    """Operations of the mean with its derivatives, and of sigma."""
    if plan.expansion is None:
        return Counter(), Counter()
    outputs, points, inputs = plan.expansion.points.shape
    distances = Counter(add=2 * inputs * points, multiply=inputs * points, divide=2 * inputs)
    mean = distances + Counter(multiply=3 * points, exp=points, add=points)
    mean += Counter(add=3 * inputs, multiply=inputs, divide=inputs)
    mean += Counter(add=2 * outputs * points, multiply=outputs * points, divide=4 * outputs)
    pairs = points * (points + 1) // 2 if plan.expansion.triangular else points * points
    sigma = distances + Counter(multiply=2 * points, exp=points, sqrt=1, divide=1)
    sigma += Counter(add=pairs + points, multiply=pairs + points)
    return _scaled(mean, outputs), _scaled(sigma, outputs)


def _reach(plan: Plan) -> tuple[Counts, Counts]:
    """Operations of looking whether a wrench is within reach, and of the search for the nearest that is."""
    table = plan.reach.table
    limits, arms = len(table.rows), len(table.middle)
    looking = Counter(add=6 * limits + 5 * arms, multiply=6 * limits + 3 * arms, divide=6 + arms, trig=arms, sqrt=arms)
    looking += Counter(other=2 * limits + 3 * arms)
    turn = looking + Counter(add=14 * limits + 36, multiply=6 * limits + 36, divide=2 * arms, trig=4 * arms, sqrt=arms)
    return looking, _scaled(turn, ROUNDS) + _scaled(looking + Counter(add=12, multiply=6), PULLS)


def _newton(size: int) -> Counts:
    """Operations of one proposal: normal equations, Cholesky, two triangular systems."""
    cube = size**3
    return Counter(add=cube + size * size, multiply=cube + size * size, divide=size * size, sqrt=size, other=8 * size)


def cost(plan: Plan, pieces: Pieces, usual: float, number: int, table_numbers: int) -> Cost:
    """The cost of a step; `usual` is the mean number of evaluations, `number` the bytes of one number."""
    size = len(plan.gate.rows)
    alone, whole = evaluations(plan)
    mean, sigma = _process(plan)
    physics = pieces.moving.counts if pieces.moving else Counter()
    around = Counter(sigma)
    for piece in (pieces.fixed, pieces.sent):
        around += piece.counts if piece else Counter()
    each = physics + _newton(size)
    looking, finding = _reach(plan)
    around += _scaled(looking, 3)
    worst = _scaled(each, alone) + _scaled(each + mean, whole + 1) + around + _scaled(finding, 2)
    share = whole / (alone + whole)
    often = _scaled(each, usual * (1 - share)) + _scaled(each + mean, usual * share + 1) + around
    memory = 6 * 6 + 2 + (plan.physics.arms + plan.physics.memory if plan.physics else 0) + 1
    sizes = sizes_of(plan, compensation_of(plan)) | {"WG_FIXED": pieces.fixed.numbers if pieces.fixed else 0}
    room = sum(math.prod(sizes[n] if isinstance(n, str) else n for n in entry.shape) for entry in layout(Room))
    functions = [p.numbers for p in (pieces.fixed, pieces.moving, pieces.sent) if p]
    frames = 250  # numbers of the calls themselves: locals, arguments, saved registers, of ten functions at most
    stack = room + sizes["WG_ROW"] + max([0, *functions]) + frames
    return Cost(
        at_worst={kind: worst[kind] for kind in KINDS},
        usual={kind: often[kind] for kind in KINDS},
        evaluations_usual=usual,
        evaluations_worst=alone + whole,
        tables=table_numbers * number,
        memory=memory * number,
        stack=stack * number,
    )
