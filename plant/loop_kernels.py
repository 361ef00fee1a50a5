"""A closed loop in compiled code: sensors, law, allocation, plant and rigid body from step to step.

Each piece has its specification in plain numpy: `plant.sensors.read_pose`, `plant.controller`, `plant.allocation`,
`plant.closed_loop.fly` and `loss_of_control`, `plant.rigid_body`; the plant's effects come as a tape
(`plant.loop_program`). numba compiles this file once per machine: what differs between vehicles is data.
"""

# mypy: disable-error-code="no-any-return"
# Long because numba renews its cache by the file in which the outermost function stands, and by no other.

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.plant.allocation import ROUNDING
from wrenchgap.plant.tape_kernels import compiled, evaluate

GOING, LOST_STATE, LOST_PLACE, LOST_TURN, WAITING = range(5)
"""How a stretch of steps ended: at its end, with control lost (state, position, attitude), before a compensator."""

Ints = NDArray[np.int64]


class Lines(NamedTuple):
    """`plant.tape.Program` as compiled code takes it; `value` (n,) holds constants and results."""

    code: NDArray[np.int32]
    inputs: Ints
    results: Ints
    value: Array


class Body(NamedTuple):
    """Mass properties of the truth, with the inverse of the inertia about the centre of mass."""

    mass: float
    com_B: Array
    inertia: Array
    inverse: Array
    gravity: float


class Law(NamedTuple):
    """`plant.controller`: gains and what the controller believes of the body."""

    zeta_position: float
    omega_position: float
    zeta: Array
    omega: Array
    integral: float
    limit: float
    transport: float
    mass: float
    com_B: Array
    inertia: Array
    along_z: bool
    gravity: float


class Allocator(NamedTuple):
    """`plant.allocation.Allocation`: per group its arm, first column and summed c_f; per rotor its group, or -1."""

    there: bool
    inverse: Array
    arm: Ints
    column: Ints
    strength: Array
    rotor_group: Ints
    tilts: NDArray[np.bool_]
    tilt_min: Array
    tilt_max: Array
    tilt_rate_max: Array
    speed_min: Array
    speed_max: Array
    hold: float
    wrench: Array  # (6,) scratch
    thrusts: Array  # (G,) scratch


class Timing(NamedTuple):
    """When what is due, in steps; noise of the sensors (`plant.sensors.SensorNoise`); limits of control."""

    dt: float
    per_command: int
    per_imu: int
    per_pose: int
    measured: bool
    compensating: bool
    position_std: float
    attitude_std: float
    velocity_std: float
    rate_std: float
    lost_position: float
    lost_attitude: float


class Given(NamedTuple):
    """Series: `time`, `voltage`, `disturbance` of S steps, IMU errors, white noise (P, 12), reference (K, 19).

    What a recorded computer sent beyond law and allocation (`plant.flight_computer.RecordedPilot`): `offset`,
    `correction` (K, 6), `tilt` (K, A), `speed` (K, R), zero in a simulation; `forgiven` (K,) where control may be lost.
    """

    time: Array
    voltage: Array
    disturbance: Array
    imu: Array
    noise: Array
    reference: Array
    offset: Array
    correction: Array
    tilt: Array
    speed: Array
    forgiven: NDArray[np.bool_]


class Memory(NamedTuple):
    """What changes: state (13,), last pose (13,), gyroscope (3,), integral (3,), tilts (A,), effects' memory (M,).

    `counts` (4,): whether tilts are known; commands limited in rotor speed, tilt rate, tilt range. `lost` (1,): size.
    `known` (13,): what the controller knows of the state.
    """

    y: Array
    pose: Array
    gyro: Array
    integral: Array
    tilt: Array
    effects: Array
    counts: Ints
    lost: Array
    known: Array


class Flight(NamedTuple):
    """Results: states (S, 13) and wrenches (S, 6); poses (P, 13); desired, commanded (K, 6), tilts, rotor speeds."""

    rows: Array
    wrench: Array
    poses: Array
    desired: Array
    commanded: Array
    tilt: Array
    speed: Array


