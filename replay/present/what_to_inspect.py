"""What to look at on the vehicle after something was found: a sentence for each effect, in the user's names."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.autopilot import Autopilot
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.changed.changed import AT_ONCE, Changed, Verdict
from wrenchgap.learn.changed.places import Place, towards
from wrenchgap.learn.changed.priors import ROTOR_THRUST
from wrenchgap.learn.changed.sizes import Size
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.posterior.explain import Explanation
from wrenchgap.learn.posterior.posterior import NamedSet
from wrenchgap.learn.posterior.settings import DEFAULT
from wrenchgap.plant.effects import family
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.replay.present import fitted_effects
from wrenchgap.replay.present.numbers import AXIS_HEADS, number, quantity, share, side_of, size_in_words, unit_of


@dataclass(frozen=True)
class InspectionThresholds:
    """Which places are named."""

    sure: float = 0.9
    """Probability of one place from which on no other is named."""
    likely: float = 0.05
    """Probability from which on a place is worth a look."""
    perhaps: float = 2.0
    """Standard deviations of a change that is not established from which on a look is worth it: M1 had 1.7 for M3."""
    nearer: float = 1.4
    """Times by which the mean torque of healthy flights is farther from the model than that of suspect ones where the
    two sides may be exchanged. Of 16 pairs of real flights: 1.6 to 2.1 where they were and a propeller was cut by 2 mm
    or more, 0.5 to 0.7 where they were not, 0.8 to 1.2 without such a change."""


INSPECTION = InspectionThresholds()

PARTS = {
    "rotor_thrust": "its propeller for cuts, cracks and dirt, its motor for drag, its mount for play",
    "tilt_offset": "the servo horn and its screw, and the servo's zero",
}
"""What to look at on one rotor or arm."""
ACTIONS = {
    "accelerometer_bias": "calibrate the accelerometer, and look at what is mounted beside it",
    "imu_misalignment": "look at the IMU's mounting: has it turned?",
    "imu_lever_arm": "look at the IMU's mounting: has it moved?",
    "motor_lag": "look at motors, bearings and speed controllers: rotors follow their commands differently",
    "tilt_scale": "command every arm to two angles and measure them (servos, gears, linkages); or the log scales them",
    "servo_lag": "look at the tilt servos, their supply voltage and their load",
    "backlash": "hold the hull and rock every arm by hand: gears and horns of the tilt servos have play",
    "arm_twist": "twist every arm by hand: one or several have become softer",
    "command_delay": "look at the link and the load of the flight computer (commands may arrive later), and at the "
    "low-pass and the stamps of the IMU (it may be later)",
    "thrust_scale": "look at the battery and at all propellers: all thrust together has changed",
    "battery_sag": "measure the battery's voltage under load beside the log's (a voltmeter that is off does the same)",
    "thrust_fade": "measure the battery's internal resistance, and its voltage under load",
    "thrust_curve": "look at the settings of the speed controllers",
    "mass": "weigh the vehicle",
    "inertia": "look at what was moved or mounted far from the middle",
    "tether": "look for cables and ropes that pull",
    "wind": "compare the wind on the days of the flights",
    "body_drag": "look at covers and payload that catch the air",
    "drag_torque": "check that all propellers are of one type, and mounted the right way round",
}
"""What to do, by family, where an effect is of no single rotor or arm."""
YAW_BIAS = "a twisted motor mount or arm, then propellers of two kinds"
"""What to look for where the motors of one turning direction work harder."""
LOADS = ("com_offset", "payload", "mass", "accelerometer_bias", "imu_misalignment", "command_delay", "tilt_scale")
"""Those of which a model that lacks them says that something is to be looked at."""
NOTHING = "Nothing is established that asks for an inspection; a smaller change may stay unseen."
MORE = "Look at what was touched between these flights; `wrenchgap trend` of all of them tells when it came."
PERHAPS = "Nothing is established to inspect; a look at {0} costs little: it is where the likeliest change would be."
REGAINED = (
    "{0} lifts more than on the healthy flights: its propeller is new, or flights with damage were given as the "
    "healthy ones. Then exchange the two sides, which says the size better, and inspect {0}: {1}"
)
NO_NAME = (
    "Something is different that the catalogue has no name for: look at everything that was touched between the "
    "flights, and fly the suspect vehicle with excitation on all axes."
)
LOG_ALIKE = "Fly the suspect vehicle again, with the IMU logged as on the healthy flights."

TO_TELL = "A flight with excitation on all axes tells which of them it is."


def likeliest(found: Changed) -> NamedSet | None:
    """The heaviest set of changes where nothing is established, if less than half of the weight is on no change."""
    if found.verdict is not Verdict.NOTHING or found.nothing >= 0.5:
        return None
    sets = sorted((s for c in found.classes for s in c.sets if s.names), key=lambda s: -s.weight)
    return sets[0] if sets else None


def sentences(found: Changed) -> list[str]:
    """What to inspect, the most significant first."""
    if found.verdict is Verdict.NOTHING:
        likely = likeliest(found)
        alone = [] if likely is None else [a.largest for a in found.alone if a.effect in likely.names]
        clear = [one.where for one in alone[:1] if one.where and one.significance > INSPECTION.perhaps]
        return [PERHAPS.format(clear[0]) if clear else MORE if beyond_these(found) else NOTHING]
    if found.verdict is Verdict.CHANGED and len(found.names) > AT_ONCE:
        return [NO_NAME]
    out = []
    if found.verdict is Verdict.UNKNOWN:
        unlike = bool(found.louder and unlike_rates(found))
        out += _of_constant_change(found) or [LOG_ALIKE if unlike else NO_NAME]
    for name in dict.fromkeys(p.effect for p in sorted(found.parameters, key=lambda p: -p.significance)):
        listed = [p for p in found.parameters if p.effect == name]
        said = _of(found, name, listed, [p for p in found.places if p.effect == name])
        out += [f"{said}."] if said else []
    return out


def of_explanation(found: Explanation) -> list[str]:
    """What to inspect after `explain`: where a firm effect is a defect or a load, which no drag and no lag is.

    Of rotors the weakest, of servos the one that is off most.
    """
    vehicle, out = found.model.vehicle, []
    for name in found.firm:
        values, had = found.changes(name), name in found.given
        if name in PARTS and values:
            sizes = {n: -v if name == "rotor_thrust" else abs(v) for n, v in values.items()}
            one = max(sizes, key=lambda n: sizes[n])
            out += [f"Inspect {located(vehicle, one)}: {PARTS[name]}."] if sizes[one] > 0.0 else []
        elif name in LOADS:
            is_so = "has moved since the model was fitted" if had else "is off"
            out.append(f"{_of_whole(name, values, vehicle, is_so)}.")
    constant = next((m for m in found.members if m.name == "constant_wrench"), None)
    if constant is not None:
        logs = [f.flight.autopilot for f in found.flights]
        by = {
            v.name: v.value
            for v in found.fit.values(constant.name)
            if abs(v.value) > SIGNIFICANCE.alone * (v.std or 0.0)
        }
        begins = "What would make such a constant wrench"
        if found.confidence(constant) >= DEFAULT.firm:
            begins = "What makes such a constant wrench, this does not tell"
        causes = causes_of_constant(by, vehicle, trim(logs))
        if causes and fitted_effects.is_independent_of_thrust(found):
            begins = begins.partition(",")[0]
            causes = [
                "a cable, a rope or what else pulls at it; it does not grow with the thrust, as it would by a "
                "centre of mass, weak propellers or a mounting"
            ]
        out += [f"{begins}: {'; '.join(causes)}."] if causes else []
    return out


def located(vehicle: Vehicle, part: str, *also: str) -> str:
    """A rotor or an arm by its name, where it is as seen from the centre of mass, and what else is said of it.

    Such as "M4 (front left, lower rotor)".
    """
    kind, _, number = part.partition("_")
    if vehicle.arms is None or vehicle.rotors is None or kind not in ("arm", "rotor"):
        return " ".join([vehicle.called(part), *(f"({words})" for words in also)])
    on_arm = vehicle.rotors.arm
    arm = int(number) if kind == "arm" else int(on_arm[int(number)])
    x, y = vehicle.arms.position_B[arm, :2] - vehicle.body.com_B[:2]
    where = side_of(x, y)
    said = [] if where in vehicle.called(part).replace("_", " ") else [where]
    if kind == "rotor" and np.count_nonzero(on_arm == arm) > 1:
        height = vehicle.rotors.offset[on_arm == arm]
        said.append(f"{'upper' if vehicle.rotors.offset[int(number)] == height.max() else 'lower'} rotor")
    more = ", ".join([*said, *also])
    return f"{vehicle.called(part)} ({more})" if more else vehicle.called(part)


def granted(found: Explanation, begins: str) -> str:
    """What the flights share on average that the model's scatter between flights allows, the most unusual first."""
    if not found.granted:
        return ""
    one = found.granted[0]
    causes = causes_of_constant({AXES[g.axis]: g.mean for g in found.granted}, found.model.vehicle)
    usual = (
        "flights of this vehicle differ by" if found.model.between_flights else "thrust axes as unsure as these make"
    )
    return (
        f"{begins}on {AXES[one.axis]} these flights are off by {size_in_words(one.mean, unit_of(one.axis))} on "
        f"average, {one.ratio:.2g} times what {usual}{': ' * bool(causes)}{'; '.join(causes)}"
    )


