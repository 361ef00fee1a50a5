"""Checks on the bench: what each measures, and what every effect of the catalogue does to it.

An effect changes the readings of the checks that name it in `shows` and no others; of those that name it in `unclear`
nothing is known. Effects that no check shows are in `NO_CHECK`, with the reason. Effects of a user's own are in
neither: nothing is known of them here. Costs are our estimates, resolutions those of ordinary tools (docs/settle.md).
"""

from wrenchgap.learn.posterior.bench_tests import hull, rotors, wakes
from wrenchgap.learn.posterior.bench_tests.trial import Fitted, Setup, Trial

__all__ = ["NO_CHECK", "TRIALS", "Fitted", "Setup", "Trial"]

TRIALS: tuple[Trial, ...] = (
    hull.look,
    hull.air,
    hull.weigh,
    hull.imu_place,
    hull.rock,
    hull.imu_level,
    hull.imu_bias,
    hull.zeros,
    hull.travel,
    hull.load,
    hull.hang,
    rotors.swap,
    hull.servo_step,
    rotors.rotor_step,
    rotors.spin,
    hull.swing,
    rotors.pair,
    rotors.curve,
    rotors.torque,
    rotors.thrust,
    rotors.discharge,
    hull.pendulum,
    wakes.board,
    wakes.blockage,
    wakes.interference,
    wakes.fan,
    wakes.rotor_fan,
)
"""Cheapest first."""

NO_CHECK: dict[str, str] = {
    "constant_wrench": "it has no place on the vehicle to look at: it stands for trim of whatever origin",
    "rotational_drag": "its linear part is made by rotors that turn while the vehicle does; with rotors stopped a "
    "pendulum shows the booms alone",
}
"""Effects that no check shows, and why."""
