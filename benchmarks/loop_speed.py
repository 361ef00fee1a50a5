"""Processor time of a simulated flight at 1 kHz, beside plain numpy and the same plant in solve_ivp, in one run.

    python -m benchmarks.loop_speed                     # a table; nothing is written
    python -m benchmarks.loop_speed --page              # and docs/performance.md
    python -m benchmarks.loop_speed --seconds 20 --json rows.json

The flight is `multi_axis` with excitation, by tilt_hexarotor: controller and IMU at 200 Hz, pose sensor at 100 Hz, the
wrench of rotors and effects at 1 kHz, log included. With solve_ivp (RK45) the same law and allocation hold a command
for 5 ms, in which it integrates the plant to a relative 1e-6; it has no sensors, and no effects that remember.
MuJoCo, a compiled simulator, steps the vehicle of `benchmarks/hidden_effects` in its own loop under a constant thrust:
no law, no sensors, no log.
"""

from functools import partial

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

from benchmarks import pages
from benchmarks.hidden_effects.airframe import GRAVITY, MASS, ROTORS, Airframe
from benchmarks.pages import timed
from wrenchgap.plant import model_file
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.controller import control_law, next_integral
from wrenchgap.plant.effects import catalogue
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.rigid_body import RigidBody, pack, unpack
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.trajectory import named
from wrenchgap.plant.wrench_model import about_origin

MODEL = model_file.load("tilt_hexarotor")
RATE = 1000.0
STATELESS = ("com_offset", "body_drag", "rotor_drag", "wind")
PLANTS = {
    "nominal": (),
    ", ".join(STATELESS): STATELESS,
    "the same, servo_lag, motor_lag, command_delay, arm_reaction": (
        *STATELESS, "servo_lag", "motor_lag", "command_delay", "arm_reaction",
    ),
}  # fmt: skip


def truth(names):
    """The vehicle with these effects, at half their typical size, or where a search begins."""
    made = []
    for name in names:
        parameters = catalogue()[name].parameters(MODEL.vehicle)
        made.append(make_effect(MODEL.vehicle, name, tuple(p.start or 0.5 * p.scale for p in parameters)))
    return MODEL.with_effects(made)


def by_solve_ivp(model, trajectory, seconds):
    """Positions (K, 3) of a flight whose commands are held for a period, the plant integrated by scipy."""
    gains = MODEL.controller
    dt, plant = 1.0 / gains.rate_hz, model.wrench_model
    time = np.arange(round(seconds * gains.rate_hz)) * dt
    reference, body = trajectory.at(time), RigidBody(plant.body)
    r = reference.sample(0)
    y = pack(State(r.time, r.position_E, r.quat_ED, r.velocity_E, r.omega_D))
    allocation, found = Allocation(MODEL.vehicle), []
    integral, tilt = np.zeros(3), np.zeros(len(MODEL.vehicle.arms))
    for k, begin in enumerate(time.tolist()):
        found.append(y[:3])
        known = unpack(np.array([begin]), y[None])
        wrench, error = control_law(gains, MODEL.vehicle.body, known, reference.sample(k), integral[None])
        integral = next_integral(gains, integral, error[0], dt)
        tilt, speed, _ = allocation.step(about_origin(MODEL.vehicle.body, wrench)[0], tilt, k == 0, dt)

        def slopes(t, now, sent=Commands(wrench, tilt[None], speed[None])):
            return body.derivative(now, plant.wrench(sent, unpack(np.array([t]), now[None]))[0])

        y = solve_ivp(slopes, (begin, begin + dt), y, rtol=1e-6, atol=1e-9).y[:, -1]
        y[3:7] /= np.linalg.norm(y[3:7])
    return np.array(found)


def by_mujoco(seconds):
    """Processor time [s] of MuJoCo's own steps, twelve thrusters and six hinged arms that hold still."""
    model = Airframe().compile(1.0 / RATE)
    data = mujoco.MjData(model)
    data.ctrl[:ROTORS] = MASS * GRAVITY / ROTORS
    return timed(lambda: mujoco.mj_step(model, data, nstep=round(seconds * RATE)))[0]


def rows(seconds):
    """What was measured, as it comes."""
    trajectory, silent = named("multi_axis", seconds, 1.0, 3), MODEL.sensors.silent
    for label, names in PLANTS.items():
        model = truth(names)

        def flown(compiled, sensors=None, feedback="measured", model=model):
            rng = np.random.default_rng(7)
            return simulate(
                model, MODEL, trajectory, seconds, rng=rng, physics_rate=RATE, compiled=compiled, sensors=sensors,
                feedback=feedback,
            )  # fmt: skip

        flown(True)  # compiles, or loads what is compiled
        ours, one = timed(lambda: flown(True))
        plain, other = timed(lambda: flown(False))
        row = {"plant": label, "effects": len(names), "seconds": seconds, "compiled_s": ours, "plain_s": plain}
        row["apart_from_plain_m"] = float(np.abs(one.odometry.position_E - other.odometry.position_E).max())
        if not set(names) - set(STATELESS):
            theirs, positions = timed(partial(by_solve_ivp, model, trajectory, seconds))
            exact = flown(True, silent, "true").odometry.position_E
            every = round(MODEL.controller.rate_hz / silent.pose_rate_hz)
            row |= {"solve_ivp_s": theirs, "apart_from_solve_ivp_m": float(np.abs(exact - positions[::every]).max())}
        yield row
    yield {"plant": "MuJoCo's steps alone, hinged arms", "seconds": seconds, "mujoco_s": by_mujoco(seconds)}


def table(found, load):
    """In Markdown."""
    *found, other = found
    heads = ("plant", "compiled, x real time", "plain numpy", "solve_ivp", "ratio to plain", "ratio to solve_ivp")
    lines = []
    for row in found:
        ours, plain, theirs = row["compiled_s"], row["plain_s"], row.get("solve_ivp_s")
        cells = [row["plant"], f"{row['seconds'] / ours:.0f}", f"{row['seconds'] / plain:.1f}"]
        cells += ["-" if theirs is None else f"{row['seconds'] / theirs:.1f}", f"{plain / ours:.0f}"]
        cells += ["-" if theirs is None else f"{theirs / ours:.0f}", f"{row['apart_from_plain_m']:.0e}"]
        cells.append("-" if theirs is None else f"{row['apart_from_solve_ivp_m']:.0e}")
        lines.append(cells)
    lines.append([other["plant"], f"{other['seconds'] / other['mujoco_s']:.0f}", *["-"] * 6])
    return pages.markdown((*heads, "apart from plain [m]", "from solve_ivp [m]"), lines, load)


def main():
    """Measure; with --page, renew the page."""
    parser = pages.options(__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of flight")
    asked = parser.parse_args()
    pages.measure(asked, "loop", rows(asked.seconds), table)


if __name__ == "__main__":
    main()