TRIMS = {
    ("AHRS_TRIM_X", "AHRS_TRIM_Y"): ("rad", "to compare with the log's"),
    ("SENS_BOARD_X_OFF", "SENS_BOARD_Y_OFF"): ("deg", "on top of the log's"),
}
"""Parameters by which an autopilot is told of its mounting, their unit, and whether the logged IMU is without them, as
ArduPilot's is, or turned by them already, as PX4's is."""


def trim(logs: Sequence[Autopilot | None]) -> str:
    """What the parameters of all these logs say of the autopilot's mounting; empty where they differ or say nothing."""
    for names, (own_unit, words) in TRIMS.items():
        had = {tuple(float(one.parameters.get(n, np.nan)) for n in names) if one else None for one in logs}
        if len(had) == 1 and (values := had.pop()) is not None and np.isfinite(values).all():
            degrees = np.degrees(values) if own_unit == "rad" else values
            return f"{words} " + ", ".join(f"{n} {number(d, 2)} deg" for n, d in zip(names, degrees, strict=True))
    return ""


def _of_constant_change(found: Changed) -> list[str]:
    """The same of a constant wrench that changed, on axes where it is beyond chance, and of the thrust."""
    by = {p.name: p.change for p in constant_changes(found)}
    causes = causes_of_constant(by, found.model.vehicle)
    if "force_z" in by:
        more = by["force_z"] / (found.model.vehicle.body.mass * GRAVITY)
        said = f"{share(abs(more))} {'more' if more > 0.0 else 'less'} thrust than commanded"
        causes.append(f"{said}: {ACTIONS['thrust_scale'].partition(':')[0]}, and weigh the vehicle")
    return [f"Inspect what makes such a change: {'; '.join(causes)}. {TO_TELL}"] if causes else []


