"""Fit mismatch models to samples of commands and mismatches: Gaussian processes, and straight lines.

Hyperparameters maximise the marginal likelihood (ML-II) by L-BFGS from a sensible start and from random ones. They
are bounded, in units of the standardised data, so that no start ends in a degenerate corner: lengthscales short
enough that the GP notices when it leaves its data, and a noise that keeps the kernel matrix well conditioned.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any

import numpy as np

from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.flight.flight import AXES, Array, Indices, Mask
from wrenchgap.learn.parallel import few_threads
from wrenchgap.learn.process import likelihood
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess, MeanKind, Provenance
from wrenchgap.learn.process.held_out_time import CALIBRATION, HeldOut, left_out, sigma_scale
from wrenchgap.learn.process.subsample import Kernel, subsample, thin
from wrenchgap.learn.process.subsample import posterior as sparse_posterior
from wrenchgap.plant.mismatch import LinearMismatch, output_indices

Found = dict[FitSettings, tuple[Indices, list[Kernel]]]
"""By the settings of an exact process: points, and the kernels of outputs so far. Sparse inference begins there."""

BOUNDS = {"lengthscale": (0.3, 20.0), "signal": (1e-3, 1e2), "noise": (1e-5, 2.0)}
"""Of the hyperparameters; inputs have unit standard deviation, outputs unit rms."""

SEARCHES = {"closed-form": likelihood.maximise, "gpy": likelihood.maximise_by_gpy}
"""What maximises a likelihood, by `FitSettings.search`."""


@dataclass(frozen=True)
class SearchSettings:
    """What a search for hyperparameters starts from, and what it takes for equal."""

    blind: float = 1e6
    """Lengthscale of an input that the process does not look at."""
    quiet: float = 1e-3
    """Noise variance below which an exact process on few samples has found none, which sparse inference on all samples
    cannot leave: at a bound the search's transformed gradient vanishes."""
    loud: float = 0.05
    """Noise variance from which sparse inference is then started as well."""
    tie: float = 7.0
    """Log likelihoods closer than this say the same (likelihood-ratio test: half the 95th percentile of chi^2 with 7
    degrees of freedom, six lengthscales and a variance). Then the larger noise is believed: in six dimensions white
    noise is explained as well by a function with lengthscales shorter than the distance between samples, which predicts
    nothing."""


SEARCH = SearchSettings()


def fit(
    inputs: Array,
    outputs: Array,
    names: tuple[str, ...],
    settings: FitSettings | None = None,
    *,
    provenance: Provenance | None = None,
    progress: Progress = silent,
) -> GaussianProcess:
    """GP of `outputs` (M, L) [N or Nm] named `names` over commands `inputs` (M, D), consecutive samples.

    D is six, and the columns of `settings.inputs` behind. All M samples set the scales, the mean function,
    `sigma_training` and the calibration; `settings.points` of them are kept as training or inducing inputs. Raises
    FitError where the data cannot carry a fit.
    """
    how = settings or FitSettings()
    gp, held = fit_held_out(inputs, outputs, names, how, provenance=provenance, progress=progress)
    return gp if held is None else believed(gp, held, gp.gain, inputs)


def fit_held_out(
    inputs: Array,
    outputs: Array,
    names: tuple[str, ...],
    settings: FitSettings,
    *,
    provenance: Provenance | None = None,
    progress: Progress = silent,
) -> tuple[GaussianProcess, HeldOut | None]:
    """As `fit`, not calibrated, and the samples that were left out in turn; None where they are too few."""
    posterior, gp = _fit(inputs, outputs, names, settings, provenance, progress)
    index, seen = _seen(inputs, gp.settings)
    gp = replace(gp, sigma_training=np.percentile(gp.std(seen), 99, axis=0))
    held = None
    if gp.settings.calibrate and len(index) >= CALIBRATION.fewest:
        progress(1.0, "calibrating sigma")
        mean, std = left_out(len(inputs), index, partial(posterior.predict, gp, inputs))
        held = HeldOut(outputs[index], mean, std, CALIBRATION.block(len(inputs))[index])
    progress(1.0, "done")
    return gp, held


def believed(gp: GaussianProcess, held: HeldOut, gain: Array, inputs: Array) -> GaussianProcess:
    """The process with this gain (L,), and sigma calibrated to what it then leaves of the samples held out."""
    scale = sigma_scale(held.actual - gain * held.predicted, held.std)
    gp = replace(gp, gain=gain, sigma_scale=scale if gp.settings.calibrate else gp.sigma_scale)
    return replace(gp, sigma_training=np.percentile(gp.std(_seen(inputs, gp.settings)[1]), 99, axis=0))


def left_out_errors(
    inputs: Array, outputs: Array, names: tuple[str, ...], settings: FitSettings, found: Found | None = None
) -> Array | None:
    """Errors (K, L) of samples, each predicted from the blocks of time that it is not in; None where they are few.

    Hyperparameters are those of all samples; otherwise as `fit`. What is `found` for the same samples is used, and what
    is new put in.
    """
    posterior, gp = _fit(inputs, outputs, names, settings, None, silent, found)
    index, _ = _seen(inputs, settings)
    if len(index) < CALIBRATION.fewest:
        return None
    (mean,) = left_out(len(inputs), index, partial(posterior.mean, gp, inputs))
    return np.asarray(outputs[index] - mean)


