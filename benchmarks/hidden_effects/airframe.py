"""The vehicle as MuJoCo sees it: a hull, six hinged arms that carry the rotors, an IMU, and what an effect adds.

Stated totals at zero tilt: 4.0 kg, J = diag(0.1035, 0.1045, 0.1914) kg m^2 about the body origin O, centre of mass at
O. The arms take their share; the hull gets the rest. Every length is in metres, every mass in kg.

Arm frame: x outward along the tilt axis, z the thrust direction at zero tilt. A rotor pushes with `T` along its hub
site's z and twists with `s kappa T` about it (s = +1 for the upper rotor of arms 0, 2, 4 and the lower of 1, 3, 5).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array

ARMS, ROTORS = 6, 12
MASS = 4.0
INERTIA = (0.1035, 0.1045, 0.1914)
ARM_LENGTH, HUB, RADIUS = 0.30, 0.035, 0.115
C_F, KAPPA, SPEED_MAX = 7.2e-6, 0.0165, 1250.0
GRAVITY = 9.80665
AZIMUTH = np.arange(ARMS) * np.pi / 3
TWIST = np.array([(1.0, -1.0) if arm % 2 == 0 else (-1.0, 1.0) for arm in range(ARMS)]).ravel()
"""(12,) sign of each rotor's drag torque about its thrust direction."""
HOVER_SPEED = float(np.sqrt(MASS * GRAVITY / (ROTORS * C_F)))


