"""Put the compensator into a control loop that knows nothing of wrenchgap.

Yours are `fly`'s loop and the plant; the three lines marked with an arrow are all that changes. The plant here is
attitude alone: three small angles, a PD controller, and a mismatch that the controller does not know.

    python examples/02_compensator_in_your_loop.py
"""

import numpy as np

from wrenchgap.compensate import Compensator, Settings
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.learn.process.train import fit

DT = 0.01  # s
INERTIA = np.array([0.10, 0.10, 0.19])  # kg m^2
WEIGHT = 4.0 * 9.81  # N
TORQUES = ("torque_x", "torque_y", "torque_z")


def real_torque(wrench):
    """What the rotors really make: lever arm of a misplaced centre of mass, a weak rotor, a twisted arm."""
    force, torque = wrench[:3], wrench[3:]
    lever = np.cross([0.004, -0.007, 0.005], force)
    weak = -0.1 * np.array([0.4, 0.0, 0.0]) * np.tanh(torque[0] + 0.02 * force[2])
    return torque + lever + weak + [0.0, 0.0, 0.06 * np.sin(force[0] / 8)]


def ideal_torque(wrench):
    """What the controller believes."""
    return wrench[3:]


def fly(reference, seconds, plant=real_torque, compensator=None):
    """Angles (K, 3) [rad], commanded wrenches (K, 6) and real torques (K, 3)."""
    angle, rate = np.zeros(3), np.zeros(3)
    angles, commands, torques = [], [], []
    for time in np.arange(0.0, seconds, DT):
        error = angle - reference(time)
        torque_des = -INERTIA * (3.5**2 * error + 2 * 1.3 * 3.5 * rate)
        force = WEIGHT * np.array([-np.sin(angle[1]), np.sin(angle[0]), np.cos(angle[0]) * np.cos(angle[1])])
        wrench = np.concatenate([force, torque_des])
        if compensator is not None:  # <-
            result = compensator.step(wrench)  # <-
            wrench = result.wrench_cmd  # <-
        torque = plant(wrench)
        rate = rate + DT * torque / INERTIA
        angle = angle + DT * rate
        angles.append(angle)
        commands.append(wrench)
        torques.append(torque)
    return np.array(angles), np.array(commands), np.array(torques)


def excitation(time):
    """Slow tilting with a multisine on top, so that torques vary independently of attitude."""
    fast = 0.15 * np.sin([7.1 * time, 5.3 * time + 1, 6.2 * time + 2])
    return 0.9 * np.sin([0.31 * time, 0.43 * time, 0.0]) + fast


def unseen(time):
    """The flight that counts: tilting about x and y with other periods, at rest when it starts."""
    return 0.5 * (1 - np.cos([0.6 * time, 0.8 * time, 0.5 * time])) * [1, -1, 0.5]


def main():
    """Learn from one flight, fly another with and without the compensator, print the mean absolute errors."""
    _, commands, torques = fly(excitation, 60.0)
    gp = fit(commands, torques - commands[:, 3:], TORQUES, FitSettings(points=100, restarts=0))

    believed, _, _ = fly(unseen, 20.0, plant=ideal_torque)
    flights = {
        "before": fly(unseen, 20.0)[0],
        "after": fly(unseen, 20.0, compensator=Compensator(gp, Settings(dt=DT)))[0],
    }
    errors = {name: np.abs(angles - believed).mean(axis=0) for name, angles in flights.items()}
    print("attitude against that of the believed plant, mean |x| |y| |z| [rad]")
    for name, error in errors.items():
        print(f"{name:6s}", *(f"{value:.5f}" for value in error))
    return errors


if __name__ == "__main__":
    main()
