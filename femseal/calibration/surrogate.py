"""Interpolate the leakage between simulations by Gaussian processes.

A simulation solves the case with one hardness and one shortest wave. This pair of values is a point of the unit square.
A Gaussian process models the cube root of the leakage at each load. When a channel closes, the cube root of its leakage
is proportional to its gap. The interpolation error of the cube root is therefore about as large near sealing as far
from it. The process is the sum of

- a linear trend,
- a smooth process, with a squared exponential covariance, and
- a rough process, whose covariance along the last axis, the shortest wave, is exponential, exp(−r). It describes jumps
  of the leakage. Such jumps occur because a single wave can open or close a channel when the low-pass filter removes
  it.

The correlation lengths and the relative amplitudes of these processes are the same for all loads. They maximise the
posterior density with weak priors. Each load has its own scale (Rasmussen and Williams, Gaussian Processes for Machine
Learning, 2006, sections 2.2, 2.7 and 5.4; Conti and O'Hagan, J Stat Plan Inference 140, 2010, section 2). Simulations
without leakage are left out of this fit.

A second Gaussian process predicts whether the seal leaks. It is fitted by least squares to the class of each
simulation: 1 if the seal leaks, −1 if it is sealed (Rasmussen and Williams, section 6.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr, ndtri_exp

from ..base import Array, Flags, Indices

#: Variance of the coefficients of the linear trend, relative to the variance of the values.
_TREND_VARIANCE = 25.0
#: Variance that is added because of rounding, relative to the variance of the values.
_ROUNDING_VARIANCE = 1e-8
#: Priors of ln(amplitude) and ln(correlation length): their medians (process, parameter). The first process is the
#: smooth one, the second one the rough one.
_PRIOR_MEDIANS = np.log([[0.5, 1.0], [0.05, 0.3]])
#: Standard deviations of these priors (process, parameter).
_PRIOR_DEVIATIONS = np.array([[1.5, 0.7], [1.5, 1.0]])
#: Decimals to which ln(amplitude) and ln(correlation length) are rounded, so that the results do not depend on the last
#: digits of the fit.
_PARAMETER_DECIMALS = 3
#: Smallest number of simulations with a leakage from which the leakage at a load can be predicted.
FEWEST = 6
#: Limit of the predicted probabilities: the probability that the seal leaks is never closer than this to 0 or 1.
LEAST = 1e-3
#: Standard deviation of ln(leakage) if nothing is known.
_UNKNOWN_DEVIATION = 30.0
#: Standard deviation of the predicted class (1: leaks, −1: sealed) that remains even after very many simulations.
_CLASS_DEVIATION = 0.2


@dataclass(frozen=True)
class _Solution:
    """Solution of K w = y for each of the k columns y of the values (n, k), with the covariance K = LLᵀ (n, n).

    log_root_determinant : ln|L|. whitening : L⁻¹ (n, n). weights : w = K⁻¹y (n, k). squares : yᵀK⁻¹y (k,).
    """

    log_root_determinant: float
    whitening: Array
    weights: Array
    squares: Array


def _solve(covariance: Array, values: Array) -> _Solution:
    """Solve K w = y for each column y of standardised values (n, k), with the Cholesky factor L of the covariance K."""
    rounding = _ROUNDING_VARIANCE * (1 + _TREND_VARIANCE)
    root = np.linalg.cholesky(covariance + rounding * np.eye(len(covariance)))
    whitening = solve_triangular(root, np.eye(len(root)), lower=True)
    # values y with the covariance K become values L⁻¹y with the covariance 1, whose squares add up to yᵀK⁻¹y
    white_values = whitening @ values
    return _Solution(
        log_root_determinant=float(np.log(np.diag(root)).sum()),
        whitening=whitening,
        weights=whitening.T @ white_values,
        squares=np.maximum((white_values**2).sum(0), _ROUNDING_VARIANCE),
    )


def _covariance(parameters: Array, a: Array, b: Array) -> Array:
    """Compute the covariance (m, n) between points a (m, dimensions) and b (n, dimensions).

    parameters : ln(amplitude) and ln(correlation lengths) of the smooth process, and then those of the rough process.
    """
    # (process, 1, 1, parameter)
    amplitudes_and_lengths = np.exp(parameters).reshape(2, 1, 1, -1)
    amplitudes = amplitudes_and_lengths[..., 0]
    lengths = amplitudes_and_lengths[..., 1:]
    distances = np.abs(a[:, None] - b) / lengths  # (process, m, n, dimension)
    exponents = 0.5 * distances**2
    # the rough process has an exponential covariance along the last dimension
    exponents[1, ..., -1] = distances[1, ..., -1]
    processes = amplitudes**2 * np.exp(-exponents.sum(-1))
    covariance = _TREND_VARIANCE * (1 + (a - 0.5) @ (b - 0.5).T) + processes.sum(0)
    # products with arrays in another order have other last digits
    return np.ascontiguousarray(covariance)


def _standardise(values: Array) -> tuple[Array, Array]:
    """Return the standard deviations (k,) of the columns of values (n, k), and the standardised values (n, k)."""
    deviations = np.where(np.ptp(values, axis=0) > 0, values.std(0), 1.0)
    return deviations, (values - values.mean(0)) / deviations


class Process:
    """Gaussian processes with common correlation lengths, each with its own mean and scale.

    Parameters
    ----------
    parameters : array (2 × (1 + dimensions),)
        ln(amplitude) and ln(correlation lengths) of the smooth process, and then those of the rough process.
    points : array (n, dimensions)
        Points in the unit cube.
    values : array (n, k)
        Values of the k processes at the points.
    """

    def __init__(self, parameters: Array, points: Array, values: Array) -> None:
        self._parameters = parameters
        self._points = points
        # the covariance describes standardised values, so that predictions must be scaled back
        self._mean = values.mean(0)
        deviations, standardised = _standardise(values)
        solution = _solve(_covariance(parameters, points, points), standardised)
        self._whitening = solution.whitening
        self._weights = deviations * solution.weights
        # standard deviation of the Student distribution, which replaces the normal one because its scale is unknown
        degrees_of_freedom = max(len(points) - points.shape[1] - 3, 1)
        self._scale = deviations * np.sqrt(solution.squares / degrees_of_freedom)

    def predict(self, points: Array) -> tuple[Array, Array]:
        """Predict the mean and the standard deviation of the k processes at points (m, dimensions).

        Both are arrays (m, k), from the usual formulas of a Gaussian process (Rasmussen and Williams, equations 2.25
        and 2.26).
        """
        covariance = _covariance(self._parameters, points, self._points)  # (m, n)
        mean = self._mean + covariance @ self._weights
        # variance of the prior at the points, minus what the data explain (m,)
        explained = ((self._whitening @ covariance.T) ** 2).sum(0)
        # ln(amplitude) is the first parameter of each process, before its `dimensions` correlation lengths
        dimensions = points.shape[1]
        log_amplitudes = self._parameters[[0, dimensions + 1]]
        trend_variance = _TREND_VARIANCE * (1 + ((points - 0.5) ** 2).sum(-1))
        prior_variance = trend_variance + np.exp(2 * log_amplitudes).sum()
        variance = np.maximum(prior_variance - explained, _ROUNDING_VARIANCE)
        return mean, self._scale * np.sqrt(variance)[:, None]

    def leave_one_out_errors(self) -> Array:
        """Compute the standardised errors (n, k) of leave-one-out prediction.

        Each value is predicted from all others, and its error is divided by the standard deviation of the prediction.
        With the weights w = K⁻¹y, the error of value i is w_i / (K⁻¹)_ii, and the standard deviation is (K⁻¹)_ii^(-1/2)
        (Rasmussen and Williams, equation 5.12). The standardised error is therefore w_i / (K⁻¹)_ii^(1/2).
        """
        precision = (self._whitening**2).sum(
            0
        )  # (K⁻¹)_ii, because K⁻¹ is the product of L⁻¹ transposed and L⁻¹
        return np.asarray(self._weights / self._scale / np.sqrt(precision)[:, None])


@dataclass(frozen=True)
class _Data:
    """Values (n, k) at points (n, dimensions) of the unit cube."""

    points: Array
    values: Array


def _fit_processes(data_sets: list[_Data]) -> list[Process]:
    """Fit Gaussian processes to several sets of data.

    All sets share the same amplitudes and correlation lengths, which maximise the posterior density. The mean, the
    trend and the scale of each column y of values are unknown, and the density is integrated over them. Up to a
    constant, this gives

        −ln(density) = Σ ((parameter − median) / deviation)² / 2 + Σ (ν/2 ln(yᵀK⁻¹y) + ln|L|)

    where the first sum is over the parameters, with their priors, and the second one over all columns of all sets. The
    number of degrees of freedom is ν = n − dimensions − 1 for n points.
    """
    if not data_sets:
        return []
    dimensions = data_sets[0].points.shape[1]
    # The parameters are, for each of the two processes, one amplitude and then a correlation length along every
    # dimension. The prior is the same for all correlation lengths of a process.
    repetitions = [1, dimensions]
    medians = np.repeat(_PRIOR_MEDIANS, repetitions, axis=1).ravel()
    deviations = np.repeat(_PRIOR_DEVIATIONS, repetitions, axis=1).ravel()
    standardised_sets = []
    for data in data_sets:
        _, standardised_values = _standardise(data.values)
        standardised_sets.append(_Data(data.points, standardised_values))

    def negative_log_posterior(parameters: Array) -> float:
        """Compute −ln(density) of the parameters, up to a constant, by the formula above."""
        total = 0.5 * (((parameters - medians) / deviations) ** 2).sum()
        for data in standardised_sets:
            covariance = _covariance(parameters, data.points, data.points)
            solution = _solve(covariance, data.values)
            degrees_of_freedom = max(len(data.points) - dimensions - 1, 1)
            squares = solution.squares  # (column,)
            n_columns = len(squares)
            total += (
                0.5 * degrees_of_freedom * np.log(squares).sum()
                + n_columns * solution.log_root_determinant
            )
        return float(total)

    best = minimize(
        negative_log_posterior,
        medians,
        jac="3-point",
        method="L-BFGS-B",
        bounds=list(zip(medians - 4 * deviations, medians + 4 * deviations, strict=True)),
        options={"ftol": 1e-14, "gtol": 1e-7},
    )
    parameters = best.x.round(_PARAMETER_DECIMALS)
    return [Process(parameters, data.points, data.values) for data in data_sets]


@dataclass(frozen=True)
class _LoadGroup:
    """Loads at which the same simulations leak.

    loads : indices of the loads. simulations : indices of the simulations that leak at these loads.
    """

    loads: list[int]
    simulations: Indices


def _group_loads(is_open: Flags) -> list[_LoadGroup]:
    """Group the loads at which the same simulations leak. Loads with fewer than `FEWEST` such simulations are left out.

    is_open : array of bool (simulations, loads), whether each simulation leaks at each load.
    """
    # arrays cannot be keys of a dictionary, but the bytes of a column of `is_open` can
    loads_by_pattern: dict[bytes, list[int]] = {}
    for load in np.flatnonzero(is_open.sum(0) >= FEWEST):
        pattern = is_open[:, load].tobytes()
        loads_by_pattern.setdefault(pattern, []).append(int(load))
    groups = []
    for loads in loads_by_pattern.values():
        leaking_simulations = np.flatnonzero(is_open[:, loads[0]])
        groups.append(_LoadGroup(loads, leaking_simulations))
    return groups


class Prediction(NamedTuple):
    """Prediction of the surrogate at several points.

    Parameters
    ----------
    mean, deviation : array (points, loads)
        Median and standard deviation of ln(leakage), provided that the seal leaks.
    is_open : array (points, loads)
        Probability that the seal leaks.
    """

    mean: Array
    deviation: Array
    is_open: Array


class _ProcessAtLoads(NamedTuple):
    """Gaussian processes of a quantity at several loads, with the indices of these loads."""

    loads: list[int]
    process: Process


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Prediction of the leakage at several loads, interpolated between simulations.

    Parameters
    ----------
    leakage : tuple of _ProcessAtLoads
        Processes of the cube root of the leakage, one entry for each group of loads at which the same simulations leak.
        Loads at which too few simulations leak belong to no group.
    open : _ProcessAtLoads, optional
        Processes of the class of a simulation (1: leaks, −1: sealed), at the loads at which some simulations leak and
        others are sealed. None if there is no such load.
    common_class : array (loads,)
        Class of the first simulation at each load. At the loads that are not in `open`, all simulations have this
        class.
    correlation : array (loads, loads)
        Correlation of the prediction errors at two loads.
    """

    leakage: tuple[_ProcessAtLoads, ...]
    open: _ProcessAtLoads | None
    common_class: Array
    correlation: Array

    @classmethod
    def fit(cls, points: Array, leakage: Array) -> Surrogate:
        """Fit a surrogate to the leakages of simulations.

        Parameters
        ----------
        points : array (simulations, dimensions)
            Hardness and shortest wave of each simulation, as a point of the unit square.
        leakage : array (simulations, loads)
            Leakages, 0 where the seal is sealed.
        """
        is_open = leakage > 0
        groups = _group_loads(is_open)
        data_sets = []
        for group in groups:
            leakage_of_group = leakage[group.simulations][:, group.loads]
            data_sets.append(_Data(points[group.simulations], np.cbrt(leakage_of_group)))
        processes = _fit_processes(data_sets)
        leakage_processes = []
        errors = np.zeros(leakage.shape)  # 0 where no leakage is predicted
        for group, process in zip(groups, processes, strict=True):
            leakage_processes.append(_ProcessAtLoads(group.loads, process))
            errors[group.simulations[:, None], group.loads] = process.leave_one_out_errors()
        leakage_class = np.where(is_open, 1.0, -1.0)
        # loads at which some simulations leak and others do not
        mixed_loads = np.flatnonzero(np.ptp(leakage_class, axis=0)).tolist()
        class_process = None
        if mixed_loads:
            (process,) = _fit_processes([_Data(points, leakage_class[:, mixed_loads])])
            class_process = _ProcessAtLoads(mixed_loads, process)
        return cls(
            leakage=tuple(leakage_processes),
            open=class_process,
            common_class=leakage_class[0],
            correlation=_correlation(errors),
        )

    def predict(self, points: Array) -> Prediction:
        """Predict the leakage at points (points, dimensions) of the unit cube.

        The seal leaks if its class is above 0. The predicted class is normally distributed, so that the probability of
        a leakage is Φ(mean / deviation) with the normal distribution function Φ.
        """
        shape = len(points), len(self.common_class)
        mean = np.zeros(shape)
        deviation = np.full(shape, _UNKNOWN_DEVIATION)
        for loads, process in self.leakage:
            mean[:, loads], deviation[:, loads] = _logarithm(*process.predict(points))
        class_mean = np.tile(self.common_class, (len(points), 1))
        class_deviation = np.zeros(shape)
        if self.open is not None:
            loads, process = self.open
            class_mean[:, loads], class_deviation[:, loads] = process.predict(points)
        probability = ndtr(class_mean / np.hypot(class_deviation, _CLASS_DEVIATION))
        return Prediction(mean, deviation, np.clip(probability, LEAST, 1 - LEAST))


