"""The paper's compensation as one object that fits into somebody else's control loop.

compensator = Compensator(gp)
while flying:
    wrench_des = controller(...)
    wrench_cmd = compensator.step(wrench_des).wrench_cmd

Models that depend on more than the command (`plant.mismatch.Follows`) are also given the state:
`compensator.step(wrench_des, state)`. With `physics`, the process corrects only what the named effects leave, and the
uncertainty filter lets go of that part alone: far from the data the physics stays.
"""

# Long because one object is the whole step; the loop kernels and their limits have files of their own.

import math
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from wrenchgap.compensate import kernels
from wrenchgap.compensate.fast import Limits, Plan, Stepper, plan
from wrenchgap.compensate.lbfgs import NotCompiled, Optimiser
from wrenchgap.compensate.physics import Fixed, PhysicsMismatch, Sum
from wrenchgap.compensate.reach import Reach, reach_of
from wrenchgap.compensate.tables import IMPLAUSIBLE, looked_at, state_row
from wrenchgap.compensate.uncertainty import default_filter
from wrenchgap.flight.arguments import check_types
from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.mismatch import Follows, Judged, KnowsItsData, MismatchModel, needs_state, output_indices
from wrenchgap.plant.state import State
from wrenchgap.plant.trace.arrays import Untraceable
from wrenchgap.plant.vehicle import Vehicle

Solver = Literal["newton", "lbfgs", "onboard"]


@dataclass(frozen=True)
class Settings:
    """How to compensate. None asks for the default that the model suggests.

    dt                period at which `step` is called [s], at most `max_dt`: in a second without a command a
                      multirotor falls five metres
    correction_max    (6,) largest absolute correction [N, Nm] beyond that of the physics; default three times the
                      largest mismatch in the training data; for physics, and for a model that does not know its data,
                      half of the vehicle's authority (`compensate.reach`)
    accept            J below which an optimum counts as a solution; default the paper's 1e-4 (0.01 Nm), or less for
                      a small vehicle: the square of 2 % of the largest mismatch in the training data
    regulariser       weight of the squared torque correction in the search
    max_evaluations   of the model in one search
    filter_uncertain  False switches the uncertainty filter off: the correction is the optimum
    decay_time        tau_d, time constant with which a distrusted correction dies out [s]
    sigma_threshold   standard deviation at which half of the optimum is taken
    kappa             gate slope: how sharply the correction fades around the threshold [1 over the unit of sigma]
    normalise         whether sigma is the maximum of normalised outputs (see `compensate.uncertainty`)
    solver            "newton": compiled, handing over to L-BFGS where it does not settle, and where a model cannot be
                      compiled; "lbfgs": the paper's reference, on plain models; "onboard": Newton alone, which is what
                      `wrenchgap export` writes
    despite_verdict   compensate in full, on outputs too of which `learn` says not to (`plant.mismatch.Judged`)
    good_enough       share of `accept` at which L-BFGS stops; Newton, which converges faster, goes on to 1e-14
    """

    dt: float = 0.01
    correction_max: tuple[float, ...] | None = None
    accept: float | None = None
    regulariser: float = 0.0
    max_evaluations: int = 100
    filter_uncertain: bool = True
    decay_time: float = 0.15
    sigma_threshold: float | None = None
    kappa: float | None = None
    normalise: bool | None = None
    solver: Solver = "newton"
    good_enough: float = 1e-6
    despite_verdict: bool = False
    max_dt: ClassVar[float] = 1.0

    def __post_init__(self) -> None:
        check_types(type(self), vars(self))
        positive = {"dt": self.dt, "decay_time": self.decay_time, "accept": self.accept, "kappa": self.kappa}
        for name, value in positive.items():
            if value is not None and not (math.isfinite(value) and value > 0):
                raise UsageError(f"compensate: {name} is {value}, expected a positive number")
        if self.dt > self.max_dt:
            raise UsageError(f"compensate: dt is {self.dt:g} s, expected a control period of {self.max_dt:g} s at most")
        if not (math.isfinite(self.regulariser) and self.regulariser >= 0):
            raise UsageError(f"compensate: regulariser is {self.regulariser}, expected zero or a positive number")
        if not 1 <= self.max_evaluations <= 1_000_000:
            raise UsageError(f"compensate: max_evaluations is {self.max_evaluations}, expected 1 to 1,000,000")
        threshold = self.sigma_threshold
        if threshold is not None and not threshold >= 0:
            raise UsageError(f"compensate: sigma_threshold is {threshold}, expected zero or a positive number")
        most = self.correction_max
        if most is not None and (len(most) != len(AXES) or not all(value >= 0 for value in most)):
            raise UsageError(f"compensate: correction_max is {most}, expected six numbers >= 0: {', '.join(AXES)}")


