"""A surrogate of the leakage of scenes: a case solved at many values of a few of its keys.

It is a Gaussian process for each load. The cube root of the leakage, which is as the gap of a channel that
closes and so errs alike near sealing and far from it, is a linear trend, plus a smooth process, plus one that jumps
along the last axis, where its covariance falls as exp(−r), as waves that are removed open and close single channels.
Lengths and ratios of sizes are the most likely ones for all loads together, with weak priors; each load has a scale of
its own (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 2.2, 2.7, 5.4; Conti and
O'Hagan, J Stat Plan Inference 140, 2010, section 2). Scenes that are sealed are left out of it: whether a scene is open
is a process of its own, of −1 and 1, by least squares (section 6.5 of the book).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr, ndtri_exp

from ..base import Array

#: Variance of the linear trend in variances of the values, and part of that variance that rounding may be.
_TREND, _ROUNDING = 25.0, 1e-8
#: Priors of size and lengths of the smooth and of the other process: ln of their medians, standard deviations of ln.
_MEDIANS, _WIDTHS = np.log([[0.5, 1.0], [0.05, 0.3]]), np.array([[1.5, 0.7], [1.5, 1.0]])
#: Decimals of the logarithms of sizes and lengths.
_DIGITS = 3
#: Scenes that are open at a load, without which nothing is known of its leakage; least probability of either class.
FEWEST, LEAST = 6, 1e-3
#: Standard deviation of an unknown ln(leakage), and of the class by which open and sealed scenes mix at least.
_UNKNOWN, _BLUR = 30.0, 0.2


class Process:
    """Gaussian processes through values (n, k) at points (n, dimensions) of the unit cube, each with its own scale."""

    def __init__(self, parameters: Array, points: Array, values: Array) -> None:
        self._points, self._parameters, self._mean = points, parameters, values.mean(0)
        size, scaled = _standard(values)
        _, self._whitening, weights, squares = _solved(
            _covariance(parameters, points, points), scaled
        )
        # variance of the Student distribution that an unknown scale makes of a normal one
        self._size = size * np.sqrt(squares / max(len(points) - points.shape[1] - 3, 1))
        self._weights = size * weights

    def at(self, points: Array) -> tuple[Array, Array]:
        """Mean and standard deviation (m, k) at points (m, dimensions)."""
        between = _covariance(self._parameters, points, self._points)
        half = self._whitening @ between.T
        own = (
            _TREND * (1 + ((points - 0.5) ** 2).sum(-1))
            + np.exp(2 * self._parameters[[0, points.shape[1] + 1]]).sum()
        )
        variance = np.maximum(own - (half**2).sum(0), _ROUNDING)
        return self._mean + between @ self._weights, self._size * np.sqrt(variance)[:, None]

    def left_out(self) -> Array:
        """Error at each point of the processes through the others, in their standard deviations (n, k)."""
        own = np.sqrt((self._whitening**2).sum(0))[:, None]
        return np.asarray(self._weights / self._size / own)


def _standard(values: Array) -> tuple[Array, Array]:
    """Standard deviations of values (n, k), and the values in them."""
    size = np.where(np.ptp(values, axis=0) > 0, values.std(0), 1.0)
    return size, (values - values.mean(0)) / size


def _through(sets: list[tuple[Array, Array]]) -> list[Process]:
    """Processes through sets of points (n, dimensions) and values (n, k), with the parameters most likely for all."""
    if not sets:
        return []
    dimensions = sets[0][0].shape[1]
    start = np.concatenate([np.r_[m[0], np.full(dimensions, m[1])] for m in _MEDIANS])
    widths = np.concatenate([np.r_[w[0], np.full(dimensions, w[1])] for w in _WIDTHS])
    standard = [(points, _standard(values)[1]) for points, values in sets]

    def unlikely(parameters: Array) -> float:
        fit = 0.5 * (((parameters - start) / widths) ** 2).sum()
        for points, scaled in standard:
            volume, _, _, squares = _solved(_covariance(parameters, points, points), scaled)
            free = max(len(points) - dimensions - 1, 1)
            fit += 0.5 * free * np.log(squares).sum() + len(squares) * volume
        return float(fit)

    bounds = list(zip(start - 4 * widths, start + 4 * widths, strict=True))
    # where a search stops depends on last digits: they must not matter to what follows
    options = {"ftol": 1e-14, "gtol": 1e-7}
    found = minimize(
        unlikely, start, jac="3-point", method="L-BFGS-B", bounds=bounds, options=options
    )
    parameters = found.x.round(_DIGITS)
    return [Process(parameters, points, values) for points, values in sets]


def _solved(covariance: Array, scaled: Array) -> tuple[float, Array, Array, Array]:
    """Of values y (n, k) with the covariance K = LLᵀ: ln|L|, L⁻¹, K⁻¹y, and the squares yᵀK⁻¹y (k,)."""
    root = np.linalg.cholesky(covariance + _ROUNDING * (1 + _TREND) * np.eye(len(covariance)))
    whitening = solve_triangular(root, np.eye(len(root)), lower=True)
    white = whitening @ scaled
    squares = np.maximum((white**2).sum(0), _ROUNDING)
    return float(np.log(np.diag(root)).sum()), whitening, whitening.T @ white, squares


def _covariance(parameters: Array, a: Array, b: Array) -> Array:
    """Covariance between points a (m, d) and b (n, d): trend, smooth process, and one that jumps along an axis."""
    both = np.exp(parameters).reshape(2, 1, 1, -1)
    gap = np.abs(a[:, None] - b) / both[..., 1:]
    exponents = 0.5 * gap**2
    exponents[1, ..., -1] = gap[1, ..., -1]
    processes = both[..., 0] ** 2 * np.exp(-exponents.sum(-1))
    return np.asarray(_TREND * (1 + (a - 0.5) @ (b - 0.5).T) + processes.sum(0))


@dataclass(frozen=True, eq=False)
class Surrogate:
    """ln(leakage) and the probability that it is not 0, at several loads.

    leakage : sets of loads that are open in the same scenes, and the processes of the cube root of their leakage; loads
    that are open in too few have none. open : the loads at which only some scenes are open, and the processes of their
    class; None where there is none. alike : class of the scenes at the other loads (loads,), −1 or 1. correlation : of
    the errors at two loads (loads, loads).
    """

    leakage: tuple[tuple[list[int], Process], ...]
    open: tuple[list[int], Process] | None
    alike: Array
    correlation: Array

    @classmethod
    def through(cls, points: Array, leakage: Array) -> Surrogate:
        """Through scenes at points (n, dimensions) of the unit cube with leakages (n, loads) >= 0, see `Process`."""
        is_open, errors = leakage > 0, np.zeros(leakage.shape)
        sets: dict[bytes, list[int]] = {}
        for load in np.flatnonzero(is_open.sum(0) >= FEWEST):
            sets.setdefault(is_open[:, load].tobytes(), []).append(int(load))
        there = [np.flatnonzero(is_open[:, loads[0]]) for loads in sets.values()]
        gaps = [
            (points[some], np.cbrt(leakage[some][:, loads]))
            for some, loads in zip(there, sets.values(), strict=True)
        ]
        processes = tuple(zip(sets.values(), _through(gaps), strict=True))
        for some, (loads, process) in zip(there, processes, strict=True):
            errors[some[:, None], loads] = process.left_out()
        label = np.where(is_open, 1.0, -1.0)
        mixed = np.flatnonzero(np.ptp(label, axis=0)).tolist()
        classes = (mixed, _through([(points, label[:, mixed])])[0]) if mixed else None
        norm = np.sqrt((errors**2).sum(0)) + 1e-30
        # between 0 and 1 of what few scenes say, so that no combination of loads seems known exactly
        correlation = 0.95 * np.clip(errors.T @ errors / np.outer(norm, norm), -1, 1)
        np.fill_diagonal(correlation, 1.0)
        return cls(processes, classes, label[0], correlation)

    def at(self, points: Array) -> tuple[Array, Array, Array]:
        """Mean and standard deviation of ln(leakage) of open seals, and probability to be open, each (m, loads)."""
        mean, deviation, middle, width = np.zeros((4, len(points), len(self.alike)))
        deviation += _UNKNOWN
        middle += self.alike
        for loads, process in self.leakage:
            mean[:, loads], deviation[:, loads] = _logarithm(*process.at(points))
        if self.open is not None:
            loads, process = self.open
            middle[:, loads], width[:, loads] = process.at(points)
        return mean, deviation, np.clip(ndtr(middle / np.hypot(width, _BLUR)), LEAST, 1 - LEAST)


def _logarithm(mean: Array, deviation: Array) -> tuple[Array, Array]:
    """Median of ln(leakage), and half the range of its middle 68 %, where its cube root is normal and above 0."""
    ratio = np.maximum(mean / deviation, -1e3)
    quantiles = (ratio - ndtri_exp(log_ndtr(ratio) + log_ndtr(below)) for below in (1.0, 0.0, -1.0))
    low, middle, high = (3 * np.log(deviation * quantile) for quantile in quantiles)
    return middle, (high - low) / 2