def _correlation(errors: Array) -> Array:
    """Estimate the correlation between the prediction errors at each pair of loads.

    With few simulations the estimate is uncertain, and the correlations are therefore reduced by 5 %. Without this
    reduction, the covariance matrix could be singular, and some combination of the loads would seem to be known
    exactly.

    Parameters
    ----------
    errors : array (simulations, loads)
        Errors of the leave-one-out predictions. Their expectation is 0, so that no mean is subtracted.

    Returns
    -------
    array (loads, loads)
    """
    norms = np.sqrt((errors**2).sum(0)) + 1e-30  # not 0 at loads where no leakage is predicted
    correlation = 0.95 * np.clip(errors.T @ errors / np.outer(norms, norms), -1, 1)
    np.fill_diagonal(correlation, 1.0)
    return np.asarray(correlation)


def _logarithm(mean: Array, deviation: Array) -> tuple[Array, Array]:
    """Compute the distribution of ln(leakage) from the mean and the deviation of the cube root of the leakage.

    The cube root x is normally distributed. The distribution is truncated at 0, because x is positive if the seal
    leaks. The quantile of x at the probability Φ(s) is then deviation (r − Φ⁻¹(Φ(r) Φ(−s))), with the normal
    distribution function Φ and r = mean/deviation. The
    quantile of ln(leakage) at the same probability is 3 ln(x), because the leakage is x³.

    Returns
    -------
    median, deviation : array
        Median of ln(leakage), and half the distance between the quantiles for s = −1 and s = 1, which is the standard
        deviation if ln(leakage) is normally distributed.
    """
    # for smaller ratios, the difference in `quantile` would lose its digits
    ratio = np.maximum(mean / deviation, -1e3)

    def quantile(normal_score: float) -> Array:
        """Return the quantile of ln(leakage) at the probability Φ(normal_score), computed with logarithms of Φ."""
        cube_root = ratio - ndtri_exp(log_ndtr(ratio) + log_ndtr(-normal_score))
        return 3 * np.log(deviation * cube_root)

    return quantile(0.0), (quantile(1.0) - quantile(-1.0)) / 2