def _seen(inputs: Array, settings: FitSettings) -> tuple[Indices, Array]:
    """Samples, by index and themselves, that a sparse process and the calibration look at."""
    index = thin(len(inputs), settings.pre_thin, settings.seed)
    return index, inputs[index]


def _fit(
    inputs: Array,
    outputs: Array,
    names: tuple[str, ...],
    settings: FitSettings,
    provenance: Provenance | None,
    progress: Progress,
    found: Found | None = None,
) -> tuple[_Posterior, GaussianProcess]:
    """The process, not calibrated and without `sigma_training`, and what it was made of."""
    _check(inputs, outputs, names, settings)
    input_mean, input_scale = inputs.mean(axis=0), _spread(inputs)
    x = (inputs - input_mean) / input_scale
    looks = _looks(x, settings)
    coefficients, output_scale = _mean_function(x, outputs, settings.mean, looks)
    residuals = outputs / output_scale - _affine(x, coefficients)

    progress(0.0, f"choosing {min(settings.points, len(inputs))} of {len(inputs)} samples")
    how = {name: getattr(settings, name) for name in ("method", "seed", "pre_thin", "scale")}
    key, found = replace(settings, inference="exact"), {} if found is None else found
    if key not in found:
        found[key] = subsample(inputs, settings.points, **how), []
    seen, _ = _seen(inputs, settings)
    kept, exact = found[key]
    posterior = _Posterior(x, residuals, kept, seen, settings, exact)
    for index, name in enumerate(names):
        progress((1 + index) / (1 + len(names)), f"fitting {name}")
        posterior.fit(index)
    gp = GaussianProcess(
        outputs=tuple(names),
        input_mean=input_mean,
        input_scale=input_scale,
        output_scale=output_scale,
        mean_coefficients=coefficients,
        **{f.name: np.array([getattr(k, f.name) for k in posterior.kernels]) for f in fields(Kernel)},
        sigma_training=np.zeros(len(names)),
        mismatch_max=np.abs(outputs).max(axis=0),
        settings=settings,
        provenance=provenance or Provenance(),
        **posterior.content(np.ones(len(inputs), dtype=bool)),
    )
    return posterior, gp


@dataclass
class _Posterior:
    """Kernels of all outputs, and what they say given all samples or some of them.

    x (M, D) and residuals (M, L) standardised; `kept` and `seen` are indices: points, and the samples that a sparse
    process and the calibration look at. `exact` are the kernels of an exact process as far as they are known.
    """

    x: Array
    residuals: Array
    kept: Indices
    seen: Indices
    settings: FitSettings
    exact: list[Kernel] = field(default_factory=list)
    kernels: list[Kernel] = field(default_factory=list)

    def fit(self, index: int) -> None:
        """The kernel of one output after the other."""
        looks = _looks(self.x, self.settings)
        x, z = self.x[:, looks], self.residuals[:, index]
        if index == len(self.exact):
            self.exact.append(_maximum_likelihood(x[self.kept], z[self.kept], self.settings, index))
        kernel = self.exact[index]
        if self.settings.inference == "sparse":
            starts = [kernel]
            if kernel.noise_variance < SEARCH.quiet:
                starts.append(replace(kernel, noise_variance=SEARCH.loud))
            maximise = SEARCHES[self.settings.search]
            with _quietly():
                tried = [maximise(x[self.seen], z[self.seen], k, BOUNDS, x[self.kept]) for k in starts]
            bound, found = max(tried, key=lambda one: one[0])
            kernel = found if np.isfinite(bound) else kernel
        lengthscales = np.full(len(looks), SEARCH.blind)
        lengthscales[looks] = kernel.lengthscales
        self.kernels.append(replace(kernel, lengthscales=lengthscales))

    def content(self, usable: Mask) -> dict[str, Any]:
        """Fields of the process, given the samples that are `usable` (M,)."""
        points = self.kept if self.settings.inference == "sparse" else self.kept[usable[self.kept]]
        found: dict[str, Any] = {"inputs": self.x[points], "residuals": self.residuals[points]}
        if self.settings.inference == "sparse":
            rows = self.seen[usable[self.seen]]
            x, z, inducing = self.x[rows], self.residuals[rows], self.x[points]
            parts = [sparse_posterior(kernel, x, z[:, i], inducing) for i, kernel in enumerate(self.kernels)]
            found["weights"], found["whitener"] = (np.array(part) for part in zip(*parts, strict=True))
        return found

    def predict(self, gp: GaussianProcess, inputs: Array, usable: Mask, asked: Indices) -> tuple[Array, Array]:
        """Mean and standard deviation; see `held_out_time.Predict`."""
        return replace(gp, **self.content(usable)).predict(inputs[asked])

    def mean(self, gp: GaussianProcess, inputs: Array, usable: Mask, asked: Indices) -> tuple[Array]:
        """The mean alone."""
        return (replace(gp, **self.content(usable)).mean(inputs[asked]),)


