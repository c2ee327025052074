"""Predict the leakage of scenes that were not solved from those that were, by Gaussian processes.

A scene is the case with one pair of values of hardness and shortest wave, here a point of the unit square. For each
load there is a Gaussian process of the cube root of the leakage. The cube root behaves like the gap of a channel that
closes, so that its error is about the same near sealing and far from it. The process is the sum of

- a linear trend,
- a smooth process, with a squared exponential covariance, and
- a process that jumps along the last axis, where its covariance is exp(−r): each wave that the low-pass removes may
  open or close a single channel.

The lengths and relative sizes of these processes are the most likely ones for all loads together, given weak priors;
each load has its own scale (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 2.2, 2.7
and 5.4; Conti and O'Hagan, J Stat Plan Inference 140, 2010, section 2). Sealed scenes are left out. Whether a scene is
open or sealed is a process of its own, fitted to 1 and −1 by least squares (section 6.5 of the book).
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
#: Priors of the size and of the lengths of the smooth process and of the one that jumps: ln of their medians.
_PRIOR_MEDIANS = np.log([[0.5, 1.0], [0.05, 0.3]])
#: Standard deviations of these priors in ln.
_PRIOR_DEVIATIONS = np.array([[1.5, 0.7], [1.5, 1.0]])
#: Decimals of the logarithms of sizes and lengths. Rounding makes the results independent of the last digits of the
#: fit.
_PARAMETER_DECIMALS = 3
#: Fewest open scenes from which the leakage at a load can be predicted.
FEWEST = 6
#: Smallest probability of being open, or of being sealed.
LEAST = 1e-3
#: Standard deviation of ln(leakage) if nothing is known.
_UNKNOWN_DEVIATION = 30.0
#: Standard deviation of the class of a scene (1 or −1) that remains however many scenes are solved.
_CLASS_DEVIATION = 0.2


@dataclass(frozen=True)
class _Solution:
    """Solution of K w = y for several columns y, with the covariance K = LLᵀ.

    log_root_determinant : ln|L|. whitening : L⁻¹ (n, n). weights : K⁻¹y (n, k). squares : yᵀK⁻¹y (k,).
    """

    log_root_determinant: float
    whitening: Array
    weights: Array
    squares: Array


def _solve(covariance: Array, values: Array) -> _Solution:
    """Solve K w = y for standardised values y (n, k)."""
    rounding = _ROUNDING_VARIANCE * (1 + _TREND_VARIANCE)
    root = np.linalg.cholesky(covariance + rounding * np.eye(len(covariance)))
    whitening = solve_triangular(root, np.eye(len(root)), lower=True)
    white_values = whitening @ values
    return _Solution(
        log_root_determinant=float(np.log(np.diag(root)).sum()),
        whitening=whitening,
        weights=whitening.T @ white_values,
        squares=np.maximum((white_values**2).sum(0), _ROUNDING_VARIANCE),
    )


def _covariance(parameters: Array, a: Array, b: Array) -> Array:
    """Compute the covariance (m, n) between points a (m, dimensions) and b (n, dimensions).

    parameters : ln of the size and the lengths of the smooth process, and then those of the process that jumps.
    """
    # (process, 1, 1, parameter)
    sizes_and_lengths = np.exp(parameters).reshape(2, 1, 1, -1)
    sizes = sizes_and_lengths[..., 0]
    lengths = sizes_and_lengths[..., 1:]
    distances = np.abs(a[:, None] - b) / lengths  # (process, m, n, dimension)
    exponents = 0.5 * distances**2
    exponents[1, ..., -1] = distances[1, ..., -1]
    processes = sizes**2 * np.exp(-exponents.sum(-1))
    covariance = _TREND_VARIANCE * (1 + (a - 0.5) @ (b - 0.5).T) + processes.sum(0)
    # products with arrays in another order have other last digits
    return np.ascontiguousarray(covariance)


def _standardise(values: Array) -> tuple[Array, Array]:
    """Compute the standard deviations of values (n, k), and the values in units of them around their means."""
    deviations = np.where(np.ptp(values, axis=0) > 0, values.std(0), 1.0)
    return deviations, (values - values.mean(0)) / deviations


class Process:
    """Gaussian processes with common lengths, each with its own mean and scale.

    Parameters
    ----------
    parameters : array (2 × (1 + dimensions),)
        ln of the size and the lengths of the smooth process, and then those of the process that jumps.
    points : array (n, dimensions)
        Points in the unit cube.
    values : array (n, k)
        Values of the k processes at the points.
    """

    def __init__(self, parameters: Array, points: Array, values: Array) -> None:
        self._parameters = parameters
        self._points = points
        # the processes are those of standardised values; predictions are scaled back
        self._mean = values.mean(0)
        deviations, standardised = _standardise(values)
        solution = _solve(_covariance(parameters, points, points), standardised)
        self._whitening = solution.whitening
        self._weights = deviations * solution.weights
        # variance of the Student distribution that results from a normal one if its scale is unknown
        degrees_of_freedom = max(len(points) - points.shape[1] - 3, 1)
        self._scale = deviations * np.sqrt(solution.squares / degrees_of_freedom)

    def at(self, points: Array) -> tuple[Array, Array]:
        """Predict mean and standard deviation (m, k) at points (m, dimensions).

        These are the usual formulas of a Gaussian process (Rasmussen and Williams, equations 2.25 and 2.26).
        """
        covariance = _covariance(self._parameters, points, self._points)  # (m, n)
        mean = self._mean + covariance @ self._weights
        # variance of the prior at the points, minus what the data explain (m,)
        explained = ((self._whitening @ covariance.T) ** 2).sum(0)
        log_sizes = self._parameters[[0, points.shape[1] + 1]]
        trend_variance = _TREND_VARIANCE * (1 + ((points - 0.5) ** 2).sum(-1))
        prior_variance = trend_variance + np.exp(2 * log_sizes).sum()
        variance = np.maximum(prior_variance - explained, _ROUNDING_VARIANCE)
        return mean, self._scale * np.sqrt(variance)[:, None]

    def left_out(self) -> Array:
        """Compute the error (n, k) of predicting each point from all others, in units of its standard deviation."""
        precision = (self._whitening**2).sum(0)  # diagonal of the inverse of the covariance
        return np.asarray(self._weights / self._scale / np.sqrt(precision)[:, None])


@dataclass(frozen=True)
class _Data:
    """Values (n, k) at points (n, dimensions) of the unit cube."""

    points: Array
    values: Array


def _fit_processes(data_sets: list[_Data]) -> list[Process]:
    """Fit a Gaussian process, whose covariance is a sum of two kernels, to each set of data.

    All sets share the amplitudes and correlation lengths of the maximum of the posterior density; the variance of each
    set is integrated out.
    """
    if not data_sets:
        return []
    dimensions = data_sets[0].points.shape[1]
    # one amplitude and `dimensions` correlation lengths for each of the two kernels
    medians = np.concatenate([np.r_[m[0], np.full(dimensions, m[1])] for m in _PRIOR_MEDIANS])
    deviations = np.concatenate([np.r_[d[0], np.full(dimensions, d[1])] for d in _PRIOR_DEVIATIONS])
    standardised = [_Data(data.points, _standardise(data.values)[1]) for data in data_sets]

    def negative_log_posterior(parameters: Array) -> float:
        total = 0.5 * (((parameters - medians) / deviations) ** 2).sum()
        for data in standardised:
            covariance = _covariance(parameters, data.points, data.points)
            solution = _solve(covariance, data.values)
            degrees_of_freedom = max(len(data.points) - dimensions - 1, 1)
            squares = solution.squares
            total += (
                0.5 * degrees_of_freedom * np.log(squares).sum()
                + len(squares) * solution.log_root_determinant
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
    """Loads that are open in the same scenes.

    loads : their indices. scenes : indices of the open scenes (scenes,).
    """

    loads: list[int]
    scenes: Indices


def _group_loads(is_open: Flags) -> list[_LoadGroup]:
    """Group the loads that have enough open scenes by these scenes.

    is_open : array of bool (scenes, loads).
    """
    loads_by_pattern: dict[bytes, list[int]] = {}
    for load in np.flatnonzero(is_open.sum(0) >= FEWEST):
        loads_by_pattern.setdefault(is_open[:, load].tobytes(), []).append(int(load))
    return [
        _LoadGroup(loads, np.flatnonzero(is_open[:, loads[0]]))
        for loads in loads_by_pattern.values()
    ]


class Prediction(NamedTuple):
    """What a surrogate predicts at several points.

    Parameters
    ----------
    mean, deviation : array (points, loads)
        Median of ln(leakage) of an open seal, and its standard deviation.
    is_open : array (points, loads)
        Probability that the seal is open.
    """

    mean: Array
    deviation: Array
    is_open: Array


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Prediction of ln(leakage) and of the probability of leaking, at several loads.

    Parameters
    ----------
    leakage : tuple of pairs (list of int, Process)
        Loads that are open in the same scenes, and the processes of the cube root of their leakage. Loads that are open
        in too few scenes have none.
    open : pair (list of int, Process), optional
        Loads at which only some of the scenes are open, and the processes of their class; None if there is no such
        load.
    common_class : array (loads,)
        Class of the scenes at the other loads: 1 if all are open, −1 if all are sealed.
    correlation : array (loads, loads)
        Correlation of the prediction errors at two loads.
    """

    leakage: tuple[tuple[list[int], Process], ...]
    open: tuple[list[int], Process] | None
    common_class: Array
    correlation: Array

    @classmethod
    def through(cls, points: Array, leakage: Array) -> Surrogate:
        """Fit a surrogate to solved scenes.

        Parameters
        ----------
        points : array (scenes, dimensions)
            Points in the unit cube.
        leakage : array (scenes, loads)
            Leakages >= 0, 0 where sealed.
        """
        is_open = leakage > 0
        groups = _group_loads(is_open)
        data_sets = [
            _Data(points[group.scenes], np.cbrt(leakage[group.scenes][:, group.loads]))
            for group in groups
        ]
        processes = _fit_processes(data_sets)
        errors = np.zeros(leakage.shape)
        for group, process in zip(groups, processes, strict=True):
            errors[group.scenes[:, None], group.loads] = process.left_out()
        scene_class = np.where(is_open, 1.0, -1.0)
        mixed_loads = np.flatnonzero(np.ptp(scene_class, axis=0)).tolist()
        class_process = None
        if mixed_loads:
            (process,) = _fit_processes([_Data(points, scene_class[:, mixed_loads])])
            class_process = mixed_loads, process
        loads = [group.loads for group in groups]
        leakage_processes = tuple(zip(loads, processes, strict=True))
        return cls(leakage_processes, class_process, scene_class[0], _correlation(errors))

    def at(self, points: Array) -> Prediction:
        """Predict the leakage at points (points, dimensions) of the unit cube."""
        shape = len(points), len(self.common_class)
        mean = np.zeros(shape)
        deviation = np.full(shape, _UNKNOWN_DEVIATION)
        for loads, process in self.leakage:
            mean[:, loads], deviation[:, loads] = _logarithm(*process.at(points))
        class_mean = np.tile(self.common_class, (len(points), 1))
        class_deviation = np.zeros(shape)
        if self.open is not None:
            loads, process = self.open
            class_mean[:, loads], class_deviation[:, loads] = process.at(points)
        probability = ndtr(class_mean / np.hypot(class_deviation, _CLASS_DEVIATION))
        return Prediction(mean, deviation, np.clip(probability, LEAST, 1 - LEAST))


def _correlation(errors: Array) -> Array:
    """Estimate the correlation (loads, loads) of prediction errors (scenes, loads) at two loads.

    Few scenes say little about it. It is therefore reduced a little, so that no combination of loads appears to be
    known exactly.
    """
    norms = np.sqrt((errors**2).sum(0)) + 1e-30
    correlation = 0.95 * np.clip(errors.T @ errors / np.outer(norms, norms), -1, 1)
    np.fill_diagonal(correlation, 1.0)
    return np.asarray(correlation)


def _logarithm(mean: Array, deviation: Array) -> tuple[Array, Array]:
    """Convert a normal cube root of the leakage, given that it is positive, to ln(leakage).

    Returns
    -------
    median, deviation : array
        Median of ln(leakage), and half the distance between the quantiles that are 1 standard deviation away from the
        median of a normal distribution.
    """
    ratio = np.maximum(mean / deviation, -1e3)

    def quantile(normal_score: float) -> Array:
        truncated = ratio - ndtri_exp(log_ndtr(ratio) + log_ndtr(-normal_score))
        return 3 * np.log(deviation * truncated)

    return quantile(0.0), (quantile(1.0) - quantile(-1.0)) / 2
