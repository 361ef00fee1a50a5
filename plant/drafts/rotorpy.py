"""A vehicle from RotorPy's `quad_params`, a dict that a Python file assigns; the file is not run.

From the centre of mass; k_eta Omega^2 is a rotor's thrust along z, rotor_directions k_m Omega^2 its torque on the body
about z, whatever the air does to the thrust. Beyond that, each an effect:

    tau_m              motor_lag               dOmega/dt = (Omega_cmd - Omega) / tau_m
    c_Dx, c_Dy, c_Dz   body_drag_areas         -|v| c_D v
    k_d                rotor_drag              -Omega k_d v_t, at the hub and across z
    k_z                axial_inflow            -Omega k_z v_z, at the hub
    k_h                translational_lift      k_h |v_t|^2, at the hub
    k_m, with k_z or k_h: drag_torque_of_speed, since their change of the thrust is not in the torque

Source: rotorpy 3.0, vehicles/multirotor.py (`compute_body_wrench`) and the files vehicles/*_params.py.
"""

from pathlib import Path
from typing import Any, Self

from pydantic import model_validator

from wrenchgap.flight.errors import ModelError
from wrenchgap.plant.drafts.draft import Draft, EffectDraft, RotorDraft, Sourced
from wrenchgap.plant.drafts.package_tables import CENTRE, UP, Numbers, lag_effect, notes_of, read_known
from wrenchgap.plant.drafts.python_constants import constants
from wrenchgap.plant.effects.body_drag_areas import BodyDragAreas
from wrenchgap.plant.reader import Integer, NotNegative, Number, Positive, Table, Vector, rule_error


class QuadParams(Table):
    """What of `quad_params` describes the vehicle, with RotorPy's defaults."""

    mass: Positive
    Ixx: Positive
    Iyy: Positive
    Izz: Positive
    Ixy: Number
    Ixz: Number
    Iyz: Number
    num_rotors: Integer
    rotor_pos: dict[str, Vector]
    rotor_directions: Numbers
    rotor_radius: Positive | None = None
    rI: Vector | None = None
    c_Dx: NotNegative = 0.0
    c_Dy: NotNegative = 0.0
    c_Dz: NotNegative = 0.0
    k_eta: Positive
    k_m: NotNegative
    k_d: NotNegative = 0.0
    k_z: NotNegative = 0.0
    k_h: NotNegative = 0.0
    tau_m: NotNegative
    rotor_speed_min: NotNegative
    rotor_speed_max: Positive

    @model_validator(mode="after")
    def _fits(self) -> Self:
        rotors, places, ways = self.num_rotors, len(self.rotor_pos), len(self.rotor_directions)
        if not rotors == places == ways:
            raise rule_error(
                f"num_rotors is {rotors}, rotor_pos has {places}, rotor_directions {ways}: expected as many"
            )
        if not all(abs(way) == 1.0 for way in self.rotor_directions):
            raise rule_error(f"rotor_directions: got {list(self.rotor_directions)}, expected 1 or -1 for each rotor")
        if self.rotor_speed_min >= self.rotor_speed_max:
            raise rule_error("rotor_speed_min: expected less than rotor_speed_max [rad/s]")
        return self


def from_rotorpy(path: Path) -> Draft:
    """A draft of the `quad_params` of a Python file. Raises ModelError, in one line."""
    found = constants(path).get("quad_params")
    if not isinstance(found, dict):
        raise ModelError(f"{path.name}: assigns no dict quad_params, as RotorPy's files vehicles/*_params.py do")
    told, unread = read_known(QuadParams, found, f"{path.name}: quad_params")
    effects = _effects(told)
    xy, xz, yz = told.Ixy, told.Ixz, told.Iyz
    return Draft(
        path.stem,
        path.name,
        _rotors(told),
        mass=_sourced(told.mass, "mass"),
        inertia=_sourced(((told.Ixx, xy, xz), (xy, told.Iyy, yz), (xz, yz, told.Izz)), "Ixx to Iyz"),
        com=CENTRE,
        imu_position=None if told.rI is None else _sourced(told.rI, "rI"),
        effects=effects,
        notes=notes_of(path.name, unread, effects),
    )


def _sourced(value: Any, keys: str) -> Sourced:
    return Sourced(value, f"{keys} of quad_params")


def _rotors(told: QuadParams) -> tuple[RotorDraft, ...]:
    radius = None if told.rotor_radius is None else _sourced(told.rotor_radius, "rotor_radius")
    return tuple(
        RotorDraft(
            _sourced(place, "rotor_pos"),
            UP,
            _sourced(-int(way), "rotor_directions, against that torque on the body,"),
            kappa=_sourced(told.k_m / told.k_eta, "k_m over k_eta"),
            c_f=_sourced(told.k_eta, "k_eta"),
            radius=radius,
            speed_min=_sourced(told.rotor_speed_min, "rotor_speed_min"),
            speed_max=_sourced(told.rotor_speed_max, "rotor_speed_max"),
        )
        for place, way in zip(told.rotor_pos.values(), told.rotor_directions, strict=True)
    )


def _effects(told: QuadParams) -> tuple[EffectDraft, ...]:
    """The terms beyond thrust and torque with the square of the speed."""
    half_density = 0.5 * BodyDragAreas.air_density
    areas = {"area_x": told.c_Dx / half_density, "area_y": told.c_Dy / half_density, "area_z": told.c_Dz / half_density}
    rows: tuple[tuple[str, str, dict[str, float], bool], ...] = (
        ("body_drag_areas", "c_Dx, c_Dy, c_Dz", areas, any(areas.values())),
        ("rotor_drag", "k_d", {"coefficient": told.k_d}, told.k_d > 0.0),
        ("axial_inflow", "k_z", {"k_z": told.k_z}, told.k_z > 0.0),
        ("translational_lift", "k_h", {"k_h": told.k_h}, told.k_h > 0.0),
        ("drag_torque_of_speed", "k_m", {"change": 0.0, "of_speed": 1.0}, told.k_m * max(told.k_z, told.k_h) > 0.0),
    )
    lag = lag_effect(told.tau_m, told.tau_m, "tau_m of quad_params")
    return (*lag, *(EffectDraft(name, values, f"{keys} of quad_params") for name, keys, values, said in rows if said))
