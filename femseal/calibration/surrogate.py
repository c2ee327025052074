"""Interpolate the leakage between solved scenes by Gaussian processes.

A scene is the case with one pair of values of hardness and shortest wave, which is a point of the unit square here. The
cube root of the leakage at each load is modelled by a Gaussian process. The cube root is proportional to the gap of a
channel that closes, so that its error is about the same near sealing and far from it. The process is the sum of

- a linear trend,
- a smooth process, with a squared exponential covariance, and
- a rough process, whose covariance along the last axis, the shortest wave, is exponential, exp(−r). It describes jumps
  of the leakage: every wave that the low-pass filter removes may open or close a single channel.

The correlation lengths and the relative amplitudes of these processes are common to all loads. They maximise the
posterior density with weak priors. Each load has its own scale (Rasmussen and Williams, Gaussian Processes for Machine
Learning, 2006, sections 2.2, 2.7 and 5.4; Conti and O'Hagan, J Stat Plan Inference 140, 2010, section 2). Sealed scenes
are left out of this fit. A second Gaussian process predicts whether a scene is open or sealed. It is fitted to the
values 1 and −1 by least squares (section 6.5 of the book).
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
#: Fewest open scenes from which the leakage at a load can be predicted.
FEWEST = 6
#: Smallest probability that a scene is open, and smallest probability that it is sealed.
LEAST = 1e-3
#: Standard deviation of ln(leakage) if nothing is known.
_UNKNOWN_DEVIATION = 30.0
#: Standard deviation of the class of a scene (1 or −1) that remains even if very many scenes are solved.
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
        """Predict mean and standard deviation (m, k) at points (m, dimensions).

        These are the usual formulas of a Gaussian process (Rasmussen and Williams, equations 2.25 and 2.26).
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

        Each value is predicted from all others, and its error is divided by the standard deviation of the prediction
        (Rasmussen and Williams, equation 5.12).
        """
        precision = (self._whitening**2).sum(0)  # diagonal of the inverse of the covariance
        return np.asarray(self._weights / self._scale / np.sqrt(precision)[:, None])


@dataclass(frozen=True)
class _Data:
    """Values (n, k) at points (n, dimensions) of the unit cube."""

    points: Array
    values: Array


def _fit_processes(data_sets: list[_Data]) -> list[Process]:
    """Fit Gaussian processes to several sets of data.

    All sets share their amplitudes and correlation lengths, which maximise the posterior density. The scale of each
    column of values is integrated out of this density.
    """
    if not data_sets:
        return []
    dimensions = data_sets[0].points.shape[1]
    # parameters: for each of the two processes, one amplitude and then a correlation length along every dimension
    repetitions = [1, dimensions]
    medians = np.repeat(_PRIOR_MEDIANS, repetitions, axis=1).ravel()
    deviations = np.repeat(_PRIOR_DEVIATIONS, repetitions, axis=1).ravel()
    standardised_sets = []
    for data in data_sets:
        _, standardised_values = _standardise(data.values)
        standardised_sets.append(_Data(data.points, standardised_values))

    def negative_log_posterior(parameters: Array) -> float:
        total = 0.5 * (((parameters - medians) / deviations) ** 2).sum()
        for data in standardised_sets:
            covariance = _covariance(parameters, data.points, data.points)
            solution = _solve(covariance, data.values)
            degrees_of_freedom = max(len(data.points) - dimensions - 1, 1)
            squares = solution.squares
            # density of the values after integration over their mean, trend and scale
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

    loads : indices of the loads. scenes : indices of the open scenes (scenes,).
    """

    loads: list[int]
    scenes: Indices


def _group_loads(is_open: Flags) -> list[_LoadGroup]:
    """Group loads that are open in the same scenes; loads with too few open scenes are left out.

    is_open : array of bool (scenes, loads).
    """
    # a column of `is_open` as bytes is the key of a group
    loads_by_pattern: dict[bytes, list[int]] = {}
    for load in np.flatnonzero(is_open.sum(0) >= FEWEST):
        loads_by_pattern.setdefault(is_open[:, load].tobytes(), []).append(int(load))
    return [
        _LoadGroup(loads, np.flatnonzero(is_open[:, loads[0]]))
        for loads in loads_by_pattern.values()
    ]


class Prediction(NamedTuple):
    """Prediction of the surrogate at several points.

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
    """Interpolation of ln(leakage) between solved scenes, and of the probability that a scene leaks, at several loads.

    Parameters
    ----------
    leakage : tuple of pairs (list of int, Process)
        Groups of loads that are open in the same scenes, each with the processes of the cube root of the leakage at
        these loads. Loads that are open in too few scenes are in no group.
    open : pair (list of int, Process), optional
        Loads at which some scenes are open and others are sealed, and the processes of the class (1 or −1) at these
        loads; None if there is no such load.
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
    def fit(cls, points: Array, leakage: Array) -> Surrogate:
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
            errors[group.scenes[:, None], group.loads] = process.leave_one_out_errors()
        scene_class = np.where(is_open, 1.0, -1.0)
        mixed_loads = np.flatnonzero(np.ptp(scene_class, axis=0)).tolist()
        class_process = None
        if mixed_loads:
            (process,) = _fit_processes([_Data(points, scene_class[:, mixed_loads])])
            class_process = mixed_loads, process
        loads = [group.loads for group in groups]
        leakage_processes = tuple(zip(loads, processes, strict=True))
        return cls(leakage_processes, class_process, scene_class[0], _correlation(errors))

    def predict(self, points: Array) -> Prediction:
        """Predict the leakage at points (points, dimensions) of the unit cube."""
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
    """Estimate the correlation (loads, loads) of prediction errors (scenes, loads) at two loads.

    With few scenes this estimate is uncertain. It is therefore reduced by 5 %, so that the covariance matrix stays
    regular and no combination of loads appears to be known exactly.
    """
    norms = np.sqrt((errors**2).sum(0)) + 1e-30
    correlation = 0.95 * np.clip(errors.T @ errors / np.outer(norms, norms), -1, 1)
    np.fill_diagonal(correlation, 1.0)
    return np.asarray(correlation)


def _logarithm(mean: Array, deviation: Array) -> tuple[Array, Array]:
    """Convert a normally distributed cube root of the leakage to the distribution of ln(leakage).

    The normal distribution is truncated at 0, because the leakage of an open scene is positive.

    Returns
    -------
    median, deviation : array
        Median of ln(leakage), and half the distance between its quantiles at the probabilities 0.16 and 0.84, which are
        1 standard deviation away from the median in a normal distribution.
    """
    ratio = np.maximum(mean / deviation, -1e3)

    def quantile(normal_score: float) -> Array:
        truncated = ratio - ndtri_exp(log_ndtr(ratio) + log_ndtr(-normal_score))
        return 3 * np.log(deviation * truncated)

    return quantile(0.0), (quantile(1.0) - quantile(-1.0)) / 2