@compiled
def set_state(lines: Lines, first: int, y: Array, time: float, voltage: float) -> None:
    """The state's numbers as inputs of a tape, from the place `first`."""
    for i in range(13):
        lines.value[lines.inputs[first + i]] = y[i]
    lines.value[lines.inputs[first + 13]] = time
    lines.value[lines.inputs[first + 14]] = voltage


@compiled
def read_pose(timing: Timing, y: Array, noise: Array, found: Array) -> None:
    """`plant.sensors.read_pose` of one state, with white noise (12,): attitude, position, velocity, rate."""
    a, b, c = timing.attitude_std * noise[0], timing.attitude_std * noise[1], timing.attitude_std * noise[2]
    half = 0.5 * math.sqrt(a * a + b * b + c * c)
    sinc = 0.5 * math.sin(half) / half if half > 0.0 else 0.5
    qw, qx, qy, qz = math.cos(half), sinc * a, sinc * b, sinc * c
    pw, px, py, pz = y[3], y[4], y[5], y[6]
    found[3] = pw * qw - px * qx - py * qy - pz * qz
    found[4] = pw * qx + px * qw + py * qz - pz * qy
    found[5] = pw * qy - px * qz + py * qw + pz * qx
    found[6] = pw * qz + px * qy - py * qx + pz * qw
    for i in range(3):
        found[i] = y[i] + timing.position_std * noise[3 + i]
        found[7 + i] = y[7 + i] + timing.velocity_std * noise[6 + i]
        found[10 + i] = y[10 + i] + timing.rate_std * noise[9 + i]


