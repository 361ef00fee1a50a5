"""A model as a sheet: mass properties, rotors, the command curve, effects, what was assumed; as JSON and as a table."""

from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant.command_curve import CommandCurve
from wrenchgap.plant.drafts.draft import Sheet
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.replay.present.addition import effects_json, model_table
from wrenchgap.replay.present.figures import style, vehicle
from wrenchgap.replay.present.figures.vehicle import hubs
from wrenchgap.replay.present.numbers import entries, number, quantity
from wrenchgap.replay.present.tables import Line, Part, note_lines, table

ROTOR_LEGEND = "x forward, y left, z up, from the body origin   turns: seen against the thrust, so from above"


def parts(sheet: Sheet) -> list[Part]:
    """What was understood, what was assumed."""
    model = sheet.model
    out: list[Part] = [Line(line) for line in overview(model)]
    if model.vehicle.has_rotors:
        out += [Line(), rotor_table(model.vehicle), Line(ROTOR_LEGEND, "dim")]
    if model.effects:
        out += [Line(), model_table(model)]
    out += [Line(), *note_lines(sheet.assumed, "assumed")] if sheet.assumed else []
    return [*out, *note_lines([*sheet.notes, *model.notes])]


def overview(model: Model) -> list[str]:
    """Mass properties, what full thrust is, and the curve of commands, a line each."""
    vehicle, body, told = model.vehicle, model.vehicle.body, model.vehicle.tolerances
    moments = np.diag(body.inertia)
    share = "" if told.inertia is None else f" +-{100.0 * float(np.max(np.diag(told.inertia) / moments)):.2g} %"
    mass = quantity(body.mass, "kg") + ("" if told.mass is None else f" +-{quantity(told.mass, 'kg', 2)}")
    lines = [
        f"{vehicle.name}: {mass}; moments of inertia {', '.join(number(m) for m in moments)} kg m^2{share}",
        f"centre of mass at {_place(body.com_B)}, IMU at {_place(vehicle.imu_position_B)}",
    ]
    if vehicle.has_rotors:
        lines.append(f"full thrust is {number(full_thrust(vehicle), 2)} times the weight")
    granted = [
        *([f"thrust +-{100.0 * told.thrust:.2g} %"] if told.thrust else []),
        *([f"thrust axes +-{np.degrees(told.thrust_axis):.2g} deg"] if told.thrust_axis else []),
    ]
    if granted:
        lines.append(f"not known better than: {', '.join(granted)}")
    if model.command is not None:
        hover = "no command: the curve never carries the weight"
        if (at := hover_command(model)) is not None:
            hover = f"{at:.0f} us" if at > 10.0 else f"{100.0 * at:.0f} % of full throttle"
        lines.append(f"rotor commands: {_curve(model.command)}; hover at {hover}")
    return lines


def _place(at: Array) -> str:
    return f"({', '.join(number(1e3 * v) for v in at)}) mm"


def _curve(curve: CommandCurve) -> str:
    ends = "" if curve.ends == (0.0, 1.0) else f" from {curve.ends[0]:g} to {curve.ends[1]:g}"
    battery = ", with the battery's voltage" if curve.uses_voltage else ""
    origin = f" ({curve.source})" if curve.source else ""
    return f"{curve.unit}{ends}, by a curve to {curve.gives}{battery}{origin}"


def full_thrust(vehicle: Vehicle) -> float:
    """Thrust of all rotors at their highest speed, over the weight."""
    _, rotors = vehicle.geometry()
    return float(np.sum(rotors.c_f * rotors.speed_max**2) / (vehicle.body.mass * GRAVITY))


def hover_command(model: Model, steps: int = 400) -> float | None:
    """Command at which equal rotors, all up, carry the weight; None where none of `steps` over its range does."""
    curve, vehicle = model.command, model.vehicle
    if curve is None or not vehicle.has_rotors:
        return None
    arms, rotors = vehicle.geometry()
    commands = np.linspace(*curve.span, steps)
    speeds = curve.speeds(np.repeat(commands[:, None], len(rotors), 1), None, vehicle)
    lift = (rotors.c_f * speeds**2) @ np.abs(arms.normal_B[rotors.arm, 2])
    carried = np.flatnonzero(lift >= vehicle.body.mass * GRAVITY)
    return float(commands[carried[0]]) if carried.size else None


def _rows(vehicle: Vehicle) -> list[dict[str, Any]]:
    if not vehicle.has_rotors:
        return []
    _, rotors = vehicle.geometry()
    places = hubs(vehicle)
    return [
        {
            "rotor": vehicle.rotor_name(r),
            **dict(zip("xyz", places[r].tolist(), strict=True)),
            "spin": int(rotors.spin[r]),
            **{name: float(getattr(rotors, name)[r]) for name in ("c_f", "kappa", "radius")},
            "thrust_max": float(rotors.c_f[r] * rotors.speed_max[r] ** 2),
        }
        for r in range(len(rotors))
    ]


def rotor_table(vehicle: Vehicle) -> Part:
    """One row for each rotor."""
    heads = ("rotor", "x [mm]", "y [mm]", "z [mm]", "turns", "full thrust [N]", "kappa [mm]", "radius [mm]")
    rows = [
        (
            row["rotor"],
            *(number(1e3 * row[axis]) for axis in "xyz"),
            "counter-clockwise" if row["spin"] > 0 else "clockwise",
            number(row["thrust_max"]),
            *(number(1e3 * row[key]) for key in ("kappa", "radius")),
        )
        for row in _rows(vehicle)
    ]
    return table("rotors, in the order of logged commands", heads, rows)


def to_json(sheet: Sheet) -> dict[str, Any]:
    """The body of the `model` schema."""
    model, curve = sheet.model, sheet.model.command
    return {
        **entries(model.vehicle, "name", "mass=body.mass", "inertia=body.inertia", "com=body.com_B"),
        **entries(model.vehicle, "imu_position=imu_position_B", "tolerances"),
        "rotors": _rows(model.vehicle),
        "full_thrust_over_weight": full_thrust(model.vehicle) if model.vehicle.has_rotors else None,
        "command": curve and {**entries(curve, "unit", "gives", "source"), "hover": hover_command(model)},
        "effects": effects_json(model.snapshot),
        "assumed": list(sheet.assumed),
        "notes": [*sheet.notes, *model.notes],
    }


def frame(sheet: Sheet) -> list[dict[str, Any]]:
    """One row for each rotor."""
    return _rows(sheet.model.vehicle)


def picture(sheet: Sheet) -> style.Picture:
    """Arms, rotors, the centre of mass, the IMU (`figures.vehicle`)."""
    return vehicle.picture(sheet.model.vehicle)
