"""What a model says in the quantities that other programs have parameters for, and how well it knows them.

Taken from the model as it acts, not from the names of its effects: mass properties with the effects on the body; of
each rotor its part of the wrench in still air (all rotors as in hover, less the same without this one); drag from the
wrench at a few speeds; the thrust curve from commands to lift. An effect that somebody adds to the catalogue is in it,
and what an effect moves is found by leaving it out. Only time constants and delays are taken by name.

Standard deviations are those of the effects' values, to first order and without their correlations,
sqrt(sum_i (dq/dtheta_i sigma_i)^2). A quantity without one was not identified: it is as the model file has it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.model import Model
from wrenchgap.plant.state import Commands, Motion, State, concatenated
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel, cross

Values = dict[str, Array]
"""Quantities by name, `values_of`."""
REST = np.zeros((1, 3))
UPRIGHT, REVERSED = np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])
"""Level, heading along x of E, and the other way: what pushes the same in B is fixed in the body."""
HEIGHT = 1000.0
"""[m], at which no ground is felt."""
SPEEDS = (2.0, 4.0)
"""Velocities [m/s] from which drag is taken: those of missions, where its linear and its quadratic part differ."""
FLOWN = np.linspace(0.7, 1.3, 13)
"""Speeds and commands, relative to hover, over which the thrust curve is taken: what flights of identification use."""
LAGS = {"motor_lag": ("tau", "tau"), "asymmetric_motor_lag": ("tau_up", "tau_down")}
"""Effects with time constants up and down, and the names of these."""


@dataclass(frozen=True, eq=False)
class Quantity:
    """A quantity of a model: its value, that of the model without effects, the standard deviation; all of one shape.

    `by` are the names of the effects that move it.
    """

    value: Array
    nominal: Array
    std: Array
    by: tuple[str, ...] = ()

    @property
    def identified(self) -> bool:
        """Whether a fitted effect moves it."""
        return bool(np.any(self.std > 1e-9 * np.abs(self.value).max()))  # rounding is no deviation


def quantities(model: Model) -> dict[str, Quantity]:
    """The quantities of a model (`values_of`) with their standard deviations; ModelError for one without rotors."""
    return propagated(model, lambda effects: values_of(model, effects))


def propagated(model: Model, of: Callable[[Sequence[ModelEffect]], Values]) -> dict[str, Quantity]:
    """What a function makes of the effects of a model, with standard deviations and the effects that move each value.

    Effects of the air and of the battery are left out (still air, nominal voltage), and those at a limit (`at_limit`).
    """

    def evaluated(effects: Sequence[ModelEffect]) -> Values:
        return {name: np.asarray(value, dtype=float) for name, value in of(effects).items()}

    own = acting_effects(model)
    value, nominal = evaluated(own), evaluated([])
    variance = {name: np.zeros_like(array) for name, array in value.items()}
    by: dict[str, list[str]] = {name: [] for name in value}
    for k, one in enumerate(own):
        without = evaluated([*own[:k], *own[k + 1 :]])
        for name in value:
            rounding = 1e-12 * float(np.abs(np.nan_to_num(value[name])).max())
            if not np.allclose(without[name], value[name], rtol=1e-9, atol=rounding, equal_nan=True):
                by[name].append(one.name)
        std = np.zeros_like(one.theta) if one.std is None else np.nan_to_num(one.std)
        for i in np.flatnonzero(std > 0.0):
            step = 0.5 * std[i] * (np.arange(len(std)) == i)
            ends = [
                evaluated([*own[:k], replace(one, theta=one.theta + sign * step), *own[k + 1 :]]) for sign in (-1, 1)
            ]
            for name in value:
                variance[name] += (ends[1][name] - ends[0][name]) ** 2
    return {n: Quantity(value[n], nominal[n], np.sqrt(variance[n]), tuple(by[n])) for n in value}


def acting_effects(model: Model) -> list[ModelEffect]:
    """The effects of a model that act in still air at the nominal voltage, and are at no limit."""
    still = (one for one in model.effects if one.effect.place != "air" and not one.effect.needs_voltage)
    return [one for one in still if not at_limit(one, model.vehicle)]


def at_limit(one: ModelEffect, vehicle: Vehicle) -> bool:
    """Whether a fitted value of an effect is at a limit of its parameter that is not zero, or beyond: its law is wrong.

    A value without a standard deviation was not fitted: somebody stated it.
    """
    if one.std is None:
        return False
    parameters = one.effect.parameters(vehicle)
    low, high, near = np.array([(p.low, p.high, 1e-6 * p.scale) for p in parameters]).T
    ended = (one.theta <= low + near) & (low != 0.0) | (one.theta >= high - near) & (high != 0.0)
    return bool(np.any(ended))


def values_of(model: Model, effects: Sequence[ModelEffect]) -> Values:
    """The quantities of a model's vehicle with these effects; raises ModelError for a vehicle without rotors.

    Returns
    -------
    dict
        Of R rotors: ``mass`` [kg], ``com`` (3,) and ``imu`` (3,) [m] from O, ``inertia`` (3, 3) [kg m^2] about the
        centre of mass, ``misalignment`` (3,) [rad] of the IMU about B's axes; ``hub`` (R, 3) [m] from O, ``direction``
        (R, 3) of the thrust, ``level`` () [N], the mean thrust at the speeds ``hover`` (R,) [rad/s] that nominally
        carry the weight, ``balance`` (R,), thrusts there over their mean, ``yaw`` (R,) [m], the torque about that
        direction per thrust; ``push`` (2,) [N] along B's x and y and ``couple`` (3,) [Nm] about O, fixed in the body,
        with rotors that stand; ``lag`` (2,) up and down and ``delay`` () [s]; ``linear`` (3,) [N s/m] and ``quadratic``
        (3,) [N s^2/m^2] drag along B's axes, ``lift`` () [N s^2/m^2] the thrust of a rotor that moves across it, per
        speed squared; ``curve`` (3,), the thrust over ``level`` at speeds s times ``hover``, c_0 + c_1 s + c_2 s^2, and
        ``twist`` (3,) the drag torque over that in hover, likewise. Where [command] says what full command is,
        ``signal`` (), the share of it in hover, and ``by_signal`` (2,) [N], the mean thrust of a rotor over that share
        u, a_1 u + a_2 u^2; not a number where the rotors cannot carry the vehicle.
    """
    acting, vehicle = WrenchModel(model.vehicle, tuple(effects)), model.vehicle
    arms, rotors = vehicle.geometry()
    named = {
        one.name: dict(zip([p.name for p in one.effect.parameters(vehicle)], one.theta, strict=True))
        for one in acting.effects
    }
    hover = hover_speeds(vehicle)
    wrench = partial(still_wrench, acting)
    out = {"mass": np.array(acting.body.mass), "com": acting.body.com_B, "inertia": acting.body.inertia}
    out |= _sensors(acting)
    count = len(rotors)
    rest = wrench(np.zeros((1, count)))[0]
    turned = wrench(np.zeros((1, count)), quat_EB=REVERSED)[0]
    parts = _parts(wrench, hover[None])[0]
    thrust = np.linalg.norm(parts[:, :3], axis=1)
    if not (thrust > 0.0).all():
        r = int(np.flatnonzero(~(thrust > 0.0))[0])
        raise ModelError(f"{vehicle.name}: {vehicle.rotor_name(r)} makes no thrust with the effects of the model")
    along = parts[:, :3] / thrust[:, None]
    out |= {"push": 0.5 * (rest + turned)[:2], "couple": 0.5 * (rest + turned)[3:]}
    hub = arms.position_B[rotors.arm] + rotors.offset[:, None] * along
    out |= {"hub": hub, "direction": along, "level": thrust.mean(), "balance": thrust / thrust.mean(), "hover": hover}
    out["yaw"] = _about(parts, hub, along) / thrust
    out |= _drag(lambda velocity_B: wrench(hover[None], velocity_B=velocity_B)[:, :3], count)
    lags = [[named[n][p] for p in pair] for n, pair in LAGS.items() if n in named]
    out["lag"] = np.sum(lags, axis=0) if lags else np.zeros(2)
    out["delay"] = np.array(named.get("command_delay", {}).get("delay", 0.0))

    def mean_thrust(speed: Array) -> Array:
        return np.asarray((wrench(speed)[:, 2] - rest[2]) / float(np.abs(along[:, 2]).sum()))

    out["curve"] = np.polynomial.polynomial.polyfit(FLOWN, mean_thrust(FLOWN[:, None] * hover) / out["level"], 2)
    twist = np.array([np.abs(_about(one, hub, along)).mean() for one in _parts(wrench, FLOWN[:, None] * hover)])
    level = float((np.abs(out["yaw"]) * thrust).mean())
    out["twist"] = np.polynomial.polynomial.polyfit(FLOWN, twist / level, 2) if level > 0.0 else out["curve"]
    return out | _by_signal(model, mean_thrust, acting.body.mass * GRAVITY / float(np.abs(along[:, 2]).sum()))


def _parts(wrench: Callable[[Array], Array], speeds: Array) -> Array:
    """Of each rotor its part (N, R, 6) of the `wrench` (N, 6) of speeds (N, R): that of all, less that without it."""
    n, count = speeds.shape
    without = wrench((speeds[:, None] * (1.0 - np.eye(count))).reshape(-1, count))
    return np.asarray(wrench(speeds)[:, None] - without.reshape(n, count, 6))


def _about(parts: Array, hub: Array, along: Array) -> Array:
    """Torques (R,) about directions of thrust `along` (R, 3), of wrenches (R, 6) about O of rotors at `hub` (R, 3)."""
    return np.asarray(np.einsum("ri,ri->r", parts[:, 3:] - cross(hub, parts[:, :3]), along))


def hover_speeds(vehicle: Vehicle) -> Array:
    """Speeds (R,) [rad/s] at which all rotors nominally make the same thrust, and together the weight."""
    _, rotors = vehicle.geometry()
    return np.asarray(np.sqrt(vehicle.body.mass * GRAVITY / len(rotors) / rotors.c_f))


def still_wrench(
    acting: WrenchModel, speed: Array, tilt: Array | None = None, velocity_B: Array = REST, quat_EB: Array = UPRIGHT
) -> Array:
    """Wrenches (N, 6) about O at rotor speeds (N, R), level, far above the ground, each in equilibrium.

    `tilt` (A,) [rad] is that of the arms, zero by default; there may be one speed or one velocity (1, 3) for all, and
    there is one attitude (4,).
    """
    arms, rotors = acting.vehicle.geometry()
    n = max(len(speed), len(velocity_B))
    still, upright = np.zeros((n, 3)), np.tile(quat_EB, (n, 1))
    state = State(np.zeros(n), np.tile([0.0, 0.0, HEIGHT], (n, 1)), upright, still + velocity_B, still)
    tilts = np.zeros((n, len(arms))) + (0.0 if tilt is None else tilt)
    commands = Commands(np.zeros((n, 6)), tilts, speed + np.zeros((n, len(rotors))))
    alone = (slice(k, k + 1) for k in range(n))  # none follows another
    settled = concatenated([acting.command(commands.take(one), state.take(one), 0.01)[0] for one in alone])
    return np.asarray(acting.wrench(settled, state))


def _drag(force: Callable[[Array], Array], count: int) -> Values:
    """Linear and quadratic drag (3,) along B's axes, and the lift of `count` rotors, of the `force` (N, 3).

    Drag is what is odd in the velocities (N, 3), lift what of z is even along x and y.
    """
    moving = np.concatenate([sign * v * np.eye(3) for v in SPEEDS for sign in (1.0, -1.0)])
    forces = force(moving).reshape(len(SPEEDS), 2, 3, 3)
    slow, fast = -0.5 * np.einsum("vkk->vk", forces[:, 0] - forces[:, 1]) / np.array(SPEEDS)[:, None]
    quadratic, hover = (fast - slow) / (SPEEDS[1] - SPEEDS[0]), force(REST)[0]
    lift = ((forces[:, :, :2, 2].mean(axis=(1, 2)) - hover[2]) / np.square(SPEEDS)).mean() / count
    found = {"quadratic": quadratic, "linear": slow - SPEEDS[0] * quadratic, "lift": lift}
    rounding = 1e-12 * np.abs(hover).max()
    return {name: np.where(np.abs(value) > rounding, value, 0.0) for name, value in found.items()}


def _sensors(acting: WrenchModel) -> Values:
    """Place and misalignment of the IMU, from what it reads of unit angular accelerations and forces along B's axes.

    From a lever arm r it feels e_k x r, and sum_k e_k x (e_k x r) = -2 r; misaligned by m it reads v - m x v, likewise.
    """
    axes, nothing = np.eye(3), np.zeros((3, 3))
    still = State(np.zeros(3), nothing, np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)), nothing, nothing)

    def felt(motion: Motion) -> Array:
        return (
            acting.read_imu(motion, still).specific_force_B
            - acting.read_imu(Motion(*3 * [nothing]), still).specific_force_B
        )

    turned = -0.5 * cross(axes, felt(Motion(nothing, nothing, axes))).sum(axis=0)
    board_to_B = np.linalg.inv(np.eye(3) - np.cross(turned, axes).T)  # columns: e_k - m x e_k
    lever = -0.5 * cross(axes, felt(Motion(nothing, axes, nothing)) @ board_to_B.T).sum(axis=0)
    return {"imu": acting.vehicle.imu_position_B + lever, "misalignment": turned}


def has_signal(model: Model) -> bool:
    """Whether [command] says which commands are none and full: a bench table of pulse widths does not."""
    return model.command is not None and (model.command.unit == "normalised" or model.command.ends != (0.0, 1.0))


def _by_signal(model: Model, mean_thrust: Callable[[Array], Array], needed: float) -> Values:
    """The share of full command at which a rotor makes the thrust that is `needed` [N], and the curve about it."""
    if model.command is None or not has_signal(model):
        return {}
    from scipy.optimize import brentq  # here: the page need not wait for it

    curve, (low, high), count = model.command, model.command.ends, len(model.vehicle.geometry()[1])

    def thrust(shares: Array) -> Array:
        commands = np.repeat((low + shares * (high - low))[:, None], count, axis=1)
        return mean_thrust(curve.speeds(commands, None, model.vehicle))

    none, full = thrust(np.array([0.0, 1.0]))
    if not none < needed <= full:
        return {"signal": np.array(np.nan), "by_signal": np.full(2, np.nan)}
    signal = brentq(lambda share: float(thrust(np.array([share]))[0]) - needed, 0.0, 1.0)
    near = np.minimum(FLOWN * signal, 1.0)
    fitted = np.linalg.lstsq(np.stack((near, near**2), axis=1), thrust(near), rcond=None)[0]
    return {"signal": np.array(signal), "by_signal": np.where(np.abs(fitted) < 1e-9 * needed, 0.0, fitted)}
