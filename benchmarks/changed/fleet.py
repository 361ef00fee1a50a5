"""Vehicles whose flights differ among themselves, what is changed on some of them, and in which sizes.

RotorPy flies the quadrotors and the octorotor (`benchmarks.field`), MuJoCo the tilting hexarotor
(`benchmarks.hidden_effects`). The model is wrong in all flights alike (`BUILT`); no two flights are alike (`SCATTER`);
a changed flight differs by one thing more.
"""

from __future__ import annotations

import pickle
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array, Flight

VEHICLES = ("nano", "quad", "x8", "hexa")
TUNING, PUBLISHED = 20000, 21000
"""First seeds; nobody tunes on the published ones."""
SECONDS = 15.0
ROTOR, PLACE, AIR, MOUNT, WIND = 0.005, 0.01, 0.01, 0.1, 0.5
"""One standard deviation between flights: thrust of each rotor (1), place of the centre of mass forward and to the
left (arms; a third of it upwards), thrust of all rotors (battery, air; 1), mounting of the IMU about each axis (deg),
wind in each level direction (m/s)."""
SCATTER = {"rotor": ROTOR, "place": PLACE, "air": AIR, "mount_deg": MOUNT, "wind": WIND}
BUILT = {"thrust": 0.95, "place": 0.03, "lag": 0.02, "drag": 0.01}
"""In all flights, and not in the model: 5 % less thrust, a centre of mass 3 % of the arm forward, motors that follow in
20 ms, rotors that drag by 1 % of the weight per m/s. The hexarotor has servos of 15 ms and arms with inertia instead of
the last two."""

Graded = tuple[str, str, tuple[float, ...]]
_WEAK: Graded = ("weak_rotor", "of one rotor's thrust", (0.02, 0.04, 0.08, 0.16))
_BESIDE: Graded = ("beside", "of the arm, centre of mass", (0.02, 0.04, 0.08, 0.16))
_HEAVIER: Graded = ("heavier", "of the mass", (0.01, 0.02, 0.04, 0.08))
_DRAG: Graded = ("rotor_drag", "of the weight per m/s", (0.01, 0.02, 0.04, 0.08))
_TURNED: Graded = ("imu_turned", "deg", (0.5, 1.0, 2.0, 4.0))
GRADED: dict[str, tuple[Graded, ...]] = {
    "nano": (_WEAK, _BESIDE, _HEAVIER),
    "quad": (_WEAK, _BESIDE, _HEAVIER, _DRAG, _TURNED),
    "x8": (_WEAK, _BESIDE, _DRAG),
    "hexa": (
        _WEAK,
        ("com_offset", "of the arm, centre of mass", (0.01, 0.02, 0.04, 0.08)),
        ("mass", "of the mass", (0.01, 0.02, 0.04, 0.08)),
        ("servo_zero", "deg, one arm", (0.5, 1.0, 2.0, 4.0)),
        ("body_drag", "m^2", (0.02, 0.04, 0.08, 0.16)),
        _TURNED,
    ),
}
"""What is changed, in which unit, in which sizes, by vehicle."""
HEALTHY = {"nano": 7, "quad": 7, "x8": 7, "hexa": 7}
"""Healthy flights."""
REPEATS = {"nano": 1, "quad": 1, "x8": 1, "hexa": 1}
"""Changed flights of each size."""
CHANGED_FROM = 100
"""Seeds of changed flights count from there, those of healthy ones from the first seed."""
UNITS = {"weak_rotor": 0.10, "beside": 0.06, "heavier": 0.06, "rotor_drag": 0.025, "imu_turned": 2.0}
"""What scale 1 of `benchmarks.field.hidden` is."""


@dataclass(frozen=True)
class Case:
    """One flight: healthy where `effect` is "none". Everything random about it is drawn from `seed`."""

    vehicle: str
    effect: str
    size: float
    seed: int
    seconds: float = SECONDS

    @property
    def name(self) -> str:
        """Unique."""
        return f"{self.vehicle}.{self.effect}.{self.size:g}.{self.seed}"


def healthy(vehicle: str, first_seed: int) -> list[Case]:
    """Flights of a vehicle on which nothing is changed."""
    return [Case(vehicle, "none", 0.0, first_seed + k) for k in range(HEALTHY[vehicle])]


def changed(vehicle: str, first_seed: int) -> list[Case]:
    """Flights on which something is; every one with a seed of its own."""
    seed = first_seed + CHANGED_FROM
    out = []
    for effect, _, sizes in GRADED[vehicle]:
        for size in sizes:
            for _ in range(REPEATS[vehicle]):
                out.append(Case(vehicle, effect, size, seed))
                seed += 1
    return out


@dataclass(frozen=True)
class Hidden:
    """What is there: names of the catalogue that are right for it, and parameters of the first of them."""

    answers: tuple[str, ...]
    effect: str
    parameters: dict[str, float]


NOTHING = Hidden((), "", {})


