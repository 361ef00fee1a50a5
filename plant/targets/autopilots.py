"""Parameters of PX4, ArduPilot and the Crazyflie's firmware that say what was identified, and nothing else.

Body frames of PX4 and ArduPilot are forward, right, down: (x, y, z) in B is (x, -y, -z) there, also of small rotations.

PX4         CA_ROTORn_P* [m] from the centre of mass, _A* the thrust's direction, _KM the drag torque per thrust [m],
            positive for a rotor that turns counter-clockwise, _CT relative to the other rotors. THR_MDL_FAC f: thrust
            goes with f s^2 + (1 - f) s of the signal s, and a command u (`actuator_motors`) is sent as the s for which
            that is u; MPC_THR_HOVER is u in hover. SENS_BOARD_*_OFF [deg] turn vectors from the board to the body, on
            top of those with which the log was made. CA_SV_TLn_MINA, _MAXA [deg] are the angles of a tilt servo's ends
            from upwards, towards the azimuth _TD [deg] to the right of ahead; CA_ROTORn_TILT is the servo's n + 1.
ArduPilot   MOT_THST_EXPO f, likewise over the range of the motors' spin, MOT_THST_HOVER; INS_POS1_* [m]; AHRS_TRIM_X,
            _Y [rad] turn vectors from the board to the body (the logged IMU does not have them), to one that leans,
            where a force fixed in the body would move it: level is then the attitude in which it stands still.
Crazyflie   thrust of a motor [N] = quadSysId.pwmToThrustA d^2 + pwmToThrustB d of the duty d, thrustToTorque [m],
            mass [kg] and moments of inertia [kg m^2] of the Lee controller.

Sources: parameter references of PX4 and ArduPilot; PX4 "Control Allocation"; AP_AHRS `update_trim_rotation_matrices`,
PX4 `GetSensorLevelAdjustment`; crazyflie-firmware, power_distribution_quadrotor.c, controller_lee.c.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.flight.formats.ned_frd import flu
from wrenchgap.plant.drafts.ardupilot import USUAL
from wrenchgap.plant.model import Model
from wrenchgap.plant.targets.quantities import FLOWN, Quantity, Values, has_signal, propagated, values_of
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.plant.wrench_model import ModelEffect

Parameters = Mapping[str, float]

CT = 6.5
"""PX4's default of CA_ROTORn_CT."""


