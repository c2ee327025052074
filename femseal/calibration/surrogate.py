"""Interpolate the leakage between simulations by Gaussian processes.

A simulation solves the case with a given hardness and a given shortest wave. The hardness and the shortest wave of a
simulation are scaled to a point of the unit square. At each load, a Gaussian process models the cube root of the
leakage. The cube root is used because it is a smooth function near sealing: the leakage of a closing channel is
proportional to the cube of its gap. The Gaussian process is the sum of

- a linear trend,
- a smooth process, with a squared exponential covariance, and
- a rough process, whose covariance along the last axis, the shortest wave, is exponential, exp(−r). The rough process
  describes how the leakage jumps as the shortest wave varies. The leakage jumps if the low-pass filter removes a wave
  that opens or closes a channel.

The correlation lengths and the relative amplitudes of the smooth and the rough process are common to all loads, and
maximise the posterior density with weak priors. The absolute amplitude is different for each load (Rasmussen and
Williams, Gaussian Processes for Machine Learning, 2006, sections 2.2, 2.7 and 5.4; Conti and O'Hagan, J Stat Plan
Inference 140, 2010, section 2). Simulations without leakage are not used to fit the leakage.

A second Gaussian process predicts whether the seal leaks. The second process is fitted by least squares to 1 for each
simulation that leaks and to −1 for each sealed one (Rasmussen and Williams, section 6.5).
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
#: Each coordinate of the centre of the unit cube, at which the linear trend has its mean.
_CENTRE = 0.5
#: Index of the rough process among the two processes; the smooth process has the index 0.
_ROUGH = 1
#: Variance that is added because of rounding, relative to the variance of the values.
_ROUNDING_VARIANCE = 1e-8
#: Medians of the priors of ln(amplitude) and ln(correlation length), axes: process, parameter. The first row is for the
#: smooth process, and the second row is for the rough process.
_PRIOR_MEDIANS = np.log([[0.5, 1.0], [0.05, 0.3]])
#: Standard deviations of the priors of ln(amplitude) and ln(correlation length), axes: process, parameter.
_PRIOR_DEVIATIONS = np.array([[1.5, 0.7], [1.5, 1.0]])
#: Decimals to which ln(amplitude) and ln(correlation length) are rounded, so that the results do not depend on the last
#: digits of the fit.
_PARAMETER_DECIMALS = 3
#: Smallest number of simulations with a leakage from which the leakage at a load can be predicted.
FEWEST_LEAKING = 6
#: Limit of the predicted probabilities: the probability that the seal leaks is never closer than this to 0 or 1.
LEAST_PROBABILITY = 1e-3
#: Standard deviation of ln(leakage) at a load at which too few simulations leak for a prediction.
_UNKNOWN_DEVIATION = 30.0
#: Standard deviation of the predicted value for leaking (1) or sealed (−1) that remains even after very many
#: simulations.
_CLASS_DEVIATION = 0.2


@dataclass(frozen=True)
class _Solution:
    """Solution of K w = y for each of the k columns y of the values (n, k), with the covariance K = LLᵀ (n, n).

    log_root_determinant : ln|L|, half of ln|K|.
    whitening : L⁻¹ (n, n).
    weights : w = K⁻¹y (n, k).
    squares : yᵀK⁻¹y (k,).
    """

    log_root_determinant: float
    whitening: Array
    weights: Array
    squares: Array


def _solve(covariance: Array, values: Array) -> _Solution:
    """Solve K w = y by the Cholesky factor of the covariance K (n, n), for each column y of the values (n, k).

    The values must be standardised: each column has the mean 0 and the standard deviation 1.
    """
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
    """Compute the prior covariance (m, n) between the points `a` (m, dimensions) and the points `b` (n, dimensions).

    The covariance between two points is

        V (1 + (a − c)·(b − c)) + Σ A² exp(−Σ e_d),

    with the variance V of the trend coefficients and the centre c of the unit cube. The first sum is over the smooth
    and the rough process, with the amplitude A of a process. The second sum is over the dimensions d, with e_d = r_d²/2
    and the distance r_d of the points in correlation lengths. For the last dimension of the rough process, e_d is equal
    to r_d.

    parameters : ln(amplitude) and ln(correlation lengths) of the smooth process, then ln(amplitude) and ln(correlation
        lengths) of the rough process.
    """
    # (process, 1, 1, parameter), where the axes of length 1 are for the points a and b
    amplitudes_and_lengths = np.exp(parameters).reshape(2, 1, 1, -1)
    amplitudes = amplitudes_and_lengths[..., 0]  # (process, 1, 1)
    lengths = amplitudes_and_lengths[..., 1:]  # (process, 1, 1, dimension)
    distances = np.abs(a[:, None] - b) / lengths  # (process, m, n, dimension)
    exponents = 0.5 * distances**2
    exponents[_ROUGH, ..., -1] = distances[_ROUGH, ..., -1]
    processes = amplitudes**2 * np.exp(-exponents.sum(-1))  # (process, m, n)
    trend = _TREND_VARIANCE * (1 + (a - _CENTRE) @ (b - _CENTRE).T)
    covariance = trend + processes.sum(0)
    # the last digits of a product depend on the order of the arrays in memory
    return np.ascontiguousarray(covariance)


def _standardise(values: Array) -> tuple[Array, Array]:
    """Return the standard deviation (k,) of each column of the values (n, k), and the standardised values (n, k)."""
    deviations = np.where(np.ptp(values, axis=0) > 0, values.std(0), 1.0)
    return deviations, (values - values.mean(0)) / deviations


class GaussianProcess:
    """Model k quantities by Gaussian processes with shared correlation lengths but separate means and scales.

    Parameters
    ----------
    parameters : array (2 × (1 + dimensions),)
        ln(amplitude) and ln(correlation lengths) of the smooth process, then ln(amplitude) and ln(correlation lengths)
        of the rough process.
    points : array (n, dimensions)
        Points in the unit cube at which the quantities are known.
    values : array (n, k)
        Values of the k quantities at the points.
    """

    def __init__(self, parameters: Array, points: Array, values: Array) -> None:
        """Solve for the weights of the predictions; see the class for the arguments."""
        self._parameters = parameters
        self._points = points
        # the covariance describes standardised values, so that predictions must be scaled back to the values
        self._mean = values.mean(0)  # (k,)
        deviations, standardised = _standardise(values)
        solution = _solve(_covariance(parameters, points, points), standardised)
        self._whitening = solution.whitening
        self._weights = deviations * solution.weights
        # standard deviation of Student's distribution, which replaces the normal distribution because the scale is
        # unknown
        degrees_of_freedom = max(len(points) - points.shape[1] - 3, 1)
        self._scale = deviations * np.sqrt(solution.squares / degrees_of_freedom)

    def predict(self, points: Array) -> tuple[Array, Array]:
        """Predict the mean and the standard deviation of the k quantities at points (m, dimensions).

        The mean and the standard deviation, two arrays (m, k), follow from the usual Gaussian-process formulas
        (Rasmussen and Williams, equations 2.25 and 2.26).
        """
        covariance = _covariance(self._parameters, points, self._points)  # (m, n)
        mean = self._mean + covariance @ self._weights  # (m, k)
        # The variance is the variance of the prior at the points, minus the part that the known values explain. The
        # explained part is c K⁻¹ cᵀ = |L⁻¹ cᵀ|² for each row c of the covariance.
        explained = ((self._whitening @ covariance.T) ** 2).sum(0)  # (m,)
        # ln(amplitude) is the first parameter of each process, before its `dimensions` correlation lengths
        dimensions = points.shape[1]
        log_amplitudes = self._parameters[[0, dimensions + 1]]
        trend_variance = _TREND_VARIANCE * (1 + ((points - _CENTRE) ** 2).sum(-1))
        prior_variance = trend_variance + np.exp(2 * log_amplitudes).sum()
        variance = np.maximum(prior_variance - explained, _ROUNDING_VARIANCE)
        return mean, self._scale * np.sqrt(variance)[:, None]

    def leave_one_out_errors(self) -> Array:
        """Compute the standardised errors (n, k) of leave-one-out prediction.

        The value at each point is predicted from all other points, and the prediction error is divided by its standard
        deviation. With the weights w = K⁻¹y, the error of the prediction at point i is w_i / (K⁻¹)_ii, and its standard
        deviation is (K⁻¹)_ii^(-1/2) (Rasmussen and Williams, equation 5.12). The standardised error at point i is the
        ratio w_i / (K⁻¹)_ii^(1/2).
        """
        # the diagonal of K⁻¹ = (L⁻¹)ᵀ L⁻¹ contains the sums of squares of the columns of L⁻¹
        inverse_diagonal = (self._whitening**2).sum(0)
        # the weights are scaled to the values, and are divided by the scale to standardise them
        return np.asarray(self._weights / self._scale / np.sqrt(inverse_diagonal)[:, None])


@dataclass(frozen=True)
class _Data:
    """Values (n, k) of k quantities at points (n, dimensions) of the unit cube."""

    points: Array
    values: Array


def _fit_processes(data_sets: list[_Data]) -> list[GaussianProcess]:
    """Fit Gaussian processes with common amplitudes and correlation lengths to several sets of data.

    The amplitudes and correlation lengths maximise the posterior density. The mean, the trend and the scale of each
    column y are unknown and are integrated out of the posterior density. Up to a constant, the negative logarithm of
    the integrated posterior density is

        −ln(density) = Σ ((parameter − median) / deviation)² / 2 + Σ (ν/2 ln(yᵀK⁻¹y) + ln|L|).

    The first sum is over the parameters, ln(amplitude) and ln(correlation length), with the median and the standard
    deviation of their prior. The second sum is over the columns y of all sets of data, with the covariance K = LLᵀ. The
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
        """Compute −ln(density) of the parameters, up to a constant, using the formula in `_fit_processes`."""
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
    return [GaussianProcess(parameters, data.points, data.values) for data in data_sets]


