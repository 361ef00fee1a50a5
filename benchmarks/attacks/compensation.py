"""What a compensation commands when its demands are saturated, upset, huge, tiny, or no numbers; in Python and in C."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

import wrenchgap as wg
from benchmarks.attacks import Attack, Outcome
from wrenchgap.compensate import Combined, Compensator, DisturbanceObserver, PhysicsMismatch, Settings
from wrenchgap.compensate.reach import Reach, reach_of
from wrenchgap.flight.errors import UsageError, WrenchgapError
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess, Provenance
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.model import Model, make_effect
from wrenchgap.plant.state import State
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.plant.wrench_model import about_origin
from wrenchgap.replay.export.export import Export

AREA = "The compensation, as it is flown"
DRAWS = 1_000_000
"""Of all exports and of all Python compensations together."""
OVERSHOOT = 1e-5
"""Share of a bound by which a command may be beyond it: rounding of single precision."""
ARMS_HELD = 0.02
"""Share of the authority by which what the allocation makes may be off: an arm that hardly pushes keeps its angle."""
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", "-fsanitize=address,undefined")
TORQUE = ("torque_x", "torque_y", "torque_z")


def _with(name: str, **effects: object) -> Model:
    model = wg.load_model(name)
    return model.with_effects([make_effect(model.vehicle, effect, values) for effect, values in effects.items()])


def _process(model: Model, mean: str) -> GaussianProcess:
    """A process of 20 points about hover, with hills of 2 % of the authority."""
    rng, authority = np.random.default_rng(3), reach_of(model.vehicle).authority
    hover = np.array([0, 0, model.vehicle.body.mass * GRAVITY, 0, 0, 0])
    return GaussianProcess(
        outputs=TORQUE,
        input_mean=hover,
        input_scale=0.1 * authority,
        output_scale=0.02 * authority[3:],
        mean_coefficients=np.zeros((3, 7)),
        inputs=rng.normal(size=(20, 6)),
        residuals=np.tanh(rng.normal(size=(20, 3))),
        lengthscales=np.full((3, 6), 2.0),
        signal_variance=np.ones(3),
        noise_variance=np.full(3, 0.05),
        sigma_training=np.full(3, 0.3),
        mismatch_max=0.02 * authority[3:],
        settings=FitSettings(points=20, mean=mean, inputs=()),  # type: ignore[arg-type]
        provenance=Provenance(vehicle=model.vehicle.name, physics=", ".join(e.name for e in model.effects)),
    )


OFFSET = [0.004, -0.007, 0.005]
TILTING = {"com_offset": OFFSET, "tilt_offset": np.linspace(-0.03, 0.04, 6), "servo_lag": [0.06]}
CASES: dict[str, tuple[Model, str | None, float | None, float | None]] = {
    "tilt_hexarotor: effects": (_with("tilt_hexarotor", com_offset=OFFSET), None, None, None),
    "tilt_hexarotor: effects and process, lags led": (_with("tilt_hexarotor", **TILTING), "physics", 0.1, None),
    "voliro_x: process and observer": (_with("voliro_x"), "zero", None, 2.0),
    "voliro_x: effects, process, observer": (_with("voliro_x", **TILTING), "physics", None, 2.0),
    "crazyflie: effects and observer": (_with("crazyflie", com_offset=[0.001, 0.002, 0.0]), None, None, 2.0),
    "asymmetric_quadrotor: process": (_with("asymmetric_quadrotor"), "zero", None, None),
}
"""Model, mean of the process (None: no process), lead [s], bandwidth of the observer [Hz]."""


def _saturates(reach: Reach, model: Model, commands: np.ndarray) -> int:
    """How many commands (N, 6) the nominal allocation of the vehicle has to limit, by more than `ARMS_HELD`."""
    vehicle = model.vehicle
    allocation, (arms, rotors) = Allocation(vehicle), vehicle.geometry()
    count = 0
    for command in commands:
        made = allocation.allocate(about_origin(vehicle.body, command[None]))[0]
        unknowns = allocation.inverse @ about_origin(vehicle.body, command[None])[0]
        wanted = allocation.matrix @ unknowns
        thrust = rotors.c_f * made.rotor_speed[0] ** 2
        back = np.zeros(6)
        for k, arm in enumerate(rotors.arm):
            angle = made.tilt[0][arm]
            along = np.cos(angle) * arms.normal_B[arm] + np.sin(angle) * arms.lateral_B[arm]
            back[:3] += thrust[k] * along
            back[3:] += thrust[k] * (np.cross(arms.position_B[arm], along) - rotors.spin[k] * rotors.kappa[k] * along)
        count += bool(np.any(np.abs(back - wanted) > ARMS_HELD * reach.authority))
    return count


def _built(made: Export, place: Path, name: str) -> Path:
    """A program of this folder with an export, under sanitisers."""
    compiler, vehicle = shutil.which("gcc") or shutil.which("cc"), made.model.vehicle
    assert compiler, "no C compiler"
    words = [f"-DAUTHORITY={{{','.join(map(repr, reach_of(vehicle).authority.tolist()))}}}"]
    words += [f"-DCORRECTION_MAX={{{','.join(map(repr, map(float, made.correction_max)))}}}"]
    words += [f"-DHOVER={vehicle.body.mass * GRAVITY!r}", f"-I{place}"]
    sources = [str(Path(__file__).with_name(f"{name}.c")), str(place / "wrenchgap_compensator.c")]
    subprocess.run([compiler, *FLAGS, *words, "-o", str(place / name), *sources, "-lm"], check=True)
    return place / name


def _corrupted(folder: Path) -> Outcome:
    """An export with effects, a process and an observer, into whose memory something else writes."""
    model = _with("tilt_hexarotor", com_offset=OFFSET)
    about = {"observer": 2.0, "observer_max": 0.05 * float(reach_of(model.vehicle).authority[3:].min())}
    made = wg.export_compensator(_process(model, "physics"), model, folder / "export", Settings(dt=0.005), **about)  # type: ignore[arg-type]
    done = subprocess.run(
        [str(_built(made, folder / "export", "corrupted")), "100000"], capture_output=True, text=True, check=False
    )
    if done.returncode:
        return Outcome(False, done.stderr[-300:])
    command, correction = map(float, done.stdout.split())
    return Outcome(
        command <= 1 + OVERSHOOT and correction <= 1 + OVERSHOOT,
        f"100,000 periods: command {command:.6f} and correction {correction:.6f} of their bounds at most",
    )


def _allocated(folder: Path) -> Outcome:
    """An exported allocation, into whose memory something else writes."""
    model = _with("tilt_hexarotor", com_offset=OFFSET, rotor_thrust=[-0.2] + 11 * [0.0])
    wg.export_allocation(model, folder / "allocation")
    vehicle, compiler = model.vehicle, shutil.which("gcc") or shutil.which("cc")
    assert compiler, "no C compiler"
    _, rotors = vehicle.geometry()
    most = float((rotors.c_f * rotors.speed_max**2).max())
    words = [f"-DHOVER={vehicle.body.mass * GRAVITY!r}", f"-DTHRUST_MAX={most!r}", f"-I{folder / 'allocation'}"]
    sources = [str(Path(__file__).with_name("allocation.c")), str(folder / "allocation" / "wrenchgap_allocation.c")]
    subprocess.run([compiler, *FLAGS, *words, "-o", str(folder / "hammer"), *sources, "-lm"], check=True)
    done = subprocess.run([str(folder / "hammer"), "200000"], capture_output=True, text=True, check=False)
    if done.returncode:
        return Outcome(False, done.stderr[-300:])
    largest, wrong, off = map(float, done.stdout.split())
    return Outcome(
        largest <= 1.0 + 1e-9 and wrong == 0.0 and off < 1e-3,
        f"200,000 periods: thrusts {largest:.6f} of their limit at most, {wrong:.0f} numbers not finite or negative; "
        f"hover behind a demand that no vehicle can make is made to {off:.1g} N and Nm",
    )


def _c(precision: str) -> Callable[[Path], Outcome]:
    """Every case as C, half of the `DRAWS` in all."""

    def run(folder: Path) -> Outcome:
        said, held = [], True
        for number, (name, (model, mean, lead, hz)) in enumerate(CASES.items()):
            reach, place = reach_of(model.vehicle), folder / f"{number}"
            gp = None if mean is None else _process(model, mean)
            settings = Settings(dt=0.005, max_evaluations=12)
            about = {"observer": hz, "observer_max": None if hz is None else 0.05 * float(reach.authority[3:].min())}
            made = wg.export_compensator(gp, model, place, settings, lead=lead, precision=precision, **about)  # type: ignore[arg-type]
            program = _built(made, place, "hammer")
            count = max(1, DRAWS // 2 // len(CASES))
            done = subprocess.run([str(program), str(count), str(number)], capture_output=True, text=True, check=False)
            if done.returncode:
                return Outcome(False, f"{name}: {done.stderr[-300:]}")
            _, command, correction, apart, refused = (float(v) for v in done.stdout.split())
            rows = np.array([[float(v) for v in line.split()] for line in done.stderr.splitlines()])
            cut = _saturates(reach, model, rows)
            held &= command <= 1 + OVERSHOOT and correction <= 1 + OVERSHOOT and apart <= 1e-6 and cut == 0
            said.append((command, correction, apart, refused / count, cut))
        worst = np.max(said, axis=0)
        return Outcome(
            bool(held),
            f"{len(CASES)} exports, {len(CASES) * count:,} draws, {100 * np.mean([s[3] for s in said]):.0f} % refused: "
            f"command {worst[0]:.6f} and correction {worst[1]:.6f} of their bounds at most, "
            f"{worst[4]:.0f} limited by the allocation, after a refused one {worst[2]:.1g} from a fresh start",
        )

    return run


def _python(_: Path) -> Outcome:
    """Every case in Python, by `step`: six draws for a thousand of those in C."""
    rng, worst, refused, cut, total = np.random.default_rng(8), np.zeros(3), 0, 0, 0
    for model, mean, lead, hz in CASES.values():
        reach = reach_of(model.vehicle)
        gp = None if mean is None else _process(model, mean)
        physics = None if gp is not None and mean == "zero" else PhysicsMismatch(model.wrench_model, TORQUE, lead)
        first = physics if gp is None else gp
        assert first is not None

        def made(first=first, physics=physics, gp=gp, model=model, hz=hz):  # type: ignore[no-untyped-def]
            known = Compensator(
                first, Settings(dt=0.005), physics=None if gp is None else physics, vehicle=model.vehicle
            )
            return known if hz is None else Combined(model.vehicle, 0.005, hz, known)

        one, hover = made(), np.array([0, 0, model.vehicle.body.mass * GRAVITY, 0, 0, 0])
        bound = _bound(one)
        for _k in range(6 * DRAWS // 1000 // len(CASES)):
            total += 1
            scale = rng.choice([0.3, 1.0, 3.0, 1e9, 1e300, 1e-300, np.inf, np.nan], p=[0.2, 0.3, 0.2] + [0.06] * 5)
            wanted = scale * rng.uniform(-1, 1, 6) * reach.authority
            bad = not np.isfinite(wanted).all()
            state = _state(rng, rng.random() < 0.2)
            try:
                got = one.step(wanted, state)
                worst[0] = max(worst[0], np.max(np.abs(got.wrench_cmd) / reach.authority))
                worst[1] = max(worst[1], np.max(np.abs(got.correction) / np.maximum(bound, 1e-300)))
                cut += _saturates(reach, model, got.wrench_cmd[None]) if total % 50 == 0 else 0
                bad = got.limited or not np.isfinite(got.cost)
            except UsageError:
                bad = True
            if bad:
                refused += 1
                calm = _state(rng, False)
                fresh = made()
                if hz is not None:
                    fresh._observed.estimate[:] = one.estimate
                off = np.abs(one.step(hover, calm).wrench_cmd - fresh.step(hover, calm).wrench_cmd)
                worst[2] = max(worst[2], off.max())
    held = worst[0] <= 1 + OVERSHOOT and worst[1] <= 1 + OVERSHOOT and worst[2] <= 1e-6 and cut == 0
    return Outcome(
        bool(held),
        f"{total:,} draws, {100 * refused / total:.0f} % refused: command {worst[0]:.6f} and correction "
        f"{worst[1]:.6f} of their bounds at most, {cut} limited by the allocation, after a refused one "
        f"{worst[2]:.1g} from a fresh start",
    )


def _bound(one: Compensator | Combined | DisturbanceObserver) -> np.ndarray:
    return np.asarray(one.correction_max)


def _state(rng: np.random.Generator, upset: bool) -> State:
    """At rest, or with numbers of any size."""
    calm = State(np.zeros(1), np.array([[0, 0, 2.0]]), np.array([[1.0, 0, 0, 0]]), np.zeros((1, 3)), np.zeros((1, 3)))
    calm = replace(calm, voltage=np.full(1, 15.0))
    if not upset:
        return calm
    size = rng.choice([5.0, 50.0, 1e6, 1e200, np.nan])
    return replace(calm, omega_B=size * rng.uniform(-1, 1, (1, 3)), velocity_E=size * rng.uniform(-1, 1, (1, 3)))


def _latched(_: Path) -> Outcome:
    """The demand of the issue: rotors saturate, and hover ever after."""
    model = _with("tilt_hexarotor", com_offset=OFFSET)
    hover = np.array([0, 0, 39.2, 0, 0, 0])
    state = _state(np.random.default_rng(0), False)
    one = Compensator(PhysicsMismatch(model.wrench_model, TORQUE), Settings(dt=0.005))
    fresh = one.step(hover, state).wrench_cmd
    said = one.step([8.08, -9.5, 26.5, -17.2, 17.8, 14.6], state)
    off = max(float(np.abs(one.step(hover, state).wrench_cmd - fresh).max()) for _ in range(100))
    wrench = ", ".join(f"{v:.1f}" for v in said.wrench_cmd)
    return Outcome(
        said.limited and off <= 1e-6 and reach_of(model.vehicle).inside(said.wrench_cmd),
        f"answered with the nearest reachable wrench, ({wrench}); hover afterwards as from a fresh start "
        f"to {off:.1g} Nm",
    )


def _refused(make: Callable[[], object], words: str) -> Callable[[Path], Outcome]:
    """Whether a compensation is refused in these words."""

    def tried(_: Path) -> Outcome:
        try:
            make()
        except WrenchgapError as error:
            return Outcome(words in str(error), f"refused: {str(error)[:160]}")
        return Outcome(False, "was made")

    return tried


def _reversed() -> object:
    return PhysicsMismatch(_with("tilt_hexarotor", thrust_scale=[-1.5]).wrench_model, TORQUE)


def _beyond() -> object:
    model = wg.load_model("tilt_hexarotor")
    gp = _process(model, "zero")
    return Compensator(replace(gp, mismatch_max=1e6 * gp.mismatch_max), vehicle=model.vehicle)


BOUND = (
    "finite, inside the vehicle's reach, correction within its stated bound; after a demand or state that is refused "
    "the next ordinary command is that of a fresh start (with the observer's estimate) within 1e-6"
)
ATTACKS = (
    Attack("a demand that saturates the rotors, then hover, compensated by `com_offset`", BOUND, _latched),
    Attack(
        "a model file with which all thrust is -0.5 of what is commanded",
        "refused: could not fly",
        _refused(_reversed, "could not fly"),
    ),
    Attack(
        "a stored process that says it has seen a mismatch beyond what the vehicle makes",
        "refused: damaged or of another vehicle",
        _refused(_beyond, "damaged or of another vehicle"),
    ),
    Attack(
        "exported C, double, under address and undefined-behaviour sanitisers: saturated, upset, huge, tiny, denormal "
        "and non-finite demands and states",
        BOUND,
        _c("double"),
        slow=True,
    ),
    Attack("the same in single precision", BOUND, _c("float"), slow=True),
    Attack(
        "numbers of a `wg_memory`, and all of it, overwritten at random in flight, under sanitisers",
        "finite, inside the vehicle's reach, correction within its stated bound",
        _corrupted,
    ),
    Attack("the same in Python, by `step`", BOUND, _python, slow=True),
    Attack(
        "the exported allocation: demands that no controller should make, its memory overwritten, under sanitisers",
        "thrusts within the rotors' limits, finite; an ordinary demand behind an odd one is made",
        _allocated,
    ),
)