@dataclass(frozen=True)
class Autopilot:
    """A firmware: `parameters` makes its own from values (`quantities.values_of`) and parameters as they were.

    `uses` are the quantities behind them, `limits` what the firmware takes, by the end of a name, `relative` the values
    from which parameters are counted where it is not known which were set, `together` patterns of names of which one
    means nothing without the others (places in metres beside those that were ratios). `curve` are the names of its
    thrust factor and of its command in hover, `factor` what the first is where nobody set it; where `linearises`,
    shares of full command are shares of thrust, and not signals.
    """

    name: str
    parameters: Callable[[Values, Parameters], Values]
    uses: frozenset[str]
    limits: Mapping[str, tuple[float, float]]
    curve: tuple[str, str] | None = None
    factor: float = 0.0
    linearises: bool = False
    relative: str = ""
    together: tuple[str, ...] = ()

    def quantities(self, model: Model, before: Parameters, shaped: bool) -> dict[str, Quantity]:
        """The parameters, with standard deviations and the effects that move each; `shaped`: a curve was identified."""
        if self.curve is None or model.command is None or not has_signal(model):
            return propagated(model, lambda effects: self.parameters(values_of(model, effects), before))
        old = before.get(self.curve[0], self.factor)
        sent = old if self.linearises and model.command.unit == "normalised" else 0.0
        names = self.curve

        def every(effects: Sequence[ModelEffect]) -> Values:
            values = values_of(model, effects)
            factor, signal = _factor(values, sent), _signal(float(values["signal"]), sent)
            used = factor if shaped else old  # what the firmware has when this is set
            hover = used * signal**2 + (1.0 - used) * signal
            curve = dict(zip(names, np.array((factor, hover)), strict=True)) if shaped else {names[1]: np.array(hover)}
            return self.parameters(values, before) | curve

        return propagated(model, every)

    def check(self, model: Model, before: Parameters) -> None:
        """Raise ModelError for parameters of another firmware or vehicle, and for values that no firmware takes."""
        now = self.parameters(values_of(model, []), {})
        own = {*now, *(self.curve or ())}
        if before and not before.keys() & own:
            raise ModelError(
                f"{model.name}: the parameters that were set are none of {self.name}'s; give those of its log"
            )
        counted = [n for n in before if (n in now and n.endswith(("_CT", "_OFF"))) or n in (self.curve or ())[:1]]
        for name in counted:  # the new values are counted from these
            if (why := self.refused(name, before[name])) is not None:
                raise ModelError(f"{model.name}: the parameters that were set: {why}")
        arms, rotors = model.vehicle.geometry()
        if before.get("CA_ROTOR_COUNT", len(rotors)) != len(rotors):
            raise ModelError(
                f"{model.name}: has {len(rotors)} rotors, CA_ROTOR_COUNT is {before['CA_ROTOR_COUNT']:g}; give the "
                "parameters of this vehicle"
            )
        for r, place_B in enumerate(arms.position_B[rotors.arm] - model.vehicle.body.com_B):
            name = f"CA_ROTOR{r}_P"
            if f"{name}X" not in before:
                continue
            mine, theirs = frd(place_B)[:2], np.array([before[f"{name}X"], before.get(f"{name}Y", 0.0)])
            with np.errstate(over="ignore", invalid="ignore"):  # a damaged log has any number
                alike = 0.7 * np.linalg.norm(mine) * np.linalg.norm(theirs)  # cos 45 deg: beyond, it is another rotor's
                same = bool(mine @ theirs >= alike)
            if not same:
                raise ModelError(
                    f"{model.name}: rotor {r} is at x {mine[0]:.3g}, y {mine[1]:.3g} m (forward, right), {name}X and Y "
                    f"are {theirs[0]:.3g}, {theirs[1]:.3g}; put the rotors of the model in the autopilot's order"
                )
            self._check_axis_and_turn(model, r, before, now)

    def _check_axis_and_turn(self, model: Model, r: int, before: Parameters, now: Values) -> None:
        """Raise ModelError where rotor r pulls or turns the other way: with its sign yaw control would be unstable."""
        axis = [f"CA_ROTOR{r}_A{k}" for k in "XYZ"]
        mine = np.array([now[name] for name in axis])
        theirs = np.array([before.get(name, usual) for name, usual in zip(axis, (0.0, 0.0, -1.0), strict=True)])
        with np.errstate(over="ignore", invalid="ignore"):
            same = bool(mine @ theirs >= 0.7 * np.linalg.norm(mine) * np.linalg.norm(theirs) > 0.0)
        if not same:
            ours, set_so = (", ".join(f"{x:.2g}" for x in one) for one in (mine, theirs))
            raise ModelError(
                f"{model.name}: rotor {r} pulls along {ours} (forward, right, down), {axis[0]}, Y and Z are {set_so}; "
                "give the parameters of this vehicle"
            )
        name, turn = f"CA_ROTOR{r}_KM", float(now[f"CA_ROTOR{r}_KM"])
        told = before.get(name, 0.0 if any(key.endswith("_KM") for key in before) else turn)  # PX4 has all, or none
        if turn and not told * turn > 0.0:
            turns = "counter-clockwise" if turn > 0.0 else "clockwise"
            raise ModelError(
                f"{model.name}: rotor {r} turns {turns} from above, {name} {told:.3g} says otherwise; give the "
                "parameters of this vehicle, or correct the turning directions in the model"
            )

    def _limits_of(self, name: str) -> tuple[float, float]:
        return next((ends for end, ends in self.limits.items() if name.endswith(end)), (-np.inf, np.inf))

    def nearest(self, name: str, value: float, std: float) -> float:
        """The value, or the firmware's limit where that is within one standard deviation of it."""
        low, high = self._limits_of(name)
        limit = min(max(value, low), high)
        return limit if abs(limit - value) <= std else value

    def refused(self, name: str, value: float) -> str | None:
        """Why a value is none for this firmware, None where it is one."""
        low, high = self._limits_of(name)
        return None if low <= value <= high else f"{name} {value:.7g} is none: {self.name} takes {low:g} to {high:g}"


def frd(vector_B: Array) -> Array:
    """From B (forward, left, up) to the autopilots' body frame (forward, right, down), vectors and small rotations."""
    return flu(vector_B)  # the same turn by 180 deg about x, both ways


def _factor(values: Values, sent: float) -> float:
    """The factor f of the thrust curve f s^2 + (1 - f) s over the signal s, of commands made with the factor `sent`."""
    if not np.isfinite(values["signal"]):
        return float("nan")
    s = FLOWN * _signal(float(values["signal"]), sent)
    u = sent * s**2 + (1.0 - sent) * s
    linear, square = np.linalg.lstsq(np.stack((s, s**2), axis=1), values["by_signal"] @ [u, u**2], rcond=None)[0]
    return float(square / (linear + square))


def _signal(command: float, sent: float) -> float:
    """The signal s with sent s^2 + (1 - sent) s = command."""
    if sent < 1e-9:
        return command
    return float((np.sqrt((1.0 - sent) ** 2 + 4.0 * sent * command) - (1.0 - sent)) / (2.0 * sent))


