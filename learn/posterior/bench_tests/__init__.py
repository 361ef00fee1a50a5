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
    Trial("look", 1, ("tether",), hull.look, "0.5 % of the weight"),
    Trial("air", 1, ("wind",), hull.air, "1 m/s"),
    Trial("weigh", 5, ("mass", "payload"), hull.weigh, "0.2 % of the mass", _LOAD),
    Trial("imu_place", 5, ("imu_lever_arm",), hull.imu_place, "2 mm"),
    Trial("rock", 5, ("backlash",), arms.rock, "0.1 deg"),
    Trial("imu_level", 10, ("imu_misalignment",), hull.imu_level, "0.2 deg"),
    Trial("imu_bias", 10, ("accelerometer_bias",), hull.imu_bias, "0.05 m/s^2"),
    Trial("tilt_zero", 15, ("tilt_offset",), arms.zeros, "0.2 deg"),
    Trial("load_arm", 15, ("arm_twist",), arms.load, "0.2 deg"),
    Trial(
        "hang",
        20,
        ("com_offset", "payload"),
        hull.hang,
        "1 mm; 1 % of the arm where that is less",
        _LOAD,
    ),
    Trial("swap", 25, ("rotor_thrust",), rotors.swap, "2 % of a rotor's thrust times the arm"),
    Trial("servo_step", 30, ("servo_lag", "command_delay"), arms.servo_step, "4 ms"),
    Trial(
        "rotor_step",
        30,
        ("motor_lag", "asymmetric_motor_lag", "command_delay"),
        rotors.rotor_step,
        "4 ms",
    ),
    Trial("rotor_inertia", 30, ("rotor_gyroscopic",), rotors.spin, "30 % of a typical rotor's"),
    Trial("swing_arm", 30, ("arm_reaction",), arms.swing, "0.2 deg"),
    Trial("pair", 60, ("coaxial_loss", "coaxial_loss_of_wake"), rotors.pair, "1 %"),
    Trial("curve", 60, ("thrust_curve",), rotors.curve, "1 %"),
    Trial("torque", 60, ("drag_torque", "drag_torque_of_speed"), rotors.torque, "2 %"),
    # sag is right at a voltage of its own: what it makes of the level on another supply is not known
    Trial("thrust", 90, ("thrust_scale", "rotor_thrust"), rotors.thrust, "1 %", ("battery_sag",)),
    Trial("discharge", 90, ("battery_sag", "thrust_fade"), rotors.discharge, "1 %"),
    Trial("pendulum", 90, ("inertia", "payload"), hull.pendulum, "2 %", _LOAD),
    Trial("board", 120, ("ground_effect", "ground_effect_one_height"), wakes.board, "1 %"),
    Trial("blockage", 120, ("downwash_blockage",), wakes.blockage, "1 %"),
    Trial("interference", 120, ("rotor_interference",), wakes.interference, "1 %"),
    Trial("fan", 120, ("body_drag", "body_drag_areas"), wakes.hull, "1 % of the weight"),
    # the linear part of rotational_drag may be what rotors do in moving air
    Trial(
        "rotor_fan",
        180,
        ("rotor_drag", "translational_lift", "axial_inflow"),
        wakes.rotor,
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
