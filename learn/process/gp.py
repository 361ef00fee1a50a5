"""Gaussian processes for the mismatch between commanded and real wrench, evaluated in closed form.

L independent outputs, each with a squared-exponential kernel with one lengthscale per input, and Gaussian noise
(Rasmussen and Williams 2006, chapter 2; paper, 'Learning model-plant mismatch'). With x the standardised input,
X (N, D) the training inputs, and for each output

    k(x, x')  = s_f^2 exp(-1/2 sum_d (x_d - x'_d)^2 / l_d^2)
    alpha     = (K + s_n^2 I)^-1 (z - m(X))
    mean      = m(x) + k(x, X) alpha                                m(x) = b_0 + b . x, zero unless asked for
    var       = k(x, x) + s_n^2 - |C^-1 k(X, x)|^2                  C C^T = K + s_n^2 I
    dmean/dx_d = b_d + sum_n alpha_n k(x, X_n) (X_nd - x_d) / l_d^2

`mean` and its derivative are multiplied by `gain`, what held-out time supports of each output
(`learn.process.held_out_time`).

A sparse posterior (Titsias 2009, `learn.process.subsample`) brings its own `weights` in place of alpha and its own
`whitener` in place of C^-1; its X are the inducing inputs.

Inputs are the six components of the command, and where `settings.inputs` says so the groups of
`plant.mismatch_inputs` behind them. The hyperparameters come from `learn.process.train`.
"""

# Long because the closed forms of mean, standard deviation and Jacobian share the factors that one class keeps.

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Literal

import numpy as np

from wrenchgap.flight.arguments import check_types
from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.process.held_out_time import Decision, Verdict
from wrenchgap.learn.process.subsample import JITTER, Method, Scale
from wrenchgap.plant import mismatch_inputs
from wrenchgap.plant.effects.lag import LagMemory
from wrenchgap.plant.mismatch import Expansion, MismatchModel, output_indices
from wrenchgap.plant.reader import Names, NotNegative, Positive, Real, stored
from wrenchgap.plant.state import State

MeanKind = Literal["zero", "constant", "linear", "physics"]
Inference = Literal["exact", "sparse"]
Search = Literal["closed-form", "gpy"]


@stored
@dataclass(frozen=True)
class LogSource:
    """A log that went into a fit: its name and the SHA-256 of its content."""

    name: str
    sha256: str


class CautionKind(StrEnum):
    """What a user should know before trusting the correction."""

    NEARLY_SINGULAR = "nearly singular"  # of I + dmu/dW on the training flights
    WORSE = "worse"  # on unseen flights the process makes the error of `axes` larger
    NOT_WORTH_IT = "not worth it"  # on unseen flights something simpler does as well on `axes`
    ALLOCATED = "allocated"  # the commanded wrench is what the model makes of the logged actuators
    SAID = "said"  # `text` of a file that an older version wrote


@stored
@dataclass(frozen=True)
class Caution:
    """One of them: axes with their rms on unseen flights before and after, or the smallest `eigenvalue`."""

    kind: CautionKind
    axes: Names = ()
    before: tuple[Real, ...] = ()
    after: tuple[Real, ...] = ()
    eigenvalue: Real | None = None
    text: str = ""


@stored
@dataclass(frozen=True)
class Provenance:
    """Where a fitted model comes from, and what `learn` found of it.

    physics       names the effects whose remainder was learnt
    warnings      what is wrong with it
    verdicts      one for each output; none in files of older versions, and where nobody asked
    lags          first-order lag of each output behind the commands, as the fit found it [s] (`learn.identify.samples`)
    margin        least stability margin along the training commands (`plant.stability`)
    observer_hz   bandwidth of the observer of what is left that log and loop support [Hz] (`learn.identify.observer`);
                  None: none does, or nobody looked
    observer_lag  lag that this observer takes the vehicle to have [s]
    observer_peak M_s of the attitude loop with it, without it where there is none; None where that loop is unstable
    observer_left share that the best observer within the margins leaves of what none leaves; None where there is none
    loop_lag, loop_delay    of the actuators, with which the loop was judged [s]
    gains         where the gains of that loop come from: "log", "model", or "typical" of a vehicle of that size
    """

    vehicle: str = ""
    model_hash: str = ""
    physics: str = "nominal"
    cutoff_hz: Positive | None = None
    logs: tuple[LogSource, ...] = ()
    version: str = ""
    date: str = ""
    warnings: tuple[Caution, ...] = ()
    verdicts: tuple[Verdict, ...] = ()
    lags: tuple[NotNegative, ...] = ()
    margin: Real | None = None
    observer_hz: Positive | None = None
    observer_lag: NotNegative = 0.0
    observer_peak: Real | None = None
    observer_left: Real | None = None
    loop_lag: NotNegative = 0.0
    loop_delay: NotNegative = 0.0
    gains: str = ""


