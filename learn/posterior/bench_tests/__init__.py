"""Checks on the bench: what each measures, and what every effect of the catalogue does to it.

An effect changes the readings of the checks that name it in `shows` and no others; of those that name it in `unclear`
nothing is known. Effects that no check shows are in `NO_CHECK`, with the reason. Effects of a user's own are in
neither: nothing is known of them here. Costs are our estimates, resolutions those of ordinary tools (docs/settle.md).
"""

from __future__ import annotations

from wrenchgap.learn.posterior.bench_tests import arms, hull, rotors, wakes
from wrenchgap.learn.posterior.bench_tests.trial import Fitted, Setup, Trial

__all__ = ["NO_CHECK", "TRIALS", "Fitted", "Setup", "Trial"]

_LOAD = ("tether",)
"""A weight on a string weighs with the vehicle, a cable does not."""

TRIALS: tuple[Trial, ...] = (
    Trial("look", 1, ("tether",), hull.look, "whatever pulls or touches the vehicle in flight", "0.5 % of the weight"),
    Trial("air", 1, ("wind",), hull.air, "whether the air moved", "1 m/s"),
    Trial("weigh", 5, ("mass", "payload"), hull.weigh, "mass, ready to fly", "0.2 % of the mass", _LOAD),
    Trial("imu_place", 5, ("imu_lever_arm",), hull.imu_place, "place of the IMU", "2 mm"),
    Trial("rock", 5, ("backlash",), arms.rock, "free play of the arms, by hand", "0.1 deg"),
    Trial("imu_level", 10, ("imu_misalignment",), hull.imu_level, "IMU still, in six positions", "0.2 deg"),
    Trial("imu_bias", 10, ("accelerometer_bias",), hull.imu_bias, "IMU still, in six positions", "0.05 m/s^2"),
    Trial("tilt_zero", 15, ("tilt_offset",), arms.zeros, "angle of the arms commanded to zero", "0.2 deg"),
    Trial(
        "load_arm",
        15,
        ("arm_twist",),
        arms.load,
        "angle of an arm under half and one and a half hover thrusts",
        "0.2 deg",
    ),
    Trial(
        "hang",
        20,
        ("com_offset", "payload"),
        hull.hang,
        "centre of mass, from two points",
        "1 mm; 1 % of the arm where that is less",
        _LOAD,
    ),
    Trial(
        "swap",
        25,
        ("rotor_thrust",),
        rotors.swap,
        "torque in hover after two rotors have changed places",
        "2 % of a rotor's thrust times the arm",
    ),
    Trial(
        "servo_step",
        30,
        ("servo_lag", "command_delay"),
        arms.servo_step,
        "dead time and time constant of a tilt servo",
        "4 ms",
    ),
    Trial(
        "rotor_step",
        30,
        ("motor_lag", "asymmetric_motor_lag", "command_delay"),
        rotors.rotor_step,
        "dead time and time constants of a rotor's speed, up and down",
        "4 ms",
    ),
    Trial(
        "rotor_inertia",
        30,
        ("rotor_gyroscopic",),
        rotors.spin,
        "inertia of a propeller with its motor bell",
        "30 % of a typical rotor's",
    ),
    Trial("swing_arm", 30, ("arm_reaction",), arms.swing, "turn of the hanging hull when an arm is swung", "0.2 deg"),
    Trial(
        "pair",
        60,
        ("coaxial_loss", "coaxial_loss_of_wake"),
        rotors.pair,
        "thrust of the lower rotor, alone and below the upper one",
        "1 %",
    ),
    Trial("curve", 60, ("thrust_curve",), rotors.curve, "thrust at 80, 100 and 120 % of hover's command", "1 %"),
    Trial("torque", 60, ("drag_torque", "drag_torque_of_speed"), rotors.torque, "torque over thrust of a rotor", "2 %"),
    # sag is right at a voltage of its own: what it makes of the level on another supply is not known
    Trial(
        "thrust",
        90,
        ("thrust_scale", "rotor_thrust"),
        rotors.thrust,
        "thrust of each rotor at hover's command, one at a time",
        "1 %",
        ("battery_sag",),
    ),
    Trial(
        "discharge",
        90,
        ("battery_sag", "thrust_fade"),
        rotors.discharge,
        "thrust at one command, battery full and nearly empty",
        "1 %",
    ),
    Trial("pendulum", 90, ("inertia", "payload"), hull.pendulum, "moments of inertia, on two strings", "2 %", _LOAD),
    Trial(
        "board",
        120,
        ("ground_effect", "ground_effect_one_height"),
        wakes.board,
        "thrust two rotor radii above a board",
        "1 %",
    ),
    Trial(
        "blockage",
        120,
        ("downwash_blockage",),
        wakes.blockage,
        "thrust of an arm that blows at its neighbours' booms",
        "1 %",
    ),
    Trial(
        "interference",
        120,
        ("rotor_interference",),
        wakes.interference,
        "torque about z of all arms together and one by one, at 90 deg",
        "1 %",
    ),
    Trial(
        "fan",
        120,
        ("body_drag", "body_drag_areas"),
        wakes.hull,
        "force in a wind of 5 m/s, rotors stopped",
        "1 % of the weight",
    ),
    # the linear part of rotational_drag may be what rotors do in moving air
    Trial(
        "rotor_fan",
        180,
        ("rotor_drag", "translational_lift", "axial_inflow"),
        wakes.rotor,
        "forces of one rotor in a wind of 5 m/s",
        "1 %",
        ("rotational_drag",),
    ),
)
"""Cheapest first."""

NO_CHECK: dict[str, str] = {
    "constant_wrench": "it has no place on the vehicle to look at: it stands for trim of whatever origin",
    "rotational_drag": "its linear part is made by rotors that turn while the vehicle does; with rotors stopped a "
    "pendulum shows the booms alone",
}
"""Effects that no check shows, and why."""