@compiled
def observe(timing: Timing, gyro: Lines, given: Given, memory: Memory, flight: Flight, n: int) -> None:
    """What the sensors read at step n, where they are due."""
    if n % timing.per_pose == 0:
        read_pose(timing, memory.y, given.noise[n // timing.per_pose], memory.pose)
        for i in range(13):
            flight.poses[n // timing.per_pose, i] = memory.pose[i]
    if n % timing.per_imu == 0:
        set_state(gyro, 0, memory.y, given.time[n], given.voltage[n])
        evaluate(gyro, 0, len(gyro.code))
        for i in range(3):
            memory.gyro[i] = gyro.value[gyro.results[i]] + given.imu[n // timing.per_imu, i]


@compiled
def loss(timing: Timing, y: Array, reference: Array, size: Array) -> int:
    """`plant.closed_loop.loss_of_control`; how far off in `size` (1,)."""
    far = 0.0
    finite = True
    for i in range(3):
        far += (y[i] - reference[i]) ** 2
        finite = finite and math.isfinite(y[10 + i])
    far = math.sqrt(far)
    size[0] = math.nan
    if not (finite and math.isfinite(far)):
        return LOST_STATE
    if far > timing.lost_position:
        size[0] = far
        return LOST_PLACE
    same = abs(y[3] * reference[3] + y[4] * reference[4] + y[5] * reference[5] + y[6] * reference[6])
    angle = 2.0 * math.acos(min(1.0, same))
    if angle > timing.lost_attitude:
        size[0] = angle
        return LOST_TURN
    return GOING


@compiled
def turned(q: Array, a: float, b: float, c: float) -> tuple[float, float, float]:
    """The vector (a, b, c) turned by a quaternion (4,) as its matrix does it (`flight.so3.matrix`)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return (
        (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c,
        2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c,
        2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c,
    )


@compiled
def back(q: Array, a: float, b: float, c: float) -> tuple[float, float, float]:
    """As `turned`, by the transposed matrix."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return (
        (1 - 2 * (y * y + z * z)) * a + 2 * (x * y + w * z) * b + 2 * (x * z - w * y) * c,
        2 * (x * y - w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z + w * x) * c,
        2 * (x * z + w * y) * a + 2 * (y * z - w * x) * b + (1 - 2 * (x * x + y * y)) * c,
    )


@compiled
def along_thrust(fx: float, fy: float, fz: float, asked: Array, found: Array) -> None:
    """`plant.trajectory.reference.attitude_of_thrust` for the force (fx, fy, fz), with the yaw of `asked` (4,)."""
    norm = math.sqrt(fx * fx + fy * fy + fz * fz)
    x, y, z = fx / norm, fy / norm, fz / norm
    size = math.sqrt((1.0 + z) ** 2 + y * y + x * x)
    tw, tx, ty = (1.0 + z) / size, -y / size, x / size
    half = math.atan2(asked[3], asked[0])
    cw, cz = math.cos(half), math.sin(half)
    found[0], found[1], found[2], found[3] = tw * cw, tx * cw + ty * cz, ty * cw - tx * cz, tw * cz


@compiled
def desire(law: Law, known: Array, r: Array, integral: Array, room: Array, dt: float, desired: Array) -> None:
    """`plant.controller.Controller.step` in a state (13,) beside the reference (19,); the integral goes on by dt.

    `room` (4,) is for the attitude that is asked for.
    """
    s, w = law.omega_position * law.omega_position, 2.0 * law.zeta_position * law.omega_position
    fx = law.mass * (r[13] - w * (known[7] - r[7]) - s * (known[0] - r[0]))
    fy = law.mass * (r[14] - w * (known[8] - r[8]) - s * (known[1] - r[1]))
    fz = law.mass * (r[15] - w * (known[9] - r[9]) - s * (known[2] - r[2]) + law.gravity)
    q = known[3:7]
    desired[0], desired[1], desired[2] = back(q, fx, fy, fz)
    for i in range(4):
        room[i] = r[3 + i]
    if law.along_z:
        along_thrust(fx, fy, fz, r[3:7], room)
        desired[0], desired[1] = 0.0, 0.0
    # Columns of R_BD: the axes of D, in B.
    x0, y0, z0 = turned(room, 1.0, 0.0, 0.0)
    x1, y1, z1 = turned(room, 0.0, 1.0, 0.0)
    x2, y2, z2 = turned(room, 0.0, 0.0, 1.0)
    a0, a1, a2 = back(q, x0, y0, z0)
    b0, b1, b2 = back(q, x1, y1, z1)
    c0, c1, c2 = back(q, x2, y2, z2)
    # R_DB = R_BD^T, so that e_R = vee(R_DB) has these.
    ex, ey, ez = 0.5 * (c1 - b2), 0.5 * (a2 - c0), 0.5 * (b0 - a1)
    p, o, u = known[10], known[11], known[12]
    wx, wy = a0 * r[10] + b0 * r[11] + c0 * r[12], a1 * r[10] + b1 * r[11] + c1 * r[12]
    wz = a2 * r[10] + b2 * r[11] + c2 * r[12]
    dx = a0 * r[16] + b0 * r[17] + c0 * r[18] - law.transport * (o * wz - u * wy)
    dy = a1 * r[16] + b1 * r[17] + c1 * r[18] - law.transport * (u * wx - p * wz)
    dz = a2 * r[16] + b2 * r[17] + c2 * r[18] - law.transport * (p * wy - o * wx)
    z, f = law.zeta, law.omega
    dx -= 2.0 * z[0] * f[0] * (p - wx) + f[0] * f[0] * (ex + law.integral * integral[0])
    dy -= 2.0 * z[1] * f[1] * (o - wy) + f[1] * f[1] * (ey + law.integral * integral[1])
    dz -= 2.0 * z[2] * f[2] * (u - wz) + f[2] * f[2] * (ez + law.integral * integral[2])
    J = law.inertia
    lx, ly = J[0, 0] * p + J[0, 1] * o + J[0, 2] * u, J[0, 1] * p + J[1, 1] * o + J[1, 2] * u
    lz = J[0, 2] * p + J[1, 2] * o + J[2, 2] * u
    desired[3] = J[0, 0] * dx + J[0, 1] * dy + J[0, 2] * dz + (o * lz - u * ly)
    desired[4] = J[0, 1] * dx + J[1, 1] * dy + J[1, 2] * dz + (u * lx - p * lz)
    desired[5] = J[0, 2] * dx + J[1, 2] * dy + J[2, 2] * dz + (p * ly - o * lx)
    integral[0] = min(max(integral[0] + dt * ex, -law.limit), law.limit)
    integral[1] = min(max(integral[1] + dt * ey, -law.limit), law.limit)
    integral[2] = min(max(integral[2] + dt * ez, -law.limit), law.limit)


@compiled
def unwrapped(angle: float, before: float) -> float:
    """`numpy.unwrap` of an angle beside the one before."""
    step = angle - before
    turn = step + math.pi
    turn = turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi)) - math.pi
    if turn == -math.pi and step > 0.0:
        turn = math.pi
    return angle if abs(step) < math.pi else angle + (turn - step)


@compiled
def into_range(angle: float, least: float, most: float) -> float:
    """The angle of the same direction within a range, as `plant.allocation`; the angle itself where there is none."""
    turn = 2.0 * math.pi
    back = max(math.ceil((angle - most) / turn - ROUNDING), 0) - max(math.ceil((least - angle) / turn - ROUNDING), 0)
    other = angle - turn * back
    return other if least - ROUNDING <= other <= most + ROUNDING else angle


@compiled
def allocate(a: Allocator, law: Law, dt: float, wrench: Array, memory: Memory, tilt: Array, speed: Array) -> None:
    """`Allocation.allocate` of one wrench (6,) about the believed centre of mass, behind the angles sent last."""
    w = a.wrench
    c = law.com_B
    for i in range(6):
        w[i] = wrench[i]
    w[3] += c[1] * wrench[2] - c[2] * wrench[1]
    w[4] += c[2] * wrench[0] - c[0] * wrench[2]
    w[5] += c[0] * wrench[1] - c[1] * wrench[0]
    before, fresh = memory.tilt, memory.counts[0] == 0
    thrusts = a.thrusts
    for i in range(len(tilt)):
        tilt[i] = 0.0
    for g in range(len(a.arm)):
        first = 0.0
        for i in range(6):
            first += a.inverse[a.column[g], i] * w[i]
        thrust = first
        if a.tilts[a.arm[g]]:
            second = 0.0
            for i in range(6):
                second += a.inverse[a.column[g] + 1, i] * w[i]
            thrust = math.hypot(first, second)
            tilt[a.arm[g]] = math.atan2(first, second)
            if thrust < a.hold:
                tilt[a.arm[g]] = 0.0 if fresh else before[a.arm[g]]
        thrusts[g] = thrust / a.strength[g]
    slow, far = False, False
    if not fresh:
        for i in range(len(tilt)):
            tilt[i] = into_range(unwrapped(tilt[i], before[i]), a.tilt_min[i], a.tilt_max[i])
            slow = slow or not abs(tilt[i] - before[i]) <= a.tilt_rate_max[i] * dt
    else:
        for i in range(len(tilt)):
            tilt[i] = into_range(tilt[i], a.tilt_min[i], a.tilt_max[i])
    if slow:
        for i in range(len(tilt)):
            most = a.tilt_rate_max[i] * dt
            tilt[i] = before[i] + min(max(tilt[i] - before[i], -most), most)
        memory.counts[2] += 1
    for i in range(len(tilt)):
        inside = min(max(tilt[i], a.tilt_min[i]), a.tilt_max[i])
        far = far or inside != tilt[i]
        tilt[i] = inside
        memory.tilt[i] = inside
    over = False
    for i in range(len(speed)):
        square = 0.0 if a.rotor_group[i] < 0 else thrusts[a.rotor_group[i]]
        wanted = math.sqrt(max(square, 0.0))
        speed[i] = min(max(wanted, a.speed_min[i]), a.speed_max[i])
        over = over or speed[i] != wanted or square < 0.0
    memory.counts[0] = 1
    memory.counts[1] += 1 if over else 0
    memory.counts[3] += 1 if far else 0


@compiled
def slopes(body: Body, wrench: Array, y: Array, k: int, room: Array) -> None:
    """`RigidBody.derivative` at y (13,), into room[k] (13,)."""
    c, J, K = body.com_B, body.inertia, body.inverse
    fx, fy, fz = wrench[0], wrench[1], wrench[2]
    tx = wrench[3] - (c[1] * fz - c[2] * fy)
    ty = wrench[4] - (c[2] * fx - c[0] * fz)
    tz = wrench[5] - (c[0] * fy - c[1] * fx)
    w, x, y_, z, p, q, r = y[3], y[4], y[5], y[6], y[10], y[11], y[12]
    lx, ly = J[0, 0] * p + J[0, 1] * q + J[0, 2] * r, J[0, 1] * p + J[1, 1] * q + J[1, 2] * r
    lz = J[0, 2] * p + J[1, 2] * q + J[2, 2] * r
    ex, ey, ez = tx - (q * lz - r * ly), ty - (r * lx - p * lz), tz - (p * ly - q * lx)
    dp, dq = K[0, 0] * ex + K[0, 1] * ey + K[0, 2] * ez, K[0, 1] * ex + K[1, 1] * ey + K[1, 2] * ez
    dr = K[0, 2] * ex + K[1, 2] * ey + K[2, 2] * ez
    sx, sy, sz = fx / body.mass, fy / body.mass, fz / body.mass
    ux, uy, uz = q * c[2] - r * c[1], r * c[0] - p * c[2], p * c[1] - q * c[0]
    sx -= dq * c[2] - dr * c[1] + q * uz - r * uy
    sy -= dr * c[0] - dp * c[2] + r * ux - p * uz
    sz -= dp * c[1] - dq * c[0] + p * uy - q * ux
    n = 2.0 / (w * w + x * x + y_ * y_ + z * z)
    bx, by, bz = n * (y_ * sz - z * sy), n * (z * sx - x * sz), n * (x * sy - y_ * sx)
    out = room[k]
    out[0], out[1], out[2] = y[7], y[8], y[9]
    out[3], out[4] = 0.5 * (-x * p - y_ * q - z * r), 0.5 * (w * p + y_ * r - z * q)
    out[5], out[6] = 0.5 * (w * q + z * p - x * r), 0.5 * (w * r + x * q - y_ * p)
    out[7], out[8] = sx + w * bx + y_ * bz - z * by, sy + w * by + z * bx - x * bz
    out[9] = sz + w * bz + x * by - y_ * bx - body.gravity
    out[10], out[11], out[12] = dp, dq, dr


@compiled
def move(body: Body, wrench: Array, y: Array, h: float, room: Array) -> None:
    """`RigidBody.step`: y (13,) after h [s]; `room` (5, 13) is scratch."""
    at = room[4]
    slopes(body, wrench, y, 0, room)
    for stage in range(1, 4):
        part = h if stage == 3 else 0.5 * h
        for i in range(13):
            at[i] = y[i] + part * room[stage - 1, i]
        slopes(body, wrench, at, stage, room)
    for i in range(13):
        y[i] += h / 6.0 * (room[0, i] + 2.0 * (room[1, i] + room[2, i]) + room[3, i])
    scale = 1.0 / math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5] + y[6] * y[6])
    for i in range(3, 7):
        y[i] *= scale