@dataclass(frozen=True)
class Result:
    """One step. Wrenches (6,) in B [N, Nm].

    wrench_cmd   what to send to the allocation: desired plus correction
    correction   after the uncertainty filter
    optimum      before it: the optimiser's choice
    sigma        largest standard deviation over the outputs at desired plus optimum
    beta         distrust, 0 (optimum taken as it is) to 1 (correction dying out)
    cost         J of `optimum`; nan where the search failed
    iterations   evaluations of the model in the search
    accepted     J is below the acceptance threshold
    limited      the vehicle cannot make the demand, or the optimum: wrench_cmd is the nearest wrench that it can
                 make (`compensate.reach`), no longer desired plus correction, and nothing is remembered of the step
    trouble      empty, or one line on what went wrong
    solve_time   wall-clock time of the step [s]; the only field that differs between two equal runs
    """

    wrench_cmd: Array
    correction: Array
    optimum: Array
    sigma: float
    beta: float
    cost: float
    iterations: int
    accepted: bool
    limited: bool = False
    trouble: str = ""
    solve_time: float = field(default=0.0, compare=False)


class Compensator:
    """Corrects desired wrenches for a known mismatch, one after the other.

    Holds two things between steps: the last unfiltered optimum, where the next search starts, and the last filtered
    correction. Equal sequences of desired wrenches give equal results. Behind a step that was limited, or whose input
    was none, it holds what it does after `reset`.

    vehicle   whose reach bounds commands and corrections; that of the physics by default. Without either only the
              correction is bounded, and only for a model that knows its data or with `Settings.correction_max`
    """

    def __init__(
        self,
        model: MismatchModel | Follows,
        settings: Settings | None = None,
        *,
        physics: PhysicsMismatch | None = None,
        vehicle: Vehicle | None = None,
    ) -> None:
        self.settings = settings or Settings()
        model = _judged(model, self.settings, physics)
        self.model, self.physics = model, physics
        if physics is not None and physics.outputs != model.outputs:
            raise UsageError(f"compensate: physics on {physics.outputs}, the model on {model.outputs}; they must agree")
        named = model if isinstance(model, PhysicsMismatch) else physics
        effects = () if named is None else named.model.effects
        self._powered = any(item.effect.needs_voltage for item in effects)
        vehicle = named.model.vehicle if vehicle is None and named is not None else vehicle
        self.reach = None if vehicle is None else reach_of(vehicle)
        bound = _bounds(model, self.settings, self.reach)
        known = bound if self.reach is None else np.where(bound > 0, self.reach.correction_max, 0.0)
        accept, s = _accept(model, self.settings), self.settings
        self._optimiser = Optimiser(-bound, bound, accept, s.regulariser, s.max_evaluations, s.good_enough)
        self._of_physics = replace(self._optimiser, lower=-known, upper=known)
        self.uncertainty = default_filter(
            model,
            decay=math.exp(-s.dt / s.decay_time),
            threshold=s.sigma_threshold if s.filter_uncertain else math.inf,
            kappa=s.kappa,
            normalise=s.normalise,
        )
        self.not_compiled: NotCompiled | None = None
        self.without_observer = ""
        """Why there is no observer where one was requested."""
        self._fast = self._compiled(bound, known, accept)
        self.reset()

    def _compiled(self, bound: Array, known: Array, accept: float) -> Stepper | None:
        """Compiled steps; None where the settings exclude them, or, as `not_compiled` says, where a model does."""
        s = self.settings
        if s.solver == "lbfgs" or (s.solver == "newton" and s.regulariser > 0.0):
            return None
        limits = Limits(bound, known, self.reach, accept, s.max_evaluations, s.dt, s.solver == "onboard")
        try:
            step_plan = plan(self.model, self.physics, self.uncertainty, limits)
        except Untraceable as error:
            if s.solver == "onboard":
                raise UsageError(f"compensate: solver onboard: {error}") from None
            self.not_compiled = NotCompiled(str(error))
            return None
        return Stepper(step_plan, self._optimiser, self._of_physics)

    def reset(self) -> None:
        """Forget the past: the next search starts from zero, with no correction to decay."""
        self.forget()
        self._model: MismatchModel | None = None
        self._stepped = False

    def forget(self) -> None:
        """As `reset`, but that `expected` still answers as at the last step."""
        self._optimum = np.zeros(len(AXES))
        self._correction = np.zeros(len(AXES))  # less that of the physics
        self._known = np.zeros(len(AXES))  # correction of the physics alone
        self._following = [m.follow(self.settings.dt) if isinstance(m, Follows) else Fixed(m) for m in self._parts]
        if self._fast is not None:
            self._fast.reset()

    @property
    def _parts(self) -> list[MismatchModel | Follows]:
        return [self.model] if self.physics is None else [self.physics, self.model]

    def step(self, wrench_des: ArrayLike, state: State | None = None) -> Result:
        """Command for the desired wrench (6,) [N, Nm], in this state (N = 1) where the model needs it.

        Raises UsageError on anything but six finite numbers, or without a state that is needed. Trouble of the solver
        or the model never raises, nor does a state that is none: the optimum is then zero and `Result.trouble` says
        why.
        """
        try:
            return self._step(wrench_of(wrench_des), state)
        except BaseException:
            self.forget()
            raise

    def _step(self, wanted: Array, state: State | None) -> Result:
        started = perf_counter()
        self.check_voltage(state)
        if self._fast is not None:
            if state is None and self.needs_state:
                for follower in self._following:
                    follower.model_at(None)  # says which model it is that needs the state
            row = self._fast.one(wanted, state)
            self._stepped = True
            return result_of(row.copy(), self._fast.trouble, perf_counter() - started)
        wrench, limited = (wanted, False) if self.reach is None else self.reach.nearest(wanted)
        if state is not None and self.needs_state and not plausible(state, powered=self._powered):
            self.forget()
            zero = np.zeros(len(AXES))
            return Result(wrench, zero, zero, 0.0, 1.0, math.nan, 0, False, limited, IMPLAUSIBLE)
        here = [f.model_at(state) for f in self._following]
        model = self._model = Sum(*here) if len(here) > 1 else here[0]
        iterations = 0
        if len(here) > 1:
            known = self._of_physics.solve(here[0], wrench, self._known)
            self._known, iterations = known.correction, known.iterations
        optimum = self._optimiser.solve(model, wrench, self._optimum, self._known)
        with np.errstate(all="ignore"):
            sigma = self.uncertainty.sigma(here[-1].std((wrench + optimum.correction)[None])[0])
        trouble, beta = optimum.trouble, self.uncertainty.beta(sigma)
        if not math.isfinite(sigma):
            beta, trouble = 1.0, trouble or "the model's standard deviation is not finite: correction withheld"
        self._optimum = optimum.correction
        self._correction = self.uncertainty.filtered(optimum.correction - self._known, self._correction, beta)
        correction = self._known + self._correction
        command, cut = (wrench + correction, False) if self.reach is None else self.reach.nearest(wrench + correction)
        limited = limited or cut
        found, cost, iterations = optimum.correction.copy(), optimum.cost, iterations + optimum.iterations
        if limited or not math.isfinite(cost):
            self.forget()
        else:
            for follower in self._following:
                follower.record(command)
        took = perf_counter() - started
        return Result(
            command, correction, found, sigma, beta, cost, iterations, optimum.accepted, limited, trouble, took
        )

    def check_voltage(self, states: State | None) -> None:
        """Raise UsageError where an effect needs the voltage and the states have none at all."""
        if self._powered and states is not None and states.voltage is None:
            raise UsageError("compensate: effect battery_sag needs the voltage, and the state has none")

    def steps_compiled(self, with_states: bool) -> Stepper | None:
        """What makes many steps at once; None where `rows_by_step` must, one after the other. See `compensate.run`."""
        if self._fast is None or (self.needs_state and not with_states):
            return None
        self._stepped = True
        return self._fast

    def rows_by_step(self, wrenches: Array, states: State | None) -> tuple[Array, dict[int, str]]:
        """Results (K, 24 + 2 L) of consecutive steps as `compensate.run` orders them, and trouble by step."""
        rows, trouble = [], dict[int, str]()
        for k, wrench in enumerate(wrenches):
            one = self.step(wrench, None if states is None else states.take(slice(k, k + 1)))
            numbers_of = [one.sigma, one.beta, one.cost, one.iterations, one.accepted, one.limited]
            expected = [self.expected(wrench), self.expected(one.wrench_cmd)]
            rows.append(np.concatenate([one.wrench_cmd, one.correction, one.optimum, numbers_of, *expected]))
            if one.trouble:
                trouble[k] = one.trouble
        return np.array(rows), trouble

    @property
    def correction_max(self) -> Array:
        """Largest correction (6,) by all parts [N, Nm]; infinite where neither data nor a vehicle bound it."""
        known = 0.0 if self.physics is None else self._of_physics.upper
        return np.asarray(self._optimiser.upper + known)

    @property
    def plan(self) -> Plan | None:
        """What is compiled, None where plain models step."""
        return None if self._fast is None else self._fast.plan

    @property
    def needs_state(self) -> bool:
        """Whether `step` needs the state."""
        return any(needs_state(part) for part in self._parts)

    def expected(self, wrench_cmd: Array) -> Array:
        """Mismatch (L,) of a command (6,) at the last step, as the models then had it."""
        if self._fast is not None and self._stepped:
            return self._fast.expected(wrench_cmd)
        if self._model is None:
            raise UsageError("compensate: nothing is expected before the first step")
        return np.asarray(self._model.mean(wrench_cmd[None])[0])


