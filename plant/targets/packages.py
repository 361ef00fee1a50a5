"""Parameters of simulators in Python: RotorPy's `quad_params`, drone-models' `first_principles`. Rotors thrust along z.

RotorPy: from the centre of mass; a rotor makes k_eta Omega^2 + k_h |v_xy|^2 along z, rotor_directions k_m Omega^2 about
it, and at its hub -Omega (k_d, k_d, k_z) v; the hull -|v| c_D v. So linear drag is put at the hubs, in proportion to
their speeds, and quadratic drag is exact along one axis at a time.
drone-models: thrust and torque are polynomials in revolutions a minute, mixing_matrix has the arms over L and the signs
of the torques, drag_matrix v is the force, speeds approach their commands at rates rotor_dyn_coef [1/s]. prop_inertia
is 0: about x its gyroscopic torque has the other sign there than in physics.
Sources: rotorpy 3.0 (vehicles/multirotor.py), drone-models 0.1 (first_principles/model.py).
"""

import numpy as np
import tomlkit

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import RPM
from wrenchgap.plant.drafts.package_tables import INSTANT
from wrenchgap.plant.targets.quantities import Values
from wrenchgap.plant.vehicle import GRAVITY, Vehicle


def rotorpy(vehicle: Vehicle, values: Values) -> str:
    """A Python module with `quad_params`. Raises ModelError for rotors that RotorPy cannot have."""
    _, rotors = vehicle.geometry()
    _check_upward(vehicle, values, "RotorPy")
    if len(rotors) != 4:
        raise ModelError(f"{vehicle.name}: has {len(rotors)} rotors; RotorPy inverts the allocation of four")
    arms, J = values["hub"] - values["com"], values["inertia"]
    k_eta, speeds = values["level"] / np.mean(values["hover"] ** 2), values["hover"].sum()
    quad = {
        "mass": values["mass"],
        **{f"I{'xyz'[i]}{'xyz'[k]}": J[i, k] for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))},
        "num_rotors": 4,
        "rotor_radius": rotors.radius.mean(),
        "rotor_pos": {f"r{r + 1}": arm for r, arm in enumerate(arms)},
        "rotor_directions": np.sign(values["yaw"]),
        "rI": values["imu"] - values["com"],
        **{f"c_D{axis}": values["quadratic"][k] for k, axis in enumerate("xyz")},
        "k_eta": k_eta,
        "k_m": k_eta * np.abs(values["yaw"]).mean(),
        "k_d": values["linear"][:2].mean() / speeds,
        "k_z": values["linear"][2] / speeds,
        "k_h": max(float(values["lift"]), 0.0),
        "k_flap": 0.0,
        "tau_m": values["lag"].mean() or INSTANT,
        "rotor_speed_min": rotors.speed_min.max(),
        "rotor_speed_max": rotors.speed_max.min(),
        "motor_noise_std": 0.0,
    }
    lines = [f"    {key!r}: {_python(value)}," for key, value in quad.items()]
    return "\n".join(["import numpy as np", "", "quad_params = {", *lines, "}"]) + "\n"


def _python(value: object) -> str:
    """Python that makes a number, an array or a dict of them."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key!r}: {_python(one)}' for key, one in value.items())}}}"
    plain = np.asarray(value).tolist()
    return f"np.array({plain!r})" if isinstance(plain, list) else repr(plain)


def drone_models(vehicle: Vehicle, values: Values) -> str:
    """TOML with the keyword arguments of `drone_models.first_principles.dynamics`. Raises ModelError likewise."""
    _check_upward(vehicle, values, "drone-models")
    arms = values["hub"] - values["com"]
    length = float(np.linalg.norm(arms[:, :2], axis=1).mean())
    powers = (RPM / values["hover"].mean()) ** np.arange(3)
    thrust = float(values["level"]) * values["curve"] * powers
    torque = float(values["level"]) * float(np.abs(values["yaw"]).mean()) * values["twist"] * powers
    up, down = (1.0 / (float(x) or INSTANT) for x in values["lag"])
    drone = {
        "gravity_vec": [0.0, 0.0, -GRAVITY],
        "mass": float(values["mass"]),
        "L": length,
        "J": values["inertia"].tolist(),
        "J_inv": np.linalg.inv(values["inertia"]).tolist(),
        "rpm2thrust": thrust.tolist(),
        "rpm2torque": torque.tolist(),
        "rotor_dyn_coef": [up, 0.0, down, 0.0],
        "mixing_matrix": [*(arms[:, [1, 0]] * [1.0, -1.0] / length).T.tolist(), np.sign(values["yaw"]).tolist()],
        "drag_matrix": np.diag(-values["linear"]).tolist(),
        "prop_inertia": 0.0,
    }
    return tomlkit.dumps(drone)


def _check_upward(vehicle: Vehicle, values: Values, package: str, tolerance: float = 0.02) -> None:
    """Raise ModelError where a thrust is off z by more than a `tolerance` [rad], 0.02 % of thrust along z."""
    arms, _ = vehicle.geometry()
    if arms.tilts.any() or np.abs(values["direction"] - [0.0, 0.0, 1.0]).max() > tolerance:
        raise ModelError(f"{vehicle.name}: has rotors that do not point up; those of {package} do")