@compiled
def push(step: Lines, given: Given, memory: Memory, flight: Flight, n: int, k: int) -> None:
    """`WrenchModel.actuate` with the commands of period k at step n: the wrench, and what effects remember."""
    place, v = 0, step.value
    for i in range(6):
        v[step.inputs[i]] = flight.commanded[k, i]
    place = 6
    for i in range(flight.tilt.shape[1]):
        v[step.inputs[place + i]] = flight.tilt[k, i]
    place += flight.tilt.shape[1]
    for i in range(flight.speed.shape[1]):
        v[step.inputs[place + i]] = flight.speed[k, i]
    place += flight.speed.shape[1]
    set_state(step, place, memory.y, given.time[n], given.voltage[n])
    place += 15
    for i in range(len(memory.effects)):
        v[step.inputs[place + i]] = memory.effects[i]
    evaluate(step, 0, len(step.code))
    for i in range(6):
        flight.wrench[n, i] = v[step.results[i]] + given.disturbance[n, i]
    for i in range(len(memory.effects)):
        memory.effects[i] = v[step.results[6 + i]]


@compiled
def decide(timing: Timing, law: Law, given: Given, memory: Memory, flight: Flight, k: int, room: Array) -> int:
    """Whether control is lost at the beginning of period k; else the desired wrench."""
    said = loss(timing, memory.y, given.reference[k], memory.lost)
    if said == LOST_STATE or (said != GOING and not given.forgiven[k]):
        return said
    for i in range(13):
        memory.known[i] = memory.pose[i] if timing.measured else memory.y[i]
    if timing.measured:
        for i in range(3):
            memory.known[10 + i] = memory.gyro[i]
    held = timing.dt * timing.per_command
    desire(law, memory.known, given.reference[k], memory.integral, room[4], held, flight.desired[k])
    for i in range(6):
        flight.desired[k, i] += given.offset[k, i]
        flight.commanded[k, i] = flight.desired[k, i] + given.correction[k, i]
    return GOING