def result_of(row: Array, trouble: str, took: float) -> Result:
    """A row of `compensate.run` as a result."""
    sigma, beta, cost, evaluations, accepted, limited = row[18:24].tolist()
    if not math.isfinite(sigma):
        trouble = trouble or "the model's standard deviation is not finite: correction withheld"
    if not math.isfinite(cost):
        trouble = trouble or "no correction: the mismatch model gave a value that is not finite"
    said = (sigma, beta, cost, int(evaluations), accepted > 0.0, limited > 0.0, trouble, took)
    return Result(row[:6], row[6:12], row[12:18], *said)


def _judged(
    model: MismatchModel | Follows, settings: Settings, physics: PhysicsMismatch | None
) -> MismatchModel | Follows:
    """The model as far as it is to be compensated; UsageError where nothing is."""
    if not isinstance(model, Judged):
        return model
    if settings.despite_verdict:
        return model.despite_verdict()
    if physics is None and set(model.refused) == set(model.outputs):
        raise UsageError(
            f"compensate: the verdict of `wrenchgap learn` on {', '.join(model.outputs)} is not to compensate, and "
            "there is nothing else; learn from another flight or on named effects, or say --despite-verdict "
            "(Settings(despite_verdict=True))"
        )
    return model


def wrench_of(wrench_des: ArrayLike) -> Array:
    """A desired wrench as an array (6,) [N, Nm]; raises UsageError for anything but six finite numbers."""
    try:
        wrench = np.array(wrench_des, dtype=float)
    except (TypeError, ValueError):
        raise UsageError(f"compensate: desired wrench {wrench_des!r} is not six numbers: {', '.join(AXES)}") from None
    if wrench.shape != (len(AXES),):
        raise UsageError(f"compensate: desired wrench has shape {wrench.shape}, expected (6,): {', '.join(AXES)}")
    if not np.isfinite(wrench).all():
        raise UsageError(f"compensate: desired wrench {wrench.tolist()} is not finite; check the controller")
    return wrench