def flown(case: Case, folder: Path | None = None) -> tuple[Flight, Hidden]:
    """The flight and what was changed on it; kept in `folder`, where it is found the next time."""
    kept = None if folder is None else folder / f"{case.name}.{case.seconds:g}.pickle"
    if kept is not None and kept.exists():
        with kept.open("rb") as file:
            return pickle.load(file)  # type: ignore[no-any-return]
    out = _hexa(case) if case.vehicle == "hexa" else _rotors(case)
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.with_suffix(".part").write_bytes(pickle.dumps(out))
        kept.with_suffix(".part").rename(kept)
    return out


def usual(seed: int, rotors: int) -> dict[str, Any]:
    """What this flight differs by from others of its vehicle, in `SCATTER`'s units."""
    rng = np.random.default_rng([seed, 61])
    return {
        "gains": (1.0 + AIR * rng.normal()) * (1.0 + ROTOR * rng.normal(size=rotors)),
        "place": PLACE * rng.normal(size=3) * np.array((1.0, 1.0, 1.0 / 3.0)),
        "mount": np.radians(MOUNT) * rng.normal(size=3),
        "wind": WIND * rng.normal(size=3) * np.array((1.0, 1.0, 0.0)),
    }


def _rotors(case: Case) -> tuple[Flight, Hidden]:
    """A vehicle that RotorPy flies."""
    from benchmarks.field.engine import fly, recorded  # needs RotorPy
    from benchmarks.field.hidden import HIDDEN
    from benchmarks.field.sensors import measured
    from benchmarks.field.truth import Truth
    from benchmarks.field.vehicles import GRAVITY, vehicle

    built = vehicle(case.vehicle)
    differs = usual(case.seed, built.rotors)
    weight = built.mass * GRAVITY
    per_rotor = weight / (built.rotors * built.hover_speed)
    healthy = (
        Truth(built)
        .with_params(k_d=BUILT["drag"] * per_rotor)
        .but(
            gains=BUILT["thrust"] * differs["gains"],
            com_B=built.arm * (np.array((BUILT["place"], 0.0, 0.0)) + differs["place"]),
            imu_rotvec=differs["mount"],
            tau=(BUILT["lag"], BUILT["lag"]),
            wind_E=differs["wind"],
        )
    )
    truth, hidden = healthy, NOTHING
    if case.effect != "none":
        rng = np.random.default_rng([case.seed, 31])
        truth = HIDDEN[case.effect].change(healthy, case.size / UNITS[case.effect], rng)
        names = tuple(sorted({n for answer in HIDDEN[case.effect].answers for n in answer}))
        hidden = Hidden(names, *_difference(healthy, truth))
    for seed in range(case.seed, case.seed + 500_000, 100_000):  # a flight that was lost is flown on another course
        with suppress(UsageError):
            seen = fly(truth, "excited", case.seconds, seed)
            break
    else:
        raise UsageError(f"{case.name}: lost on five courses")
    return measured(recorded(seen, truth, case.name), "good", case.seed), hidden


def _difference(healthy: Any, truth: Any) -> tuple[str, dict[str, float]]:
    """The change as parameters of the catalogue, of a rotor's thrust relative to what it was."""
    lost = truth.thrust_gains / healthy.thrust_gains - 1.0
    if np.any(lost):
        k = int(np.argmin(lost))
        return "rotor_thrust", {f"rotor_{k}": float(lost[k])}
    moved, turned = truth.com_B - healthy.com_B, truth.imu_rotvec
    if np.any(moved):
        return "com_offset", _xyz(moved)
    if np.any(turned != healthy.imu_rotvec):
        return "imu_misalignment", _xyz(turned)
    if truth.param("mass") != healthy.param("mass"):
        return "mass", {"added": float(truth.param("mass") - healthy.param("mass"))}
    return "rotor_drag", {}


def _xyz(values: Array) -> dict[str, float]:
    return dict(zip("xyz", (float(v) for v in values), strict=True))


def _hexa(case: Case) -> tuple[Flight, Hidden]:
    """The tilting hexarotor."""
    from benchmarks.changed.hexarotor import Usual, added, servo_zero
    from benchmarks.field.sensors import measured
    from benchmarks.hidden_effects.engine import fly

    also: list[Any] = [Usual(usual(case.seed, 12), BUILT["thrust"], BUILT["place"])]
    names: tuple[str, ...] = ()
    hidden = NOTHING
    if case.effect == "servo_zero":
        turned, hidden = servo_zero(case.size, case.seed)
        also.insert(0, turned)
    elif case.effect != "none":
        names = (case.effect,)
    sizes = case.size * (0.30 if case.effect == "com_offset" else 1.0)
    flight, truth = fly(names, (sizes,) if names else None, "train", case.seconds, case.seed, noise=0.0, also=also)
    if names:
        hidden = added(case.effect, truth.parameters[case.effect], truth.answers[0])
    return measured(flight, "good", case.seed), hidden