@dataclass(frozen=True)
class _LoadGroup:
    """A group of loads where exactly the same simulations leak.

    loads : indices of the loads in the group.
    simulations : indices of the simulations that leak at the loads.
    """

    loads: list[int]
    simulations: Indices


def _group_loads(is_open: Flags) -> list[_LoadGroup]:
    """Group the loads so that exactly the same simulations leak at all loads of a group.

    A load at which fewer than `FEWEST_LEAKING` simulations leak belongs to no group.

    is_open : array of bool (simulations, loads), whether each simulation leaks at each load.
    """
    # arrays cannot be keys of a dictionary, but the bytes of a column of `is_open` can
    loads_by_pattern: dict[bytes, list[int]] = {}
    for load in np.flatnonzero(is_open.sum(0) >= FEWEST_LEAKING):
        pattern = is_open[:, load].tobytes()
        loads_by_pattern.setdefault(pattern, []).append(int(load))
    groups = []
    for loads in loads_by_pattern.values():
        leaking_simulations = np.flatnonzero(is_open[:, loads[0]])
        groups.append(_LoadGroup(loads, leaking_simulations))
    return groups


class Prediction(NamedTuple):
    """Leakage that the surrogate predicts at several points and loads.

    Parameters
    ----------
    mean, deviation : array (points, loads)
        Median and standard deviation of ln(leakage), under the condition that the seal leaks.
    is_open : array (points, loads)
        Probability that the seal leaks.
    """

    mean: Array
    deviation: Array
    is_open: Array


