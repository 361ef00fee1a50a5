"""Which flights the benchmark makes: one hidden effect over sizes, two at once, none, and what is in no catalogue."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from benchmarks.hidden_effects.hidden import HIDDEN

Kind = Literal["one", "two", "none", "outside"]

OUTSIDE = ("slung_load", "slosh", "compass", "resonance", "ringing")
"""Effects that the catalogue does not have."""
SIZES = (0.03, 0.1, 0.25, 0.5, 1.0, 2.0)
"""In units of each effect's own middling size."""
SMALL = 0.25
"""Sizes below this are there to find where naming ends; scores of single effects are of this size and larger."""
LARGEST = {
    "payload": 1.6,
    "wake": 1.6,
    "body_drag": 1.6,
    "imu_moved": 2.0,
    "slosh": 1.5,
    "resonance": 1.5,
    "heavy_arms": 1.0,
    "ringing": 1.3,
}
"""Beyond this the engine's autopilot loses the vehicle, or the effect is absurd."""
PAIRS = (
    ("com_offset", "weak_rotor"),
    ("com_offset", "servo_lag"),
    ("com_offset", "tether"),
    ("wake", "com_offset"),
    ("wake", "command_delay"),
    ("thin_air", "tilt_offset"),
    ("mass", "inertia"),
    ("battery", "com_offset"),
    ("imu_turned", "weak_rotor"),
    ("jet", "motor_lag"),
    ("inflow", "tilt_offset"),
    ("payload", "servo_lag"),
    ("flapping", "thin_air"),
    ("droop", "coaxial_loss"),
)
ELSEWHERE = {"ground": "low", "body_drag": "fast", "edgewise": "fast", "compass": "turn"}
"""Trajectories other than the excitation flight that an effect needs to show at all."""
UNSEEN = {"train": "figure8", "fast": "fast", "low": "low", "turn": "turn", "figure8": "train"}
"""Where what was found on one trajectory is tested: another one, or another seed of the only one that shows it."""


@dataclass(frozen=True)
class Case:
    """One flight. `scales` multiply the effects' middling sizes."""

    kind: Kind
    effects: tuple[str, ...]
    scales: tuple[float, ...]
    trajectory: str
    seed: int
    seconds: float = 30.0
    split: float = 0.0
    crisp: bool = False

    @property
    def name(self) -> str:
        """Unique in the list."""
        hidden = "+".join(f"{e}x{s:g}" for e, s in zip(self.effects, self.scales, strict=True)) or "none"
        return f"{hidden}.{self.trajectory}.{self.seed}{'.crisp' if self.crisp else ''}"

    @property
    def sizes(self) -> tuple[float, ...]:
        """In the effects' own units."""
        return tuple(HIDDEN[e].size * s for e, s in zip(self.effects, self.scales, strict=True))


def _one(effect: str, kind: Kind, scale: float, seed: int) -> Case:
    hidden = HIDDEN[effect]
    split = 0.3 if hidden.needs_split else 0.0
    return Case(kind, (effect,), (scale,), ELSEWHERE.get(effect, "train"), seed, split=split)


def everything(seed: int = 5000) -> Iterator[Case]:
    """The whole benchmark; every flight has a seed of its own, counted from `seed`."""
    for effect in HIDDEN:
        kind: Kind = "outside" if effect in OUTSIDE else "one"
        sizes = (1.0, LARGEST.get(effect, 2.0)) if kind == "outside" else SIZES
        flown: set[float] = set()
        for scale in sizes:
            seed += 1
            possible = min(scale, LARGEST.get(effect, 2.0))
            if possible not in flown:
                flown.add(possible)
                yield _one(effect, kind, possible, seed)
    for pair in PAIRS:
        seed += 1
        yield Case("two", pair, (1.0, 1.0), "train", seed, seconds=40.0)
    for trajectory in ("train", "pitch", "figure8", "steps", "hover", "fast", "low", "turn"):
        for crisp in (True, False):
            seed += 1
            yield Case("none", (), (), trajectory, seed, crisp=crisp)


def fast() -> Iterator[Case]:
    """What runs with the tests: every kind, what `tests/learn/test_explain.py` does not fly itself."""
    for effect, seed in (("com_offset", 901), ("weak_rotor", 902), ("wake", 903), ("thin_air", 906)):
        yield _one(effect, "one", 1.0, seed)
    yield Case("two", ("com_offset", "weak_rotor"), (1.0, 1.0), "train", 911)
    yield _one("resonance", "outside", 1.0, 922)
    yield Case("none", (), (), "train", 931, crisp=True)
