"""The vehicles of the field: what their engineers believe, in RotorPy's words, and where their model files are.

| name | what | source of the numbers |
|---|---|---|
| nano | plain quadrotor of 30 g | RotorPy's Crazyflie 2 (Foerster 2015; Bitcraze) without its drag and motor lag |
| quad | plain quadrotor of 1.5 kg | our estimate: a 450 mm frame, propellers of 10 inches |
| x8 | coaxial octorotor of 3.2 kg | our estimate: four arms of 0.25 m, propellers of 11 inches |
| blind | quadrotor of 1 kg of which the wrench alone is known | RotorPy's copy of PX4's SIH quadrotor |
| hexa | tilting hexarotor of 4 kg | `benchmarks.hidden_effects`, an engine of its own |

Frames: B has x forward, y left, z up, origin O; rotor places are from O. `spin` of a model file is minus RotorPy's
`rotor_directions`: there +1 is a drag torque along +z.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant import model_file
from wrenchgap.plant.model import Model

MODELS = Path(__file__).parent / "models"
GRAVITY = 9.80665
"""m/s^2. RotorPy's is 9.81; the engine sets this one, so that a scale is a scale."""
STILL_AIR = {"c_Dx": 0.0, "c_Dy": 0.0, "c_Dz": 0.0, "k_d": 0.0, "k_z": 0.0, "k_h": 0.0, "k_flap": 0.0}


@dataclass(frozen=True)
class Vehicle:
    """What is believed. `places_B` (R, 3) [m] from O, `directions` (R,) as RotorPy's, `inertia` (3,) [kg m^2].

    `k_eta` [N s^2], `k_m` [Nm s^2], `radius` [m], speeds [rad/s]; `gains` of the attitude loop (1/s^2, 1/s).
    `shows_rotors`: whether rotors are in the model file and their speeds in the log.
    """

    name: str
    mass: float
    inertia: tuple[float, float, float]
    places_B: Array
    directions: Array
    k_eta: float
    k_m: float
    radius: float
    speed_max: float
    gains: tuple[float, float]
    shows_rotors: bool = True

    @property
    def rotors(self) -> int:
        """How many."""
        return len(self.places_B)

    @property
    def hover_speed(self) -> float:
        """rad/s."""
        return float(np.sqrt(self.mass * GRAVITY / self.rotors / self.k_eta))

    @property
    def arm(self) -> float:
        """m, from O to a rotor, level."""
        return float(np.linalg.norm(self.places_B[:, :2], axis=1).mean())

    @property
    def model(self) -> Model:
        """The model file, read as a user's."""
        return model_file.load(MODELS / f"{self.name}.toml")

    def params(self) -> dict[str, Any]:
        """RotorPy's dictionary of the believed vehicle in still air, as many rotors as there are."""
        xx, yy, zz = self.inertia
        return {
            **STILL_AIR,
            "mass": self.mass,
            "Ixx": xx,
            "Iyy": yy,
            "Izz": zz,
            "Ixy": 0.0,
            "Ixz": 0.0,
            "Iyz": 0.0,
            "num_rotors": self.rotors,
            "rotor_pos": {f"r{k}": place for k, place in enumerate(self.places_B)},
            "rotor_directions": self.directions,
            "rotor_speed_min": 0.0,
            "rotor_speed_max": self.speed_max,
            "k_eta": self.k_eta,
            "k_m": self.k_m,
            "tau_m": 1.0,  # not used: the engine turns the rotors
            "kp_att": self.gains[0],
            "kd_att": self.gains[1],
        }

    def allocation(self) -> Array:
        """(4, R): thrusts of the rotors [N] to thrust and torque about O [N, Nm]."""
        x, y, _ = self.places_B.T
        return np.stack((np.ones(self.rotors), y, -x, self.k_m / self.k_eta * self.directions))


def _cross(arm: float, height: float = 0.0) -> Array:
    """Four places at 45 deg, in RotorPy's order: front left, front right, back right, back left."""
    half = arm / np.sqrt(2.0)
    return np.array([(half, half, height), (half, -half, height), (-half, -half, height), (-half, half, height)])


@cache
def vehicle(name: str) -> Vehicle:
    """One of `VEHICLES` but the tilting hexarotor, which has an engine of its own."""
    turn = np.array([1.0, -1.0, 1.0, -1.0])
    if name == "nano":
        places, J = _cross(0.043), (1.43e-5, 1.43e-5, 2.8e-5)
        return Vehicle(name, 0.03, J, places, turn, 2.3e-8, 7.8e-10, 0.0231, 2500.0, (220.0, 32.0))
    if name == "quad":
        places, J = _cross(0.225), (0.0165, 0.0170, 0.0300)
        return Vehicle(name, 1.5, J, places, turn, 1.2e-5, 1.9e-7, 0.127, 950.0, (120.0, 22.0))
    if name == "x8":
        places = np.stack((_cross(0.25, 0.03), _cross(0.25, -0.03)), 1).reshape(8, 3)  # upper, lower, arm after arm
        directions, J = np.stack((turn, -turn), 1).ravel(), (0.040, 0.042, 0.070)
        return Vehicle(name, 3.2, J, places, directions, 1.1e-5, 1.8e-7, 0.14, 950.0, (100.0, 20.0))
    if name == "blind":
        half = 0.17
        places = half * np.array([(1.0, -1.0, 0.0), (-1.0, 1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, -1.0, 0.0)])
        directions, J = np.array([-1.0, -1.0, 1.0, 1.0]), (0.025, 0.025, 0.030)
        return Vehicle(name, 1.0, J, places, directions, 5e-6, 1e-7, 0.12, 1000.0, (110.0, 21.0), shows_rotors=False)
    raise KeyError(name)


VEHICLES = ("nano", "quad", "x8", "blind", "hexa")