def plausible(state: State, *, powered: bool = False) -> bool:
    """Whether the first state is one that a flight can have; its voltage too where an effect is `powered`."""
    return bool(kernels.plausible(looked_at(True, powered=powered), state_row(state)))


def _accept(model: MismatchModel | Follows, settings: Settings, most: float = 1e-4, share: float = 0.02) -> float:
    """J below which an optimum is accepted.

    `most` is the paper's threshold, (0.01 Nm)^2, for a vehicle with a mismatch of some 0.5 Nm. `share` of the largest
    mismatch seen may remain where that is less: a 40 g quadrotor has torques of 1e-4 Nm.
    """
    if settings.accept is not None:
        return settings.accept
    own = float(np.sum((share * model.mismatch_max) ** 2)) if isinstance(model, KnowsItsData) else 0.0
    return min(most, own) if own > 0 else most


def largest_correction(model: KnowsItsData, factor: float = 3.0) -> Array:
    """Default bound of the correction (L,) [N or Nm]: `factor` times the largest mismatch seen.

    A slope of -2/3, which triples the correction of an error, is as near to the singular -1 as a model is trusted.
    """
    return factor * model.mismatch_max


def _bounds(model: MismatchModel | Follows, settings: Settings, reach: Reach | None) -> Array:
    """Largest absolute correction (6,), zero where the model has no output.

    Raises FitError for a process that has seen more than this vehicle can make.
    """
    rows = output_indices(model.outputs)
    bound = np.zeros(len(AXES))
    if isinstance(model, KnowsItsData):
        bound[rows] = largest_correction(model)
        if reach is not None:
            for name, seen, most in zip(model.outputs, model.mismatch_max, reach.authority[rows], strict=True):
                if not seen <= most:
                    raise FitError(
                        f"compensate: the process has seen a mismatch of {seen:.3g} on {name}, and the vehicle makes "
                        f"{most:.3g} at most: its file is damaged or of another vehicle; learn it again"
                    )
            bound[rows] = np.minimum(bound[rows], reach.authority[rows])
    else:
        bound[rows] = np.inf if reach is None else reach.correction_max[rows]
    if settings.correction_max is not None:
        bound[rows] = np.array(settings.correction_max, dtype=float)[rows]
    return bound