def constant_changes(found: Changed) -> list[Size]:
    """Components of a constant wrench that changed beyond chance, the most significant first."""
    clear = [p for p in found.parameters if p.effect == "constant_wrench" and p.significance > SIGNIFICANCE.alone]
    return sorted(clear, key=lambda p: -p.significance)


def causes_of_constant(by: Mapping[str, float], vehicle: Vehicle, mounting: str = "") -> list[str]:
    """What makes a constant wrench with these components [N, Nm]; `mounting` is what logs say of the autopilot's."""
    weight, causes = vehicle.body.mass * GRAVITY, []
    if by.keys() & {"torque_x", "torque_y"}:
        x, y = by.get("torque_y", 0.0) / weight, -by.get("torque_x", 0.0) / weight
        off = size_in_words(float(np.hypot(x, y)), "m")
        causes.append(f"a centre of mass {off} towards the {towards(vehicle, x, y)}, or weak propellers there")
    if "torque_z" in by:
        causes.append(f"a yaw bias of {size_in_words(by['torque_z'], 'Nm')}: look for {YAW_BIAS}")
    if tilt := float(np.hypot(by.get("force_x", 0.0), by.get("force_y", 0.0))) / weight:
        logged = f" ({mounting})" if mounting else ""
        causes.append(f"an autopilot mounted {np.degrees(tilt):.2g} deg off the rotors' plane{logged}, or wind")
    return causes


def _is_stronger(listed: Sequence[Size]) -> bool:
    """Whether the clearest of these changes is that of a rotor which lifts more."""
    clearest = max(listed, key=lambda p: p.significance, default=None)
    return clearest is not None and clearest.effect == ROTOR_THRUST and clearest.change > 0.0


def exchanged(found: Changed) -> str:
    """Both sides of flights the other way round, for a command.

    Empty where a rotor got weaker, or none stronger and healthy flights are as near to the model as suspect ones.
    """
    rotors = [p for p in found.parameters if p.effect == ROTOR_THRUST]
    if not (_is_stronger(rotors or found.parameters) or (not rotors and suspects_are_nearer(found))):
        return ""
    sides: list[list[str]] = [[], []]
    for one in found.flights:
        sides[one.records[0].flight in found.suspect].append(str(one.flight.path))
    return f"{shlex.join(sides[0])} --healthy {shlex.join(sides[1])}"


