"""Effects with values as text, `com_offset=x:0.004,y:-0.007`: parsed, checked for a vehicle, put into a model."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model, make_effect
from wrenchgap.plant.model_file import provenance_now
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel


def parse_value(text: str) -> tuple[str, dict[str, float] | list[float]]:
    """`com_offset=x:0.004,y:-0.007` by name or `com_offset=0.004,-0.007,0` in order; UsageError on anything else."""
    name, equals, rest = text.partition("=")
    parts = [part.strip() for part in rest.split(",") if part.strip()]
    if not (name and equals and parts):
        raise UsageError(f"{text!r}: expected EFFECT=PARAMETER:VALUE,... e.g. com_offset=x:0.004,y:-0.007")
    named = [pair for part in parts if len(pair := re.split(r"[:=]", part, maxsplit=1)) == 2]
    if len({key.strip() for key, _ in named}) < len(named):
        raise UsageError(f"{text!r}: a parameter is given twice; say it once")
    if len(named) == len(parts):
        return name.strip(), {key.strip(): _number(value, text) for key, value in named}
    if named:
        raise UsageError(f"{text!r}: give all parameters by name, or all in order")
    return name.strip(), [_number(part, text) for part in parts]


def _number(value: str, text: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise UsageError(f"{text!r}: {value.strip()!r} is not a number") from None


def effect_of_text(model: Model, text: str) -> ModelEffect:
    """The effect that a text like `servo_lag=tau:0.05` describes; parameters that are not named are zero.

    Raises ModelError for unknown names, with a list of the known ones.
    """
    name, values = parse_value(text)
    vehicle = model.without_tolerances.vehicle  # a truth may contradict what the file is sure of
    parameters = find(name).parameters(vehicle)
    if isinstance(values, dict) and set(values) <= {p.name for p in parameters}:
        values = {p.name: 0.0 for p in parameters} | values
    effect = make_effect(model.vehicle, name, values)
    for parameter, value in zip(parameters, effect.theta, strict=True):
        if value != 0.0 and not parameter.low <= value <= parameter.high:
            raise ModelError(
                f"effect {name}: {parameter.name} = {value:g} {parameter.unit} is not plausible for "
                f"{model.vehicle.name}; expected {parameter.low:.3g} to {parameter.high:.3g}"
            )
    return effect


def with_values(model: Model, texts: Sequence[str]) -> Model:
    """The model with effects of given values, in place of its own of the same names."""
    source = provenance_now("set by hand")
    return model.with_replaced(replace(effect_of_text(model, text), provenance=source) for text in texts)


def with_hidden(model: Model, texts: Sequence[str]) -> Model:
    """The model with further effects; values add to those of an effect that it has already."""
    truth = replace(model, history=())
    for text in texts:
        new = effect_of_text(model, text)
        truth = truth.with_replaced([replace(new, theta=truth.theta(new.name) + new.theta)])
    return truth


def drawn(model: WrenchModel, rng: np.random.Generator) -> WrenchModel:
    """The model with its effects' values drawn within their standard deviations, and what is plausible."""
    effects = []
    for one in model.effects:
        if one.std is not None:
            low, high = np.array([(p.low, p.high) for p in one.effect.parameters(model.vehicle)]).T
            value = one.theta + np.nan_to_num(one.std) * rng.standard_normal(len(one.theta))
            one = replace(one, theta=np.clip(value, np.minimum(low, one.theta), np.maximum(high, one.theta)))
        effects.append(one)
    return WrenchModel(model.vehicle, tuple(effects))


def with_drawn_inertia(model: WrenchModel, rng: np.random.Generator) -> WrenchModel:
    """The model with moments of inertia drawn within the tolerances of its vehicle; as it is without any, and with an
    effect that says them.
    """  # noqa: D205
    tolerance = model.vehicle.tolerances.inertia
    if tolerance is None or any(e.name == "inertia" for e in model.effects):
        return model
    change = np.concatenate((np.diag(tolerance) * rng.standard_normal(3), np.zeros(3)))
    low, high = np.array([(p.low, p.high) for p in find("inertia").parameters(model.vehicle)]).T
    drawn_now = make_effect(model.vehicle, "inertia", np.clip(change, low, high))
    return WrenchModel(model.vehicle, (*model.effects, drawn_now))


def with_load(model: Model, payload: float) -> WrenchModel:
    """The model with a mass [kg] more at its centre of mass."""
    if payload == 0.0:
        return model.wrench_model
    body, known = model.wrench_model.body, {e.name: e for e in model.effects}
    more = make_effect(model.vehicle, "payload", [payload, *body.com_B])
    if own := known.pop("payload", None):  # both at the place of their common centre
        total = own.theta[0] + payload
        more = replace(more, theta=np.array([total, *((own.theta[0] * own.theta[1:] + payload * body.com_B) / total)]))
    return WrenchModel(model.vehicle, (*known.values(), more))


def in_wind(model: WrenchModel, speed: float, rng: np.random.Generator) -> WrenchModel:
    """The model in air that moves with this speed [m/s], level, in a direction of chance: that of the day when it was
    fitted has gone.
    """  # noqa: D205
    angle = rng.uniform(0.0, 2.0 * np.pi)
    air = make_effect(model.vehicle, "wind", [speed * np.cos(angle), speed * np.sin(angle)])
    return WrenchModel(model.vehicle, (*(e for e in model.effects if e.name != "wind"), air))


@dataclass(frozen=True)
class WeakRotor:
    """A rotor, by its parameter, and the share `lost` of its thrust."""

    rotor: str
    lost: float


def weakened_rotors(effects: Sequence[ModelEffect], weak: float = 0.1, sure: float = 3.0) -> tuple[WeakRotor, ...]:
    """Rotors that an effect of a model says have lost thrust, the worst first.

    From `weak` on, far beyond what sound propellers differ by (some 3 %), and `sure` standard deviations.
    """
    found = []
    for one in effects:
        if one.name == "rotor_thrust":
            std = np.zeros(len(one.theta)) if one.std is None else np.nan_to_num(one.std)
            lost = np.flatnonzero((one.theta <= -weak) & (-one.theta > sure * std))
            found += [WeakRotor(f"rotor_{k}", float(-one.theta[k])) for k in lost]
    return tuple(sorted(found, key=lambda one: -one.lost))
