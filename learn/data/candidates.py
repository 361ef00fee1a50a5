"""Which effects are tried: the one place that decides it, of what an effect needs and what model and flights have.

Of the catalogue, or of the names that a user gave, an effect is tried unless

    the model has another form of it
    it needs what model or logs lack                `inapplicable`
    the flights cannot show it                      `unexcited`: never that fast, that low ...
    the model file knows what it is about           `plant.effects.effect.Effect.known`: a mass that was weighed
    it is air that moves, and no effect through     alone it has no force (`plant.effects`)
        which the air acts is tried or in the model
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from wrenchgap.flight.errors import FitError, ModelError
from wrenchgap.learn.data.measurement import Record
from wrenchgap.plant.effects import acting_effects, catalogue, family, find
from wrenchgap.plant.effects.effect import SensorEffect
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import ModelEffect


class Lack(StrEnum):
    """Why an effect cannot be tried."""

    ARMS = "arms"  # the model file describes none
    TILT = "tilt"  # no arm tilts
    COAXIAL = "coaxial"  # no arm has two rotors
    GEOMETRY = "geometry"  # whatever else an effect asks of the vehicle
    ROTORS = "rotors"  # commands of the rotors
    POSE = "pose"
    IMU = "imu"  # the motion comes from the odometry
    VOLTAGE = "voltage"
    EXCITATION = "excitation"  # the flights cannot show it
    AIR = "air"  # nothing through which the air would act
    KNOWN = "known"  # the model file knows the number well
    FOLLOWING = "following"  # the motion follows the commands on no axis
    FIT = "fit"  # no physically possible values were found


@dataclass(frozen=True)
class Untried:
    """An effect that is not tried, and why; `detail` is what the effect, the model file or the fit says itself."""

    effect: str
    lack: Lack
    detail: str = ""

    @property
    def reason(self) -> str:
        """The reason without the effect's name, as errors and results quote it."""
        return REASONS.get(self.lack, self.detail)

    def __str__(self) -> str:
        return f"effect {self.effect}: {self.reason}"


REASONS = {
    Lack.ARMS: "needs rotors: the model file has no [[vehicle.arms]]",
    Lack.TILT: "needs arms that tilt, and none does",
    Lack.COAXIAL: "needs two rotors on one arm, and no arm has them",
    Lack.ROTORS: "needs rotor commands: the log has none and the model file no arms to allocate to",
    Lack.POSE: "needs pose and velocity; map them with --topic odometry=/your/topic",
    Lack.IMU: "needs an IMU: rates and forces of this log come from the odometry; map one with --topic imu=/your/topic",
    Lack.AIR: "has no force of its own: needs an effect through which the air acts, and none can be tried",
    Lack.FOLLOWING: "commands answer the motion on every axis: a fitted lag would be the controller's own phase",
    Lack.VOLTAGE: "needs the battery voltage; map it with --topic battery=/your/topic",
}
"""In words; where there are none, `Untried.detail` has them."""


def inapplicable(name: str, model: Model, records: Sequence[Record]) -> Untried | None:
    """Why this effect cannot be evaluated on these records, None if it can. Raises ModelError for an unknown name."""
    effect, vehicle = find(name), model.vehicle
    if (effect.needs_rotors or effect.needs_tilt or effect.needs_coaxial) and not vehicle.has_rotors:
        return Untried(name, Lack.ARMS)
    arms, _ = vehicle.geometry() if vehicle.has_rotors else (None, None)
    if effect.needs_tilt and arms is not None and not arms.tilts.any():
        return Untried(name, Lack.TILT)
    try:
        effect.parameters(vehicle)
    except ModelError as error:
        return Untried(name, Lack.COAXIAL if effect.needs_coaxial else Lack.GEOMETRY, str(error))
    if effect.needs_rotors and any(r.commands.rotor_speed is None for r in records):
        return Untried(name, Lack.ROTORS)
    if effect.needs_pose and not all(r.has_pose for r in records):
        return Untried(name, Lack.POSE)
    if isinstance(effect, SensorEffect) and not all(r.has_imu for r in records):
        return Untried(name, Lack.IMU)
    if effect.needs_voltage and not all(r.has_voltage for r in records):
        return Untried(name, Lack.VOLTAGE)
    return None


def unexcited(name: str, model: Model, records: Sequence[Record]) -> Untried | None:
    """Why these flights cannot show this effect although it could be fitted, None if they can."""
    effect = find(name)
    reasons = [effect.unexcited(model.wrench_model.context(r.state)) for r in records]
    if any(reason is None for reason in reasons):
        return None
    return Untried(name, Lack.EXCITATION, str(reasons[0]))


def check_effects(effects: Sequence[ModelEffect], model: Model, records: Sequence[Record]) -> None:
    """Raise FitError, in one line, where one of the effects needs what a log lacks: rotors, pose, an IMU or voltage."""
    for item in effects:
        for record in records:
            reason = inapplicable(item.name, model, [record])
            if reason is not None:
                raise FitError(
                    f"{record.flight}: {reason}; or take the effect out of the model with "
                    f"`wrenchgap remove {item.name}`"
                )


@dataclass(frozen=True)
class Candidates:
    """Names to try, and what is not tried with the reason."""

    tried: tuple[str, ...]
    untried: tuple[Untried, ...]


def candidates(records: Sequence[Record], model: Model, names: Sequence[str] = ()) -> Candidates:
    """The effects to try on these records, among `names` where there are any.

    What the model has already is tried as a change of its values. Raises ModelError for unknown names.
    """
    present = {e.name for e in model.effects}
    taken = {n for n in catalogue() if family(n) in {family(p) for p in present}} - present
    wanted = [n for n in (names or catalogue()) if n not in taken]
    reasons = {n: inapplicable(n, model, records) or unexcited(n, model, records) for n in wanted}
    reasons |= {n: known(n, model) for n in wanted if reasons[n] is None and n not in present}
    tried = [n for n in wanted if reasons[n] is None]
    acting = acting_effects(tried, [e.name for e in model.effects])
    reasons |= {n: Untried(n, Lack.AIR) for n in tried if n not in acting}
    untried = tuple(u for n in wanted if (u := reasons[n]) is not None)
    return Candidates(tuple(acting), untried)


def known(name: str, model: Model) -> Untried | None:
    """Where the model file knows what an effect is about."""
    why = find(name).known(model.vehicle)
    return None if why is None else Untried(name, Lack.KNOWN, why)