class _ProcessAtLoads(NamedTuple):
    """Indices of several loads, and the Gaussian processes of a quantity at these loads."""

    loads: list[int]
    process: GaussianProcess


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Predict the leakage at several loads by interpolation between simulations.

    Parameters
    ----------
    leakage : tuple of _ProcessAtLoads
        Gaussian processes of the cube root of the leakage, one entry for each group of loads, see `_group_loads`.
    open : _ProcessAtLoads, optional
        Gaussian processes that predict 1 if the seal leaks and −1 if the seal is sealed. These processes exist for the
        loads where some simulations leak and others are sealed. None if the simulations agree at every load.
    common_class : array (loads,)
        1 if the first simulation leaks at a load, −1 if the first simulation is sealed. At loads that are not in
        `open`, all simulations have the value of the first simulation.
    correlation : array (loads, loads)
        Correlation between the prediction errors of ln(leakage) at two loads.
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
            Leakage of each simulation at each load, 0 where the seal is sealed.
        """
        is_open = leakage > 0  # (simulation, load)
        groups = _group_loads(is_open)
        data_sets = []
        for group in groups:
            leakage_of_group = leakage[group.simulations][:, group.loads]
            data_sets.append(_Data(points[group.simulations], np.cbrt(leakage_of_group)))
        processes = _fit_processes(data_sets)  # one for each group
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

        The Gaussian processes in `open` predict a value above 0 if the seal leaks. The predicted value is normally
        distributed, so that the seal leaks with the probability Φ(mean / deviation), where mean and deviation describe
        the predicted value and Φ is the normal distribution function.
        """
        shape = len(points), len(self.common_class)  # (point, load)
        mean = np.zeros(shape)
        deviation = np.full(shape, _UNKNOWN_DEVIATION)
        for loads, process in self.leakage:
            mean[:, loads], deviation[:, loads] = _logarithm(*process.predict(points))
        # at loads at which the simulations agree, every point gets the common value of the simulations
        class_mean = np.tile(self.common_class, (len(points), 1))
        class_deviation = np.zeros(shape)
        if self.open is not None:
            loads, process = self.open
            class_mean[:, loads], class_deviation[:, loads] = process.predict(points)
        probability = ndtr(class_mean / np.hypot(class_deviation, _CLASS_DEVIATION))
        return Prediction(
            mean, deviation, np.clip(probability, LEAST_PROBABILITY, 1 - LEAST_PROBABILITY)
        )