@dataclass(frozen=True)
class FitSettings:
    """How a GP is fitted.

    points    training inputs kept (paper: 100 in real flight, 200 in simulation)
    method    k-medoids library; `pyclustering` is the paper's
    scale     inputs standardised for the distance between samples, or raw as in the paper
    mean      "zero" is the paper's and returns to zero off the data; "constant" and "linear" are fitted to all
              samples by least squares, and do not; "physics" is the model with its effects, on whose remainder the
              process has mean zero
    inputs    groups of `plant.mismatch_inputs` besides the commanded wrench
    inference "exact" on the points kept, or "sparse": all samples, seen through as many inducing points
    calibrate scale sigma by what it turns out to be on blocks of time that were left out
    restarts  searches from random hyperparameters besides two fixed ones, deterministic in `seed`
    blind     components of the command that the process does not look at
    search    "closed-form", or GPy's, the paper's: the same optima in several times the time
    guarded   `learn` decides by held-out time what of it is believed (docs/do-no-harm.md); False: the
              paper's, believed as it is
    """

    points: int = 200
    method: Method = "fasterpam"
    scale: Scale = "standardised"
    mean: MeanKind = "zero"
    inputs: tuple[str, ...] = ()
    inference: Inference = "exact"
    calibrate: bool = True
    restarts: int = 1
    seed: int = 0
    pre_thin: int = 5000
    blind: tuple[str, ...] = ()
    guarded: bool = True
    search: Search = "closed-form"

    def __post_init__(self) -> None:
        check_types(type(self), vars(self))
        object.__setattr__(self, "inputs", mismatch_inputs.ordered_groups(self.inputs))
        if self.blind:
            output_indices(self.blind)