@compiled
def begin(
    timing: Timing, gyro: Lines, law: Law, given: Given, memory: Memory, flight: Flight, n: int, room: Array
) -> int:
    """Sensors of step n, and where a period begins there, whether control is lost and what is desired."""
    observe(timing, gyro, given, memory, flight, n)
    for i in range(13):
        flight.rows[n, i] = memory.y[i]
    if n % timing.per_command == 0:
        return decide(timing, law, given, memory, flight, n // timing.per_command, room)
    return GOING


@compiled
def send(timing: Timing, law: Law, a: Allocator, given: Given, memory: Memory, flight: Flight, n: int) -> None:
    """Allocate the command of the period that begins at step n, where one does; and what goes beyond the allocation."""
    if n % timing.per_command == 0 and a.there:
        k, held = n // timing.per_command, timing.dt * timing.per_command
        tilt, speed = flight.tilt[k], flight.speed[k]
        allocate(a, law, held, flight.commanded[k], memory, tilt, speed)
        for i in range(len(tilt)):
            tilt[i] = min(max(tilt[i] + given.tilt[k, i], a.tilt_min[i]), a.tilt_max[i])
        for i in range(len(speed)):
            speed[i] = min(max(speed[i] + given.speed[k, i], a.speed_min[i]), a.speed_max[i])


@compiled
def stretch(
    timing: Timing, step: Lines, gyro: Lines, body: Body, law: Law, allocator: Allocator, given: Given, memory: Memory,
    flight: Flight, room: Array, first: int, last: int, decided: bool,
) -> tuple[int, int]:  # fmt: skip
    """Steps from `first` until `last`, until control is lost, or until a compensator is to decide.

    `decided` says that the command of the period that begins at `first` is there. How it ended, and at which step.
    """
    for n in range(first, last):
        if not (decided and n == first):
            said = begin(timing, gyro, law, given, memory, flight, n, room)
            if said != GOING:
                return said, n
            if timing.compensating and n % timing.per_command == 0:
                return WAITING, n
        send(timing, law, allocator, given, memory, flight, n)
        push(step, given, memory, flight, n, n // timing.per_command)
        move(body, flight.wrench[n], memory.y, timing.dt, room)
    return GOING, last