def _of(found: Changed, name: str, listed: list[Size], places: list[Place]) -> str:
    if places:
        likely = (
            places[:1]
            if places[0].probability >= INSPECTION.sure
            else [p for p in places if p.probability >= INSPECTION.likely]
        )
        shares = [() if len(likely) == 1 else (share(p.probability),) for p in likely]
        vehicle = found.model.vehicle
        which = " or ".join(located(vehicle, p.parameter, *own) for p, own in zip(likely, shares, strict=True))
        if _is_stronger(listed):
            return REGAINED.format(which, PARTS[name])
        return f"Inspect {which}: {PARTS.get(name, 'what is mounted there')}"
    return _of_whole(name, {p.name: p.change for p in listed}, found.model.vehicle, "has moved")


def _of_whole(name: str, by: Mapping[str, float], vehicle: Vehicle, is_so: str) -> str:
    """Of an effect of no single rotor or arm, with its values by parameter; empty where there is nothing to do."""
    if name in ("com_offset", "payload"):
        x, y = by.get("x", 0.0), by.get("y", 0.0)
        side, far = towards(vehicle, x, y), size_in_words(float(np.hypot(x, y)), "m")
        mass = f", {quantity(by['mass'], 'kg')}" if "mass" in by else ""
        return f"Inspect the battery and what is mounted{mass}: the centre of mass {is_so} by {far} towards the {side}"
    words = ACTIONS.get(family(name), "")
    return f"{words[0].upper()}{words[1:]} ({name})" if words else ""


def unlike_rates(found: Changed, most: float = 1.5) -> str:
    """That the IMU came at another rate, by this factor, which alone may make a larger error; empty where not."""
    rates: dict[bool, list[float]] = {True: [], False: []}
    for one in found.flights:
        if one.flight.imu is not None:
            rates[one.records[0].flight in found.suspect].append(1.0 / one.flight.imu.period)
    if not rates[True] or not rates[False]:
        return ""
    suspect, healthy = (float(np.median(rates[side])) for side in (True, False))
    if max(suspect, healthy) < most * min(suspect, healthy):
        return ""
    return (
        f"their IMU came at {suspect:.3g} Hz, that of the healthy flights at {healthy:.3g} Hz, which alone may make it."
    )


def unclear(found: Changed) -> str:
    """That no change is beyond what so few healthy flights leave open; empty where one is."""
    if found.is_clear:
        return ""
    few = f"{len(found.healthy)} healthy flight{'s do' if len(found.healthy) > 1 else ' does'}"
    nearer = " The suspect flights fit the model better than the healthy ones: are the two sides exchanged?"
    return (
        f" Not established: {few} not say how much flights differ; give more of them."
        f"{nearer if suspects_are_nearer(found) else ''}"
    )


def suspects_are_nearer(found: Changed) -> bool:
    """Whether the model fits the mean torque of the suspect flights better than that of the healthy ones.

    In units of what flights differ by, beyond that (a distance of 3 in three numbers: 3 %) and `INSPECTION.nearer`.
    """
    healthy, suspect = (
        float(np.linalg.norm(np.mean([r.mean[3:] / found.scatter[3:] for r in found.rows if r.role == role], axis=0)))
        for role in ("healthy", "suspect")
    )
    return healthy > max(INSPECTION.nearer * suspect, suspect + 3.0)


def beyond_these(found: Changed, chance: float = 0.01) -> str:
    """Where suspect flights are beyond what these healthy ones differ by, and not beyond what flights usually do.

    By Student's t of the flights' means with a probability of `chance` on any of six axes; at least three healthy
    flights, and a change larger than the usual scatter.
    """
    from scipy.stats import t as student  # here: few answers need it, and it loads slowly

    healthy, suspect = (np.array([r.mean for r in found.rows if r.role == role]) for role in ("healthy", "suspect"))
    if len(healthy) < 3 or not len(suspect):
        return ""
    apart = np.abs(suspect.mean(axis=0) - healthy.mean(axis=0))
    own = healthy.std(axis=0, ddof=1)
    error = own * np.sqrt(1.0 / len(healthy) + 1.0 / len(suspect))
    clear = (apart > student.isf(chance / 12.0, len(healthy) - 1) * error) & (apart > found.scatter) & (own > 0.0)
    if not clear.any():
        return ""
    k = int(np.argmax(np.where(clear, apart / found.scatter, 0.0)))
    these, usual = apart[k] / own[k], apart[k] / found.scatter[k]
    return (
        f" Their mean {AXIS_HEADS[k]} differs by {these:.2g} times what these {len(healthy)} healthy flights differ by "
        f"among themselves, and {usual:.2g} times what is usual: more healthy flights would tell."
    )