@dataclass(frozen=True)
class _Factors:
    """What every query needs, per output: inputs over lengthscales, alpha, inverse Cholesky factor."""

    points: Array  # (L, N, D)
    squares: Array  # (L, 1, N)
    alpha: Array  # (L, N)
    whitener: Array  # (L, N, N), C^-1


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """L independent GPs over inputs xi (D,), immutable; a `plant.mismatch.MismatchModel` for D = 6.

    With more inputs `follow` makes it one, instant by instant.

    outputs             names out of `flight.flight.AXES`, L of them
    input_mean          (D,), input_scale (D,): x = (xi - input_mean) / input_scale
    output_scale        (L,) [N or Nm]: standardised output = output / output_scale
    mean_coefficients   (L, 1 + D): b_0 and b of m(x), standardised
    inputs              (N, D) training inputs, standardised
    residuals           (N, L) training outputs minus m, standardised
    lengthscales        (L, D), signal_variance (L,), noise_variance (L,), of standardised quantities
    sigma_training      (L,) 99th percentile of `std` over all samples that were given to the fit [N or Nm]
    mismatch_max        (L,) largest absolute output among them [N or Nm]
    sigma_scale         (L,) factor of calibration in `std` (`learn.process.held_out_time`)
    gain                (L,) what `mean` is multiplied by, 0 to 1
    weights             (L, N) and `whitener` (L, N, N) of a sparse posterior; empty for an exact one
    """

    outputs: tuple[str, ...]
    input_mean: Array
    input_scale: Array
    output_scale: Array
    mean_coefficients: Array
    inputs: Array
    residuals: Array
    lengthscales: Array
    signal_variance: Array
    noise_variance: Array
    sigma_training: Array
    mismatch_max: Array
    sigma_scale: Array = field(default_factory=lambda: np.empty(0))
    gain: Array = field(default_factory=lambda: np.empty(0))
    weights: Array = field(default_factory=lambda: np.empty((0, 0)))
    whitener: Array = field(default_factory=lambda: np.empty((0, 0, 0)))
    settings: FitSettings = field(default_factory=FitSettings)
    provenance: Provenance = field(default_factory=Provenance)
    _factors: _Factors = field(init=False, repr=False)

    def __repr__(self) -> str:
        return f"<GaussianProcess of {', '.join(self.outputs)}: {len(self.inputs)} points on {self.provenance.physics}>"

    def __post_init__(self) -> None:
        output_indices(self.outputs)
        for name in ("sigma_scale", "gain"):
            if np.size(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.ones(len(self.outputs)))
        for name, shape in self.array_shapes().items():
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != shape:
                raise FitError(f"GP: {name} has shape {array.shape}, expected {shape}")
            if not np.isfinite(array).all():
                raise FitError(f"GP: {name} holds values that are not finite")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        expected = len(AXES) + len(mismatch_inputs.columns(self.settings.inputs))
        if self.settings.inputs and self.inputs.shape[1] != expected:
            raise FitError(f"GP: {self.inputs.shape[1]} inputs, expected {expected} of the command and its settings")
        for name in ("input_scale", "output_scale", "lengthscales", "signal_variance", "noise_variance", "sigma_scale"):
            if (getattr(self, name) <= 0).any():
                raise FitError(f"GP: {name} must be positive, got {getattr(self, name).min():g}")
        for name in ("sigma_training", "mismatch_max"):
            if (getattr(self, name) < 0).any():
                raise FitError(f"GP: {name} must not be negative, got {getattr(self, name).min():g}")
        if (self.gain < 0).any() or (self.gain > 1).any():
            raise FitError(f"GP: gain must be between 0 and 1, got {self.gain.tolist()}")
        object.__setattr__(self, "_factors", self._factor())

    def array_shapes(self) -> dict[str, tuple[int, ...]]:
        """Expected shape of every array, by field name."""
        (count, dims), outputs = np.shape(self.inputs), len(self.outputs)
        sparse = (outputs, count) if np.size(self.weights) else (0, 0)
        return {
            "input_mean": (dims,),
            "input_scale": (dims,),
            "output_scale": (outputs,),
            "mean_coefficients": (outputs, 1 + dims),
            "inputs": (count, dims),
            "residuals": (count, outputs),
            "lengthscales": (outputs, dims),
            "signal_variance": (outputs,),
            "noise_variance": (outputs,),
            "sigma_training": (outputs,),
            "mismatch_max": (outputs,),
            "sigma_scale": (outputs,),
            "gain": (outputs,),
            "weights": sparse,
            "whitener": (*sparse, sparse[-1]),
        }

    @property
    def input_groups(self) -> tuple[str, ...]:
        """Groups of inputs besides the command."""
        return self.settings.inputs

    @property
    def sigma_prior(self) -> Array:
        """`std` infinitely far from the training inputs (L,) [N or Nm]."""
        spread = np.sqrt(self.signal_variance + self.noise_variance)
        return np.asarray(self.output_scale * self.sigma_scale * spread)

    @property
    def needs_state(self) -> bool:
        """See `plant.mismatch.Follows`."""
        return bool(self.settings.inputs)

    def follow(self, dt: float) -> Following:
        """See `plant.mismatch.Follows`."""
        return Following(self, dt)

    def expansion(self) -> Expansion:
        """See `plant.mismatch.Expands`."""
        shared = ("outputs", "input_mean", "input_scale", "output_scale", "lengthscales")
        spread = ("signal_variance", "noise_variance", "sigma_scale")
        f = self._factors
        return Expansion(
            input_groups=self.settings.inputs,
            **{name: getattr(self, name) for name in shared + spread},
            mean_coefficients=self.mean_coefficients * self.gain[:, None],
            points=f.points,
            alpha=f.alpha * self.gain[:, None],
            whitener=f.whitener,
        )

    def given(self, extra: Array) -> MismatchModel:
        """The process as a function of the command alone, its further inputs being `extra` (D - 6,)."""
        return self if len(self.input_mean) == len(AXES) else _Given(self, extra)

    def mean(self, xi: Array, /) -> Array:
        """Expected mismatch (M, L) [N or Nm] at commands xi (M, D)."""
        return _blockwise(self._mean, xi)

    def std(self, xi: Array, /, noise: bool = True) -> Array:
        """Standard deviation (M, L) [N or Nm]: of a measurement, or without `noise` of the function alone."""
        return _blockwise(lambda part: self._std_of(self._kernel(part)[2], noise), xi)

    def jacobian(self, xi: Array, /) -> Array:
        """Derivative of the mean (M, L, D)."""
        return _blockwise(lambda part: self.mean_and_jacobian(part)[1], xi)

    def predict(self, xi: Array, /) -> tuple[Array, Array]:
        """Mean and standard deviation, noise included, (M, L) each."""
        both = []
        for part in _blocks(xi):
            x, _, k = self._kernel(part)
            both.append((self._mean_of(x, k), self._std_of(k, noise=True)))
        mean, std = (np.concatenate(parts) for parts in zip(*both, strict=True))
        return mean, std

    def mean_and_jacobian(self, xi: Array, /) -> tuple[Array, Array]:
        """Mean (M, L) and its derivative (M, L, D), sharing one evaluation of the kernel."""
        x, q, k = self._kernel(xi)
        weighted = k * self._factors.alpha[:, None, :]
        total = weighted.sum(axis=2)
        slope = (weighted @ self._factors.points - total[:, :, None] * q) / self.lengthscales[:, None, :]
        slope += self.mean_coefficients[:, None, 1:]
        jacobian = slope.transpose(1, 0, 2) * ((self.gain * self.output_scale)[:, None] / self.input_scale)
        return self._with_mean_function(x, total), jacobian

    @property
    def refused(self) -> tuple[str, ...]:
        """Outputs on which the verdict of `learn` is not to compensate; see `plant.mismatch.Judged`."""
        return tuple(v.output for v in self.provenance.verdicts if v.decision is not Decision.COMPENSATE and not v.gain)

    def despite_verdict(self) -> GaussianProcess:
        """The process as it was fitted, believed in full."""
        return replace(self, gain=np.ones(len(self.outputs)))

    def check_vehicle(self, vehicle: str) -> None:
        """Raise FitError unless this GP was learnt on the named vehicle."""
        if self.provenance.vehicle != vehicle:
            raise FitError(
                f"GP of another vehicle: learnt on {self.provenance.vehicle!r}, the model is {vehicle!r}; "
                "learn one from this vehicle's logs with `wrenchgap learn`"
            )

    def _mean(self, xi: Array) -> Array:
        x, _, k = self._kernel(xi)
        return self._mean_of(x, k)

    def _mean_of(self, x: Array, k: Array) -> Array:
        return self._with_mean_function(x, (k @ self._factors.alpha[:, :, None])[:, :, 0])

    def _with_mean_function(self, x: Array, standardised: Array) -> Array:
        """`standardised` (L, M) plus m(x), in N and Nm: (M, L)."""
        mean_function = self.mean_coefficients[:, 0] + x @ self.mean_coefficients[:, 1:].T
        return np.asarray((mean_function + standardised.T) * (self.gain * self.output_scale))

    def _std_of(self, k: Array, noise: bool) -> Array:
        whitened = self._factors.whitener @ k.transpose(0, 2, 1)  # (L, N, M)
        explained = np.einsum("lnm,lnm->ml", whitened, whitened)
        variance = np.maximum(self.signal_variance - explained, 0.0) + (self.noise_variance if noise else 0.0)
        return np.asarray(np.sqrt(variance) * (self.output_scale * self.sigma_scale))

    def _kernel(self, xi: Array) -> tuple[Array, Array, Array]:
        """Standardised x (M, D), x over lengthscales (L, M, D), k(x, X) (L, M, N)."""
        x = (xi - self.input_mean) / self.input_scale
        q = x / self.lengthscales[:, None, :]
        distance = -2.0 * (q @ self._factors.points.transpose(0, 2, 1))
        distance += self._factors.squares
        distance += (q * q).sum(axis=2, keepdims=True)
        np.maximum(distance, 0.0, out=distance)
        distance *= -0.5
        np.exp(distance, out=distance)
        distance *= self.signal_variance[:, None, None]
        return x, q, distance

    def _factor(self) -> _Factors:
        points = self.inputs / self.lengthscales[:, None, :]
        squares = (points * points).sum(axis=2)[:, None, :]
        if self.weights.size:
            return _Factors(points, squares, self.weights, self.whitener)
        from scipy.linalg import solve_triangular  # here: others need not wait for it

        eye = np.eye(len(self.inputs))
        alphas, whiteners = [], []
        for index, scaled in enumerate(points):
            difference = scaled[:, None, :] - scaled
            gram = self.signal_variance[index] * np.exp(-0.5 * np.einsum("ijd,ijd->ij", difference, difference))
            try:
                factor = np.linalg.cholesky(gram + (self.noise_variance[index] + JITTER.noise) * eye)
            except np.linalg.LinAlgError:
                raise FitError(
                    f"GP: kernel matrix of {self.outputs[index]} is not positive definite; refit with more noise"
                ) from None
            whiteners.append(solve_triangular(factor, eye, lower=True))
            alphas.append(whiteners[-1].T @ (whiteners[-1] @ self.residuals[:, index]))
        return _Factors(points, squares, alpha=np.array(alphas), whitener=np.array(whiteners))