@dataclass
class Airframe:
    """Everything about the build that a hidden effect may change before the flight; the defaults are the ideal vehicle.

    `hull_shift` (3,) moves the hull's centre of mass; `ballast` are point masses (mass, position_B) fixed to the hull
    and taken off its mass, so that `mass` stays the total; `arm_inertia` is about the arm's x, y, z; `tilt_zero` (6,)
    [rad] turns each rotor pair about its arm's axis; `play` [rad] is the free travel between servo and arm.
    `extra_bodies`, `extra_world`, `extra_tendons` are MJCF put into the hull, the world and the tendon section.
    """

    mass: float = MASS
    arm_mass: float = 0.277
    arm_inertia: tuple[float, float, float] = (3.4e-4, 3.0e-4, 2.0e-4)
    hull_shift: Array = field(default_factory=lambda: np.zeros(3))
    hull_inertia_less: Array = field(default_factory=lambda: np.zeros(3))  # kg m^2, taken off the hull's moments
    ballast: list[tuple[float, Array]] = field(default_factory=list)
    kappa: float = KAPPA
    tilt_zero: Array = field(default_factory=lambda: np.zeros(ARMS))
    play: float = 0.0
    servo_tau: float = 0.013  # s, of the position loop
    servo_inner_tau: float = 0.002  # s, of the velocity loop inside it
    servo_rate: float = 8.0  # rad/s
    motor_tau: float = 0.0  # s at hover speed; 0: rotors follow at once
    imu_position: Array = field(default_factory=lambda: np.zeros(3))
    imu_rotvec: Array = field(default_factory=lambda: np.zeros(3))
    extra_bodies: list[str] = field(default_factory=list)
    extra_world: list[str] = field(default_factory=list)
    extra_tendons: list[str] = field(default_factory=list)
    extra_hull_mass: float = 0.0  # kg of `extra_bodies` that are part of `mass`

    def hull(self) -> tuple[float, Array]:
        """Mass and principal inertia about O of the hull alone, so that hull and arms add up to the stated totals."""
        radial, tangential, vertical = self.arm_inertia
        point = self.arm_mass * ARM_LENGTH**2
        level = 3 * (radial + tangential + point)  # sum over 60 deg steps of cos^2 is 3, and of sin^2
        arms = np.array([level, level, 6 * (vertical + point)])
        mass = self.mass - ARMS * self.arm_mass - sum(m for m, _ in self.ballast) - self.extra_hull_mass
        return mass, np.array(INERTIA) - arms - self.hull_inertia_less

    def mjcf(self, timestep: float) -> str:
        """The model in MuJoCo's XML."""
        mass, inertia = self.hull()
        arms = "".join(self._arm(arm) for arm in range(ARMS))
        ballast = "".join(
            f'<body pos="{_text(at)}"><inertial pos="0 0 0" mass="{m}" diaginertia="1e-7 1e-7 1e-7"/></body>'
            for m, at in self.ballast
        )
        angle = float(np.linalg.norm(self.imu_rotvec))
        axis = self.imu_rotvec / angle if angle > 0 else np.array([0.0, 0.0, 1.0])
        driven = "gear" if self.play else "tilt"
        stiffer = 10.0 if self.play else 1.0  # a gear train holds the bearing's friction
        gain = stiffer * self.arm_inertia[0] / self.servo_inner_tau
        tendons = [*self.extra_tendons]
        if self.play:
            tendons += [
                f'<fixed limited="true" range="{-self.play / 2} {self.play / 2}" solreflimit="0.004 1">'
                f'<joint joint="tilt{a}" coef="1"/><joint joint="gear{a}" coef="-1"/></fixed>'
                for a in range(ARMS)
            ]
        rotors = "".join(
            f'<general site="hub{r}" gear="0 0 1 0 0 {TWIST[r] * self.kappa}" ctrllimited="false"/>'
            for r in range(ROTORS)
        )
        servos = "".join(f'<velocity joint="{driven}{a}" kv="{gain}"/>' for a in range(ARMS))
        return (
            f'<mujoco><compiler angle="radian"/>'
            f'<option timestep="{timestep}" integrator="implicitfast" gravity="0 0 {-GRAVITY}">'
            f'<flag contact="disable"/></option>'
            f'<worldbody>{"".join(self.extra_world)}<body name="hull"><freejoint name="free"/>'
            f'<inertial pos="{_text(self.hull_shift)}" mass="{mass}" diaginertia="{_text(inertia)}"/>'
            f'<site name="imu" pos="{_text(self.imu_position)}" axisangle="{_text(axis)} {angle}"/>'
            f"{arms}{ballast}{''.join(self.extra_bodies)}</body></worldbody>"
            f"<tendon>{''.join(tendons)}</tendon><actuator>{rotors}{servos}</actuator>"
            f'<sensor><accelerometer site="imu"/></sensor></mujoco>'
        )

    def _arm(self, arm: int) -> str:
        """One arm: hinge along the outward axis, its mass at the hub, the two hub sites at +-35 mm along z."""
        g = AZIMUTH[arm]
        place = f'pos="{ARM_LENGTH * np.cos(g)} {ARM_LENGTH * np.sin(g)} 0" axisangle="0 0 1 {g}"'
        zero = f'axisangle="1 0 0 {self.tilt_zero[arm]}"'
        lean = np.array([0.0, -np.sin(self.tilt_zero[arm]), np.cos(self.tilt_zero[arm])])
        sites = "".join(
            f'<site name="hub{2 * arm + k}" pos="{_text(sign * HUB * lean)}" {zero}/>' for k, sign in enumerate((1, -1))
        )
        friction = 'frictionloss="0.05"' if self.play else ""
        body = (
            f'<body name="arm{arm}" {place}><joint name="tilt{arm}" type="hinge" axis="1 0 0" {friction}/>'
            f'<inertial pos="0 0 0" mass="{self.arm_mass}" diaginertia="{_text(self.arm_inertia)}"/>{sites}</body>'
        )
        if self.play:
            body += (
                f'<body {place}><joint name="gear{arm}" type="hinge" axis="1 0 0" armature="1e-4"/>'
                f'<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-7 1e-7 1e-7"/></body>'
            )
        return body

    def compile(self, timestep: float) -> mujoco.MjModel:
        """The model, ready to step; raises ModelError where no such vehicle can be built."""
        try:
            return mujoco.MjModel.from_xml_string(self.mjcf(timestep))
        except ValueError as error:
            reason = str(error).splitlines()[0]
            raise ModelError(
                f"hidden effect: MuJoCo cannot build the vehicle ({reason}); choose a smaller size"
            ) from error


def _text(values: object) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(np.asarray(values, dtype=float)))