def _px4(values: Values, before: Parameters) -> Values:
    out: Values = {}
    places, directions = frd(values["hub"] - values["com"]), frd(values["direction"])
    for r, (place, along) in enumerate(zip(places, directions, strict=True)):
        rotor = f"CA_ROTOR{r}_"
        out |= {f"{rotor}P{axis}": place[k] for k, axis in enumerate("XYZ")}
        out |= {f"{rotor}A{axis}": along[k] for k, axis in enumerate("XYZ")}
        out |= {f"{rotor}KM": -values["yaw"][r], f"{rotor}CT": before.get(f"{rotor}CT", CT) * values["balance"][r]}
    out |= {f"EKF2_IMU_POS_{axis}": x for axis, x in zip("XYZ", frd(values["imu"] - values["com"]), strict=True)}
    for axis, angle in zip("XYZ", np.degrees(frd(values["misalignment"])), strict=True):
        out[f"SENS_BOARD_{axis}_OFF"] = before.get(f"SENS_BOARD_{axis}_OFF", 0.0) + angle
    return out | _tilt_servos(directions, before)


def _tilt_servos(directions: Array, before: Parameters, servos: int = 4) -> Values:
    """Angles of the ends of tilt servos as they were set, turned as the rotors (R, 3) lean at no commanded tilt."""
    out: Values = {}
    for n in range(servos):
        rotors = [r for r in range(len(directions)) if before.get(f"CA_ROTOR{r}_TILT") == n + 1]
        ends = [f"CA_SV_TL{n}_{end}" for end in ("MINA", "MAXA")]
        if rotors and all(name in before for name in ends):
            towards, along = np.radians(before.get(f"CA_SV_TL{n}_TD", 0.0)), directions[rotors].mean(axis=0)
            leans = np.arctan2(along[0] * np.cos(towards) + along[1] * np.sin(towards), -along[2])
            out |= {name: before[name] + np.degrees(leans) for name in ends}
    return out


def _ardupilot(values: Values, before: Parameters) -> Values:
    del before
    out: Values = {f"INS_POS1_{axis}": x for axis, x in zip("XYZ", frd(values["imu"] - values["com"]), strict=True)}
    forward, left = values["push"] / (values["mass"] * GRAVITY)
    turned = frd(values["misalignment"] - np.array([-left, forward, 0.0]))
    return out | {f"AHRS_TRIM_{axis}": turned[k] for k, axis in enumerate("XY")}


def _crazyflie(values: Values, before: Parameters) -> Values:
    del before
    out: Values = {"quadSysId.thrustToTorque": np.abs(values["yaw"]).mean(), "ctrlLee.mass": values["mass"]}
    out |= {f"ctrlLee.J_{axis}": values["inertia"][k, k] for k, axis in enumerate("xyz")}
    if "by_signal" in values:
        out |= dict(zip(("quadSysId.pwmToThrustB", "quadSysId.pwmToThrustA"), values["by_signal"], strict=True))
    return out


AUTOPILOTS = {
    "px4": Autopilot(
        "PX4",
        _px4,
        frozenset({"mass", "com", "direction", "balance", "yaw", "imu", "misalignment", "level", "curve"}),
        {"_KM": (-1.0, 1.0), "_CT": (0.01, 100.0), "_OFF": (-45.0, 45.0), "THR_MDL_FAC": (0.0, 1.0)}
        | {"MPC_THR_HOVER": (0.1, 0.8), "_MINA": (-90.0, 90.0), "_MAXA": (-90.0, 90.0)},
        ("THR_MDL_FAC", "MPC_THR_HOVER"),
        linearises=True,
        together=(r"CA_ROTOR\d+_P[XYZ]", r"CA_ROTOR\d+_A[XYZ]", r"CA_ROTOR\d+_KM", r"CA_ROTOR\d+_CT"),
        relative=f"CA_ROTOR*_CT {CT}, THR_MDL_FAC 0 and SENS_BOARD_*_OFF 0, PX4's defaults",
    ),
    "ardupilot": Autopilot(
        "ArduPilot",
        _ardupilot,
        frozenset({"mass", "imu", "misalignment", "level", "curve", "push"}),
        {"INS_POS1_X": (-5.0, 5.0), "INS_POS1_Y": (-5.0, 5.0), "INS_POS1_Z": (-5.0, 5.0)}
        | {"AHRS_TRIM_X": (-0.1745, 0.1745), "AHRS_TRIM_Y": (-0.1745, 0.1745)}
        | {"MOT_THST_EXPO": (-1.0, 1.0), "MOT_THST_HOVER": (0.125, 0.6875)},
        ("MOT_THST_EXPO", "MOT_THST_HOVER"),
        USUAL["MOT_THST_EXPO"],
    ),
    "crazyflie": Autopilot(
        "the Crazyflie's firmware",
        _crazyflie,
        frozenset({"mass", "inertia", "yaw", "level", "curve"}),
        {"mass": (0.01, 1.0)},
        together=(r"quadSysId\.pwmToThrust[AB]",),
    ),
}
"""Limits of PX4 and ArduPilot: their parameter references; PX4 switches a rotor off whose _CT is 0."""