class Following:
    """A process on its way through a flight: knows the inputs that are not the next command."""

    def __init__(self, gp: GaussianProcess, dt: float) -> None:
        self._gp, self._dt = gp, dt
        self._names = gp.settings.inputs
        self._sent: Array | None = None
        self._memory: LagMemory | None = None

    def model_at(self, state: State | None, /) -> MismatchModel:
        """See `plant.mismatch.Follower`."""
        if not self._names:
            return self._gp
        if state is None:
            raise UsageError(
                f"this GP has inputs besides the commanded wrench ({', '.join(self._names)}): give the state to "
                "Compensator.step(wrench_des, state)"
            )
        sent, memory = (np.zeros(len(AXES)), None) if self._sent is None else (self._sent, self._memory)
        extra, self._memory = mismatch_inputs.extra_inputs(self._names, sent[None], state, self._dt, memory)
        return self._gp.given(extra[0])

    def record(self, wrench_cmd: Array, /) -> None:
        """See `plant.mismatch.Follower`."""
        if self._sent is None:
            self._memory = None
        self._sent = wrench_cmd


class _Given:
    """A process whose inputs beyond the command are fixed."""

    def __init__(self, gp: GaussianProcess, extra: Array) -> None:
        self.gp, self.extra, self.outputs = gp, extra, gp.outputs
        self.sigma_training, self.sigma_prior, self.mismatch_max = gp.sigma_training, gp.sigma_prior, gp.mismatch_max

    def _full(self, wrench_cmd: Array) -> Array:
        return np.hstack((wrench_cmd, np.broadcast_to(self.extra, (len(wrench_cmd), len(self.extra)))))

    def mean(self, wrench_cmd: Array, /) -> Array:
        return self.gp.mean(self._full(wrench_cmd))

    def std(self, wrench_cmd: Array, /) -> Array:
        return self.gp.std(self._full(wrench_cmd))

    def jacobian(self, wrench_cmd: Array, /) -> Array:
        return self.mean_and_jacobian(wrench_cmd)[1]

    def mean_and_jacobian(self, wrench_cmd: Array, /) -> tuple[Array, Array]:
        mean, jacobian = self.gp.mean_and_jacobian(self._full(wrench_cmd))
        return mean, jacobian[:, :, : len(AXES)]


def _blockwise(function: Callable[[Array], Array], xi: Array) -> Array:
    return np.concatenate([function(part) for part in _blocks(xi)])


def _blocks(xi: Array, size: int = 512) -> list[Array]:
    """Queries (M, D) `size` at once: kernel values of three outputs at 200 points stay in the processor's cache."""
    return [xi[start : start + size] for start in range(0, max(len(xi), 1), size)]