def _correlation(errors: Array) -> Array:
    """Estimate the correlation between the prediction errors at each pair of loads.

    With few simulations, the estimated correlations are uncertain. The correlations are reduced by 5 %, because the
    covariance matrix of the prediction errors could otherwise be singular. If the covariance matrix were singular, some
    combination of the leakages at several loads would be known exactly.

    Parameters
    ----------
    errors : array (simulations, loads)
        Standardised errors of the leave-one-out predictions, whose expectation is 0. The correlations are computed
        without subtracting a mean.

    Returns
    -------
    array (loads, loads)
    """
    norms = np.sqrt((errors**2).sum(0)) + 1e-30  # not 0 at loads where no leakage is predicted
    correlation = 0.95 * np.clip(errors.T @ errors / np.outer(norms, norms), -1, 1)
    np.fill_diagonal(correlation, 1.0)
    return np.asarray(correlation)


def _logarithm(mean: Array, deviation: Array) -> tuple[Array, Array]:
    """Compute the distribution of ln(leakage) from mean and standard deviation of the cube root of the leakage.

    Let x be the cube root of the leakage. The distribution of x is normal but truncated at 0, because x is positive if
    the seal leaks. Let Φ be the normal distribution function, and r = mean/deviation. The quantile of x at the
    probability Φ(s) is deviation (r − Φ⁻¹(Φ(r) Φ(−s))). With this quantile x, the quantile of ln(leakage) at the
    probability Φ(s) is 3 ln(x).

    Returns
    -------
    median, deviation : array
        Median and standard deviation of ln(leakage). The standard deviation is half the distance between the quantiles
        for s = −1 and s = 1, as for a normal distribution of ln(leakage).
    """
    # for smaller ratios, the difference in `quantile` would lose its digits
    ratio = np.maximum(mean / deviation, -1e3)

    def quantile(normal_score: float) -> Array:
        """Return the quantile of ln(leakage) at the probability Φ(normal_score)."""
        cube_root = ratio - ndtri_exp(log_ndtr(ratio) + log_ndtr(-normal_score))
        return 3 * np.log(deviation * cube_root)

    return quantile(0.0), (quantile(1.0) - quantile(-1.0)) / 2
