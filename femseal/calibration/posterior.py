"""Compute the posterior of hardness, shortest wave and factor from a leak test, by Bayes' rule.

The measured leakage is the factor times the leakage of the model. ln(measured) is normally distributed around
ln(factor) + ln(model). Its variance is that of the test, which is independent for each row, plus that of the surrogate,
which is correlated between loads. In a sealed row, the model is sealed too, or leaks less than the limit of this row.
The priors are uniform in the logarithm within their ranges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr
from scipy.stats import qmc

from ..base import Array
from .leak_test import LeakTest
from .surrogate import Prediction, Surrogate

#: Units of the calibrated quantities, in the order of all arrays.
UNITS = {"hardness": "Pa", "shortest_wave": "m", "factor": ""}
#: Probability that the intervals of the calibrated quantities contain the true value.
PROBABILITY = 0.9
#: Fraction of the probability that may be neglected when only the most probable squares are divided further.
_NEGLECTED_PROBABILITY = 1e-4
#: Number of slabs into which each square is divided along ln(factor).
_SLABS = 24
#: Distance of the first and the last slab from the mean of ln(factor), in its standard deviations.
_SLAB_RANGE = 4.5


@dataclass(frozen=True)
class Estimate:
    """A quantity in SI: its median, and the shortest interval that contains it with the probability `PROBABILITY`."""

    median: float
    lower: float
    upper: float

    @classmethod
    def from_samples(cls, values: Array) -> Estimate:
        """Estimate a positive quantity from samples (n,); the interval is the shortest one on a logarithmic scale."""
        ordered = np.sort(values)
        count = int(np.ceil(PROBABILITY * len(ordered)))
        starts = ordered[: len(ordered) - count + 1]
        ends = ordered[count - 1 :]
        shortest = np.argmin(np.log(ends / starts))
        return cls(float(np.median(ordered)), float(starts[shortest]), float(ends[shortest]))


@dataclass(frozen=True, eq=False)
class FactorDensity:
    """Posterior density of ln(factor) at several pairs of hardness and shortest wave.

    The rows that leak give a normal density. It is multiplied by the probability of each sealed row.

    Parameters
    ----------
    mean, deviation : array (pairs, 1)
        Mean and standard deviation of the normal density.
    misfit : array (pairs, 1)
        Sum of the squares of the standardised residuals of the rows that leak, with the factor at the mean.
    log_scale : array (pairs, 1)
        ln of that part of the density which does not depend on the residuals.
    sealed_limit : array (pairs, sealed rows)
        ln(limit) − ln(model) of the sealed rows.
    sealed_deviation : array (pairs, sealed rows)
        Standard deviation of `sealed_limit`.
    sealed_is_open : array (pairs, sealed rows)
        Probability that the model leaks in the sealed rows.
    """

    mean: Array
    deviation: Array
    misfit: Array
    log_scale: Array
    sealed_limit: Array
    sealed_deviation: Array
    sealed_is_open: Array

    def log_density(self, log_factor: Array) -> Array:
        """Compute ln of the density, up to a constant, at values (pairs, m) of ln(factor)."""
        standardised = (log_factor - self.mean) / self.deviation
        log_density = self.log_scale - 0.5 * (self.misfit + standardised**2)
        for row in range(self.sealed_limit.shape[1]):
            limit = self.sealed_limit[:, row, None]
            # probability that an open model leaks more than the limit
            exceeds_limit = ndtr((log_factor - limit) / self.sealed_deviation[:, row, None])
            log_density += np.log(1 - self.sealed_is_open[:, row, None] * exceeds_limit)
        return log_density


@dataclass(frozen=True, eq=False)
class _Slabs:
    """Small squares of the unit square of hardness and wave, each with slabs of equal width along ln(factor).

    Parameters
    ----------
    centres : array (squares, 2)
        Centres of the squares.
    n_along_side : int
        Number of such squares along a side of the unit square.
    first, last : array (squares, 1)
        Ends of the range of the slabs.
    probability : array (squares, slabs)
        Probability of every slab, up to a constant.
    """

    centres: Array
    n_along_side: int
    first: Array
    last: Array
    probability: Array


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior density in the unit cube.

    The coordinates of the cube are the logarithms of the three quantities, scaled from their ranges to 0 to 1.

    Parameters
    ----------
    test : LeakTest
        The leak test.
    rows : list of int
        Index of the load of each row of the test in the loads of the surrogate.
    ranges : array (3, 2)
        Ends of the ranges of the priors in SI.
    surrogate : Surrogate
        Prediction of the leakage of the model.
    error : float
        Relative standard deviation of the measured leakages.
    """

    test: LeakTest
    rows: list[int]
    ranges: Array
    surrogate: Surrogate
    error: float

    def quantities(self, cube: Array) -> Array:
        """Convert points of the unit cube (n, 3) to the quantities in SI (n, 3)."""
        low, high = np.log(self.ranges).T
        return np.asarray(np.exp(low + cube * (high - low)))

    def predict(self, cube: Array) -> Prediction:
        """Predict the leakage of every row of the test at points of the unit cube (n, 3), including the factor."""
        model = self._predict_rows(cube[:, :2])
        log_factor = np.log(self.quantities(cube)[:, 2:])
        return Prediction(model.mean + log_factor, model.deviation, model.is_open)

    def _predict_rows(self, plane: Array) -> Prediction:
        """Predict the leakage of the model for every row of the test at hardnesses and waves (pairs, 2)."""
        mean, deviation, is_open = self.surrogate.predict(plane)
        return Prediction(mean[:, self.rows], deviation[:, self.rows], is_open[:, self.rows])

    def factor_density(self, plane: Array) -> FactorDensity:
        """Compute the density of ln(factor) at pairs of hardness and wave (pairs, 2) in the unit square."""
        mean, deviation, is_open = self._predict_rows(plane)
        is_sealed = self.test.sealed
        leaks = ~is_sealed
        residuals = np.log(self.test.leakage) - mean  # (pair, row)
        loads = np.array(self.rows)[leaks]
        errors = deviation[:, leaks]  # (pair, row that leaks)
        correlation = self.surrogate.correlation[np.ix_(loads, loads)]
        surrogate_covariance = correlation * errors[:, :, None] * errors[:, None]
        covariance = surrogate_covariance + self.error**2 * np.eye(len(loads))  # (pair, row, row)
        # Generalised least squares: ln(factor) is the constant that is fitted to the residuals. Dividing residuals and
        # ones by the Cholesky factor of the covariance makes it an ordinary least-squares problem.
        root = np.linalg.cholesky(covariance)
        columns = np.stack([residuals[:, leaks], np.ones_like(errors)], axis=-1)
        white_columns = np.linalg.solve(root, columns)
        white_residuals = white_columns[..., 0]
        white_ones = white_columns[..., 1]
        factor_deviation = (white_ones**2).sum(1, keepdims=True) ** -0.5
        factor_mean = (white_ones * white_residuals).sum(1, keepdims=True) * factor_deviation**2
        misfit = ((white_residuals - white_ones * factor_mean) ** 2).sum(1, keepdims=True)
        log_open = np.log(is_open[:, leaks]).sum(1)
        log_determinant = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(1)
        return FactorDensity(
            mean=factor_mean,
            deviation=factor_deviation,
            misfit=misfit,
            log_scale=(log_open - log_determinant)[:, None],
            sealed_limit=residuals[:, is_sealed],
            sealed_deviation=np.hypot(deviation[:, is_sealed], self.error),
            sealed_is_open=is_open[:, is_sealed],
        )

    def samples(self, count: int) -> Array:
        """Draw quasi-random samples of the posterior in the unit cube.

        The unit square of hardness and wave is divided into small squares, four for each sample. As long as the most
        probable quarter of them contains nearly all of the probability, only these are kept and divided further. Each
        square is divided into slabs along ln(factor). A Sobol sequence then chooses slabs, and points in the slabs. If
        the last digits of the density change, only a few samples move, and only to the next square. In a Markov chain,
        all later samples would change.

        Parameters
        ----------
        count : int
            Number of samples, a power of 2.

        Returns
        -------
        array (count, 3)
        """
        slabs = self._probable_slabs(4 * count)
        # random numbers of each sample: for the choice of a slab, and for the position in it along three axes
        random = qmc.Sobol(4, rng=np.random.default_rng(1)).random_base2(count.bit_length() - 1)
        # a slab is chosen where the cumulative probability of all slabs reaches the first random number
        cumulative = np.cumsum(slabs.probability) / slabs.probability.sum()
        flat_index = np.searchsorted(cumulative[:-1], random[:, 0])
        square, slab = np.divmod(flat_index, _SLABS)
        plane = slabs.centres[square] + (random[:, 1:3] - 0.5) / slabs.n_along_side
        width = (slabs.last - slabs.first)[square, 0]
        log_factor = slabs.first[square, 0] + width * (slab + random[:, 3]) / _SLABS
        low, high = np.log(self.ranges[2])
        return np.c_[plane, (log_factor - low) / (high - low)]

    def _probable_slabs(self, least_count: int) -> _Slabs:
        """Divide the unit square of hardness and wave into small squares with slabs, see `samples`.

        least_count : smallest number of squares, approximately.
        """
        n_along_side = round(least_count**0.5)
        centres = (np.indices((n_along_side, n_along_side)).reshape(2, -1).T + 0.5) / n_along_side
        while True:
            slabs = self._slabs(centres, n_along_side)
            probability = slabs.probability.sum(1)  # (square,)
            most_probable_first = np.argsort(-probability, kind="stable")
            best = np.sort(most_probable_first[: len(centres) // 4])
            if not probability[best].sum() >= (1 - _NEGLECTED_PROBABILITY) * probability.sum():
                return slabs
            # the most probable quarter of the squares contains nearly all of the probability: divide them in four
            n_along_side *= 2
            to_quarters = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) / (2 * n_along_side)
            centres = (centres[best, None] + to_quarters).reshape(-1, 2)

    def _slabs(self, centres: Array, n_along_side: int) -> _Slabs:
        """Divide squares with these centres (squares, 2) into slabs along ln(factor).

        The slabs cover several standard deviations around the mean of ln(factor), as far as they are within its range.
        """
        low, high = np.log(self.ranges[2])
        density = self.factor_density(centres)
        centre = np.clip(density.mean, low, high)
        first = np.clip(centre - _SLAB_RANGE * density.deviation, low, high)
        last = np.clip(centre + _SLAB_RANGE * density.deviation, low, high)
        middles = first + (last - first) * (np.arange(_SLABS) + 0.5) / _SLABS
        # the slabs of all squares have the same number, but not the same width
        log_probability = density.log_density(middles) + np.log(last - first)
        probability = np.exp(log_probability - log_probability.max())
        return _Slabs(centres, n_along_side, first, last, probability)