def fit_linear(inputs: Array, outputs: Array, names: tuple[str, ...], *, slope: bool = True) -> LinearMismatch:
    """Straight line g(W) = offset + gain W by least squares; without `slope`, the constant offset."""
    _check(inputs, outputs, names, FitSettings())
    mean, spread = inputs.mean(axis=0), _spread(inputs)
    x = (inputs - mean) / spread
    coefficients, scale = _mean_function(x, outputs, "linear" if slope else "constant")
    gain = coefficients[:, 1:] * scale[:, None] / spread
    residual = outputs - _affine(x, coefficients) * scale
    return LinearMismatch(tuple(names), coefficients[:, 0] * scale - gain @ mean, gain, residual.std(axis=0))


def _check(inputs: Array, outputs: Array, names: tuple[str, ...], settings: FitSettings) -> None:
    output_indices(tuple(names))
    if inputs.ndim != 2 or outputs.shape != (len(inputs), len(names)):
        raise FitError(f"fit: inputs {inputs.shape} and outputs {outputs.shape} do not match {len(names)} outputs")
    if settings.points < 2 or settings.restarts < 0 or settings.pre_thin < 1:
        got = f"{settings.points} points, {settings.restarts} restarts, thinned to {settings.pre_thin} samples"
        raise UsageError(f"fit: got {got}; expected >= 2, >= 0 and >= 1")
    if len(inputs) < 2 * inputs.shape[1]:
        raise FitError(f"fit: {len(inputs)} samples, expected at least {2 * inputs.shape[1]}; use a longer log")
    for what, array in (("inputs", inputs), ("outputs", outputs)):
        if not np.isfinite(array).all():
            bad = int((~np.isfinite(array)).any(axis=1).sum())
            raise FitError(f"fit: {bad} of {len(array)} {what} are not finite; drop them")
    if not (np.ptp(inputs, axis=0) > 0).any():
        raise FitError("fit: the command never changes, so nothing can be learnt from it; excite the vehicle")


def _spread(inputs: Array) -> Array:
    """Standard deviation of each column, one where a column is constant."""
    spread = inputs.std(axis=0)
    return np.where(spread > 1e-12 * (1 + np.abs(inputs).max(axis=0)), spread, 1.0)


def _looks(x: Array, settings: FitSettings) -> Mask:
    """Which inputs (D,) the process looks at."""
    blind = [AXES.index(name) for name in settings.blind]
    return np.asarray(~np.isin(np.arange(x.shape[1]), blind))


def _mean_function(x: Array, outputs: Array, kind: MeanKind, looks: Mask | None = None) -> tuple[Array, Array]:
    """Standardised coefficients (L, 1 + D) of m(x), and the rms (L,) of what m leaves."""
    coefficients = np.zeros((outputs.shape[1], 1 + x.shape[1]))
    if kind == "constant":
        coefficients[:, 0] = outputs.mean(axis=0)
    if kind == "linear":
        columns = np.ones(x.shape[1], dtype=bool) if looks is None else looks
        regressors = np.column_stack([np.ones(len(x)), x[:, columns]])
        coefficients[:, np.concatenate([[True], columns])] = np.linalg.lstsq(regressors, outputs, rcond=None)[0].T
    rms = np.sqrt(np.mean((outputs - _affine(x, coefficients)) ** 2, axis=0))
    scale = np.maximum(rms, 1e-6 * np.abs(outputs).max(axis=0) + 1e-12)
    return coefficients / scale[:, None], scale


def _affine(x: Array, coefficients: Array) -> Array:
    return np.asarray(coefficients[:, 0] + x @ coefficients[:, 1:].T)


def _maximum_likelihood(x: Array, z: Array, settings: FitSettings, index: int) -> Kernel:
    """Best of the searches from two fixed and `restarts` random starts, for standardised data x (N, D), z (N,).

    The fixed starts believe in a smooth function with little noise, and in noise with little function.
    """
    rng = np.random.default_rng([settings.seed, index])
    starts = [Kernel(np.full(x.shape[1], 2.0), 1.0, 0.05), Kernel(np.full(x.shape[1], 5.0), 0.1, 0.9)]
    for _ in range(settings.restarts):
        lengthscales = np.exp(rng.uniform(np.log(0.5), np.log(8.0), x.shape[1]))
        starts.append(Kernel(lengthscales, float(np.exp(rng.uniform(-1, 2))), float(np.exp(rng.uniform(-6, -1)))))
    with _quietly():
        found = [SEARCHES[settings.search](x, z, start, BOUNDS) for start in starts]
    usable = [one for one in found if np.isfinite(one[0])]
    if not usable:
        raise FitError("fit: the likelihood could not be maximised from any start; are there enough different samples?")
    best = max(value for value, _ in usable)
    equal = [kernel for value, kernel in usable if value > best - SEARCH.tie]
    return max(equal, key=lambda kernel: kernel.noise_variance)


@contextmanager
def _quietly() -> Iterator[None]:
    """One BLAS thread, since the matrices are small, and no word of what a search overflows on its way."""
    with np.errstate(all="ignore"), few_threads():
        yield
